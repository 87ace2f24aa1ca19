//! How each published figure turns logged points into the curve it draws.
//!
//! * **Transfer** and single-task curves: more than 10 points are averaged over 5, each average standing at the last of
//!   its steps; values become percent of the expert's solved steps. A run continued beyond 4·10⁷ steps is shifted to 0
//!   and starts at value 0; another gets the point (0, 0) in front.
//! * **Fine-tuning by reinforcement learning**: Savitzky–Golay over 101 points, if there are more than 101.
//! * **Multi-task baselines**: percent of the expert, steps beyond 5·10⁷ dropped, averaged over 20 points, each average
//!   standing at the window's point 10; fewer than 20 points stay as they are.
//! * **CSI fine-tuning**: Savitzky–Golay over min(101, largest odd ≤ n) points from 7 points on; percent of the expert.
//! * **Portable tables**: trailing mean over a window (the first window − 1 points go) or Savitzky–Golay.
//!
//! Oracle: `tests/analysis_parity.rs`, algorithms `curve_*`, `seed_band`.

use super::{Curve, CurveError, running_mean, savitzky_golay, stitch};

/// A transfer run whose first step lies beyond this continues an earlier training.
pub const CONTINUED_RUN: f64 = 4e7;
/// Steps beyond this are not drawn in the multi-task figures.
const LAST_STEP: f64 = 5e7;
/// Window of fine-tuning curves.
const LONG_WINDOW: usize = 101;

/// What turns a logged solved fraction into percent of the expert.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransferScale {
    /// The expert's mean number of solved steps.
    pub expert_solved_steps: f64,
    pub horizon: u32,
    /// Whether values were logged in percent, as those of walking are.
    pub is_percent: bool,
}

/// The curve of a transfer or single-task figure.
#[must_use]
pub fn transfer_curve(logged: &Curve, scale: TransferScale) -> Curve {
    let smooth = if logged.len() > 10 { trailing_mean(logged, 5) } else { logged.clone() };
    let unit = if scale.is_percent { 0.01 } else { 1.0 };
    let factor = 100.0 * f64::from(scale.horizon) / scale.expert_solved_steps * unit;
    let mut points: Vec<(f64, f64)> = smooth.points().map(|(x, y)| (x, factor * y)).collect();
    match points.first().copied() {
        Some((start, _)) if start > CONTINUED_RUN => {
            points.iter_mut().for_each(|(step, _)| *step -= start);
            points[0].1 = 0.0;
        }
        _ => points.insert(0, (0.0, 0.0)),
    }
    points.into_iter().collect()
}

/// Smoothed values of a fine-tuning figure.
pub fn rl_finetuning_values(values: &[f64]) -> Result<Vec<f64>, CurveError> {
    if values.len() > LONG_WINDOW {
        savitzky_golay(values, LONG_WINDOW)
    } else {
        Ok(values.to_vec())
    }
}

/// Smoothed values of a CSI fine-tuning figure, in percent of `expert`.
pub fn csi_finetuning_values(values: &[f64], expert: f64) -> Result<Vec<f64>, CurveError> {
    let length = values.len();
    let smooth = if length < 7 {
        values.to_vec()
    } else {
        savitzky_golay(values, LONG_WINDOW.min(length - (length + 1) % 2))?
    };
    Ok(smooth.into_iter().map(|value| 100.0 * value / expert).collect())
}

/// One seed's curve of a multi-task figure, from its runs in order, in percent of `expert`.
#[must_use]
pub fn multi_task_curve(runs: &[Curve], expert: f64, window: usize) -> Curve {
    let joined: Curve = stitch(runs)
        .points()
        .filter(|(step, _)| *step <= LAST_STEP)
        .map(|(step, value)| (step, 100.0 * value / expert))
        .collect();
    if joined.len() < window {
        return joined;
    }
    let smooth = running_mean(&joined.values, window);
    let steps = joined.steps.iter().skip(window / 2);
    steps.copied().zip(smooth).collect()
}

/// How a curve of a portable table is smoothed.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Smoothing {
    None,
    /// Mean over the last points, the given number of them.
    Trailing(usize),
    /// Order 2, over an odd number of points.
    SavitzkyGolay(usize),
}

/// One seed's curve of a portable table.
pub fn portable_curve(logged: &Curve, smoothing: Smoothing) -> Result<Curve, CurveError> {
    match smoothing {
        Smoothing::None => Ok(logged.clone()),
        Smoothing::Trailing(window) => Ok(trailing_mean(logged, window)),
        Smoothing::SavitzkyGolay(window) => {
            Curve::new(logged.steps.clone(), savitzky_golay(&logged.values, window)?)
        }
    }
}

/// Means over `window` points, each at the last of its steps.
fn trailing_mean(curve: &Curve, window: usize) -> Curve {
    let steps = curve.steps.iter().skip(window.saturating_sub(1));
    steps.copied().zip(running_mean(&curve.values, window)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn line(points: usize, start: f64) -> Curve {
        (0..points).map(|i| (start + i as f64, i as f64 / 100.0)).collect()
    }

    const SCALE: TransferScale =
        TransferScale { expert_solved_steps: 50.0, horizon: 100, is_percent: false };

    #[test]
    fn a_short_curve_stays_and_starts_at_the_origin() {
        let curve = transfer_curve(&line(3, 7.0), SCALE);
        assert_eq!(curve.steps(), [0.0, 7.0, 8.0, 9.0]);
        assert_eq!(curve.values(), [0.0, 0.0, 2.0, 4.0]);
        assert_eq!(transfer_curve(&Curve::default(), SCALE).steps(), [0.0]);
    }

    #[test]
    fn a_continued_run_is_shifted_to_the_origin() {
        let curve = transfer_curve(&line(12, 5e7), SCALE);
        assert_eq!((curve.len(), curve.steps()[0], curve.values()[0]), (8, 0.0, 0.0));
        assert!((curve.values()[1] - 6.0).abs() < 1e-12);
    }

    #[test]
    fn windows_longer_than_the_curve_are_errors_or_leave_it_alone() {
        let short = line(4, 0.0);
        assert!(portable_curve(&short, Smoothing::SavitzkyGolay(5)).is_err());
        assert!(portable_curve(&short, Smoothing::Trailing(5)).unwrap().is_empty());
        assert_eq!(portable_curve(&short, Smoothing::None), Ok(short.clone()));
        assert_eq!(multi_task_curve(&[short], 1.0, 20).len(), 4);
        assert_eq!(csi_finetuning_values(&[1.0; 6], 0.5), Ok(vec![200.0; 6]));
    }

    #[test]
    fn an_even_number_of_points_is_smoothed_over_one_less() {
        for length in [7, 8, 100, 101, 102, 200] {
            assert_eq!(csi_finetuning_values(&vec![0.5; length], 0.5).unwrap().len(), length);
        }
    }
}

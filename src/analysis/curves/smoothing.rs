//! Two smoothers of evenly weighted points.
//!
//! * *Running mean* over a window of w points, only where the window fits: n − w + 1 values.
//! * *Savitzky & Golay 1964*, order 2: the value at the middle of each odd window of the parabola fitted to it; the first
//!   and last half windows take the parabola of the first and last window. With i = −h … h the parabola is
//!   `ȳ + b i + c (i² − h(h+1)/3)`, `b = Σ i y / Σ i²`, `c = Σ q y / Σ q²`, q the bracket. In the unit of the values.
//!
//! NaN spreads over every window that contains it. Oracle: `tests/analysis_parity.rs`, algorithms `savgol`,
//! `running_mean_valid`.

use super::CurveError;

/// Means over windows of `window` values; none if the window does not fit or is zero.
#[must_use]
pub fn running_mean(values: &[f64], window: usize) -> Vec<f64> {
    if window == 0 {
        return Vec::new();
    }
    // Each window is summed afresh: a sliding sum would carry the rounding of one window into all later ones.
    values.windows(window).map(|part| part.iter().sum::<f64>() / window as f64).collect()
}

/// Savitzky–Golay smoothing of order 2; as many values as given.
pub fn savitzky_golay(values: &[f64], window: usize) -> Result<Vec<f64>, CurveError> {
    if window < 3 || window.is_multiple_of(2) || window > values.len() {
        return Err(CurveError::Window { window, length: values.len() });
    }
    let half = window / 2;
    let first = Parabola::fit(&values[..window]);
    let last = Parabola::fit(&values[values.len() - window..]);
    let middle = values.windows(window).map(|part| Parabola::fit(part).at(0.0));
    let edge = |i: usize| i as f64 - half as f64;
    Ok((0..half)
        .map(|i| first.at(edge(i)))
        .chain(middle)
        .chain((half + 1..window).map(|i| last.at(edge(i))))
        .collect())
}

/// A parabola over a window, in terms that are orthogonal on it.
struct Parabola {
    level: f64,
    slope: f64,
    curvature: f64,
    /// Mean of i² over the window.
    mean_square: f64,
}

impl Parabola {
    /// The least-squares parabola of an odd number of values, at least three.
    fn fit(values: &[f64]) -> Self {
        let half = (values.len() / 2) as f64;
        let mean_square = half * (half + 1.0) / 3.0;
        let (mut sum, mut first, mut second) = (0.0, 0.0, 0.0);
        let (mut first_norm, mut second_norm) = (0.0, 0.0);
        for (index, &value) in values.iter().enumerate() {
            let i = index as f64 - half;
            let q = i * i - mean_square;
            sum += value;
            first += i * value;
            second += q * value;
            first_norm += i * i;
            second_norm += q * q;
        }
        Self {
            level: sum / values.len() as f64,
            slope: first / first_norm,
            curvature: second / second_norm,
            mean_square,
        }
    }

    fn at(&self, i: f64) -> f64 {
        self.level + self.slope * i + self.curvature * (i * i - self.mean_square)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn windows_that_do_not_fit_give_no_mean_and_are_refused_by_the_filter() {
        assert!(running_mean(&[1.0; 4], 5).is_empty() && running_mean(&[1.0; 4], 0).is_empty());
        assert_eq!(running_mean(&[1.0, 2.0, 6.0], 2), [1.5, 4.0]);
        for window in [0, 1, 4, 7] {
            let error = CurveError::Window { window, length: 5 };
            assert_eq!(savitzky_golay(&[1.0; 5], window), Err(error));
        }
    }

    proptest! {
        #[test]
        fn a_parabola_passes_unchanged_edges_included(
            a in -2.0..2.0_f64,
            b in -2.0..2.0_f64,
            c in -2.0..2.0_f64,
            half in 1..6_usize,
        ) {
            let values: Vec<f64> =
                (0..20).map(f64::from).map(|x| a + b * x + c * x * x).collect();
            let smoothed = savitzky_golay(&values, 2 * half + 1).unwrap();
            prop_assert_eq!(smoothed.len(), values.len());
            for (found, want) in smoothed.iter().zip(&values) {
                prop_assert!((found - want).abs() < 1e-9, "{found} {want}");
            }
        }
    }
}

//! Mean and spread of several seeds' curves.
//!
//! * Over **shared steps**: only the steps that every seed logged.
//! * On a **grid**: evenly spaced from the smallest first step to the largest last one (at most a given end), each seed
//!   interpolated linearly inside its own range only, averaged over the seeds present.
//!
//! Spread is the standard deviation with divisor n, in the unit of the values. The spread of one seed is 0; figures
//! draw no band then. Oracle: `tests/analysis_parity.rs`, algorithms `curve_shared_steps`, `seed_band`.

use super::super::stats::{Divisor, mean, standard_deviation};
use super::{Curve, CurveError};

/// Mean ± standard deviation over seeds.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Band {
    pub steps: Vec<f64>,
    /// NaN where no seed has a value.
    pub mean: Vec<f64>,
    pub standard_deviation: Vec<f64>,
    /// Seeds behind each point.
    pub count: Vec<usize>,
}

impl Band {
    /// Standard error of the mean at a place of the band, divisor n − 1; NaN for fewer than two seeds.
    #[must_use]
    pub fn standard_error(&self, place: usize) -> f64 {
        match self.count[place] {
            0 | 1 => f64::NAN,
            // The deviation has divisor n: s² / n = d² / (n − 1).
            count => self.standard_deviation[place] / ((count - 1) as f64).sqrt(),
        }
    }

    fn push(&mut self, step: f64, values: &[f64]) {
        self.steps.push(step);
        self.mean.push(mean(values).unwrap_or(f64::NAN));
        let deviation = standard_deviation(values, Divisor::Count);
        self.standard_deviation.push(deviation.unwrap_or(f64::NAN));
        self.count.push(values.len());
    }
}

/// The band over the steps common to all `curves`, whose steps must rise. No common step is an error.
pub fn band_over_shared_steps(curves: &[Curve]) -> Result<Band, CurveError> {
    let (first, others) = curves.split_first().ok_or(CurveError::NoCurves)?;
    let mut band = Band::default();
    for (step, value) in first.points() {
        let find = |curve: &Curve| {
            let place = curve.steps.binary_search_by(|other| other.total_cmp(&step)).ok()?;
            Some(curve.values[place])
        };
        let rest: Option<Vec<f64>> = others.iter().map(find).collect();
        if let Some(mut values) = rest {
            values.insert(0, value);
            band.push(step, &values);
        }
    }
    if band.steps.is_empty() {
        return Err(CurveError::NoSharedStep { curves: curves.len() });
    }
    Ok(band)
}

/// The band on `points` evenly spaced steps up to `end` at most. Curves must have rising steps; empty ones do not count.
pub fn band_on_grid(curves: &[Curve], points: usize, end: f64) -> Result<Band, CurveError> {
    let curves: Vec<&Curve> = curves.iter().filter(|curve| !curve.is_empty()).collect();
    let start = curves.iter().map(|curve| curve.steps[0]).reduce(f64::min);
    let last = curves.iter().map(|curve| curve.steps[curve.len() - 1]).reduce(f64::max);
    let (Some(start), Some(last)) = (start, last) else { return Err(CurveError::NoCurves) };
    let last = last.min(end);
    let spacing = (last - start) / points.saturating_sub(1).max(1) as f64;
    let mut band = Band::default();
    for index in 0..points {
        let step =
            if index > 0 && index + 1 == points { last } else { start + index as f64 * spacing };
        let values: Vec<f64> = curves.iter().filter_map(|curve| interpolate(curve, step)).collect();
        band.push(step, &values);
    }
    Ok(band)
}

/// The value of `curve` at `step`, if that lies in its range.
fn interpolate(curve: &Curve, step: f64) -> Option<f64> {
    let after = curve.steps.partition_point(|&other| other < step);
    if after == 0 {
        return (curve.steps[0] <= step).then_some(curve.values[0]);
    }
    let (right, value) = (*curve.steps.get(after)?, curve.values[after]);
    let (left, before) = (curve.steps[after - 1], curve.values[after - 1]);
    Some(before + (value - before) * (step - left) / (right - left))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: &[(f64, f64)]) -> Curve {
        points.iter().copied().collect()
    }

    #[test]
    fn only_steps_of_all_seeds_count() {
        let curves = [
            curve(&[(1.0, 0.0), (2.0, 1.0), (4.0, 5.0)]),
            curve(&[(2.0, 3.0), (3.0, 9.0), (4.0, 5.0)]),
        ];
        let band = band_over_shared_steps(&curves).unwrap();
        assert_eq!((&band.steps[..], &band.mean[..]), (&[2.0, 4.0][..], &[2.0, 5.0][..]));
        assert_eq!(band.standard_deviation, [1.0, 0.0]);
        // Of 1 and 3: standard deviation √2 with divisor n − 1, over √2 seeds.
        assert!((band.standard_error(0) - 1.0).abs() < 1e-15);
        let alone = band_over_shared_steps(&curves[..1]).unwrap();
        assert!(alone.standard_error(0).is_nan());
        let apart = [curve(&[(1.0, 0.0)]), curve(&[(2.0, 0.0)])];
        assert_eq!(band_over_shared_steps(&apart), Err(CurveError::NoSharedStep { curves: 2 }));
        assert_eq!(band_over_shared_steps(&[]), Err(CurveError::NoCurves));
    }

    #[test]
    fn a_grid_point_averages_the_seeds_that_reach_it() {
        let curves =
            [curve(&[(0.0, 0.0), (4.0, 4.0)]), curve(&[(2.0, 6.0), (3.0, 6.0)]), curve(&[])];
        let band = band_on_grid(&curves, 5, 100.0).unwrap();
        assert_eq!(band.steps, [0.0, 1.0, 2.0, 3.0, 4.0]);
        assert_eq!(band.mean, [0.0, 1.0, 4.0, 4.5, 4.0]);
        assert_eq!(band.count, [1, 1, 2, 2, 1]);
        assert_eq!(band_on_grid(&curves, 3, 2.0).unwrap().steps, [0.0, 1.0, 2.0]);
        assert_eq!(band_on_grid(&[], 3, 2.0), Err(CurveError::NoCurves));
        assert!(band_on_grid(&curves, 0, 2.0).unwrap().steps.is_empty());
    }
}

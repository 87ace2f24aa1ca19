//! Pearson's correlation and Fisher's z.
//!
//! `r = Σ(x − x̄)(y − ȳ) / √(Σ(x − x̄)² Σ(y − ȳ)²)`, in [−1, 1]; `z = atanh(r)`, with r clipped to ±0.999999 first, so
//! that a perfect correlation has a finite z. No unit.
//!
//! Degenerate: r is undefined for unequal lengths, fewer than two values, NaN, or a side without variance.
//! Oracle: `tests/analysis_parity.rs`, algorithms `pearson`, `fisher_z`.

use super::mean;

/// Largest |r| that z is taken of.
pub const LARGEST_CORRELATION: f64 = 0.999_999;

/// Pearson's correlation of two series of equal length.
#[must_use]
pub fn pearson(x: &[f64], y: &[f64]) -> Option<f64> {
    if x.len() != y.len() || x.len() < 2 {
        return None;
    }
    let (x_mean, y_mean) = (mean(x)?, mean(y)?);
    let (mut xx, mut yy, mut xy) = (0.0, 0.0, 0.0);
    for (&x, &y) in x.iter().zip(y) {
        let (x, y) = (x - x_mean, y - y_mean);
        xx += x * x;
        yy += y * y;
        xy += x * y;
    }
    // Equal values leave a deviation of rounding size only.
    let is_constant = |values: &[f64]| values.iter().all(|v| (v - values[0]).abs() == 0.0);
    let r = xy / (xx.sqrt() * yy.sqrt());
    (r.is_finite() && !is_constant(x) && !is_constant(y)).then(|| r.clamp(-1.0, 1.0))
}

/// Fisher's z of a correlation; NaN stays NaN.
#[must_use]
pub fn fisher_z(r: f64) -> f64 {
    // The library's atanh rounds differently on both sides of zero; opposite correlations get opposite z.
    r.abs().clamp(0.0, LARGEST_CORRELATION).atanh().copysign(r)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_correlate_perfectly_and_constants_not_at_all() {
        let x = [0.1, 0.2, 0.4];
        assert!((pearson(&x, &[1.0, 2.0, 4.0]).unwrap() - 1.0).abs() < 1e-15);
        assert!((pearson(&x, &[-1.0, -2.0, -4.0]).unwrap() + 1.0).abs() < 1e-15);
        assert_eq!(pearson(&x, &[0.1; 3]), None);
        assert_eq!(pearson(&x, &[1.0, 2.0]), None);
        assert_eq!(pearson(&[1.0], &[1.0]), None);
        assert_eq!(pearson(&x, &[1.0, 2.0, f64::NAN]), None);
    }

    #[test]
    fn a_perfect_correlation_has_a_finite_z() {
        assert!((fisher_z(1.0) - 0.999_999_f64.atanh()).abs() < 1e-15);
        assert!((fisher_z(-1.0) + 0.999_999_f64.atanh()).abs() < 1e-15);
        assert!(fisher_z(f64::NAN).is_nan());
    }
}

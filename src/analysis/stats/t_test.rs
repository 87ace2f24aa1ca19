//! One-sample t test: is the mean of a few values different from zero?
//!
//! `t = mean / (sd / √n)` with sd of divisor n − 1 and n − 1 degrees of freedom. Mean and s.e.m. in the unit of the
//! values; t without.
//!
//! Degenerate: fewer than two values, or NaN: undefined. Without variance t is undefined, and p is the limit: for "greater"
//! 0 with a positive mean, else 1. All values zero: t = 0, p = 1.
//!
//! Oracle: `tests/analysis_parity.rs`, algorithms `ttest_1samp_greater`, `t_sf_then_holm`.

use statrs::distribution::{Continuous, ContinuousCDF, StudentsT};

use super::{Divisor, Sidedness, mean, standard_error};

/// Outcome of a t test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TTest {
    pub mean: f64,
    pub standard_error: f64,
    /// Undefined without variance, unless the mean is zero as well.
    pub t: Option<f64>,
    pub degrees_of_freedom: usize,
    pub p: f64,
}

/// Tests whether the mean of `values` differs from zero.
#[must_use]
pub fn one_sample_t(values: &[f64], sidedness: Sidedness) -> Option<TTest> {
    let standard_error = standard_error(values, Divisor::CountMinusOne)?;
    let mean = mean(values)?;
    if !mean.is_finite() || !standard_error.is_finite() {
        return None;
    }
    let degrees_of_freedom = values.len() - 1;
    // Equal values have no variance, whatever rounding made of their mean.
    let is_constant = values.iter().all(|x| (x - values[0]).abs() == 0.0) || standard_error == 0.0;
    let (mean, standard_error) =
        if is_constant { (values[0], 0.0) } else { (mean, standard_error) };
    let (t, p) = match (is_constant, mean == 0.0) {
        (false, _) => {
            let t = mean / standard_error;
            (Some(t), t_p(t, degrees_of_freedom, sidedness)?)
        }
        (true, true) => (Some(0.0), 1.0),
        (true, false) => {
            let certain = if mean > 0.0 { (1.0, 0.0) } else { (0.0, 1.0) };
            (None, sidedness.p(certain))
        }
    };
    Some(TTest { mean, standard_error, t, degrees_of_freedom, p })
}

/// p value of a t statistic; undefined without degrees of freedom or for NaN.
#[must_use]
pub fn t_p(t: f64, degrees_of_freedom: usize, sidedness: Sidedness) -> Option<f64> {
    let distribution = StudentsT::new(0.0, 1.0, degrees_of_freedom as f64).ok()?;
    // The lower tail of −t is the upper one of t, without the rounding of 1 − cdf.
    (!t.is_nan()).then(|| sidedness.p((distribution.cdf(t), distribution.cdf(-t))))
}

/// Half the width of the confidence interval of a mean: its standard error times the quantile of t. Undefined for fewer
/// than two values and a confidence outside (0, 1).
#[must_use]
pub fn t_interval(standard_error: f64, count: usize, confidence: f64) -> Option<f64> {
    let degrees_of_freedom = count.checked_sub(1).filter(|&degrees| degrees > 0)?;
    let distribution = StudentsT::new(0.0, 1.0, degrees_of_freedom as f64).ok()?;
    if confidence <= 0.0 || confidence >= 1.0 {
        return None;
    }
    let share = f64::midpoint(1.0, confidence);
    let mut quantile = distribution.inverse_cdf(share);
    // The library's quantile has few digits; Newton's steps double them.
    for _ in 0..3 {
        quantile -= (distribution.cdf(quantile) - share) / distribution.pdf(quantile);
    }
    Some(standard_error * quantile)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_degree_of_freedom_is_a_cauchy_distribution() {
        // P(T > t) = ½ − atan(t)/π.
        let want = 0.5 - 3.0_f64.atan() / std::f64::consts::PI;
        assert!((t_p(3.0, 1, Sidedness::Greater).unwrap() - want).abs() < 1e-14);
        assert!((t_p(3.0, 1, Sidedness::TwoSided).unwrap() - 2.0 * want).abs() < 1e-14);
        assert!((t_p(3.0, 1, Sidedness::Less).unwrap() - (1.0 - want)).abs() < 1e-14);
    }

    #[test]
    fn the_interval_of_five_values_is_the_tabulated_one() {
        // The 97.5 % quantile of t with 4 degrees of freedom is 2.776445 in every table.
        assert!((t_interval(2.0, 5, 0.95).unwrap() - 2.0 * 2.776_445_105).abs() < 1e-8);
        // With one degree of freedom the quantile is tan(π(p − ½)).
        let want = (std::f64::consts::PI * 0.475).tan();
        assert!((t_interval(1.0, 2, 0.95).unwrap() - want).abs() < 1e-9 * want);
        assert_eq!((t_interval(2.0, 1, 0.95), t_interval(2.0, 0, 0.95)), (None, None));
        assert_eq!(t_interval(2.0, 5, 1.0), None);
    }

    #[test]
    fn values_without_variance_have_the_limiting_p() {
        let p = |value: f64, sidedness| one_sample_t(&[value; 3], sidedness).unwrap().p;
        assert_eq!((p(0.1, Sidedness::Greater), p(-0.1, Sidedness::Greater)), (0.0, 1.0));
        assert_eq!((p(0.1, Sidedness::TwoSided), p(0.1, Sidedness::Less)), (0.0, 1.0));
        assert_eq!((p(0.0, Sidedness::Greater), p(0.0, Sidedness::TwoSided)), (1.0, 1.0));
        assert_eq!(one_sample_t(&[0.1; 3], Sidedness::Greater).unwrap().t, None);
    }

    #[test]
    fn too_few_values_and_nan_are_undefined() {
        assert_eq!(one_sample_t(&[], Sidedness::Greater), None);
        assert_eq!(one_sample_t(&[1.0], Sidedness::Greater), None);
        assert_eq!(one_sample_t(&[1.0, f64::NAN], Sidedness::Greater), None);
        assert_eq!(t_p(1.0, 0, Sidedness::Greater), None);
        assert_eq!(t_p(f64::NAN, 3, Sidedness::Greater), None);
    }
}

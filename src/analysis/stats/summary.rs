//! Mean, standard deviation and standard error of the mean.
//!
//! `sd = √(Σ(x − mean)² / d)` with divisor d = n or n − 1, and `s.e.m. = sd / √n`; both in the unit of the values.
//! Sums run in the order of the values, in `f64`, in two passes.
//!
//! Degenerate: the mean of nothing, the deviation with a divisor of zero and the s.e.m. of a single value (whatever
//! the divisor) are undefined: `None`. NaN among the values makes mean and deviation NaN; only [`Summary::of`] skips
//! NaN, because there it means "this episode has no value", and then says how many values it used.
//!
//! Oracle: `tests/analysis_parity.rs`, algorithms `sem`, `csi_curve`.

/// What the sum of squared deviations is divided by. The choice changes published numbers, so it has no default:
/// curves over episodes divide by n, tables over seeds by n − 1.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Divisor {
    /// n, NumPy's `ddof=0`.
    Count,
    /// n − 1, NumPy's `ddof=1`.
    CountMinusOne,
}

/// Arithmetic mean; undefined for no values.
#[must_use]
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Standard deviation; undefined if the divisor is zero.
#[must_use]
pub fn standard_deviation(values: &[f64], divisor: Divisor) -> Option<f64> {
    let centre = mean(values)?;
    let divisor = match divisor {
        Divisor::Count => values.len(),
        Divisor::CountMinusOne => values.len() - 1,
    };
    let squares: f64 = values.iter().map(|x| (x - centre) * (x - centre)).sum();
    (divisor > 0).then(|| (squares / divisor as f64).sqrt())
}

/// Standard error of the mean; undefined for fewer than two values.
#[must_use]
pub fn standard_error(values: &[f64], divisor: Divisor) -> Option<f64> {
    if values.len() < 2 {
        return None;
    }
    Some(standard_deviation(values, divisor)? / (values.len() as f64).sqrt())
}

/// Mean ± s.e.m. and the number of values behind them.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Summary {
    pub mean: Option<f64>,
    pub standard_error: Option<f64>,
    /// Number of values used, i.e. those that are not NaN.
    pub count: usize,
}

impl Summary {
    /// Summarises `values`, skipping NaN.
    #[must_use]
    pub fn of(values: &[f64], divisor: Divisor) -> Self {
        let defined: Vec<f64> = values.iter().copied().filter(|x| !x.is_nan()).collect();
        Self {
            mean: mean(&defined),
            standard_error: standard_error(&defined, divisor),
            count: defined.len(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn deviation_and_error_of_a_hand_computed_sample() {
        let values = [2.0, 4.0, 4.0, 4.0, 5.0, 5.0, 7.0, 9.0];
        assert_eq!(mean(&values), Some(5.0));
        assert_eq!(standard_deviation(&values, Divisor::Count), Some(2.0));
        let sample = standard_deviation(&values, Divisor::CountMinusOne).unwrap();
        assert!((sample - (32.0_f64 / 7.0).sqrt()).abs() < 1e-15);
        let error = standard_error(&values, Divisor::Count).unwrap();
        assert!((error - 2.0 / 8.0_f64.sqrt()).abs() < 1e-15);
    }

    #[test]
    fn what_is_undefined_is_none_and_never_a_panic() {
        assert_eq!(mean(&[]), None);
        assert_eq!(standard_deviation(&[3.0], Divisor::CountMinusOne), None);
        assert_eq!(standard_error(&[3.0], Divisor::Count), None);
        let empty = Summary::of(&[f64::NAN], Divisor::Count);
        assert_eq!(empty, Summary { mean: None, standard_error: None, count: 0 });
    }

    #[test]
    fn a_summary_skips_undefined_values_and_counts_the_rest() {
        let summary = Summary::of(&[1.0, f64::NAN, 3.0], Divisor::CountMinusOne);
        assert_eq!((summary.mean, summary.count), (Some(2.0), 2));
        assert!((summary.standard_error.unwrap() - 1.0).abs() < 1e-15);
    }
}

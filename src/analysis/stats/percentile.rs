//! Percentiles with linear interpolation between order statistics, "type 7" of Hyndman & Fan 1996, NumPy's default.
//!
//! With the values sorted, x₀ ≤ … ≤ xₙ₋₁, the q-th percentile lies at position q/100 · (n − 1); between two
//! neighbours it is interpolated. In the unit of the values. Undefined (`None`) for no values, for NaN among them, and
//! for q outside [0, 100].
//!
//! Oracle: `tests/analysis_parity.rs`, algorithm `percentile_linear`.

/// The `percent`-th percentile (0 to 100) of `values`, in any order.
#[must_use]
pub fn percentile(values: &[f64], percent: f64) -> Option<f64> {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    percentile_of_sorted(&sorted, percent)
}

/// The same for values already sorted by [`f64::total_cmp`].
pub(super) fn percentile_of_sorted(sorted: &[f64], percent: f64) -> Option<f64> {
    // NaN sorts to either end, by its sign.
    let has_nan = sorted.first()?.is_nan() || sorted.last()?.is_nan();
    if has_nan || !(0.0..=100.0).contains(&percent) {
        return None;
    }
    let position = percent / 100.0 * (sorted.len() - 1) as f64;
    let below = position.floor() as usize;
    let above = (below + 1).min(sorted.len() - 1);
    Some(sorted[below] + (sorted[above] - sorted[below]) * position.fract())
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "these quantiles are exact in binary")]
mod tests {
    use super::*;

    #[test]
    fn percentiles_of_four_values_by_hand() {
        let values = [4.0, 1.0, 3.0, 2.0];
        let found = [0.0, 25.0, 50.0, 100.0].map(|q| percentile(&values, q).unwrap());
        assert_eq!(found, [1.0, 1.75, 2.5, 4.0]);
    }

    #[test]
    fn undefined_percentiles_are_none() {
        assert_eq!(percentile(&[], 50.0), None);
        assert_eq!(percentile(&[1.0, f64::NAN], 50.0), None);
        assert_eq!(percentile(&[1.0, -f64::NAN], 50.0), None);
        assert_eq!(percentile(&[1.0], 101.0), None);
        assert_eq!(percentile(&[1.0], f64::NAN), None);
    }
}

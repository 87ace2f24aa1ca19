//! How one muscle pulls in `MuJoCo`, and the action that makes it pull towards a wished length (`spec/policy.md` §4.4).
//!
//! Force = gain · activation + bias. With the normalised length L (the length range of the whole muscle maps onto
//! `range`) and the normalised velocity V: gain = −F₀ · FL(L) · FV(V), bias = −F₀ · FP(L), all of them piecewise
//! quadratic. Checked against the library's own functions and against the forces that the engine computes.
//!
//! Below the shortest length 3.17.0 has no active force, as here; 2.3.7 continues the curve beyond zero, and the muscle
//! pushes. The inversion cannot tell them apart: it takes every gain above −1 N as −1 N.

/// Smallest divisor, as in the library.
const TINY: f64 = 1e-15;
/// Images of the actions −1 and 1 under the excitation's sigmoid: outside them its inverse would leave the action box.
const ACTIVATION_RANGE: [f64; 2] = [0.000_552_778_636_923_599_6, 0.924_141_819_978_756_6];
/// Stiffness of the wish per peak force, 1/m, and damping, s/m.
const STIFFNESS: f64 = 5.0;
const DAMPING: f64 = 0.1 * STIFFNESS;

/// Constants of one muscle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MuscleModel {
    pub gain: MuscleParameters,
    pub bias: MuscleParameters,
    /// Shortest and longest length of the whole muscle in its body, m.
    pub length_range: [f64; 2],
    /// Acceleration that unit force causes in the reference configuration.
    pub acceleration: f64,
}

/// The nine numbers of a muscle's gain or bias.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MuscleParameters {
    /// Normalised lengths that the ends of the length range map onto.
    pub range: [f64; 2],
    /// Peak force, N; negative: from `scale` and the acceleration.
    pub force: f64,
    pub scale: f64,
    /// Normalised lengths between which the muscle pulls at all.
    pub shortest: f64,
    pub longest: f64,
    /// Shortening velocity without force, in rest lengths per second.
    pub fastest: f64,
    /// Passive force at the longest length, and active force while lengthening, in peak forces.
    pub passive: f64,
    pub lengthening: f64,
}

impl MuscleParameters {
    /// From the numbers in the model's order.
    #[must_use]
    pub fn new(numbers: &[f64; 9]) -> Self {
        let &[low, high, force, scale, shortest, longest, fastest, passive, lengthening] = numbers;
        let range = [low, high];
        Self { range, force, scale, shortest, longest, fastest, passive, lengthening }
    }

    fn peak_force(&self, acceleration: f64) -> f64 {
        if self.force < 0.0 { self.scale / acceleration.max(TINY) } else { self.force }
    }

    /// Rest length, m, and the normalised length of `length`.
    fn normalise(&self, length: f64, length_range: [f64; 2]) -> (f64, f64) {
        let [low, high] = length_range;
        let rest = (high - low) / (self.range[1] - self.range[0]).max(TINY);
        (rest, self.range[0] + (length - low) / rest.max(TINY))
    }
}

impl MuscleModel {
    /// Force at full activation and the best length, held still, N.
    #[must_use]
    pub fn strongest(&self) -> f64 {
        self.gain.peak_force(self.acceleration)
    }

    /// Force per activation, N, never positive.
    #[must_use]
    pub fn gain(&self, length: f64, velocity: f64) -> f64 {
        let p = &self.gain;
        let (rest, length) = p.normalise(length, self.length_range);
        let velocity = velocity / (rest * p.fastest).max(TINY);
        -p.peak_force(self.acceleration) * active_force(p, length) * velocity_factor(p, velocity)
    }

    /// Force without activation, N, never positive.
    #[must_use]
    pub fn bias(&self, length: f64) -> f64 {
        let p = &self.bias;
        let (_, length) = p.normalise(length, self.length_range);
        let knee = 0.5 * (1.0 + p.longest);
        let peak = p.peak_force(self.acceleration) * p.passive;
        if length <= 1.0 {
            0.0
        } else if length <= knee {
            -peak * 0.5 * ((length - 1.0) / (knee - 1.0).max(TINY)).powi(2)
        } else {
            -peak * (0.5 + (length - knee) / (knee - 1.0).max(TINY))
        }
    }

    /// The action that makes the muscle pull towards `target`, m, as a damped spring would.
    #[must_use]
    pub fn action_towards(&self, target: f64, length: f64, velocity: f64) -> f64 {
        let peak = self.bias.force;
        let wished = STIFFNESS * peak * (target - length) - DAMPING * peak * velocity;
        // Not `clamp`: a model without a stated force has a negative one, and the published bounds are then crossed.
        let force = wished.max(-peak).min(0.0);
        let gain = self.gain(length, velocity).min(-1.0);
        let [lowest, highest] = ACTIVATION_RANGE;
        let activation = ((force - self.bias(length)) / gain).clamp(lowest, highest);
        0.5 - 0.2 * (1.0 / activation - 1.0).ln()
    }
}

/// Active force over normalised length: a bump between shortest and longest with its top at 1.
fn active_force(p: &MuscleParameters, length: f64) -> f64 {
    let (rising, falling) = (0.5 * (p.shortest + 1.0), 0.5 * (1.0 + p.longest));
    let ratio = |over: f64, under: f64| (over / under.max(TINY)).powi(2);
    if length < p.shortest || length > p.longest {
        0.0
    } else if length <= rising {
        0.5 * ratio(length - p.shortest, rising - p.shortest)
    } else if length <= 1.0 {
        1.0 - 0.5 * ratio(1.0 - length, 1.0 - rising)
    } else if length <= falling {
        1.0 - 0.5 * ratio(length - 1.0, falling - 1.0)
    } else {
        0.5 * ratio(p.longest - length, p.longest - falling)
    }
}

/// Active force over normalised velocity: none while shortening fast, more than at rest while lengthening.
fn velocity_factor(p: &MuscleParameters, velocity: f64) -> f64 {
    let excess = p.lengthening - 1.0;
    if velocity <= -1.0 {
        0.0
    } else if velocity <= 0.0 {
        (velocity + 1.0).powi(2)
    } else if velocity <= excess {
        p.lengthening - (excess - velocity).powi(2) / excess.max(TINY)
    } else {
        p.lengthening
    }
}

//! What a minibatch is to be improved in (`spec/training.md` §5.6), one sample at a time.
//!
//! `L = c_pg L_pg + c_ent L_ent + c_v L_v + c_im L_im` with, over the B samples of a minibatch,
//!
//! * `L_pg = −mean(min(ρÂ, clip(ρ, 1 − ε, 1 + ε) Â))`, `ρ = exp(ln π − ln π_old)`, Â the advantages standardised within
//!   the minibatch with the unbiased standard deviation;
//! * `L_v = mean((R − V)²)` and `L_ent = −mean(entropy)`;
//! * `L_im` by [`ImitationLoss`], of an action drawn by given noise.
//!
//! Nothing couples the samples but numbers that are known before any of them is looked at ([`Objective`]). So losses and
//! gradients are sums over samples, and a network may take them in any portions.

use serde::{Deserialize, Serialize};

use super::Sample;
use super::distribution::Distribution;
use super::shards::Sum;

/// Added to the standard deviation of advantages.
const DEVIATION_EPSILON: f64 = 1e-8;

/// What is minimised. The default is the published PPO: the code's constants, not the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Coefficients {
    pub policy_gradient: f64,
    pub entropy: f64,
    pub value: f64,
    pub imitation: f64,
    /// Half of the range of ρ that the policy gradient may use, ε.
    pub clip: f64,
    pub standardise_advantages: bool,
    pub imitation_loss: ImitationLoss,
}

/// How far an action is from the expert's.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum ImitationLoss {
    /// Squared errors of a drawn action, averaged over the body's muscles and summed over the minibatch.
    SquaredPerSample,
    /// Squared errors of a drawn action, averaged over all muscles of the minibatch.
    SquaredOverAll,
    /// `−Σ ln π(a*)`, padding included, whose expert action is zero.
    NegativeLogProbability,
    /// Divergence of the expert's excitations from those of the mean action, each seen as the chance of a pulse, averaged over
    /// the body's muscles and summed over the minibatch. What a muscle cannot feel (any action far below zero leaves it at
    /// rest) costs nothing, which is most of what an expert that turns muscles on and off does.
    Excitation,
}

/// The excitation of an action `a` is the logistic function of `5 (a − ½)` (`spec/tasks.md` §1.3).
const EXCITATION_SLOPE: f64 = 5.0;

/// Divergence in nats of excitations from wanted ones, and its derivative by the action that they come from.
fn excitation_divergence(action: f32, wanted: f32) -> (f64, f64) {
    let exponent = |action: f32| EXCITATION_SLOPE * (f64::from(action) - 0.5);
    // ln of the excitation, and of what it lacks to one.
    let logarithms = |z: f64| (-(-z).exp().ln_1p(), -z.exp().ln_1p());
    let (on, off) = logarithms(exponent(action));
    let (wanted_on, wanted_off) = logarithms(exponent(wanted));
    let share = wanted_on.exp();
    let divergence = share * (wanted_on - on) + (1.0 - share) * (wanted_off - off);
    (divergence, EXCITATION_SLOPE * (on.exp() - share))
}

impl Default for Coefficients {
    fn default() -> Self {
        Self {
            policy_gradient: 1.0,
            entropy: 1e-6,
            value: 0.5,
            imitation: 0.0,
            clip: 0.3,
            standardise_advantages: true,
            imitation_loss: ImitationLoss::SquaredPerSample,
        }
    }
}

impl Coefficients {
    /// Whether the expert's actions are needed.
    #[must_use]
    pub fn imitates(&self) -> bool {
        self.imitation != 0.0
    }

    /// Whether samples need noise.
    #[must_use]
    pub fn draws(&self) -> bool {
        use ImitationLoss::{SquaredOverAll, SquaredPerSample};
        self.imitates() && matches!(self.imitation_loss, SquaredPerSample | SquaredOverAll)
    }
}

/// The losses of a minibatch, each before its coefficient.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Losses {
    /// The weighted sum, which the gradient belongs to.
    pub total: f64,
    pub policy_gradient: f64,
    pub value: f64,
    pub entropy: f64,
    pub imitation: f64,
    /// `mean(exp(Δ) − 1 − Δ)`, Δ the change of the log-probability since the action was drawn.
    pub approximate_divergence: f64,
    /// Share of samples whose ρ is out of range.
    pub clip_fraction: f64,
}

impl Sum for Losses {
    fn add(&mut self, other: &Self) {
        self.total += other.total;
        self.policy_gradient += other.policy_gradient;
        self.value += other.value;
        self.entropy += other.entropy;
        self.imitation += other.imitation;
        self.approximate_divergence += other.approximate_divergence;
        self.clip_fraction += other.clip_fraction;
    }
}

impl Losses {
    /// The mean, where this is a sum over `count` minibatches.
    #[cfg(feature = "play")]
    pub(super) fn over(self, count: f64) -> Self {
        Self {
            total: self.total / count,
            policy_gradient: self.policy_gradient / count,
            value: self.value / count,
            entropy: self.entropy / count,
            imitation: self.imitation / count,
            approximate_divergence: self.approximate_divergence / count,
            clip_fraction: self.clip_fraction / count,
        }
    }
}

/// The losses with everything that depends on the minibatch as a whole.
#[derive(Debug, Clone)]
pub struct Objective {
    coefficients: Coefficients,
    samples: f64,
    mean_advantage: f64,
    advantage_scale: f64,
    /// Muscles of all samples that have an expert action.
    imitated: f64,
}

/// Memory for one sample's actions.
#[derive(Debug, Clone, Default)]
pub struct LossScratch {
    action: Vec<f32>,
    slopes: Vec<f32>,
}

impl LossScratch {
    /// For actions of up to so many numbers.
    #[must_use]
    pub fn new(actions: usize) -> Self {
        Self { action: vec![0.0; actions], slopes: vec![0.0; actions] }
    }
}

/// Where the derivatives of one sample's loss go: by the mean of its actions (set), by the distribution's own numbers
/// (added), by the value (set).
#[derive(Debug)]
pub struct Slopes<'a> {
    pub mean: &'a mut [f32],
    pub own: &'a mut [f32],
    pub value: &'a mut f32,
}

impl Objective {
    #[must_use]
    pub fn new(coefficients: Coefficients, minibatch: &[Sample<'_>]) -> Self {
        let samples = minibatch.len() as f64;
        let (mut mean_advantage, mut advantage_scale) = (0.0, 1.0);
        if coefficients.standardise_advantages && minibatch.len() > 1 {
            let advantages = minibatch.iter().map(|sample| f64::from(sample.advantage));
            mean_advantage = advantages.clone().sum::<f64>() / samples;
            let squares: f64 = advantages.map(|a| (a - mean_advantage).powi(2)).sum();
            advantage_scale = 1.0 / ((squares / (samples - 1.0)).sqrt() + DEVIATION_EPSILON);
        }
        let imitated =
            minibatch.iter().map(|sample| sample.expert_action.len()).sum::<usize>() as f64;
        Self { coefficients, samples, mean_advantage, advantage_scale, imitated }
    }

    #[must_use]
    pub fn coefficients(&self) -> &Coefficients {
        &self.coefficients
    }

    /// One sample's share of the losses, and of their derivatives.
    pub fn pull<D: Distribution>(
        &self,
        sample: &Sample<'_>,
        distribution: &D,
        mean: &[f32],
        value: f32,
        scratch: &mut LossScratch,
        slopes: &mut Slopes<'_>,
    ) -> Losses {
        let Coefficients {
            policy_gradient,
            entropy,
            value: value_coefficient,
            imitation,
            clip,
            ..
        } = self.coefficients;
        let share = 1.0 / self.samples;
        slopes.mean.fill(0.0);

        let change = distribution.log_probability(mean, sample.action)
            - f64::from(sample.old_log_probability);
        let ratio = change.exp();
        let advantage = (f64::from(sample.advantage) - self.mean_advantage) * self.advantage_scale;
        let clipped = ratio.clamp(1.0 - clip, 1.0 + clip) * advantage;
        let is_free = ratio * advantage <= clipped;
        let surrogate = if is_free { ratio * advantage } else { clipped };
        if is_free {
            let slope = -policy_gradient * share * ratio * advantage;
            distribution.pull_log_probability(mean, sample.action, slope, slopes.mean, slopes.own);
        }
        distribution.pull_entropy(-entropy * share, slopes.own);
        let error = f64::from(value) - f64::from(sample.value_target);
        *slopes.value = (2.0 * value_coefficient * share * error) as f32;

        let mut losses = Losses {
            total: 0.0,
            policy_gradient: -share * surrogate,
            value: share * error * error,
            entropy: -share * distribution.entropy(),
            imitation: self.imitate(sample, distribution, mean, scratch, slopes.mean, slopes.own),
            approximate_divergence: share * (ratio - 1.0 - change),
            clip_fraction: if (ratio - 1.0).abs() > clip { share } else { 0.0 },
        };
        losses.total = policy_gradient * losses.policy_gradient
            + entropy * losses.entropy
            + value_coefficient * losses.value
            + imitation * losses.imitation;
        losses
    }

    fn imitate<D: Distribution>(
        &self,
        sample: &Sample<'_>,
        distribution: &D,
        mean: &[f32],
        scratch: &mut LossScratch,
        mean_gradient: &mut [f32],
        own: &mut [f32],
    ) -> f64 {
        if !self.coefficients.imitates() {
            return 0.0;
        }
        let weight = self.coefficients.imitation;
        let expert = sample.expert_action;
        let action = &mut scratch.action[..mean.len()];
        let per_muscle = match self.coefficients.imitation_loss {
            ImitationLoss::NegativeLogProbability => {
                let (muscles, padding) = action.split_at_mut(expert.len());
                muscles.copy_from_slice(expert);
                padding.fill(0.0);
                distribution.pull_log_probability(mean, action, -weight, mean_gradient, own);
                return -distribution.log_probability(mean, action);
            }
            ImitationLoss::Excitation => {
                let per_muscle = 1.0 / expert.len() as f64;
                let mut sum = 0.0;
                for ((slope, &mean), &wanted) in mean_gradient.iter_mut().zip(mean).zip(expert) {
                    let (divergence, derivative) = excitation_divergence(mean, wanted);
                    sum += divergence;
                    *slope += (weight * per_muscle * derivative) as f32;
                }
                return per_muscle * sum;
            }
            ImitationLoss::SquaredPerSample => 1.0 / expert.len() as f64,
            ImitationLoss::SquaredOverAll => 1.0 / self.imitated,
        };
        distribution.draw(mean, sample.noise, action);
        let slopes = &mut scratch.slopes[..mean.len()];
        slopes.fill(0.0);
        let mut squares = 0.0;
        for ((slope, &drawn), &wanted) in slopes.iter_mut().zip(&*action).zip(expert) {
            let error = f64::from(drawn) - f64::from(wanted);
            squares += error * error;
            *slope = (2.0 * weight * per_muscle * error) as f32;
        }
        distribution.pull_draw(sample.noise, slopes, mean_gradient, own);
        per_muscle * squares
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_divergence_of_excitations_is_that_of_two_chances() {
        let excitation = |action: f64| 1.0 / (1.0 + (-5.0 * (action - 0.5)).exp());
        for (action, wanted) in [(0.2_f32, 0.7_f32), (-1.0, 1.0), (0.9, -0.3), (3.0, -1.0)] {
            let (p, q) = (excitation(f64::from(wanted)), excitation(f64::from(action)));
            let expected = p * (p / q).ln() + (1.0 - p) * ((1.0 - p) / (1.0 - q)).ln();
            let (divergence, slope) = excitation_divergence(action, wanted);
            assert!((divergence - expected).abs() < 1e-9 * expected, "{divergence}, {expected}");
            let step = 1e-3_f32;
            let [low, high] = [action - step, action + step];
            let [below, above] = [low, high].map(|x| excitation_divergence(x, wanted).0);
            let difference = (above - below) / (f64::from(high) - f64::from(low));
            assert!((slope - difference).abs() < 1e-4 * slope.abs(), "{slope}, {difference}");
        }
        assert_eq!(excitation_divergence(0.3, 0.3), (0.0, 0.0));
        let (lost, slope) = excitation_divergence(-60.0, 1.0);
        assert!(lost.is_finite() && slope < -4.0, "a wrong action is felt however wrong it is");
        let (rest, _) = excitation_divergence(-0.6, -1.0);
        assert!(rest < 0.01, "a muscle at rest may rest as it likes: {rest}");
    }
}

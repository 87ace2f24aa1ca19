//! Plays the walking expert: a perceptron whose outputs are wished muscle lengths, turned into actions by an inverse
//! muscle model (`spec/policy.md` §4.4).
//!
//! It normalises for itself, `clip((x − mean)/(deviation + 10⁻⁸), ±5)`, and is played by its means: the published code
//! never samples it as an expert.

use std::sync::Arc;

use super::check_sizes;
use super::muscle_model::MuscleModel;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::{Activation, TensorMap};
use crate::policy::interface::{Actor, ObservationVariant, Policy, TaskInterface};
use crate::policy::network::mlp::{Mlp, MlpScratch};
use crate::policy::network::weights::Weights;

const DEVIATION_EPSILON: f32 = 1e-8;
const CLIP: f32 = 5.0;

/// The walking expert.
#[derive(Debug, Clone)]
pub struct WalkingPolicy {
    network: Arc<WalkingNetwork>,
}

#[derive(Debug, Clone)]
struct WalkingNetwork {
    /// Mean and divisor of every component; absent if the file was saved before it saw anything.
    statistics: Option<(Vec<f32>, Vec<f32>)>,
    layers: Mlp,
    inputs: usize,
    muscles: usize,
}

impl WalkingPolicy {
    /// Reads the network off a checkpoint's tensors.
    pub fn from_tensors(tensors: &TensorMap) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        let mut names = weights.numbered(|k| format!("net.affine_layers.{k}"));
        names.push("action_mean".to_owned());
        let [_, inputs] = weights.matrix_size(&format!("{}.weight", names[0]))?;
        let layers = Mlp::read(weights, &names, inputs, Activation::Silu, false)?;
        let seen = weights.tensor("norm.n", weights.shape("norm.n")?)?;
        let statistics = if seen.first().is_some_and(|&n| n > 0.0) {
            let deviation = weights.tensor("norm.std", &[inputs])?;
            let divisors = deviation.iter().map(|d| d + DEVIATION_EPSILON).collect();
            Some((weights.tensor("norm.mean", &[inputs])?.to_vec(), divisors))
        } else {
            None
        };
        if statistics.iter().any(|(_, divisors): &(_, Vec<f32>)| divisors.iter().any(|d| *d <= 0.0))
        {
            return Err(PolicyError::NormaliserValues);
        }
        let muscles = layers.outputs(inputs);
        let network = WalkingNetwork { statistics, layers, inputs, muscles };
        Ok(Self { network: Arc::new(network) })
    }
}

impl Policy for WalkingPolicy {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::CleanAndMuscles
    }

    fn is_stochastic(&self) -> bool {
        false
    }

    fn bind(&self, task: &TaskInterface, _slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        let network = &self.network;
        check_sizes(task, network.inputs, network.muscles)?;
        let (expected, found) = (network.muscles, task.muscle_models.len());
        if expected != found {
            let (what, task) = ("muscle models", task.task.clone());
            return Err(PolicyError::DoesNotFit { what, expected, found, task });
        }
        Ok(Box::new(WalkingActor {
            muscles: task.muscle_models.clone(),
            normalised: vec![0.0; network.inputs],
            scratch: network.layers.scratch(),
            network: Arc::clone(network),
        }))
    }
}

struct WalkingActor {
    network: Arc<WalkingNetwork>,
    muscles: Vec<MuscleModel>,
    normalised: Vec<f32>,
    scratch: MlpScratch,
}

impl Actor for WalkingActor {
    fn reset(&mut self, _slot: usize) {}

    fn act(
        &mut self,
        slots: &[usize],
        observations: &[f32],
        action_means: &mut [f32],
        mut standard_deviations: Option<&mut [f32]>,
    ) {
        let network = &*self.network;
        let (inputs, muscles) = (network.inputs, network.muscles);
        let length = inputs + 2 * muscles;
        for row in 0..slots.len() {
            let (observed, state) = observations[row * length..(row + 1) * length].split_at(inputs);
            let (lengths, velocities) = state.split_at(muscles);
            network.normalise(observed, &mut self.normalised);
            let wished = network.layers.apply(&self.normalised, &mut self.scratch);
            let actions = &mut action_means[row * muscles..(row + 1) * muscles];
            let state = lengths.iter().zip(velocities);
            for (((action, &wish), muscle), (&length, &velocity)) in
                actions.iter_mut().zip(wished).zip(&self.muscles).zip(state)
            {
                let target = f64::from(wish.clamp(-1.0, 1.0));
                *action = muscle.action_towards(target, length.into(), velocity.into()) as f32;
            }
        }
        if let Some(deviations) = &mut standard_deviations {
            deviations.fill(f32::NAN);
        }
    }

    fn clips_actions(&self) -> bool {
        false
    }
}

impl WalkingNetwork {
    fn normalise(&self, raw: &[f32], normalised: &mut [f32]) {
        let Some((mean, divisors)) = &self.statistics else {
            normalised.copy_from_slice(raw);
            return;
        };
        let statistics = mean.iter().zip(divisors);
        for ((x, raw), (mean, divisor)) in normalised.iter_mut().zip(raw).zip(statistics) {
            *x = ((raw - mean) / divisor).clamp(-CLIP, CLIP);
        }
    }
}

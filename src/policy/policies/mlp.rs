//! Plays the plain perceptrons: Stable-Baselines3's PPO and soft actor-critic policies, on the clean vector or on the padded
//! matrix of all tasks (`spec/policy.md` §2.4, §2.5), and mjrl's natural-policy-gradient policy, which scales for itself
//! (§4.5).
//!
//! All are hidden layers, a linear head, and something that happens to the head's output.

use std::sync::Arc;

use super::exploration::{Exploration, NoiseMemory};
use super::input::{BoundInput, Input};
use super::subspace::ControlSubspace;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::{Activation, Normaliser, Scalars, TensorMap};
use crate::policy::interface::{Actor, ObservationVariant, Policy, TaskInterface};
use crate::policy::network::linear::Linear;
use crate::policy::network::mlp::{Mlp, MlpScratch};
use crate::policy::network::weights::Weights;

/// Bounds of the logarithm of a soft actor-critic's standard deviation, as the library clamps it.
const LOG_DEVIATION: [f32; 2] = [-20.0, 2.0];

/// A perceptron policy.
#[derive(Debug, Clone)]
pub struct MlpPolicy {
    network: Arc<MlpNetwork>,
}

#[derive(Debug, Clone)]
struct MlpNetwork {
    input: Input,
    inputs: usize,
    hidden: Mlp,
    head: Linear,
    output: Output,
    exploration: Exploration,
    clips: bool,
}

/// What happens to the head's output.
#[derive(Debug, Clone)]
enum Output {
    /// Nothing.
    Mean,
    /// mjrl.
    Scaled { scale: Vec<f32>, shift: Vec<f32> },
    /// A control subspace.
    Projected(ControlSubspace),
    /// Soft actor-critic: the hyperbolic tangent of it, also of a sample. The layer gives the logarithms of its standard
    /// deviations; without it they are not known.
    Squashed { log_deviation: Option<Linear> },
}

impl MlpPolicy {
    /// mjrl's policy: `tanh` layers called `fc_layers.<k>` between its own shifts and scales.
    pub fn natural_policy_gradient(tensors: &TensorMap) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        let mut names = weights.numbered(|k| format!("fc_layers.{k}"));
        let head = names.pop().unwrap_or_else(|| "fc_layers.0".to_owned());
        let layers = Layers::read(weights, &names, &head, Activation::Tanh)?;
        let (inputs, muscles) = (layers.inputs, layers.head.outputs());
        let input = Input::shifted(
            weights.tensor("in_shift", &[inputs])?,
            weights.tensor("in_scale", &[inputs])?,
        );
        let output = Output::Scaled {
            scale: weights.tensor("out_scale", &[muscles])?.to_vec(),
            shift: weights.tensor("out_shift", &[muscles])?.to_vec(),
        };
        let exploration = Exploration::read(weights, &head, None)?;
        Ok(Self::new(layers, input, output, exploration, false))
    }

    /// Stable-Baselines3's PPO policy, with a control subspace if the file holds one.
    pub fn ppo(
        tensors: &TensorMap,
        scalars: &Scalars,
        normaliser: &Normaliser,
    ) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        let names = weights.hidden_layers("policy_net");
        let activation = activation(&names, scalars)?;
        let layers = Layers::read(weights, &names, "action_net", activation)?;
        let input = Input::normalised(normaliser, layers.inputs, &scalars.task_index)?;
        let output = if weights.has("projection") {
            let muscles = layers.head.outputs();
            Output::Projected(ControlSubspace::read(weights, muscles, scalars.subspace_size)?)
        } else {
            Output::Mean
        };
        let exploration = Exploration::read(weights, "action_net", scalars.exploration.as_ref())?;
        Ok(Self::new(layers, input, output, exploration, true))
    }

    /// Stable-Baselines3's soft actor-critic policy.
    pub fn soft_actor_critic(
        tensors: &TensorMap,
        scalars: &Scalars,
        normaliser: &Normaliser,
    ) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        let names = weights.numbered(|k| format!("actor.latent_pi.{}", 2 * k));
        let layers = Layers::read(weights, &names, "actor.mu", activation(&names, scalars)?)?;
        let input = Input::normalised(normaliser, layers.inputs, &scalars.task_index)?;
        let name = "actor.log_std";
        let log_deviation = if weights.has(&format!("{name}.weight")) {
            Some(Linear::read(weights, name, layers.head.inputs(), layers.head.outputs())?)
        } else {
            None
        };
        let output = Output::Squashed { log_deviation };
        Ok(Self::new(layers, input, output, Exploration::Unknown, true))
    }

    fn new(
        Layers { inputs, hidden, head }: Layers,
        input: Input,
        output: Output,
        exploration: Exploration,
        clips: bool,
    ) -> Self {
        let network = MlpNetwork { input, inputs, hidden, head, output, exploration, clips };
        Self { network: Arc::new(network) }
    }

    pub(in crate::policy) fn observation_length(&self) -> usize {
        self.network.inputs
    }

    pub(in crate::policy) fn muscle_count(&self) -> usize {
        self.network.head.outputs()
    }
}

/// Hidden layers and head.
struct Layers {
    inputs: usize,
    hidden: Mlp,
    head: Linear,
}

impl Layers {
    fn read(
        weights: Weights,
        hidden: &[String],
        head: &str,
        activation: Activation,
    ) -> Result<Self, PolicyError> {
        let first = hidden.first().map_or(head, String::as_str);
        let [_, inputs] = weights.matrix_size(&format!("{first}.weight"))?;
        let hidden = Mlp::read(weights, hidden, inputs, activation, true)?;
        let [outputs, _] = weights.matrix_size(&format!("{head}.weight"))?;
        let head = Linear::read(weights, head, hidden.outputs(inputs), outputs)?;
        Ok(Self { inputs, hidden, head })
    }
}

/// The activation function, which only hidden layers need.
pub(super) fn activation(hidden: &[String], scalars: &Scalars) -> Result<Activation, PolicyError> {
    match scalars.activation {
        Some(activation) => Ok(activation),
        None if hidden.is_empty() => Ok(Activation::Relu),
        None => Err(PolicyError::Missing { what: "the activation function" }),
    }
}

impl Policy for MlpPolicy {
    fn variant(&self) -> ObservationVariant {
        self.network.input.variant()
    }

    fn is_stochastic(&self) -> bool {
        match &self.network.output {
            Output::Squashed { log_deviation } => log_deviation.is_some(),
            _ => self.network.exploration.is_known(),
        }
    }

    fn bind(&self, task: &TaskInterface, slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        let network = &self.network;
        let outputs = network.head.outputs();
        let keeps = matches!(network.output, Output::Squashed { .. });
        Ok(Box::new(MlpActor {
            input: network.input.bind(task, slots, network.inputs, outputs)?,
            scratch: network.hidden.scratch(),
            output: vec![0.0; outputs],
            deviations: vec![0.0; outputs],
            muscles: task.muscle_count,
            before_squashing: vec![0.0; if keeps { slots * task.muscle_count } else { 0 }],
            noise: network.exploration.memory(slots),
            network: Arc::clone(network),
        }))
    }
}

struct MlpActor {
    network: Arc<MlpNetwork>,
    input: BoundInput,
    scratch: MlpScratch,
    /// The head's output for the body that acts; longer than its muscles if the policy was made for a larger one.
    output: Vec<f32>,
    /// As long as `output`.
    deviations: Vec<f32>,
    muscles: usize,
    /// Slots × muscles, for samples of a soft actor-critic.
    before_squashing: Vec<f32>,
    noise: NoiseMemory,
}

impl Actor for MlpActor {
    fn reset(&mut self, slot: usize) {
        self.input.reset(slot);
        self.noise.reset(slot);
    }

    fn act(
        &mut self,
        slots: &[usize],
        observations: &[f32],
        action_means: &mut [f32],
        mut standard_deviations: Option<&mut [f32]>,
    ) {
        let (length, muscles) = (self.input.observation_length(), self.muscles);
        let network = &*self.network;
        for (row, &slot) in slots.iter().enumerate() {
            let raw = &observations[row * length..(row + 1) * length];
            let columns = row * muscles..(row + 1) * muscles;
            let scaled = self.input.scale(&network.input, slot, raw);
            let latent = network.hidden.apply(scaled, &mut self.scratch);
            network.head.apply(latent, &mut self.output);
            if let Some(wanted) = &mut standard_deviations {
                network.deviations(latent, &mut self.noise, slot, &mut self.deviations);
                wanted[columns.clone()].copy_from_slice(&self.deviations[..muscles]);
            }
            match &network.output {
                Output::Mean => {}
                Output::Scaled { scale, shift } => {
                    for ((mean, scale), shift) in self.output.iter_mut().zip(scale).zip(shift) {
                        *mean = *mean * scale + shift;
                    }
                }
                Output::Projected(subspace) => {
                    subspace.apply(&mut self.output, &mut self.deviations);
                }
                Output::Squashed { .. } => {
                    let kept = &mut self.before_squashing[slot * muscles..][..muscles];
                    kept.copy_from_slice(&self.output[..muscles]);
                    self.output.iter_mut().for_each(|mean| *mean = mean.tanh());
                }
            }
            action_means[columns].copy_from_slice(&self.output[..muscles]);
        }
    }

    fn sample(
        &mut self,
        slot: usize,
        standard_deviations: &[f32],
        action: &mut [f32],
        normal: &mut dyn FnMut() -> f64,
    ) {
        if let Output::Squashed { .. } = self.network.output {
            let before = &self.before_squashing[slot * self.muscles..][..self.muscles];
            for ((action, mean), deviation) in
                action.iter_mut().zip(before).zip(standard_deviations)
            {
                *action = (mean + deviation * normal() as f32).tanh();
            }
            return;
        }
        let exploration = &self.network.exploration;
        exploration.sample(&mut self.noise, slot, standard_deviations, action, normal);
    }

    fn clips_actions(&self) -> bool {
        self.network.clips
    }
}

impl MlpNetwork {
    /// Standard deviations of every output, for a soft actor-critic before the squashing.
    fn deviations(&self, latent: &[f32], noise: &mut NoiseMemory, slot: usize, row: &mut [f32]) {
        match &self.output {
            Output::Squashed { log_deviation: Some(layer) } => {
                let [low, high] = LOG_DEVIATION;
                layer.apply(latent, row);
                row.iter_mut().for_each(|x| *x = x.clamp(low, high).exp());
            }
            _ => self.exploration.write(latent, noise, slot, row),
        }
    }
}

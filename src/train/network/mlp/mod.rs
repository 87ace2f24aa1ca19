//! Stable-Baselines3's actor-critic perceptron (`spec/policy.md` §2.4, §2.5): two stacks of dense layers, one for the
//! action and one for the value, each with a linear head, and standard deviations that are the same in every state.
//!
//! Three things may be added: noise on the latent vector as well ([`MlpSettings::lattice`]), a control subspace that the mean
//! action is projected onto ([`MlpSettings::subspace`]), and several tasks, padded to the largest ([`MlpSettings::input`]).

mod pass;

use std::ops::Range;

use pass::MlpPlayer;

use super::check::{Lengths, check};
use super::dense::{Dense, Stack};
use super::padded_input::PaddedInput;
use super::{Player, Trainable};
use crate::policy::checkpoint::contents::{Activation, ExplorationSettings, Format, Scalars};
use crate::random::Random;
use crate::train::losses::Objective;
use crate::train::shards::{shards, smallest_of_dense, sum_over_shards};
use crate::train::{Coefficients, Losses, Parameters, Sample, TrainError, initialisation};

/// What a perceptron is made of. The default is Stable-Baselines3's, without sizes.
#[derive(Debug, Clone, PartialEq)]
pub struct MlpSettings {
    pub observations: usize,
    /// What it sees instead of `observations` numbers of one task.
    pub input: Option<PaddedInput>,
    pub muscles: usize,
    /// Widths of the hidden layers before the action.
    pub policy_layers: Vec<usize>,
    /// Widths of the hidden layers before the value.
    pub value_layers: Vec<usize>,
    pub activation: Activation,
    /// Whether weights start orthogonal (gain √2, 0.01 for the action, 1 for the value) and biases at zero; else both
    /// start as torch's dense layers do.
    pub orthogonal: bool,
    /// Logarithm of the standard deviations at the start.
    pub log_deviation: f64,
    /// Noise on the latent vector as well as on the muscles.
    pub lattice: bool,
    pub subspace: Option<SubspaceSettings>,
}

/// A control subspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SubspaceSettings {
    /// Rows of the projection that count; above the number of muscles all of them.
    pub size: usize,
    /// Whether projection and mean are trained.
    pub trainable: bool,
}

impl Default for MlpSettings {
    fn default() -> Self {
        Self {
            observations: 0,
            input: None,
            muscles: 0,
            policy_layers: vec![64, 64],
            value_layers: vec![64, 64],
            activation: Activation::Tanh,
            orthogonal: true,
            log_deviation: 0.0,
            lattice: false,
            subspace: None,
        }
    }
}

/// An actor-critic perceptron.
#[derive(Debug, Clone)]
pub struct Mlp {
    settings: MlpSettings,
    input: PaddedInput,
    parameters: Parameters,
    policy: Stack,
    action: Dense,
    value_stack: Stack,
    value: Dense,
    log_deviations: Range<usize>,
    /// Projection and mean.
    subspace: Option<[Range<usize>; 2]>,
}

impl Mlp {
    /// A network whose parameters are drawn from `random`.
    pub fn new(settings: MlpSettings, random: &mut Random) -> Result<Self, TrainError> {
        let mut network = Self::untrained(settings)?;
        network.draw(random);
        Ok(network)
    }

    /// A network whose parameters are zeros, to be read from a checkpoint.
    pub fn untrained(settings: MlpSettings) -> Result<Self, TrainError> {
        let input = settings.input.clone();
        let input = input.unwrap_or_else(|| PaddedInput::new(vec![settings.observations]));
        let widths = settings.policy_layers.iter().chain(&settings.value_layers);
        if input.width() == 0 || settings.muscles == 0 || widths.clone().any(|&w| w == 0) {
            return Err(TrainError::Sizes { what: "a layer without inputs or outputs".to_owned() });
        }
        if settings.lattice && settings.subspace.is_some() {
            let what = "lattice exploration and a control subspace at once".to_owned();
            return Err(TrainError::Sizes { what });
        }
        let mut parameters = Parameters::zeros(shapes(&settings, input.width()));
        if settings.subspace.is_some_and(|subspace| !subspace.trainable) {
            parameters.freeze(|name| matches!(name, "projection" | "mean"));
        }
        let stack = |branch: &str, count: usize| -> Result<Stack, TrainError> {
            let names = (0..count).map(|k| format!("mlp_extractor.{branch}.{}", 2 * k));
            let layers =
                names.map(|name| Dense::find(&parameters, &name)).collect::<Result<_, _>>()?;
            let (function, slope) = (settings.activation.function(), settings.activation.slope());
            Ok(Stack { layers, function, slope })
        };
        let range = |name: &str| parameters.place(name).map(|place| place.range.clone());
        let subspace = match settings.subspace {
            Some(_) => Some([range("projection")?, range("mean")?]),
            None => None,
        };
        Ok(Self {
            policy: stack("policy_net", settings.policy_layers.len())?,
            action: Dense::find(&parameters, "action_net")?,
            value_stack: stack("value_net", settings.value_layers.len())?,
            value: Dense::find(&parameters, "value_net")?,
            log_deviations: range("log_std")?,
            subspace,
            settings,
            input,
            parameters,
        })
    }

    #[must_use]
    pub fn settings(&self) -> &MlpSettings {
        &self.settings
    }

    /// Projects mean actions onto the first rows of `projection` (muscles × muscles) from now on.
    pub fn set_subspace(&mut self, projection: &[f32], mean: &[f32]) -> Result<(), TrainError> {
        let muscles = self.settings.muscles;
        let Some([projection_range, mean_range]) = self.subspace.clone() else {
            return Err(TrainError::Sizes {
                what: "a subspace set that it was made without".to_owned(),
            });
        };
        if projection.len() != muscles * muscles || mean.len() != muscles {
            return Err(TrainError::Sizes {
                what: format!(
                    "a subspace of {} and {} numbers for {muscles} muscles",
                    projection.len(),
                    mean.len()
                ),
            });
        }
        self.parameters.numbers_mut()[projection_range].copy_from_slice(projection);
        self.parameters.numbers_mut()[mean_range].copy_from_slice(mean);
        Ok(())
    }

    fn draw(&mut self, random: &mut Random) {
        let gain = std::f64::consts::SQRT_2;
        let hidden = self.policy.layers.iter().chain(&self.value_stack.layers);
        let heads = [(&self.action, 0.01), (&self.value, 1.0)];
        let numbers = self.parameters.numbers_mut();
        for (layer, gain) in hidden.map(|layer| (layer, gain)).chain(heads) {
            let weight = &mut numbers[layer.weight.clone()];
            if self.settings.orthogonal {
                initialisation::orthogonal(weight, layer.inputs, gain, random);
            } else {
                initialisation::dense(weight, layer.inputs, random);
                initialisation::dense(&mut numbers[layer.bias.clone()], layer.inputs, random);
            }
        }
        // A lattice's logarithm of the scale is a constant beside its parameters.
        let log_deviation = if self.settings.lattice { 0.0 } else { self.settings.log_deviation };
        numbers[self.log_deviations.clone()].fill(log_deviation as f32);
        if let Some([projection, _]) = &self.subspace {
            let diagonal =
                numbers[projection.clone()].iter_mut().step_by(self.settings.muscles + 1);
            diagonal.for_each(|x| *x = 1.0);
        }
    }
}

/// Names and shapes in the order of the published optimiser.
fn shapes(settings: &MlpSettings, observations: usize) -> Vec<(String, Vec<usize>)> {
    let latents = settings.policy_layers.last().copied().unwrap_or(observations);
    let deviations = if settings.lattice { latents } else { 0 } + settings.muscles;
    let mut shapes = vec![("log_std".to_owned(), vec![deviations])];
    let mut add = |name: &str, inputs: usize, outputs: usize| {
        shapes.push((format!("{name}.weight"), vec![outputs, inputs]));
        shapes.push((format!("{name}.bias"), vec![outputs]));
    };
    let mut ends = [observations; 2];
    for ((branch, widths), end) in
        [("policy_net", &settings.policy_layers), ("value_net", &settings.value_layers)]
            .into_iter()
            .zip(&mut ends)
    {
        for (k, &width) in widths.iter().enumerate() {
            add(&format!("mlp_extractor.{branch}.{}", 2 * k), *end, width);
            *end = width;
        }
    }
    add("action_net", ends[0], settings.muscles);
    add("value_net", ends[1], 1);
    if settings.subspace.is_some() {
        shapes.push(("projection".to_owned(), vec![settings.muscles; 2]));
        shapes.push(("mean".to_owned(), vec![settings.muscles]));
    }
    shapes
}

impl Trainable for Mlp {
    fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    fn parameters_mut(&mut self) -> &mut Parameters {
        &mut self.parameters
    }

    fn action_length(&self, _task: usize) -> usize {
        self.settings.muscles
    }

    fn noise_length(&self, _task: usize) -> usize {
        self.log_deviations.len()
    }

    fn gradient(
        &self,
        minibatch: &[Sample<'_>],
        coefficients: &Coefficients,
        threads: usize,
        gradient: &mut Vec<f32>,
    ) -> Result<Losses, TrainError> {
        let lengths = |task| {
            Some(Lengths {
                observation: self.input.length(task)?,
                action: self.settings.muscles,
                muscles: None,
                noise: self.log_deviations.len(),
            })
        };
        check(minibatch, coefficients, lengths, self.input.tasks())?;
        let objective = Objective::new(*coefficients, minibatch);
        let constants = self.constants();
        let numbers = self.parameters.numbers().len();
        gradient.resize(numbers + self.extra_lengths().iter().sum::<usize>(), 0.0);
        let shards = shards(minibatch.len(), smallest_of_dense(numbers));
        let rows = shards.first().map_or(0, ExactSizeIterator::len);
        let losses = sum_over_shards(
            &shards,
            threads,
            gradient,
            || self.memory(rows),
            |memory, shard, sums| {
                self.pull(&constants, &objective, &minibatch[shard], memory, sums)
            },
        );
        self.finish(&constants, gradient);
        gradient.truncate(numbers);
        Ok(losses)
    }

    fn player(&self) -> Box<dyn Player + '_> {
        Box::new(MlpPlayer::new(self))
    }

    fn description(&self) -> (Format, Scalars) {
        let exploration = ExplorationSettings {
            lattice: self.settings.lattice,
            log_scale: if self.settings.lattice { self.settings.log_deviation } else { 0.0 },
            ..ExplorationSettings::default()
        };
        let scalars = Scalars {
            activation: Some(self.settings.activation),
            exploration: Some(exploration),
            subspace_size: self.settings.subspace.map(|subspace| subspace.size),
            task_index: self.input.index().to_vec(),
            ..Scalars::default()
        };
        (Format::PpoMlp, scalars)
    }
}

#[cfg(test)]
mod tests;

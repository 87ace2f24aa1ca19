//! Plays the two kinds of plain perceptron: Stable-Baselines3's PPO policy on a normalised vector
//! (`spec/policy.md` §2.4) and mjrl's natural-policy-gradient policy, which scales for itself (§4.5).

use std::sync::Arc;

use super::{Exploration, check_sizes};
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::{Activation, ComponentStatistics, TensorMap};
use crate::policy::interface::{Actor, ObservationVariant, Policy, TaskInterface};
use crate::policy::network::mlp::{Mlp, MlpScratch};
use crate::policy::network::weights::Weights;
use crate::policy::normaliser::ComponentNormaliser;

/// Added to mjrl's input scale before the division.
const SCALE_EPSILON: f32 = 1e-8;

/// A perceptron policy.
#[derive(Debug, Clone)]
pub struct MlpPolicy {
    network: Arc<MlpNetwork>,
}

#[derive(Debug, Clone)]
struct MlpNetwork {
    input: Input,
    layers: Mlp,
    /// Scale and shift of every output; mjrl only.
    output: Option<(Vec<f32>, Vec<f32>)>,
    exploration: Exploration,
    observation_length: usize,
    muscle_count: usize,
    clips: bool,
}

/// What happens to an observation before the first layer.
#[derive(Debug, Clone)]
enum Input {
    Normalised(ComponentNormaliser),
    Shifted { shift: Vec<f32>, scale: Vec<f32> },
}

impl MlpPolicy {
    /// mjrl's policy: `tanh` layers called `fc_layers.<k>` between its own shifts and scales.
    pub fn natural_policy_gradient(tensors: &TensorMap) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        let names = weights.numbered(|k| format!("fc_layers.{k}"));
        let first = names
            .first()
            .ok_or_else(|| PolicyError::MissingTensor { name: "fc_layers.0.weight".to_owned() })?;
        let [_, inputs] = weights.matrix_size(&format!("{first}.weight"))?;
        let layers = Mlp::read(weights, &names, inputs, Activation::Tanh, false)?;
        let muscle_count = layers.outputs(inputs);
        let scale = weights.tensor("in_scale", &[inputs])?;
        let input = Input::Shifted {
            shift: weights.tensor("in_shift", &[inputs])?.to_vec(),
            scale: scale.iter().map(|scale| scale + SCALE_EPSILON).collect(),
        };
        let output = (
            weights.tensor("out_scale", &[muscle_count])?.to_vec(),
            weights.tensor("out_shift", &[muscle_count])?.to_vec(),
        );
        Self::new(weights, input, layers, Some(output), inputs, false)
    }

    /// Stable-Baselines3's PPO policy.
    pub fn ppo(
        tensors: &TensorMap,
        activation: Option<Activation>,
        statistics: &ComponentStatistics,
    ) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        if weights.has("projection") {
            // Its subspace size is not in the file (§2.4) and must not be guessed.
            let what = "policy with a trained control subspace".to_owned();
            return Err(PolicyError::Unsupported { what });
        }
        let mut names = weights.numbered(|k| format!("mlp_extractor.policy_net.{}", 2 * k));
        names.push("action_net".to_owned());
        let [_, inputs] = weights.matrix_size(&format!("{}.weight", names[0]))?;
        let activation =
            activation.ok_or(PolicyError::Missing { what: "the activation function" })?;
        let layers = Mlp::read(weights, &names, inputs, activation, false)?;
        let input = Input::Normalised(ComponentNormaliser::new(statistics, inputs)?);
        Self::new(weights, input, layers, None, inputs, true)
    }

    fn new(
        weights: Weights,
        input: Input,
        layers: Mlp,
        output: Option<(Vec<f32>, Vec<f32>)>,
        observation_length: usize,
        clips: bool,
    ) -> Result<Self, PolicyError> {
        let muscle_count = layers.outputs(observation_length);
        let exploration = Exploration::read(weights, muscle_count)?;
        let network = MlpNetwork {
            input,
            layers,
            output,
            exploration,
            observation_length,
            muscle_count,
            clips,
        };
        Ok(Self { network: Arc::new(network) })
    }

    pub(in crate::policy) fn observation_length(&self) -> usize {
        self.network.observation_length
    }

    pub(in crate::policy) fn muscle_count(&self) -> usize {
        self.network.muscle_count
    }
}

impl Policy for MlpPolicy {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Clean
    }

    fn is_stochastic(&self) -> bool {
        self.network.exploration.is_known()
    }

    fn bind(&self, task: &TaskInterface, _slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        check_sizes(task, self.observation_length(), self.muscle_count())?;
        Ok(Box::new(MlpActor {
            normalised: vec![0.0; self.observation_length()],
            scratch: self.network.layers.scratch(),
            network: Arc::clone(&self.network),
        }))
    }
}

struct MlpActor {
    network: Arc<MlpNetwork>,
    normalised: Vec<f32>,
    scratch: MlpScratch,
}

impl Actor for MlpActor {
    fn reset(&mut self, _slot: usize) {}

    fn act(
        &mut self,
        slots: &[usize],
        observations: &[f32],
        action_means: &mut [f32],
        mut standard_deviations: Option<&mut [f32]>,
    ) {
        let network = &*self.network;
        let (length, muscles) = (self.normalised.len(), network.muscle_count);
        for row in 0..slots.len() {
            let raw = &observations[row * length..(row + 1) * length];
            let columns = row * muscles..(row + 1) * muscles;
            match &network.input {
                Input::Normalised(normaliser) => normaliser.apply(raw, &mut self.normalised),
                Input::Shifted { shift, scale } => {
                    let constants = shift.iter().zip(scale);
                    for ((x, &raw), (shift, scale)) in
                        self.normalised.iter_mut().zip(raw).zip(constants)
                    {
                        *x = (raw - shift) / scale;
                    }
                }
            }
            let means = &mut action_means[columns.clone()];
            means.copy_from_slice(network.layers.apply(&self.normalised, &mut self.scratch));
            if let Some((scale, shift)) = &network.output {
                for ((mean, scale), shift) in means.iter_mut().zip(scale).zip(shift) {
                    *mean = *mean * scale + shift;
                }
            }
            if let Some(deviations) = &mut standard_deviations {
                network.exploration.write(&mut deviations[columns]);
            }
        }
    }

    fn clips_actions(&self) -> bool {
        self.network.clips
    }
}

//! Plays a recurrent PPO policy: normaliser, LSTM, optional dense layers, linear head (`spec/policy.md` §4.2).

use std::sync::Arc;

use super::{Exploration, check_sizes};
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::{Activation, ComponentStatistics, TensorMap};
use crate::policy::interface::{Actor, ObservationVariant, Policy, TaskInterface};
use crate::policy::network::linear::Linear;
use crate::policy::network::lstm::{Lstm, LstmState};
use crate::policy::network::mlp::{Mlp, MlpScratch};
use crate::policy::network::weights::Weights;
use crate::policy::normaliser::ComponentNormaliser;

/// A recurrent policy with the normaliser it was trained with.
#[derive(Debug, Clone)]
pub struct RecurrentPolicy {
    network: Arc<RecurrentNetwork>,
}

/// Normaliser and networks of actor and critic.
#[derive(Debug, Clone)]
pub(in crate::policy) struct RecurrentNetwork {
    normaliser: ComponentNormaliser,
    actor: Branch,
    /// Absent when the file has no recurrent critic.
    critic: Option<Branch>,
    exploration: Exploration,
}

/// LSTM, dense layers, linear head.
#[derive(Debug, Clone)]
pub(in crate::policy) struct Branch {
    lstm: Lstm,
    hidden: Mlp,
    head: Linear,
}

/// What changes from step to step in one branch, and its scratch memory.
#[derive(Debug, Clone)]
pub(in crate::policy) struct BranchScratch {
    gates: Vec<f32>,
    hidden: MlpScratch,
}

impl RecurrentPolicy {
    /// Reads the networks off a checkpoint's tensors. `activation` is needed only if there are dense layers.
    pub fn from_tensors(
        tensors: &TensorMap,
        activation: Option<Activation>,
        statistics: &ComponentStatistics,
    ) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        let actor = Branch::read(weights, "lstm_actor", "policy_net", "action_net", activation)?;
        let critic = if weights.has("lstm_critic.weight_hh_l0") {
            Some(Branch::read(weights, "lstm_critic", "value_net", "value_net", activation)?)
        } else {
            None
        };
        let exploration = Exploration::read(weights, actor.head.outputs())?;
        let normaliser = ComponentNormaliser::new(statistics, actor.lstm.inputs())?;
        let network = RecurrentNetwork { normaliser, actor, critic, exploration };
        Ok(Self { network: Arc::new(network) })
    }

    pub(in crate::policy) fn network(&self) -> &RecurrentNetwork {
        &self.network
    }
}

impl RecurrentNetwork {
    pub(in crate::policy) fn normaliser(&self) -> &ComponentNormaliser {
        &self.normaliser
    }

    pub(in crate::policy) fn observation_length(&self) -> usize {
        self.actor.lstm.inputs()
    }

    pub(in crate::policy) fn muscle_count(&self) -> usize {
        self.actor.head.outputs()
    }

    pub(in crate::policy) fn actor(&self) -> &Branch {
        &self.actor
    }

    pub(in crate::policy) fn critic(&self) -> Option<&Branch> {
        self.critic.as_ref()
    }
}

impl Branch {
    fn read(
        weights: Weights,
        lstm: &str,
        hidden: &str,
        head: &str,
        activation: Option<Activation>,
    ) -> Result<Self, PolicyError> {
        let lstm = Lstm::read(weights, lstm)?;
        let names = weights.numbered(|k| format!("mlp_extractor.{hidden}.{}", 2 * k));
        let activation = match activation {
            Some(activation) => activation,
            // Without dense layers it is never used.
            None if names.is_empty() => Activation::Relu,
            None => return Err(PolicyError::Missing { what: "the activation function" }),
        };
        let hidden = Mlp::read(weights, &names, lstm.width(), activation, true)?;
        let inputs = hidden.outputs(lstm.width());
        let [outputs, _] = weights.matrix_size(&format!("{head}.weight"))?;
        let head = Linear::read(weights, head, inputs, outputs)?;
        Ok(Self { lstm, hidden, head })
    }

    pub(in crate::policy) fn initial_state(&self) -> LstmState {
        self.lstm.initial_state()
    }

    pub(in crate::policy) fn scratch(&self) -> BranchScratch {
        BranchScratch { gates: vec![0.0; 4 * self.lstm.width()], hidden: self.hidden.scratch() }
    }

    /// Advances `state` by one normalised observation and writes the head's output.
    pub(in crate::policy) fn step(
        &self,
        observation: &[f32],
        state: &mut LstmState,
        scratch: &mut BranchScratch,
        output: &mut [f32],
    ) {
        self.lstm.step(observation, state, &mut scratch.gates);
        let latent = self.hidden.apply(state.output(self.lstm.width()), &mut scratch.hidden);
        self.head.apply(latent, output);
    }
}

impl Policy for RecurrentPolicy {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Clean
    }

    fn is_stochastic(&self) -> bool {
        self.network.exploration.is_known()
    }

    fn bind(&self, task: &TaskInterface, slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        let actor = &self.network.actor;
        check_sizes(task, actor.lstm.inputs(), actor.head.outputs())?;
        Ok(Box::new(RecurrentActor {
            network: Arc::clone(&self.network),
            states: vec![actor.initial_state(); slots],
            normalised: vec![0.0; actor.lstm.inputs()],
            scratch: actor.scratch(),
        }))
    }
}

struct RecurrentActor {
    network: Arc<RecurrentNetwork>,
    states: Vec<LstmState>,
    normalised: Vec<f32>,
    scratch: BranchScratch,
}

impl Actor for RecurrentActor {
    fn reset(&mut self, slot: usize) {
        let state = &mut self.states[slot];
        state.hidden.fill(0.0);
        state.cell.fill(0.0);
    }

    fn act(
        &mut self,
        slots: &[usize],
        observations: &[f32],
        action_means: &mut [f32],
        mut standard_deviations: Option<&mut [f32]>,
    ) {
        let (length, muscles) = (self.normalised.len(), self.network.muscle_count());
        for (row, &slot) in slots.iter().enumerate() {
            let raw = &observations[row * length..(row + 1) * length];
            let columns = row * muscles..(row + 1) * muscles;
            self.network.normaliser.apply(raw, &mut self.normalised);
            self.network.actor.step(
                &self.normalised,
                &mut self.states[slot],
                &mut self.scratch,
                &mut action_means[columns.clone()],
            );
            if let Some(deviations) = &mut standard_deviations {
                self.network.exploration.write(&mut deviations[columns]);
            }
        }
    }

    fn clips_actions(&self) -> bool {
        true
    }
}

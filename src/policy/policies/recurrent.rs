//! Plays a recurrent PPO policy: normaliser, LSTM, optional dense layers, linear head (`spec/policy.md` §4.2).

use std::sync::Arc;

use super::check_sizes;
use super::exploration::{Exploration, NoiseMemory};
use super::mlp::activation;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::{ComponentStatistics, Scalars, TensorMap};
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
    /// Reads the networks off a checkpoint's tensors. A critic without a recurrent layer of its own (one that shares the
    /// actor's, or has none) is not read: nothing asks for its values.
    pub fn from_tensors(
        tensors: &TensorMap,
        scalars: &Scalars,
        statistics: &ComponentStatistics,
    ) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        let actor = Branch::read(weights, "lstm_actor", "policy_net", "action_net", scalars)?;
        let critic = if weights.has("lstm_critic.weight_hh_l0") {
            Some(Branch::read(weights, "lstm_critic", "value_net", "value_net", scalars)?)
        } else {
            None
        };
        let exploration = Exploration::read(weights, "action_net", scalars.exploration.as_ref())?;
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
        scalars: &Scalars,
    ) -> Result<Self, PolicyError> {
        let lstm = Lstm::read(weights, lstm)?;
        let names = weights.hidden_layers(hidden);
        let activation = activation(&names, scalars)?;
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

    /// Advances `state` by one normalised observation, writes the head's output and returns what the head saw.
    pub(in crate::policy) fn step<'a>(
        &self,
        observation: &[f32],
        state: &'a mut LstmState,
        scratch: &'a mut BranchScratch,
        output: &mut [f32],
    ) -> &'a [f32] {
        self.lstm.step(observation, state, &mut scratch.gates);
        let latent = self.hidden.apply(state.output(self.lstm.width()), &mut scratch.hidden);
        self.head.apply(latent, output);
        latent
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
            noise: self.network.exploration.memory(slots),
        }))
    }
}

struct RecurrentActor {
    network: Arc<RecurrentNetwork>,
    states: Vec<LstmState>,
    normalised: Vec<f32>,
    scratch: BranchScratch,
    noise: NoiseMemory,
}

impl Actor for RecurrentActor {
    fn reset(&mut self, slot: usize) {
        let state = &mut self.states[slot];
        state.hidden.fill(0.0);
        state.cell.fill(0.0);
        self.noise.reset(slot);
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
            let latent = self.network.actor.step(
                &self.normalised,
                &mut self.states[slot],
                &mut self.scratch,
                &mut action_means[columns.clone()],
            );
            if let Some(deviations) = &mut standard_deviations {
                let row = &mut deviations[columns];
                self.network.exploration.write(latent, &mut self.noise, slot, row);
            }
        }
    }

    fn sample(
        &mut self,
        slot: usize,
        standard_deviations: &[f32],
        action: &mut [f32],
        normal: &mut dyn FnMut() -> f64,
    ) {
        let exploration = &self.network.exploration;
        exploration.sample(&mut self.noise, slot, standard_deviations, action, normal);
    }

    fn clips_actions(&self) -> bool {
        true
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::npz::Arrays;
    use crate::policy::checkpoint::contents::Normaliser;
    use crate::policy::checkpoint::{self, Limits};

    #[test]
    fn a_critic_of_two_layers_values_as_the_library() {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/experts");
        let file = |end: &str| folder.join(format!("recurrent_two_layers{end}"));
        let limits = Limits::default();
        let read = checkpoint::open(&file(".zip"), &limits).unwrap();
        let statistics = checkpoint::open_normaliser(&file("_vecnormalize.pkl"), &limits).unwrap();
        let Normaliser::PerComponent(statistics) = statistics else { panic!("wrong kind") };
        let policy = RecurrentPolicy::from_tensors(&read.tensors, &read.scalars, &statistics);
        let policy = policy.unwrap();
        let network = policy.network();
        let critic = network.critic().unwrap();
        let recorded = Arrays::open(&file("_io.npz")).unwrap();
        let values = |name: &str| recorded.get(name).unwrap().to_f32();
        let (mut state, mut scratch) = (critic.initial_state(), critic.scratch());
        let (observations, starts) = (values("obs"), values("start"));
        for ((raw, start), expected) in observations.chunks(5).zip(starts).zip(values("value")) {
            if start != 0.0 {
                state = critic.initial_state();
            }
            let (mut input, mut value) = ([0.0; 5], [0.0]);
            network.normaliser().apply(raw, &mut input);
            critic.step(&input, &mut state, &mut scratch, &mut value);
            assert!((value[0] - expected).abs() < 1e-5, "{}, not {expected}", value[0]);
        }
    }
}

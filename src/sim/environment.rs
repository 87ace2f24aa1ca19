//! A body playing a task: reset, step, time limit (`spec/tasks.md` §1.4–1.6).

use crate::npz::ArrayError;
use crate::policy::vocabulary::Vocabulary;
use crate::policy::{ObservationVariant, TaskInterface};

use super::bodies::Bodies;
use super::engine::{EngineError, Names, Simulation};
use super::muscles;
use super::random::Random;
use super::tasks::{Definition, RecordedStart, RewardConfiguration, Stepping, Task, Verdict};

/// What one control step gave.
#[derive(Debug, Clone, Copy, PartialEq)]
#[expect(
    clippy::struct_excessive_bools,
    reason = "four independent facts, each recorded on its own"
)]
pub struct StepOutcome {
    /// Weighted sum of the reward components.
    pub reward: f64,
    /// The goal is met in this step.
    pub solved: bool,
    /// The task ended the episode.
    pub terminated: bool,
    /// The time limit ended the episode, and the task did not.
    pub truncated: bool,
    /// The physics diverged in this step and was reset to the reference configuration, as published; the episode goes
    /// on from there.
    pub diverged: bool,
}

impl StepOutcome {
    /// Whether the episode is over.
    #[must_use]
    pub fn ended(&self) -> bool {
        self.terminated || self.truncated
    }
}

/// One body with its task.
pub struct Environment {
    definition: &'static Definition,
    simulation: Simulation,
    task: Box<dyn Task>,
    /// Component index and weight, in the order of summation.
    weights: Vec<(usize, f64)>,
    clean_indices: Vec<usize>,
    observation: Vec<f64>,
    components: Vec<f64>,
    step: usize,
}

impl std::fmt::Debug for Environment {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{} at step {}", self.definition.name, self.step)
    }
}

impl Environment {
    /// A body for the task.
    pub fn new(
        definition: &'static Definition,
        bodies: &Bodies,
        configuration: RewardConfiguration,
    ) -> Result<Self, EngineError> {
        let mut simulation = bodies.body(definition.source, definition.model)?;
        simulation.set_timestep(definition.timestep);
        Self::of(definition, simulation, configuration)
    }

    /// Another body for the same task.
    pub fn duplicate(&self, configuration: RewardConfiguration) -> Result<Self, EngineError> {
        Self::of(self.definition, self.simulation.duplicate()?, configuration)
    }

    fn of(
        definition: &'static Definition,
        simulation: Simulation,
        configuration: RewardConfiguration,
    ) -> Result<Self, EngineError> {
        let task = definition.build(&simulation)?;
        Ok(Self {
            definition,
            weights: weights_of(task.as_ref(), configuration),
            clean_indices: task.layout().indices(task.clean_keys()),
            observation: vec![0.0; task.layout().total_len()],
            components: vec![0.0; task.components().len()],
            simulation,
            task,
            step: 0,
        })
    }

    /// The task's constants.
    #[must_use]
    pub fn definition(&self) -> &'static Definition {
        self.definition
    }

    /// The task itself.
    #[must_use]
    pub fn task(&self) -> &dyn Task {
        self.task.as_ref()
    }

    /// The body.
    #[must_use]
    pub fn simulation(&self) -> &Simulation {
        &self.simulation
    }

    /// The body, to be changed by a replay.
    pub fn simulation_mut(&mut self) -> &mut Simulation {
        &mut self.simulation
    }

    /// Names of the muscles, in the order of an action.
    #[must_use]
    pub fn muscles(&self) -> Vec<String> {
        self.simulation.names_of(Names::Actuator)
    }

    /// What a policy must know to play this.
    #[must_use]
    pub fn interface(&self) -> TaskInterface {
        let vocabulary = Vocabulary::standard();
        let ids = |words: &[String]| words.iter().filter_map(|w| vocabulary.id_of(w)).collect();
        let muscles = self.muscles();
        TaskInterface {
            task: self.definition.name.to_owned(),
            muscle_count: muscles.len(),
            muscle_observation_length: self.task.layout().len(),
            clean_observation_length: self.clean_indices.len(),
            observation_words: self.task.layout().phrases().map(ids).collect(),
            action_words: self
                .task
                .action_phrases(&muscles)
                .iter()
                .map(|phrase| ids(phrase))
                .collect(),
            muscle_models: self.simulation.muscle_models(),
        }
    }

    /// Length of the observation of a variant.
    #[must_use]
    pub fn observation_length(&self, variant: ObservationVariant) -> usize {
        match variant {
            ObservationVariant::Muscle => self.task.layout().len(),
            ObservationVariant::Clean => self.clean_indices.len(),
            ObservationVariant::CleanAndMuscles => {
                self.clean_indices.len() + 2 * self.simulation.muscle_length().len()
            }
        }
    }

    /// The newest observation: everything in the task's [`super::layout::Layout`].
    #[must_use]
    pub fn observation(&self) -> &[f64] {
        &self.observation
    }

    /// The newest observation in single precision, as every policy gets it.
    pub fn read_observation(&self, variant: ObservationVariant, into: &mut [f32]) {
        match variant {
            ObservationVariant::Muscle => {
                for (to, &from) in into.iter_mut().zip(&self.observation) {
                    *to = from as f32;
                }
            }
            ObservationVariant::Clean => {
                for (to, &index) in into.iter_mut().zip(&self.clean_indices) {
                    *to = self.observation[index] as f32;
                }
            }
            ObservationVariant::CleanAndMuscles => {
                let (clean, muscles) = into.split_at_mut(self.clean_indices.len());
                self.read_observation(ObservationVariant::Clean, clean);
                let body = &self.simulation;
                let state = body.muscle_length().iter().chain(body.muscle_velocity());
                for (to, &from) in muscles.iter_mut().zip(state) {
                    *to = from as f32;
                }
            }
        }
    }

    /// The newest numbers of the observation's block `key`, e.g. `feet_contact_force`, as the body's sensors give them.
    #[must_use]
    pub fn block(&self, key: &str) -> Option<&[f64]> {
        self.task.layout().range(key).map(|range| &self.observation[range])
    }

    /// Reward components of the last step, in the order of [`Task::components`].
    #[must_use]
    pub fn components(&self) -> &[f64] {
        &self.components
    }

    /// The last step's reward under another configuration.
    #[must_use]
    pub fn reward_under(&self, configuration: RewardConfiguration) -> f64 {
        weights_of(self.task.as_ref(), configuration)
            .iter()
            .map(|&(index, weight)| weight * self.components[index])
            .sum()
    }

    /// Starts an episode drawn from `random`.
    pub fn reset(&mut self, random: &mut Random) {
        self.task.reset(&mut self.simulation, random);
        self.begin();
    }

    /// Starts a recorded episode. Model and state were set by the caller.
    pub fn adopt(&mut self, start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        self.task.adopt(start)?;
        self.begin();
        Ok(())
    }

    fn begin(&mut self) {
        self.step = 0;
        self.task.begin(&self.simulation);
        self.task.observe(&self.simulation, &mut self.observation);
    }

    /// One control step with an action (not clipped).
    pub fn step(&mut self, action: &[f32]) -> StepOutcome {
        for (excitation, &a) in self.simulation.excitation_mut().iter_mut().zip(action) {
            *excitation = muscles::excitation(a);
        }
        self.step_excited()
    }

    /// One control step with excitations.
    pub fn step_with(&mut self, excitation: &[f64]) -> StepOutcome {
        self.simulation.excitation_mut().copy_from_slice(excitation);
        self.step_excited()
    }

    /// One control step with the excitations that are set in the body.
    pub fn step_excited(&mut self) -> StepOutcome {
        self.task.before_step(&mut self.simulation);
        let diverged = self.advance_physics();
        let Verdict { solved, done } = self.task.judge(&self.simulation, &mut self.components);
        self.task.observe(&self.simulation, &mut self.observation);
        self.step += 1;
        let reward = self.weights.iter().map(|&(index, w)| w * self.components[index]).sum();
        StepOutcome {
            reward,
            solved,
            terminated: done,
            truncated: !done && self.step >= self.definition.horizon,
            diverged,
        }
    }

    /// The published stepping order, and what is computed after it. Says whether the physics had to be reset.
    fn advance_physics(&mut self) -> bool {
        let simulation = &mut self.simulation;
        let before = simulation.warning_count();
        match self.definition.stepping {
            Stepping::Split => {
                simulation.step_second_half();
                (1..self.definition.substeps).for_each(|_| simulation.step());
                simulation.step_first_half();
            }
            Stepping::Whole => (0..self.definition.substeps).for_each(|_| simulation.step()),
        }
        let diverged = simulation.warning_count() != before;
        if diverged {
            simulation.reset();
            simulation.forward_without_actuation();
        }
        match self.definition.stepping {
            Stepping::Split if diverged => simulation.forward(),
            Stepping::Split => simulation.forward_after_first_half(),
            // The published code asks for positions once for the reward and once for the observation. The second time is
            // not idle: each normalises the root's quaternion in place, and in 2.3.7 that can move its last bit.
            Stepping::Whole => {
                simulation.kinematics();
                simulation.kinematics();
            }
        }
        diverged
    }
}

/// Component index and weight, in the order of summation.
fn weights_of(task: &dyn Task, configuration: RewardConfiguration) -> Vec<(usize, f64)> {
    let place = |name: &str| task.components().iter().position(|component| *component == name);
    let weights = task.weights(configuration).iter();
    weights.filter_map(|&(name, weight)| Some((place(name)?, weight))).collect()
}

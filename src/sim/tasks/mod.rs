//! The tasks: what is observed, rewarded, solved and done (`spec/tasks.md` §2).

mod baoding;
mod description;
mod die_reorient;
mod extra;
mod finger_reach;
mod joint_pose;
mod pen_reorient;
mod published;
mod registry;
mod relocate;
mod walk;

pub use baoding::Direction;
pub use description::{Chosen, Event, Start, Threshold};
pub use registry::{ALL, Definition, EXTRA, Source, Stepping, TaskError, every, find};

use crate::npz::{ArrayError, Arrays};

use super::engine::{EngineError, Simulation};
use super::layout::{Layout, per_muscle};
use super::random::Random;

/// Which of the two published reward configurations is summed. Solved and done do not depend on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RewardConfiguration {
    /// The benchmark's weights.
    Sparse,
    /// The weights the published checkpoints were trained with.
    Dense,
}

/// Whose rewards and limits a task has, where the paper's differ from those of the environment it was made from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Rules {
    /// The paper's.
    Arnold,
    /// Those of `MyoSuite`'s own environment, in both reward configurations.
    MyoSuite,
}

/// What a task says about a state.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Verdict {
    /// The goal is met in this very step.
    pub solved: bool,
    /// The episode ends here, whatever the time.
    pub done: bool,
}

/// What a recorded episode started from: for replaying it.
#[derive(Debug)]
pub struct RecordedStart<'a> {
    /// Arrays of the recording.
    pub arrays: &'a Arrays,
    /// The task's variables after reset.
    pub task_state: &'a serde_json::Value,
}

impl RecordedStart<'_> {
    /// A number among the task's variables.
    pub fn number(&self, pointer: &str) -> Result<f64, ArrayError> {
        self.task_state
            .pointer(pointer)
            .and_then(serde_json::Value::as_f64)
            .ok_or_else(|| ArrayError::Missing { array: format!("task_state{pointer}") })
    }
}

/// One task on one body.
pub trait Task: Send {
    /// The muscle observation.
    fn layout(&self) -> &Layout;

    /// The blocks of the clean observation, in its order.
    fn clean_keys(&self) -> &'static [&'static str];

    /// The words that describe each muscle as an action.
    fn action_phrases(&self, muscles: &[String]) -> Vec<Vec<String>> {
        per_muscle("action", "", muscles, "activation").phrases
    }

    /// The word by which the observation speaks of the model's joint `name`.
    fn joint_word(&self, name: &str) -> String {
        name.to_owned()
    }

    /// Direction of the root's x axis in the plane, rad; `None` where no root moves.
    fn heading(&self, _simulation: &Simulation) -> Option<f64> {
        None
    }

    /// Names of the reward components, in the order in which [`Task::judge`] writes them.
    fn components(&self) -> &'static [&'static str];

    /// Weights of the reward, in the order of summation. Components that are not named weigh nothing.
    fn weights(&self, configuration: RewardConfiguration) -> &'static [(&'static str, f64)];

    /// The numbers that decide whether a step is solved and the episode over.
    fn thresholds(&self) -> Vec<Threshold>;

    /// What an episode starts from: goal and initial state, as [`Task::reset`] chooses them.
    fn starts(&self) -> Vec<Start>;

    /// Draws the episode's goal and initial state, edits the model, and leaves the initial positions in the
    /// reset state. The caller has not reset the simulation yet; see [`start_from`].
    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random);

    /// Takes over a recorded episode's variables instead of drawing them. State and model are set by the caller.
    fn adopt(&mut self, start: &RecordedStart<'_>) -> Result<(), ArrayError>;

    /// Remembers what it needs of the state an episode starts from.
    fn begin(&mut self, _simulation: &Simulation) {}

    /// Edits the model before the physics of a step.
    fn before_step(&mut self, _simulation: &mut Simulation) {}

    /// Writes everything in [`Layout`] about the current state.
    fn observe(&self, simulation: &Simulation, observation: &mut [f64]);

    /// What is to be reached now, where that has a place.
    fn targets(&self) -> Vec<Target> {
        Vec::new()
    }

    /// The positions of all joints that are to be reached, where that is what is to be reached.
    fn target_pose(&self) -> Option<&[f64]> {
        None
    }

    /// Writes the reward components of the current state. Called before [`Task::observe`], so that a goal that moves with
    /// the body is judged where it was and observed where it is.
    fn judge(&mut self, simulation: &Simulation, components: &mut [f64]) -> Verdict;
}

/// Something to be reached, as one may draw it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Target {
    pub place: Place,
    /// What is to be there counts as there within this distance, m.
    pub radius: f64,
}

/// Where a target is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Place {
    /// At a site of the body, which says where that is.
    Site(usize),
    /// At a point of the world, m.
    Point([f64; 3]),
}

/// Resets the simulation and starts it at rest from `qpos` (`spec/tasks.md` §1.5): everything is cleared, the warm start
/// included, then set, then computed.
fn start_from(simulation: &mut Simulation, qpos: &[f64]) {
    simulation.reset();
    simulation.forward_without_actuation();
    simulation.qpos_mut().copy_from_slice(qpos);
    simulation.qvel_mut().fill(0.0);
    simulation.forward();
}

/// Effort: minus the Euclidean norm of all activations, divided by their number.
fn activation_cost(simulation: &Simulation) -> f64 {
    let activation = simulation.activation();
    -norm(activation) / activation.len() as f64
}

fn norm(vector: &[f64]) -> f64 {
    length(vector.iter().copied())
}

/// Euclidean norm of numbers, summed in their order.
fn length(numbers: impl Iterator<Item = f64>) -> f64 {
    numbers.map(|x| x * x).sum::<f64>().sqrt()
}

fn indicator(condition: bool) -> f64 {
    f64::from(u8::from(condition))
}

/// Cosine of the angle between two vectors; 0 if one of them is zero.
fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let dot: f64 = a.iter().zip(b).map(|(x, y)| x * y).sum();
    let lengths = norm(a) * norm(b);
    if lengths > 0.0 { dot / lengths } else { dot }
}

fn difference(a: &[f64], b: &[f64]) -> [f64; 3] {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// Row `index` of a matrix with three columns.
fn row3(matrix: &[f64], index: usize) -> &[f64] {
    &matrix[3 * index..3 * index + 3]
}

/// Why a body for a task cannot be made.
pub type BuildResult<T> = Result<T, EngineError>;

//! What a run of any algorithm can do: learn a stretch, tell how it goes, be looked at, be stored and go on.

use std::path::Path;

use serde::Serialize;

use super::TrainError;
use super::plan::Plan;
use crate::policy::checkpoint::contents::{Checkpoint, Normaliser};
use crate::sim::bodies::Bodies;
use crate::sim::rollout::Machine;

/// A run in memory.
pub trait Learner: Sized {
    /// Its constants.
    type Recipe: Serialize;

    /// A run before its first step.
    fn new(plan: Plan<Self::Recipe>, bodies: &Bodies) -> Result<Self, TrainError>;

    fn plan(&self) -> &Plan<Self::Recipe>;

    /// Control steps so far.
    fn steps(&self) -> u64;

    /// Whether the run has all its steps.
    fn is_finished(&self) -> bool {
        self.steps() >= self.plan().last_step()
    }

    /// Plays some steps and learns from them. The result does not depend on `threads`.
    fn iterate(&mut self, threads: usize) -> Result<Report, TrainError>;

    /// The policy as it is now, with its normaliser.
    fn policy(&self) -> (Checkpoint, Normaliser);

    /// Mean solved fraction of `episodes` episodes of every task.
    fn evaluate(&self, machine: &Machine, episodes: usize) -> Result<Vec<f64>, TrainError>;

    /// Writes the run as it is.
    fn save(&self, path: &Path) -> Result<(), TrainError>;

    /// Goes on from what [`Self::save`] wrote. The plan must be the same, apart from its length.
    fn restore(&mut self, path: &Path) -> Result<(), TrainError>;
}

/// What one iteration showed.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Control steps so far.
    pub steps: u64,
    /// Share of solved steps of the rollout, by task.
    pub solved: Vec<f64>,
    /// By task, the mean of every reward component.
    pub components: Vec<Vec<(&'static str, f64)>>,
    /// Mean raw return of the last hundred episodes.
    pub episode_reward: Option<f64>,
    /// Their mean length.
    pub episode_length: Option<f64>,
    /// What the algorithm has to say, by the names of its curves; NaN where there is nothing.
    pub training: Vec<(&'static str, f64)>,
}

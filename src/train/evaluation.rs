//! How much of its time the policy solves its tasks, measured while it learns.
//!
//! The same episodes every time, from streams of their own: evaluating changes nothing of the run. Perceptrons play their
//! mean action, as the published experts do, and transformers a sample, as the published evaluation does.

use super::TrainError;
use super::recipe::NetworkShape;
use super::streams::Purpose;
use super::trainer::Trainer;
use crate::policy;
use crate::sim::rollout::{ActionMode, Channels, EpisodeSpec, Machine, RolloutPlan, play};

impl Trainer {
    /// Mean solved fraction of `episodes` episodes of every task.
    pub fn evaluate(&self, machine: &Machine, episodes: usize) -> Result<Vec<f64>, TrainError> {
        let (checkpoint, normaliser) = self.policy();
        let policy = policy::load(&checkpoint, Some(&normaliser))?;
        let mode = match self.plan.recipe.network {
            NetworkShape::Perceptron(_) => ActionMode::Deterministic,
            NetworkShape::Transformer(_) => ActionMode::Stochastic,
        };
        let mut fractions = Vec::with_capacity(self.plan.tasks.len());
        for (index, task) in self.plan.tasks.iter().enumerate() {
            let spec = |episode| EpisodeSpec {
                episode,
                reset_seed: self.streams.seed_of(Purpose::Evaluation, [index, episode]),
                action_seed: self.streams.seed_of(Purpose::EvaluationActions, [index, episode]),
                projection: None,
            };
            let plan = RolloutPlan {
                task: task.definition,
                policy: policy.as_ref(),
                mode,
                action_noise: 0.0,
                projections: &[],
                channels: Channels::Counts,
                rewards: self.plan.recipe.rewards.configuration(),
            };
            let specs: Vec<EpisodeSpec> = (0..episodes).map(spec).collect();
            let played = play(machine, &plan, &specs, &|_| ())?;
            let solved: usize = played.iter().map(|episode| episode.solved_steps).sum();
            fractions.push(solved as f64 / (episodes * task.definition.horizon) as f64);
        }
        Ok(fractions)
    }
}

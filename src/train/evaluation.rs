//! How much of its time the policy solves its tasks, measured while it learns.
//!
//! The same episodes every time, from streams of their own: evaluating changes nothing of the run. Perceptrons of one task play
//! their mean action, as the published experts do; policies of many tasks a sample, as the published evaluation does.

use super::TrainError;
use super::plan::Plan;
use super::recipe::Rewards;
use super::streams::{Purpose, Streams};
use crate::policy;
use crate::policy::checkpoint::contents::{Checkpoint, Normaliser};
use crate::sim::rollout::{ActionMode, Channels, EpisodeSpec, Machine, RolloutPlan, play};

/// Mean solved fraction of `episodes` episodes of every task of `plan`.
pub(super) fn evaluate<R>(
    plan: &Plan<R>,
    rewards: &Rewards,
    (checkpoint, normaliser): &(Checkpoint, Normaliser),
    mode: ActionMode,
    machine: &Machine,
    episodes: usize,
) -> Result<Vec<f64>, TrainError> {
    let policy = policy::load(checkpoint, Some(normaliser))?;
    let streams = Streams { seed: plan.seed };
    let mut fractions = Vec::with_capacity(plan.tasks.len());
    for (index, task) in plan.tasks.iter().enumerate() {
        let spec = |episode| EpisodeSpec {
            episode,
            reset_seed: streams.seed_of(Purpose::Evaluation, [index, episode]),
            action_seed: streams.seed_of(Purpose::EvaluationActions, [index, episode]),
            projection: None,
        };
        let plan = RolloutPlan {
            task: task.definition,
            policy: policy.as_ref(),
            mode,
            action_noise: 0.0,
            projections: &[],
            channels: Channels::Counts,
            rewards: rewards.configuration(),
        };
        let specs: Vec<EpisodeSpec> = (0..episodes).map(spec).collect();
        let played = play(machine, &plan, &specs, &|_| ())?;
        let solved: usize = played.iter().map(|episode| episode.solved_steps).sum();
        fractions.push(solved as f64 / (episodes * task.definition.horizon) as f64);
    }
    Ok(fractions)
}

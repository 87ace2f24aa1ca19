//! A rollout beside its parts: what does the loop cost that is neither physics nor forward pass?
//!
//! The same episodes are played three times: by the rollout loop, on one thread; as physics alone, each body fed with the actions
//! it was given before; and as forward passes alone, as many as there were steps. Then once more by two threads.

use std::time::Duration;

use serde::Serialize;

use crate::experiment::seed;
use crate::policy::Policy;
use crate::sim::environment::Environment;
use crate::sim::random::Random;
use crate::sim::rollout::{
    self, ActionMode, Channels, EpisodeSpec, Machine, RolloutError, RolloutPlan,
};
use crate::sim::tasks::{Definition, RewardConfiguration};

use super::{best_time, forward};

/// What one task's loop costs. Times are per control step.
#[derive(Debug, Clone, Serialize)]
pub struct LoopRow {
    /// The task.
    pub task: &'static str,
    /// Control steps played.
    pub steps: usize,
    /// The whole loop on one thread, ms.
    pub loop_milliseconds: f64,
    /// Resets and physics alone, ms.
    pub physics_milliseconds: f64,
    /// Forward passes alone, ms.
    pub forward_milliseconds: f64,
    /// Speed of two threads over that of one.
    pub two_threads: f64,
}

impl LoopRow {
    /// The loop's time over that of its parts.
    #[must_use]
    pub fn overhead(&self) -> f64 {
        self.loop_milliseconds / (self.physics_milliseconds + self.forward_milliseconds)
    }
}

/// Plays `episodes` of `task` and its parts, spending at least `budget` on each.
pub fn measure(
    machine: &Machine,
    policy: &dyn Policy,
    task: &'static Definition,
    episodes: usize,
    budget: Duration,
) -> Result<LoopRow, RolloutError> {
    let specs: Vec<EpisodeSpec> =
        (0..episodes).map(|episode| seed::episode(0, task.name, episode, None)).collect();
    let plan = |channels| RolloutPlan {
        task,
        policy,
        mode: ActionMode::Deterministic,
        action_noise: 0.0,
        projections: &[],
        channels,
        rewards: RewardConfiguration::Sparse,
    };
    let on = |threads| Machine { threads, ..machine.clone() };
    let recorded = rollout::play(&on(1), &plan(Channels::All), &specs, &|_| ())?;
    let steps: usize = recorded.iter().map(|episode| episode.steps).sum();

    let counts = plan(Channels::Counts);
    let play = |threads| -> Result<f64, RolloutError> {
        rollout::play(&on(threads), &counts, &specs, &|_| ())?;
        Ok(best_time(budget, || {
            // It has just worked with the same arguments.
            let _played = rollout::play(&on(threads), &counts, &specs, &|_| ());
        }))
    };
    let (one, two) = (play(1)?, play(2)?);

    let mut environment = Environment::new(task, &machine.bodies, RewardConfiguration::Sparse)?;
    let muscles = environment.muscles().len();
    let physics = best_time(budget, || {
        for episode in &recorded {
            environment.reset(&mut Random::new(episode.spec.reset_seed));
            for action in episode.recording.action.chunks_exact(muscles) {
                environment.step(action);
            }
        }
    });
    let interface = environment.interface();
    let forward =
        forward::seconds_per_observation(policy, &interface, machine.batch.min(episodes), budget)?;
    let per_step = 1e3 / steps as f64;
    Ok(LoopRow {
        task: task.name,
        steps,
        loop_milliseconds: one * per_step,
        physics_milliseconds: physics * per_step,
        forward_milliseconds: 1e3 * forward,
        two_threads: one / two,
    })
}

//! A rollout beside its parts: what does the loop cost that is neither physics nor forward pass?
//!
//! The same episodes are played three times: by the rollout loop, on one thread; as physics alone, each body fed with the actions
//! it was given before; and as forward passes alone, as many as there were steps. Then once more by two threads, and once
//! as a sweep: planned, entered into a ledger, and put together again. What was recorded of them is written to a file.

use std::collections::BTreeMap;
use std::time::Duration;

use serde::Serialize;
use serde_json::Value;

use crate::experiment::ExperimentError;
use crate::experiment::gather::{Played, SweepError};
use crate::experiment::plan::{Arm, Plan, Shard, Typed};
use crate::experiment::recording::{self, Source};
use crate::experiment::seed;
use crate::experiment::worker::{self, Crew, Scene};
use crate::files;
use crate::policy::Policy;
use crate::record::{Format, Place, Recording, write_recording};
use crate::sim::environment::Environment;
use crate::sim::random::Random;
use crate::sim::rollout::{
    self, ActionMode, Channels, Episode, EpisodeSpec, Machine, RolloutError, RolloutPlan,
};
use crate::sim::tasks::{Definition, RewardConfiguration};

use super::forward::Body;
use super::{best_time, forward};

/// What one task's loop costs. Times are per control step.
#[derive(Debug, Clone, Serialize)]
pub struct LoopRow {
    /// The task.
    pub task: &'static str,
    /// The body as the transformer sees it.
    #[serde(skip)]
    pub body: Body,
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
    /// Time of the same episodes as a sweep, on one thread, over that of the loop.
    pub sweep: f64,
    /// Writing everything recorded as Parquet, ms; none where that is not built in.
    pub parquet_milliseconds: Option<f64>,
    /// The same as MCAP.
    pub mcap_milliseconds: Option<f64>,
}

impl LoopRow {
    /// Control steps per second of two threads.
    #[must_use]
    pub fn rate(&self) -> f64 {
        1e3 * self.two_threads / self.loop_milliseconds
    }

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
) -> Result<LoopRow, ExperimentError> {
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
    let play = |threads| -> Result<f64, ExperimentError> {
        rollout::play(&on(threads), &counts, &specs, &|_| ())?;
        Ok(best_time(budget, || {
            // It has just worked with the same arguments.
            let _played = rollout::play(&on(threads), &counts, &specs, &|_| ());
        }))
    };
    let (one, two) = (play(1)?, play(2)?);
    let machine_of_one = on(1);
    let crew = Crew {
        machine: &machine_of_one,
        scene: &Same(&counts),
        goes_on: &|| true,
        on_episode: &|| (),
        watcher: None,
    };
    let sweep_plan = sweep_plan(task, episodes);
    sweep(&sweep_plan, &crew)?;
    let sweep = best_time(budget, || {
        // It has just worked with the same arguments.
        let _played = sweep(&sweep_plan, &crew);
    });

    let mut environment = Environment::new(task, &machine.bodies, RewardConfiguration::Sparse)
        .map_err(RolloutError::from)?;
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
        forward::seconds_per_observation(policy, &interface, machine.batch.min(episodes), budget)
            .map_err(RolloutError::from)?;
    let names = rollout::channel_names(&machine_of_one, task)?;
    let (mode, metadata) = (ActionMode::Deterministic, BTreeMap::new());
    let source = Source { task, policy: "made up", mode, seed: 0, metadata };
    let recording = recording::recording(source, &names, recorded);
    let per_step = 1e3 / steps as f64;
    let written = |built: bool, format| -> Result<Option<f64>, ExperimentError> {
        if !built {
            return Ok(None);
        }
        Ok(Some(per_step * writing(&recording, format, budget)?))
    };
    Ok(LoopRow {
        parquet_milliseconds: written(cfg!(feature = "parquet"), Format::Parquet)?,
        mcap_milliseconds: written(cfg!(feature = "mcap"), Format::Mcap)?,
        task: task.name,
        body: Body {
            name: task.name,
            sensors: interface.observation_words.len(),
            muscles: interface.muscle_count,
        },
        steps,
        loop_milliseconds: one * per_step,
        physics_milliseconds: physics * per_step,
        forward_milliseconds: 1e3 * forward,
        two_threads: one / two,
        sweep: sweep / one,
    })
}

/// Seconds for writing `recording` to a file, its copy in memory included.
fn writing(
    recording: &Recording,
    format: Format,
    budget: Duration,
) -> Result<f64, ExperimentError> {
    let folder = files::temporary_folder(&std::env::temp_dir(), "arnold-analyze-bench")?;
    let file = [(format, folder.path().join("recording"))];
    write_recording(recording.clone(), &file, Place::Replace)?;
    Ok(best_time(budget, || {
        // It has just worked with the same arguments.
        let _written = write_recording(recording.clone(), &file, Place::Replace);
    }))
}

/// A scene in which every arm is played alike.
struct Same<'a>(&'a RolloutPlan<'a>);

impl Scene for Same<'_> {
    fn rollout(&self, _: &Arm) -> RolloutPlan<'_> {
        self.0.clone()
    }
}

/// The plan of one arm: what `evaluate` would write.
fn sweep_plan(task: &Definition, episodes: usize) -> Plan {
    Plan {
        program: String::new(),
        key: String::new(),
        typed: Typed { words: Vec::new(), folder: "".into(), data: "".into() },
        shared: Value::Null,
        seed: 0,
        policies: vec![Value::Null],
        arms: vec![Arm {
            stage: 0,
            task: task.name.to_owned(),
            policy: 0,
            condition: Value::Null,
            first: 0,
            episodes,
            channels: Channels::Counts,
        }],
    }
}

/// Plans, plays and puts together in a folder of its own.
fn sweep(plan: &Plan, crew: &Crew<'_>) -> Result<Vec<Episode>, ExperimentError> {
    let folder = files::temporary_folder(&std::env::temp_dir(), "arnold-analyze-bench")?;
    plan.write(folder.path()).map_err(SweepError::Plan)?;
    worker::work(plan, folder.path(), Shard::ALL, crew)?;
    Played::complete(plan, folder.path())?.episodes(0)
}

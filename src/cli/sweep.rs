//! How a command plays its episodes: it says which, and gets them back when all are there.
//!
//! Nothing that is in the ledgers of the run folder is played again. Called as it is, a command plays what is missing,
//! goes on and ends with its results. Called through `plan`, `work` or `gather`, it does its part of that and ends, or goes
//! on from what others played.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use crate::experiment::ExperimentError;
use crate::experiment::book::{Book, Depth};
use crate::experiment::gather::{Played, SweepError};
use crate::experiment::plan::{Arm, PLAN, Plan, Shard, Typed};
use crate::experiment::run_folder::{self, RunFolder};
use crate::experiment::worker::{self, Crew, Ended, Scene};

use super::context::Context;
use super::laboratory::Laboratory;
use super::progress::{self, Progress};
use super::render::Hinted;
use super::signals;

/// A part of a sweep.
#[derive(Debug, Clone)]
pub struct Assignment {
    /// Folder of the sweep.
    pub folder: PathBuf,
    pub purpose: Purpose,
}

/// Which part.
#[derive(Debug, Clone, Copy)]
pub enum Purpose {
    /// Write the plan.
    Plan,
    /// Play a shard.
    Work {
        shard: Shard,
        /// Instead of what the plan was typed with.
        threads: Option<NonZeroUsize>,
        batch: Option<NonZeroUsize>,
    },
    /// Go on from what was played.
    Gather,
}

impl Context {
    /// Worker threads, where `work` was told a number.
    #[must_use]
    pub fn threads(&self) -> Option<NonZeroUsize> {
        match self.assignment.as_ref()?.purpose {
            Purpose::Work { threads, .. } => threads,
            Purpose::Plan | Purpose::Gather => None,
        }
    }

    /// Bodies per thread, where `work` was told a number.
    #[must_use]
    pub fn batch(&self) -> Option<NonZeroUsize> {
        match self.assignment.as_ref()?.purpose {
            Purpose::Work { batch, .. } => batch,
            Purpose::Plan | Purpose::Gather => None,
        }
    }
}

/// The episodes of `arms`, and the seconds that playing took; `None` if the assignment ends before they are all there.
pub fn play(
    context: &Context,
    folder: &RunFolder,
    laboratory: &Laboratory,
    scene: &dyn Scene,
    arms: Vec<Arm>,
) -> anyhow::Result<Option<(Played, f64)>> {
    let plan = Plan {
        program: run_folder::program(),
        key: folder.key().to_owned(),
        typed: Typed {
            words: context.words.clone(),
            folder: std::env::current_dir()?,
            data: std::path::absolute(&context.data)?,
        },
        shared: laboratory.shared(),
        seed: laboratory.seed,
        policies: laboratory.policies(),
        arms,
    };
    plan.check().map_err(SweepError::Plan)?;
    let purpose = context.assignment.as_ref().map(|assignment| assignment.purpose);
    record_plan(&plan, folder, purpose)?;
    let (shard, ends) = match purpose {
        None => (Shard::ALL, false),
        Some(Purpose::Work { shard, .. }) => (shard, true),
        Some(Purpose::Plan) => return Ok(None),
        Some(Purpose::Gather) => return Ok(Some((complete(&plan, folder)?, 0.0))),
    };
    let seconds = work(context, &plan, folder, shard, laboratory, scene)?;
    if ends {
        return Ok(None);
    }
    Ok(Some((complete(&plan, folder)?, seconds)))
}

/// An error if a part of a sweep is to be done by a command that plays nothing as it was typed.
pub fn nothing_to_play(context: &Context) -> anyhow::Result<()> {
    if context.assignment.is_none() {
        return Ok(());
    }
    Err(Hinted::new(
        "typed like this the command plays nothing, so there is nothing to plan",
        "run it as it is, without `plan`",
    ))
}

/// Writes the plan, or compares it with the one that is there.
fn record_plan(plan: &Plan, folder: &RunFolder, purpose: Option<Purpose>) -> anyhow::Result<()> {
    let stored = folder.file(PLAN).exists().then(|| Plan::read(&folder.path));
    let same = |stored: &Plan| *stored == Plan { typed: stored.typed.clone(), ..plan.clone() };
    match (stored, purpose) {
        (Some(Ok(stored)), _) if same(&stored) => Ok(()),
        // A run folder of our own: its name says that the work is this very work.
        (_, None) | (None, Some(Purpose::Plan)) => Ok(plan.write(&folder.path)?),
        (Some(Err(error)), _) => Err(error.into()),
        (_, Some(Purpose::Plan)) => Err(Hinted::new(
            format!("there is another plan in `{}`", folder.path.display()),
            "choose another folder with `--out DIR`",
        )),
        (Some(Ok(stored)), _) => Err(Hinted::new(
            format!(
                "{} than it was when this was planned, in `{}`",
                difference(&stored, plan),
                folder.path.display()
            ),
            "work with the same program, policy, models and data as the plan, or plan again",
        )),
        (None, _) => Err(Hinted::new(
            format!("there is no plan in `{}`", folder.path.display()),
            "`arnold-analyze plan --out DIR COMMAND…` makes one",
        )),
    }
}

/// The first thing in which the work at hand is not the one that was planned.
fn difference(planned: &Plan, found: &Plan) -> &'static str {
    if planned.program != found.program {
        "the program is another"
    } else if planned.policies != found.policies {
        "the policy is another"
    } else if planned.shared != found.shared || planned.seed != found.seed {
        "how it is played is another"
    } else {
        "the list of episodes is another"
    }
}

fn complete(plan: &Plan, folder: &RunFolder) -> anyhow::Result<Played> {
    Played::complete(plan, &folder.path).map_err(|error| match &error {
        ExperimentError::Sweep(SweepError::Missing { .. }) => Hinted::new(
            error.to_string(),
            "`arnold-analyze work DIR` plays what is missing, `status DIR` shows it",
        ),
        _ => error.into(),
    })
}

/// Plays what is missing of `shard`; the seconds that took.
fn work(
    context: &Context,
    plan: &Plan,
    folder: &RunFolder,
    shard: Shard,
    laboratory: &Laboratory,
    scene: &dyn Scene,
) -> anyhow::Result<f64> {
    signals::listen()?;
    let book = Book::read(plan, &folder.path, Depth::Lines)?;
    let (mut total, mut before) = (0_u64, 0_u64);
    for (place, planned) in plan.episodes().enumerate() {
        let mine = planned.is_in(shard);
        total += u64::from(mine);
        before += u64::from(mine && book.is_done(place));
    }
    if before > 0 {
        context.say(&format!("{before} of {total} episodes are played already"));
    }
    let progress = Progress::resume(context, folder.command(), "episodes", total, before);
    let crew = Crew {
        machine: &laboratory.machine,
        scene,
        goes_on: &signals::go_on,
        watcher: laboratory.watcher(),
        on_episode: &|| progress.advance(1),
    };
    let ended = worker::work(plan, &folder.path, shard, &crew);
    let seconds = progress.finish();
    match ended? {
        Ended::Done => Ok(seconds),
        Ended::Stopped => Err(Hinted::new(
            format!("stopped after {}; what was played is kept", progress::duration(seconds)),
            "the same command goes on from there",
        )),
    }
}

//! The worker: plays what is missing of a sweep, stage by stage, and enters it into its ledger.
//!
//! A worker plays the episodes of its shard. A later stage needs all of the one before; what other shards have not
//! delivered by then, the worker plays as well, instead of waiting for somebody who may never come: a round at a time, each
//! shard from a place of its own and away from where its owner would begin, looking into the ledgers in between. An episode
//! that two workers played is the same episode.

use std::collections::BTreeMap;
use std::ops::ControlFlow;
use std::path::Path;
use std::sync::Mutex;

use crate::files::FileError;
use crate::sim::rollout::{self, Channels, EpisodeSpec, Job, Machine, RolloutPlan, Subspace};
use crate::sim::watching::Watcher;

use super::ExperimentError;
use super::book::{Book, Depth};
use super::gather::Played;
use super::ledger::Ledger;
use super::plan::{Arm, Plan, Planned, Shard};

/// What a plan is played with: the side of a sweep that knows policies and subspaces.
pub trait Scene {
    /// How `arm` is played, but for its projection and its channels.
    fn rollout(&self, arm: &Arm) -> RolloutPlan<'_>;

    /// The projections of `arms`, places in the plan and all of one stage. `played` has the episodes of the stages before.
    fn projections(
        &self,
        arms: &[usize],
        _played: &Played,
    ) -> Result<Vec<Option<Subspace>>, ExperimentError> {
        Ok(vec![None; arms.len()])
    }
}

/// Who plays, and who is told.
#[derive(Clone, Copy)]
pub struct Crew<'a> {
    pub machine: &'a Machine,
    pub scene: &'a dyn Scene,
    /// Whether the work goes on; once it does not, no episode is begun.
    pub goes_on: &'a (dyn Fn() -> bool + Sync),
    /// Who looks on.
    pub watcher: Option<&'a dyn Watcher>,
    /// Called after every episode, from any thread.
    pub on_episode: &'a (dyn Fn() + Sync),
}

/// How work ended.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Ended {
    /// Nothing of the shard is missing.
    Done,
    /// Somebody asked to stop.
    Stopped,
}

/// Plays what is missing of `shard` in the sweep in `folder`.
pub fn work(
    plan: &Plan,
    folder: &Path,
    shard: Shard,
    crew: &Crew<'_>,
) -> Result<Ended, ExperimentError> {
    let mut worker = Worker { plan, folder, crew, ledger: None };
    let ended = worker.all_stages(shard);
    if let Some(ledger) = &worker.ledger {
        ledger.sync()?;
    }
    ended
}

struct Worker<'a> {
    plan: &'a Plan,
    folder: &'a Path,
    crew: &'a Crew<'a>,
    /// Made when the first episode is to be played.
    ledger: Option<Ledger>,
}

/// An episode to be played, and its place in the plan.
type Missing = (usize, Planned);

impl Worker<'_> {
    fn all_stages(&mut self, shard: Shard) -> Result<Ended, ExperimentError> {
        let stages = self.plan.stage_count();
        for stage in 0..stages {
            let played = Played::read(self.plan, self.folder, Depth::Steps)?;
            let mut mine = self.missing(&played.book, stage);
            mine.retain(|(_, planned)| planned.is_in(shard));
            if self.play(&mine, &played)? == Ended::Stopped {
                return Ok(Ended::Stopped);
            }
            if stage + 1 == stages || shard == Shard::ALL {
                continue;
            }
            loop {
                let played = Played::read(self.plan, self.folder, Depth::Lines)?;
                let mut missing = self.missing(&played.book, stage);
                if missing.is_empty() {
                    break;
                }
                let round = self.crew.machine.threads * self.crew.machine.batch;
                missing
                    .truncate(missing.len() - missing.len() * (shard.number() - 1) / shard.count());
                let help = missing.split_off(missing.len().saturating_sub(round));
                if self.play(&help, &played)? == Ended::Stopped {
                    return Ok(Ended::Stopped);
                }
            }
        }
        Ok(Ended::Done)
    }

    fn missing(&self, book: &Book, stage: usize) -> Vec<Missing> {
        let of_stage = |planned: &Planned| self.plan.arms[planned.arm].stage == stage;
        let all = self.plan.episodes().enumerate();
        all.filter(|(place, planned)| of_stage(planned) && !book.is_done(*place)).collect()
    }

    fn play(&mut self, missing: &[Missing], played: &Played) -> Result<Ended, ExperimentError> {
        if !(self.crew.goes_on)() {
            return Ok(Ended::Stopped);
        }
        if missing.is_empty() {
            return Ok(Ended::Done);
        }
        let ledger = match &mut self.ledger {
            Some(ledger) => ledger,
            none => none.insert(Ledger::new(self.folder)?),
        };
        let lists = match lists(self.plan, self.crew.scene, missing, played) {
            Err(ExperimentError::Stopped) => return Ok(Ended::Stopped),
            lists => lists?,
        };
        let Crew { machine, scene, goes_on, watcher, on_episode } = *self.crew;
        let jobs: Vec<Job<'_>> = lists
            .iter()
            .map(|list| Job {
                plan: RolloutPlan {
                    projections: &list.projections,
                    channels: list.channels,
                    ..scene.rollout(list.arm)
                },
                specs: &list.specs,
            })
            .collect();
        let failure: Mutex<Option<FileError>> = Mutex::new(None);
        rollout::play_jobs(machine, &jobs, watcher, goes_on, &|job, index, episode| {
            let list = &lists[job];
            let keep_steps = list.channels != Channels::Counts;
            match ledger.enter(list.keys[index], &episode, keep_steps) {
                Ok(()) => {
                    on_episode();
                    ControlFlow::Continue(())
                }
                Err(error) => {
                    if let Ok(mut failure) = failure.lock() {
                        failure.get_or_insert(error);
                    }
                    ControlFlow::Break(())
                }
            }
        })?;
        match failure.into_inner() {
            Ok(Some(error)) => Err(error.into()),
            _ if goes_on() => Ok(Ended::Done),
            _ => Ok(Ended::Stopped),
        }
    }
}

/// Episodes that one rollout plan serves: of one task and policy, in any number of projections.
struct List<'a> {
    arm: &'a Arm,
    channels: Channels,
    projections: Vec<Subspace>,
    specs: Vec<EpisodeSpec>,
    keys: Vec<u128>,
}

fn lists<'a>(
    plan: &'a Plan,
    scene: &dyn Scene,
    missing: &[Missing],
    played: &Played,
) -> Result<Vec<List<'a>>, ExperimentError> {
    let mut places: Vec<usize> = missing.iter().map(|(_, planned)| planned.arm).collect();
    places.dedup();
    let projections = scene.projections(&places, played)?;
    let arm_keys = plan.arm_keys();
    let mut lists: Vec<List<'a>> = Vec::new();
    // By arm: its list, and its projection there.
    let mut seats: BTreeMap<usize, (usize, Option<usize>)> = BTreeMap::new();
    for (place, projection) in places.into_iter().zip(projections) {
        let arm = &plan.arms[place];
        let serves = |list: &List<'_>| {
            (&list.arm.task, list.arm.policy, list.channels)
                == (&arm.task, arm.policy, arm.channels)
        };
        let seat = lists.iter().position(serves).unwrap_or_else(|| {
            let (projections, specs, keys) = Default::default();
            lists.push(List { arm, channels: arm.channels, projections, specs, keys });
            lists.len() - 1
        });
        let list = &mut lists[seat];
        seats.insert(place, (seat, projection.as_ref().map(|_| list.projections.len())));
        list.projections.extend(projection);
    }
    for (_, planned) in missing {
        let (seat, projection) = seats[&planned.arm];
        let list = &mut lists[seat];
        list.specs.push(plan.spec(&plan.arms[planned.arm], planned.number, projection));
        list.keys.push(arm_keys[planned.arm].episode(planned.number));
    }
    Ok(lists)
}

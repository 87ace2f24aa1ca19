//! How far a sweep is: counted from its plan and its ledgers, without policy or physics, on any machine that sees the
//! folder, while others work on it or not.

use std::path::Path;

use serde::Serialize;

use super::ExperimentError;
use super::book::{Book, Depth};
use super::gather::SweepError;
use super::plan::{Plan, Shard};

/// The rate is that of the last ten minutes.
const WINDOW: u64 = 600;
/// Nothing for that long, and nobody seems to be at work, s.
const SILENCE: u64 = 300;

/// Some of the episodes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Default)]
pub struct Share {
    pub planned: usize,
    pub done: usize,
}

/// The episodes of one task in one stage.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct TaskShare {
    /// From 1 on.
    pub stage: usize,
    pub task: String,
    pub planned: usize,
    pub done: usize,
}

/// How far a sweep is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Status {
    pub planned: usize,
    pub done: usize,
    pub missing: usize,
    /// Entries that are not whole; their episodes will be played again.
    pub failed: usize,
    /// Episodes that were played more than once.
    pub twice: usize,
    /// Those of them that did not come out alike: the machines compute differently.
    pub different: usize,
    /// Ledgers, one for every process that worked on it.
    pub ledgers: usize,
    pub tasks: Vec<TaskShare>,
    /// Shards, as far as their number is known.
    pub shards: Vec<Share>,
    /// Episodes per second.
    pub rate: Option<f64>,
    /// Until everything is played at that rate.
    pub seconds_left: Option<f64>,
    /// Since the last episode ended.
    pub seconds_since_last: Option<u64>,
}

impl Status {
    /// The state of the sweep in `folder`, cut into `shards` (0: not cut), at the time `now`, in seconds since 1970.
    pub fn read(folder: &Path, shards: usize, now: u64) -> Result<Self, ExperimentError> {
        let plan = Plan::read(folder).map_err(SweepError::Plan)?;
        let book = Book::read(&plan, folder, Depth::Lines)?;
        Ok(Self::of(&plan, &book, shards, now))
    }

    fn of(plan: &Plan, book: &Book, shards: usize, now: u64) -> Self {
        let mut tasks: Vec<TaskShare> = Vec::new();
        let mut row_of_arm = Vec::with_capacity(plan.arms.len());
        for arm in &plan.arms {
            let is_row = |row: &TaskShare| row.stage == arm.stage + 1 && row.task == arm.task;
            let row = tasks.iter().rposition(is_row).unwrap_or_else(|| {
                let (stage, task) = (arm.stage + 1, arm.task.clone());
                tasks.push(TaskShare { stage, task, planned: 0, done: 0 });
                tasks.len() - 1
            });
            row_of_arm.push(row);
        }
        let cut: Vec<Shard> =
            (1..=shards).filter_map(|number| Shard::new(number, shards)).collect();
        let mut of_shard = vec![Share::default(); cut.len()];
        for (place, planned) in plan.episodes().enumerate() {
            let done = usize::from(book.is_done(place));
            let row = &mut tasks[row_of_arm[planned.arm]];
            row.planned += 1;
            row.done += done;
            if let Some(shard) = planned.shard_of(shards) {
                of_shard[shard].planned += 1;
                of_shard[shard].done += done;
            }
        }
        let planned = plan.episode_count();
        let done: usize = tasks.iter().map(|row| row.done).sum();
        let newest = book.times.iter().copied().max();
        let silent = newest.is_none_or(|newest| now.saturating_sub(newest) > SILENCE);
        let rate = if silent { None } else { rate(&book.times, now) };
        let missing = planned - done;
        Self {
            planned,
            done,
            missing,
            failed: book.damaged,
            twice: book.twice,
            different: book.different,
            ledgers: book.ledger_count(),
            tasks,
            shards: of_shard,
            rate,
            seconds_left: rate.map(|rate| missing as f64 / rate),
            seconds_since_last: newest.map(|newest| now.saturating_sub(newest)),
        }
    }
}

/// Episodes per second in the last minutes before `now`; undefined for a single moment.
fn rate(times: &[u64], now: u64) -> Option<f64> {
    let recent = || times.iter().copied().filter(|&time| time + WINDOW >= now);
    let oldest = recent().min()?;
    let seconds = now.saturating_sub(oldest);
    (seconds > 0).then(|| recent().count() as f64 / seconds as f64)
}

#[cfg(test)]
mod tests {
    use super::super::ledger::Ledger;
    use super::super::ledger::tests::episode;
    use super::super::plan::tests::plan;
    use super::*;

    #[test]
    fn what_is_done_is_counted_by_stage_task_and_shard() {
        let folder = tempfile::tempdir().unwrap();
        let plan = plan(10, 2, 20);
        plan.write(folder.path()).unwrap();
        let ledger = Ledger::new(folder.path()).unwrap();
        let keys = plan.arm_keys();
        for number in 0..10 {
            ledger.enter(keys[0].episode(number), &episode(0.0), false).unwrap();
            ledger.enter(keys[1].episode(number), &episode(0.0), false).unwrap();
        }
        let status = Status::read(folder.path(), 2, 0).unwrap();
        assert_eq!((status.planned, status.done, status.missing), (50, 20, 30));
        assert_eq!((status.failed, status.twice, status.ledgers), (0, 0, 1));
        let rows: Vec<_> = status.tasks.iter().map(|r| (r.stage, r.planned, r.done)).collect();
        assert_eq!(rows, [(1, 10, 10), (2, 40, 10)]);
        // Pieces of ten: the first, third and fifth belong to the first shard.
        let shards: Vec<_> = status.shards.iter().map(|s| (s.planned, s.done)).collect();
        assert_eq!(shards, [(30, 10), (20, 10)]);
    }

    #[test]
    fn the_rate_is_that_of_the_last_minutes() {
        let hour_ago = [0; 1000];
        let recent = [3000, 3050, 3100, 3100];
        let times = [&hour_ago[..], &recent].concat();
        assert_eq!(rate(&times, 3200), Some(4.0 / 200.0));
        assert_eq!(rate(&times, 10_000), None);
        assert_eq!(rate(&[5, 5], 5), None);
    }
}

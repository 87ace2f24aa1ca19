//! All ledgers of a sweep against its plan: which episodes are done, and what came of them.
//!
//! Ledgers are read in the order of their names. An episode that several of them hold was played twice; the first counts.
//! Both should say the same. If they do not, the machines compute differently (vector instructions are chosen at run
//! time), and [`Book::different`] says so. Lines of other plans are no concern of this one.

use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::files::{self, FileError};
use crate::sim::rollout::{Channels, Recording};

use super::ledger::{self, DATA, LEDGERS, LOG, Outcome, Steps};
use super::payload;
use super::plan::Plan;

/// How closely ledgers are looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Depth {
    /// Lines alone: enough to count.
    Lines,
    /// Also that the steps which lines point to are whole.
    Steps,
}

/// What is known of a plan's episodes.
#[derive(Debug)]
pub struct Book {
    entries: Vec<Option<Filed>>,
    logs: Vec<PathBuf>,
    /// When the episodes that count ended, in seconds since 1970; in no order.
    pub times: Vec<u64>,
    /// Lines, or steps of an episode, that are not whole.
    pub damaged: usize,
    /// Entries of other plans.
    pub strange: usize,
    /// Episodes that were played more than once.
    pub twice: usize,
    /// Those of them that did not come out alike.
    pub different: usize,
}

/// What is known of one episode.
#[derive(Debug, Clone, Copy)]
struct Filed {
    outcome: Outcome,
    steps: Option<Steps>,
    /// Place of the ledger.
    log: u32,
}

impl Book {
    /// Reads the ledgers in the folder of the sweep.
    pub fn read(plan: &Plan, folder: &Path, depth: Depth) -> Result<Self, FileError> {
        let places = Places::of(plan);
        let keeps: Vec<bool> =
            plan.arms.iter().map(|arm| arm.channels != Channels::Counts).collect();
        let mut book = Self {
            entries: vec![None; places.count],
            logs: logs(folder)?,
            times: Vec::new(),
            damaged: 0,
            strange: 0,
            twice: 0,
            different: 0,
        };
        for log in 0..book.logs.len() {
            let path = book.logs[log].clone();
            let mut data = Data::beside(&path, depth);
            ledger::for_each_line(&path, |entry| {
                let Some(entry) = entry else {
                    book.damaged += 1;
                    return;
                };
                let Some((place, arm)) = places.find(entry.key) else {
                    book.strange += 1;
                    return;
                };
                if let Some(known) = &book.entries[place] {
                    book.twice += 1;
                    book.different += usize::from(!known.outcome.is_same(&entry.outcome));
                    return;
                }
                let whole = !keeps[arm] || entry.steps.is_some_and(|steps| data.holds(&steps));
                if !whole {
                    book.damaged += 1;
                    return;
                }
                book.times.push(entry.time);
                book.entries[place] =
                    Some(Filed { outcome: entry.outcome, steps: entry.steps, log: log as u32 });
            })?;
        }
        Ok(book)
    }

    /// Whether the episode at `place` of the plan is done.
    #[must_use]
    pub fn is_done(&self, place: usize) -> bool {
        self.entries[place].is_some()
    }

    /// How many of the episodes at `places` are done.
    #[must_use]
    pub fn done_in(&self, places: Range<usize>) -> usize {
        self.entries[places].iter().flatten().count()
    }

    /// Number of ledgers.
    #[must_use]
    pub fn ledger_count(&self) -> usize {
        self.logs.len()
    }

    /// What came of the episode at `place`, with its steps if they were kept; `None` if it is not done.
    pub fn episode(&self, place: usize) -> Result<Option<(Outcome, Recording)>, FileError> {
        let Some(filed) = &self.entries[place] else { return Ok(None) };
        let Some(steps) = &filed.steps else {
            return Ok(Some((filed.outcome, Recording::default())));
        };
        let mut data = Data::beside(&self.logs[filed.log as usize], Depth::Steps);
        let recording = data.read(steps).and_then(|bytes| payload::decode(&bytes));
        Ok(recording.map(|recording| (filed.outcome, recording)))
    }
}

/// The ledgers in the folder of a sweep; none if there is no such folder yet.
fn logs(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let folder = folder.join(LEDGERS);
    if !folder.exists() {
        return Ok(Vec::new());
    }
    let mut logs = files::list(&folder)?;
    logs.retain(|path| files::has_extension(path, LOG));
    Ok(logs)
}

/// From content keys to places in the plan.
struct Places {
    /// Sorted by key: key, place, arm.
    keys: Vec<(u128, u32, u32)>,
    count: usize,
}

impl Places {
    fn of(plan: &Plan) -> Self {
        let arms = plan.arm_keys();
        let key = |(place, planned): (usize, super::plan::Planned)| {
            (arms[planned.arm].episode(planned.number), place as u32, planned.arm as u32)
        };
        let mut keys: Vec<_> = plan.episodes().enumerate().map(key).collect();
        keys.sort_unstable();
        Self { count: keys.len(), keys }
    }

    fn find(&self, key: u128) -> Option<(usize, usize)> {
        let found = self.keys.binary_search_by_key(&key, |entry| entry.0).ok()?;
        Some((self.keys[found].1 as usize, self.keys[found].2 as usize))
    }
}

/// The file with the steps of a ledger's episodes.
struct Data {
    path: PathBuf,
    depth: Depth,
    /// Opened when the first steps are asked for.
    open: Option<(File, u64)>,
}

impl Data {
    fn beside(log: &Path, depth: Depth) -> Self {
        Self { path: log.with_extension(DATA), depth, open: None }
    }

    fn holds(&mut self, steps: &Steps) -> bool {
        self.depth == Depth::Lines || self.read(steps).is_some()
    }

    /// The bytes of `steps`, if they are whole.
    fn read(&mut self, steps: &Steps) -> Option<Vec<u8>> {
        if self.open.is_none() {
            let file = files::open(&self.path).ok()?;
            let length = file.metadata().ok()?.len();
            self.open = Some((file, length));
        }
        let (file, length) = self.open.as_mut()?;
        if steps.offset.checked_add(u64::from(steps.length))? > *length {
            return None;
        }
        file.seek(SeekFrom::Start(steps.offset)).ok()?;
        let mut bytes = vec![0; steps.length as usize];
        file.read_exact(&mut bytes).ok()?;
        steps.are(&bytes).then_some(bytes)
    }
}

#[cfg(test)]
mod tests {
    use super::super::ledger::Ledger;
    use super::super::ledger::tests::episode;
    use super::super::plan::tests::plan;
    use super::*;

    #[test]
    fn the_first_entry_counts_and_another_one_is_noticed() {
        let folder = tempfile::tempdir().unwrap();
        let plan = plan(2, 1, 2);
        let key = |arm: usize, number| plan.arm_keys()[arm].episode(number);
        let (one, two) = (Ledger::new(folder.path()).unwrap(), Ledger::new(folder.path()).unwrap());
        one.enter(key(1, 1), &episode(0.5), false).unwrap();
        two.enter(key(1, 1), &episode(0.5), false).unwrap();
        two.enter(key(0, 0), &episode(1.5), false).unwrap();
        one.enter(key(0, 0), &episode(2.5), false).unwrap();
        one.enter(42, &episode(0.0), false).unwrap();
        let book = Book::read(&plan, folder.path(), Depth::Steps).unwrap();
        assert_eq!((book.twice, book.different, book.strange, book.damaged), (2, 1, 1, 0));
        assert_eq!((book.done_in(0..2), book.done_in(2..4), book.times.len()), (1, 1, 2));
        assert!(book.is_done(3) && !book.is_done(2));
        let (outcome, _) = book.episode(0).unwrap().unwrap();
        assert_eq!(outcome.reward.to_bits(), 2.5_f64.to_bits());
    }

    #[test]
    fn an_episode_whose_steps_are_spoiled_or_gone_was_not_played() {
        let folder = tempfile::tempdir().unwrap();
        let mut plan = plan(2, 0, 0);
        plan.arms[0].channels = Channels::ActionMeans;
        let ledger = Ledger::new(folder.path()).unwrap();
        for number in 0..2 {
            ledger.enter(plan.arm_keys()[0].episode(number), &episode(0.5), true).unwrap();
        }
        let read = |depth| Book::read(&plan, folder.path(), depth).unwrap();
        let data = folder.path().join("ledger/00001.data");
        let mut bytes = std::fs::read(&data).unwrap();
        assert_eq!(read(Depth::Steps).episode(1).unwrap().unwrap().1, episode(0.5).recording);
        *bytes.last_mut().unwrap() ^= 1;
        files::write_atomic(&data, &bytes).unwrap();
        let book = read(Depth::Steps);
        assert_eq!((book.done_in(0..2), book.damaged, book.is_done(0)), (1, 1, true));
        assert_eq!(read(Depth::Lines).done_in(0..2), 2);
        files::remove(&data).unwrap();
        assert_eq!(read(Depth::Steps).done_in(0..2), 0);
    }
}

//! The ledger: what came of every episode, one line each, appended and never changed.
//!
//! Every process that works on a sweep has a file of its own, so nobody writes into another's:
//! `ledger/00001.log`, one line per finished episode, and `ledger/00001.data`, the steps of those that keep any.
//!
//! ```text
//! check key steps solved_steps reward terminated diverged_steps time offset length check_of_data
//! ```
//!
//! `key` is the content key of the episode, `reward` the bits of the number, `time` seconds since 1970 (for rates; no
//! result depends on it), `offset` and `length` say where in the `.data` file the steps lie. `check` is a hash of the rest
//! of the line. A line counts when its check does, so that half a line, or one that a disk spoiled, is an episode that was
//! not played.
//!
//! A line is handed to the system when its episode ends: `kill -9` loses the episodes in play, no more. Against the loss
//! of power the files are synced every few seconds.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant, SystemTime, UNIX_EPOCH};

use crate::files::{self, FileError};
use crate::sim::rollout::Episode;

use super::payload;

/// Folder of the ledgers in that of a sweep.
pub const LEDGERS: &str = "ledger";
/// How names of ledgers end.
pub const LOG: &str = "log";
/// How names of the files with the steps end.
pub const DATA: &str = "data";
/// No line is longer.
const LONGEST_LINE: usize = 256;
/// Longest time between an episode and its being safe from the loss of power.
const SYNC_INTERVAL: Duration = Duration::from_secs(5);

/// What came of an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Outcome {
    pub steps: u32,
    pub solved_steps: u32,
    pub reward: f64,
    pub terminated: bool,
    pub diverged_steps: u32,
}

/// Where the steps of an episode lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Steps {
    pub offset: u64,
    pub length: u32,
    check: u64,
}

/// A line.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Entry {
    /// Content key of the episode.
    pub key: u128,
    pub outcome: Outcome,
    /// When it ended, in seconds since 1970.
    pub time: u64,
    pub steps: Option<Steps>,
}

/// The ledger of this process.
#[derive(Debug)]
pub struct Ledger {
    path: PathBuf,
    open: Mutex<Open>,
}

#[derive(Debug)]
struct Open {
    log: File,
    /// Made when the first episode has steps to keep.
    data: Option<File>,
    data_length: u64,
    synced: Instant,
}

impl Ledger {
    /// A new ledger for the sweep in `folder`.
    pub fn new(folder: &Path) -> Result<Self, FileError> {
        let (path, log) = files::new_numbered(&folder.join(LEDGERS), LOG)?;
        let open = Open { log, data: None, data_length: 0, synced: Instant::now() };
        Ok(Self { path, open: Mutex::new(open) })
    }

    /// Enters `episode` under its content key, with its steps if `keep_steps`. After an error nothing more may be entered:
    /// what would come next would join half a line.
    pub fn enter(&self, key: u128, episode: &Episode, keep_steps: bool) -> Result<(), FileError> {
        let bytes = keep_steps.then(|| payload::encode(&episode.recording));
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        let steps = bytes.map(|bytes| self.keep(&mut open, &bytes)).transpose()?;
        let time = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
        let line = Entry { key, outcome: Outcome::of(episode), time, steps }.line();
        open.log.write_all(line.as_bytes()).map_err(|source| self.failed(LOG, source))?;
        if open.synced.elapsed() >= SYNC_INTERVAL {
            self.sync_files(&mut open)?;
        }
        Ok(())
    }

    /// Makes everything safe from the loss of power.
    pub fn sync(&self) -> Result<(), FileError> {
        self.sync_files(&mut self.open.lock().unwrap_or_else(PoisonError::into_inner))
    }

    fn sync_files(&self, open: &mut Open) -> Result<(), FileError> {
        // Steps first: a line must not promise what is lost.
        if let Some(data) = &open.data {
            data.sync_data().map_err(|source| self.failed(DATA, source))?;
        }
        open.log.sync_data().map_err(|source| self.failed(LOG, source))?;
        open.synced = Instant::now();
        Ok(())
    }

    fn keep(&self, open: &mut Open, bytes: &[u8]) -> Result<Steps, FileError> {
        let failed = |source| self.failed(DATA, source);
        let data = match &mut open.data {
            Some(data) => data,
            none => none.insert(files::open_to_append(&self.path.with_extension(DATA))?),
        };
        data.write_all(bytes).map_err(failed)?;
        let offset = open.data_length;
        open.data_length += bytes.len() as u64;
        Ok(Steps { offset, length: bytes.len() as u32, check: short_hash(bytes) })
    }

    fn failed(&self, extension: &str, source: std::io::Error) -> FileError {
        FileError::Write { path: self.path.with_extension(extension), source }
    }
}

impl Outcome {
    fn of(episode: &Episode) -> Self {
        Self {
            steps: episode.steps as u32,
            solved_steps: episode.solved_steps as u32,
            reward: episode.reward,
            terminated: episode.terminated,
            diverged_steps: episode.diverged_steps as u32,
        }
    }

    /// Whether both are the same, to the bit.
    #[must_use]
    pub fn is_same(&self, other: &Self) -> bool {
        self.reward.to_bits() == other.reward.to_bits()
            && Self { reward: 0.0, ..*self } == Self { reward: 0.0, ..*other }
    }
}

impl Steps {
    /// Whether `bytes` are those that were entered.
    #[must_use]
    pub fn are(&self, bytes: &[u8]) -> bool {
        bytes.len() as u64 == u64::from(self.length) && short_hash(bytes) == self.check
    }
}

impl Entry {
    /// The line of this entry, with its end.
    #[must_use]
    pub fn line(&self) -> String {
        let Outcome { steps, solved_steps, reward, terminated, diverged_steps } = self.outcome;
        let place = match self.steps {
            None => "- - -".to_owned(),
            Some(Steps { offset, length, check }) => format!("{offset} {length} {check:016x}"),
        };
        let rest = format!(
            "{:032x} {steps} {solved_steps} {:016x} {} {diverged_steps} {} {place}",
            self.key,
            reward.to_bits(),
            u8::from(terminated),
            self.time,
        );
        format!("{:016x} {rest}\n", short_hash(rest.as_bytes()))
    }

    /// The entry in a line without its end, if it is whole.
    #[must_use]
    pub fn read(line: &[u8]) -> Option<Self> {
        let line = std::str::from_utf8(line).ok()?;
        let (check, rest) = line.split_once(' ')?;
        if hexadecimal::<16>(check)? != u128::from(short_hash(rest.as_bytes())) {
            return None;
        }
        let mut words = rest.split(' ');
        let mut word = || words.next();
        let key = hexadecimal::<32>(word()?)?;
        let outcome = Outcome {
            steps: word()?.parse().ok()?,
            solved_steps: word()?.parse().ok()?,
            reward: f64::from_bits(hexadecimal::<16>(word()?)? as u64),
            terminated: word()? == "1",
            diverged_steps: word()?.parse().ok()?,
        };
        let time = word()?.parse().ok()?;
        let steps = match [word()?, word()?, word()?] {
            ["-", "-", "-"] => None,
            [offset, length, check] => Some(Steps {
                offset: offset.parse().ok()?,
                length: length.parse().ok()?,
                check: hexadecimal::<16>(check)? as u64,
            }),
        };
        words.next().is_none().then_some(Self { key, outcome, time, steps })
    }
}

/// Reads the ledger at `path` line by line: the entry, or nothing for a line that is not whole.
pub fn for_each_line(path: &Path, mut take: impl FnMut(Option<Entry>)) -> Result<(), FileError> {
    let mut begun = Vec::with_capacity(LONGEST_LINE);
    let add = |begun: &mut Vec<u8>, bytes: &[u8]| {
        // One byte too many says that the line is too long; the rest of it need not be kept.
        let room = LONGEST_LINE + 1 - begun.len();
        begun.extend_from_slice(&bytes[..bytes.len().min(room)]);
    };
    files::for_each_piece(path, |piece| {
        let mut lines = piece.split(|&byte| byte == b'\n');
        let last = lines.next_back().unwrap_or_default();
        for line in lines {
            if begun.is_empty() {
                take(Entry::read(line));
            } else {
                add(&mut begun, line);
                take(Entry::read(&begun));
                begun.clear();
            }
        }
        add(&mut begun, last);
    })?;
    if !begun.is_empty() {
        take(None);
    }
    Ok(())
}

/// The number of exactly `DIGITS` lower-case hexadecimal digits.
fn hexadecimal<const DIGITS: usize>(text: &str) -> Option<u128> {
    let digit = |byte: u8| matches!(byte, b'0'..=b'9' | b'a'..=b'f');
    let whole = text.len() == DIGITS && text.bytes().all(digit);
    whole.then(|| u128::from_str_radix(text, 16).ok()).flatten()
}

/// The first eight bytes of a hash.
fn short_hash(bytes: &[u8]) -> u64 {
    let hash = blake3::hash(bytes);
    let mut short = [0; 8];
    short.copy_from_slice(&hash.as_bytes()[..8]);
    u64::from_be_bytes(short)
}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::experiment::seed;
    use crate::sim::rollout::Recording;

    pub(crate) fn episode(reward: f64) -> Episode {
        Episode {
            spec: seed::episode(0, "elbow_pose", 3, None),
            steps: 100,
            solved_steps: 17,
            reward,
            terminated: true,
            diverged_steps: 1,
            recording: Recording { action_mean: vec![0.5; 4], ..Recording::default() },
        }
    }

    fn read(path: &Path) -> Vec<Option<Entry>> {
        let mut found = Vec::new();
        for_each_line(path, |entry| found.push(entry)).unwrap();
        found
    }

    #[test]
    fn what_was_entered_is_read_and_every_process_has_its_own_file() {
        let folder = tempfile::tempdir().unwrap();
        let (one, two) = (Ledger::new(folder.path()).unwrap(), Ledger::new(folder.path()).unwrap());
        one.enter(1, &episode(-0.0), false).unwrap();
        one.enter(2, &episode(f64::NAN), true).unwrap();
        two.enter(3, &episode(0.1), false).unwrap();
        one.sync().unwrap();
        let found = read(&one.path);
        assert_eq!(found.len(), 2);
        let [first, second] = [found[0].unwrap(), found[1].unwrap()];
        assert_eq!((first.key, first.steps), (1, None));
        assert!(first.outcome.is_same(&Outcome::of(&episode(-0.0))));
        assert!(!first.outcome.is_same(&Outcome::of(&episode(0.0))));
        assert!(second.outcome.is_same(&Outcome::of(&episode(f64::NAN))));
        let data = std::fs::read(one.path.with_extension(DATA)).unwrap();
        assert!(second.steps.unwrap().are(&data));
        assert_eq!(payload::decode(&data), Some(episode(0.0).recording));
        assert_eq!(read(&two.path)[0].unwrap().key, 3);
    }

    #[test]
    fn half_a_line_and_an_endless_one_are_no_entries_and_spoil_no_other() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.log");
        let entry = Entry { key: 7, outcome: Outcome::of(&episode(1.5)), time: 9, steps: None };
        let whole = entry.line();
        let text = format!("{}\n{whole}{}\n{whole}{}", "x".repeat(200_000), "y", &whole[..50]);
        files::write_atomic(&path, text.as_bytes()).unwrap();
        assert_eq!(read(&path), [None, Some(entry), None, Some(entry), None]);
    }

    proptest! {
        #[test]
        fn a_line_with_one_other_byte_is_no_entry(place in 0..120_usize, byte in 0..=255_u8) {
            let steps = Some(Steps { offset: 12_345, length: 678, check: 9 });
            let entry = Entry { key: 7 << 100, outcome: Outcome::of(&episode(1.5)), time: 9, steps };
            let mut line = entry.line().trim_end().as_bytes().to_vec();
            prop_assert_eq!(Entry::read(&line), Some(entry));
            let place = place % line.len();
            prop_assume!(line[place] != byte);
            line[place] = byte;
            prop_assert_eq!(Entry::read(&line), None);
        }

        #[test]
        fn any_bytes_are_survived(bytes in prop::collection::vec(0..=255_u8, 0..300)) {
            let _none_or_some = Entry::read(&bytes);
            let _none_or_some = payload::decode(&bytes);
        }
    }
}

//! Scalars of `TensorBoard` event files.
//!
//! A file is a row of records: length (u64, little-endian), masked CRC-32C of the length, payload, masked CRC-32C of the
//! payload. A payload is an `Event` message: 1 wall time, 2 step, 5 summary; a summary has values: 1 tag, 2 simple value
//! or 8 tensor. Tensors count if they hold one float or double. Everything else is skipped.
//!
//! Every point is read: nothing is thinned. A process that was killed leaves a record cut short; reading ends there, the
//! points before it stay, and the place and reason are returned ([`Damage`]). A damaged record in the middle ends the
//! file in the same way, because nothing tells where the next one starts.
//!
//! Limits: a file of at most 2 GiB and 100,000 tags. Memory is a small multiple of what the file holds.
//! Oracle: `tests/subspaces_parity.rs`, algorithm `tfevents`.

use std::collections::HashMap;
use std::fmt;
use std::path::{Path, PathBuf};

use super::RecordError;
use super::crc32c::masked_crc32c;
use super::protobuf::{Fields, Malformed, Value};
use crate::files;

/// No event file may be larger than this.
const LARGEST_FILE: u64 = 2 << 30;
/// No file may have more tags than this.
const MOST_TAGS: usize = 100_000;
/// Folders below a run in which its event files lie.
const FOLDERS: [&str; 6] = [".", "PPO_0", "tb", "logs", "tensorboard", "rl_finetune"];
/// How the names of event files start.
const PREFIX: &str = "events.out.tfevents.";

/// One logged value.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ScalarPoint {
    /// Environment steps.
    pub step: i64,
    /// Seconds since 1970.
    pub wall_time: f64,
    pub value: f64,
}

/// All values logged under one tag.
#[derive(Debug, Clone, PartialEq)]
pub struct ScalarSeries {
    pub tag: String,
    pub points: Vec<ScalarPoint>,
}

/// Where and why reading ended before the end of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Damage {
    /// Byte at which the unreadable record starts.
    pub offset: usize,
    pub reason: DamageReason,
}

/// Why a record cannot be read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DamageReason {
    CutShort,
    LengthChecksum,
    PayloadChecksum,
    Message,
    TooManyTags,
}

impl fmt::Display for Damage {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let reason = match self.reason {
            DamageReason::CutShort => "is cut short",
            DamageReason::LengthChecksum => "has a length with a wrong checksum",
            DamageReason::PayloadChecksum => "has a wrong checksum",
            DamageReason::Message => "is not an event",
            DamageReason::TooManyTags => "names more tags than any training logs",
        };
        write!(f, "the record at byte {} {reason}", self.offset)
    }
}

/// The scalars of one file or of several joined.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct EventScalars {
    /// In the order in which tags first appear.
    pub series: Vec<ScalarSeries>,
    /// Damaged files; their readable part is in `series`.
    pub damaged: Vec<(PathBuf, Damage)>,
}

impl EventScalars {
    /// The series of `tag`.
    #[must_use]
    pub fn series(&self, tag: &str) -> Option<&ScalarSeries> {
        self.series.iter().find(|series| series.tag == tag)
    }

    /// The series of the solved fraction: the first tag ending in `/solved`, else the first containing `solved`.
    #[must_use]
    pub fn solved(&self) -> Option<&ScalarSeries> {
        let ends = |series: &&ScalarSeries| series.tag.ends_with("/solved");
        let contains = |series: &&ScalarSeries| series.tag.contains("solved");
        self.series.iter().find(ends).or_else(|| self.series.iter().find(contains))
    }
}

/// Reads the scalars of one event file.
pub fn read_event_file(path: &Path) -> Result<EventScalars, RecordError> {
    read_event_files(&[path.to_path_buf()])
}

/// Reads all event files of a training run, in its folder and the usual folders below, joined and sorted by step.
pub fn read_event_run(folder: &Path) -> Result<EventScalars, RecordError> {
    let mut paths = Vec::new();
    for below in FOLDERS {
        let folder = if below == "." { folder.to_path_buf() } else { folder.join(below) };
        if !folder.is_dir() {
            continue;
        }
        let found = super::result_files::files_in(&folder, |name| name.starts_with(PREFIX))?;
        paths.extend(found);
    }
    if paths.is_empty() {
        return Err(RecordError::NoFiles {
            what: format!("`{PREFIX}*`"),
            path: folder.to_path_buf(),
        });
    }
    read_event_files(&paths)
}

/// Reads several event files of one run and sorts each series by step; points of equal step keep the order of the files.
pub fn read_event_files(paths: &[PathBuf]) -> Result<EventScalars, RecordError> {
    let mut scalars = EventScalars::default();
    let mut places = HashMap::new();
    for path in paths {
        let bytes = files::read_bounded(path, LARGEST_FILE)?;
        if let Some(damage) = read_into(&mut scalars.series, &mut places, &bytes) {
            scalars.damaged.push((path.clone(), damage));
        }
    }
    for series in &mut scalars.series {
        series.points.sort_by_key(|point| point.step);
    }
    Ok(scalars)
}

/// Adds the scalars in `bytes` to `series`; `places` finds a tag's series.
fn read_into(
    series: &mut Vec<ScalarSeries>,
    places: &mut HashMap<String, usize>,
    bytes: &[u8],
) -> Option<Damage> {
    let mut rest = bytes;
    while !rest.is_empty() {
        let offset = bytes.len() - rest.len();
        let record = split_record(rest).and_then(|(payload, after)| {
            read_event(payload, &mut |tag, point| {
                let place = match places.get(tag) {
                    Some(&place) => place,
                    None if series.len() < MOST_TAGS => {
                        places.insert(tag.to_owned(), series.len());
                        series.push(ScalarSeries { tag: tag.to_owned(), points: Vec::new() });
                        series.len() - 1
                    }
                    None => return Err(DamageReason::TooManyTags),
                };
                series[place].points.push(point);
                Ok(())
            })?;
            Ok(after)
        });
        match record {
            Ok(after) => rest = after,
            Err(reason) => return Some(Damage { offset, reason }),
        }
    }
    None
}

/// The payload of the first record and what comes after it.
fn split_record(bytes: &[u8]) -> Result<(&[u8], &[u8]), DamageReason> {
    let cut_short = DamageReason::CutShort;
    let (length, rest) = bytes.split_first_chunk::<8>().ok_or(cut_short)?;
    let (length_sum, rest) = rest.split_first_chunk::<4>().ok_or(cut_short)?;
    if masked_crc32c(length) != u32::from_le_bytes(*length_sum) {
        return Err(DamageReason::LengthChecksum);
    }
    let length = usize::try_from(u64::from_le_bytes(*length)).map_err(|_| cut_short)?;
    let (payload, rest) = rest.split_at_checked(length).ok_or(cut_short)?;
    let (payload_sum, rest) = rest.split_first_chunk::<4>().ok_or(cut_short)?;
    if masked_crc32c(payload) != u32::from_le_bytes(*payload_sum) {
        return Err(DamageReason::PayloadChecksum);
    }
    Ok((payload, rest))
}

/// Bytes of an event file up to its first event after `step`, or to the first that cannot be read.
pub(super) fn length_up_to(bytes: &[u8], step: i64) -> usize {
    let mut rest = bytes;
    while let Ok((payload, after)) = split_record(rest) {
        let is_later = |field| matches!(field, Ok((2, Value::Varint(at))) if at as i64 > step);
        if Fields(payload).any(is_later) {
            break;
        }
        rest = after;
    }
    bytes.len() - rest.len()
}

/// Hands every scalar of an event to `sink`.
fn read_event(
    payload: &[u8],
    sink: &mut dyn FnMut(&str, ScalarPoint) -> Result<(), DamageReason>,
) -> Result<(), DamageReason> {
    let bad = |_: Malformed| DamageReason::Message;
    let (mut step, mut wall_time) = (0, 0.0);
    // Fields may come in any order, the step after the summary too.
    for field in Fields(payload) {
        match field.map_err(bad)? {
            (1, Value::Fixed64(bytes)) => wall_time = f64::from_le_bytes(bytes),
            (2, Value::Varint(value)) => step = value as i64,
            _ => {}
        }
    }
    for field in Fields(payload) {
        let (5, Value::Bytes(summary)) = field.map_err(bad)? else { continue };
        for field in Fields(summary) {
            let (1, Value::Bytes(value)) = field.map_err(bad)? else { continue };
            if let Some((tag, value)) = read_value(value).map_err(bad)? {
                sink(tag, ScalarPoint { step, wall_time, value })?;
            }
        }
    }
    Ok(())
}

/// Tag and value of a summary value, if it is a scalar.
fn read_value(message: &[u8]) -> Result<Option<(&str, f64)>, Malformed> {
    let (mut tag, mut scalar) = (None, None);
    for field in Fields(message) {
        match field? {
            (1, Value::Bytes(text)) => {
                tag = Some(std::str::from_utf8(text).map_err(|_| Malformed)?);
            }
            (2, Value::Fixed32(bytes)) => scalar = Some(f64::from(f32::from_le_bytes(bytes))),
            (8, Value::Bytes(tensor)) => scalar = read_tensor(tensor)?,
            _ => {}
        }
    }
    Ok(tag.zip(scalar))
}

/// The value of a tensor that holds one float (type 1) or double (type 2), in either of its two forms.
fn read_tensor(message: &[u8]) -> Result<Option<f64>, Malformed> {
    let mut kind = 0;
    let (mut float, mut double, mut content) = (None, None, None);
    for field in Fields(message) {
        match field? {
            (1, Value::Varint(value)) => kind = value,
            (4, Value::Bytes(bytes)) => content = Some(bytes),
            (5, Value::Bytes(bytes)) => float = bytes.try_into().ok(),
            (5, Value::Fixed32(bytes)) => float = Some(bytes),
            (6, Value::Bytes(bytes)) => double = bytes.try_into().ok(),
            (6, Value::Fixed64(bytes)) => double = Some(bytes),
            _ => {}
        }
    }
    let content = content.filter(|bytes: &&[u8]| !bytes.is_empty());
    Ok(match kind {
        1 => float
            .or_else(|| content?.try_into().ok())
            .map(|bytes| f64::from(f32::from_le_bytes(bytes))),
        2 => double.or_else(|| content?.try_into().ok()).map(f64::from_le_bytes),
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn bytes_field(field: u8, content: &[u8]) -> Vec<u8> {
        [&[field << 3 | 2, content.len() as u8][..], content].concat()
    }

    fn record(payload: &[u8]) -> Vec<u8> {
        let length = (payload.len() as u64).to_le_bytes();
        let sum = |bytes: &[u8]| masked_crc32c(bytes).to_le_bytes();
        [&length[..], &sum(&length), payload, &sum(payload)].concat()
    }

    fn event(step: u8, value: &[u8]) -> Vec<u8> {
        let summary = bytes_field(5, &bytes_field(1, value));
        // The step after the summary, as some writers do.
        record(&[&summary[..], &[0x10, step]].concat())
    }

    fn simple(tag: &str, value: f32) -> Vec<u8> {
        [bytes_field(1, tag.as_bytes()), vec![0x15], value.to_le_bytes().to_vec()].concat()
    }

    fn read(bytes: &[u8]) -> (Vec<ScalarSeries>, Option<Damage>) {
        let mut series = Vec::new();
        let damage = read_into(&mut series, &mut HashMap::new(), bytes);
        (series, damage)
    }

    #[test]
    fn all_forms_of_a_scalar_are_read() {
        let tensor = |kind: u8, content: Vec<u8>| {
            let tensor = [vec![0x08, kind], content].concat();
            [bytes_field(1, b"t"), bytes_field(8, &tensor)].concat()
        };
        let float = 0.5_f32.to_le_bytes();
        let double = 0.25_f64.to_le_bytes();
        let file = [
            event(1, &simple("a/solved", 0.75)),
            event(2, &tensor(1, bytes_field(5, &float))),
            event(3, &tensor(1, bytes_field(4, &float))),
            event(4, &tensor(2, bytes_field(6, &double))),
            event(5, &tensor(2, bytes_field(4, &double))),
            event(6, &tensor(7, bytes_field(4, b"text"))),
            event(7, &tensor(1, bytes_field(5, &[float, float].concat()))),
            record(&bytes_field(3, b"brain.Event:2")),
        ]
        .concat();
        let (series, damage) = read(&file);
        assert_eq!(damage, None);
        let values = |index: usize| -> Vec<(i64, f64)> {
            series[index].points.iter().map(|point| (point.step, point.value)).collect()
        };
        assert_eq!(values(0), [(1, 0.75)]);
        assert_eq!(values(1), [(2, 0.5), (3, 0.5), (4, 0.25), (5, 0.25)]);
    }

    #[test]
    fn a_cut_tail_keeps_what_came_before_and_is_named() {
        let first = event(1, &simple("a", 1.0));
        let file = [first.clone(), event(2, &simple("a", 2.0))].concat();
        for end in first.len() + 1..file.len() {
            let (series, damage) = read(&file[..end]);
            assert_eq!(series[0].points.len(), 1);
            let offset = first.len();
            assert_eq!(damage, Some(Damage { offset, reason: DamageReason::CutShort }));
        }
    }

    #[test]
    fn wrong_sums_and_lengths_are_named() {
        let good = event(1, &simple("a", 1.0));
        let reason = |at: usize| {
            let mut bad = good.clone();
            bad[at] ^= 1;
            read(&bad).1.unwrap().reason
        };
        assert_eq!(reason(0), DamageReason::LengthChecksum);
        assert_eq!(reason(12), DamageReason::PayloadChecksum);
        let endless = u64::MAX.to_le_bytes();
        let file = [&endless[..], &masked_crc32c(&endless).to_le_bytes()].concat();
        assert_eq!(read(&file).1.unwrap().reason, DamageReason::CutShort);
        assert_eq!(read(&record(&[0x0B])).1.unwrap().reason, DamageReason::Message);
    }

    #[test]
    fn the_solved_tag_is_found_by_its_ending_first() {
        let of = |tags: &[&str]| {
            let series = tags
                .iter()
                .map(|tag| ScalarSeries { tag: (*tag).to_owned(), points: Vec::new() })
                .collect();
            let scalars = EventScalars { series, damaged: Vec::new() };
            scalars.solved().map(|series| series.tag.clone())
        };
        assert_eq!(of(&["solved_frac", "pen/solved"]).as_deref(), Some("pen/solved"));
        assert_eq!(of(&["reward", "solved_frac"]).as_deref(), Some("solved_frac"));
        assert_eq!(of(&["reward"]), None);
    }

    proptest! {
        #[test]
        fn no_bytes_make_it_panic(bytes in prop::collection::vec(any::<u8>(), 0..200)) {
            read(&bytes);
            read(&record(&bytes));
        }
    }
}

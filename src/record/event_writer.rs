//! Writes scalars as `TensorBoard` event files; `events.rs` says what such a file is.
//!
//! The file grows while a run goes on, so that `TensorBoard` can follow it. A run that was killed goes on behind the last
//! record that counts: whatever was logged after its last checkpoint, or was cut short, is taken off first.

use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

use super::RecordError;
use super::crc32c::masked_crc32c;
use super::events;
use crate::files::{self, FileError};

/// No event file may be larger than this.
const LARGEST_FILE: u64 = 2 << 30;
/// What the first record of a file says.
const VERSION: &[u8] = b"brain.Event:2";

/// An event file that is being written.
#[derive(Debug)]
pub struct EventWriter {
    file: File,
    path: PathBuf,
}

impl EventWriter {
    /// Opens the file `path` behind its last event of at most `step`, or a new one. `wall_time` is in seconds since 1970.
    pub fn open(path: &Path, step: i64, wall_time: f64) -> Result<Self, RecordError> {
        let kept = match files::read_bounded(path, LARGEST_FILE) {
            Ok(bytes) => events::length_up_to(&bytes, step),
            Err(FileError::Read { source, .. })
                if source.kind() == std::io::ErrorKind::NotFound =>
            {
                0
            }
            Err(other) => return Err(other.into()),
        };
        let file = files::open_to_append(path)?;
        let mut writer = Self { file, path: path.to_path_buf() };
        writer.file.set_len(kept as u64).map_err(|source| writer.failed(source))?;
        if kept == 0 {
            let mut event = wall_time_field(wall_time);
            bytes_field(&mut event, 3, VERSION);
            writer.append(&event)?;
        }
        Ok(writer)
    }

    /// Appends the values of several tags at one step, as one event.
    pub fn write<'a>(
        &mut self,
        step: i64,
        wall_time: f64,
        scalars: impl IntoIterator<Item = (&'a str, f64)>,
    ) -> Result<(), RecordError> {
        let mut summary = Vec::new();
        for (tag, value) in scalars {
            let mut message = Vec::with_capacity(tag.len() + 8);
            bytes_field(&mut message, 1, tag.as_bytes());
            message.push(2 << 3 | 5);
            message.extend_from_slice(&(value as f32).to_le_bytes());
            bytes_field(&mut summary, 1, &message);
        }
        let mut event = wall_time_field(wall_time);
        event.push(2 << 3);
        varint(&mut event, step as u64);
        bytes_field(&mut event, 5, &summary);
        self.append(&event)
    }

    /// Makes what was written survive a power cut.
    pub fn sync(&self) -> Result<(), RecordError> {
        self.file.sync_data().map_err(|source| self.failed(source))
    }

    /// One record in one write, so that a kill leaves at most one cut short.
    fn append(&mut self, payload: &[u8]) -> Result<(), RecordError> {
        let length = (payload.len() as u64).to_le_bytes();
        let sum = |bytes: &[u8]| masked_crc32c(bytes).to_le_bytes();
        let record = [&length[..], &sum(&length), payload, &sum(payload)].concat();
        self.file.write_all(&record).map_err(|source| self.failed(source))
    }

    fn failed(&self, source: std::io::Error) -> RecordError {
        FileError::Write { path: self.path.clone(), source }.into()
    }
}

fn wall_time_field(wall_time: f64) -> Vec<u8> {
    [&[1 << 3 | 1][..], &wall_time.to_le_bytes()].concat()
}

fn bytes_field(message: &mut Vec<u8>, field: u8, content: &[u8]) {
    message.push(field << 3 | 2);
    varint(message, content.len() as u64);
    message.extend_from_slice(content);
}

fn varint(message: &mut Vec<u8>, mut value: u64) {
    while value >= 0x80 {
        message.push(value as u8 | 0x80);
        value >>= 7;
    }
    message.push(value as u8);
}

#[cfg(test)]
mod tests {
    use super::super::read_event_file;
    use super::*;

    #[test]
    fn what_is_written_is_read_back() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.out.tfevents.0.run");
        let mut writer = EventWriter::open(&path, 0, 1.5).unwrap();
        let long = "tag".repeat(100);
        writer.write(1, 2.5, [("elbow_pose/solved", 0.75), (&long, -3.0)]).unwrap();
        writer.write(1 << 40, 3.5, [("elbow_pose/solved", 0.5)]).unwrap();
        let read = read_event_file(&path).unwrap();
        assert!(read.damaged.is_empty());
        let solved = &read.series("elbow_pose/solved").unwrap().points;
        let points: Vec<_> = solved.iter().map(|p| (p.step, p.wall_time, p.value)).collect();
        assert_eq!(points, [(1, 2.5, 0.75), (1 << 40, 3.5, 0.5)]);
        assert!((read.series(&long).unwrap().points[0].value + 3.0).abs() < 1e-12);
    }

    #[test]
    fn a_run_goes_on_behind_its_last_checkpoint_even_after_a_torn_record() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("events.out.tfevents.0.run");
        let write = |steps: std::ops::RangeInclusive<i64>, from| {
            let mut writer = EventWriter::open(&path, from, 0.0).unwrap();
            steps.for_each(|step| writer.write(step, 0.0, [("a", step as f64)]).unwrap());
        };
        write(1..=6, 0);
        let undisturbed = std::fs::read(&path).unwrap();
        let torn = undisturbed.len() - 5;
        #[expect(clippy::disallowed_methods, reason = "the test tears the file")]
        std::fs::write(&path, &undisturbed[..torn]).unwrap();
        write(4..=6, 3);
        assert_eq!(std::fs::read(&path).unwrap(), undisturbed);
    }
}

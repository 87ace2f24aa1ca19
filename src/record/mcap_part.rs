//! Some episodes of an MCAP recording, without reading the others: through the index of chunks at the end of the file.
//!
//! An episode's messages lie between two times (see [`super::mcap`]), and the index says which times a chunk holds. Index
//! and chunks have checksums, which are compared. The header has only that of the whole file, which would have to be read.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::{Read, Seek, SeekFrom};
use std::ops::RangeInclusive;
use std::path::Path;

use mcap::records::{ChunkIndex, Record};

use super::RecordError;
use super::mcap::{LONGEST_RECORD, Reading, chunk, damaged, read_header, spans};
use super::mcap_chunk::crc32;
use super::recording::Recording;
use crate::files::{self, FileError};

/// Opcode and length.
const HEAD: usize = 1 + 8;
/// The last record and the letters after it: start of the summary, start of its offsets, checksum.
const FOOTER: usize = HEAD + 8 + 8 + 4;
const MAGIC: usize = 8;
/// A summary of a million chunks is shorter.
const LONGEST_SUMMARY: u64 = 1 << 28;

/// Reads the episodes with these numbers.
pub(super) fn read_episodes(path: &Path, numbers: &[u64]) -> Result<Recording, RecordError> {
    let mut header = read_header(path)?;
    let metadata = std::mem::take(&mut header.about.metadata);
    let spans: Vec<RangeInclusive<u64>> = spans(&header)
        .into_iter()
        .filter(|(number, _)| numbers.contains(number))
        .map(|(_, span)| span)
        .collect();
    header.episodes.retain(|facts| numbers.contains(&facts.number));
    let mut part = Part { file: files::open(path)?, path };
    let index = part.index()?;
    let mut reading = Reading::of_some(header);
    for (id, topic) in index.channels {
        reading.add_channel(id, &topic);
    }
    let overlaps = |chunk: &ChunkIndex| {
        let times = chunk.message_start_time..=chunk.message_end_time;
        spans.iter().any(|span| span.start() <= times.end() && times.start() <= span.end())
    };
    for one in index.chunks.into_iter().filter(overlaps) {
        let body = part.record(one.chunk_start_offset, one.chunk_length)?;
        chunk(&body, path, &mut |record| {
            if let Record::Message { header, data } = record {
                reading.take(header.channel_id, &data).map_err(|what| damaged(path, what))?;
            }
            Ok(true)
        })?;
    }
    let mut recording = reading.finish(path)?;
    recording.about.metadata = metadata;
    Ok(recording)
}

/// What of the summary is needed.
#[derive(Default)]
struct Index {
    channels: BTreeMap<u16, String>,
    /// By their place in the file, which is the order of their messages.
    chunks: Vec<ChunkIndex>,
}

struct Part<'a> {
    file: File,
    path: &'a Path,
}

impl Part<'_> {
    /// `length` bytes from `start`.
    fn bytes(&mut self, start: u64, length: u64) -> Result<Vec<u8>, RecordError> {
        let mut bytes = Vec::new();
        let read = self
            .file
            .seek(SeekFrom::Start(start))
            .and_then(|_| (&self.file).take(length).read_to_end(&mut bytes));
        read.map_err(|source| FileError::Read { path: self.path.to_path_buf(), source })?;
        if bytes.len() as u64 == length {
            Ok(bytes)
        } else {
            Err(damaged(self.path, "it ends before its index says".to_owned()))
        }
    }

    /// The record of `length` bytes at `start`, without its head.
    fn record(&mut self, start: u64, length: u64) -> Result<Vec<u8>, RecordError> {
        if length > (LONGEST_RECORD + HEAD) as u64 || length < HEAD as u64 {
            return Err(damaged(self.path, "its index names an impossible chunk".to_owned()));
        }
        let mut record = self.bytes(start, length)?;
        record.drain(..HEAD);
        Ok(record)
    }

    fn index(&mut self) -> Result<Index, RecordError> {
        let fail = |what: &str| damaged(self.path, what.to_owned());
        let cut = || fail("its index is cut off");
        let length = files::length(self.path)?;
        let end = length.checked_sub((FOOTER + MAGIC) as u64).ok_or_else(cut)?;
        let footer = self.bytes(end, FOOTER as u64)?;
        let start = footer[HEAD..].first_chunk::<8>().map_or(0, |b| u64::from_le_bytes(*b));
        if start == 0 || start > end || end - start > LONGEST_SUMMARY {
            return Err(damaged(self.path, "it has no index".to_owned()));
        }
        let summary = self.bytes(start, end - start)?;
        let claimed = footer.last_chunk::<4>().map_or(0, |bytes| u32::from_le_bytes(*bytes));
        let checked = [&summary, &footer[..FOOTER - 4]].concat();
        // 0 means that the writer took no checksum.
        if claimed != 0 && claimed != crc32(&checked) {
            return Err(damaged(self.path, "its index does not have its checksum".to_owned()));
        }
        let (mut rest, mut index) = (summary.as_slice(), Index::default());
        let fail = |what: String| damaged(self.path, what);
        while let Some((&opcode, after)) = rest.split_first() {
            let cut = || fail("its index is cut off".to_owned());
            let length = after.first_chunk::<8>().map(|bytes| u64::from_le_bytes(*bytes));
            let length = length.and_then(|length| usize::try_from(length).ok()).ok_or_else(cut)?;
            let length = length.checked_add(HEAD).ok_or_else(cut)?;
            let (record, others) = rest.split_at_checked(length).ok_or_else(cut)?;
            let record = mcap::parse_record(opcode, &record[HEAD..]);
            match record.map_err(|error| fail(error.to_string()))? {
                Record::Channel(channel) => {
                    index.channels.insert(channel.id, channel.topic);
                }
                Record::ChunkIndex(chunk) => index.chunks.push(chunk),
                _ => {}
            }
            rest = others;
        }
        index.chunks.sort_by_key(|chunk| chunk.chunk_start_offset);
        Ok(index)
    }
}

#[cfg(test)]
mod tests {
    use super::super::mcap::write;
    use super::super::recording::testing::{assert_same, recording};
    use super::super::{Place, Samples};
    use super::*;

    /// Enough episodes for several chunks.
    fn long() -> Recording {
        let mut long = recording();
        for number in 11..900 {
            let mut episode = long.episodes[usize::from(number % 2 == 0)].clone();
            episode.facts.number = number;
            if let Samples::Double(values) = &mut episode.samples[2] {
                values[0] = number as f64;
            }
            long.episodes.push(episode);
        }
        long
    }

    #[test]
    fn some_episodes_are_those_of_the_whole() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen.mcap");
        write(&path, &long(), Place::New).unwrap();
        for numbers in [&[2_u64][..], &[10, 500], &[899], &[3]] {
            let mut want = long();
            want.episodes.retain(|episode| numbers.contains(&episode.facts.number));
            assert_same(&read_episodes(&path, numbers).unwrap(), &want);
        }
    }

    #[test]
    fn damage_is_an_error_or_changes_nothing() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen.mcap");
        write(&path, &recording(), Place::New).unwrap();
        let mut want = recording();
        want.episodes.remove(0);
        let bytes = std::fs::read(&path).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let after_header = summary.chunk_indexes[0].chunk_start_offset as usize;
        let other = folder.path().join("damaged.mcap");
        for place in (after_header..bytes.len()).step_by(3) {
            let mut changed = bytes.clone();
            changed[place] ^= 0x81;
            files::write_atomic(&other, &changed).unwrap();
            if let Ok(found) = read_episodes(&other, &[10]) {
                assert_same(&found, &want);
            }
        }
        for length in (0..bytes.len()).step_by(101) {
            files::write_atomic(&other, &bytes[..length]).unwrap();
            assert!(read_episodes(&other, &[10]).is_err(), "{length} bytes of {}", bytes.len());
        }
    }
}

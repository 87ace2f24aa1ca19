//! A recording as a tidy Parquet table: one row per step, one column per element of a channel.
//!
//! Columns are `task`, `episode`, `step`, `time` (s, after the step; absent if the control interval is not known), then
//! `channel.element` for every channel, in the type it was recorded in. Row groups hold whole episodes and are encoded one
//! at a time, so that writing needs little memory beside the recording. What a table cannot say (timing, seeds, flags of
//! episodes) lies in the metadata under the key [`HEADER`]; a table without it is no recording.
//!
//! Undefined numbers are null, as in every table of this program.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Cursor, Write};
use std::ops::Range;
use std::path::Path;

use polars::prelude::{
    BooleanChunked, Column as Stored, DataFrame, Float32Chunked, Float64Chunked, IntoColumn,
    KeyValueMetadata, NamedFrom, NewChunkedArray, ParquetCompression, ParquetReader, ParquetWriter,
    PlSmallStr, PolarsError, SerReader, Series,
};

use super::header::Header;
use super::parquet::{ARROW_SCHEMA, LARGEST_FILE, UNITS};
use super::parquet_part::PartOfFile;
use super::recording::{Channel, Element, Episode, Recording, Samples};
use super::{Place, RecordError};
use crate::files;

/// Metadata key of everything but the samples.
pub(super) const HEADER: &str = "recording";
/// Rows of a row group, unless an episode is longer.
const ROW_GROUP: usize = 1 << 14;

/// Writes `recording` to `path`.
pub(super) fn write(path: &Path, recording: &Recording, place: Place) -> Result<(), RecordError> {
    recording.check()?;
    let metadata = &recording.about.metadata;
    if let Some(key) = [UNITS, ARROW_SCHEMA, HEADER].iter().find(|key| metadata.contains_key(**key))
    {
        return Err(RecordError::ReservedKey { key: (*key).to_owned() });
    }
    let mut header = Header::of(recording);
    header.about.metadata.clear();
    let mut pairs =
        vec![(UNITS.to_owned(), units_of(recording)), (HEADER.to_owned(), header.to_json())];
    pairs.extend(metadata.iter().map(|(key, value)| (key.clone(), value.clone())));
    let fail = |source| RecordError::Parquet { path: path.to_path_buf(), source };
    let schema = frame(recording, 0..0).map_err(fail)?.schema().clone();
    place.write(path, |file| {
        let mut buffer = BufWriter::with_capacity(1 << 20, file);
        let mut writer = ParquetWriter::new(&mut buffer)
            .with_compression(ParquetCompression::Zstd(None))
            .set_parallel(false)
            .with_key_value_metadata(Some(KeyValueMetadata::from_static(pairs)))
            .batched(&schema)
            .map_err(io::Error::other)?;
        for group in groups(recording.episodes.iter().map(|episode| episode.facts.length)) {
            let frame = frame(recording, group).map_err(io::Error::other)?;
            writer.write_batch(&frame).map_err(io::Error::other)?;
        }
        writer.finish().map_err(io::Error::other)?;
        drop(writer);
        buffer.flush()
    })
}

/// The units of all columns that have one, as a JSON object with sorted keys.
fn units_of(recording: &Recording) -> String {
    let mut units = BTreeMap::new();
    if recording.about.control_interval.is_some() {
        units.insert("time".to_owned(), "s");
    }
    for channel in &recording.channels {
        for element in channel.elements.iter().filter(|element| !element.unit.is_empty()) {
            units.insert(channel.column_name(element), &element.unit);
        }
    }
    serde_json::json!(units).to_string()
}

/// Consecutive episodes of about [`ROW_GROUP`] steps together.
fn groups(lengths: impl Iterator<Item = usize>) -> Vec<Range<usize>> {
    let mut groups: Vec<Range<usize>> = Vec::new();
    let mut rows = ROW_GROUP;
    for (index, length) in lengths.enumerate() {
        match groups.last_mut() {
            Some(group) if rows + length <= ROW_GROUP => {
                group.end = index + 1;
                rows += length;
            }
            _ => {
                groups.push(index..index + 1);
                rows = length;
            }
        }
    }
    groups
}

/// The rows of some episodes.
fn frame(recording: &Recording, group: Range<usize>) -> Result<DataFrame, PolarsError> {
    let episodes = &recording.episodes[group];
    let steps = || episodes.iter().flat_map(|e| (0..e.facts.length).map(move |step| (e, step)));
    let rows = steps().count();
    let tasks = Series::new("task".into(), vec![recording.about.task.as_str(); rows]);
    let numbers: Vec<i64> = steps().map(|(e, _)| e.facts.number as i64).collect();
    let places: Vec<i64> = steps().map(|(_, step)| step as i64).collect();
    let mut columns = vec![
        tasks.into_column(),
        Series::new("episode".into(), numbers).into_column(),
        Series::new("step".into(), places).into_column(),
    ];
    if let Some(interval) = recording.about.control_interval {
        let times: Vec<f64> = steps().map(|(_, step)| (step + 1) as f64 * interval).collect();
        columns.push(Series::new("time".into(), times).into_column());
    }
    for (place, channel) in recording.channels.iter().enumerate() {
        for (index, element) in channel.elements.iter().enumerate() {
            columns.push(column(channel, element, index, rows, episodes, place));
        }
    }
    DataFrame::new(rows, columns)
}

/// One element of the channel at `place`, over all steps of `episodes`.
fn column(
    channel: &Channel,
    element: &Element,
    index: usize,
    rows: usize,
    episodes: &[Episode],
    place: usize,
) -> Stored {
    /// Values of one element, with null for NaN only where there is one: the mask costs time.
    macro_rules! numbers {
        ($kind:path, $number:ty, $array:ty, $name:expr) => {{
            let mut values: Vec<$number> = Vec::with_capacity(rows);
            for episode in episodes {
                if let $kind(samples) = &episode.samples[place] {
                    values.extend(samples.iter().skip(index).step_by(channel.width()));
                }
            }
            if values.iter().any(|value| value.is_nan()) {
                let defined = values.into_iter().map(|value| (!value.is_nan()).then_some(value));
                <$array>::from_iter_options($name, defined).into_column()
            } else {
                <$array>::from_vec($name, values).into_column()
            }
        }};
    }
    let name: PlSmallStr = channel.column_name(element).into();
    match channel.precision {
        super::Precision::Single => numbers!(Samples::Single, f32, Float32Chunked, name),
        super::Precision::Double => numbers!(Samples::Double, f64, Float64Chunked, name),
        super::Precision::Flag => {
            let mut values: Vec<bool> = Vec::with_capacity(rows);
            for episode in episodes {
                if let Samples::Flag(samples) = &episode.samples[place] {
                    values.extend(samples.iter().skip(index).step_by(channel.width()));
                }
            }
            BooleanChunked::from_slice(name, &values).into_column()
        }
    }
}

/// Everything about the recording in `path` but its samples.
pub(super) fn read_header(path: &Path) -> Result<Header, RecordError> {
    header_of(PartOfFile::open(path)?.bytes(), path)
}

fn header_of(bytes: &[u8], path: &Path) -> Result<Header, RecordError> {
    let fail = |source| RecordError::Parquet { path: path.to_path_buf(), source };
    let mut reader = ParquetReader::new(Cursor::new(bytes));
    let pairs = reader.get_metadata().map_err(fail)?.key_value_metadata().clone();
    let mut metadata: BTreeMap<String, String> = pairs
        .unwrap_or_default()
        .into_iter()
        .filter_map(|pair| Some((pair.key, pair.value?)))
        .collect();
    let header = metadata
        .remove(HEADER)
        .ok_or_else(|| RecordError::NoRecording { path: path.to_path_buf() })?;
    let mut header = Header::parse(&header, "Parquet", path)?;
    metadata.remove(UNITS);
    metadata.remove(ARROW_SCHEMA);
    header.about.metadata = metadata;
    let rows = reader.num_rows().map_err(fail)? as u64;
    if header.row_count() != Some(rows) {
        let expected = header.row_count().unwrap_or(u64::MAX);
        let what = format!("it has {rows} rows, its header says {expected}");
        return Err(RecordError::Damaged { format: "Parquet", what, path: path.to_path_buf() });
    }
    Ok(header)
}

/// Reads what [`write`] wrote.
pub(super) fn read(path: &Path) -> Result<Recording, RecordError> {
    let bytes = files::read_bounded(path, LARGEST_FILE)?;
    let header = header_of(&bytes, path)?;
    let mut episodes = header.empty_episodes();
    let mut row = 0;
    for group in groups(header.episodes.iter().map(|facts| facts.length)) {
        row += fill(&bytes, &header.channels, row, &mut episodes[group], path)?;
    }
    let recording = Recording { about: header.about, channels: header.channels, episodes };
    recording.check()?;
    Ok(recording)
}

/// Reads the episodes with these numbers, and of the file only the row groups that they are in.
pub(super) fn read_episodes(path: &Path, numbers: &[u64]) -> Result<Recording, RecordError> {
    let mut part = PartOfFile::open(path)?;
    let header = header_of(part.bytes(), path)?;
    let mut episodes = header.empty_episodes();
    let mut row = 0;
    for episode in &mut episodes {
        let length = episode.facts.length;
        if numbers.contains(&episode.facts.number) {
            part.fetch_rows(row..row + length)?;
            let one = std::slice::from_mut(episode);
            fill(part.bytes(), &header.channels, row, one, path)?;
        }
        row += length;
    }
    episodes.retain(|episode| numbers.contains(&episode.facts.number));
    let recording = Recording { about: header.about, channels: header.channels, episodes };
    recording.check()?;
    Ok(recording)
}

/// Fills consecutive episodes from the rows that begin at `row`; how many rows that were.
fn fill(
    bytes: &[u8],
    channels: &[Channel],
    row: usize,
    episodes: &mut [Episode],
    path: &Path,
) -> Result<usize, RecordError> {
    let rows = episodes.iter().map(|episode| episode.facts.length).sum();
    let frame = ParquetReader::new(Cursor::new(bytes))
        .with_slice(Some((row, rows)))
        .finish()
        .map_err(|source| RecordError::Parquet { path: path.to_path_buf(), source })?;
    for (place, channel) in channels.iter().enumerate() {
        take(&frame, channel, place, episodes, path)?;
    }
    Ok(rows)
}

/// Takes a channel of a group of episodes from its rows.
fn take(
    frame: &DataFrame,
    channel: &Channel,
    place: usize,
    group: &mut [Episode],
    path: &Path,
) -> Result<(), RecordError> {
    let fail = |source| RecordError::Parquet { path: path.to_path_buf(), source };
    let width = channel.width();
    for episode in group.iter_mut() {
        let count = episode.facts.length * width;
        episode.samples[place] = match channel.precision {
            super::Precision::Single => Samples::Single(vec![0.0; count]),
            super::Precision::Double => Samples::Double(vec![0.0; count]),
            super::Precision::Flag => Samples::Flag(vec![false; count]),
        };
    }
    for (index, element) in channel.elements.iter().enumerate() {
        let stored = frame.column(&channel.column_name(element)).map_err(fail)?;
        /// Spreads the values of a column over the rows of the episodes.
        macro_rules! spread {
            ($kind:path, $values:expr, $missing:expr) => {{
                let mut values = $values.iter();
                for episode in group.iter_mut() {
                    if let $kind(samples) = &mut episode.samples[place] {
                        for into in samples.iter_mut().skip(index).step_by(width) {
                            *into = values.next().flatten().unwrap_or($missing);
                        }
                    }
                }
            }};
        }
        match channel.precision {
            super::Precision::Single => {
                spread!(Samples::Single, stored.f32().map_err(fail)?, f32::NAN);
            }
            super::Precision::Double => {
                spread!(Samples::Double, stored.f64().map_err(fail)?, f64::NAN);
            }
            super::Precision::Flag => spread!(Samples::Flag, stored.bool().map_err(fail)?, false),
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::super::recording::testing::{assert_same, recording};
    use super::*;

    #[test]
    fn a_recording_comes_back_bit_for_bit_and_its_bytes_do_not_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen.parquet");
        let mut long = recording();
        // More steps than a row group, with an episode across the border and an empty one.
        for number in 11..2000 {
            let mut episode = long.episodes[1].clone();
            episode.facts.number = number;
            long.episodes.push(episode);
        }
        long.episodes[4].facts.length = 0;
        long.episodes[4].samples =
            long.channels.iter().map(|c| Samples::with_capacity(c.precision, 0)).collect();
        for recording in [recording(), long] {
            write(&path, &recording, Place::Replace).unwrap();
            let bytes = files::sha256_of_file(&path).unwrap();
            assert_same(&read(&path).unwrap(), &recording);
            write(&path, &recording, Place::Replace).unwrap();
            assert_eq!(files::sha256_of_file(&path).unwrap(), bytes);
        }
    }

    #[test]
    fn the_table_reads_as_a_table() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen.parquet");
        write(&path, &recording(), Place::Replace).unwrap();
        let (table, metadata) = super::super::read_parquet(&path).unwrap();
        assert_eq!(table.row_count(), 14);
        assert_eq!(table.column("joint.flexion").unwrap().unit, "rad");
        assert_eq!(table.column("action.FCU").unwrap().values.len(), 14);
        assert!(metadata.iter().any(|(key, _)| key == "program"));
    }

    #[test]
    fn a_table_that_is_no_recording_is_told_apart() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let table = super::super::Table::default();
        super::super::write_parquet(&path, &table, &[]).unwrap();
        assert!(matches!(read(&path), Err(RecordError::NoRecording { .. })));
    }
}

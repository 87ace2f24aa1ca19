//! The formats a recording can have: told apart by how a file begins, never by its name.

use std::io::Read;
use std::path::{Path, PathBuf};

use serde::Serialize;

use super::header::Header;
use super::recording::{About, Channel, EpisodeFacts, Recording};
use super::{Place, RecordError};
use crate::files;

/// A format that recordings are written in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Format {
    /// A tidy table, one row per step.
    Parquet,
    /// JSON messages for a viewer.
    Mcap,
    /// Upstream's compact HDF5.
    Hdf5,
    /// Upstream's HDF5 of walking.
    Gait,
}

impl Format {
    pub const ALL: [Self; 4] = [Self::Parquet, Self::Mcap, Self::Hdf5, Self::Gait];

    /// What it is called on the command line.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Parquet => "parquet",
            Self::Mcap => "mcap",
            Self::Hdf5 => "hdf5",
            Self::Gait => "gait",
        }
    }

    /// The ending of its files.
    #[must_use]
    pub fn extension(self) -> &'static str {
        match self {
            Self::Parquet => "parquet",
            Self::Mcap => "mcap",
            Self::Hdf5 | Self::Gait => "h5",
        }
    }
}

/// What a file begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Container {
    Parquet,
    Mcap,
    Hdf5,
}

impl Container {
    fn of(path: &Path) -> Result<Option<Self>, RecordError> {
        const LONGEST: usize = 8;
        let mut start = Vec::with_capacity(LONGEST);
        let fail = |source| files::FileError::Read { path: path.to_path_buf(), source };
        files::length(path)?;
        files::open(path)?.take(LONGEST as u64).read_to_end(&mut start).map_err(fail)?;
        Ok(if start.starts_with(b"PAR1") {
            Some(Self::Parquet)
        } else if start == b"\x89MCAP0\r\n" {
            Some(Self::Mcap)
        } else if start == b"\x89HDF\r\n\x1a\n" {
            Some(Self::Hdf5)
        } else {
            None
        })
    }
}

/// A recording from a file, and what in the file is not in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Opened {
    pub recording: Recording,
    /// Names of data sets that have no place in a recording.
    pub left_out: Vec<String>,
}

/// What is inside a recording, without its samples.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Summary {
    pub format: &'static str,
    pub about: About,
    pub channels: Vec<Channel>,
    pub episodes: Vec<EpisodeFacts>,
    /// Names of data sets that would not be read.
    pub left_out: Vec<String>,
}

impl Summary {
    #[cfg(feature = "hdf5")]
    pub(super) fn of(format: &'static str, recording: &Recording, left_out: Vec<String>) -> Self {
        Self { left_out, ..Self::of_header(format, Header::of(recording)) }
    }

    #[cfg(any(feature = "parquet", feature = "mcap", feature = "hdf5"))]
    fn of_header(format: &'static str, header: Header) -> Self {
        let Header { about, channels, episodes, .. } = header;
        Self { format, about, channels, episodes, left_out: Vec::new() }
    }
}

/// Whether `path` begins like one of the formats. Says nothing about what follows.
pub fn may_be_recording(path: &Path) -> Result<bool, RecordError> {
    Ok(Container::of(path)?.is_some())
}

/// The error of a format that this program was built without.
#[cfg(not(all(feature = "parquet", feature = "mcap", feature = "hdf5")))]
fn not_built<T>(format: &'static str, path: &Path) -> Result<T, RecordError> {
    Err(RecordError::NotBuilt { format, path: path.to_path_buf() })
}

/// Reads the recording in `path`.
pub fn read_recording(path: &Path) -> Result<Opened, RecordError> {
    #[cfg(any(feature = "parquet", feature = "mcap"))]
    let whole = |recording| Opened { recording, left_out: Vec::new() };
    match Container::of(path)? {
        #[cfg(feature = "parquet")]
        Some(Container::Parquet) => super::recording_parquet::read(path).map(whole),
        #[cfg(not(feature = "parquet"))]
        Some(Container::Parquet) => not_built("Parquet", path),
        #[cfg(feature = "mcap")]
        Some(Container::Mcap) => super::mcap::read(path).map(whole),
        #[cfg(not(feature = "mcap"))]
        Some(Container::Mcap) => not_built("MCAP", path),
        #[cfg(feature = "hdf5")]
        Some(Container::Hdf5) => super::hdf5::read(path),
        #[cfg(not(feature = "hdf5"))]
        Some(Container::Hdf5) => not_built("HDF5", path),
        None => Err(RecordError::UnknownFormat { path: path.to_path_buf() }),
    }
}

/// Reads the episodes with these numbers, and of the file only what they need where its format allows it. Numbers that are
/// not there are left out.
pub fn read_episodes(path: &Path, numbers: &[u64]) -> Result<Opened, RecordError> {
    let of = |recording| Opened { recording, left_out: Vec::new() };
    let mut opened = match Container::of(path)? {
        #[cfg(feature = "parquet")]
        Some(Container::Parquet) => of(super::recording_parquet::read_episodes(path, numbers)?),
        #[cfg(feature = "mcap")]
        Some(Container::Mcap) => of(super::mcap_part::read_episodes(path, numbers)?),
        _ => read_recording(path)?,
    };
    opened.recording.episodes.retain(|episode| numbers.contains(&episode.facts.number));
    Ok(opened)
}

/// What is in the recording in `path`.
pub fn summarise(path: &Path) -> Result<Summary, RecordError> {
    match Container::of(path)? {
        #[cfg(feature = "parquet")]
        Some(Container::Parquet) => {
            Ok(Summary::of_header("Parquet", super::recording_parquet::read_header(path)?))
        }
        #[cfg(not(feature = "parquet"))]
        Some(Container::Parquet) => not_built("Parquet", path),
        #[cfg(feature = "mcap")]
        Some(Container::Mcap) => Ok(Summary::of_header("MCAP", super::mcap::read_header(path)?)),
        #[cfg(not(feature = "mcap"))]
        Some(Container::Mcap) => not_built("MCAP", path),
        #[cfg(feature = "hdf5")]
        Some(Container::Hdf5) => super::hdf5::summarise(path),
        #[cfg(not(feature = "hdf5"))]
        Some(Container::Hdf5) => not_built("HDF5", path),
        None => Err(RecordError::UnknownFormat { path: path.to_path_buf() }),
    }
}

/// Writes `recording` to each of `files` and says which channels were dropped where. The recording is handed over, so that
/// the HDF5 library need not hold it a second time; give its formats last.
pub fn write_recording(
    recording: Recording,
    files: &[(Format, PathBuf)],
    place: Place,
) -> Result<Vec<(Format, Vec<String>)>, RecordError> {
    let Some(((last, last_path), others)) = files.split_last() else { return Ok(Vec::new()) };
    let mut dropped = Vec::new();
    for (format, path) in others {
        match format {
            Format::Parquet | Format::Mcap => write_borrowed(&recording, *format, path, place)?,
            Format::Hdf5 | Format::Gait => {
                dropped.push((*format, write_owned(recording.clone(), *format, path, place)?));
            }
        }
    }
    dropped.push((*last, write_owned(recording, *last, last_path, place)?));
    dropped.retain(|(_, channels)| !channels.is_empty());
    Ok(dropped)
}

fn write_borrowed(
    recording: &Recording,
    format: Format,
    path: &Path,
    place: Place,
) -> Result<(), RecordError> {
    match format {
        #[cfg(feature = "parquet")]
        Format::Parquet => super::recording_parquet::write(path, recording, place),
        #[cfg(feature = "mcap")]
        Format::Mcap => super::mcap::write(path, recording, place),
        other => write_owned(recording.clone(), other, path, place).map(drop),
    }
}

/// Writes and gives the names of the channels that the format cannot hold.
fn write_owned(
    recording: Recording,
    format: Format,
    path: &Path,
    place: Place,
) -> Result<Vec<String>, RecordError> {
    match format {
        #[cfg(feature = "parquet")]
        Format::Parquet => write_borrowed(&recording, format, path, place).map(|()| Vec::new()),
        #[cfg(not(feature = "parquet"))]
        Format::Parquet => not_built("Parquet", path),
        #[cfg(feature = "mcap")]
        Format::Mcap => write_borrowed(&recording, format, path, place).map(|()| Vec::new()),
        #[cfg(not(feature = "mcap"))]
        Format::Mcap => not_built("MCAP", path),
        #[cfg(feature = "hdf5")]
        Format::Hdf5 => super::hdf5::write_compact(path, recording, place).map(|()| Vec::new()),
        #[cfg(feature = "hdf5")]
        Format::Gait => super::hdf5::write_gait(path, recording, place),
        #[cfg(not(feature = "hdf5"))]
        Format::Hdf5 | Format::Gait => not_built("HDF5", path),
    }
}

#[cfg(all(feature = "parquet", feature = "mcap", feature = "hdf5"))]
#[cfg(test)]
mod tests {
    use super::super::recording::testing::{assert_same, recording};
    use super::*;

    #[test]
    fn a_recording_goes_through_every_format_and_comes_back_bit_for_bit() {
        let folder = tempfile::tempdir().unwrap();
        let mut current = recording();
        for format in [Format::Hdf5, Format::Mcap, Format::Parquet, Format::Hdf5, Format::Parquet] {
            let path = folder.path().join(format.word());
            let files = [(format, path.clone())];
            assert_eq!(write_recording(current, &files, Place::Replace).unwrap(), []);
            assert!(may_be_recording(&path).unwrap());
            let summary = summarise(&path).unwrap();
            assert_eq!((summary.episodes.len(), summary.channels.len()), (2, 5));
            let opened = read_recording(&path).unwrap();
            assert_eq!(opened.left_out, [""; 0]);
            let mut part = opened.recording.clone();
            part.episodes.remove(0);
            assert_same(&read_episodes(&path, &[10, 11]).unwrap().recording, &part);
            assert_same(&opened.recording, &recording());
            current = opened.recording;
        }
    }

    #[test]
    fn no_writer_replaces_a_file_that_it_was_not_told_to() {
        let folder = tempfile::tempdir().unwrap();
        for format in [Format::Parquet, Format::Mcap, Format::Hdf5] {
            let path = folder.path().join(format.word());
            files::write_atomic(&path, b"mine").unwrap();
            let files = [(format, path.clone())];
            let error = write_recording(recording(), &files, Place::New).unwrap_err();
            assert!(matches!(error, RecordError::Exists { .. }), "{error}");
            assert_eq!(std::fs::read(&path).unwrap(), b"mine");
        }
    }

    #[test]
    fn what_begins_like_no_format_is_named() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notes.h5");
        files::write_atomic(&path, b"\x89HD").unwrap();
        assert!(!may_be_recording(&path).unwrap());
        assert!(matches!(read_recording(&path), Err(RecordError::UnknownFormat { .. })));
    }
}

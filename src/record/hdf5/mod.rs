//! Recordings in upstream's HDF5 layouts (`spec/analysis.md` §16), read and written without a system library.
//!
//! | layout | what | in | out |
//! | --- | --- | --- | --- |
//! | compact (16.1) | one file per policy and task, a group per episode | yes | yes |
//! | per episode (16.2) | the first release: one file per episode | yes | as compact (16.3) |
//! | gait (16.4) | walking: activation, foot contacts, root velocity | yes | yes |
//!
//! Readers take single or double precision, do not mind what they do not know, and cut every array to the episode's
//! length. Our own compact files carry one more text, `recording`, so that they come back bit for bit.

pub mod axes;
mod compact;
mod gait;
mod per_episode;
mod source;
mod write;

use std::path::Path;

pub use per_episode::{ExportOptions, export};
pub(super) use write::{write_compact, write_gait};

use super::format::Opened;
use super::{RecordError, Summary};
use source::Source;

/// Text of our own compact files: everything but the samples.
const HEADER: &str = "recording";

/// Which layout a file has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Layout {
    Compact,
    PerEpisode,
    Gait,
}

impl Layout {
    fn of(source: &Source) -> Result<Self, RecordError> {
        if source.has_data_set("", "actions")? {
            return Ok(Self::PerEpisode);
        }
        let episodes = source.episodes()?;
        let Some((_, first)) = episodes.first() else {
            return Err(source.damaged("it has no group `episode_…`"));
        };
        let is_gait = !source.has_data_set("", HEADER)?
            && source.has_data_set(first, "foot_contacts")?
            && source.has_data_set(first, "activations")?;
        Ok(if is_gait { Self::Gait } else { Self::Compact })
    }

    fn name(self) -> &'static str {
        match self {
            Self::Compact => "HDF5, compact (upstream)",
            Self::PerEpisode => "HDF5, one episode (upstream, first release)",
            Self::Gait => "HDF5, gait (upstream)",
        }
    }
}

/// Reads a recording in any of the layouts.
pub(super) fn read(path: &Path) -> Result<Opened, RecordError> {
    let source = Source::open(path)?;
    match Layout::of(&source)? {
        Layout::Compact => compact::read(&source),
        Layout::Gait => gait::read(&source),
        Layout::PerEpisode => per_episode::read_one(&source),
    }
}

/// What is in the file.
pub(super) fn summarise(path: &Path) -> Result<Summary, RecordError> {
    let layout = Layout::of(&Source::open(path)?)?;
    let Opened { recording, left_out } = read(path)?;
    Ok(Summary::of(layout.name(), &recording, left_out))
}

//! Everything about a recording but its samples, as one JSON document: what the formats that have no place of their own
//! for it carry, and what a reader checks the samples against.

use std::path::Path;

use serde::{Deserialize, Serialize};

use super::RecordError;
use super::recording::{About, Channel, Episode, EpisodeFacts, Recording, Samples};

/// Version of the document.
const VERSION: u32 = 1;
/// No recording has more values than this, 32 GiB in double precision.
const MOST_VALUES: u64 = 1 << 32;

/// The document.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(super) struct Header {
    version: u32,
    pub(super) about: About,
    pub(super) channels: Vec<Channel>,
    pub(super) episodes: Vec<EpisodeFacts>,
}

impl Header {
    /// The header of `recording`.
    pub(super) fn of(recording: &Recording) -> Self {
        Self {
            version: VERSION,
            about: recording.about.clone(),
            channels: recording.channels.clone(),
            episodes: recording.episodes.iter().map(|episode| episode.facts.clone()).collect(),
        }
    }

    /// The document's text.
    pub(super) fn to_json(&self) -> String {
        // Plain fields with text keys: there is nothing in it that JSON cannot hold.
        serde_json::to_string(self).unwrap_or_default()
    }

    /// Reads what [`Header::to_json`] gave; `path` is for the error.
    pub(super) fn parse(
        text: &str,
        format: &'static str,
        path: &Path,
    ) -> Result<Self, RecordError> {
        let fail = |what: String| RecordError::Damaged { format, what, path: path.to_path_buf() };
        let header: Self =
            serde_json::from_str(text).map_err(|e| fail(format!("its header: {e}")))?;
        if header.version != VERSION {
            let found = header.version;
            return Err(fail(format!("its header has version {found}, expected {VERSION}")));
        }
        if header.value_count().is_none_or(|count| count > MOST_VALUES) {
            return Err(fail(format!("it claims more than {MOST_VALUES} values")));
        }
        Ok(header)
    }

    /// Values of all episodes together.
    fn value_count(&self) -> Option<u64> {
        let width = self.channels.iter().map(|channel| channel.width() as u64).sum::<u64>();
        self.row_count()?.checked_mul(width.max(1))
    }

    /// Steps of all episodes together; `None` where that is no number.
    pub(super) fn row_count(&self) -> Option<u64> {
        self.episodes.iter().try_fold(0_u64, |sum, facts| sum.checked_add(facts.length as u64))
    }

    /// Episodes without values, to be filled.
    pub(super) fn empty_episodes(&self) -> Vec<Episode> {
        let samples =
            || self.channels.iter().map(|channel| Samples::with_capacity(channel.precision, 0));
        let episode =
            |facts: &EpisodeFacts| Episode { facts: facts.clone(), samples: samples().collect() };
        self.episodes.iter().map(episode).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::recording::testing::recording;
    use super::*;

    #[test]
    fn a_header_comes_back_and_impossible_ones_are_refused() {
        let header = Header::of(&recording());
        let path = Path::new("a.mcap");
        assert_eq!(Header::parse(&header.to_json(), "MCAP", path).unwrap(), header);
        let mut other = header.clone();
        other.version = 9;
        let mut huge = header;
        huge.episodes[0].length = usize::MAX;
        for (header, complaint) in [(other, "version 9, expected 1"), (huge, "claims more than")] {
            let error = Header::parse(&header.to_json(), "MCAP", path).unwrap_err().to_string();
            assert!(error.contains(complaint) && error.contains("`a.mcap`"), "{error}");
        }
    }
}

//! An episode as the viewer is told it: everything that is seen of all takes, in one recording.

use re_sdk::EntityPath;
use re_sdk::log::LogMsg;
use re_sdk_types::archetypes::TextDocument;

use crate::units::Seconds;

use super::heat::Map;
use super::store::{SceneError, Store};
use super::{Frame, Signal, Stage, stage};

/// One policy playing an episode.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Take {
    /// What tells it apart from the others: the policy, or the number of components.
    pub label: String,
    pub stage: Stage,
    pub frames: Vec<Frame>,
    pub signals: Vec<Signal>,
}

/// One episode, by one or several takes that start alike.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Act {
    pub task: String,
    /// Number of the episode.
    pub episode: u64,
    /// What it is played under, such as a number of components; empty if nothing.
    pub condition: String,
    /// Control step.
    pub interval: Seconds,
    /// Steps that an episode can have; 0 where that is not known.
    pub horizon: usize,
    /// What a person should know: where it comes from.
    pub notes: String,
    pub takes: Vec<Take>,
}

impl Take {
    /// Where the take stands.
    pub(super) fn path(&self) -> EntityPath {
        EntityPath::from_single_string(self.label.as_str())
    }
}

impl Act {
    /// What the viewer calls it.
    pub(super) fn title(&self) -> String {
        let Self { task, episode, condition, .. } = self;
        let comma = if condition.is_empty() { "" } else { ", " };
        format!("{task}{comma}{condition}, episode {episode}")
    }

    /// Frames that the heat map has room for: those of a whole episode, so that the maps of two can be compared.
    pub(super) fn length(&self) -> usize {
        let played = self.takes.iter().map(|take| take.frames.len()).max();
        played.unwrap_or(0).max(self.horizon + 1)
    }

    /// Its recording, with the notes. Equal episodes of a `run` have equal names, so that a file says the same twice.
    pub(super) fn open(&self, run: &str) -> Result<Store, SceneError> {
        let Self { task, episode, condition, notes, takes, .. } = self;
        let labels: Vec<&str> = takes.iter().map(|take| take.label.as_str()).collect();
        let labels = labels.join("\n");
        let identity = format!("{task}\n{episode}\n{condition}\n{labels}\n{notes}\n{run}");
        let identity = blake3::hash(identity.as_bytes()).to_hex();
        let mut store = Store::recording(task, &identity[..32], &self.title())?;
        store.fixed("notes", &TextDocument::from_markdown(notes.as_str()))?;
        Ok(store)
    }

    /// All messages of the episode.
    pub(super) fn messages(&self) -> Result<Vec<LogMsg>, SceneError> {
        let mut store = self.open("")?;
        for take in &self.takes {
            let path = take.path();
            stage::set(&mut store, &path, &take.stage)?;
            stage::show(&mut store, &path, &take.stage, &take.frames, self.interval)?;
            for signal in &take.signals {
                signal.introduce(&mut store, &path)?;
                signal.show(&mut store, &path, self.interval)?;
            }
            let map = Map::new(take.stage.muscles.len(), self.length(), self.takes.len());
            map.name_rows(&mut store, &path, &take.stage.muscles)?;
            let rows = take.frames.iter().map(|frame| frame.activation.as_slice());
            map.show(&mut store, &path, rows)?;
            let steps: Vec<usize> = take.frames.iter().map(|frame| frame.step).collect();
            map.point(&mut store, &path, &steps, self.interval)?;
        }
        Ok(store.take())
    }
}

//! An episode as the viewer is told it: everything that is seen of all takes, in one recording.

use re_sdk::EntityPath;
use re_sdk::log::LogMsg;
use re_sdk_types::archetypes::TextDocument;

use crate::units::Seconds;

use super::store::{SceneError, Store};
use super::{Frame, Signal, Stage, heat, stage};

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
    /// Control step.
    pub interval: Seconds,
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
    /// All messages of the episode.
    pub(super) fn messages(&self) -> Result<Vec<LogMsg>, SceneError> {
        let labels: Vec<&str> = self.takes.iter().map(|take| take.label.as_str()).collect();
        let mut store = open(&self.task, self.episode, &labels, &self.notes, "")?;
        for take in &self.takes {
            let path = take.path();
            stage::set(&mut store, &path, &take.stage)?;
            stage::show(&mut store, &path, &take.stage, &take.frames, self.interval)?;
            for signal in &take.signals {
                signal.introduce(&mut store, &path)?;
                signal.show(&mut store, &path, self.interval)?;
            }
            let (muscles, all) = (take.stage.muscles.len(), take.frames.len());
            let rows = take.frames.iter().map(|frame| frame.activation.as_slice());
            heat::show(&mut store, &path, muscles, all, rows)?;
            let steps: Vec<usize> = take.frames.iter().map(|frame| frame.step).collect();
            heat::point(&mut store, &path, muscles, all, &steps, self.interval)?;
        }
        Ok(store.take())
    }
}

/// The recording of an episode, with its notes. Equal episodes of a `run` have equal names, so that a file says the same
/// twice.
pub(super) fn open(
    task: &str,
    episode: u64,
    labels: &[&str],
    notes: &str,
    run: &str,
) -> Result<Store, SceneError> {
    let identity = format!("{task}\n{episode}\n{}\n{notes}\n{run}", labels.join("\n"));
    let identity = blake3::hash(identity.as_bytes()).to_hex();
    let mut store = Store::recording(task, &identity[..32], &format!("{task}, episode {episode}"))?;
    store.fixed("notes", &TextDocument::from_markdown(notes))?;
    Ok(store)
}

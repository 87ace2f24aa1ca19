//! Tasks played with every channel kept, for the commands that record or look at every step.

use std::collections::BTreeMap;

use crate::experiment::ExperimentError;
use crate::experiment::gather::Played;
use crate::experiment::plan::Arm;
use crate::experiment::recording::Source;
use crate::sim::rollout::{self, ChannelNames, Channels, Episode};
use crate::sim::tasks::Definition;

use super::laboratory::Laboratory;

impl Laboratory {
    /// Every episode of every task, with all channels.
    #[must_use]
    pub fn recorded_arms(&self) -> Vec<Arm> {
        self.tasks.iter().map(|task| self.arm(task, Channels::All)).collect()
    }

    /// The episodes of the task at `place` that were played so: what their columns are, and the episodes.
    pub fn recorded(
        &self,
        played: &Played,
        place: usize,
    ) -> Result<(ChannelNames, Vec<Episode>), ExperimentError> {
        let names = rollout::channel_names(&self.machine, self.tasks[place])?;
        Ok((names, played.episodes(place)?))
    }

    /// What a recording of `task` says of where it comes from.
    #[must_use]
    pub fn source(&self, task: &'static Definition) -> Source<'_> {
        Source {
            task,
            policy: &self.policy.name,
            mode: self.mode,
            seed: self.seed,
            metadata: BTreeMap::new(),
        }
    }
}

//! A muscle channel of a recording: what muscles were told or did, all episodes below each other.

use serde_json::{Value, json};

use crate::analysis::signal::Rows;
use crate::record::{Episode, Recording, names};
use crate::sim::tasks;
use crate::units::Seconds;

use super::ExperimentError;

/// Which episodes of a recording count.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum EpisodeChoice {
    /// All, of which there must be so many.
    Exactly(usize),
    /// The first so many with at least one solved step.
    Successful(usize),
}

/// What a recording is of.
#[derive(Debug, Clone, PartialEq)]
pub struct Take {
    pub policy: String,
    pub task: String,
    /// How actions were chosen, in a word; empty if the file does not say.
    pub actions: &'static str,
    /// Control step: the task's, else what the file says.
    pub control_interval: Option<Seconds>,
    pub episodes: usize,
    /// Steps of all episodes together.
    pub steps: usize,
    pub muscles: Vec<String>,
}

impl Take {
    /// For the result document.
    #[must_use]
    pub(super) fn document(&self) -> Value {
        json!({
            "policy": self.policy,
            "task": self.task,
            "actions": Some(self.actions).filter(|word| !word.is_empty()),
            "control_interval": self.control_interval,
            "episodes": self.episodes,
            "steps": self.steps,
            "muscles": self.muscles.len(),
        })
    }
}

/// The chosen episodes of one policy in one task.
#[derive(Debug, Clone)]
pub(super) struct Chosen<'a> {
    policy: &'a str,
    recording: &'a Recording,
    episodes: Vec<&'a Episode>,
}

impl<'a> Chosen<'a> {
    pub(super) fn of(
        policy: &'a str,
        recording: &'a Recording,
        choice: EpisodeChoice,
    ) -> Result<Self, ExperimentError> {
        let all = recording.episodes.iter();
        let task = || recording.about.task.clone();
        let episodes: Vec<&Episode> = match choice {
            EpisodeChoice::Exactly(_) => all.collect(),
            EpisodeChoice::Successful(count) => {
                let solved = recording.place(names::SOLVED).ok_or_else(|| {
                    let (channel, policy) = (names::SOLVED, policy.to_owned());
                    ExperimentError::NoChannel { channel, policy, task: task() }
                })?;
                let succeeded = |e: &&Episode| e.samples[solved].values().any(|x| x > 0.0);
                all.filter(succeeded).take(count).collect()
            }
        };
        let (policy_name, found) = (policy.to_owned(), episodes.len());
        match choice {
            EpisodeChoice::Exactly(expected) if found != expected => {
                Err(ExperimentError::EpisodeCount {
                    policy: policy_name,
                    task: task(),
                    expected,
                    found,
                })
            }
            EpisodeChoice::Successful(expected) if found < expected => {
                Err(ExperimentError::SuccessCount {
                    policy: policy_name,
                    task: task(),
                    expected,
                    found,
                })
            }
            _ => Ok(Self { policy, recording, episodes }),
        }
    }

    /// Values of `channel`, row-major with one row per step, all finite; and the names of its columns.
    pub(super) fn values(
        &self,
        channel: &'static str,
    ) -> Result<(Vec<f64>, Vec<String>), ExperimentError> {
        let (policy, task) = (|| self.policy.to_owned(), || self.recording.about.task.clone());
        let place = self.recording.place(channel).ok_or_else(|| ExperimentError::NoChannel {
            channel,
            policy: policy(),
            task: task(),
        })?;
        let elements = &self.recording.channels[place].elements;
        let mut values = Vec::new();
        for episode in &self.episodes {
            let start = values.len();
            values.extend(episode.samples[place].values());
            Rows::new(&values[start..], elements.len()).map_err(|source| {
                ExperimentError::Signal {
                    channel,
                    policy: policy(),
                    task: task(),
                    episode: episode.facts.number,
                    source,
                }
            })?;
        }
        Ok((values, elements.iter().map(|element| element.name.clone()).collect()))
    }

    /// Whether the recording has `channel`.
    pub(super) fn has(&self, channel: &str) -> bool {
        self.recording.place(channel).is_some()
    }

    /// What this is, of so many `muscles`.
    pub(super) fn take(&self, muscles: Vec<String>) -> Take {
        let about = &self.recording.about;
        Take {
            policy: self.policy.to_owned(),
            task: about.task.clone(),
            actions: about
                .deterministic
                .map_or("", |mean| if mean { "deterministic" } else { "stochastic" }),
            control_interval: tasks::find(&about.task)
                .map_or(about.control_interval, |task| Some(task.control_interval())),
            episodes: self.episodes.len(),
            steps: self.episodes.iter().map(|episode| episode.facts.length).sum(),
            muscles,
        }
    }
}

/// Names of the columns of row-major `values` that never change.
pub(super) fn constant_columns(values: &[f64], names: &[String]) -> Vec<String> {
    let Some(first) = values.get(..names.len()) else { return Vec::new() };
    let mut constant = vec![true; names.len()];
    for row in values.chunks_exact(names.len().max(1)) {
        for ((constant, value), first) in constant.iter_mut().zip(row).zip(first) {
            *constant &= value.to_bits() == first.to_bits();
        }
    }
    let pairs = names.iter().zip(constant);
    pairs.filter(|(_, constant)| *constant).map(|(name, _)| name.clone()).collect()
}

/// A warning where recordings differ in their rate; rows are taken step by step, whatever time lies between them.
pub(super) fn rates_warning(takes: &[&Take]) -> Option<String> {
    let mut rates: Vec<f64> =
        takes.iter().filter_map(|take| take.control_interval).map(|step| 1.0 / step).collect();
    rates.sort_by(f64::total_cmp);
    rates.dedup_by(|a, b| (*a - *b).abs() < 1e-6 * *b);
    let words: Vec<String> = rates.iter().map(|rate| format!("{rate:.4}")).collect();
    let words: Vec<&str> =
        words.iter().map(|word| word.trim_end_matches('0').trim_end_matches('.')).collect();
    (rates.len() > 1).then(|| {
        format!("control rates differ ({} Hz); every step counts as one row", words.join(", "))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_that_never_change_are_named() {
        let names = ["a", "b"].map(str::to_owned);
        assert_eq!(constant_columns(&[1.0, 2.0, 1.0, 3.0], &names), ["a"]);
        assert!(constant_columns(&[], &names).is_empty());
        assert!(constant_columns(&[], &[]).is_empty());
    }

    #[test]
    fn different_rates_are_said_once_each() {
        let take = |step: Option<f64>| Take {
            policy: String::new(),
            task: String::new(),
            actions: "",
            control_interval: step,
            episodes: 1,
            steps: 1,
            muscles: Vec::new(),
        };
        let takes = [Some(0.01), Some(0.025), None, Some(0.01)].map(take);
        let warning = rates_warning(&takes.each_ref()).unwrap();
        assert!(warning.contains("(40, 100 Hz)"), "{warning}");
        assert_eq!(rates_warning(&[&takes[0], &takes[3], &takes[2]]), None);
    }
}

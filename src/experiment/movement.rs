//! Movements: of a recording, the two channels that the analyses of smoothness and of joint angles look at.
//!
//! Actions are those that were sent to the body. Of the joints those that turn are kept: an angle and a length have no
//! common scale. Files that do not tell the unit hold the hand, whose joints all turn.

use crate::analysis::signal::{Rows, SignalError};
use crate::record::{Recording, Samples, names};
use crate::sim::tasks;
use crate::units::Seconds;

use super::ExperimentError;

/// One episode, executed steps only.
#[derive(Debug, Clone, PartialEq)]
pub struct Movement {
    /// Number of the attempt.
    pub number: u64,
    actions: Vec<f64>,
    angles: Vec<f64>,
}

/// The episodes of one policy in one task.
#[derive(Debug, Clone, PartialEq)]
pub struct Movements {
    pub policy: String,
    pub task: String,
    /// Whether the mean action was played; `None`: the file does not say.
    pub deterministic: Option<bool>,
    /// Control step: the task's, else what the file says. Upstream's exports do not tell the truth here.
    pub control_interval: Option<Seconds>,
    /// Steps in which the physics diverged, as far as it was recorded.
    pub diverged_steps: usize,
    pub muscles: usize,
    pub joints: usize,
    pub episodes: Vec<Movement>,
}

impl Movements {
    /// The movements in `recording`, of a policy that is called `policy` from here on.
    pub fn of(policy: &str, recording: &Recording) -> Result<Self, ExperimentError> {
        let task = &recording.about.task;
        let place = |channel: &'static str| {
            recording.place(channel).ok_or_else(|| ExperimentError::NoChannel {
                channel,
                policy: policy.to_owned(),
                task: task.clone(),
            })
        };
        let (action, joint) = (place(names::ACTION)?, place(names::JOINT)?);
        let turning: Vec<bool> =
            recording.channels[joint].elements.iter().map(|e| e.unit != "m").collect();
        let episodes = recording.episodes.iter().map(|episode| Movement {
            number: episode.facts.number,
            actions: episode.samples[action].values().collect(),
            angles: columns(&episode.samples[joint], &turning),
        });
        let diverged = recording.episodes.iter().filter_map(|e| e.facts.diverged_steps);
        Ok(Self {
            policy: policy.to_owned(),
            task: task.clone(),
            deterministic: recording.about.deterministic,
            control_interval: tasks::find(task)
                .map_or(recording.about.control_interval, |task| Some(task.control_interval())),
            diverged_steps: diverged.sum(),
            muscles: recording.channels[action].width(),
            joints: turning.iter().filter(|&&turns| turns).count(),
            episodes: episodes.collect(),
        })
    }

    /// How actions were chosen, in a word; nothing if the file does not say.
    #[must_use]
    pub fn actions_word(&self) -> &'static str {
        self.deterministic.map_or("", |mean| if mean { "deterministic" } else { "stochastic" })
    }

    /// What was sent to the body in `episode`: steps × muscles.
    pub fn actions<'a>(&self, episode: &'a Movement) -> Result<Rows<'a>, ExperimentError> {
        Rows::new(&episode.actions, self.muscles)
            .map_err(|source| self.unusable(names::ACTION, episode, source))
    }

    /// Joint angles in `episode`, rad: steps × joints.
    pub fn angles<'a>(&self, episode: &'a Movement) -> Result<Rows<'a>, ExperimentError> {
        Rows::new(&episode.angles, self.joints)
            .map_err(|source| self.unusable(names::JOINT, episode, source))
    }

    fn unusable(
        &self,
        channel: &'static str,
        episode: &Movement,
        source: SignalError,
    ) -> ExperimentError {
        ExperimentError::Signal {
            channel,
            policy: self.policy.clone(),
            task: self.task.clone(),
            episode: episode.number,
            source,
        }
    }
}

/// The columns of row-major `samples` that are `kept`.
fn columns(samples: &Samples, kept: &[bool]) -> Vec<f64> {
    let cells = samples.values().zip(kept.iter().cycle());
    cells.filter_map(|(value, &kept)| kept.then_some(value)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::{About, Channel, Element, Episode, EpisodeFacts, Precision};

    fn recording(joints: Vec<f64>) -> Recording {
        let element =
            |name: &str, unit: &str| Element { name: name.to_owned(), unit: unit.to_owned() };
        let joint = Channel {
            elements: vec![element("knee", "rad"), element("slide", "m"), element("hip", "rad")],
            ..Channel::new(names::JOINT, "", ["a"], Precision::Double, None)
        };
        let facts = EpisodeFacts {
            number: 7,
            length: 2,
            seeds: None,
            terminated: None,
            diverged_steps: Some(3),
        };
        Recording {
            about: About {
                task: "pen".to_owned(),
                control_interval: Some(0.02),
                ..About::default()
            },
            channels: vec![joint, Channel::new(names::ACTION, "", ["m"], Precision::Single, None)],
            episodes: vec![Episode {
                facts,
                samples: vec![Samples::Double(joints), Samples::Single(vec![0.5, -0.5])],
            }],
        }
    }

    #[test]
    fn joints_that_slide_are_left_out_and_the_task_knows_its_own_step() {
        let found = Movements::of("obc", &recording(vec![1.0, 2.0, 3.0, 4.0, 5.0, 6.0])).unwrap();
        assert_eq!((found.joints, found.muscles, found.diverged_steps), (2, 1, 3));
        let episode = &found.episodes[0];
        assert_eq!(found.angles(episode).unwrap().values(), [1.0, 3.0, 4.0, 6.0]);
        assert_eq!(found.actions(episode).unwrap().values(), [0.5, -0.5]);
        // The file says 20 ms, as old exports do whatever the task.
        assert_eq!(found.control_interval, Some(0.01));
    }

    #[test]
    fn a_missing_channel_and_an_undefined_angle_are_named() {
        let mut without = recording(vec![0.0; 6]);
        without.retain_channels(|channel| channel.name != names::JOINT);
        let error = Movements::of("obc", &without).unwrap_err().to_string();
        assert_eq!(error, "the recording of `obc` in `pen` has no channel `joint`");
        let found = Movements::of("obc", &recording(vec![f64::NAN; 6])).unwrap();
        let error = found.angles(&found.episodes[0]).unwrap_err().to_string();
        assert!(error.contains("`joint` of episode 7 of `obc` in `pen`"), "{error}");
    }
}

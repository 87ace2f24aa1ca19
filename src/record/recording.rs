//! A recording: many episodes of one policy on one task, whatever file they come from or go to.
//!
//! A recording has a list of [`Channel`]s, which say what is in a column and in which unit, and a list of [`Episode`]s,
//! each with one array per channel: row-major, one row per executed step, one column per element. Nothing is padded: an
//! episode's arrays have exactly its number of steps.
//!
//! The channels that `rollout` writes, and the names the upstream formats are translated to (`spec/analysis.md` §0.3, §16),
//! are the constants in [`names`].

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use crate::units::Seconds;

use super::RecordError;

/// Names of channels.
pub mod names {
    /// Mean of the policy's distribution, before sampling and clipping.
    pub const ACTION_MEAN: &str = "action_mean";
    /// What was sent to the body.
    pub const ACTION: &str = "action";
    /// Muscle excitation, 0..1: the action after the actuator's sigmoid.
    pub const EXCITATION: &str = "excitation";
    /// Muscle state, 0..1.
    pub const ACTIVATION: &str = "activation";
    /// Joint positions.
    pub const JOINT: &str = "joint";
    /// Joint velocities.
    pub const JOINT_VELOCITY: &str = "joint_velocity";
    /// Whether the step counts as solved.
    pub const SOLVED: &str = "solved";
    /// Reward of the step.
    pub const REWARD: &str = "reward";
    /// What the reward is a weighted sum of.
    pub const REWARD_COMPONENT: &str = "reward_component";
    /// Touch forces: right foot, right toes, left foot, left toes.
    pub const FOOT_CONTACT: &str = "foot_contact";
    /// Velocity of the root along its heading, across it, and upwards.
    pub const ROOT_VELOCITY: &str = "root_velocity";
    /// Heading of the root in the plane.
    pub const ROOT_YAW: &str = "root_yaw";
    /// What the policy saw, newest frame, not standardised.
    pub const OBSERVATION: &str = "observation";

    /// What the compact HDF5 layout of upstream calls our channels, where it has them.
    pub(in super::super) const UPSTREAM: [(&str, &str); 7] = [
        (ACTION, "actions"),
        (ACTION_MEAN, "action_means"),
        (JOINT, "joint_positions"),
        (REWARD, "rewards"),
        (SOLVED, "solved"),
        (EXCITATION, "muscle_controls"),
        (ACTIVATION, "muscle_activations"),
    ];

    /// Our name for what upstream calls `name`, or `name` itself.
    #[must_use]
    pub fn of_upstream(name: &str) -> &str {
        UPSTREAM.iter().find(|(_, theirs)| *theirs == name).map_or(name, |(ours, _)| ours)
    }

    /// Upstream's name for our channel `name`, or `name` itself.
    #[must_use]
    pub fn to_upstream(name: &str) -> &str {
        UPSTREAM.iter().find(|(ours, _)| *ours == name).map_or(name, |(_, theirs)| theirs)
    }

    /// Elements of [`FOOT_CONTACT`].
    pub const FEET: [&str; 4] = ["right_foot", "right_toes", "left_foot", "left_toes"];
    /// Elements of [`ROOT_VELOCITY`].
    pub const HEADING_AXES: [&str; 3] = ["forward", "left", "up"];
}

/// Whether a value was taken before or after the physics of its step.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Timing {
    BeforeStep,
    AfterStep,
}

impl Timing {
    /// `before_step` or `after_step`, as the upstream formats spell it.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::BeforeStep => "before_step",
            Self::AfterStep => "after_step",
        }
    }

    /// What [`Timing::word`] gave.
    #[must_use]
    pub fn of_word(word: &str) -> Option<Self> {
        [Self::BeforeStep, Self::AfterStep].into_iter().find(|timing| timing.word() == word)
    }
}

/// How the values of a channel are stored. Formats keep it, so that nothing is rounded on the way.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Precision {
    Single,
    Double,
    Flag,
}

/// One column of a channel.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Element {
    /// A muscle, a joint, an axis; empty if the channel is a single number.
    pub name: String,
    /// Unit; empty if there is none.
    pub unit: String,
}

/// A quantity recorded at every step.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Channel {
    /// One of [`names`], or what a file calls it.
    pub name: String,
    /// `None`: the file does not say.
    pub timing: Option<Timing>,
    pub precision: Precision,
    pub elements: Vec<Element>,
}

impl Channel {
    /// A channel of several elements with one unit.
    pub fn new<N: Into<String>>(
        name: &str,
        unit: &str,
        elements: impl IntoIterator<Item = N>,
        precision: Precision,
        timing: Option<Timing>,
    ) -> Self {
        let element = |element: N| Element { name: element.into(), unit: unit.to_owned() };
        let elements = elements.into_iter().map(element).collect();
        Self { name: name.to_owned(), timing, precision, elements }
    }

    /// A channel that is one number per step.
    #[must_use]
    pub fn scalar(name: &str, precision: Precision, timing: Option<Timing>) -> Self {
        Self::new(name, "", [""], precision, timing)
    }

    /// Number of elements.
    #[must_use]
    pub fn width(&self) -> usize {
        self.elements.len()
    }

    /// Whether this is one number without a name of its own.
    #[must_use]
    pub fn is_scalar(&self) -> bool {
        matches!(self.elements.as_slice(), [element] if element.name.is_empty())
    }

    /// The name of an element's column in a table: `activation.ECRL`, or `reward`.
    #[must_use]
    pub fn column_name(&self, element: &Element) -> String {
        if self.is_scalar() { self.name.clone() } else { format!("{}.{}", self.name, element.name) }
    }

    /// The units of all elements, each said once.
    #[must_use]
    pub fn units(&self) -> Vec<&str> {
        let mut units: Vec<&str> = Vec::new();
        for element in &self.elements {
            if !element.unit.is_empty() && !units.contains(&element.unit.as_str()) {
                units.push(&element.unit);
            }
        }
        units
    }
}

/// The values of a channel in one episode, row-major with one row per step. Undefined numbers are NaN.
#[derive(Debug, Clone, PartialEq)]
pub enum Samples {
    Single(Vec<f32>),
    Double(Vec<f64>),
    Flag(Vec<bool>),
}

impl Samples {
    /// No values yet, with room for `count`.
    #[must_use]
    pub fn with_capacity(precision: Precision, count: usize) -> Self {
        match precision {
            Precision::Single => Self::Single(Vec::with_capacity(count)),
            Precision::Double => Self::Double(Vec::with_capacity(count)),
            Precision::Flag => Self::Flag(Vec::with_capacity(count)),
        }
    }

    /// Takes memory for `count` more values.
    pub fn reserve(&mut self, count: usize) {
        match self {
            Self::Single(values) => values.reserve(count),
            Self::Double(values) => values.reserve(count),
            Self::Flag(values) => values.reserve(count),
        }
    }

    /// Number of values.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Single(values) => values.len(),
            Self::Double(values) => values.len(),
            Self::Flag(values) => values.len(),
        }
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// How they are stored.
    #[must_use]
    pub fn precision(&self) -> Precision {
        match self {
            Self::Single(_) => Precision::Single,
            Self::Double(_) => Precision::Double,
            Self::Flag(_) => Precision::Flag,
        }
    }

    /// The value at `place`; flags are 0 and 1.
    #[must_use]
    pub fn value(&self, place: usize) -> f64 {
        match self {
            Self::Single(values) => f64::from(values[place]),
            Self::Double(values) => values[place],
            Self::Flag(values) => f64::from(u8::from(values[place])),
        }
    }

    /// All values, in order.
    pub fn values(&self) -> impl Iterator<Item = f64> {
        (0..self.len()).map(|place| self.value(place))
    }
}

/// The seeds an episode of this program was drawn from, as hexadecimal digits.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Seeds {
    /// Goal and initial state.
    pub start: String,
    /// Sampled actions and action noise.
    pub actions: String,
}

/// What is known of an episode as a whole.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct EpisodeFacts {
    /// Number of the attempt; numbers may be missing in between.
    pub number: u64,
    /// Executed steps.
    pub length: usize,
    pub seeds: Option<Seeds>,
    /// The task ended it, before the time limit.
    pub terminated: Option<bool>,
    /// Steps in which the physics diverged and was reset.
    pub diverged_steps: Option<usize>,
}

/// One episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    pub facts: EpisodeFacts,
    /// One array per channel of the recording, in their order.
    pub samples: Vec<Samples>,
}

/// What is known of a recording as a whole.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct About {
    /// Code name of the task.
    pub task: String,
    pub policy: String,
    /// `hand`, `arm`, `elbow`, `legs`; `None`: the file does not say.
    pub body: Option<String>,
    /// Control step.
    pub control_interval: Option<Seconds>,
    /// Steps after which an episode is cut off.
    pub horizon: Option<usize>,
    /// Seed of the recording.
    pub seed: Option<i64>,
    /// Whether the mean action was played.
    pub deterministic: Option<bool>,
    /// Everything else: provenance, the plan, attributes of the file it was read from.
    pub metadata: BTreeMap<String, String>,
}

/// Many episodes of one policy on one task.
#[derive(Debug, Clone, PartialEq)]
pub struct Recording {
    pub about: About,
    pub channels: Vec<Channel>,
    pub episodes: Vec<Episode>,
}

/// A channel of all episodes, one below the other.
#[derive(Debug, Clone, PartialEq)]
pub struct Stacked {
    /// Row-major: rows are steps, columns are elements.
    pub values: Vec<f64>,
    /// Steps of all episodes together.
    pub rows: usize,
    pub columns: usize,
}

impl Recording {
    /// Where the channel `name` stands in every episode's list.
    #[must_use]
    pub fn place(&self, name: &str) -> Option<usize> {
        self.channels.iter().position(|channel| channel.name == name)
    }

    /// The channel `name`.
    #[must_use]
    pub fn channel(&self, name: &str) -> Option<&Channel> {
        self.channels.iter().find(|channel| channel.name == name)
    }

    /// The channel `name` of one episode.
    #[must_use]
    pub fn samples<'a>(&self, episode: &'a Episode, name: &str) -> Option<&'a Samples> {
        self.place(name).and_then(|place| episode.samples.get(place))
    }

    /// The channel `name` of all episodes, one below the other, in their order.
    #[must_use]
    pub fn stacked(&self, name: &str) -> Option<Stacked> {
        let place = self.place(name)?;
        let (rows, columns) = (self.step_count(), self.channels[place].width());
        let mut values = Vec::with_capacity(rows * columns);
        for episode in &self.episodes {
            values.extend(episode.samples[place].values());
        }
        Some(Stacked { values, rows, columns })
    }

    /// Steps of all episodes together.
    #[must_use]
    pub fn step_count(&self) -> usize {
        self.episodes.iter().map(|episode| episode.facts.length).sum()
    }

    /// Sum of an episode's values of a channel of one number per step.
    #[must_use]
    pub fn total(&self, episode: &Episode, name: &str) -> Option<f64> {
        self.samples(episode, name).map(|samples| samples.values().sum())
    }

    /// Keeps only the channels for which `keep` holds and returns the names of the others.
    pub fn retain_channels(&mut self, keep: impl Fn(&Channel) -> bool) -> Vec<String> {
        let kept: Vec<bool> = self.channels.iter().map(keep).collect();
        let mut dropped = Vec::new();
        let mut place = 0;
        self.channels.retain(|channel| {
            let keep = kept[place];
            place += 1;
            if !keep {
                dropped.push(channel.name.clone());
            }
            keep
        });
        for episode in &mut self.episodes {
            let mut kept = kept.iter();
            episode.samples.retain(|_| kept.next() == Some(&true));
        }
        dropped
    }

    /// Says whether every episode has an array of the right kind and length for every channel, and whether names are
    /// unique. Readers and writers ask before they believe a recording.
    pub fn check(&self) -> Result<(), RecordError> {
        let wrong = |what: String| Err(RecordError::Inconsistent { what });
        for (place, channel) in self.channels.iter().enumerate() {
            if self.place(&channel.name) != Some(place) {
                return wrong(format!("there are two channels called `{}`", channel.name));
            }
            let mut elements: Vec<&str> =
                channel.elements.iter().map(|e| e.name.as_str()).collect();
            elements.sort_unstable();
            if let Some(twice) = elements.windows(2).find(|pair| pair[0] == pair[1]) {
                let (name, twice) = (&channel.name, twice[0]);
                return wrong(format!("channel `{name}` has two elements called `{twice}`"));
            }
        }
        let mut numbers: Vec<u64> = self.episodes.iter().map(|e| e.facts.number).collect();
        numbers.sort_unstable();
        if let Some([twice, _]) = numbers.array_windows::<2>().find(|[a, b]| a == b) {
            return wrong(format!("there are two episodes with the number {twice}"));
        }
        for episode in &self.episodes {
            let EpisodeFacts { number, length, .. } = episode.facts;
            if episode.samples.len() != self.channels.len() {
                let (found, expected) = (episode.samples.len(), self.channels.len());
                return wrong(format!("episode {number} has {found} arrays, expected {expected}"));
            }
            for (channel, samples) in self.channels.iter().zip(&episode.samples) {
                let (name, found, width) = (&channel.name, samples.len(), channel.width());
                if length.checked_mul(width) != Some(found) {
                    return wrong(format!(
                        "`{name}` of episode {number} has {found} values, expected {length} × {width}"
                    ));
                }
                if samples.precision() != channel.precision {
                    return wrong(format!(
                        "`{name}` of episode {number} has another type of number"
                    ));
                }
            }
        }
        Ok(())
    }
}

#[cfg(test)]
pub(crate) mod testing {
    use super::*;

    /// A recording of two episodes with every kind of channel, and numbers that are hard to keep.
    pub(crate) fn recording() -> Recording {
        let muscles = ["ECRL", "ECRB", "FCU"];
        let before = Some(Timing::BeforeStep);
        let channels = vec![
            Channel::new(names::ACTION, "", muscles, Precision::Single, before),
            Channel::new(names::ACTION_MEAN, "", muscles, Precision::Single, before),
            Channel::new(names::JOINT, "rad", ["flexion"], Precision::Double, before),
            Channel::scalar(names::REWARD, Precision::Double, Some(Timing::AfterStep)),
            Channel::scalar(names::SOLVED, Precision::Flag, Some(Timing::AfterStep)),
        ];
        let hard = [0.1, -0.0, 5e-324, 1e300, 1.0 / 3.0, f64::NAN, 2.0, -7.25];
        let episode = |number: u64, length: usize| {
            let single = |shift: usize| {
                (0..3 * length).map(|i| hard[(i + shift) % 8] as f32).map(finite).collect()
            };
            let double = |shift: usize| (0..length).map(|i| hard[(i + shift) % 8]).collect();
            let samples = vec![
                Samples::Single(single(0)),
                Samples::Single(single(1)),
                Samples::Double(double(number as usize)),
                Samples::Double(double(3)),
                Samples::Flag((0..length).map(|i| i % 3 == 0).collect()),
            ];
            let seeds = Seeds { start: format!("{number:064x}"), actions: "ab".repeat(32) };
            Episode {
                facts: EpisodeFacts {
                    number,
                    length,
                    seeds: Some(seeds),
                    terminated: Some(number == 2),
                    diverged_steps: Some(1),
                },
                samples,
            }
        };
        Recording {
            about: About {
                task: "pen".to_owned(),
                policy: "arnold/seed_0".to_owned(),
                body: Some("hand".to_owned()),
                control_interval: Some(0.01),
                horizon: Some(100),
                seed: Some(7),
                deterministic: Some(false),
                metadata: BTreeMap::from([
                    ("key".to_owned(), "ü \"b\"".to_owned()),
                    ("program".to_owned(), "arnold-analyze".to_owned()),
                ]),
            },
            channels,
            episodes: vec![episode(2, 5), episode(10, 9)],
        }
    }

    fn finite(value: f32) -> f32 {
        if value.is_infinite() { f32::MAX } else { value }
    }

    /// Whether two recordings hold the same bits; `==` calls NaN different from itself.
    #[cfg(any(feature = "parquet", feature = "mcap", feature = "hdf5"))]
    pub(crate) fn assert_same(found: &Recording, want: &Recording) {
        assert_eq!(found.about, want.about);
        assert_eq!(found.channels, want.channels);
        assert_eq!(found.episodes.len(), want.episodes.len());
        for (found, want) in found.episodes.iter().zip(&want.episodes) {
            assert_eq!(found.facts, want.facts);
            for (found, want) in found.samples.iter().zip(&want.samples) {
                assert_eq!(found.precision(), want.precision());
                let bits =
                    |samples: &Samples| samples.values().map(f64::to_bits).collect::<Vec<_>>();
                assert_eq!(bits(found), bits(want));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::testing::recording;
    use super::*;

    #[test]
    fn episodes_are_stacked_in_their_order() {
        let recording = recording();
        recording.check().unwrap();
        let stacked = recording.stacked(names::ACTION).unwrap();
        assert_eq!((stacked.rows, stacked.columns, stacked.values.len()), (14, 3, 42));
        assert_eq!(
            stacked.values[15].to_bits(),
            recording.episodes[1].samples[0].value(0).to_bits()
        );
        assert!(recording.stacked("torque").is_none());
    }

    #[test]
    fn an_array_that_does_not_fit_its_channel_is_named() {
        let mut wrong = recording();
        wrong.episodes[1].samples[3] = Samples::Double(vec![0.0; 4]);
        let error = wrong.check().unwrap_err().to_string();
        assert_eq!(error, "`reward` of episode 10 has 4 values, expected 9 × 1");
        wrong = recording();
        wrong.episodes[1].facts.number = 2;
        assert!(wrong.check().unwrap_err().to_string().contains("two episodes with the number 2"));
    }

    #[test]
    fn a_dropped_channel_is_dropped_in_every_episode() {
        let mut recording = recording();
        let dropped = recording.retain_channels(|channel| channel.name != names::JOINT);
        assert_eq!(dropped, [names::JOINT]);
        recording.check().unwrap();
        assert_eq!(recording.total(&recording.episodes[0], names::SOLVED), Some(2.0));
    }
}

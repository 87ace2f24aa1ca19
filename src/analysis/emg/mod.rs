//! Walking muscle activity against human electromyograms (EMG).
//!
//! A recording is cut into gait cycles ([`segment`]), the kept cycles are averaged ([`CycleProfile`]), and the profile
//! of each muscle is correlated with that of nine people ([`correlate`]). How well people agree with each other is the
//! ceiling ([`leave_one_out`]).

mod channels;
mod comparison;
mod correlation;
mod gait;
mod human;
mod muscles;
mod profile;
mod traces;

pub use channels::{ChannelFault, Fault, channel_faults, faulty_muscles};
pub use comparison::{
    ComparisonRow, CorrelationRow, CycleRow, SubjectRow, comparisons, correlation_rows, cycle_rows,
    subject_rows,
};
pub use correlation::{
    Correlations, PairwiseCorrelations, correlate, leave_one_out, pairwise, timing,
};
pub use gait::{
    ContactSensors, Cycle, EpisodeStrikes, GaitEpisode, GaitOptions, PercentileScope, Segmentation,
    Verdict, forward_velocity, segment,
};
pub use human::{HumanProfiles, SubjectTable};
pub use muscles::{BicepsFemoris, HUMAN_CHANNELS, Side, columns_named, model_muscles};
pub use profile::{CycleProfile, cycle_profile};
pub use traces::{MuscleTrace, Trace, muscle_trace, relative_to_maximum};

use super::signal::SignalError;
use crate::units::Hertz;

/// Why walking cannot be compared with people.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EmgError {
    #[error(transparent)]
    Signal(#[from] SignalError),
    #[error("the option `{name}` is {value}, expected {expected}")]
    Option { name: &'static str, value: f64, expected: &'static str },
    #[error("{expected} foot contacts are expected per row, found {found} in episode {episode}")]
    ContactCount { episode: usize, expected: usize, found: usize },
    #[error("episode {episode} has {found} rows of {what}, expected {expected}")]
    RowCount { episode: usize, what: &'static str, expected: usize, found: usize },
    #[error("{found} tables of activations for {expected} episodes")]
    EpisodeCount { expected: usize, found: usize },
    #[error("episode {episode} is sampled at {found} Hz, the first at {expected} Hz")]
    MixedRates { episode: usize, expected: Hertz, found: Hertz },
    #[error("no gait cycle was kept of {detected} detected")]
    NoCycle { detected: usize },
    #[error("there is no muscle `{name}` among the {available} recorded")]
    MissingMuscle { name: String, available: usize },
    #[error("column {column} of the human data is `{found}`, expected `{expected}`")]
    Label { column: usize, expected: String, found: String },
    #[error("expected {expected} columns, found {found} in the data of subject {subject}")]
    ColumnCount { subject: u32, expected: usize, found: usize },
    #[error("subject {subject} has {found} points per cycle, the first has {expected}")]
    PointCount { subject: u32, expected: usize, found: usize },
    #[error("subject {subject} appears twice")]
    RepeatedSubject { subject: u32 },
    #[error("expected at least {needed} subjects, found {found}")]
    TooFewSubjects { needed: usize, found: usize },
    #[error("expected {expected} subject means for `{policy}`, found {found}")]
    SubjectCount { policy: String, expected: usize, found: usize },
}

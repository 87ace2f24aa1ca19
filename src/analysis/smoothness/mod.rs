//! How smoothly a policy moves: four numbers for an episode, compared between policies over tasks.
//!
//! | metric | of | smoother |
//! | --- | --- | --- |
//! | [`mean_action_change`] | muscle commands | lower |
//! | [`SpectralArcLength`] | speed of all joints together | higher |
//! | [`DimensionlessJerk`] | each joint's angle | higher |
//! | [`VelocityPeaks`] | each joint's speed | lower |
//!
//! All four count time in steps, as the authors do: differences are not divided by the control step. So none has a
//! unit of time, and tasks with other control steps can stand side by side.
//!
//! [`SmoothnessMeter`] computes all four of an episode; `tables` averages them and compares policies.

mod action_change;
mod dimensionless_jerk;
mod meter;
mod spectral_arc_length;
mod speed;
mod tables;
mod velocity_peaks;

pub use action_change::mean_action_change;
pub use dimensionless_jerk::{DimensionlessJerk, DimensionlessJerkOptions};
pub use meter::{Smoothness, SmoothnessMeter, SmoothnessOptions};
pub use spectral_arc_length::{SpectralArcLength, SpectralArcLengthOptions};
pub use speed::joint_space_speed;
pub use tables::{ComparisonRow, EpisodeRow, Metric, TaskRow, comparisons, task_row};
pub use velocity_peaks::{VelocityPeaks, VelocityPeaksOptions, local_maxima};

/// Episodes with fewer samples have no smoothness: the third difference needs four.
pub const FEWEST_SAMPLES: usize = 4;

/// Why smoothness cannot be measured, averaged or compared.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SmoothnessError {
    #[error("{actions} rows of actions, but {positions} rows of joint positions")]
    RowCount { actions: usize, positions: usize },
    #[error("the option `{name}` is {value}, expected {expected}")]
    Option { name: &'static str, value: f64, expected: &'static str },
    #[error("`{policy}` has {found} episodes of `{task}`, expected {expected}")]
    EpisodeCount { policy: String, task: String, expected: usize, found: usize },
    #[error("`{metric}` of episode {episode} of `{task}` is undefined for `{policy}`")]
    Undefined { metric: &'static str, policy: String, task: String, episode: u64 },
    #[error("`{policy}` has no mean `{metric}` for `{task}`")]
    MissingTask { metric: &'static str, policy: String, task: String },
}

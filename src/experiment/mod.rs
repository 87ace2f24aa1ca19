//! The lab bench: seeds, plans, provenance, and the sweeps made of them.
//!
//! Every sweep is a list of [`crate::sim::rollout::EpisodeSpec`]s, played by the one rollout loop, summarised by the
//! analyses, and written into one [`run_folder::RunFolder`].

pub mod csi;
pub mod emg;
mod emg_cohort;
mod emg_figures;
mod emg_report;
pub mod emg_subjects;
pub mod evaluation;
pub mod factors;
pub mod kinematics;
mod kinesis_walk;
pub mod movement;
pub mod recording;
pub mod run_folder;
pub mod seed;
pub mod smoothness;
pub mod throughput;
pub mod verify_traces;
pub mod walking;

use crate::analysis::signal::SignalError;
use crate::analysis::smoothness::SmoothnessError;
use crate::analysis::subspace::SubspaceError;
use crate::record::RecordError;
use crate::sim::rollout::RolloutError;

/// Why an experiment failed.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// Playing.
    #[error(transparent)]
    Rollout(#[from] RolloutError),
    /// Subspaces of a task's actions.
    #[error("the actions in `{task}` span no subspace: {source}")]
    Subspace {
        /// The task, or `pooled`.
        task: String,
        /// Why.
        source: SubspaceError,
    },
    /// A recording without what is to be analysed.
    #[error("the recording of `{policy}` in `{task}` has no channel `{channel}`")]
    NoChannel { channel: &'static str, policy: String, task: String },
    /// A channel that cannot be analysed.
    #[error("`{channel}` of episode {episode} of `{policy}` in `{task}`: {source}")]
    Signal {
        channel: &'static str,
        policy: String,
        task: String,
        episode: u64,
        source: SignalError,
    },
    /// A task of somebody else's, in a file that does not tell its rate.
    #[error("the control step of `{task}` is not known, nor told in the recording of `{policy}`")]
    NoControlInterval { policy: String, task: String },
    /// Joint angles without dimensions.
    #[error("the joint angles of `{policy}` in `{task}` have no dimensionality: {source}")]
    Kinematics { policy: String, task: String, source: SubspaceError },
    /// Too few or too many.
    #[error("`{policy}` has {found} episodes of `{task}`, expected {expected}")]
    EpisodeCount { policy: String, task: String, expected: usize, found: usize },
    /// Measuring smoothness.
    #[error(transparent)]
    Smoothness(#[from] SmoothnessError),
    /// Writing tables.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Writing files.
    #[error(transparent)]
    File(#[from] crate::files::FileError),
    /// Gait cycles of a walk.
    #[error(transparent)]
    Walk(#[from] walking::WalkError),
    /// Drawing.
    #[error(transparent)]
    Figure(#[from] crate::figure::FigureError),
}

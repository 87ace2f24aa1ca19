//! The lab bench: seeds, plans, provenance, and the sweeps made of them.
//!
//! Every sweep is a [`plan::Plan`]: an exact list of episodes. [`worker`]s play them with the one rollout loop and enter
//! them into [`ledger`]s; [`gather`] puts them together, the analyses summarise them, and the results are written into one
//! [`run_folder::RunFolder`].

pub mod benchmarks;
pub mod book;
pub mod csi;
pub mod emg;
mod emg_cohort;
mod emg_figures;
mod emg_report;
pub mod emg_subjects;
pub mod evaluation;
pub mod factors;
pub mod finished_runs;
pub mod gallery;
pub mod gather;
pub mod hypothesis;
pub mod kinematics;
mod kinesis_walk;
pub mod learning_curves;
pub mod ledger;
pub mod movement;
pub mod muscle_signal;
pub mod paper_index;
mod parallel;
pub mod payload;
pub mod plan;
pub mod published_curves;
pub mod recording;
pub mod report;
pub mod run_folder;
pub mod seed;
pub mod slurm;
pub mod smoothness;
pub mod status;
pub mod subspaces;
pub mod synergies;
pub mod throughput;
pub mod verify_traces;
#[cfg(feature = "view")]
pub mod viewing;
pub mod walking;
pub mod worker;

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
    /// Somebody asked to stop.
    #[error("stopped")]
    Stopped,
    /// Planning, and putting together.
    #[error(transparent)]
    Sweep(#[from] gather::SweepError),
    /// Subspaces of a task's actions.
    #[error("the actions in `{task}` span no subspace: {source}")]
    Subspace {
        /// The task, or `pooled`.
        task: String,
        /// Why.
        source: SubspaceError,
    },
    /// Actions without directions.
    #[error("the actions of `{policy}` in `{task}` span no subspace: {source}")]
    Actions { policy: String, task: String, source: SubspaceError },
    /// Controls without synergies.
    #[error("the muscle controls of `{policy}` in `{task}` have no synergies: {source}")]
    Controls { policy: String, task: String, source: SubspaceError },
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
    /// Fewer successes than asked for.
    #[error("`{policy}` solved `{task}` in {found} episodes, expected {expected}")]
    SuccessCount { policy: String, task: String, expected: usize, found: usize },
    /// Bodies that cannot be compared.
    #[error("`{policy}` in `{task}` has {found} muscles, but {other} has {expected}")]
    Muscles { policy: String, task: String, other: String, expected: usize, found: usize },
    /// The same number of muscles under other names.
    #[error(
        "muscle {place} of `{policy}` in `{task}` is `{found}`, but in {other} it is `{expected}`"
    )]
    MuscleNames {
        policy: String,
        task: String,
        other: String,
        place: usize,
        expected: Box<str>,
        found: Box<str>,
    },
    /// A comparison over tasks that misses one.
    #[error("there is nothing of `{policy}` in `{task}`, but of `{other}` there is")]
    MissingTask { policy: String, task: String, other: String },
    /// One policy in one task.
    #[error("`{policy}` in `{task}` alone cannot be compared with anything")]
    NothingToCompare { policy: String, task: String },
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

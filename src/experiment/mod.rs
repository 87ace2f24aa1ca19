//! The lab bench: seeds, plans, provenance, and the sweeps made of them.
//!
//! Every sweep is a list of [`crate::sim::rollout::EpisodeSpec`]s, played by the one rollout loop, summarised by the
//! analyses, and written into one [`run_folder::RunFolder`].

pub mod csi;
pub mod evaluation;
pub mod recording;
pub mod run_folder;
pub mod seed;
pub mod verify_traces;

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
    /// Writing tables.
    #[error(transparent)]
    Record(#[from] RecordError),
    /// Writing files.
    #[error(transparent)]
    File(#[from] crate::files::FileError),
    /// Drawing.
    #[error(transparent)]
    Figure(#[from] crate::figure::FigureError),
}

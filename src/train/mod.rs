//! The gym: from samples to better parameters (`spec/training.md` §5).
//!
//! * [`parameters`]: all numbers of a network in one row, under the names a checkpoint gives them, so that what is trained
//!   is what [`crate::policy`] reads back; [`initialisation`]: where they start.
//! * [`losses`]: what is wanted of them, for one sample at a time; [`distribution`]: the probabilities it is made of.
//! * [`tape`]: the operations of the transformer, each with its way back.
//! * [`network`]: the networks with their derivatives. [`Trainable`] is what all of them offer.
//! * [`shards`]: a minibatch is cut into parts that do not depend on the number of threads, and their gradients are added
//!   in order, so that the same bytes come out on any machine with the same vector instructions.
//! * [`adam`]: one step along the gradient.
//! * [`trainer`] learns from what the policy did last, [`soft`] from all that is remembered; [`learner`] is what a run of
//!   either can do.

pub mod adam;
pub mod advantages;
#[cfg(feature = "play")]
mod body;
#[cfg(feature = "play")]
mod checkpoints;
#[cfg(feature = "play")]
mod collector;
#[cfg(feature = "play")]
mod curves;
pub mod distribution;
#[cfg(feature = "play")]
mod evaluation;
pub mod initialisation;
#[cfg(feature = "play")]
pub mod learner;
pub mod losses;
pub mod network;
pub mod parameters;
#[cfg(feature = "play")]
pub mod plan;
#[cfg(feature = "play")]
pub mod recipe;
pub mod reward_normaliser;
#[cfg(feature = "play")]
pub mod run;
pub mod schedule;
pub mod shards;
#[cfg(feature = "play")]
pub mod soft;
#[cfg(feature = "play")]
pub mod start;
#[cfg(feature = "play")]
mod statistics;
pub mod streams;
#[cfg(feature = "play")]
mod students;
pub mod tape;
#[cfg(feature = "play")]
pub mod teacher;
#[cfg(feature = "play")]
pub mod trainer;

pub use losses::{Coefficients, ImitationLoss, Losses};
pub use network::{Decision, Player, Trainable};
pub use parameters::Parameters;

use std::path::PathBuf;

use crate::policy::PolicyError;

/// One step of one body, as the gradient needs it.
#[derive(Debug, Clone, Copy)]
pub struct Sample<'a> {
    /// Position of its task in the list that the network was made for; 0 if there is no such list.
    pub task: usize,
    /// Normalised observation. For a transformer: tokens × lags, oldest first, without padding.
    pub observation: &'a [f32],
    /// The action as it was drawn, before any clipping.
    pub action: &'a [f32],
    /// Logarithm of the density that `action` had when it was drawn.
    pub old_log_probability: f32,
    /// Advantage before standardisation.
    pub advantage: f32,
    /// What the value should have been: the λ-return.
    pub value_target: f32,
    /// The expert's action, one number for each muscle the body has. Entries of `action` beyond them are padding. Empty if
    /// nothing is imitated.
    pub expert_action: &'a [f32],
    /// Standard normal numbers for the action that is compared with the expert's, as many as
    /// [`Trainable::noise_length`] says. Empty if nothing is imitated, or not by an action.
    pub noise: &'a [f32],
}

/// Why a network cannot be trained.
#[derive(Debug, thiserror::Error)]
pub enum TrainError {
    #[error("a network cannot have {what}")]
    Sizes { what: String },
    #[error("sample {sample} has {found} numbers of {what} where the network needs {expected}")]
    Sample { what: &'static str, sample: usize, expected: usize, found: usize },
    #[error("sample {sample} is of task {task}, the network knows {known}")]
    UnknownTask { sample: usize, task: usize, known: usize },
    #[error("the {what} of this step is not finite")]
    NotFinite { what: &'static str },
    #[error("the stored {what} cannot belong to this run")]
    State { what: String },
    #[error("`{folder}` holds another run: its {what} is {found}, not {wanted}")]
    OtherRun { what: String, found: String, wanted: String, folder: PathBuf },
    #[error("{what}")]
    Plan { what: String },
    #[error(transparent)]
    File(#[from] crate::files::FileError),
    #[error(transparent)]
    Array(#[from] crate::npz::ArrayError),
    #[error(transparent)]
    Record(#[from] crate::record::RecordError),
    #[cfg(feature = "play")]
    #[error(transparent)]
    Engine(#[from] crate::sim::engine::EngineError),
    #[cfg(feature = "play")]
    #[error(transparent)]
    Rollout(#[from] crate::sim::rollout::RolloutError),
    #[error(transparent)]
    Policy(#[from] PolicyError),
}

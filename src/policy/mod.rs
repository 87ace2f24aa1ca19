//! The brains: from a checkpoint on disk to an action, without executing anything in the file.
//!
//! [`open`] reads a checkpoint and its normaliser and returns a [`Policy`]; bound to a task, it becomes an [`Actor`].

pub mod checkpoint;
mod history;
pub mod interface;
mod loading;
pub mod network;
mod normaliser;
pub mod policies;
pub mod verify;
pub mod vocabulary;

use std::path::PathBuf;

use crate::files::FileError;
use checkpoint::CheckpointError;
pub use interface::{Actor, ObservationVariant, Policy, TaskInterface};
pub use loading::{Loaded, load, open};

/// Why a policy cannot be read or played.
#[derive(Debug, thiserror::Error)]
pub enum PolicyError {
    /// The task's sizes are not those the policy was trained for.
    #[error("the policy expects {expected} {what}, task `{task}` has {found}")]
    DoesNotFit { what: &'static str, expected: usize, found: usize, task: String },
    #[error("the checkpoint has no tensor `{name}`")]
    MissingTensor { name: String },
    #[error("tensor `{name}` has shape {found:?}, expected {expected}")]
    TensorShape { name: String, expected: String, found: Vec<usize> },
    #[error("tensor `{name}` holds numbers that are not finite")]
    NotFinite { name: String },
    #[error("{heads} attention heads do not divide a width of {width}")]
    Heads { heads: usize, width: usize },
    #[error("a {format} policy needs the normaliser it was trained with, and there is none")]
    MissingNormaliser { format: &'static str },
    #[error("a {format} policy needs a normaliser {expected}, this one is {found}")]
    WrongNormaliser { format: &'static str, expected: &'static str, found: &'static str },
    #[error("the normaliser has {found} entries where the policy needs {expected}")]
    NormaliserLength { expected: usize, found: usize },
    #[error("the normaliser holds a mean, variance, count or limit that no statistics can have")]
    NormaliserValues,
    #[error("word {word} is not in the policy's vocabulary of {vocabulary} words")]
    UnknownWord { word: u16, vocabulary: usize },
    #[error("the vocabulary cannot be used: {what}")]
    Vocabulary { what: String },
    #[error("the checkpoint does not say {what}, which cannot be guessed")]
    Missing { what: &'static str },
    #[error("not supported: {what}")]
    Unsupported { what: String },
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error("{source}, in `{path}`")]
    InFile { source: Box<PolicyError>, path: PathBuf },
}

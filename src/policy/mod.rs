//! The brains: from a checkpoint on disk to an action, without executing anything in the file.
//!
//! [`open`] reads a checkpoint and its normaliser and returns a [`Policy`]; bound to a task, it becomes an [`Actor`].

mod agreement;
mod average;
pub mod checkpoint;
mod companions;
mod ensemble_folder;
pub mod expert_table;
mod experts;
pub mod export;
pub mod history;
pub mod interface;
mod loading;
pub mod network;
mod normaliser;
pub mod policies;
pub mod running_components;
pub mod running_statistics;
pub mod shelf;
mod speech;
mod transformer_files;
pub mod verify;
pub mod vocabulary;

use std::path::PathBuf;

use crate::files::FileError;
use checkpoint::CheckpointError;
pub use experts::open_experts;
pub use interface::{Actor, ObservationVariant, Policy, Sampling, TaskInterface};
pub use loading::{Loaded, Member, NO_NORMALISER, Stored, load, open, read_stored};

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
    #[error("the policy has words of their own for {trained}; none for task `{task}`")]
    UntrainedTask { task: String, trained: String },
    #[error("the vocabulary cannot be used: {what}")]
    Vocabulary { what: String },
    #[error("the policy is told which of its tasks it plays, {trained}; `{task}` is none of them")]
    NotInIndex { task: String, trained: String },
    #[error("the checkpoint does not say {what}, which cannot be guessed")]
    Missing { what: &'static str },
    #[error("{source_name} says {what}: {said}, but it is {found}")]
    Contradiction { source_name: &'static str, what: &'static str, said: String, found: String },
    #[error("the policy has no embedding for `{description}`")]
    UnknownDescription { description: String },
    #[error(
        "the normaliser has never seen {unknown} of the {sensors} sensors of task `{task}`, which the policy was \
         trained on: it belongs to another run"
    )]
    ForeignNormaliser { unknown: usize, sensors: usize, task: String },
    #[error("`{path}` exists already and is another file")]
    Exists { path: PathBuf },
    #[error("what was written does not read as what was meant")]
    NotTheSame,
    #[error("it has {found}, unlike `{other}`: only checkpoints of one network have a mean")]
    AnotherNetwork { found: String, other: PathBuf },
    #[error("there is no policy `{name}`: looked for {looked}")]
    NotFound { name: String, looked: String },
    #[error("`{name}` may be one of several: {runs}")]
    SeveralRuns { name: String, runs: String },
    #[error("there is no checkpoint in the folder `{folder}`")]
    NoCheckpoint { folder: PathBuf },
    #[error("it is no table of experts: {fault}")]
    ExpertTable { fault: String },
    #[error("there is no expert to play `{task}`: {reason}")]
    NoExpert { task: String, reason: String },
    #[error("there is no folder `{folder}`")]
    NoExpertFolder { folder: PathBuf },
    #[error("the expert should be {declared} and is {found}, in `{folder}`")]
    OtherExpert { folder: PathBuf, declared: String, found: String },
    #[error("none of the experts can be opened; their folder is `{folder}`{reasons}")]
    NoExperts { reasons: String, folder: PathBuf },
    #[error("not supported: {what}")]
    Unsupported { what: String },
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error("{source}, in `{path}`")]
    InFile { source: Box<PolicyError>, path: PathBuf },
}

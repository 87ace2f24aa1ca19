//! Checkpoint files, read as inert data: nothing in a file is ever executed, imported or called.
//!
//! Three families of files are recognised by their content, whatever they are called: Stable-Baselines3 archives
//! (`sb3.rs`), bare torch state dictionaries, and `mjrl` pickles (`npg.rs`); and beside them the pickled normalisers
//! (`vecnormalize.rs`). What `convert` made of one is a safetensors file (`safe.rs`). Below these lie the zip reader (`archive.rs`), the pickle machine (`pickle.rs`, `allowed.rs`,
//! `records.rs`), torch tensors (`tensors.rs`, `stream.rs`, `storages.rs`) and NumPy arrays (`arrays.rs`). Everything
//! is charged to [`Limits`] before it is allocated.
//!
//! ```no_run
//! use arnold_analyze::policy::checkpoint::{self, Limits};
//! # fn main() -> Result<(), checkpoint::CheckpointError> {
//! let policy = checkpoint::open("rl_model_49977000_steps.zip".as_ref(), &Limits::default())?;
//! println!("{:?} with {} tensors", policy.format, policy.tensors.len());
//! # Ok(())
//! # }
//! ```

mod allowed;
mod archive;
mod arrays;
pub mod contents;
mod declared;
mod limits;
mod npg;
mod pickle;
mod records;
mod safe;
mod sb3;
mod scaler;
mod settings;
mod siblings;
mod statistics;
mod storages;
mod stream;
mod summary;
mod tensors;
mod vecnormalize;

use std::path::{Path, PathBuf};

use crate::files::{self, FileError};
use allowed::Kind;
use archive::Archive;
use contents::{Checkpoint, Normaliser, Scalars};
use declared::Declared;
use limits::Budget;

pub use archive::ArchiveError;
pub use limits::{LimitExceeded, Limits};
pub use pickle::PickleError;
pub use records::RecordError;
pub(super) use safe::{Package, write as write_package};
pub use sb3::UnusedPickle;
pub use scaler::Scaler;
pub use siblings::normaliser_beside;
pub use storages::TensorError;
pub use stream::EmbeddedTensorError;
pub use summary::{ParameterCounts, network_sizes, parameter_counts};

/// Why a checkpoint or normaliser cannot be used. Each message is complete: it says where in the file, what, and the
/// path last; the `fault` inside is part of it, not a further cause.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("the file is neither a zip archive nor a pickle nor safetensors")]
    UnknownFormat,
    #[error("the file holds {found}, not a policy")]
    NotAPolicy { found: String },
    #[error("the file holds {found}, not a normaliser")]
    NotANormaliser { found: String },
    #[error("`{part}` is not a torch file")]
    NotATorchFile { part: String },
    #[error("the file holds {what}; its first tensors are `{tensors}`")]
    ForeignNetwork { what: &'static str, tensors: String },
    #[error("the file holds no network that is known here; its first tensors are `{tensors}`")]
    UnknownNetwork { tensors: String },
    #[error(transparent)]
    Archive(#[from] ArchiveError),
    #[error("pickle of `{part}` {fault}")]
    Pickle { part: String, fault: PickleError },
    #[error("`{part}`: {fault}")]
    Record { part: String, fault: RecordError },
    #[error("`{part}` {fault}")]
    Limit { part: String, fault: LimitExceeded },
    #[error("`{part}` is no valid JSON: {fault}")]
    Settings { part: String, fault: serde_json::Error },
    #[error("tensor `{tensor}` {fault}")]
    Tensor { tensor: String, fault: TensorError },
    #[error("tensor `{tensor}` {fault}")]
    EmbeddedTensor { tensor: String, fault: EmbeddedTensorError },
    #[error("the file {fault}")]
    Safetensors { fault: String },
    #[error("statistic `{name}` is {value} at index {index}, which no training produces")]
    ImpossibleStatistic { name: String, value: f64, index: usize },
    #[error("statistic `{name}` has {found} numbers; the others ask for {expected}")]
    StatisticLength { name: &'static str, expected: usize, found: usize },
    #[error("the signature of row {row} of the statistics has no words, or not in rising order")]
    UnsortedSignature { row: usize },
    #[error("the first row of the statistics is not that of the padding signature (0,)")]
    NoPaddingSignature,
    #[error("{fault}, in `{path}`")]
    InFile { fault: Box<CheckpointError>, path: PathBuf },
}

/// Reads a policy from the bytes of its file.
pub fn read_checkpoint(bytes: &[u8], limits: &Limits) -> Result<Checkpoint, CheckpointError> {
    let mut budget = Budget::new(limits);
    match Container::of(bytes)? {
        Container::Zip => {
            let mut archive = Archive::open(bytes, &mut budget)?;
            if sb3::recognise(&archive) {
                sb3::read(&mut archive, &mut budget)
            } else if tensors::pickle_member(&archive.names()).is_some() {
                let state =
                    tensors::read_state_dict(bytes, "torch file", Kind::TorchPolicy, &mut budget)?;
                sb3::checkpoint(state, Scalars::default())
            } else {
                Err(CheckpointError::NotAPolicy { found: "some other archive".to_owned() })
            }
        }
        Container::Pickle => match pickle::first_global(bytes, &mut Budget::new(limits)) {
            Some(class) if vecnormalize::recognise(&class) => {
                Err(CheckpointError::NotAPolicy { found: "a normaliser".to_owned() })
            }
            Some(class) if class.starts_with("sklearn.") => {
                let found = format!("`{class}`, an object of scikit-learn");
                Err(CheckpointError::NotAPolicy { found })
            }
            _ => npg::read(bytes, &mut budget),
        },
        Container::Safetensors => Ok(safe::read(bytes, &mut budget)?.checkpoint),
    }
}

/// Whether a file is safetensors, and what such a file holds beside its policy: the normaliser, and which files it was
/// made of. Null and nothing for bare weights.
pub fn embedded(
    bytes: &[u8],
    limits: &Limits,
) -> Result<Option<(Option<Normaliser>, serde_json::Value)>, CheckpointError> {
    let package = read_package(bytes, limits)?;
    Ok(package.map(|package| (package.normaliser, package.provenance)))
}

/// Reads a safetensors file with all that belongs to its policy; `None` if it is another kind of file.
pub(super) fn read_package(
    bytes: &[u8],
    limits: &Limits,
) -> Result<Option<Package>, CheckpointError> {
    if Container::of(bytes)? != Container::Safetensors {
        return Ok(None);
    }
    safe::read(bytes, &mut Budget::new(limits)).map(Some)
}

/// Reads a normaliser from the bytes of its file.
pub fn read_normaliser(bytes: &[u8], limits: &Limits) -> Result<Normaliser, CheckpointError> {
    read_normaliser_and_globals(bytes, limits).map(|(normaliser, _globals)| normaliser)
}

/// Reads a normaliser, and every global that its pickle names, sorted.
pub fn read_normaliser_and_globals(
    bytes: &[u8],
    limits: &Limits,
) -> Result<(Normaliser, Vec<String>), CheckpointError> {
    let not_a_normaliser =
        |found: &str| Err(CheckpointError::NotANormaliser { found: found.to_owned() });
    match Container::of(bytes)? {
        Container::Zip => return not_a_normaliser("an archive"),
        Container::Safetensors => return not_a_normaliser("tensors"),
        Container::Pickle => {}
    }
    match pickle::first_global(bytes, &mut Budget::new(limits)) {
        Some(class) if vecnormalize::recognise(&class) => {
            vecnormalize::read(bytes, &class, &mut Budget::new(limits))
        }
        Some(class) if class == npg::CLASS => not_a_normaliser("a policy"),
        // Whatever else it is: let the strictest list say what is wrong with it.
        _ => match pickle::read(bytes, Kind::ComponentNormaliser, &mut Budget::new(limits)) {
            Err(fault) => Err(CheckpointError::Pickle { part: "normaliser".to_owned(), fault }),
            Ok(_) => not_a_normaliser("some other object"),
        },
    }
}

/// Reads the settings of a policy from JSON beside it: the `data` of an archive as a loose file, or `model_config.json`.
pub fn read_settings(
    bytes: &[u8],
    part: &str,
    limits: &Limits,
) -> Result<Scalars, CheckpointError> {
    settings::read(bytes, part, &mut Budget::new(limits))
}

/// Reads the arguments of a training run, `args.json`.
pub fn read_arguments(bytes: &[u8]) -> Result<Declared, CheckpointError> {
    let arguments = serde_json::from_slice(bytes)
        .map_err(|fault| CheckpointError::Settings { part: "args.json".to_owned(), fault })?;
    Ok(Declared::from_arguments(&arguments))
}

/// Reads scikit-learn's `StandardScaler` from the bytes of its file.
pub fn read_scaler(bytes: &[u8], limits: &Limits) -> Result<Scaler, CheckpointError> {
    scaler::read(bytes, &mut Budget::new(limits))
}

/// Lists the globals named by the torch members of an archive, including those that reading the policy does not need.
pub fn list_globals(bytes: &[u8], limits: &Limits) -> Result<Vec<UnusedPickle>, CheckpointError> {
    let mut budget = Budget::new(limits);
    match Container::of(bytes)? {
        Container::Zip => {
            let mut archive = Archive::open(bytes, &mut budget)?;
            Ok(sb3::list_globals(&mut archive, &mut budget))
        }
        Container::Pickle => {
            let listing = pickle::read(bytes, Kind::Listing, &mut budget);
            let globals = listing.map(|pickle| pickle.records.globals().to_vec());
            let globals = globals.map_err(|error| error.to_string());
            Ok(vec![UnusedPickle { member: "pickle".to_owned(), globals }])
        }
        Container::Safetensors => Ok(Vec::new()),
    }
}

/// Reads the policy in the file `path`.
pub fn open(path: &Path, limits: &Limits) -> Result<Checkpoint, CheckpointError> {
    let bytes = files::read_bounded(path, limits.file_bytes)?;
    read_checkpoint(&bytes, limits).map_err(in_file(path))
}

/// Reads the normaliser in the file `path`.
pub fn open_normaliser(path: &Path, limits: &Limits) -> Result<Normaliser, CheckpointError> {
    let bytes = files::read_bounded(path, limits.file_bytes)?;
    read_normaliser(&bytes, limits).map_err(in_file(path))
}

/// Attaches the path to an error, for callers that read the bytes themselves.
pub fn in_file(path: &Path) -> impl Fn(CheckpointError) -> CheckpointError {
    move |fault| CheckpointError::InFile { fault: Box::new(fault), path: path.to_path_buf() }
}

/// Attaches the part of the file to an error of the pickle machine.
fn in_pickle(part: &str) -> impl Fn(PickleError) -> CheckpointError {
    move |fault| CheckpointError::Pickle { part: part.to_owned(), fault }
}

/// The outermost layer of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Container {
    Zip,
    Pickle,
    Safetensors,
}

impl Container {
    /// Recognised by the first bytes: a local zip header, or a pickle that states its protocol.
    fn of(bytes: &[u8]) -> Result<Self, CheckpointError> {
        match bytes {
            [b'P', b'K', 3, 4, ..] => Ok(Self::Zip),
            // Before pickles: a header's length may begin as they do.
            _ if safe::recognise(bytes) => Ok(Self::Safetensors),
            [0x80, 2..=5, ..] => Ok(Self::Pickle),
            _ => Err(CheckpointError::UnknownFormat),
        }
    }
}

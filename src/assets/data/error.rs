//! What can go wrong with the published data sets, and what to do about it.

use std::path::PathBuf;

use crate::files::FileError;

/// Why a data set is not there or could not be fetched.
#[derive(Debug, thiserror::Error)]
pub enum DataError {
    /// It was never fetched into this data folder.
    #[error("the data set `{name}` is not in `{folder}`")]
    Missing { name: String, command: String, folder: PathBuf },
    /// Something lies in its place that `setup` did not put there.
    #[error("the data set `{name}` is not verified: `setup` did not put it into `{folder}`")]
    Unverified { name: String, command: String, folder: PathBuf },
    /// It was fetched and is not what it was.
    #[error("the data set `{name}` is damaged: {reason} in `{path}`")]
    Damaged { name: String, command: String, reason: String, path: PathBuf },
    /// There is no archive of that name.
    #[error("there is no archive `{name}`, only {known}")]
    UnknownArchive { name: String, known: String },
    /// This program cannot fetch.
    #[error(
        "cannot fetch the data set `{name}`: this program was built without the feature `download`"
    )]
    NoDownload { name: String },
    /// The source gave no answer, or only a part of the file.
    #[error(
        "cannot fetch `{file}`: {reason} (tried {attempts} times); no data set was changed{}; from `{address}`",
        what_is_kept(*.kept, *.bytes)
    )]
    Unreachable {
        file: String,
        reason: String,
        attempts: u32,
        kept: u64,
        bytes: u64,
        address: String,
        command: String,
    },
    /// The source answered with something else than the file.
    #[error("cannot fetch `{file}`: {reason}; no data set was changed; from `{address}`")]
    Refused { file: String, reason: String, address: String, command: String },
    /// The folder given as the source lacks the file.
    #[error("no `{file}` in `{folder}`; no data set was changed")]
    NotInFolder { file: String, folder: PathBuf },
    /// The file came over and is another one.
    #[error("`{file}` has {found}, expected {expected}; it was not used; from `{address}`")]
    WrongSum { file: String, found: String, expected: String, address: String },
    /// The archive is not one that may be unpacked.
    #[error("{reason} in the archive `{file}`; no data set was changed")]
    BadArchive { file: String, reason: String },
    /// A file of the data set would replace another file.
    #[error("there is another file already; nothing was changed: `{path}`")]
    Conflict { path: PathBuf },
    /// A place to write to is a link or something else that leads elsewhere.
    #[error("this is not a plain file or folder, so nothing is written there: `{path}`")]
    NotPlain { path: PathBuf },
    /// The disk is too small.
    #[error("needs {needed} bytes to fetch and unpack, {free} are free in `{folder}`")]
    NoSpace { needed: u64, free: u64, folder: PathBuf },
    /// The data folder cannot be written to or read.
    #[error("cannot use the data folder: {0}")]
    Files(#[from] FileError),
}

fn what_is_kept(kept: u64, bytes: u64) -> String {
    match kept {
        0 => String::new(),
        kept => format!(", and the next try continues after {kept} of {bytes} bytes"),
    }
}

impl DataError {
    /// What the person at the terminal can do about it.
    #[must_use]
    pub fn hint(&self) -> String {
        match self {
            Self::Missing { command, .. } => format!("run `{command}`"),
            Self::Unverified { command, .. } => {
                format!("run `{command}`, which keeps what is the same and verifies it")
            }
            Self::Damaged { command, .. } => {
                format!("move that file away and run `{command}`, which puts the published one there")
            }
            Self::UnknownArchive { .. } => {
                "name them with commas between, `--arnold checkpoints,experts`, or leave the names out for all".to_owned()
            }
            Self::NoDownload { .. } => {
                "build it with `cargo build --release`, without `--no-default-features`".to_owned()
            }
            Self::Unreachable { file, command, .. } | Self::Refused { file, command, .. } => format!(
                "check the network (`HTTPS_PROXY` names a proxy); or fetch `{file}` elsewhere, put it into a folder and \
                 run `{command} --from DIR`; or set `ARNOLD_MIRROR` to such a folder or to the address of a server that \
                 holds the file"
            ),
            Self::NotInFolder { file, .. } => format!(
                "put `{file}` there under its own name, or leave out `--from` and `ARNOLD_MIRROR` to fetch it"
            ),
            Self::WrongSum { .. } => "try again; if the sum stays wrong, the file was replaced where it comes from: do not \
                 use it"
                .to_owned(),
            Self::BadArchive { .. } => "do not unpack it by hand; please report it".to_owned(),
            Self::Conflict { .. } => {
                "move that file away, or choose another data folder with `--data DIR`".to_owned()
            }
            Self::NotPlain { .. } => {
                "move it away, or choose another data folder with `--data DIR`; the data folder itself may be a link"
                    .to_owned()
            }
            Self::NoSpace { .. } => {
                "make room, or choose a data folder on another disk with `--data DIR`".to_owned()
            }
            Self::Files(_) => "choose a folder you may write to with `--data DIR`".to_owned(),
        }
    }
}

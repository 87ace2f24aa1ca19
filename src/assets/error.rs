//! What can go wrong with the parts, and what to do about it.

use std::path::PathBuf;

use super::SETUP_COMMAND;
use crate::files::FileError;

/// Why a part is not there or could not be fetched.
#[derive(Debug, thiserror::Error)]
pub enum AssetError {
    /// It was never installed here.
    #[error("{what} is not installed")]
    Missing {
        /// The part.
        what: String,
        /// The command that installs it.
        command: &'static str,
    },
    /// It was installed and is not what it was.
    #[error("{what} is damaged: {reason} in `{path}`")]
    Damaged {
        /// The part.
        what: String,
        /// What is wrong with it.
        reason: String,
        /// The file or folder it is about.
        path: PathBuf,
    },
    /// A wheel does not hold what was committed.
    #[error("`{file}` has SHA-256 {found}, expected {expected}, in `{wheel}`")]
    WrongHash {
        /// The file inside the wheel, or the wheel itself.
        file: String,
        /// The committed hash.
        expected: String,
        /// The hash of what was found.
        found: String,
        /// The wheel.
        wheel: PathBuf,
    },
    /// A wheel is not a readable archive, is larger than it may be, or lacks a file.
    #[error("{reason} in `{wheel}`")]
    BadWheel {
        /// What is wrong with it.
        reason: String,
        /// The wheel.
        wheel: PathBuf,
    },
    /// Nobody publishes this part for this machine.
    #[error("there is no official {what} for {platform}")]
    NoWheel {
        /// The part.
        what: String,
        /// The machine's operating system and processor.
        platform: String,
    },
    /// A folder given instead of `pip` does not hold the wheel.
    #[error("no wheel of {what} in `{folder}`")]
    NoWheelIn {
        /// The part.
        what: String,
        /// The folder that was searched.
        folder: PathBuf,
    },
    /// Neither `pip` nor `uv` can be run.
    #[error("cannot fetch {what}: found neither `pip` nor `uv` (tried {tried})")]
    NoPip {
        /// The part.
        what: String,
        /// The commands that were tried.
        tried: String,
    },
    /// `pip` ran and failed.
    #[error("cannot fetch {what}: `{command}` failed:\n{last_lines}")]
    PipFailed {
        /// The part.
        what: String,
        /// The command line, without its options.
        command: String,
        /// The last things it said.
        last_lines: String,
    },
    /// The cache cannot be written to or read.
    #[error("cannot use the cache: {0}")]
    Cache(#[from] FileError),
}

impl AssetError {
    /// What the person at the terminal can do about it.
    #[must_use]
    pub fn hint(&self) -> String {
        match self {
            Self::Missing { command, .. } => format!("run `{command}`"),
            Self::Damaged { .. } => format!("run `{SETUP_COMMAND}`, which replaces it"),
            Self::WrongHash { .. } | Self::BadWheel { .. } => format!(
                "delete that wheel and run `{SETUP_COMMAND}` again; if the hash stays wrong, the wheel \
                 was replaced where your `pip` gets it: do not use it"
            ),
            Self::NoWheel { .. } => {
                "use a Linux machine (x86-64 or Arm) or a Mac with Apple silicon; \
                on an Intel Mac only `--physics 2.3.7` exists"
                    .to_owned()
            }
            Self::NoWheelIn { what, .. } => {
                format!("put the wheel of {what} there under its own name, or leave `--from` out")
            }
            Self::NoPip { .. } => format!(
                "install pip (Debian: `apt-get install python3-pip`) or uv, or fetch the wheels elsewhere \
                 and run `{SETUP_COMMAND} --from DIR`"
            ),
            Self::PipFailed { .. } => format!(
                "check the network and `pip config list`, or fetch the wheels elsewhere and run \
                 `{SETUP_COMMAND} --from DIR`"
            ),
            Self::Cache(_) => {
                "set `ARNOLD_CACHE` to a folder you may write to, with 60 MB free".to_owned()
            }
        }
    }
}

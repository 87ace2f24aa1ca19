//! The published data sets: fetched into the data folder, verified, unpacked, never mixed with anything else.
//!
//! | data set | published as | becomes |
//! |---|---|---|
//! | `kinesis` | one archive of Zenodo 21807280 | `kinesis/` |
//! | `emg` | ten files of a Hugging Face data set | `emg/` |
//! | `checkpoints`, `experts`, `benchmarks`, `extra_results` | an archive of Zenodo 21807280 each | a folder each |
//!
//! All files of a set are fetched and verified before any is unpacked, and unpacked beside their place before any is
//! moved there. A file that lies there already must be the same; then it stays. Killed at any moment, the program leaves
//! unfinished files in the hidden folder `.setup`, which the next run continues, or some files of a set without its
//! receipt, which the next run finds to be the same. [`Origin`] replaces the source, never the sums.

pub mod catalogue;
mod error;
#[cfg(feature = "download")]
mod fetch;
#[cfg(feature = "download")]
mod http;
#[cfg(feature = "download")]
mod install;
#[cfg(feature = "download")]
mod md5;
mod receipt;
#[cfg(feature = "download")]
mod unpack;

use std::path::{Path, PathBuf};
use std::time::Duration;

pub use catalogue::{Checksum, Content, DataSet, Record, RemoteFile};
pub use error::DataError;
#[cfg(feature = "download")]
pub use fetch::Patience;
pub use receipt::DataReceipt;

/// Unfinished files, the lock and the receipts.
const HIDDEN: &str = ".setup";

/// Where the files of a record are taken from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Origin {
    /// Where they are published.
    Published,
    /// A folder that holds them under their own names.
    Folder(PathBuf),
    /// Another server: the address before the name of a file.
    Server(String),
}

impl Origin {
    /// What `$ARNOLD_MIRROR` names: an address if it looks like one, else a folder.
    #[must_use]
    pub fn of_mirror(text: &str) -> Self {
        if text.starts_with("http://") || text.starts_with("https://") {
            Self::Server(text.to_owned())
        } else {
            Self::Folder(text.into())
        }
    }
}

/// What happens while data sets are fetched.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum DataEvent {
    /// The data set is there and verified; nothing was done.
    Present(String),
    /// Another process is at work in this data folder.
    Waiting,
    /// A file is being fetched from byte `start` on.
    Fetching { file: String, address: String, start: u64, bytes: u64 },
    /// That many more bytes have come.
    Received(u64),
    /// A try failed, and the next follows after a wait.
    Retrying { reason: String, wait: Duration },
    /// What was continued turned out to be wrong and is fetched from the start.
    StartingOver(String),
    /// A file's size and sum are compared.
    Checking(String),
    /// An archive is being unpacked.
    Unpacking(String),
    /// The data set is in place: files, and how many of them were there before.
    Installed { name: String, files: usize, kept: usize },
}

/// The user's data folder.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DataFolder {
    root: PathBuf,
}

impl DataFolder {
    /// The data folder at `root`. Nothing is created.
    #[must_use]
    pub fn at(root: impl Into<PathBuf>) -> Self {
        Self { root: root.into() }
    }

    /// Itself.
    #[must_use]
    pub fn root(&self) -> &Path {
        &self.root
    }

    /// The folder of `set`.
    #[must_use]
    pub fn folder(&self, set: &DataSet<'_>) -> PathBuf {
        set.destination.split('/').fold(self.root.clone(), |path, step| path.join(step))
    }

    /// Hashes every file of `set` and compares it with the receipt.
    pub fn verify(&self, set: &DataSet<'_>) -> Result<DataReceipt, DataError> {
        let (name, command) = (set.name.to_owned(), set.command.to_owned());
        let folder = self.folder(set);
        let is_empty = std::fs::read_dir(&folder).map_or(true, |mut all| all.next().is_none());
        if is_empty {
            return Err(DataError::Missing { name, command, folder });
        }
        let path = self.receipt(set);
        if !path.exists() {
            return Err(DataError::Unverified { name, command, folder });
        }
        let damaged = |(reason, path)| DataError::Damaged {
            name: set.name.to_owned(),
            command: set.command.to_owned(),
            reason,
            path,
        };
        let receipt = DataReceipt::read(&path).map_err(|reason| damaged((reason, path)))?;
        if !receipt.is_of(set) {
            // An older program put another version there.
            return Err(DataError::Unverified { name, command, folder });
        }
        receipt.check(&folder).map_err(damaged)?;
        Ok(receipt)
    }

    /// How many bytes are free where the data folder is or will be; none where the system does not say.
    #[cfg(feature = "download")]
    #[must_use]
    pub fn free_space(&self) -> Option<u64> {
        let absolute = std::path::absolute(self.root()).ok()?;
        let existing = absolute.ancestors().find(|folder| folder.is_dir())?;
        let system = rustix::fs::statvfs(existing).ok()?;
        system.f_bavail.checked_mul(system.f_frsize)
    }

    fn hidden(&self) -> PathBuf {
        self.root.join(HIDDEN)
    }

    fn receipt(&self, set: &DataSet<'_>) -> PathBuf {
        self.hidden().join(format!("{}.json", set.name))
    }
}

#[cfg(not(feature = "download"))]
impl DataFolder {
    /// Nothing is going to be written.
    #[must_use]
    pub fn free_space(&self) -> Option<u64> {
        None
    }

    /// Makes sure that `sets` are here and verified; without the feature `download` they must be already.
    pub fn ensure(
        &self,
        sets: &[DataSet<'_>],
        _origin: &Origin,
        observe: &mut dyn FnMut(DataEvent),
    ) -> Result<(), DataError> {
        for set in sets {
            let name = set.name.to_owned();
            if self.verify(set).is_err() {
                return Err(DataError::NoDownload { name });
            }
            observe(DataEvent::Present(name));
        }
        Ok(())
    }
}

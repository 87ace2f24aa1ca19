//! The receipt of a data set: where it comes from, the sums that proved it, and the SHA-256 of every file. Written last,
//! so a data set with a receipt is a whole one; without a date, so the same files give the same receipt.
//!
//! Receipts lie together in a hidden folder of the data folder, because some readers take every file of a data set.

use std::collections::BTreeMap;
use std::path::Path;

use serde::{Deserialize, Serialize};

use super::DataSet;
use crate::assets::wheel;
use crate::files;

/// A hundred thousand files make 15 MB.
const LARGEST_RECEIPT: u64 = 64 << 20;

/// What was fetched and what lies there now.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct DataReceipt {
    /// The data set.
    pub name: String,
    /// Where it is published.
    pub source: String,
    /// The licence it is under.
    pub licence: String,
    /// What to cite.
    pub citations: Vec<String>,
    /// What each published file summed up to, by its name.
    pub fetched: BTreeMap<String, String>,
    /// SHA-256 of every file, by its path below the data set's folder with `/` between folders.
    pub files: BTreeMap<String, String>,
}

impl DataReceipt {
    pub(super) fn new(set: &DataSet<'_>, files: BTreeMap<String, String>) -> Self {
        let sum = |file: &super::RemoteFile<'_>| (file.name.to_owned(), file.checksum.to_string());
        Self {
            name: set.name.to_owned(),
            source: set.record.to_string(),
            licence: set.licence.to_owned(),
            citations: set.citations.iter().map(|&text| text.to_owned()).collect(),
            fetched: set.files.iter().map(sum).collect(),
            files,
        }
    }

    #[cfg(feature = "download")]
    pub(super) fn write(&self, path: &Path) -> Result<(), files::FileError> {
        files::write_atomic_with(path, |file| Ok(serde_json::to_writer_pretty(file, self)?))
    }

    /// The receipt at `path`, or what is wrong with it.
    pub(super) fn read(path: &Path) -> Result<Self, String> {
        let text = files::read_bounded(path, LARGEST_RECEIPT).map_err(|error| error.to_string())?;
        serde_json::from_slice(&text).map_err(|error| format!("unreadable receipt ({error})"))
    }

    /// Whether it is about the files that `set` names today.
    pub(super) fn is_of(&self, set: &DataSet<'_>) -> bool {
        self.name == set.name && self.fetched == Self::new(set, BTreeMap::new()).fetched
    }

    /// Hashes every file below `folder` again; the first that is not what it was, and why.
    pub(super) fn check(&self, folder: &Path) -> Result<(), (String, std::path::PathBuf)> {
        for (name, expected) in &self.files {
            let path = folder.join(name);
            if !wheel::is_plain_relative(name) {
                return Err((format!("`{name}` leaves the folder"), path));
            }
            match files::sha256_of_file(&path) {
                Ok(found) if found == *expected => {}
                Ok(found) => return Err((format!("SHA-256 {found}, expected {expected}"), path)),
                Err(error) => return Err((error.to_string(), path)),
            }
        }
        Ok(())
    }
}

//! `PART.json`: what was installed, from which wheel, and the SHA-256 of every file. It is written last, so a part with a
//! receipt is a whole part.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use super::part::Proof;
use super::{AssetError, Part, SETUP_COMMAND, wheel};
use crate::files;

const FILE_NAME: &str = "PART.json";
/// Three hundred files make 60 kB.
const LARGEST_RECEIPT: u64 = 4 << 20;

/// What lies in a part's folder.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Receipt {
    /// The Python package.
    pub name: String,
    /// Its version.
    pub version: String,
    /// The licence it is under.
    pub licence: String,
    /// The file name of the wheel it came from.
    pub wheel: String,
    /// SHA-256 of every file, by its path below the part's folder with `/` between folders.
    pub files: BTreeMap<String, String>,
}

impl Receipt {
    /// A receipt for `files` of `part` out of `wheel`.
    pub(super) fn new(part: Part, wheel: &Path, files: BTreeMap<String, String>) -> Self {
        Self {
            name: part.package().to_owned(),
            version: part.version().to_owned(),
            licence: part.licence().to_owned(),
            wheel: wheel.file_name().unwrap_or_default().to_string_lossy().into_owned(),
            files,
        }
    }

    /// SHA-256 of the list of files in the form `sha256sum` prints, sorted by path. Stands for the whole tree.
    #[must_use]
    pub fn listing(&self) -> String {
        let mut text = String::new();
        for (path, sha256) in &self.files {
            writeln!(text, "{sha256}  {path}").unwrap_or(());
        }
        files::sha256_hex(text.as_bytes())
    }

    /// Writes it into `folder`.
    pub(super) fn write(&self, folder: &Path) -> Result<(), AssetError> {
        let path = folder.join(FILE_NAME);
        Ok(files::write_atomic_with(&path, |file| Ok(serde_json::to_writer_pretty(file, self)?))?)
    }

    /// Reads the receipt in `folder` and hashes every file again. Fails unless all are what `proof` demands.
    pub(super) fn verify(part: Part, folder: &Path, proof: Proof) -> Result<Self, AssetError> {
        if !folder.is_dir() {
            return Err(AssetError::Missing { what: part.to_string(), command: SETUP_COMMAND });
        }
        let damaged = |reason: String, path: PathBuf| AssetError::Damaged {
            what: part.to_string(),
            reason,
            path,
        };
        let path = folder.join(FILE_NAME);
        let text = files::read_bounded(&path, LARGEST_RECEIPT)
            .map_err(|error| damaged(format!("no receipt ({error})"), path.clone()))?;
        let receipt: Self = serde_json::from_slice(&text)
            .map_err(|error| damaged(format!("unreadable receipt ({error})"), path.clone()))?;
        if receipt.name != part.package() || receipt.version != part.version() {
            let reason = format!(
                "expected {}=={}, found {}=={}",
                part.package(),
                part.version(),
                receipt.name,
                receipt.version
            );
            return Err(damaged(reason, path));
        }
        receipt.check(proof).map_err(|mismatch| damaged(mismatch.to_string(), path))?;
        for (name, expected) in &receipt.files {
            let file = folder.join(name);
            if !wheel::is_plain_relative(name) {
                return Err(damaged(format!("`{name}` leaves the folder"), file));
            }
            let found = files::sha256_of_file(&file)
                .map_err(|error| damaged(error.to_string(), file.clone()))?;
            if found != *expected {
                return Err(damaged(format!("SHA-256 {found}, expected {expected}"), file));
            }
        }
        Ok(receipt)
    }

    /// Compares the recorded hashes with the committed ones.
    pub(super) fn check(&self, proof: Proof) -> Result<(), Mismatch> {
        let (file, expected, found) = match proof {
            Proof::File { path, sha256 } => (path, sha256, self.files.get(path).cloned()),
            Proof::Wheel { listing, .. } => ("the list of files", listing, Some(self.listing())),
        };
        let found = found.unwrap_or_else(|| "of no file".to_owned());
        if found == expected {
            return Ok(());
        }
        Err(Mismatch { file: file.to_owned(), expected: expected.to_owned(), found })
    }
}

/// A recorded hash that is not the committed one.
#[derive(Debug, thiserror::Error)]
#[error("`{file}` has SHA-256 {found}, expected {expected}")]
pub(super) struct Mismatch {
    pub(super) file: String,
    pub(super) expected: String,
    pub(super) found: String,
}

#[cfg(test)]
mod tests {
    use super::*;

    const PART: Part = Part::Physics(crate::assets::PhysicsVersion::V2_3_7);
    const PROOF: Proof = Proof::File {
        path: "mujoco/lib.so",
        sha256: "2cf24dba5fb0a30e26e83b2ac5b9e29e1b161e5c1fa7425e73043362938b9824",
    };

    fn installed() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        files::write_atomic(&folder.path().join("mujoco/lib.so"), b"hello").unwrap();
        let hash = files::sha256_hex(b"hello");
        let hashes = BTreeMap::from([("mujoco/lib.so".to_owned(), hash)]);
        Receipt::new(PART, Path::new("a.whl"), hashes).write(folder.path()).unwrap();
        folder
    }

    #[test]
    fn a_part_that_was_not_touched_verifies() {
        let folder = installed();
        let receipt = Receipt::verify(PART, folder.path(), PROOF).unwrap();
        assert_eq!((receipt.name.as_str(), receipt.version.as_str()), ("mujoco", "2.3.7"));
    }

    #[test]
    fn a_changed_file_is_named_with_both_hashes() {
        let folder = installed();
        files::write_atomic(&folder.path().join("mujoco/lib.so"), b"hullo").unwrap();
        let text = Receipt::verify(PART, folder.path(), PROOF).unwrap_err().to_string();
        assert!(text.contains("2cf24dba5fb0a30e"), "{text}");
        assert!(text.contains(&files::sha256_hex(b"hullo")), "{text}");
        assert!(text.ends_with("mujoco/lib.so`"), "{text}");
    }

    #[test]
    fn a_receipt_changed_together_with_its_file_is_still_refused() {
        let folder = installed();
        files::write_atomic(&folder.path().join("mujoco/lib.so"), b"hullo").unwrap();
        let hashes = BTreeMap::from([("mujoco/lib.so".to_owned(), files::sha256_hex(b"hullo"))]);
        Receipt::new(PART, Path::new("a.whl"), hashes).write(folder.path()).unwrap();
        let error = Receipt::verify(PART, folder.path(), PROOF).unwrap_err();
        assert!(matches!(error, AssetError::Damaged { .. }), "{error}");
    }

    #[test]
    fn a_missing_receipt_is_damage_and_a_missing_folder_is_not() {
        let folder = installed();
        std::fs::remove_file(folder.path().join(FILE_NAME)).unwrap();
        let error = Receipt::verify(PART, folder.path(), PROOF).unwrap_err();
        assert!(matches!(error, AssetError::Damaged { .. }), "{error}");
        let error = Receipt::verify(PART, &folder.path().join("nowhere"), PROOF).unwrap_err();
        assert!(matches!(error, AssetError::Missing { .. }), "{error}");
    }

    #[test]
    fn the_listing_is_what_sha256sum_prints() {
        let hashes =
            BTreeMap::from([("b".to_owned(), "22".to_owned()), ("a".to_owned(), "11".to_owned())]);
        let receipt = Receipt::new(PART, Path::new("a.whl"), hashes);
        assert_eq!(receipt.listing(), files::sha256_hex(b"11  a\n22  b\n"));
    }
}

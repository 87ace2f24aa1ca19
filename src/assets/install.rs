//! Installing parts: fetch the wheel, check it, unpack it beside its place, write its receipt, rename it into place.
//!
//! Killed at any moment, an installer leaves a `.staging-…` folder and nothing else; the next one clears it. Two
//! installers take turns (`lock.rs`), and the second finds the work done.

use std::path::{Path, PathBuf};

use super::lock::InstallLock;
use super::part::Proof;
use super::pip::{self, Pip};
use super::{AssetError, Cache, Part, Platform, Receipt, wheel};
use crate::files::{self, Published};

const STAGING_PREFIX: &str = ".staging-";

/// Where wheels come from.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Source {
    /// The user's `pip`.
    Pip,
    /// A folder that holds the wheels under their own names.
    Folder(PathBuf),
}

/// What an installer is doing.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Event {
    /// The part is there and verified; nothing was done.
    Present(Part),
    /// Another process is installing; waiting for it.
    Waiting,
    /// The part is there but not what it should be, and will be replaced.
    Replacing(Part, String),
    /// The wheel is being fetched by this command.
    Fetching(Part, String),
    /// The wheel of this name is being checked and unpacked.
    Unpacking(Part, String),
    /// The part is in place: number of files.
    Installed(Part, usize),
}

impl Cache {
    /// Makes sure that `parts` are here and verified, fetching what is not from `source`.
    pub fn ensure(
        &self,
        parts: &[Part],
        source: &Source,
        observe: &mut dyn FnMut(Event),
    ) -> Result<(), AssetError> {
        let wanted = self.still_wanted(parts, observe)?;
        if wanted.is_empty() {
            return Ok(());
        }
        let lock = InstallLock::take(self.root(), || observe(Event::Waiting))?;
        if lock.is_exclusive() {
            clear_staging(self.root());
        }
        for part in self.still_wanted(&wanted, observe)? {
            self.install(part, source, observe)?;
        }
        Ok(())
    }

    /// The parts that are not here or not whole.
    fn still_wanted(
        &self,
        parts: &[Part],
        observe: &mut dyn FnMut(Event),
    ) -> Result<Vec<Part>, AssetError> {
        let mut wanted = Vec::new();
        for &part in parts {
            match self.verify(part) {
                Ok(_) => observe(Event::Present(part)),
                Err(AssetError::Missing { .. } | AssetError::Damaged { .. }) => wanted.push(part),
                Err(error) => return Err(error),
            }
        }
        Ok(wanted)
    }

    fn install(
        &self,
        part: Part,
        source: &Source,
        observe: &mut dyn FnMut(Event),
    ) -> Result<(), AssetError> {
        let platform = Platform::here();
        let proof = part.proof(platform)?;
        // Removed when it goes out of scope, whatever happens.
        let staging = files::temporary_folder(self.root(), STAGING_PREFIX)?;
        let wheel = match source {
            Source::Folder(folder) => pip::find_wheel(part, platform, folder)?,
            Source::Pip => {
                let pip = Pip::find().ok_or_else(|| AssetError::NoPip {
                    what: part.to_string(),
                    tried: pip::ways(),
                })?;
                observe(Event::Fetching(part, pip.command()));
                let downloads = staging.path().join("downloads");
                files::create_folder(&downloads)?;
                pip.download(part, platform, &downloads)?
            }
        };
        observe(Event::Unpacking(part, name_of(&wheel)));
        let unpacked = staging.path().join("part");
        let receipt = unpack_checked(part, proof, &wheel, &unpacked)?;
        let destination = self.folder(part);
        if let Err(AssetError::Damaged { reason, .. }) = self.verify(part) {
            observe(Event::Replacing(part, reason));
            files::publish_folder(&destination, &staging.path().join("damaged"))?;
        }
        if files::publish_folder(&unpacked, &destination)? == Published::AlreadyThere {
            // Somebody was faster, on a file system without locks: theirs must be as good as ours.
            self.verify(part)?;
        }
        observe(Event::Installed(part, receipt.files.len()));
        Ok(())
    }
}

/// Unpacks `part` into `folder` and writes its receipt, unless a hash is wrong.
fn unpack_checked(
    part: Part,
    proof: Proof,
    wheel: &Path,
    folder: &Path,
) -> Result<Receipt, AssetError> {
    let wrong = |file: &str, expected: &str, found: String| AssetError::WrongHash {
        file: file.to_owned(),
        expected: expected.to_owned(),
        found,
        wheel: wheel.to_path_buf(),
    };
    if let Proof::Wheel { sha256, .. } = proof {
        let found = files::sha256_of_file(wheel)?;
        if found != sha256 {
            return Err(wrong(&name_of(wheel), sha256, found));
        }
    }
    files::create_folder(folder)?;
    let hashes = wheel::unpack(wheel, folder, |name| part.keeps(name))?;
    let receipt = Receipt::new(part, wheel, hashes);
    receipt.check(proof).map_err(|m| wrong(&m.file, &m.expected, m.found))?;
    receipt.write(folder)?;
    Ok(receipt)
}

fn name_of(wheel: &Path) -> String {
    wheel.file_name().unwrap_or_default().to_string_lossy().into_owned()
}

/// Clears what killed installers left behind. What cannot be cleared is only in nobody's way.
fn clear_staging(root: &Path) {
    for entry in std::fs::read_dir(root).into_iter().flatten().flatten() {
        if entry.file_name().to_string_lossy().starts_with(STAGING_PREFIX) {
            let _in_nobodys_way = std::fs::remove_dir_all(entry.path());
        }
    }
}

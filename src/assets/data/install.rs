//! Putting a data set in its place: fetch, verify, unpack beside it, compare with what is there, move, write the receipt.

use std::collections::BTreeMap;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

use super::fetch::{Fetcher, Patience, part_size};
use super::{Content, DataError, DataEvent, DataFolder, DataReceipt, DataSet, Origin, unpack};
use crate::assets::lock::InstallLock;
use crate::files::{self, FileError, Published};

const STAGING_PREFIX: &str = "staging-";

impl DataFolder {
    /// Makes sure that `sets` are here and verified, fetching what is not from `origin`.
    pub fn ensure(
        &self,
        sets: &[DataSet<'_>],
        origin: &Origin,
        observe: &mut dyn FnMut(DataEvent),
    ) -> Result<(), DataError> {
        self.ensure_with(sets, origin, Patience::default(), observe)
    }

    /// The same, with another patience towards servers.
    pub fn ensure_with(
        &self,
        sets: &[DataSet<'_>],
        origin: &Origin,
        patience: Patience,
        observe: &mut dyn FnMut(DataEvent),
    ) -> Result<(), DataError> {
        let mut wanted = Vec::new();
        for set in sets {
            match self.verify(set) {
                Ok(_) => observe(DataEvent::Present(set.name.to_owned())),
                // To fetch it all and then refuse to replace that file would be a waste.
                Err(DataError::Damaged { name, command, reason, path }) if path.exists() => {
                    return Err(DataError::Damaged { name, command, reason, path });
                }
                Err(_) => wanted.push(*set),
            }
        }
        if wanted.is_empty() {
            return Ok(());
        }
        refuse_link(&self.hidden())?;
        let lock = InstallLock::take(&self.hidden(), || observe(DataEvent::Waiting))?;
        if lock.is_exclusive() {
            self.clear_staging();
        }
        for set in wanted {
            // Whoever held the lock before may have done the work.
            if self.verify(&set).is_ok() {
                observe(DataEvent::Present(set.name.to_owned()));
            } else {
                let hidden = self.hidden();
                let fetcher = Fetcher { set, origin, patience, parts: &hidden };
                self.install(&fetcher, observe)?;
            }
        }
        Ok(())
    }

    fn install(
        &self,
        fetcher: &Fetcher<'_>,
        observe: &mut dyn FnMut(DataEvent),
    ) -> Result<(), DataError> {
        let set = &fetcher.set;
        let destination = self.folder(set);
        self.refuse_links_on_the_way_to(set)?;
        self.check_space(fetcher)?;
        // All of them first: a set is never made of old and new files.
        let sources: Vec<PathBuf> =
            set.files.iter().map(|file| fetcher.fetch(file, observe)).collect::<Result<_, _>>()?;
        // Removed when it goes out of scope, whatever happens.
        let staging = files::temporary_folder(&self.hidden(), STAGING_PREFIX)?;
        let unpacked = staging.path().join("set");
        let hashes = stage(set, &sources, &unpacked, observe)?;
        let kept = self.place(&unpacked, &destination, &hashes)?;
        let count = hashes.len();
        DataReceipt::new(set, hashes).write(&self.receipt(set))?;
        for file in set.files {
            files::remove(&fetcher.part(file))?;
        }
        observe(DataEvent::Installed { name: set.name.to_owned(), files: count, kept });
        Ok(())
    }

    /// Moves the staged files to `destination`; how many were there already. Nothing is moved if one of them differs.
    fn place(
        &self,
        staged: &Path,
        destination: &Path,
        hashes: &BTreeMap<String, String>,
    ) -> Result<usize, DataError> {
        if let Some(parent) = destination.parent() {
            files::create_folder(parent)?;
        }
        if !destination.exists() && files::publish_folder(staged, destination)? == Published::Ours {
            return Ok(0);
        }
        let mut new = Vec::new();
        for (name, sha256) in hashes {
            let place = destination.join(name);
            self.refuse_links_to(&place)?;
            match std::fs::symlink_metadata(&place) {
                Err(error) if error.kind() == ErrorKind::NotFound => new.push(name),
                Ok(metadata) if metadata.is_file() && files::sha256_of_file(&place)? == *sha256 => {
                }
                // Another file, a folder, or a file where a folder should be.
                _ => return Err(DataError::Conflict { path: place }),
            }
        }
        for name in &new {
            files::publish_file(&staged.join(name), &destination.join(name))?;
        }
        Ok(hashes.len() - new.len())
    }

    /// Refuses a data set whose folder, or one above it inside the data folder, is a link or a file.
    fn refuse_links_on_the_way_to(&self, set: &DataSet<'_>) -> Result<(), DataError> {
        let folder = self.folder(set);
        self.refuse_links_to(&folder)?;
        if folder.exists() && !folder.is_dir() {
            return Err(DataError::NotPlain { path: folder });
        }
        Ok(())
    }

    /// Refuses a path that leads out of the data folder: by a link at any step, or by not being below it.
    fn refuse_links_to(&self, path: &Path) -> Result<(), DataError> {
        let outside = || DataError::NotPlain { path: path.to_path_buf() };
        let below = path.strip_prefix(self.root()).map_err(|_| outside())?;
        let mut step = self.root().to_path_buf();
        for component in below.components() {
            let std::path::Component::Normal(name) = component else { return Err(outside()) };
            step.push(name);
            refuse_link(&step)?;
        }
        Ok(())
    }

    /// Unpacked, a set takes at least as much as packed; what is fetched already is on the disk already.
    fn check_space(&self, fetcher: &Fetcher<'_>) -> Result<(), DataError> {
        let Some(free) = self.free_space() else { return Ok(()) };
        let mut needed = fetcher.set.bytes();
        if !matches!(fetcher.origin, Origin::Folder(_)) {
            for file in fetcher.set.files {
                needed += file.bytes.saturating_sub(part_size(&fetcher.part(file))?);
            }
        }
        if needed > free {
            let folder = self.root().to_path_buf();
            return Err(DataError::NoSpace { needed, free, folder });
        }
        Ok(())
    }

    /// Clears what killed installers left behind. What cannot be cleared is only in nobody's way.
    fn clear_staging(&self) {
        for entry in std::fs::read_dir(self.hidden()).into_iter().flatten().flatten() {
            if entry.file_name().to_string_lossy().starts_with(STAGING_PREFIX) {
                let _in_nobodys_way = std::fs::remove_dir_all(entry.path());
            }
        }
    }
}

/// Unpacks or copies the verified files into `folder`; SHA-256 by path below it.
fn stage(
    set: &DataSet<'_>,
    sources: &[PathBuf],
    folder: &Path,
    observe: &mut dyn FnMut(DataEvent),
) -> Result<BTreeMap<String, String>, DataError> {
    let mut hashes = BTreeMap::new();
    for (file, source) in set.files.iter().zip(sources) {
        match set.content {
            Content::Archives { root, largest } => {
                observe(DataEvent::Unpacking(file.name.to_owned()));
                let unpacked = unpack::unpack(source, root, largest, folder);
                hashes.extend(unpacked.map_err(|trouble| trouble.of(file.name))?);
            }
            Content::Files => {
                let bytes = files::read_bounded(source, file.bytes)?;
                files::write_new(&folder.join(file.name), &bytes)?;
                hashes.insert(file.name.to_owned(), files::sha256_hex(&bytes));
            }
        }
    }
    Ok(hashes)
}

fn refuse_link(path: &Path) -> Result<(), DataError> {
    match std::fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_symlink() => {
            Err(DataError::NotPlain { path: path.to_path_buf() })
        }
        Ok(_) => Ok(()),
        // Where nothing is, or nothing can be because a file stands above it, there is no link.
        Err(error) if matches!(error.kind(), ErrorKind::NotFound | ErrorKind::NotADirectory) => {
            Ok(())
        }
        Err(source) => Err(FileError::Read { path: path.to_path_buf(), source }.into()),
    }
}

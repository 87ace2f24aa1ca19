//! Getting the files of a record: from a folder, or over HTTP piece by piece.
//!
//! A file that is being fetched is called `.part`. It survives the death of the program and is continued, and it counts
//! for nothing until its size and sum are right.

use std::path::{Path, PathBuf};
use std::time::Duration;

use super::http::{Failure, Server};
use super::{Checksum, DataError, DataEvent, DataSet, Origin, RemoteFile, md5::Md5};
use crate::files::{self, FileError};

/// How long to wait for a server, and how often to ask again.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Patience {
    /// Tries in a row that brought nothing before giving up.
    pub attempts: u32,
    /// The wait after the first of them; it doubles with each.
    pub first_wait: Duration,
    /// How long a connection may take.
    pub connect: Duration,
    /// How long a server may say nothing.
    pub silence: Duration,
}

impl Default for Patience {
    fn default() -> Self {
        Self {
            attempts: 4,
            first_wait: Duration::from_secs(1),
            connect: Duration::from_secs(15),
            silence: Duration::from_mins(1),
        }
    }
}

/// A server that gives a byte at a time is left after this many tries, whatever it brings.
const MOST_TRIES: u32 = 200;

/// Fetches the files of one data set.
pub(super) struct Fetcher<'a> {
    pub(super) set: DataSet<'a>,
    pub(super) origin: &'a Origin,
    pub(super) patience: Patience,
    /// The folder of unfinished files.
    pub(super) parts: &'a Path,
}

impl Fetcher<'_> {
    /// Where `file` is taken from.
    pub(super) fn address(&self, file: &RemoteFile<'_>) -> String {
        match self.origin {
            Origin::Published => self.set.record.address(file.name),
            Origin::Server(base) => format!("{}/{}", base.trim_end_matches('/'), file.name),
            Origin::Folder(folder) => folder.join(file.name).display().to_string(),
        }
    }

    /// Where the unfinished `file` lies.
    pub(super) fn part(&self, file: &RemoteFile<'_>) -> PathBuf {
        self.parts.join(format!("{}.part", file.name))
    }

    /// A verified `file`: in the folder it was taken from, or as a finished `.part`.
    pub(super) fn fetch(
        &self,
        file: &RemoteFile<'_>,
        observe: &mut dyn FnMut(DataEvent),
    ) -> Result<PathBuf, DataError> {
        if let Origin::Folder(folder) = self.origin {
            let path = folder.join(file.name);
            if !path.is_file() {
                let (file, folder) = (file.name.to_owned(), folder.clone());
                return Err(DataError::NotInFolder { file, folder });
            }
            observe(DataEvent::Checking(file.name.to_owned()));
            self.check(file, &path)?;
            return Ok(path);
        }
        let part = self.part(file);
        let mut is_continued = part_size(&part)? > 0;
        loop {
            self.download(file, &part, observe)?;
            observe(DataEvent::Checking(file.name.to_owned()));
            let error = match self.check(file, &part) {
                Ok(()) => return Ok(part),
                Err(error @ DataError::WrongSum { .. }) => error,
                Err(error) => return Err(error),
            };
            files::remove(&part)?;
            // The first piece may be of another time or server; a file fetched in one go has no such excuse.
            if !std::mem::take(&mut is_continued) {
                return Err(error);
            }
            observe(DataEvent::StartingOver(file.name.to_owned()));
        }
    }

    /// Whether `path` has the published size and sum.
    fn check(&self, file: &RemoteFile<'_>, path: &Path) -> Result<(), DataError> {
        let wrong = |found, expected| DataError::WrongSum {
            file: file.name.to_owned(),
            found,
            expected,
            address: self.address(file),
        };
        let fail = |source| FileError::Read { path: path.to_path_buf(), source };
        let found = std::fs::metadata(path).map_err(fail)?.len();
        if found != file.bytes {
            return Err(wrong(format!("{found} bytes"), format!("{} bytes", file.bytes)));
        }
        let (found, is_right) = match file.checksum {
            Checksum::Md5(expected) => {
                let mut sum = Md5::new();
                files::for_each_piece(path, |piece| sum.update(piece))?;
                let found = sum.finish();
                (format!("MD5 {found}"), found == expected)
            }
            Checksum::Sha256(expected) => {
                let found = files::sha256_of_file(path)?;
                (format!("SHA-256 {found}"), found == expected)
            }
        };
        if is_right { Ok(()) } else { Err(wrong(found, file.checksum.to_string())) }
    }

    /// Asks until `part` has as many bytes as `file`.
    fn download(
        &self,
        file: &RemoteFile<'_>,
        part: &Path,
        observe: &mut dyn FnMut(DataEvent),
    ) -> Result<(), DataError> {
        let address = self.address(file);
        let server = Server::new(&address, *self.origin == Origin::Published, self.patience);
        let (mut in_vain, mut tries) = (0, 0);
        loop {
            let before = part_size(part)?;
            if before == file.bytes {
                return Ok(());
            }
            tries += 1;
            let failure = match server.fetch(file, part, before, observe) {
                Ok(()) => continue,
                Err(failure) => failure,
            };
            let kept = part_size(part)?;
            let reason = match failure {
                Failure::Passing(reason) => reason,
                Failure::Final(reason) => {
                    let (file, command) = (file.name.to_owned(), self.set.command.to_owned());
                    return Err(DataError::Refused { file, reason, address, command });
                }
                Failure::Disk(error) => return Err(error.into()),
            };
            in_vain = if kept > before { 1 } else { in_vain + 1 };
            if in_vain >= self.patience.attempts || tries >= MOST_TRIES {
                return Err(DataError::Unreachable {
                    file: file.name.to_owned(),
                    reason,
                    attempts: tries,
                    kept,
                    bytes: file.bytes,
                    address,
                    command: self.set.command.to_owned(),
                });
            }
            let wait = self.patience.first_wait.saturating_mul(1 << (in_vain - 1).min(6));
            observe(DataEvent::Retrying { reason, wait });
            std::thread::sleep(wait);
        }
    }
}

/// The size of an unfinished file, 0 if there is none. A link is refused: who follows it writes elsewhere.
pub(super) fn part_size(path: &Path) -> Result<u64, DataError> {
    match std::fs::symlink_metadata(path) {
        Ok(metadata) if metadata.is_file() => Ok(metadata.len()),
        Ok(_) => Err(DataError::NotPlain { path: path.to_path_buf() }),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(0),
        Err(source) => Err(FileError::Read { path: path.to_path_buf(), source }.into()),
    }
}

//! The only place that writes files. A file that exists is complete: it is written beside its target under a
//! temporary name, flushed, synced and renamed.
//!
//! `kill -9` at any moment leaves either the old file, or the new one, or a stray `.tmp…` file beside it, never a
//! half-written target.

use std::io::{self, Read, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};

/// Why a file could not be written or read.
#[derive(Debug, thiserror::Error)]
pub enum FileError {
    #[error("cannot create folder `{path}`: {source}")]
    CreateFolder { path: PathBuf, source: io::Error },
    #[error("cannot move folder `{from}` to `{to}`: {source}")]
    MoveFolder { from: PathBuf, to: PathBuf, source: io::Error },
    #[error("cannot write `{path}`: {source}")]
    Write { path: PathBuf, source: io::Error },
    #[error("cannot read `{path}`: {source}")]
    Read { path: PathBuf, source: io::Error },
    #[error("`{path}` has {found} bytes, more than the limit of {limit}")]
    TooLarge { path: PathBuf, found: u64, limit: u64 },
}

/// Makes sure that `folder` exists.
pub fn create_folder(folder: &Path) -> Result<(), FileError> {
    std::fs::create_dir_all(folder)
        .map_err(|source| FileError::CreateFolder { path: folder.to_path_buf(), source })
}

/// Says whether a file can be made in `folder`, by making one and taking it away again.
pub fn check_writable(folder: &Path) -> Result<(), FileError> {
    tempfile::Builder::new()
        .prefix(".tmp")
        .tempfile_in(folder)
        .map(drop)
        .map_err(|source| FileError::Write { path: folder.to_path_buf(), source })
}

/// Writes `bytes` to `path` atomically, creating its folder if needed.
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    write_atomic_with(path, |file| file.write_all(bytes))
}

/// Writes `path` atomically through `fill`, for contents too large to hold in memory.
pub fn write_atomic_with(
    path: &Path,
    fill: impl FnOnce(&mut std::fs::File) -> io::Result<()>,
) -> Result<(), FileError> {
    let folder = path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."));
    create_folder(folder)?;
    let fail = |source| FileError::Write { path: path.to_path_buf(), source };
    let mut temporary =
        tempfile::Builder::new().prefix(".tmp").tempfile_in(folder).map_err(fail)?;
    fill(temporary.as_file_mut()).map_err(fail)?;
    temporary.as_file().sync_all().map_err(fail)?;
    #[cfg(unix)]
    {
        use std::os::unix::fs::PermissionsExt;
        temporary
            .as_file()
            .set_permissions(std::fs::Permissions::from_mode(0o644))
            .map_err(fail)?;
    }
    temporary.persist(path).map_err(|e| fail(e.error))?;
    // The rename itself must survive a power cut: sync the folder too (not every system can).
    if let Ok(handle) = std::fs::File::open(folder) {
        let _unsupported_on_some_systems = handle.sync_all();
    }
    Ok(())
}

/// Whose content a published folder has.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Published {
    /// Ours.
    Ours,
    /// A folder was there already; it was not touched, and ours stays where it was.
    AlreadyThere,
}

/// A new folder in `folder` with a name nobody else uses; it goes away with the value.
pub fn temporary_folder(folder: &Path, prefix: &str) -> Result<tempfile::TempDir, FileError> {
    create_folder(folder)?;
    let fail = |source| FileError::CreateFolder { path: folder.join(prefix), source };
    tempfile::Builder::new().prefix(prefix).tempdir_in(folder).map_err(fail)
}

/// Writes a file that must not exist yet, in a folder that is not published yet.
pub fn write_new(path: &Path, bytes: &[u8]) -> Result<(), FileError> {
    if let Some(folder) = path.parent() {
        create_folder(folder)?;
    }
    let fail = |source| FileError::Write { path: path.to_path_buf(), source };
    let mut file =
        std::fs::File::options().write(true).create_new(true).open(path).map_err(fail)?;
    file.write_all(bytes).and_then(|()| file.sync_all()).map_err(fail)
}

/// Moves a complete folder to its place in one step, on the same file system. Never replaces a folder with something in it.
pub fn publish_folder(from: &Path, to: &Path) -> Result<Published, FileError> {
    #[expect(clippy::disallowed_methods, reason = "this is the place that publishes")]
    let renamed = std::fs::rename(from, to);
    match renamed {
        Ok(()) => Ok(Published::Ours),
        Err(error)
            if matches!(
                error.kind(),
                io::ErrorKind::DirectoryNotEmpty | io::ErrorKind::AlreadyExists
            ) =>
        {
            Ok(Published::AlreadyThere)
        }
        Err(source) => {
            Err(FileError::MoveFolder { from: from.to_path_buf(), to: to.to_path_buf(), source })
        }
    }
}

/// Reads a whole file, refusing more than `limit` bytes.
pub fn read_bounded(path: &Path, limit: u64) -> Result<Vec<u8>, FileError> {
    let fail = |source| FileError::Read { path: path.to_path_buf(), source };
    let file = std::fs::File::open(path).map_err(fail)?;
    let metadata = file.metadata().map_err(fail)?;
    if metadata.is_dir() {
        return Err(fail(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder")));
    }
    let too_large = |found| FileError::TooLarge { path: path.to_path_buf(), found, limit };
    if metadata.len() > limit {
        return Err(too_large(metadata.len()));
    }
    // A file can grow, and special files have no length: the reader itself is bounded as well.
    let mut bytes = Vec::with_capacity(usize::try_from(metadata.len()).unwrap_or(0));
    file.take(limit.saturating_add(1)).read_to_end(&mut bytes).map_err(fail)?;
    if bytes.len() as u64 > limit {
        return Err(too_large(bytes.len() as u64));
    }
    Ok(bytes)
}

/// SHA-256 of bytes, as 64 lower-case hexadecimal digits.
#[must_use]
pub fn sha256_hex(bytes: &[u8]) -> String {
    hex(&Sha256::digest(bytes))
}

/// SHA-256 of a file's content, read in pieces.
pub fn sha256_of_file(path: &Path) -> Result<String, FileError> {
    let fail = |source| FileError::Read { path: path.to_path_buf(), source };
    let mut file = std::fs::File::open(path).map_err(fail)?;
    let mut hasher = Sha256::new();
    let mut buffer = vec![0_u8; 1 << 16];
    loop {
        let count = file.read(&mut buffer).map_err(fail)?;
        if count == 0 {
            return Ok(hex(&hasher.finalize()));
        }
        hasher.update(&buffer[..count]);
    }
}

fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap_or(());
        text
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_failed_write_leaves_the_old_file_and_nothing_else() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.txt");
        write_atomic(&path, b"old").unwrap();
        let result = write_atomic_with(&path, |file| {
            file.write_all(b"half of the new")?;
            Err(io::Error::other("disk full"))
        });
        assert!(matches!(result, Err(FileError::Write { .. })));
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(std::fs::read_dir(folder.path()).unwrap().count(), 1);
    }

    #[test]
    fn publishing_a_folder_never_replaces_one_with_something_in_it() {
        let folder = tempfile::tempdir().unwrap();
        let (first, second, place) = (
            folder.path().join("first"),
            folder.path().join("second"),
            folder.path().join("place"),
        );
        write_new(&first.join("a"), b"1").unwrap();
        write_new(&second.join("a"), b"2").unwrap();
        assert_eq!(publish_folder(&first, &place).unwrap(), Published::Ours);
        assert_eq!(publish_folder(&second, &place).unwrap(), Published::AlreadyThere);
        assert_eq!(std::fs::read(place.join("a")).unwrap(), b"1");
        assert!(matches!(write_new(&place.join("a"), b"3"), Err(FileError::Write { .. })));
    }

    #[test]
    fn reading_stops_at_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("big");
        write_atomic(&path, &[7; 100]).unwrap();
        assert_eq!(read_bounded(&path, 100).unwrap().len(), 100);
        assert!(matches!(read_bounded(&path, 99), Err(FileError::TooLarge { found: 100, .. })));
    }

    #[test]
    fn sha256_of_the_empty_string_is_the_published_one() {
        let want = "e3b0c44298fc1c149afbf4c8996fb92427ae41e4649b934ca495991b7852b855";
        assert_eq!(sha256_hex(b""), want);
    }
}

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
    let temporary = write_beside(path, fill)?;
    publish(path, temporary.persist(path))
}

/// The same for a file that must not exist yet: one that does is left alone.
pub fn write_new_atomic_with(
    path: &Path,
    fill: impl FnOnce(&mut std::fs::File) -> io::Result<()>,
) -> Result<(), FileError> {
    let temporary = write_beside(path, fill)?;
    publish(path, temporary.persist_noclobber(path))
}

/// The folder that `path` lies in.
fn folder_of(path: &Path) -> &Path {
    path.parent().filter(|p| !p.as_os_str().is_empty()).unwrap_or(Path::new("."))
}

/// Fills a temporary file in the folder of `path`, creating the folder if needed.
fn write_beside(
    path: &Path,
    fill: impl FnOnce(&mut std::fs::File) -> io::Result<()>,
) -> Result<tempfile::NamedTempFile, FileError> {
    let folder = folder_of(path);
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
    Ok(temporary)
}

/// The end of a write: the renamed file, made to survive a power cut.
fn publish(
    path: &Path,
    renamed: Result<std::fs::File, tempfile::PersistError>,
) -> Result<(), FileError> {
    renamed.map_err(|e| FileError::Write { path: path.to_path_buf(), source: e.error })?;
    // The rename itself must survive it too: sync the folder (not every system can).
    if let Ok(handle) = std::fs::File::open(folder_of(path)) {
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
    write_new_with(path, |file| file.write_all(bytes))
}

/// Writes a file that must not exist yet through `fill`, for contents too large to hold in memory.
pub fn write_new_with(
    path: &Path,
    fill: impl FnOnce(&mut std::fs::File) -> io::Result<()>,
) -> Result<(), FileError> {
    if let Some(folder) = path.parent() {
        create_folder(folder)?;
    }
    let fail = |source| FileError::Write { path: path.to_path_buf(), source };
    let mut file =
        std::fs::File::options().write(true).create_new(true).open(path).map_err(fail)?;
    fill(&mut file).and_then(|()| file.sync_all()).map_err(fail)
}

/// Opens a file that grows over several lives of the program, at its end. It counts for nothing under this name.
pub fn open_to_append(path: &Path) -> Result<std::fs::File, FileError> {
    if let Some(folder) = path.parent() {
        create_folder(folder)?;
    }
    let fail = |source| FileError::Write { path: path.to_path_buf(), source };
    std::fs::File::options().append(true).create(true).open(path).map_err(fail)
}

/// Makes the first file in `folder` whose name, a number and `extension`, nobody has used yet. Several processes may ask at
/// once, and get different files.
pub fn new_numbered(folder: &Path, extension: &str) -> Result<(PathBuf, std::fs::File), FileError> {
    create_folder(folder)?;
    // Counting what is there keeps thousands of processes from trying all numbers; some may be left out, none twice.
    let taken = list(folder)?.iter().filter(|path| has_extension(path, extension)).count();
    let mut number = taken + 1;
    loop {
        let path = folder.join(format!("{number:05}.{extension}"));
        match std::fs::File::options().append(true).create_new(true).open(&path) {
            Ok(file) => return Ok((path, file)),
            Err(error) if error.kind() == io::ErrorKind::AlreadyExists => number += 1,
            Err(source) => return Err(FileError::Write { path, source }),
        }
    }
}

/// Whether the name of `path` ends in `.extension`.
#[must_use]
pub fn has_extension(path: &Path, extension: &str) -> bool {
    path.extension().is_some_and(|found| found == extension)
}

/// Removes a folder with all that is in it; it need not be there.
pub fn remove_folder(path: &Path) -> Result<(), FileError> {
    match std::fs::remove_dir_all(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(FileError::Write { path: path.to_path_buf(), source })
        }
        _ => Ok(()),
    }
}

/// Removes a file that need not be there.
pub fn remove(path: &Path) -> Result<(), FileError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => {
            Err(FileError::Write { path: path.to_path_buf(), source })
        }
        _ => Ok(()),
    }
}

/// Moves a complete file to its place, on the same file system; its folder is created. Never replaces another file.
pub fn publish_file(from: &Path, to: &Path) -> Result<(), FileError> {
    if let Some(folder) = to.parent() {
        create_folder(folder)?;
    }
    let fail = |source| FileError::Write { path: to.to_path_buf(), source };
    if std::fs::symlink_metadata(to).is_ok() {
        return Err(fail(io::ErrorKind::AlreadyExists.into()));
    }
    #[expect(clippy::disallowed_methods, reason = "this is the place that publishes")]
    std::fs::rename(from, to).map_err(fail)
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

/// Opens a file for reading it in pieces.
pub fn open(path: &Path) -> Result<std::fs::File, FileError> {
    std::fs::File::open(path).map_err(|source| FileError::Read { path: path.to_path_buf(), source })
}

/// What lies directly in `folder`, sorted by name.
pub fn list(folder: &Path) -> Result<Vec<PathBuf>, FileError> {
    let fail = |source| FileError::Read { path: folder.to_path_buf(), source };
    let entries = std::fs::read_dir(folder).map_err(fail)?;
    let mut paths =
        entries.map(|entry| Ok(entry.map_err(fail)?.path())).collect::<Result<Vec<_>, _>>()?;
    paths.sort_unstable();
    Ok(paths)
}

/// Number of bytes of a file; a folder is an error.
pub fn length(path: &Path) -> Result<u64, FileError> {
    let fail = |source| FileError::Read { path: path.to_path_buf(), source };
    let metadata = std::fs::metadata(path).map_err(fail)?;
    if metadata.is_dir() {
        return Err(fail(io::Error::new(io::ErrorKind::IsADirectory, "it is a folder")));
    }
    Ok(metadata.len())
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
    let mut hasher = Sha256::new();
    for_each_piece(path, |piece| hasher.update(piece))?;
    Ok(hex(&hasher.finalize()))
}

/// Reads a file from start to end in pieces.
pub fn for_each_piece(path: &Path, mut take: impl FnMut(&[u8])) -> Result<(), FileError> {
    let fail = |source| FileError::Read { path: path.to_path_buf(), source };
    let mut file = std::fs::File::open(path).map_err(fail)?;
    let mut buffer = vec![0_u8; 1 << 16];
    loop {
        let count = file.read(&mut buffer).map_err(fail)?;
        if count == 0 {
            return Ok(());
        }
        take(&buffer[..count]);
    }
}

/// Bytes as lower-case hexadecimal digits.
pub(crate) fn hex(bytes: &[u8]) -> String {
    use std::fmt::Write as _;
    bytes.iter().fold(String::with_capacity(2 * bytes.len()), |mut text, byte| {
        write!(text, "{byte:02x}").unwrap_or(());
        text
    })
}

/// A text from a file, made safe and short enough for a terminal.
#[must_use]
pub fn printable(text: &str) -> String {
    const LONGEST: usize = 200;
    text.chars().take(LONGEST).flat_map(char::escape_debug).collect()
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
    fn a_new_file_never_replaces_one() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.txt");
        let write = |text: &'static [u8]| write_new_atomic_with(&path, |file| file.write_all(text));
        write(b"first").unwrap();
        assert!(matches!(write(b"second"), Err(FileError::Write { .. })));
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
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
    fn publishing_a_file_never_replaces_one() {
        let folder = tempfile::tempdir().unwrap();
        let (from, to) = (folder.path().join("from"), folder.path().join("a/to"));
        write_new(&from, b"1").unwrap();
        publish_file(&from, &to).unwrap();
        write_new(&from, b"2").unwrap();
        assert!(matches!(publish_file(&from, &to), Err(FileError::Write { .. })));
        assert_eq!(std::fs::read(&to).unwrap(), b"1");
    }

    #[test]
    fn a_file_grows_at_its_end_and_may_be_removed_twice() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("b/growing.part");
        open_to_append(&path).unwrap().write_all(b"one ").unwrap();
        open_to_append(&path).unwrap().write_all(b"two").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"one two");
        remove(&path).unwrap();
        remove(&path).unwrap();
        assert!(!path.exists());
    }

    #[test]
    fn numbered_files_are_never_given_twice() {
        let folder = tempfile::tempdir().unwrap();
        let next = || new_numbered(&folder.path().join("a"), "log").unwrap().0;
        let (first, second) = (next(), next());
        remove(&first).unwrap();
        let third = next();
        assert!(second.ends_with("a/00002.log") && third.ends_with("a/00003.log"), "{third:?}");
        remove_folder(&folder.path().join("a")).unwrap();
        remove_folder(&folder.path().join("a")).unwrap();
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

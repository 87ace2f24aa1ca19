//! Unpacking a `.tar.gz`: plain files and folders below one expected folder, nothing else.
//!
//! Refused: absolute paths, `..`, links, devices, sparse files, two files of one name, more entries or bytes than
//! announced, an archive without files. Left out: what macOS adds (`._*`, `.DS_Store`, `__MACOSX`).

use std::cell::Cell;
use std::collections::BTreeMap;
use std::io::{self, BufReader, Read, Write};
use std::path::{Path, PathBuf};
use std::rc::Rc;

use flate2::read::MultiGzDecoder;
use sha2::{Digest, Sha256};
use tar::{Archive, EntryType};

use super::DataError;
use crate::assets::wheel::is_plain_relative;
use crate::files::{self, FileError};

const MOST_ENTRIES: usize = 200_000;
/// What may stand between two files: headers and long names. The reader keeps names in memory, so they are bounded.
const LARGEST_HEADER: u64 = 1 << 20;
const PIECE: usize = 1 << 16;

/// Bytes that may be read before somebody looks again.
type Allowance = Rc<Cell<u64>>;

/// A reader that fails once its allowance is used up.
struct Metered<R> {
    inner: R,
    left: Allowance,
}

impl<R: Read> Read for Metered<R> {
    fn read(&mut self, buffer: &mut [u8]) -> io::Result<usize> {
        let left = self.left.get();
        if left == 0 {
            return Err(io::Error::other("a header is longer than any needed"));
        }
        let most = usize::try_from(left).unwrap_or(usize::MAX).min(buffer.len());
        let count = self.inner.read(&mut buffer[..most])?;
        self.left.set(left - count as u64);
        Ok(count)
    }
}

/// Why an archive was not unpacked.
#[derive(Debug, thiserror::Error)]
pub(super) enum Trouble {
    /// It holds what it may not.
    #[error("{0}")]
    Archive(String),
    /// What it holds cannot be written.
    #[error(transparent)]
    Files(#[from] FileError),
}

impl Trouble {
    /// The error a person sees, about the archive called `file`.
    pub(super) fn of(self, file: &str) -> DataError {
        match self {
            Self::Archive(reason) => DataError::BadArchive { file: file.to_owned(), reason },
            Self::Files(error) => error.into(),
        }
    }
}

/// Unpacks what lies below `root` in `archive` into `destination`, at most `largest` bytes; SHA-256 by path below `root`.
pub(super) fn unpack(
    archive: &Path,
    root: &str,
    largest: u64,
    destination: &Path,
) -> Result<BTreeMap<String, String>, Trouble> {
    let unreadable = |error: io::Error| Trouble::Archive(format!("unreadable ({error})"));
    let file = std::fs::File::open(archive)
        .map_err(|source| FileError::Read { path: archive.to_path_buf(), source })?;
    let left: Allowance = Rc::new(Cell::new(LARGEST_HEADER));
    let reader = Metered { inner: MultiGzDecoder::new(BufReader::new(file)), left: left.clone() };
    let mut archive = Archive::new(reader);
    let (mut hashes, mut total) = (BTreeMap::new(), 0_u64);
    for (index, entry) in archive.entries().map_err(unreadable)?.enumerate() {
        let mut entry = entry.map_err(unreadable)?;
        let size = entry.size();
        total = total.saturating_add(size);
        if index >= MOST_ENTRIES {
            return Err(Trouble::Archive(format!("more than {MOST_ENTRIES} entries")));
        }
        if total > largest {
            return Err(Trouble::Archive(format!("more than {largest} bytes unpacked")));
        }
        left.set(size.saturating_add(LARGEST_HEADER));
        let name = std::str::from_utf8(&entry.path_bytes())
            .map_err(|_| Trouble::Archive("a name that is not UTF-8".to_owned()))?
            .to_owned();
        let kind = entry.header().entry_type();
        if kind == EntryType::XGlobalHeader || is_clutter(&name) {
            continue;
        }
        let Some(path) = below(&name, root, kind).map_err(Trouble::Archive)? else { continue };
        if hashes.contains_key(&path) {
            return Err(Trouble::Archive(format!("two files `{name}`")));
        }
        if is_file_and_folder(&hashes, &path) {
            return Err(Trouble::Archive(format!("a file and a folder of one name at `{name}`")));
        }
        let place = path.split('/').fold(destination.to_path_buf(), |p: PathBuf, s| p.join(s));
        let hash = write_hashed(&mut entry, &place)?;
        hashes.insert(path, hash);
    }
    if hashes.is_empty() {
        return Err(Trouble::Archive(format!("no files below `{root}`")));
    }
    Ok(hashes)
}

/// Whether `path` is a folder of one of the `known` files, or lies in one of them as if it were a folder.
fn is_file_and_folder(known: &BTreeMap<String, String>, path: &str) -> bool {
    let inside = format!("{path}/");
    let folder = known.range(inside.clone()..).next().is_some_and(|(k, _)| k.starts_with(&inside));
    folder || path.match_indices('/').any(|(end, _)| known.contains_key(&path[..end]))
}

/// The path below `root` of a plain file, none for a folder; an error for everything else.
fn below(name: &str, root: &str, kind: EntryType) -> Result<Option<String>, String> {
    let is_folder = kind == EntryType::Directory;
    let plain = name.strip_prefix("./").unwrap_or(name);
    let plain = if is_folder { plain.strip_suffix('/').unwrap_or(plain) } else { plain };
    if is_folder && matches!(plain, "" | ".") {
        return Ok(None);
    }
    if !is_plain_relative(plain) {
        return Err(format!("`{name}` is not a plain path"));
    }
    if !is_folder && kind != EntryType::Regular {
        return Err(format!("`{name}` is neither a file nor a folder"));
    }
    match plain.strip_prefix(root) {
        Some("") if is_folder => Ok(None),
        Some(rest) if rest.starts_with('/') => Ok((!is_folder).then(|| rest[1..].to_owned())),
        _ => Err(format!("`{name}` is not below `{root}`")),
    }
}

/// What macOS packs beside the files.
fn is_clutter(name: &str) -> bool {
    name.split('/').any(|step| matches!(step, ".DS_Store" | "__MACOSX") || step.starts_with("._"))
}

/// Writes what is in `reader` to a new file; its SHA-256.
fn write_hashed(reader: &mut impl Read, place: &Path) -> Result<String, Trouble> {
    let mut hasher = Sha256::new();
    let mut unreadable = None;
    files::write_new_with(place, |file| {
        let mut buffer = vec![0; PIECE];
        loop {
            let count = match reader.read(&mut buffer) {
                Ok(count) => count,
                // No fault of the file that is being written.
                Err(error) => {
                    unreadable = Some(error);
                    return Ok(());
                }
            };
            if count == 0 {
                return Ok(());
            }
            hasher.update(&buffer[..count]);
            file.write_all(&buffer[..count])?;
        }
    })?;
    match unreadable {
        Some(error) => Err(Trouble::Archive(format!("unreadable ({error})"))),
        None => Ok(files::hex(&hasher.finalize())),
    }
}

#[cfg(test)]
mod tests {
    use flate2::Compression;
    use flate2::write::GzEncoder;
    use tar::Header;

    use super::*;

    /// An archive with entries as they are given: the header's own check of names is passed by.
    fn packed(folder: &Path, entries: &[(EntryType, &str, &[u8])]) -> PathBuf {
        let mut builder = tar::Builder::new(GzEncoder::new(Vec::new(), Compression::fast()));
        for (kind, name, bytes) in entries {
            let mut header = Header::new_gnu();
            header.as_old_mut().name[..name.len()].copy_from_slice(name.as_bytes());
            header.set_entry_type(*kind);
            header.set_size(bytes.len() as u64);
            header.set_mode(0o644);
            if kind.is_symlink() || kind.is_hard_link() {
                header.as_old_mut().linkname[..11].copy_from_slice(b"/etc/passwd");
            }
            header.set_cksum();
            builder.append(&header, *bytes).unwrap();
        }
        let path = folder.join("a.tar.gz");
        files::write_atomic(&path, &builder.into_inner().unwrap().finish().unwrap()).unwrap();
        path
    }

    fn unpacked(entries: &[(EntryType, &str, &[u8])]) -> Result<Vec<String>, Trouble> {
        let folder = tempfile::tempdir().unwrap();
        let archive = packed(folder.path(), entries);
        let inside = folder.path().join("x/y");
        let result = unpack(&archive, "root", 10_000, &inside);
        let outside: Vec<_> = std::fs::read_dir(folder.path()).unwrap().collect();
        assert!(outside.len() <= 2, "{outside:?}");
        Ok(result?.into_keys().collect())
    }

    const FILE: EntryType = EntryType::Regular;
    const FOLDER: EntryType = EntryType::Directory;

    #[test]
    fn files_below_the_root_come_out_and_what_macos_added_stays() {
        let folder = tempfile::tempdir().unwrap();
        let archive = packed(
            folder.path(),
            &[
                (FOLDER, "./", b""),
                (FILE, "._root", b"x"),
                (FOLDER, "./root/", b""),
                (FILE, "root/a", b"1"),
                (FILE, "./root/b/c.xml", b"22"),
                (FILE, "root/b/._c.xml", b"x"),
                (FILE, "root/.DS_Store", b"x"),
                (FILE, "__MACOSX/root/a", b"x"),
            ],
        );
        let out = folder.path().join("out");
        let hashes = unpack(&archive, "root", 100, &out).unwrap();
        let want = [("a", files::sha256_hex(b"1")), ("b/c.xml", files::sha256_hex(b"22"))];
        assert_eq!(hashes, BTreeMap::from(want.map(|(name, hash)| (name.to_owned(), hash))));
        assert_eq!(std::fs::read(out.join("b/c.xml")).unwrap(), b"22");
        assert_eq!(std::fs::read_dir(&out).unwrap().count(), 2);
    }

    #[test]
    fn whatever_is_not_a_plain_file_below_the_root_is_refused_by_name() {
        for (kind, name) in [
            (FILE, "../evil"),
            (FILE, "/evil"),
            (FILE, "root/../../evil"),
            (FILE, "root\\evil"),
            (FILE, "root//evil"),
            (FILE, "other/evil"),
            (FILE, "rooted/evil"),
            (FILE, "root"),
            (FOLDER, "root/../../evil"),
            (EntryType::Symlink, "root/evil"),
            (EntryType::Link, "root/evil"),
            (EntryType::Fifo, "root/evil"),
            (EntryType::Char, "root/evil"),
        ] {
            let text = unpacked(&[(kind, name, b"")]).unwrap_err().to_string();
            assert!(text.contains(name), "{name}: {text}");
        }
    }

    #[test]
    fn two_files_of_one_name_are_refused() {
        let text =
            unpacked(&[(FILE, "root/a", b"1"), (FILE, "root/a", b"1")]).unwrap_err().to_string();
        assert_eq!(text, "two files `root/a`");
        for [first, second] in [["root/a", "root/a/b"], ["root/a/b", "root/a"]] {
            let text = unpacked(&[(FILE, first, b"1"), (FILE, second, b"1")]).unwrap_err();
            let text = text.to_string();
            assert_eq!(text, format!("a file and a folder of one name at `{second}`"));
        }
    }

    #[test]
    fn an_archive_without_files_is_refused() {
        assert_eq!(
            unpacked(&[(FOLDER, "root/", b"")]).unwrap_err().to_string(),
            "no files below `root`"
        );
        assert!(unpacked(&[]).is_err());
    }

    #[test]
    fn more_bytes_than_announced_are_stopped_before_they_are_written() {
        let text = unpacked(&[(FILE, "root/a", &[0; 6000]), (FILE, "root/b", &[0; 6000])]);
        assert_eq!(text.unwrap_err().to_string(), "more than 10000 bytes unpacked");
    }

    #[test]
    fn a_name_of_gigabytes_is_not_read_into_memory() {
        let long = vec![b'a'; 2 * LARGEST_HEADER as usize];
        let entries =
            [(EntryType::GNULongName, "././@LongLink", &long[..]), (FILE, "root/a", b"1")];
        let text = unpacked(&entries).unwrap_err().to_string();
        assert!(text.contains("longer than any needed"), "{text}");
    }

    #[test]
    fn a_long_name_that_is_plain_is_read() {
        let long = format!("root/{}/a", "b".repeat(200));
        let entries = [
            (EntryType::GNULongName, "././@LongLink", long.as_bytes()),
            (FILE, "root/short", b"1"),
        ];
        assert_eq!(unpacked(&entries).unwrap(), [long["root/".len()..].to_owned()]);
    }

    #[test]
    fn something_that_is_no_archive_and_half_an_archive_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let whole = packed(folder.path(), &[(FILE, "root/a", &[7; 5000])]);
        let bytes = std::fs::read(&whole).unwrap();
        let broken = folder.path().join("broken.tar.gz");
        for content in [b"not an archive".as_slice(), &bytes[..bytes.len() / 2]] {
            files::write_atomic(&broken, content).unwrap();
            assert!(unpack(&broken, "root", 10_000, &folder.path().join("out")).is_err());
        }
    }
}

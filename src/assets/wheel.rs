//! Taking files out of a wheel, which is a ZIP archive. Input is hostile: only plain files with plain relative names come
//! out, never links, and the sizes are bounded whatever the archive says.

use std::collections::BTreeMap;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use zip::ZipArchive;

use super::AssetError;
use crate::files;

/// The largest wheel read, 5 times the largest used.
const LARGEST_WHEEL: u64 = 256 << 20;
/// The largest file taken out, 4 times the largest used.
const LARGEST_FILE: u64 = 64 << 20;
/// The most bytes taken out, 7 times the most used.
const LARGEST_TOTAL: u64 = 256 << 20;
/// The most entries looked at, 10 times the most used.
const MOST_ENTRIES: usize = 20_000;

/// Takes the files out of `wheel` that `keeps` wants, below `destination`; their SHA-256 by name.
pub(super) fn unpack(
    wheel: &Path,
    destination: &Path,
    keeps: impl Fn(&str) -> bool,
) -> Result<BTreeMap<String, String>, AssetError> {
    let bad = |reason: String| AssetError::BadWheel { reason, wheel: wheel.to_path_buf() };
    let file = std::fs::File::open(wheel).map_err(|error| bad(error.to_string()))?;
    let size = file.metadata().map_err(|error| bad(error.to_string()))?.len();
    if size > LARGEST_WHEEL {
        return Err(bad(format!("{size} bytes, more than the limit of {LARGEST_WHEEL}")));
    }
    let mut archive =
        ZipArchive::new(BufReader::new(file)).map_err(|error| bad(error.to_string()))?;
    if archive.len() > MOST_ENTRIES {
        let found = archive.len();
        return Err(bad(format!("{found} entries, more than the limit of {MOST_ENTRIES}")));
    }
    let mut hashes = BTreeMap::new();
    let mut total = 0;
    for index in 0..archive.len() {
        let entry = archive.by_index(index).map_err(|error| bad(error.to_string()))?;
        let name = entry.name().map_err(|error| bad(error.to_string()))?.into_owned();
        if !keeps(&name) || entry.is_dir() {
            continue;
        }
        if !is_plain_relative(&name) || entry.is_symlink() {
            return Err(bad(format!("`{name}` is not a plain file below the archive's root")));
        }
        let mut bytes = Vec::new();
        entry
            .take(LARGEST_FILE + 1)
            .read_to_end(&mut bytes)
            .map_err(|error| bad(format!("`{name}` cannot be unpacked ({error})")))?;
        total += bytes.len() as u64;
        if bytes.len() as u64 > LARGEST_FILE || total > LARGEST_TOTAL {
            return Err(bad(format!("`{name}` passes the limit on unpacked bytes")));
        }
        let path =
            name.split('/').fold(destination.to_path_buf(), |path: PathBuf, step| path.join(step));
        files::write_new(&path, &bytes)?;
        hashes.insert(name, files::sha256_hex(&bytes));
    }
    Ok(hashes)
}

/// Whether `name` stays below the folder it is joined to, on every operating system: steps of ordinary characters with
/// `/` between them.
pub(super) fn is_plain_relative(name: &str) -> bool {
    let is_plain = |step: &str| {
        !step.is_empty()
            && step != "."
            && step != ".."
            && !step.contains(|c: char| c == '\\' || c == ':' || c.is_control())
    };
    name.len() <= 1024 && name.split('/').all(is_plain)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use zip::write::SimpleFileOptions;

    use super::*;

    fn wheel(folder: &Path, entries: &[(&str, &[u8])]) -> PathBuf {
        let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        for (name, bytes) in entries {
            writer.start_file(*name, SimpleFileOptions::default()).unwrap();
            writer.write_all(bytes).unwrap();
        }
        let path = folder.join("a.whl");
        files::write_atomic(&path, &writer.finish().unwrap().into_inner()).unwrap();
        path
    }

    #[test]
    fn only_what_is_wanted_comes_out() {
        let folder = tempfile::tempdir().unwrap();
        let wheel = wheel(folder.path(), &[("a/one.xml", b"1"), ("a/two.py", b"2")]);
        let out = folder.path().join("out");
        let hashes = unpack(&wheel, &out, |name| name == "a/one.xml").unwrap();
        assert_eq!(
            hashes.into_iter().collect::<Vec<_>>(),
            [("a/one.xml".to_owned(), files::sha256_hex(b"1"))]
        );
        assert_eq!(std::fs::read(out.join("a/one.xml")).unwrap(), b"1");
        assert!(!out.join("a/two.py").exists());
    }

    #[test]
    fn a_name_that_leaves_the_folder_is_refused() {
        for name in ["../evil", "/evil", "a/../../evil", "a\\..\\evil", "c:evil", "a//b", "./a", ""]
        {
            assert!(!is_plain_relative(name), "{name}");
        }
        let folder = tempfile::tempdir().unwrap();
        let wheel = wheel(folder.path(), &[("a/../../evil", b"1")]);
        let error = unpack(&wheel, &folder.path().join("x/y"), |_| true).unwrap_err();
        assert!(matches!(error, AssetError::BadWheel { .. }), "{error}");
        assert!(!folder.path().join("evil").exists());
    }

    #[test]
    fn a_link_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
        writer.add_symlink("link", "/etc/passwd", SimpleFileOptions::default()).unwrap();
        let path = folder.path().join("a.whl");
        files::write_atomic(&path, &writer.finish().unwrap().into_inner()).unwrap();
        let error = unpack(&path, &folder.path().join("out"), |_| true).unwrap_err();
        assert!(matches!(error, AssetError::BadWheel { .. }), "{error}");
    }

    #[test]
    fn a_file_of_zeros_that_packs_small_is_stopped_at_the_limit() {
        let folder = tempfile::tempdir().unwrap();
        let zeros = vec![0; usize::try_from(LARGEST_FILE).unwrap() + 1];
        let wheel = wheel(folder.path(), &[("zeros", &zeros)]);
        assert!(std::fs::metadata(&wheel).unwrap().len() < 1 << 20);
        let out = folder.path().join("out");
        let error = unpack(&wheel, &out, |_| true).unwrap_err();
        assert!(error.to_string().contains("limit"), "{error}");
        assert!(!out.exists());
    }

    #[test]
    fn something_that_is_no_archive_is_an_error_that_names_it() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("broken.whl");
        files::write_atomic(&path, b"not a zip").unwrap();
        let text = unpack(&path, &folder.path().join("out"), |_| true).unwrap_err().to_string();
        assert!(text.ends_with("broken.whl`"), "{text}");
    }
}

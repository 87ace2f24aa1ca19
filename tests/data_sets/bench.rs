//! A place for a data folder, and an archive that could be published.

use std::path::{Path, PathBuf};
use std::time::Duration;

use arnold_analyze::assets::data::{
    Checksum, Content, DataError, DataEvent, DataFolder, DataSet, Origin, Patience, Record,
    RemoteFile,
};
use arnold_analyze::files;

/// The archive's name.
pub(crate) const FILE: &str = "set.tar.gz";

/// Waits that a test can wait for.
const PATIENCE: Patience = Patience {
    attempts: 3,
    first_wait: Duration::from_millis(5),
    connect: Duration::from_secs(5),
    silence: Duration::from_millis(300),
};

/// A place for a data folder, and an archive that could be published.
pub(crate) struct Bench {
    folder: tempfile::TempDir,
    pub(crate) archive: Vec<u8>,
    pub(crate) sum: String,
}

impl Bench {
    pub(crate) fn new() -> Self {
        Self::with(&[("set/a.xml", b"a".as_slice()), ("set/meshes/b.stl", &noise(300_000))])
    }

    pub(crate) fn with(entries: &[(&str, &[u8])]) -> Self {
        let archive = packed(entries);
        let sum = files::sha256_hex(&archive);
        Self { folder: tempfile::tempdir().unwrap(), archive, sum }
    }

    pub(crate) fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn data(&self) -> DataFolder {
        DataFolder::at(self.path("data"))
    }

    /// Fetches the archive from `origin`; what happened.
    pub(crate) fn fetch(&self, origin: &Origin) -> Result<Vec<DataEvent>, DataError> {
        let file = RemoteFile {
            name: FILE,
            bytes: self.archive.len() as u64,
            checksum: Checksum::Sha256(&self.sum),
        };
        self.fetch_set(&set_of(&[file]), origin)
    }

    pub(crate) fn fetch_set(
        &self,
        set: &DataSet<'_>,
        origin: &Origin,
    ) -> Result<Vec<DataEvent>, DataError> {
        let mut events = Vec::new();
        let observe = &mut |event| events.push(event);
        self.data().ensure_with(&[*set], origin, PATIENCE, observe)?;
        self.data().verify(set).unwrap();
        Ok(events)
    }

    /// The archive in a folder of its own.
    pub(crate) fn mirror(&self) -> Origin {
        files::write_atomic(&self.path("mirror").join(FILE), &self.archive).unwrap();
        Origin::Folder(self.path("mirror"))
    }

    pub(crate) fn put(&self, name: &str, bytes: &[u8]) {
        files::write_atomic(&self.path(name), bytes).unwrap();
    }

    /// Everything below the data folder besides the lock, as `path: size`.
    pub(crate) fn all(&self) -> Vec<String> {
        let mut found = Vec::new();
        list(&self.path("data"), &self.path("data"), &mut found);
        found.sort();
        found
    }

    pub(crate) fn is_installed(&self) -> bool {
        self.all()
            == [".setup/set.json".to_owned(), "set/a.xml".to_owned(), "set/meshes/b.stl".to_owned()]
    }
}

pub(crate) fn set_of<'a>(files: &'a [RemoteFile<'a>]) -> DataSet<'a> {
    DataSet {
        name: "set",
        purpose: "tests",
        command: "arnold-analyze setup --set",
        record: Record::Zenodo(0),
        licence: "none",
        citations: &["nobody"],
        files,
        content: Content::Archives { root: "set", largest: 1_000_000 },
        destination: "set",
    }
}

fn list(root: &Path, folder: &Path, found: &mut Vec<String>) {
    for entry in std::fs::read_dir(folder).into_iter().flatten() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            list(root, &path, found);
        } else if !path.ends_with(".lock") {
            found.push(path.strip_prefix(root).unwrap().to_str().unwrap().to_owned());
        }
    }
}

/// Bytes that do not pack.
pub(crate) fn noise(count: usize) -> Vec<u8> {
    let mut state = 1_u64;
    let mut next = || {
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        (state >> 56) as u8
    };
    (0..count).map(|_| next()).collect()
}

fn packed(entries: &[(&str, &[u8])]) -> Vec<u8> {
    let gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    let mut builder = tar::Builder::new(gzip);
    for (name, bytes) in entries {
        let mut header = tar::Header::new_gnu();
        header.set_size(bytes.len() as u64);
        header.set_mode(0o644);
        builder.append_data(&mut header, name, *bytes).unwrap();
    }
    builder.into_inner().unwrap().finish().unwrap()
}

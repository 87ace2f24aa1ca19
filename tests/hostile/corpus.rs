//! The hostile files, as `make_corpus.py` writes them, and what its index says about each.

use std::path::{Path, PathBuf};
use std::process::{Command, Output};
use std::sync::LazyLock;

use serde_json::Value;

/// The file that every payload makes where it runs.
pub(crate) const MARKER: &str = "EXECUTED";

/// A file of the corpus.
#[derive(Debug)]
pub(crate) struct Entry {
    pub(crate) file: String,
    pub(crate) attacks: String,
    /// Who reads it: one of the readers of `tests/robustness.rs`.
    pub(crate) reader: String,
    /// Variants of the error from the outside in, with `/` between them; `None` for a file that must be read.
    pub(crate) error: Option<String>,
    /// What the message must contain.
    pub(crate) says: Vec<String>,
}

pub(crate) struct Corpus {
    folder: tempfile::TempDir,
    pub(crate) entries: Vec<Entry>,
}

impl Corpus {
    pub(crate) fn folder(&self) -> &Path {
        self.folder.path()
    }

    pub(crate) fn read(&self, entry: &Entry) -> Vec<u8> {
        std::fs::read(self.folder().join(&entry.file)).unwrap()
    }
}

/// The corpus, written once for all tests of this process.
pub(crate) static CORPUS: LazyLock<Corpus> = LazyLock::new(|| {
    let folder = tempfile::tempdir().unwrap();
    script(&["write", folder.path().to_str().unwrap()]);
    let index = std::fs::read(folder.path().join("index.json")).unwrap();
    let index: Vec<Value> = serde_json::from_slice(&index).unwrap();
    let text = |value: &Value| value.as_str().unwrap().to_owned();
    let entries = index.iter().map(|entry| Entry {
        file: text(&entry["file"]),
        attacks: text(&entry["attacks"]),
        reader: text(&entry["reader"]),
        error: entry["error"].as_str().map(str::to_owned),
        says: entry["says"].as_array().unwrap().iter().map(text).collect(),
    });
    Corpus { entries: entries.collect(), folder }
});

/// Runs `make_corpus.py`.
pub(crate) fn script(words: &[&str]) -> Output {
    let ended = python("make_corpus.py").args(words).output().expect("the tests need Python 3");
    let said = String::from_utf8_lossy(&ended.stderr);
    assert!(ended.status.success(), "make_corpus.py {words:?}: {said}");
    ended
}

/// Python with one of the scripts beside this file.
pub(crate) fn python(script: &str) -> Command {
    let mut command = Command::new("python3");
    let path: PathBuf = [env!("CARGO_MANIFEST_DIR"), "tests", "hostile", script].iter().collect();
    command.arg("-B").arg(path);
    command
}

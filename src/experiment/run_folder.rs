//! One folder per run: `runs/<command>-<key>/`, with the manifest written last.
//!
//! The key is a hash of everything that decides the result: command, policy, normaliser, physics library, tasks, episodes,
//! seed, options and the program's version. Threads and batch size do not. A folder with a manifest whose files still have
//! their hashes is complete: the same work is not done twice.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::files::{self, FileError};

const MANIFEST: &str = "manifest.json";
/// A manifest holds a run's small results; nobody needs a larger one.
const LARGEST_MANIFEST: u64 = 64 << 20;

/// A file of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct RunFile {
    /// Name inside the run folder.
    pub name: String,
    /// SHA-256 of its content.
    pub sha256: String,
}

/// What a finished run says of itself.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Manifest {
    /// The program and its version.
    pub program: String,
    /// The command.
    pub command: String,
    /// Hash of [`Manifest::plan`].
    pub key: String,
    /// Everything that decides the result.
    pub plan: Value,
    /// What was left out, and why.
    pub left_out: Value,
    /// The result as printed by `--json`.
    pub result: Value,
    /// The files, in the order in which they were written.
    pub files: Vec<RunFile>,
    /// Where and how it ran: decides nothing.
    pub machine: Value,
}

/// A folder that a run writes into.
#[derive(Debug, Clone)]
pub struct RunFolder {
    /// The folder.
    pub path: PathBuf,
    command: String,
    key: String,
    plan: Value,
}

impl RunFolder {
    /// The folder below `root` for `command` with `plan`.
    #[must_use]
    pub fn new(root: &Path, command: &str, plan: &Value) -> Self {
        let folder = Self::at(PathBuf::new(), command, plan);
        Self { path: root.join(format!("{command}-{}", folder.key)), ..folder }
    }

    /// A folder of any name, for `command` with `plan`.
    #[must_use]
    pub fn at(path: PathBuf, command: &str, plan: &Value) -> Self {
        let plan = json!({"program": program(), "command": command, "plan": plan});
        let hash = blake3::hash(plan.to_string().as_bytes());
        let key = hash.to_hex()[..12].to_owned();
        Self { path, command: command.to_owned(), key, plan }
    }

    /// The command that fills it.
    #[must_use]
    pub fn command(&self) -> &str {
        &self.command
    }

    /// Hash of everything that decides the result.
    #[must_use]
    pub fn key(&self) -> &str {
        &self.key
    }

    /// A file of this run.
    #[must_use]
    pub fn file(&self, name: &str) -> PathBuf {
        self.path.join(name)
    }

    /// The manifest, if this very run was finished before and all its files are as it left them.
    #[must_use]
    pub fn finished(&self) -> Option<Manifest> {
        let bytes = files::read_bounded(&self.file(MANIFEST), LARGEST_MANIFEST).ok()?;
        let manifest: Manifest = serde_json::from_slice(&bytes).ok()?;
        let intact = |file: &RunFile| {
            files::sha256_of_file(&self.file(&file.name)).is_ok_and(|hash| hash == file.sha256)
        };
        (manifest.plan == self.plan && manifest.files.iter().all(intact)).then_some(manifest)
    }

    /// Says early whether the folder can be written, before hours of work.
    pub fn prepare(&self) -> Result<(), FileError> {
        files::create_folder(&self.path)?;
        files::check_writable(&self.path)
    }

    /// Writes the manifest: from here on the run is complete. `names` are the files it wrote.
    pub fn finish(
        &self,
        names: &[String],
        left_out: Value,
        result: Value,
        machine: Value,
    ) -> Result<Manifest, FileError> {
        let hashed = names.iter().map(|name| {
            let sha256 = files::sha256_of_file(&self.file(name))?;
            Ok(RunFile { name: name.clone(), sha256 })
        });
        let manifest = Manifest {
            program: program(),
            command: self.command.clone(),
            key: self.key.clone(),
            plan: self.plan.clone(),
            left_out,
            result,
            files: hashed.collect::<Result<_, FileError>>()?,
            machine,
        };
        let mut text = serde_json::to_string_pretty(&manifest).unwrap_or_default();
        text.push('\n');
        files::write_atomic(&self.file(MANIFEST), text.as_bytes())?;
        Ok(manifest)
    }

    /// Provenance for the key-value metadata of every table: what made it, without what decides nothing.
    #[must_use]
    pub fn provenance(&self) -> Vec<(String, String)> {
        vec![
            ("program".to_owned(), program()),
            ("key".to_owned(), self.key.clone()),
            ("plan".to_owned(), self.plan.to_string()),
        ]
    }
}

/// This program and its version.
#[must_use]
pub fn program() -> String {
    format!("arnold-analyze {}", env!("CARGO_PKG_VERSION"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_run_is_finished_only_with_all_its_files_intact() {
        let root = tempfile::tempdir().unwrap();
        let run = RunFolder::new(root.path(), "csi", &json!({"seed": 1}));
        run.prepare().unwrap();
        assert!(run.finished().is_none());
        files::write_atomic(&run.file("a.txt"), b"result").unwrap();
        run.finish(&["a.txt".to_owned()], json!([]), json!({"x": 1}), json!({})).unwrap();
        assert_eq!(run.finished().unwrap().result, json!({"x": 1}));
        files::write_atomic(&run.file("a.txt"), b"tampered").unwrap();
        assert!(run.finished().is_none());
    }

    #[test]
    fn another_plan_is_another_folder() {
        let root = Path::new("runs");
        let folder = |seed: u64| RunFolder::new(root, "csi", &json!({ "seed": seed })).path;
        assert_eq!(folder(1), folder(1));
        assert_ne!(folder(1), folder(2));
    }
}

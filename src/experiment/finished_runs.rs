//! Finished runs below a folder, newest first: what others drew before.
//!
//! A run counts if its manifest can be read; a figure of it only if its files still have the hashes that the manifest says.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde_json::Value;

use crate::files::{self, FileError};

use super::paper_index::IndexEntry;
use super::run_folder::{Manifest, RunFile};

const MANIFEST: &str = "manifest.json";
/// A manifest holds a run's small results; nobody needs a larger one.
const LARGEST_MANIFEST: u64 = 64 << 20;

/// A finished run.
#[derive(Debug, Clone)]
pub struct FinishedRun {
    pub folder: PathBuf,
    pub manifest: Manifest,
}

/// All finished runs directly below `root`, the one that was finished last first. No folder, no runs.
pub fn finished_runs(root: &Path) -> Result<Vec<FinishedRun>, FileError> {
    if !root.is_dir() {
        return Ok(Vec::new());
    }
    let mut found: Vec<(SystemTime, FinishedRun)> = Vec::new();
    for folder in files::list(root)? {
        let Some(run) = FinishedRun::read(&folder) else { continue };
        let written = std::fs::metadata(folder.join(MANIFEST)).and_then(|data| data.modified());
        found.push((written.unwrap_or(SystemTime::UNIX_EPOCH), run));
    }
    // Runs of one moment stay in the order of their names.
    found.sort_by_key(|(written, _)| std::cmp::Reverse(*written));
    Ok(found.into_iter().map(|(_, run)| run).collect())
}

impl FinishedRun {
    /// The run in `folder`; `None` if there is no manifest of ours.
    #[must_use]
    pub fn read(folder: &Path) -> Option<Self> {
        let bytes = files::read_bounded(&folder.join(MANIFEST), LARGEST_MANIFEST).ok()?;
        let manifest = serde_json::from_slice(&bytes).ok()?;
        Some(Self { folder: folder.to_path_buf(), manifest })
    }

    /// The files of this run that belong to `entry`, intact; none if it is another run.
    #[must_use]
    pub fn files_of(&self, entry: &IndexEntry) -> Vec<PathBuf> {
        let lines = || self.manifest.result["lines"].as_array().into_iter().flatten();
        let is_meant = entry.recipe.is_none_or(|(recipe, part)| {
            let named = |line: &Value| line["series"].as_str().is_some_and(|s| s.contains(part));
            self.manifest.result["recipe"] == recipe && lines().any(named)
        });
        if entry.command.is_empty() || self.manifest.command != entry.command || !is_meant {
            return Vec::new();
        }
        let wanted = ["svg", "pdf", "png", "parquet", "csv"];
        let names = wanted.map(|extension| format!("{}.{extension}", entry.file));
        let listed = self.manifest.files.iter().filter(|file| names.contains(&file.name));
        // A figure whose PDF and table no longer belong together is none.
        listed.map(|file| self.intact(file)).collect::<Option<_>>().unwrap_or_default()
    }

    /// A file of this run, if its content is still what the manifest says.
    #[must_use]
    pub fn intact(&self, file: &RunFile) -> Option<PathBuf> {
        let path = self.folder.join(&file.name);
        // A file of a run lies in its folder, whatever a manifest from elsewhere says.
        let is_inside = path.parent() == Some(&self.folder) && path.file_name().is_some();
        let is_same = || files::sha256_of_file(&path).is_ok_and(|sum| sum == file.sha256);
        (is_inside && is_same()).then_some(path)
    }
}

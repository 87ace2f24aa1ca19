//! Finished runs below a folder, newest first: what others drew before.
//!
//! A run counts if its manifest can be read; a figure of it only if its files still have the hashes that the manifest says.

use std::path::{Path, PathBuf};
use std::time::SystemTime;

use serde_json::Value;

use crate::files::{self, FileError};

use super::paper_index::IndexEntry;
use super::run_folder::{Manifest, RunFile};

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
        let path = folder.join("manifest.json");
        let Ok(bytes) = files::read_bounded(&path, LARGEST_MANIFEST) else { continue };
        // Another program's manifest is none of ours.
        let Ok(manifest) = serde_json::from_slice::<Manifest>(&bytes) else { continue };
        let written = std::fs::metadata(&path).and_then(|data| data.modified());
        let written = written.unwrap_or(SystemTime::UNIX_EPOCH);
        found.push((written, FinishedRun { folder, manifest }));
    }
    // Runs of one moment stay in the order of their names.
    found.sort_by_key(|(written, _)| std::cmp::Reverse(*written));
    Ok(found.into_iter().map(|(_, run)| run).collect())
}

impl FinishedRun {
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
        let intact = |file: &RunFile| {
            let found = files::sha256_of_file(&self.folder.join(&file.name));
            found.is_ok_and(|sum| sum == file.sha256)
        };
        // A figure whose PDF and table no longer belong together is none.
        if !listed.clone().all(intact) {
            return Vec::new();
        }
        listed.map(|file| self.folder.join(&file.name)).collect()
    }
}

//! Upstream's `signals.json`: which recordings each analysis reads.
//!
//! `tasks` and `episodes` hold for all analyses; an analysis lists `policies`, perhaps `tasks` of its own, and
//! `overrides` `{policy: {task: other folder}}`. A recording lies at `<signals folder>/<policy or override>/<task>.h5`.
//! A policy may hold slashes; what would leave the folder is refused.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use serde_json::{Map, Value};

use super::RecordError;
use super::benchmarks::read_json;

/// A file of selections.
#[derive(Debug, Clone, PartialEq, Deserialize)]
pub struct SignalSelection {
    tasks: Vec<String>,
    /// Episodes that each recording must have.
    pub episodes: usize,
    #[serde(flatten)]
    analyses: Map<String, Value>,
}

/// What one analysis reads.
#[derive(Debug, Clone, PartialEq, Deserialize)]
struct Analysis {
    policies: Vec<String>,
    tasks: Option<Vec<String>>,
    #[serde(default)]
    overrides: BTreeMap<String, BTreeMap<String, String>>,
}

/// A recording that is asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SelectedSignal {
    pub policy: String,
    pub task: String,
    pub path: PathBuf,
}

/// Reads a file of selections.
pub fn read_signal_selection(path: &Path) -> Result<SignalSelection, RecordError> {
    read_json(path)
}

impl SignalSelection {
    /// The names of its analyses.
    #[must_use]
    pub fn analyses(&self) -> Vec<&str> {
        self.analyses.keys().map(String::as_str).collect()
    }

    /// The recordings of `analysis` below `signals`, by policy and task in the order of the file; `file` names it in
    /// errors.
    pub fn recordings(
        &self,
        analysis: &str,
        signals: &Path,
        file: &Path,
    ) -> Result<Vec<SelectedSignal>, RecordError> {
        let malformed = |what: String| RecordError::Malformed {
            place: format!("analysis `{analysis}`"),
            what,
            path: file.to_path_buf(),
        };
        let entry = self.analyses.get(analysis).ok_or_else(|| {
            malformed(format!("it is not there; there are {}", self.analyses().join(", ")))
        })?;
        let entry: Analysis =
            Analysis::deserialize(entry).map_err(|error| malformed(error.to_string()))?;
        let tasks = entry.tasks.as_ref().unwrap_or(&self.tasks);
        let mut found = Vec::new();
        for policy in &entry.policies {
            for task in tasks {
                let other = entry.overrides.get(policy).and_then(|of_policy| of_policy.get(task));
                let below = Path::new(other.unwrap_or(policy)).join(format!("{task}.h5"));
                if !below.components().all(|part| matches!(part, Component::Normal(_))) {
                    let what = format!("`{}` is not a plain relative path", below.display());
                    return Err(malformed(what));
                }
                let (policy, task) = (policy.clone(), task.clone());
                found.push(SelectedSignal { policy, task, path: signals.join(below) });
            }
        }
        Ok(found)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn selection(text: &str) -> Result<SignalSelection, RecordError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("signals.json");
        crate::files::write_atomic(&path, text.as_bytes()).unwrap();
        read_signal_selection(&path)
    }

    const FILE: &str = r#"{
        "tasks": ["pen", "reorient"], "episodes": 100,
        "smoothness": {"policies": ["expert", "obc/seed_0"], "signals": ["actions"]},
        "baoding_pca": {"policies": ["expert"], "tasks": ["baoding_p1_ccw"], "signals": []},
        "subspaces": {"policies": ["expert"], "overrides": {"expert": {"pen": "other"}}},
        "outside": {"policies": ["../expert"]}, "wrong": {"policies": 3}
    }"#;

    #[test]
    fn an_analysis_has_its_own_tasks_and_folders_or_those_of_all() {
        let selection = selection(FILE).unwrap();
        assert_eq!(selection.episodes, 100);
        let paths = |analysis: &str| -> Vec<String> {
            let found = selection.recordings(analysis, Path::new("s"), Path::new("f")).unwrap();
            found.into_iter().map(|signal| signal.path.display().to_string()).collect()
        };
        let want = ["s/expert/pen.h5", "s/expert/reorient.h5", "s/obc/seed_0/pen.h5"];
        assert_eq!(paths("smoothness")[..3], want);
        assert_eq!(paths("baoding_pca"), ["s/expert/baoding_p1_ccw.h5"]);
        assert_eq!(paths("subspaces"), ["s/other/pen.h5", "s/expert/reorient.h5"]);
    }

    #[test]
    fn what_leaves_the_folder_or_is_no_selection_is_refused() {
        let selected = selection(FILE).unwrap();
        for analysis in ["outside", "wrong", "nothing"] {
            let found = selected.recordings(analysis, Path::new("s"), Path::new("f.json"));
            let message = found.unwrap_err().to_string();
            assert!(message.contains(analysis) && message.contains("f.json"), "{message}");
        }
        for text in ["", "[]", "{}", r#"{"tasks": [], "episodes": -1}"#] {
            assert!(selection(text).is_err(), "{text}");
        }
    }
}

//! Which expert plays which task (`spec/policy.md` §4, `spec/tasks.md` §5.1, §5.4).
//!
//! The published experiments have one expert per task; a configuration file replaces some of them, for instance by
//! transformers trained further on one task. Tasks that the file leaves out keep their default.

use std::collections::BTreeMap;
use std::path::{Component, Path};

use serde::Deserialize;

use super::PolicyError;
use super::loading::in_file;
use crate::files::read_bounded;

/// Where the released archive keeps the experts' folders, below the data folder.
pub const EXPERT_FOLDERS: &str = "expert_policies";

/// A configuration of all tasks is some kilobytes.
const LARGEST_CONFIGURATION: u64 = 1 << 20;

/// Task, folder, algorithm, environment it was trained in.
const DEFAULT: [(&str, &str, &str, &str); 14] = [
    ("elbow_pose", "elbow_pose_lattice", "recurrent_ppo", "CleanElbowPose"),
    ("hand_thumb_reach", "thumb_reach_lattice", "recurrent_ppo", "myoHandThumbReachRandom"),
    ("hand_index_reach", "index_reach_lattice", "recurrent_ppo", "myoHandIndexReachRandom"),
    ("hand_middle_reach", "middle_reach_lattice", "recurrent_ppo", "myoHandMiddleReachRandom"),
    ("hand_ring_reach", "ring_reach_lattice", "recurrent_ppo", "myoHandRingReachRandom"),
    ("hand_little_reach", "little_reach_lattice", "recurrent_ppo", "myoHandLittleReachRandom"),
    ("pen", "pen_lattice", "recurrent_ppo", "CustomMyoPenTwirlRandom"),
    ("reorient", "reorient_lattice", "recurrent_ppo", "CustomMyoReorientP0"),
    ("baoding_p1_ccw", "baoding_phase_1", "recurrent_ppo", "CleanBaodingBallsP1CCW"),
    ("baoding_p1_cw", "baoding_phase_1", "recurrent_ppo", "CleanBaodingBallsP1CW"),
    ("baoding_p2", "baoding_phase_2", "recurrent_ppo", "CleanBaodingBallsP2"),
    ("baoding_p2_overlap", "baoding_phase_2", "recurrent_ppo", "CleanBaodingBallsP2Overlap"),
    ("relocate", "relocate", "recurrent_ppo", "CustomRelocate"),
    ("kinesis", "kinesis", "kinesis", "Kinesis"),
];

/// The expert of one task.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
pub struct ExpertEntry {
    /// Its folder, relative to the experts' folder.
    #[serde(rename = "expert")]
    pub folder: String,
    /// `recurrent_ppo`, `bc_ppo`, …
    #[serde(default)]
    pub algo: String,
    /// Environment it was trained in.
    #[serde(default)]
    pub train_env: String,
    /// Whether it is a transformer.
    #[serde(default)]
    pub use_arnold: bool,
}

/// Experts by task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ExpertTable(BTreeMap<String, ExpertEntry>);

impl Default for ExpertTable {
    fn default() -> Self {
        let entry = |(task, folder, algo, train_env): (&str, &str, &str, &str)| {
            let (folder, algo, train_env) =
                (folder.to_owned(), algo.to_owned(), train_env.to_owned());
            (task.to_owned(), ExpertEntry { folder, algo, train_env, use_arnold: false })
        };
        Self(DEFAULT.into_iter().map(entry).collect())
    }
}

impl ExpertTable {
    /// The default, with what the configuration file `path` says instead.
    pub fn with_configuration(path: &Path) -> Result<Self, PolicyError> {
        let bytes = read_bounded(path, LARGEST_CONFIGURATION)?;
        let entries: BTreeMap<String, ExpertEntry> =
            serde_json::from_slice(&bytes).map_err(|fault| {
                in_file(path)(PolicyError::ExpertTable { fault: fault.to_string() })
            })?;
        for (task, entry) in &entries {
            let parts = Path::new(&entry.folder).components();
            let inside = parts.clone().count() > 0
                && parts.into_iter().all(|part| matches!(part, Component::Normal(_)));
            if !inside {
                let fault =
                    format!("the expert of `{task}`, `{}`, is no folder below", entry.folder);
                return Err(in_file(path)(PolicyError::ExpertTable { fault }));
            }
        }
        let mut table = Self::default();
        table.0.extend(entries);
        Ok(table)
    }

    /// The expert of `task` for every task of the table: one policy, whatever is played.
    #[must_use]
    pub fn only(&self, task: &str) -> Option<Self> {
        let entry = self.0.get(task)?;
        Some(Self(self.0.keys().map(|task| (task.clone(), entry.clone())).collect()))
    }

    /// The expert of `task`.
    #[must_use]
    pub fn of(&self, task: &str) -> Option<&ExpertEntry> {
        self.0.get(task)
    }

    /// What is odd about playing `task` with `entry`: that it was trained for another one.
    #[must_use]
    pub fn misplaced(task: &str, entry: &ExpertEntry) -> Option<String> {
        let own = DEFAULT.iter().any(|row| row.0 == task && row.3 == entry.train_env);
        let other = DEFAULT.iter().find(|row| row.3 == entry.train_env && !own)?;
        Some(format!(
            "the expert of `{task}` was trained in `{}`, the environment of `{}`",
            entry.train_env, other.0
        ))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn configured(text: &str) -> Result<ExpertTable, PolicyError> {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("experts.json");
        crate::files::write_atomic(&path, text.as_bytes()).unwrap();
        ExpertTable::with_configuration(&path)
    }

    #[test]
    fn a_configuration_replaces_single_experts() {
        let text = r#"{"elbow_pose": {"expert": "elbow_263_78374700", "algo": "bc_ppo",
            "train_env": "MuscleElbowPoseRandom", "use_arnold": true}}"#;
        let table = configured(text).unwrap();
        let elbow = table.of("elbow_pose").unwrap();
        assert!(elbow.use_arnold && elbow.folder == "elbow_263_78374700" && elbow.algo == "bc_ppo");
        assert_eq!(table.of("pen"), ExpertTable::default().of("pen"));
        assert_eq!(table.of("unknown"), None);
        let only = table.only("pen").unwrap();
        assert_eq!(only.of("kinesis").unwrap().folder, "pen_lattice");
    }

    #[test]
    fn a_folder_outside_is_refused() {
        for folder in ["../elsewhere", "/etc", "", "a/../../b"] {
            let text = format!(r#"{{"pen": {{"expert": "{folder}"}}}}"#);
            let error = configured(&text).unwrap_err().to_string();
            assert!(error.contains("no folder below") && error.contains("experts.json"), "{error}");
        }
        assert!(configured("[1]").is_err());
    }

    #[test]
    fn an_expert_of_another_task_is_noticed() {
        let entry = |task: &str| ExpertTable::default().of(task).unwrap().clone();
        assert_eq!(ExpertTable::misplaced("pen", &entry("pen")), None);
        let text = ExpertTable::misplaced("pen", &entry("reorient")).unwrap();
        assert!(text.contains("`pen`") && text.contains("`reorient`"), "{text}");
    }
}

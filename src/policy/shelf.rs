//! Where the names of policies lead: files, folders of runs, and the layout of the released archive
//! (`spec/policy.md` §3.1, `spec/tasks.md` §5.5).
//!
//! | name | is |
//! |---|---|
//! | a file | that file |
//! | a folder | its newest checkpoint, by steps |
//! | `arnold`, `obc`, `arnold/seed_1`, … | the folder of that name below `student_policies`, `final_checkpoints` or `expert_policies` |
//! | a folder with one folder per seed | its first seed |
//! | `expert` | every task's own expert |
//! | `expert:pen` | the expert of one task |
//! | `expert:arnold_experts_seed_1` | the experts of a configuration in `expert_configs`, or of a file |

use std::path::{Path, PathBuf};

use super::PolicyError;
use super::expert_table::{EXPERT_FOLDERS, ExpertTable};
use super::transformer_files::steps_of;

/// Where training runs are kept: the repository's folder, and that of the released checkpoints.
const RUNS: &str = "student_policies";
const RELEASED_RUNS: &str = "final_checkpoints";
/// The release's first run of a method; of Arnold it is the one that the paper analyses.
const FIRST_SEED: &str = "seed_0";
/// Where it keeps the configurations of experts.
const CONFIGURATIONS: &str = "expert_configs";
/// Checkpoints without steps in their name, the most usual first.
const PLAIN_NAMES: [&str; 6] = [
    "model.zip",
    "model.pth",
    "final_model.zip",
    "final_model.pkl",
    "model.safetensors",
    "policy.safetensors",
];

/// What a name stands for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Choice {
    /// One checkpoint for every task.
    File(PathBuf),
    /// Every task's own expert.
    Experts(ExpertTable),
}

/// What `name` stands for, with the released archive unpacked in `data`.
pub fn find(name: &Path, data: &Path) -> Result<Choice, PolicyError> {
    let text = name.to_string_lossy();
    if text == "expert" {
        return Ok(Choice::Experts(ExpertTable::default()));
    }
    if let Some(which) = text.strip_prefix("expert:") {
        return experts(which, data);
    }
    let mut looked = vec![name.to_path_buf()];
    looked.extend([RUNS, RELEASED_RUNS, EXPERT_FOLDERS].map(|shelf| data.join(shelf).join(name)));
    if let Some(path) = looked.iter().find(|path| path.exists()) {
        return checkpoint_at(path).map(Choice::File);
    }
    // `arnold/seed_1`: the run of that seed among the runs of several tasks.
    if let Some((method, seed)) = text.split_once('/') {
        let runs = data.join(RUNS).join(format!("{method}_multi_task"));
        let named = |run: &PathBuf| {
            let name = run.file_name().unwrap_or_default().to_string_lossy().into_owned();
            name.ends_with(&format!("_{seed}")) || name.contains(&format!("_{seed}_"))
        };
        let found: Vec<PathBuf> = folders_in(&runs).into_iter().filter(named).collect();
        match found.as_slice() {
            [run] => return checkpoint_at(run).map(Choice::File),
            [] => looked.push(runs.join(format!("*_{seed}"))),
            several => {
                return Err(PolicyError::SeveralRuns { name: text.into(), runs: listed(several) });
            }
        }
    }
    Err(PolicyError::NotFound { name: text.into_owned(), looked: listed(&looked) })
}

/// The experts of one task, or of a configuration.
fn experts(which: &str, data: &Path) -> Result<Choice, PolicyError> {
    if let Some(table) = ExpertTable::default().only(which) {
        return Ok(Choice::Experts(table));
    }
    let looked = [
        PathBuf::from(which),
        data.join(CONFIGURATIONS).join(which),
        data.join(CONFIGURATIONS).join(format!("{which}.json")),
    ];
    if let Some(path) = looked.iter().find(|path| path.is_file()) {
        return ExpertTable::with_configuration(path).map(Choice::Experts);
    }
    Err(PolicyError::NotFound { name: format!("expert:{which}"), looked: listed(&looked) })
}

/// The checkpoint that `path` is, or the newest in the folder that it is.
pub fn checkpoint_at(path: &Path) -> Result<PathBuf, PolicyError> {
    if path.is_file() {
        return Ok(path.to_path_buf());
    }
    let files = files_in(path);
    let is_checkpoint = |file: &&PathBuf| {
        let end = file.extension().and_then(|end| end.to_str());
        matches!(end, Some("zip" | "safetensors" | "pth"))
    };
    let numbered =
        files.iter().filter(is_checkpoint).filter_map(|file| Some((steps_of(file)?, file)));
    // Of two files of the same step the one that is first by name, so that the choice is always the same.
    let newest = numbered.max_by(|(a, one), (b, other)| a.cmp(b).then(other.cmp(one)));
    let plain = || PLAIN_NAMES.iter().map(|name| path.join(name)).find(|file| file.is_file());
    if let Some(found) = newest.map(|(_, file)| file.clone()).or_else(plain) {
        return Ok(found);
    }
    if path.join(FIRST_SEED).is_dir() {
        return checkpoint_at(&path.join(FIRST_SEED));
    }
    let mut others = files.iter().filter(is_checkpoint);
    match (others.next(), others.next()) {
        (Some(only), None) => Ok(only.clone()),
        (Some(_), Some(_)) => {
            let several: Vec<PathBuf> = files.iter().filter(is_checkpoint).cloned().collect();
            let name = path.display().to_string();
            Err(PolicyError::SeveralRuns { name, runs: listed(&several) })
        }
        (None, _) => Err(PolicyError::NoCheckpoint { folder: path.to_path_buf() }),
    }
}

fn files_in(folder: &Path) -> Vec<PathBuf> {
    entries(folder).into_iter().filter(|path| path.is_file()).collect()
}

fn folders_in(folder: &Path) -> Vec<PathBuf> {
    entries(folder).into_iter().filter(|path| path.is_dir()).collect()
}

/// What is in a folder, sorted; nothing if it cannot be read.
fn entries(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut paths: Vec<PathBuf> = entries.filter_map(|entry| Some(entry.ok()?.path())).collect();
    paths.sort();
    paths
}

fn listed(paths: &[PathBuf]) -> String {
    let quoted: Vec<String> = paths.iter().map(|path| format!("`{}`", path.display())).collect();
    quoted.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn data(files: &[&str]) -> tempfile::TempDir {
        let data = tempfile::tempdir().unwrap();
        for file in files {
            crate::files::write_atomic(&data.path().join(file), b"x").unwrap();
        }
        data
    }

    fn found(name: &str, data: &Path) -> String {
        match find(Path::new(name), data) {
            Ok(Choice::File(path)) => path.strip_prefix(data).unwrap().display().to_string(),
            other => panic!("{name}: {other:?}"),
        }
    }

    #[test]
    fn names_of_the_released_archive_lead_to_the_newest_checkpoint() {
        let data = data(&[
            "student_policies/arnold/rl_model_9000_steps.zip",
            "student_policies/arnold/rl_model_64670238_steps.zip",
            "student_policies/arnold/rl_model_vecnormalize_99999999_steps.pkl",
            "student_policies/obc/seed_0/rl_model_1_steps.zip",
            "student_policies/arnold_multi_task/arnold_14_tasks_seed_1_x/rl_model_5_steps.zip",
            "student_policies/arnold_multi_task/arnold_14_tasks_seed_10/rl_model_6_steps.zip",
            "expert_policies/relocate/model.zip",
        ]);
        let data = data.path();
        assert_eq!(found("arnold", data), "student_policies/arnold/rl_model_64670238_steps.zip");
        assert_eq!(found("obc/seed_0", data), "student_policies/obc/seed_0/rl_model_1_steps.zip");
        let seed = found("arnold/seed_1", data);
        assert!(seed.ends_with("seed_1_x/rl_model_5_steps.zip"), "{seed}");
        assert_eq!(found("relocate", data), "expert_policies/relocate/model.zip");
        let folder = data.join("student_policies/arnold");
        assert_eq!(found(folder.to_str().unwrap(), data), found("arnold", data));
    }

    #[test]
    fn the_released_checkpoints_have_a_folder_for_each_seed() {
        let data = data(&[
            "final_checkpoints/arnold/seed_0/rl_model_64670238_steps.zip",
            "final_checkpoints/arnold/seed_1/rl_model_5_steps.zip",
        ]);
        let data = data.path();
        let first = "final_checkpoints/arnold/seed_0/rl_model_64670238_steps.zip";
        assert_eq!(found("arnold", data), first);
        let second = "final_checkpoints/arnold/seed_1/rl_model_5_steps.zip";
        assert_eq!(found("arnold/seed_1", data), second);
    }

    #[test]
    fn a_name_that_leads_nowhere_says_where_it_was_looked_for() {
        let data = data(&[
            "student_policies/empty/args.json",
            "student_policies/two/a.zip",
            "student_policies/two/b.zip",
        ]);
        let error = |name: &str| find(Path::new(name), data.path()).unwrap_err().to_string();
        let message = error("arnold/seed_3");
        for place in
            ["student_policies/arnold/seed_3", "expert_policies/arnold", "arnold_multi_task"]
        {
            assert!(message.contains(place), "{message}");
        }
        assert!(error("empty").contains("no checkpoint"), "{}", error("empty"));
        assert!(error("two").contains("a.zip"), "{}", error("two"));
        assert!(error("expert:nobody").contains("expert_configs"), "{}", error("expert:nobody"));
    }

    #[test]
    fn experts_are_named_by_task_or_configuration() {
        let data = data(&[]);
        let configuration = data.path().join("expert_configs/mine.json");
        let text = br#"{"pen": {"expert": "my_pen"}}"#;
        crate::files::write_atomic(&configuration, text).unwrap();
        let table = |name: &str| match find(Path::new(name), data.path()) {
            Ok(Choice::Experts(table)) => table,
            other => panic!("{name}: {other:?}"),
        };
        assert_eq!(table("expert"), ExpertTable::default());
        assert_eq!(table("expert:pen").of("kinesis").unwrap().folder, "pen_lattice");
        assert_eq!(table("expert:mine").of("pen").unwrap().folder, "my_pen");
        let named = format!("expert:{}", configuration.display());
        assert_eq!(table(&named).of("kinesis").unwrap().folder, "kinesis");
    }
}

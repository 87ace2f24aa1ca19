//! Published and own benchmark results: JSON files of one policy each, and the trees and selections they lie in.
//!
//! A file is one object from task to record. Readers know the published fields and ignore others; every field may be
//! missing or null. The list of solved fractions has two spellings in use, `episode_solve_step_fracs` and
//! `episode_solved_fracs`; a record with both is refused, because they could differ.
//!
//! * Tree: `<root>/<method>/<seed folder>/*_results.json`, one file per seed (of a single run also
//!   `<root>/<method>/*_results.json`), and
//!   `<root>/expert_policies/*_results.json`, any number of files merged by task.
//! * Selection: one JSON object from method to the result files of its seeds, relative to a folder.
//!
//! Limits: 64 MiB per file.

use std::collections::BTreeMap;
use std::path::{Component, Path, PathBuf};

use serde::Deserialize;
use serde::de::DeserializeOwned;

use super::RecordError;
use super::result_files::{files_in, folders_in, name_of};
use crate::files;

/// No result file may be larger than this.
const LARGEST_FILE: u64 = 64 << 20;
/// How names of result files end.
const SUFFIX: &str = "_results.json";
/// The folder of the experts' files.
const EXPERTS: &str = "expert_policies";

/// One task's record. Field names are the published ones.
#[derive(Debug, Clone, PartialEq, Default, Deserialize)]
pub struct BenchmarkEntry {
    pub avg_cum_reward: Option<f64>,
    pub std_cum_reward: Option<f64>,
    pub avg_step_reward: Option<f64>,
    pub std_step_reward: Option<f64>,
    pub avg_solved: Option<f64>,
    pub std_solved: Option<f64>,
    pub avg_solved_steps: Option<f64>,
    pub std_solved_steps: Option<f64>,
    /// Mean over episodes of solved steps / horizon.
    pub avg_solved_step_frac: Option<f64>,
    pub avg_steps: Option<f64>,
    pub std_steps: Option<f64>,
    pub max_episode_steps: Option<u32>,
    pub num_episodes: Option<usize>,
    pub episode_cum_rewards: Option<Vec<f64>>,
    #[serde(alias = "episode_solved_fracs")]
    pub episode_solve_step_fracs: Option<Vec<f64>>,
    pub episode_solved_steps: Option<Vec<u32>>,
    pub episode_steps: Option<Vec<u32>>,
    pub seed: Option<i64>,
    pub deterministic: Option<bool>,
    pub normalize_obs: Option<bool>,
    pub num_steps: Option<u64>,
}

/// The records of one policy, by task.
pub type Benchmark = BTreeMap<String, BenchmarkEntry>;

/// One seed's result file.
#[derive(Debug, Clone, PartialEq)]
pub struct SeedResult {
    pub path: PathBuf,
    pub tasks: Benchmark,
}

/// The results of several methods and of the experts.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct BenchmarkTree {
    /// Empty if the tree has no experts.
    pub experts: Benchmark,
    /// By method, each with its seeds in the order of their folders or of the selection.
    pub methods: BTreeMap<String, Vec<SeedResult>>,
}

/// Reads one result file.
pub fn read_benchmark(path: &Path) -> Result<Benchmark, RecordError> {
    read_json(path)
}

/// Reads a folder of result files and merges them by task. A task in two files is an error.
pub fn read_merged_benchmarks(folder: &Path) -> Result<Benchmark, RecordError> {
    let mut merged = Benchmark::new();
    for path in files_in(folder, |name| name.ends_with(SUFFIX))? {
        for (task, entry) in read_benchmark(&path)? {
            if merged.insert(task.clone(), entry).is_some() {
                let what = "another file of the folder has this task as well".to_owned();
                return Err(RecordError::Malformed { place: format!("task `{task}`"), what, path });
            }
        }
    }
    if merged.is_empty() {
        return Err(RecordError::NoFiles {
            what: format!("`*{SUFFIX}`"),
            path: folder.to_path_buf(),
        });
    }
    Ok(merged)
}

/// Reads a tree of results. Every seed folder must hold exactly one result file.
pub fn read_benchmark_tree(root: &Path) -> Result<BenchmarkTree, RecordError> {
    let (tree, unreadable) = survey_benchmark_tree(root)?;
    unreadable.into_iter().next().map_or(Ok(tree), |(_, error)| Err(error))
}

/// A tree, and the folders that are no method, each with the reason.
pub type SurveyedTree = (BenchmarkTree, Vec<(String, RecordError)>);

/// The same for a folder that holds other things as well: methods that cannot be read are named beside the tree.
pub fn survey_benchmark_tree(root: &Path) -> Result<SurveyedTree, RecordError> {
    let mut tree = BenchmarkTree::default();
    let mut unreadable = Vec::new();
    for method in folders_in(root)? {
        let name = name_of(&method);
        if name == EXPERTS {
            tree.experts = read_merged_benchmarks(&method)?;
            continue;
        }
        match read_method(&method) {
            Ok(seeds) if seeds.is_empty() => {}
            Ok(seeds) => drop(tree.methods.insert(name, seeds)),
            Err(error) => unreadable.push((name, error)),
        }
    }
    if tree.experts.is_empty() && tree.methods.is_empty() && unreadable.is_empty() {
        return Err(RecordError::NoFiles {
            what: format!("`*{SUFFIX}`"),
            path: root.to_path_buf(),
        });
    }
    Ok((tree, unreadable))
}

/// The seeds of one method; none if its folder is one of something else.
fn read_method(method: &Path) -> Result<Vec<SeedResult>, RecordError> {
    let mut seeds = Vec::new();
    for folder in folders_in(method)? {
        let mut found = files_in(&folder, |name| name.ends_with(SUFFIX))?;
        match (found.pop(), found.len()) {
            (Some(path), 0) => seeds.push(SeedResult { tasks: read_benchmark(&path)?, path }),
            // A folder of something else.
            (None, _) => {}
            (Some(_), others) => {
                return Err(RecordError::Malformed {
                    place: "seed folder".to_owned(),
                    what: format!("expected one `*{SUFFIX}`, found {}", others + 1),
                    path: folder,
                });
            }
        }
    }
    // A method of a single run needs no folder for it.
    if seeds.is_empty() {
        let mut found = files_in(method, |name| name.ends_with(SUFFIX))?;
        if let (Some(path), 0) = (found.pop(), found.len()) {
            seeds.push(SeedResult { tasks: read_benchmark(&path)?, path });
        }
    }
    Ok(seeds)
}

/// Reads the result files that a selection lists, below `root`. Dashes in a method's name become underscores. Paths
/// that leave `root` are refused.
pub fn read_selection(
    selection: &Path,
    root: &Path,
) -> Result<BTreeMap<String, Vec<SeedResult>>, RecordError> {
    let listed: BTreeMap<String, Vec<PathBuf>> = read_json(selection)?;
    let mut methods = BTreeMap::new();
    for (method, paths) in listed {
        let mut seeds = Vec::with_capacity(paths.len());
        for below in paths {
            if !below.components().all(|part| matches!(part, Component::Normal(_))) {
                return Err(RecordError::Malformed {
                    place: format!("method `{method}`"),
                    what: format!("`{}` is not a plain relative path", below.display()),
                    path: selection.to_path_buf(),
                });
            }
            let path = root.join(below);
            seeds.push(SeedResult { tasks: read_benchmark(&path)?, path });
        }
        let name = method.replace('-', "_");
        if methods.insert(name.clone(), seeds).is_some() {
            return Err(RecordError::Malformed {
                place: format!("method `{name}`"),
                what: "it is listed twice, once with a dash and once with an underscore".to_owned(),
                path: selection.to_path_buf(),
            });
        }
    }
    Ok(methods)
}

pub(super) fn read_json<T: DeserializeOwned>(path: &Path) -> Result<T, RecordError> {
    let bytes = files::read_bounded(path, LARGEST_FILE)?;
    serde_json::from_slice(&bytes).map_err(|error| RecordError::Malformed {
        place: format!("line {}, column {}", error.line(), error.column()),
        what: error.to_string(),
        path: path.to_path_buf(),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn write(folder: &Path, name: &str, text: &str) {
        let path = folder.join(name);
        files::create_folder(path.parent().unwrap()).unwrap();
        files::write_atomic(&path, text.as_bytes()).unwrap();
    }

    #[test]
    fn a_tree_is_read_with_both_spellings_and_seeds_in_order() {
        let folder = tempfile::tempdir().unwrap();
        let record = |key: &str, x: f64| {
            format!(r#"{{"pen": {{"avg_solved_step_frac": {x}, "{key}": [{x}], "other": null}}}}"#)
        };
        write(
            folder.path(),
            "expert_policies/a_results.json",
            &record("episode_solved_fracs", 0.5),
        );
        for (seed, x) in [("seed_10", 0.3), ("seed_2", 0.2)] {
            let text = record("episode_solve_step_fracs", x);
            write(folder.path(), &format!("obc/{seed}/x_results.json"), &text);
        }
        let tree = read_benchmark_tree(folder.path()).unwrap();
        assert_eq!(tree.experts["pen"].episode_solve_step_fracs, Some(vec![0.5]));
        let fractions: Vec<_> =
            tree.methods["obc"].iter().map(|seed| seed.tasks["pen"].avg_solved_step_frac).collect();
        assert_eq!(fractions, [Some(0.2), Some(0.3)]);
    }

    #[test]
    fn two_files_of_one_seed_or_task_and_broken_ones_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "a/seed_0/x_results.json", "{}");
        write(folder.path(), "a/seed_0/y_results.json", "{}");
        let message = |error: RecordError| error.to_string();
        assert!(message(read_benchmark_tree(folder.path()).unwrap_err()).contains("found 2"));
        let twice = tempfile::tempdir().unwrap();
        write(twice.path(), "x_results.json", r#"{"pen": {}}"#);
        write(twice.path(), "y_results.json", r#"{"pen": {}}"#);
        assert!(message(read_merged_benchmarks(twice.path()).unwrap_err()).contains("task `pen`"));
        write(twice.path(), "z.json", r#"{"pen": {"avg_solved": "much"}}"#);
        let error = message(read_benchmark(&twice.path().join("z.json")).unwrap_err());
        assert!(error.contains("line 1, column"), "{error}");
        let empty = tempfile::tempdir().unwrap();
        assert!(matches!(read_benchmark_tree(empty.path()), Err(RecordError::NoFiles { .. })));
    }

    #[test]
    fn a_selection_stays_below_its_root() {
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), "data/x_results.json", r#"{"pen": {}}"#);
        let select = |text: &str| {
            write(folder.path(), "policies.json", text);
            read_selection(&folder.path().join("policies.json"), folder.path())
        };
        let methods = select(r#"{"ppo-t": ["data/x_results.json"]}"#).unwrap();
        assert_eq!(methods["ppo_t"][0].tasks.len(), 1);
        for path in ["../x_results.json", "/etc/x_results.json", "data/../../x"] {
            assert!(select(&format!(r#"{{"a": ["{path}"]}}"#)).is_err(), "{path}");
        }
        assert!(select(r#"{"a-b": [], "a_b": []}"#).is_err());
    }
}

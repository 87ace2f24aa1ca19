//! Whatever holds benchmark results, recognised by what it is.
//!
//! * a JSON file of records: one seed;
//! * a JSON file of lists of paths: a selection; the paths start at the nearest folder above it below which the first
//!   of them exists;
//! * a JSON file from policy to records: several policies that differ in one thing, as in the ablation of the history;
//! * a folder with `results.json`: a run of `evaluate`, one seed;
//! * a folder with `*_results.json`: one seed, its files merged by task; the experts, if all names start with `expert`;
//! * any other folder: a tree of methods.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::benchmarks::read_json;
use super::result_files::{files_in, name_of};
use super::{
    Benchmark, RecordError, SeedResult, SurveyedTree, read_benchmark, read_merged_benchmarks,
    read_selection, survey_benchmark_tree,
};

/// What a run of `evaluate` calls its records.
const OWN_RESULTS: &str = "results.json";
/// How names of result files end.
const SUFFIX: &str = "_results.json";
/// How far above a selection its paths may start.
const LEVELS: usize = 6;

/// What was found at a path.
#[derive(Debug)]
pub enum BenchmarkInput {
    /// The records of one policy.
    Seed(SeedResult),
    /// Records of experts.
    Experts(Benchmark),
    /// Methods with their seeds.
    Selection(BTreeMap<String, Vec<SeedResult>>),
    /// The records of several policies in one file.
    Several(BTreeMap<String, Benchmark>),
    Tree(SurveyedTree),
}

/// Reads what is at `path`.
pub fn read_benchmark_input(path: &Path) -> Result<BenchmarkInput, RecordError> {
    if !path.is_dir() {
        return read_file(path);
    }
    let own = path.join(OWN_RESULTS);
    if own.is_file() {
        return Ok(BenchmarkInput::Seed(SeedResult { tasks: read_benchmark(&own)?, path: own }));
    }
    let files = files_in(path, |name| name.ends_with(SUFFIX))?;
    if files.is_empty() {
        return Ok(BenchmarkInput::Tree(survey_benchmark_tree(path)?));
    }
    let tasks = read_merged_benchmarks(path)?;
    if files.iter().all(|file| name_of(file).starts_with("expert")) {
        return Ok(BenchmarkInput::Experts(tasks));
    }
    Ok(BenchmarkInput::Seed(SeedResult { tasks, path: path.to_path_buf() }))
}

fn read_file(path: &Path) -> Result<BenchmarkInput, RecordError> {
    // A record holds numbers and lists, so it is never mistaken for the tasks of a policy.
    match read_json::<BTreeMap<String, Benchmark>>(path) {
        Ok(policies) if policies.values().any(|tasks| !tasks.is_empty()) => {
            return Ok(BenchmarkInput::Several(policies));
        }
        _ => {}
    }
    let error = match read_benchmark(path) {
        Ok(tasks) => return Ok(BenchmarkInput::Seed(SeedResult { tasks, path: path.into() })),
        Err(error) => error,
    };
    // What is no selection either is more likely a damaged file of records.
    let Ok(lists) = read_json::<BTreeMap<String, Vec<PathBuf>>>(path) else { return Err(error) };
    let first = lists.into_values().flatten().next().unwrap_or_default();
    Ok(BenchmarkInput::Selection(read_selection(path, &root_of(path, &first))?))
}

/// The nearest folder above `selection` below which `first` exists; its own folder if there is none.
fn root_of(selection: &Path, first: &Path) -> PathBuf {
    let absolute = std::path::absolute(selection).unwrap_or_else(|_| selection.to_path_buf());
    let own = absolute.parent().unwrap_or(Path::new(".")).to_path_buf();
    let above = own.ancestors().take(LEVELS).find(|folder| folder.join(first).exists());
    above.map_or(own.clone(), Path::to_path_buf)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files;

    fn write(folder: &Path, name: &str, text: &str) -> PathBuf {
        let path = folder.join(name);
        files::write_atomic(&path, text.as_bytes()).unwrap();
        path
    }

    #[test]
    fn everything_that_holds_results_is_recognised() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path();
        write(root, "runs/evaluate-1/results.json", r#"{"pen": {}}"#);
        write(root, "data/tree/obc/seed_0/x_results.json", r#"{"pen": {}}"#);
        write(root, "data/experts/expert_a_results.json", r#"{"pen": {}}"#);
        write(root, "data/experts/expert_b_results.json", r#"{"die": {}}"#);
        write(root, "data/one/a_results.json", r#"{"die": {}}"#);
        let list = r#"{"obc": ["data/tree/obc/seed_0/x_results.json"]}"#;
        let selection = write(root, "data/reproduction/policies.json", list);
        let read = |path: &str| read_benchmark_input(&root.join(path)).unwrap();
        assert!(matches!(read("runs/evaluate-1"), BenchmarkInput::Seed(_)));
        assert!(matches!(read("runs/evaluate-1/results.json"), BenchmarkInput::Seed(_)));
        write(
            root,
            "data/bilateral.json",
            r#"{"a": {"pen": {"avg_solved": 1}}, "b": {"pen": {}}}"#,
        );
        assert!(matches!(read("data/bilateral.json"), BenchmarkInput::Several(p) if p.len() == 2));
        assert!(matches!(read("data/one"), BenchmarkInput::Seed(_)));
        assert!(matches!(read("data/experts"), BenchmarkInput::Experts(e) if e.len() == 2));
        assert!(matches!(read("data/tree"), BenchmarkInput::Tree((t, _)) if t.methods.len() == 1));
        let found = read_benchmark_input(&selection).unwrap();
        assert!(matches!(found, BenchmarkInput::Selection(m) if m["obc"][0].tasks.len() == 1));
    }

    #[test]
    fn a_method_that_is_none_is_named_and_the_others_stay() {
        let folder = tempfile::tempdir().unwrap();
        for name in ["obc/seed_0/x", "other/run/a", "other/run/b"] {
            write(folder.path(), &format!("{name}_results.json"), r#"{"pen": {}}"#);
        }
        let BenchmarkInput::Tree((tree, unreadable)) = read_benchmark_input(folder.path()).unwrap()
        else {
            panic!("a tree");
        };
        assert_eq!(tree.methods.len(), 1);
        assert_eq!(unreadable[0].0, "other");
        assert!(unreadable[0].1.to_string().contains("found 2"));
    }

    #[test]
    fn what_is_no_result_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        for text in ["", "[]", "{\"a\": 1}", "{\"a\": {\"avg_solved\": \"x\"}}", "{\"a\": [3]}"] {
            let path = write(folder.path(), "x.json", text);
            assert!(read_benchmark_input(&path).is_err(), "{text}");
        }
        let empty = tempfile::tempdir().unwrap();
        assert!(read_benchmark_input(empty.path()).is_err());
        assert!(read_benchmark_input(&empty.path().join("nothing")).is_err());
    }
}

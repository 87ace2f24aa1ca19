//! Result files of fine-tuning inside a control subspace: `<run>_<task>…csi_<n>_results.json`.
//!
//! The number between `csi_` and `_results` counts the components. A file holds one task. Files lie in folders of any name,
//! at most [`DEPTH`] below the one given; other files are ignored.

use std::path::{Path, PathBuf};

use super::result_files::{files_in, folders_in, name_of};
use super::{BenchmarkEntry, RecordError, read_benchmark};

/// How names of result files end.
const SUFFIX: &str = "_results.json";
/// What stands in front of the number of components.
const MARK: &str = "csi_";
/// How far below the given folder files are looked for.
const DEPTH: usize = 3;

/// One file.
#[derive(Debug, Clone, PartialEq)]
pub struct CsiResult {
    /// Its name, which starts with that of its run.
    pub name: String,
    pub path: PathBuf,
    pub task: String,
    pub components: usize,
    pub entry: BenchmarkEntry,
}

/// All such files in and below `folder`, in the order of folders and names.
pub fn find_csi_results(folder: &Path) -> Result<Vec<CsiResult>, RecordError> {
    let mut found = Vec::new();
    collect(folder, DEPTH, &mut found)?;
    Ok(found)
}

fn collect(folder: &Path, depth: usize, found: &mut Vec<CsiResult>) -> Result<(), RecordError> {
    for path in files_in(folder, |name| components_of(name).is_some())? {
        let name = name_of(&path);
        let Some(components) = components_of(&name) else { continue };
        let tasks = read_benchmark(&path)?;
        let count = tasks.len();
        let mut tasks = tasks.into_iter();
        let (Some((task, entry)), None) = (tasks.next(), tasks.next()) else {
            return Err(RecordError::Malformed {
                place: "its tasks".to_owned(),
                what: format!("expected one, found {count}"),
                path,
            });
        };
        found.push(CsiResult { name, path, task, components, entry });
    }
    if depth > 0 {
        for below in folders_in(folder)? {
            collect(&below, depth - 1, found)?;
        }
    }
    Ok(())
}

/// The number of components that a file's name tells.
fn components_of(name: &str) -> Option<usize> {
    let (_, number) = name.strip_suffix(SUFFIX)?.rsplit_once(MARK)?;
    number.parse().ok().filter(|&count| count > 0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files;

    #[test]
    fn files_are_found_at_any_depth_and_others_ignored() {
        assert_eq!(components_of("333_pen_rl_model_5_steps_csi_20_results.json"), Some(20));
        for name in ["333_pen_results.json", "a_csi_0_results.json", "a_csi_x_results.json"] {
            assert_eq!(components_of(name), None, "{name}");
        }
        let folder = tempfile::tempdir().unwrap();
        let write = |name: &str, text: &str| {
            files::write_atomic(&folder.path().join(name), text.as_bytes()).unwrap();
        };
        write("csi_server/csi2_all/333_pen_csi_2_results.json", r#"{"pen": {}}"#);
        write("csi_server/csi2_all/notes.json", "{");
        write("obc/seed_0/x_results.json", "{");
        let found = find_csi_results(folder.path()).unwrap();
        assert_eq!((found.len(), found[0].task.as_str(), found[0].components), (1, "pen", 2));
        write("b/444_pen_csi_2_results.json", r#"{"pen": {}, "die": {}}"#);
        let error = find_csi_results(folder.path()).unwrap_err().to_string();
        assert!(error.contains("expected one, found 2"), "{error}");
    }
}

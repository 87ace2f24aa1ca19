//! Finding result files: the entries of a folder in an order people expect.

use std::path::{Path, PathBuf};

use super::RecordError;
use crate::files::FileError;

/// No folder may have more entries than this.
const MOST_ENTRIES: usize = 100_000;

/// Files of `folder` whose name is `wanted`, numbers in names compared as numbers.
pub(super) fn files_in(
    folder: &Path,
    wanted: impl Fn(&str) -> bool,
) -> Result<Vec<PathBuf>, RecordError> {
    Ok(entries(folder)?
        .into_iter()
        .filter(|path| path.is_file() && wanted(&name_of(path)))
        .collect())
}

/// Folders in `folder`, numbers in names compared as numbers.
pub(super) fn folders_in(folder: &Path) -> Result<Vec<PathBuf>, RecordError> {
    Ok(entries(folder)?.into_iter().filter(|path| path.is_dir()).collect())
}

/// The last part of a path.
pub(super) fn name_of(path: &Path) -> String {
    path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default()
}

fn entries(folder: &Path) -> Result<Vec<PathBuf>, RecordError> {
    let fail = |source| FileError::Read { path: folder.to_path_buf(), source };
    let mut paths = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        paths.push(entry.map_err(fail)?.path());
        if paths.len() > MOST_ENTRIES {
            return Err(RecordError::Malformed {
                place: format!("entry {MOST_ENTRIES}"),
                what: "there are more entries than any folder of results has".to_owned(),
                path: folder.to_path_buf(),
            });
        }
    }
    // What other systems leave behind is no result.
    paths.retain(|path| !name_of(path).starts_with('.'));
    paths.sort_by_cached_key(|path| natural(&name_of(path)));
    Ok(paths)
}

/// A sort key in which `seed_10` comes after `seed_2`.
fn natural(name: &str) -> Vec<(u128, String)> {
    let mut parts = Vec::new();
    let mut rest = name;
    while !rest.is_empty() {
        let text = rest.find(|c: char| c.is_ascii_digit()).unwrap_or(rest.len());
        let digits = rest[text..].find(|c: char| !c.is_ascii_digit());
        let end = digits.map_or(rest.len(), |digits| text + digits);
        // Longer numbers than any count compare as text.
        let number = rest[text..end].parse().unwrap_or(0);
        parts.push((0, rest[..text].to_owned()));
        parts.push((number, rest[text..end].to_owned()));
        rest = &rest[end..];
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_in_names_are_compared_as_numbers() {
        let mut names = ["seed_10", "seed_2", "seed", "run_1_b", "run_1_a", "run_01"];
        names.sort_by_key(|name| natural(name));
        assert_eq!(names, ["run_01", "run_1_a", "run_1_b", "seed", "seed_2", "seed_10"]);
    }
}

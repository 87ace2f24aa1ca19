//! A folder of human EMG: the labels and one table per person (`data/emg/README.md`).
//!
//! The tables may lie in the folder itself, as `setup --emg` puts them, or below it as `human_emg/` or
//! `emg_assets/human_emg/`, as the KINESIS assets have them, or as `synthetic/`, the invented people of this
//! repository. The first of these that holds the labels is taken; people recorded at other speeds are left alone.
//!
//! A folder with a `cohort.toml` is of another laboratory (`emg_cohort`).
//!
//! A folder that holds a file `SYNTHETIC` is no measurement, and whatever is made with it has to say so.

use std::path::{Path, PathBuf};

use super::emg_cohort;
use crate::analysis::emg::{EmgError, HumanProfiles, SubjectTable};
use crate::analysis::signal::Rows;
use crate::files::{self, FileError};
use crate::npz::{ArrayError, Member, parse_member, parse_npy};

const LABELS: &str = "EMG_labels.npy";
const SYNTHETIC: &str = "SYNTHETIC";
/// Where the tables may lie below the folder that was named.
const LAYOUTS: [&str; 4] = ["", "human_emg", "emg_assets/human_emg", "synthetic"];
/// A table of a hundred points has 8 kB.
const LARGEST_FILE: u64 = 1 << 20;
/// No cohort is larger.
const MOST_PEOPLE: usize = 1000;
/// Time and nine channels.
const COLUMNS: usize = 10;

/// Why a folder of human EMG cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum SubjectsError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("there is no `{LABELS}` in `{path}`")]
    NoLabels { path: PathBuf },
    #[error("{fault}, in `{path}`")]
    Array { fault: ArrayError, path: PathBuf },
    #[error("expected ten texts, found {found}, in `{path}`")]
    NotLabels { found: &'static str, path: PathBuf },
    #[error("expected rows of {COLUMNS} columns, found the shape {found:?}, in `{path}`")]
    Shape { found: Vec<usize>, path: PathBuf },
    #[error("{fault}, in `{path}`")]
    Content { fault: EmgError, path: PathBuf },
    #[error("{fault}, in `{path}`")]
    Description { fault: String, path: PathBuf },
    #[error("{fault}")]
    Table { fault: String },
    #[error("{fault}, in `{path}`")]
    Columns { fault: String, path: PathBuf },
    #[error("values are missing of everybody ({left_out} people), in the tables of `{path}`")]
    NobodyComplete { left_out: usize, path: PathBuf },
    #[error("these people walked at {walked} km/h, not at {asked} km/h, says `{path}`")]
    OtherSpeed { asked: WalkingSpeed, walked: f64, path: PathBuf },
    #[error("nobody was recorded at {speed} km/h (`{pattern}`), in `{path}`")]
    Nobody { speed: WalkingSpeed, pattern: String, path: PathBuf },
}

/// Walking speed in tenths of km/h, as the names of the files have it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct WalkingSpeed(pub u8);

impl std::fmt::Display for WalkingSpeed {
    fn fmt(&self, formatter: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(formatter, "{}.{}", self.0 / 10, self.0 % 10)
    }
}

/// The people of a folder.
#[derive(Debug, Clone, PartialEq)]
pub struct Subjects {
    pub people: HumanProfiles,
    pub speed: WalkingSpeed,
    /// Whether the people are invented.
    pub synthetic: bool,
    /// Where the tables lie.
    pub folder: PathBuf,
    /// BLAKE3 of everything read.
    pub hash: String,
    /// Who was left out, and why.
    pub left_out: Vec<String>,
}

/// Reads the people in `folder` who walked at `speed`.
pub fn read_subjects(folder: &Path, speed: WalkingSpeed) -> Result<Subjects, SubjectsError> {
    if folder.join(emg_cohort::DESCRIPTION).is_file() {
        return emg_cohort::read(folder, speed);
    }
    let layouts = LAYOUTS.map(|layout| folder.join(layout));
    let Some(folder) = layouts.into_iter().find(|folder| folder.join(LABELS).is_file()) else {
        return Err(SubjectsError::NoLabels { path: folder.to_path_buf() });
    };
    let mut hasher = blake3::Hasher::new();
    let labels = read_labels(&folder.join(LABELS), &mut hasher)?;
    let ending = format!("_walk_{:02}_avg.npy", speed.0);
    let number = |path: &PathBuf| -> Option<u32> {
        let name = path.file_name()?.to_str()?;
        name.strip_prefix("EMG_subject_")?.strip_suffix(&ending)?.parse().ok()
    };
    let mut named: Vec<(u32, PathBuf)> = files::list(&folder)?
        .into_iter()
        .filter_map(|path| Some((number(&path)?, path)))
        .take(MOST_PEOPLE)
        .collect();
    named.sort();
    if named.is_empty() {
        let pattern = format!("EMG_subject_SS{ending}");
        return Err(SubjectsError::Nobody { speed, pattern, path: folder });
    }
    let tables = named
        .iter()
        .map(|(_, path)| read_table(path, &mut hasher))
        .collect::<Result<Vec<_>, _>>()?;
    let in_file = |fault: EmgError, path: &Path| {
        let path = path.to_path_buf();
        SubjectsError::Content { fault, path }
    };
    let mut subjects = Vec::with_capacity(tables.len());
    for ((subject, path), table) in named.iter().zip(&tables) {
        let rows = Rows::new(table, COLUMNS).map_err(|fault| in_file(fault.into(), path))?;
        subjects.push(SubjectTable { subject: *subject, rows });
    }
    let people = HumanProfiles::new(&labels, &subjects).map_err(|fault| in_file(fault, &folder))?;
    Ok(Subjects {
        people,
        speed,
        synthetic: folder.join(SYNTHETIC).exists(),
        folder,
        hash: hasher.finalize().to_hex().to_string(),
        left_out: Vec::new(),
    })
}

/// A file of at most `largest` bytes, which `hasher` sees too.
pub(super) fn hashed(
    path: &Path,
    largest: u64,
    hasher: &mut blake3::Hasher,
) -> Result<Vec<u8>, FileError> {
    let bytes = files::read_bounded(path, largest)?;
    hasher.update(&(bytes.len() as u64).to_le_bytes());
    hasher.update(&bytes);
    Ok(bytes)
}

fn read(path: &Path, hasher: &mut blake3::Hasher) -> Result<(String, Vec<u8>), FileError> {
    let bytes = hashed(path, LARGEST_FILE, hasher)?;
    let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    Ok((name, bytes))
}

fn read_labels(path: &Path, hasher: &mut blake3::Hasher) -> Result<Vec<String>, SubjectsError> {
    let (name, bytes) = read(path, hasher)?;
    let wrong = |found| SubjectsError::NotLabels { found, path: path.to_path_buf() };
    match parse_member(&name, &bytes) {
        Ok(Member::Texts(texts)) if texts.shape.len() == 1 => Ok(texts.values),
        Ok(Member::Texts(_)) => Err(wrong("a table of texts")),
        Ok(Member::Numbers(_)) => Err(wrong("numbers")),
        Err(fault) => Err(SubjectsError::Array { fault, path: path.to_path_buf() }),
    }
}

/// The values of a person's table, row by row.
fn read_table(path: &Path, hasher: &mut blake3::Hasher) -> Result<Vec<f64>, SubjectsError> {
    let (name, bytes) = read(path, hasher)?;
    let array = parse_npy(&name, &bytes)
        .map_err(|fault| SubjectsError::Array { fault, path: path.to_path_buf() })?;
    if array.shape.len() != 2 || array.shape[1] != COLUMNS {
        return Err(SubjectsError::Shape { found: array.shape, path: path.to_path_buf() });
    }
    Ok(array.to_f64())
}

#[cfg(test)]
mod tests {
    use super::*;

    const NORMAL: WalkingSpeed = WalkingSpeed(45);

    fn invented() -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("data/emg")
    }

    /// A copy of the invented people in a folder of its own.
    fn copy() -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for path in files::list(&invented().join("synthetic")).unwrap() {
            std::fs::copy(&path, folder.path().join(path.file_name().unwrap())).unwrap();
        }
        folder
    }

    #[test]
    fn the_invented_people_are_found_below_their_folder_and_known_for_what_they_are() {
        let subjects = read_subjects(&invented(), NORMAL).unwrap();
        assert!(subjects.synthetic && subjects.folder.ends_with("synthetic"));
        assert_eq!(subjects.people.subjects(), [4, 5, 6, 7, 8, 9, 10, 11, 12]);
        let moved = copy();
        std::fs::remove_file(moved.path().join(SYNTHETIC)).unwrap();
        let same = read_subjects(moved.path(), NORMAL).unwrap();
        assert!(!same.synthetic);
        assert_eq!((&same.people, &same.hash), (&subjects.people, &subjects.hash));
    }

    #[test]
    fn what_is_missing_or_does_not_fit_is_named_with_its_file() {
        let empty = tempfile::tempdir().unwrap();
        let error = read_subjects(empty.path(), NORMAL).unwrap_err();
        assert!(matches!(error, SubjectsError::NoLabels { .. }), "{error}");
        let error = read_subjects(&invented(), WalkingSpeed(9)).unwrap_err().to_string();
        assert!(error.contains("0.9 km/h") && error.contains("walk_09_avg"), "{error}");

        let folder = copy();
        let table = folder.path().join("EMG_subject_07_walk_45_avg.npy");
        let whole = std::fs::read(&table).unwrap();
        let mut nan = whole.clone();
        let end = nan.len();
        nan[end - 8..].copy_from_slice(&f64::NAN.to_le_bytes());
        for (bytes, word) in [(nan, "NaN"), (whole[..end - 8].to_vec(), "another length")] {
            files::write_atomic(&table, &bytes).unwrap();
            let error = read_subjects(folder.path(), NORMAL).unwrap_err().to_string();
            assert!(error.contains(word) && error.contains("subject_07"), "{error}");
        }
        files::write_atomic(&table, &whole).unwrap();
        std::fs::copy(&table, folder.path().join(LABELS)).unwrap();
        let error = read_subjects(folder.path(), NORMAL).unwrap_err();
        assert!(matches!(error, SubjectsError::NotLabels { found: "numbers", .. }), "{error}");
    }
}

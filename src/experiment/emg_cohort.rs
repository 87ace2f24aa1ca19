//! Human EMG of any laboratory: CSV tables of mean envelopes and a `cohort.toml` that says which column is which muscle
//! (`data/emg/README.md`).
//!
//! Every table must come to the same number of points of the gait cycle, heel strike to heel strike. Where stance and
//! swing were stretched apart, `stance` says how many rows stance has and which share of the cycle it takes, and the
//! rows are laid on an even grid by straight lines between them.
//!
//! A person of whom some value is missing is left out and named; the others stay.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;

use super::emg_subjects::{Subjects, SubjectsError, WalkingSpeed, hashed};
use crate::analysis::emg::{HUMAN_CHANNELS, HumanProfiles, SubjectTable};
use crate::analysis::signal::Rows;
use crate::files;
use crate::record::{Table, Values, read_csv};

/// What describes such a cohort.
pub(super) const DESCRIPTION: &str = "cohort.toml";
/// Where the number of a person stands in the name of a file.
const NUMBER: &str = "{subject}";
/// A table of some hundred points has some hundred kilobytes, a long one of a whole study some megabytes.
const LARGEST_FILE: u64 = 64 << 20;
const LARGEST_DESCRIPTION: u64 = 1 << 16;
/// Points of a cycle that anybody works with.
const MOST_POINTS: usize = 100_000;
const MOST_PEOPLE: usize = 1000;

/// `cohort.toml`.
#[derive(Debug, Deserialize)]
#[serde(deny_unknown_fields)]
struct Description {
    /// Name of a person's file, with `{subject}` for the number.
    files: Option<String>,
    /// Or one table of all people,
    table: Option<String>,
    /// and its column with the number of the person.
    person: Option<String>,
    /// Speed at which they walked, km/h.
    speed: f64,
    #[serde(default)]
    synthetic: bool,
    stance: Option<Stance>,
    /// Label of a channel → column, or columns whose mean counts.
    muscles: BTreeMap<String, Columns>,
}

/// How stance was stretched.
#[derive(Debug, Clone, Copy, Deserialize)]
#[serde(deny_unknown_fields)]
struct Stance {
    /// Rows of it, the first of the table.
    rows: usize,
    /// Its share of the cycle, between 0 and 1.
    share: f64,
}

#[derive(Debug, Deserialize)]
#[serde(untagged)]
enum Columns {
    One(String),
    Several(Vec<String>),
}

impl Columns {
    fn names(&self) -> &[String] {
        match self {
            Self::One(name) => std::slice::from_ref(name),
            Self::Several(names) => names,
        }
    }
}

/// Reads the cohort in `folder`, which was recorded at `speed`.
pub(super) fn read(folder: &Path, speed: WalkingSpeed) -> Result<Subjects, SubjectsError> {
    let path = folder.join(DESCRIPTION);
    let mut hasher = blake3::Hasher::new();
    let bytes = hashed(&path, LARGEST_DESCRIPTION, &mut hasher)?;
    let wrong = |fault: String| SubjectsError::Description { fault, path: path.clone() };
    let description: Description =
        toml::from_slice(&bytes).map_err(|fault| wrong(fault.to_string().trim_end().to_owned()))?;
    let columns = check(&description).map_err(wrong)?;
    if (description.speed * 10.0).round() as u8 != speed.0 {
        let (asked, walked) = (speed, description.speed);
        return Err(SubjectsError::OtherSpeed { asked, walked, path });
    }

    let mut tables: Vec<(u32, Vec<f64>)> = Vec::new();
    let mut incomplete = Vec::new();
    let mut sort = |subject: u32, table: Vec<f64>, file: &Path| match table
        .iter()
        .position(|value| !value.is_finite())
    {
        None => tables.push((subject, table)),
        Some(place) => {
            let channel = HUMAN_CHANNELS[place % (HUMAN_CHANNELS.len() + 1) - 1];
            let row = place / (HUMAN_CHANNELS.len() + 1) + 1;
            let file = file.file_name().unwrap_or_default().to_string_lossy();
            incomplete.push(format!(
                    "subject {subject} is left out: `{channel}` has no value at point {row}, in `{file}`"
                ));
        }
    };
    for (path, people) in sources(folder, &description)? {
        _ = hashed(&path, LARGEST_FILE, &mut hasher)?;
        let table =
            read_csv(&path).map_err(|fault| SubjectsError::Table { fault: fault.to_string() })?;
        let fault = |fault: String| SubjectsError::Columns { fault, path: path.clone() };
        for (subject, rows) in people_of(&table, people, &description).map_err(fault)? {
            let values = values(&table, &rows, &columns, description.stance).map_err(fault)?;
            sort(subject, values, &path);
        }
    }
    tables.sort_by_key(|(subject, _)| *subject);
    if tables.is_empty() {
        return Err(SubjectsError::NobodyComplete { left_out: incomplete.len(), path });
    }
    let in_folder = |fault| SubjectsError::Content { fault, path: folder.to_path_buf() };
    let subjects = tables.iter().map(|(subject, table)| {
        let rows = Rows::new(table, HUMAN_CHANNELS.len() + 1)?;
        Ok(SubjectTable { subject: *subject, rows })
    });
    let subjects = subjects.collect::<Result<Vec<_>, _>>().map_err(in_folder)?;
    let labels: Vec<String> =
        ["Time"].into_iter().chain(HUMAN_CHANNELS).map(str::to_owned).collect();
    Ok(Subjects {
        people: HumanProfiles::new(&labels, &subjects).map_err(in_folder)?,
        speed,
        synthetic: description.synthetic,
        folder: folder.to_path_buf(),
        hash: hasher.finalize().to_hex().to_string(),
        left_out: incomplete,
    })
}

/// The columns of every channel, in the order of the channels.
fn check(description: &Description) -> Result<Vec<&[String]>, String> {
    if let Some(unknown) =
        description.muscles.keys().find(|label| !HUMAN_CHANNELS.contains(&label.as_str()))
    {
        let known = HUMAN_CHANNELS.join("`, `");
        return Err(format!("`{unknown}` is no channel; they are `{known}`"));
    }
    if let Some(stance) = description.stance
        && !(stance.rows > 0 && stance.share > 0.0 && stance.share < 1.0)
    {
        let Stance { rows, share } = stance;
        return Err(format!("stance of {rows} rows and a share of {share} is impossible"));
    }
    let columns = HUMAN_CHANNELS.iter().map(|channel| match description.muscles.get(*channel) {
        Some(columns) if !columns.names().is_empty() => Ok(columns.names()),
        _ => Err(format!("no column is named for `{channel}`")),
    });
    columns.collect()
}

/// Files to read, each with the person it is of, or none if it holds all of them.
fn sources(
    folder: &Path,
    description: &Description,
) -> Result<Vec<(PathBuf, Option<u32>)>, SubjectsError> {
    let wrong = |fault: &str| SubjectsError::Description {
        fault: fault.to_owned(),
        path: folder.join(DESCRIPTION),
    };
    // Names of files, not ways out of the folder.
    let plain = |name: &str| !name.contains(['/', '\\']) && !name.starts_with('.');
    match (&description.files, &description.table, &description.person) {
        (Some(pattern), None, None) if plain(pattern) => {
            let (before, after) = pattern
                .split_once(NUMBER)
                .ok_or_else(|| wrong("`files` lacks `{subject}`, the number of the person"))?;
            let number = |path: &PathBuf| -> Option<u32> {
                let name = path.file_name()?.to_str()?;
                name.strip_prefix(before)?.strip_suffix(after)?.parse().ok()
            };
            let numbered = files::list(folder)?.into_iter().filter_map(|path| {
                let subject = number(&path)?;
                Some((path, Some(subject)))
            });
            Ok(numbered.take(MOST_PEOPLE).collect())
        }
        (None, Some(table), Some(_)) if plain(table) => Ok(vec![(folder.join(table), None)]),
        _ => Err(wrong("it needs either `files` or both `table` and `person`, of this folder")),
    }
}

/// The rows of every person in a table.
fn people_of(
    table: &Table,
    person: Option<u32>,
    description: &Description,
) -> Result<Vec<(u32, Vec<usize>)>, String> {
    if let Some(subject) = person {
        return Ok(vec![(subject, (0..table.row_count()).collect())]);
    }
    let name = description.person.as_deref().unwrap_or_default();
    let column = table.column(name).ok_or_else(|| format!("there is no column `{name}`"))?;
    let Values::Integers(numbers) = &column.values else {
        return Err(format!("`{name}` holds something else than whole numbers"));
    };
    let mut people: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
    for (row, &number) in numbers.iter().enumerate() {
        let subject = u32::try_from(number)
            .map_err(|_| format!("`{name}` is {number} in row {}", row + 1))?;
        people.entry(subject).or_default().push(row);
    }
    if people.len() > MOST_PEOPLE {
        return Err(format!("it holds {} people, more than {MOST_PEOPLE}", people.len()));
    }
    Ok(people.into_iter().collect())
}

/// Time and channels, point by point. What is missing is NaN.
fn values(
    table: &Table,
    rows: &[usize],
    columns: &[&[String]],
    stance: Option<Stance>,
) -> Result<Vec<f64>, String> {
    if rows.len() > MOST_POINTS {
        return Err(format!("a cycle of {} points; at most {MOST_POINTS} are read", rows.len()));
    }
    let profiles: Vec<Vec<f64>> = columns
        .iter()
        .map(|names| {
            let numbers: Vec<Vec<f64>> =
                names.iter().map(|name| numbers(table, name, rows)).collect::<Result<_, _>>()?;
            let mean = |row: usize| {
                numbers.iter().map(|column| column[row]).sum::<f64>() / numbers.len() as f64
            };
            let profile: Vec<f64> = (0..rows.len()).map(mean).collect();
            stance.map_or(Ok(profile.clone()), |stance| unstretched(&profile, stance))
        })
        .collect::<Result<_, String>>()?;
    let point = |row: usize| {
        let channels = profiles.iter().map(move |profile| profile[row]);
        std::iter::once(row as f64).chain(channels)
    };
    Ok((0..rows.len()).flat_map(point).collect())
}

fn numbers(table: &Table, name: &str, rows: &[usize]) -> Result<Vec<f64>, String> {
    let column = table.column(name).ok_or_else(|| {
        let known: Vec<&str> = table.columns().iter().map(|column| column.name.as_str()).collect();
        format!("there is no column `{name}`; there are `{}`", known.join("`, `"))
    })?;
    match &column.values {
        Values::Floats(values) => Ok(rows.iter().map(|&row| values[row]).collect()),
        Values::Integers(values) => Ok(rows.iter().map(|&row| values[row] as f64).collect()),
        _ => Err(format!("`{name}` holds something else than numbers")),
    }
}

/// A profile whose first rows are stance and whose others are swing, each evenly spaced, on one even grid of as many
/// points.
fn unstretched(profile: &[f64], stance: Stance) -> Result<Vec<f64>, String> {
    let Stance { rows, share } = stance;
    let (count, swing) = (profile.len(), profile.len().saturating_sub(rows));
    if rows < 2 || swing < 2 {
        return Err(format!("stance has {rows} of the table's {count} rows; each part needs two"));
    }
    // Row k lies at this share of the cycle: each part reaches from its first moment to its last.
    let place = |row: usize| {
        if row < rows {
            share * row as f64 / (rows - 1) as f64
        } else {
            share + (1.0 - share) * (row - rows) as f64 / (swing - 1) as f64
        }
    };
    let value = |point: usize| {
        let wanted = point as f64 / (count - 1) as f64;
        let after = (0..count).find(|&row| place(row) >= wanted).unwrap_or(count - 1);
        let before = after.saturating_sub(1);
        let (low, high) = (place(before), place(after));
        if high <= low {
            return profile[after];
        }
        let weight = (wanted - low) / (high - low);
        profile[before] * (1.0 - weight) + profile[after] * weight
    };
    Ok((0..count).map(value).collect())
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "small whole numbers are exact")]
mod tests {
    use super::*;

    const SPEED: WalkingSpeed = WalkingSpeed(50);

    const MUSCLES: &str = "[muscles]\n\"Soleus\" = \"SO\"\n\"Medial Gastrocnemius\" = \"GM\"\n\
        \"Lateral Gastrocnemius\" = \"GL\"\n\"Tibialis Anterior\" = \"TA\"\n\"Semimembranosus\" = \"ST\"\n\
        \"Biceps Femoris\" = \"BF\"\n\"Vastus Lateral\" = \"VL\"\n\"Rectus Femoris\" = \"RF\"\n\
        \"Vastus Medial\" = [\"VM\", \"VL\"]\n";

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            files::write_atomic(&folder.path().join(name), text.as_bytes()).unwrap();
        }
        folder
    }

    /// Rows whose columns are `10 · column + row`, but VM is 100.
    fn csv(rows: usize, missing: Option<usize>) -> String {
        let mut text = "SO,GM,GL,TA,ST,BF,VL,RF,VM\n".to_owned();
        for row in 0..rows {
            let mut cells: Vec<String> = (0..8).map(|c| (10 * c + row).to_string()).collect();
            cells.push("100.5".to_owned());
            if missing == Some(row) {
                cells[3].clear();
            }
            text += &(cells.join(",") + "\n");
        }
        text
    }

    fn described(head: &str) -> String {
        format!("{head}\nspeed = 5.0\n{MUSCLES}")
    }

    #[test]
    fn columns_become_channels_and_an_incomplete_person_is_left_out_by_name() {
        let folder = folder(&[
            (DESCRIPTION, &described("files = \"ID{subject}_V.csv\"")),
            ("ID0002_V.csv", &csv(4, None)),
            ("ID0001_V.csv", &csv(4, Some(2))),
            ("ID0001_M.csv", "nothing"),
        ]);
        let cohort = read(folder.path(), SPEED).unwrap();
        assert_eq!(cohort.people.subjects(), [2]);
        assert_eq!(cohort.people.profile(0, 3), [30.0, 31.0, 32.0, 33.0]);
        // The mean of VM and VL.
        assert_eq!(cohort.people.profile(0, 8)[1], 80.75);
        let [left_out] = cohort.left_out.as_slice() else { panic!("{:?}", cohort.left_out) };
        for word in ["subject 1", "Tibialis Anterior", "point 3", "ID0001_V.csv"] {
            assert!(left_out.contains(word), "{left_out}");
        }
    }

    #[test]
    fn one_table_may_hold_everybody() {
        let table = csv(2, None);
        let mut lines = table.lines();
        let mut text = format!("trial,{}\n", lines.next().unwrap());
        for (person, line) in [7, 3].into_iter().flat_map(|p| lines.clone().map(move |l| (p, l))) {
            text.extend([&person.to_string(), ",", line, "\n"]);
        }
        let description = described("table = \"all.csv\"\nperson = \"trial\"");
        let folder = folder(&[(DESCRIPTION, &description), ("all.csv", &text)]);
        let cohort = read(folder.path(), SPEED).unwrap();
        assert_eq!(cohort.people.subjects(), [3, 7]);
    }

    #[test]
    fn stance_and_swing_are_laid_on_one_grid() {
        // Stance takes three quarters of the cycle in three of five rows; the value is the share of the cycle.
        let profile = [0.0, 0.375, 0.75, 0.75, 1.0];
        let stance = Stance { rows: 3, share: 0.75 };
        assert_eq!(unstretched(&profile, stance).unwrap(), [0.0, 0.25, 0.5, 0.75, 1.0]);
        assert!(unstretched(&profile, Stance { rows: 4, share: 0.5 }).is_err());
    }

    #[test]
    fn what_does_not_fit_is_named_with_its_file() {
        let files = "files = \"p{subject}.csv\"";
        for (description, table, words) in [
            ("speed = ".to_owned(), csv(2, None), ["line 1", DESCRIPTION]),
            (format!("{files}\nspeed = 4.0\n{MUSCLES}"), csv(2, None), ["4 km/h", "5.0 km/h"]),
            (described("files = \"../{subject}.csv\""), csv(2, None), ["of this folder", "cohort"]),
            (described("files = \"p.csv\""), csv(2, None), ["{subject}", DESCRIPTION]),
            (described(files).replace("\"TA\"", "\"tib\""), csv(2, None), ["`tib`", "p1.csv"]),
            (described(files).replace("\"Soleus\"", "\"Sol\""), csv(2, None), ["`Sol`", "Soleus"]),
            (described(files), csv(2, Some(0)), ["everybody", "1"]),
            (described(files), csv(2, None).replace("100.5", "x"), ["`VM`", "p1.csv"]),
        ] {
            let folder = folder(&[(DESCRIPTION, &description), ("p1.csv", &table)]);
            let error = read(folder.path(), SPEED).unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{words:?}: {error}");
        }
    }
}

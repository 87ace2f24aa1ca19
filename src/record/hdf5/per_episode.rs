//! The recordings of the first release (`spec/analysis.md` §16.2), a file per episode, and their export to the compact
//! layout (§16.3).
//!
//! Joint angles are the first 23 of the observed numbers: of the newest frame where there is a history, of the row where
//! there is none. `activations` holds the physical muscle controls.

use std::path::{Path, PathBuf};

use super::axes::Axes;
use super::compact::{FLAGS, Names, Reading, metadata};
use super::source::Source;
use crate::files;
use crate::record::RecordError;
use crate::record::format::Opened;
use crate::record::recording::{About, Samples, Timing, names};
use crate::units::Seconds;

/// Data sets that are taken as they are.
const DATA_SETS: [(&str, &str); 5] = [
    (names::ACTION, "actions"),
    (names::ACTION_MEAN, "action_means"),
    (names::REWARD, "rewards"),
    (names::SOLVED, "solved"),
    (names::EXCITATION, "activations"),
];
/// Attributes of an episode that follow from its data sets.
const KNOWN: [&str; 3] = ["episode_length", "total_reward", "solved_steps"];
const OBSERVATIONS: &str = "observations";

/// What an export is made of.
#[derive(Debug, Clone)]
pub struct ExportOptions {
    pub task: String,
    pub policy: String,
    /// Numbers of the episodes, or how many of the first.
    pub episodes: Result<Vec<u64>, usize>,
    pub axes: Axes,
    pub horizon: usize,
    pub control_interval: Option<Seconds>,
    pub actions_clipped: Option<bool>,
    pub means_clipped: Option<bool>,
}

/// Reads the `<task>_episode_<i>.h5` of `folder`, sorted by number.
pub fn export(folder: &Path, options: &ExportOptions) -> Result<Opened, RecordError> {
    let mut found = files_of(folder, &options.task)?;
    match &options.episodes {
        Ok(numbers) => {
            let missing = numbers.iter().find(|n| !found.iter().any(|(number, _)| number == *n));
            if let Some(missing) = missing {
                return Err(none(folder, &format!("{}_episode_{missing}.h5", options.task)));
            }
            found.retain(|(number, _)| numbers.contains(number));
        }
        Err(count) => found.truncate(*count),
    }
    if found.is_empty() {
        return Err(none(folder, &format!("{}_episode_*.h5", options.task)));
    }
    let clipped =
        [("actions_clipped", options.actions_clipped), ("means_clipped", options.means_clipped)];
    let flags =
        clipped.into_iter().filter_map(|(name, flag)| Some((name.to_owned(), flag?.to_string())));
    let about = About {
        task: options.task.clone(),
        policy: options.policy.clone(),
        control_interval: options.control_interval,
        horizon: Some(options.horizon),
        metadata: flags.collect(),
        ..About::default()
    };
    read(&found, about, &options.axes)
}

fn none(folder: &Path, pattern: &str) -> RecordError {
    RecordError::NoEpisodes { pattern: pattern.to_owned(), path: folder.to_path_buf() }
}

/// Reads the one episode in `source`.
pub(super) fn read_one(source: &Source) -> Result<Opened, RecordError> {
    let stem = source.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let (task, number) = stem
        .rsplit_once("_episode_")
        .and_then(|(task, number)| Some((task.to_owned(), number.parse().ok()?)))
        .unwrap_or((stem, 0));
    let about = About { task, ..About::default() };
    read(&[(number, source.path.clone())], about, &Axes::hand())
}

/// The files of a task with their numbers, sorted.
fn files_of(folder: &Path, task: &str) -> Result<Vec<(u64, PathBuf)>, RecordError> {
    let prefix = format!("{task}_episode_");
    let number = |path: PathBuf| {
        let name = path.file_name()?.to_str()?;
        let number = name.strip_prefix(&prefix)?.strip_suffix(".h5")?.parse().ok()?;
        Some((number, path))
    };
    let mut found: Vec<_> = files::list(folder)?.into_iter().filter_map(number).collect();
    found.sort_unstable();
    Ok(found)
}

fn read(found: &[(u64, PathBuf)], mut about: About, axes: &Axes) -> Result<Opened, RecordError> {
    let mut reading = Reading::default();
    let mut last = None;
    for (number, path) in found {
        let source = Source::open(path)?;
        let attributes = source.attributes("")?;
        let length =
            attributes.length().ok_or_else(|| source.damaged("it has no `episode_length`"))?;
        reading.add(&source, "", *number, length, &DATA_SETS)?;
        if let Some((values, joints)) = joint_angles(&source, length, axes.joint_names.len())? {
            reading.add_samples(&source, names::JOINT, Some(Timing::BeforeStep), values, joints)?;
        }
        if last.is_none() {
            about.metadata.extend(metadata(&attributes, &KNOWN, &FLAGS));
        }
        last = Some(source);
    }
    let source = last.ok_or_else(|| none(Path::new("."), "*_episode_*.h5"))?;
    let axes = Names::or(&source, axes.clone())?;
    let mut opened = reading.finish(&source, about, &axes)?;
    for channel in &mut opened.recording.channels {
        // Recorded beside the observation the action was chosen from; the spec names the physical signals' timing only for
        // exports of old files, where it is this one.
        channel.timing = channel.timing.or(match channel.name.as_str() {
            names::REWARD | names::SOLVED => Some(Timing::AfterStep),
            _ => Some(Timing::BeforeStep),
        });
    }
    Ok(opened)
}

/// The joint angles among the observations, with their number; `None` if there are no observations.
fn joint_angles(
    source: &Source,
    length: usize,
    joints: usize,
) -> Result<Option<(Vec<f64>, usize)>, RecordError> {
    let too_few = |found: usize| {
        source.damaged(format!("`{OBSERVATIONS}` has {found} numbers, expected at least {joints}"))
    };
    // With a history: (steps, numbers, frames), the newest frame last. Without: (steps, numbers).
    let (samples, numbers, frames) = if source.has_data_set("", OBSERVATIONS)? {
        let (samples, width) = source.rows("", OBSERVATIONS, length)?;
        (samples, width, 1)
    } else if source.has_group(OBSERVATIONS)? {
        let shape = source.shape(OBSERVATIONS, "obs")?;
        let [_, _, frames] = shape[..] else {
            return Err(source.damaged(format!("`{OBSERVATIONS}/obs` has shape {shape:?}")));
        };
        let (samples, width) = source.rows(OBSERVATIONS, "obs", length)?;
        // No frame at all leaves no numbers, which is told below.
        let frames = (frames as usize).max(1);
        (samples, width / frames, frames)
    } else {
        return Ok(None);
    };
    if numbers < joints {
        return Err(too_few(numbers));
    }
    let newest = |step: usize, joint: usize| {
        let place = (step * numbers + joint) * frames + frames - 1;
        match &samples {
            Samples::Single(values) => f64::from(values[place]),
            other => other.value(place),
        }
    };
    let values = (0..length).flat_map(|step| (0..joints).map(move |joint| (step, joint)));
    Ok(Some((values.map(|(step, joint)| newest(step, joint)).collect(), joints)))
}

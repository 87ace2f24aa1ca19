//! `convert`: the same content in another format.
//!
//! What a file is decides what can be made of it. A policy becomes safetensors and JSON. Recordings become recordings: Parquet, MCAP, upstream's HDF5. A folder of
//! the first release's files, one per episode, becomes one recording (`spec/analysis.md` §16.3).

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::convert_policy;
use crate::cli::context::{Context, Outcome};
use crate::cli::render::{self, Align, Hinted};
use crate::record::{self, Format, Opened, Place, RecordError, Recording, names};

/// Arguments of `convert`.
#[derive(Debug, Args)]
pub struct ConvertArguments {
    /// A policy: checkpoint, folder of a run, or name; or recordings; or a folder of upstream's `<task>_episode_<i>.h5`
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Format to convert a recording to; without it, a policy becomes safetensors and JSON
    #[arg(long, value_name = "FORMAT", value_enum)]
    to: Option<Target>,
    /// Normaliser of a policy [default: the one beside the checkpoint]
    #[arg(long, value_name = "FILE", conflicts_with = "to")]
    normaliser: Option<PathBuf>,
    /// Make one policy of several checkpoints of one network: the mean of their weights, and all else as the last has it
    #[arg(long, conflicts_with = "to")]
    mean: bool,
    /// File to write, or the folder for several or for a policy; nothing that exists is overwritten
    #[arg(long, value_name = "PATH")]
    out: PathBuf,
    /// Channels to keep, by our names or upstream's; reward and solved always are [default: all]
    #[arg(long, value_name = "NAME", num_args = 1.., value_delimiter = ',')]
    signals: Vec<String>,
    #[command(flatten)]
    episodes: EpisodeArguments,
}

/// What a folder of single episodes does not say itself.
#[derive(Debug, Args)]
#[command(next_help_heading = "For a folder of episodes")]
struct EpisodeArguments {
    /// Task, the first part of the files' names
    #[arg(long, value_name = "NAME")]
    task: Option<String>,
    /// Policy that was recorded
    #[arg(long, value_name = "ID")]
    policy_id: Option<String>,
    /// How many episodes, from the first
    #[arg(long, value_name = "N", default_value_t = 100, conflicts_with = "episode_ids")]
    episodes: usize,
    /// Which episodes
    #[arg(long, value_name = "LIST", num_args = 1.., value_delimiter = ',')]
    episode_ids: Vec<u64>,
    /// Steps after which an episode was cut off
    #[arg(long, value_name = "STEPS")]
    horizon: Option<usize>,
    /// Control step in seconds [default: the task's]
    #[arg(long, value_name = "SECONDS")]
    dt: Option<f64>,
    /// Names of joints and muscles [default: what the files say, else upstream's order of the hand]
    #[arg(long, value_name = "JSON")]
    axes: Option<PathBuf>,
    /// Whether the actions were clipped before they were sent
    #[arg(long, value_name = "BOOL")]
    actions_clipped: Option<bool>,
    /// Whether the mean actions were clipped
    #[arg(long, value_name = "BOOL")]
    means_clipped: Option<bool>,
}

/// What can be written.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Target {
    /// A recording as a tidy table
    Parquet,
    /// A recording for a viewer
    Mcap,
    /// A recording in upstream's compact layout
    Hdf5,
    /// A recording of walking in upstream's layout for the comparison with human muscle activity
    Gait,
}

impl Target {
    fn recording(self) -> Format {
        match self {
            Self::Parquet => Format::Parquet,
            Self::Mcap => Format::Mcap,
            Self::Hdf5 => Format::Hdf5,
            Self::Gait => Format::Gait,
        }
    }
}

/// What a file is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Kind {
    Recording,
    EpisodeFolder,
}

/// What was made of one file.
struct Converted {
    out: PathBuf,
    /// What it is, for a person.
    what: String,
    /// What did not make it.
    dropped: Vec<String>,
}

/// Runs the command.
pub fn run(context: &Context, arguments: &ConvertArguments) -> anyhow::Result<Outcome> {
    let Some(to) = arguments.to else {
        let ConvertArguments { files, normaliser, mean, out, .. } = arguments;
        return convert_policy::run(context, files, normaliser.as_deref(), *mean, out);
    };
    let outs = outs(arguments, to)?;
    let mut entries = Vec::new();
    for (file, out) in arguments.files.iter().zip(outs) {
        let converted = match kind(file)? {
            Kind::Recording => {
                let opened = record::read_recording(file).map_err(|error| hinted(&error))?;
                convert_recording(opened, out, to, arguments)?
            }
            Kind::EpisodeFolder => {
                convert_recording(open_folder(file, &arguments.episodes)?, out, to, arguments)?
            }
        };
        for name in &converted.dropped {
            context.say(&format!(
                "warning: `{name}` of `{}` has no place in the result",
                file.display()
            ));
        }
        entries.push(json!({
            "file": file.display().to_string(),
            "out": converted.out.display().to_string(),
            "what": converted.what,
            "dropped": converted.dropped,
        }));
    }
    let complete =
        entries.iter().all(|entry| entry["dropped"].as_array().is_none_or(Vec::is_empty));
    let document = json!({"command": "convert", "files": entries});
    if context.json {
        render::print_json(&document)?;
    } else {
        render::print_text(&table(&document["files"]))?;
    }
    Ok(if complete { Outcome::Done } else { Outcome::SomethingSkipped })
}

/// Where each file goes.
fn outs(arguments: &ConvertArguments, to: Target) -> anyhow::Result<Vec<PathBuf>> {
    let ConvertArguments { files, out, .. } = arguments;
    let named_folder = out.to_string_lossy().ends_with(std::path::MAIN_SEPARATOR);
    if files.len() == 1 && !out.is_dir() && !named_folder {
        return Ok(vec![out.clone()]);
    }
    let extension = to.recording().extension();
    let inside = |file: &PathBuf| {
        let stem = file.file_stem().unwrap_or_default().to_string_lossy();
        out.join(format!("{stem}.{extension}"))
    };
    let outs: Vec<PathBuf> = files.iter().map(inside).collect();
    match outs.iter().enumerate().find(|(index, path)| outs[..*index].contains(path)) {
        Some((_, twice)) => Err(Hinted::new(
            format!("two of the files would become `{}`", twice.display()),
            "convert them one at a time, each with its own `--out FILE`",
        )),
        None => Ok(outs),
    }
}

fn kind(file: &Path) -> anyhow::Result<Kind> {
    if file.is_dir() {
        return Ok(Kind::EpisodeFolder);
    }
    if record::may_be_recording(file).map_err(|error| hinted(&error))? {
        return Ok(Kind::Recording);
    }
    Err(hinted(&RecordError::UnknownFormat { path: file.to_path_buf() }))
}

fn convert_recording(
    opened: Opened,
    out: PathBuf,
    to: Target,
    arguments: &ConvertArguments,
) -> anyhow::Result<Converted> {
    let Opened { mut recording, mut left_out } = opened;
    complete(&mut recording);
    if !arguments.signals.is_empty() {
        keep(&mut recording, &arguments.signals)?;
        // What was not asked for is not missed.
        left_out.clear();
    }
    let steps = recording.step_count();
    let what = format!("{} episodes, {steps} steps", recording.episodes.len());
    let files = [(to.recording(), out.clone())];
    let dropped =
        record::write_recording(recording, &files, Place::New).map_err(|error| hinted(&error))?;
    left_out.extend(dropped.into_iter().flat_map(|(_, channels)| channels));
    Ok(Converted { out, what, dropped: left_out })
}

/// Keeps the channels that are asked for.
fn keep(recording: &mut Recording, signals: &[String]) -> anyhow::Result<()> {
    let wanted: Vec<&str> = signals.iter().map(|signal| names::of_upstream(signal)).collect();
    if let Some(missing) = wanted.iter().find(|name| recording.channel(name).is_none()) {
        let there: Vec<&str> = recording.channels.iter().map(|c| c.name.as_str()).collect();
        return Err(Hinted::new(
            format!("the recording has no channel `{missing}`"),
            format!("it has {}", there.join(", ")),
        ));
    }
    let always = [names::REWARD, names::SOLVED];
    recording.retain_channels(|channel| {
        let name = channel.name.as_str();
        wanted.contains(&name) || always.contains(&name)
    });
    Ok(())
}

/// Adds what is known of the task where the file did not say it.
#[cfg_attr(not(feature = "sim"), expect(unused, reason = "no task is known"))]
fn complete(recording: &mut Recording) {
    #[cfg(feature = "sim")]
    if let Ok(task) = crate::sim::tasks::find(&recording.about.task) {
        let about = &mut recording.about;
        about.control_interval = about.control_interval.or_else(|| Some(task.control_interval()));
        about.horizon = about.horizon.or(Some(task.horizon));
        about.body.get_or_insert_with(|| task.body.to_owned());
    }
}

#[cfg(feature = "hdf5")]
fn open_folder(folder: &Path, arguments: &EpisodeArguments) -> anyhow::Result<Opened> {
    use crate::record::hdf5::{self, ExportOptions, axes::Axes};
    let missing = |option: &str, what: &str| {
        Hinted::new(
            format!("`{}` is a folder of episodes, which do not say {what}", folder.display()),
            format!("give it with `{option}`"),
        )
    };
    let task = arguments.task.clone().ok_or_else(|| missing("--task NAME", "their task"))?;
    let horizon = arguments
        .horizon
        .ok_or_else(|| missing("--horizon STEPS", "after how many steps they were cut off"))?;
    let axes = match &arguments.axes {
        Some(path) => Axes::open(path).map_err(|error| hinted(&error))?,
        None => Axes::hand(),
    };
    let stem = || folder.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let options = ExportOptions {
        task,
        policy: arguments.policy_id.clone().unwrap_or_else(stem),
        episodes: match arguments.episode_ids.as_slice() {
            [] => Err(arguments.episodes),
            ids => Ok(ids.to_vec()),
        },
        axes,
        horizon,
        control_interval: arguments.dt,
        actions_clipped: arguments.actions_clipped,
        means_clipped: arguments.means_clipped,
    };
    hdf5::export(folder, &options).map_err(|error| hinted(&error))
}

#[cfg(not(feature = "hdf5"))]
fn open_folder(folder: &Path, _arguments: &EpisodeArguments) -> anyhow::Result<Opened> {
    Err(hinted(&RecordError::NotBuilt { format: "HDF5", path: folder.to_path_buf() }))
}

/// What to do about it.
fn hinted(error: &RecordError) -> anyhow::Error {
    let hint = match error {
        RecordError::Exists { .. } => "choose another `--out PATH`, or move the file away",
        RecordError::UnknownFormat { .. } => {
            "give a recording: Parquet or MCAP of this program, or HDF5 of this program or upstream's"
        }
        RecordError::NoRecording { .. } => {
            "only tables that `rollout` or `convert` wrote hold a recording; `inspect` says what a file is"
        }
        RecordError::CannotHold { .. } => "choose another format with `--to`",
        RecordError::NoEpisodes { .. } => {
            "the files of the first release are called `<task>_episode_<number>.h5`"
        }
        _ => "`arnold-analyze inspect FILE` says what can be read of it",
    };
    Hinted::new(error.to_string(), hint)
}

fn table(files: &Value) -> String {
    let columns = [("from", Align::Left), ("to", Align::Left), ("with", Align::Left)];
    let cell = |entry: &Value, name: &str| entry[name].as_str().unwrap_or_default().to_owned();
    let rows: Vec<Vec<String>> = files
        .as_array()
        .into_iter()
        .flatten()
        .map(|entry| ["file", "out", "what"].map(|name| cell(entry, name)).to_vec())
        .collect();
    render::table(&columns, &rows)
}

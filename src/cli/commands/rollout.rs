//! `rollout`: plays episodes and records every step.

use clap::{Args, ValueEnum};
use serde_json::{Map, Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::{Defaults, Laboratory, PlayArguments};
use crate::cli::render::{self, Align};
use crate::cli::sweep;
#[cfg(feature = "view")]
use crate::cli::viewing::{self, ViewerArguments, WatchArguments};
use crate::experiment::recording::{self, Source};
#[cfg(feature = "view")]
use crate::experiment::run_folder::RunFolder;
use crate::record::Format;

/// Arguments of `rollout`.
#[derive(Debug, Args)]
pub struct RolloutArguments {
    #[command(flatten)]
    play: PlayArguments,
    /// Format of the recordings; several may be given
    #[arg(long, value_name = "FORMAT", value_enum, num_args = 1.., value_delimiter = ',', default_value = "parquet")]
    format: Vec<RecordingFormat>,
    #[cfg(feature = "view")]
    #[command(flatten)]
    watch: WatchArguments,
}

/// A format that holds every channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum)]
pub enum RecordingFormat {
    /// One table per task, one row per step: for polars, pandas, R
    Parquet,
    /// Messages with units and names: for Foxglove and other viewers
    Mcap,
    /// Upstream's layout, a group per episode: for h5py and the authors' scripts
    Hdf5,
}

impl RecordingFormat {
    fn format(self) -> Format {
        match self {
            Self::Parquet => Format::Parquet,
            Self::Mcap => Format::Mcap,
            Self::Hdf5 => Format::Hdf5,
        }
    }
}

/// Enough to look at.
const EPISODES: usize = 10;

/// Runs the command.
pub fn run(context: &Context, arguments: &RolloutArguments) -> anyhow::Result<Outcome> {
    let defaults = Defaults { tasks: "all", episodes: EPISODES, mode: None };
    let laboratory = Laboratory::open(context, &arguments.play, defaults)?;
    // In one order, so that the same formats give the same run; HDF5 is last, as writing wants it.
    let mut formats: Vec<Format> = arguments.format.iter().map(|format| format.format()).collect();
    formats.sort_unstable();
    formats.dedup();
    let mut plan = laboratory.decides();
    plan["formats"] = formats.iter().map(|format| format.word()).collect();
    let (folder, finished) = finish::open(context, &laboratory, "rollout", &plan)?;
    if let Some(manifest) = finished {
        #[cfg(feature = "view")]
        show(context, arguments.watch.anywhere(), &laboratory, &folder, &manifest.result)?;
        return finish::print(context, &folder, &manifest, &table);
    }
    #[cfg(feature = "view")]
    arguments.watch.seat(&laboratory)?;
    let arms = laboratory.recorded_arms();
    let Some((played, seconds)) = sweep::play(context, &folder, &laboratory, &laboratory, arms)?
    else {
        return Ok(Outcome::Done);
    };
    #[cfg(feature = "view")]
    viewing::close(context, &laboratory)?;
    let mut output = Output::new(&folder);
    let mut tasks = Map::new();
    for (place, task) in laboratory.tasks.iter().enumerate() {
        let (names, episodes) = laboratory.recorded(&played, place)?;
        let steps: usize = episodes.iter().map(|episode| episode.steps).sum();
        let diverged: usize = episodes.iter().map(|episode| episode.diverged_steps).sum();
        let solved: usize = episodes.iter().map(|episode| episode.solved_steps).sum();
        let mut entry = json!({
            "episodes": episodes.len(),
            "steps": steps,
            "solved_fraction": solved as f64 / (episodes.len() * task.horizon) as f64,
            "diverged_steps": diverged,
        });
        let metadata = folder.provenance().into_iter().collect();
        let source = Source { metadata, ..laboratory.source(task) };
        let recording = recording::recording(source, &names, episodes);
        entry["files"] = output.recording(task.name, recording, &formats)?.into();
        tasks.insert(task.name.to_owned(), entry);
    }
    let manifest = output.finish(&laboratory, json!({"tasks": tasks}), seconds)?;
    #[cfg(feature = "view")]
    show(context, arguments.watch.file(), &laboratory, &folder, &manifest.result)?;
    finish::print(context, &folder, &manifest, &table)
}

/// Shows the first episodes that were recorded, if anywhere.
#[cfg(feature = "view")]
fn show(
    context: &Context,
    viewer: Option<&ViewerArguments>,
    laboratory: &Laboratory,
    folder: &RunFolder,
    result: &Value,
) -> anyhow::Result<()> {
    let Some(viewer) = viewer else { return Ok(()) };
    let tasks = result["tasks"].as_object().into_iter().flatten();
    let files = tasks.filter_map(|(_, entry)| Some(folder.file(entry["files"][0].as_str()?)));
    super::view::show_files(context, files.collect(), Some(laboratory.physics), viewer)
}

fn table(result: &Value) -> String {
    let columns = [
        ("task", Align::Left),
        ("episodes", Align::Right),
        ("steps", Align::Right),
        ("solved fraction", Align::Right),
    ];
    let rows: Vec<Vec<String>> = result["tasks"]
        .as_object()
        .into_iter()
        .flatten()
        .map(|(task, entry)| {
            let solved = entry["solved_fraction"].as_f64().unwrap_or(f64::NAN);
            vec![
                task.clone(),
                entry["episodes"].to_string(),
                entry["steps"].to_string(),
                format!("{solved:.3}"),
            ]
        })
        .collect();
    render::table(&columns, &rows)
}

//! `rollout`: plays episodes and records every step.

use clap::Args;
use serde_json::{Map, Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::{Defaults, Laboratory, PlayArguments};
use crate::cli::progress::Progress;
use crate::cli::render::{self, Align};
use crate::experiment::{recording, seed};
use crate::sim::rollout::{self, Channels, RolloutPlan};

/// Arguments of `rollout`.
#[derive(Debug, Args)]
pub struct RolloutArguments {
    #[command(flatten)]
    play: PlayArguments,
}

/// Enough to look at.
const EPISODES: usize = 10;

/// Runs the command.
pub fn run(context: &Context, arguments: &RolloutArguments) -> anyhow::Result<Outcome> {
    let defaults = Defaults { episodes: EPISODES, mode: None };
    let laboratory = Laboratory::open(context, &arguments.play, defaults)?;
    let (folder, finished) = finish::open(context, &laboratory, "rollout", &laboratory.decides())?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let total = laboratory.tasks.len() * laboratory.episodes;
    let progress = Progress::start(context, "rollout", "episodes", total as u64);
    let mut output = Output::new(&folder);
    let mut tasks = Map::new();
    for task in &laboratory.tasks {
        let plan = RolloutPlan { channels: Channels::All, ..laboratory.plan(task) };
        let specs: Vec<_> = (0..laboratory.episodes)
            .map(|i| seed::episode(laboratory.seed, task.name, i, None))
            .collect();
        let episodes = rollout::play(&laboratory.machine, &plan, &specs, &|_| progress.advance(1))?;
        let names = rollout::channel_names(&laboratory.machine, task)?;
        let file = format!("{}.parquet", task.name);
        output.table(&file, &recording::step_table(task, &names, &episodes)?)?;
        let steps: usize = episodes.iter().map(|episode| episode.steps).sum();
        let solved: usize = episodes.iter().map(|episode| episode.solved_steps).sum();
        let entry = json!({
            "episodes": episodes.len(),
            "steps": steps,
            "solved_fraction": solved as f64 / (episodes.len() * task.horizon) as f64,
            "file": file,
        });
        tasks.insert(task.name.to_owned(), entry);
    }
    let seconds = progress.finish();
    let manifest = output.finish(&laboratory, json!({"tasks": tasks}), seconds)?;
    finish::print(context, &folder, &manifest, &table)
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

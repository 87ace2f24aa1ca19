//! `evaluate`: how much of its time does a policy solve its tasks?

use clap::Args;
use serde_json::{Map, Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::{Defaults, Laboratory, PlayArguments};
use crate::cli::render::{self, Align};
use crate::cli::sweep;
use crate::experiment::evaluation::{self, TaskEvaluation};
use crate::sim::rollout::Channels;

use super::evaluate_benchmarks::{self, BenchmarkArguments};

/// Arguments of `evaluate`.
#[derive(Debug, Args)]
pub struct EvaluateArguments {
    #[command(flatten)]
    benchmarks: BenchmarkArguments,
    #[command(flatten)]
    play: PlayArguments,
}

/// Episodes per task of the paper's evaluation.
const EPISODES: usize = 200;

/// Runs the command.
pub fn run(context: &Context, arguments: &EvaluateArguments) -> anyhow::Result<Outcome> {
    if arguments.benchmarks.are_given() {
        return evaluate_benchmarks::run(context, &arguments.benchmarks, &arguments.play);
    }
    let defaults = Defaults { tasks: "all", episodes: EPISODES, mode: None };
    let laboratory = Laboratory::open(context, &arguments.play, defaults)?;
    let (folder, finished) = finish::open(context, &laboratory, "evaluate", &laboratory.decides())?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let arms = laboratory.tasks.iter().map(|task| laboratory.arm(task, Channels::Counts)).collect();
    let Some((played, seconds)) = sweep::play(context, &folder, &laboratory, &laboratory, arms)?
    else {
        return Ok(Outcome::Done);
    };
    let mut evaluations = Vec::new();
    for (arm, task) in laboratory.tasks.iter().enumerate() {
        evaluations.push(TaskEvaluation { task, episodes: played.episodes(arm)? });
    }
    let mut records = Map::new();
    for evaluation in &evaluations {
        let record = serde_json::to_value(evaluation.benchmark_record()?)?;
        records.insert(evaluation.task.name.to_owned(), record);
    }
    let mut output = Output::new(&folder);
    output.table("episodes.parquet", &evaluation::episode_table(&evaluations)?)?;
    output.json("results.json", &Value::Object(records))?;
    let provenance = finish::provenance(&laboratory);
    let figure = evaluation::figure(&evaluations, &laboratory.policy.name, provenance);
    output.figure("solved_fraction", &figure.to_svg()?)?;
    let result = json!({"tasks": evaluation::document(&evaluations)});
    let manifest = output.finish(&laboratory, result, seconds)?;
    finish::print(context, &folder, &manifest, &table)
}

fn table(result: &Value) -> String {
    let columns = [
        ("task", Align::Left),
        ("solved fraction", Align::Right),
        ("± s.e.m.", Align::Right),
        ("95 % interval", Align::Right),
        ("steps", Align::Right),
        ("reward", Align::Right),
        ("n", Align::Right),
    ];
    let number = |value: &Value, digits: usize| {
        value.as_f64().map_or_else(|| "–".to_owned(), |x| format!("{x:.digits$}"))
    };
    let rows: Vec<Vec<String>> = result["tasks"]
        .as_object()
        .into_iter()
        .flatten()
        .map(|(task, entry)| {
            let solved = &entry["solved_fraction"];
            let interval = &solved["interval_95"];
            vec![
                task.clone(),
                number(&solved["mean"], 3),
                number(&solved["sem"], 3),
                format!("{}–{}", number(&interval[0], 3), number(&interval[1], 3)),
                number(&entry["episode_length"]["mean"], 1),
                number(&entry["reward"]["mean"], 1),
                number(&solved["n"], 0),
            ]
        })
        .collect();
    render::table(&columns, &rows)
}

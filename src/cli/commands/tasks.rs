//! `tasks`: the tasks this program plays, and what one of them observes and rewards.

use clap::Args;
use serde_json::{Value, json};

use crate::assets::{Cache, Part, PhysicsVersion};
use crate::cli::context::{Context, Outcome};
use crate::cli::laboratory;
use crate::cli::render::{self, Align, Hinted};
use crate::sim::bodies::Bodies;
use crate::sim::tasks::{self, Definition, RewardConfiguration};

/// Arguments of `tasks`.
#[derive(Debug, Args)]
pub struct TasksArguments {
    /// Show this task: observation with indices, words and units, muscles, rewards
    task: Option<String>,
}

/// Runs the command.
pub fn run(context: &Context, arguments: &TasksArguments) -> anyhow::Result<Outcome> {
    match &arguments.task {
        None => list(context),
        Some(name) => {
            let task = tasks::find(name).map_err(|error| {
                Hinted::new(error.to_string(), "`arnold-analyze tasks` lists them all")
            })?;
            show(context, task)
        }
    }
}

fn facts(task: &Definition) -> Value {
    json!({
        "name": task.name,
        "paper_name": task.paper_name,
        "summary": task.summary,
        "body": task.body,
        "horizon": task.horizon,
        "control_interval_s": task.control_interval(),
        "solved_when": task.solved_when,
        "environment": task.environment,
        "model": task.model,
    })
}

fn list(context: &Context) -> anyhow::Result<Outcome> {
    if context.json {
        render::print_json(&json!({"tasks": tasks::ALL.iter().map(facts).collect::<Value>()}))?;
        return Ok(Outcome::Done);
    }
    let columns = [
        ("task", Align::Left),
        ("in the paper", Align::Left),
        ("body", Align::Left),
        ("steps", Align::Right),
        ("every", Align::Right),
        ("solved when", Align::Left),
    ];
    let rows: Vec<Vec<String>> = tasks::ALL
        .iter()
        .map(|task| {
            vec![
                task.name.to_owned(),
                task.paper_name.to_owned(),
                task.body.to_owned(),
                task.horizon.to_string(),
                format!("{:.0} ms", 1000.0 * task.control_interval()),
                task.solved_when.to_owned(),
            ]
        })
        .collect();
    render::print_text(&render::table(&columns, &rows))?;
    Ok(Outcome::Done)
}

fn show(context: &Context, task: &'static Definition) -> anyhow::Result<Outcome> {
    let cache = Cache::locate();
    let models = laboratory::available(context, &cache, Part::MyoSuite, Cache::myosuite)?;
    let library = laboratory::open_library(context, &cache, PhysicsVersion::default())?;
    let environment = laboratory::environment(task, &Bodies::new(library, &models, &context.data))?;
    let definition = environment.task();
    let clean = definition.clean_keys();
    let mut start = 0;
    let blocks: Vec<(usize, &crate::sim::layout::Block)> = definition
        .layout()
        .blocks()
        .iter()
        .map(|block| {
            let at = start;
            start += block.phrases.len();
            (at, block)
        })
        .collect();
    let muscles = environment.muscles();
    let weights = |configuration| definition.weights(configuration);
    let (sparse, dense) =
        (weights(RewardConfiguration::Sparse), weights(RewardConfiguration::Dense));
    if context.json {
        let mut document = facts(task);
        let weights = |list: &[(&str, f64)]| -> serde_json::Map<String, Value> {
            list.iter().map(|(name, weight)| ((*name).to_owned(), json!(weight))).collect()
        };
        document["observation"] = blocks
            .iter()
            .flat_map(|(start, block)| {
                block.phrases.iter().enumerate().map(move |(place, phrase)| {
                    json!({"index": start + place, "key": block.key, "unit": block.unit, "words": phrase})
                })
            })
            .collect();
        document["clean_observation"] = json!(clean);
        document["muscles"] = json!(muscles);
        document["reward_components"] = json!(definition.components());
        document["reward_weights"] = json!({"sparse": weights(sparse), "dense": weights(dense)});
        render::print_json(&document)?;
        return Ok(Outcome::Done);
    }
    let columns = [
        ("index", Align::Right),
        ("key", Align::Left),
        ("unit", Align::Left),
        ("expert", Align::Left),
        ("words of the first element", Align::Left),
    ];
    let rows: Vec<Vec<String>> = blocks
        .iter()
        .map(|(start, block)| {
            vec![
                format!("{start}–{}", start + block.phrases.len() - 1),
                block.key.to_owned(),
                block.unit.to_owned(),
                if clean.contains(&block.key) { "yes" } else { "" }.to_owned(),
                block.phrases[0].join(" "),
            ]
        })
        .collect();
    let weights = |list: &[(&str, f64)]| {
        let terms: Vec<String> = list.iter().map(|(name, w)| format!("{w} × {name}")).collect();
        terms.join(" + ")
    };
    let text = format!(
        "{} ({}): {}\n{} steps of {:.0} ms; solved when {}\n\nObservation, {} elements; an expert sees those marked:\n\n{}\n\
         Muscles, {}: {}\n\nReward, benchmark: {}\nReward, training:  {}\n",
        task.name,
        task.paper_name,
        task.summary,
        task.horizon,
        1000.0 * task.control_interval(),
        task.solved_when,
        start,
        render::table(&columns, &rows),
        muscles.len(),
        muscles.join(" "),
        weights(sparse),
        weights(dense),
    );
    render::print_text(&text)?;
    Ok(Outcome::Done)
}

//! `tasks`: the tasks this program plays, and what one of them observes, rewards, draws and counts as solved.

mod page;

use clap::Args;
use serde_json::{Value, json};

use crate::assets::{Cache, Part, PhysicsVersion};
use crate::cli::context::{Context, Outcome};
use crate::cli::laboratory;
use crate::cli::render::{self, Align, Hinted};
use crate::sim::bodies::Bodies;
use crate::sim::environment::Environment;
use crate::sim::tasks::{self, Chosen, Definition, RewardConfiguration, Start, Threshold};

/// Arguments of `tasks`.
#[derive(Debug, Args)]
pub struct TasksArguments {
    /// Show this task: thresholds, start, rewards, observation with indices, words and units, muscles
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
    let all = |list: &[Definition]| list.iter().map(facts).collect::<Value>();
    if context.json {
        render::print_json(&json!({"tasks": all(tasks::ALL), "extra": all(tasks::EXTRA)}))?;
        return Ok(Outcome::Done);
    }
    let text = format!(
        "{}\nBeside the paper's:\n\n{}\nTwo to four fingers reach as `hand_reach:thumb+index` and so on.\n",
        table(tasks::ALL, "in the paper"),
        table(tasks::EXTRA, "called"),
    );
    render::print_text(&text)?;
    Ok(Outcome::Done)
}

fn table(list: &[Definition], title: &str) -> String {
    let columns = [
        ("task", Align::Left),
        (title, Align::Left),
        ("body", Align::Left),
        ("steps", Align::Right),
        ("solved when", Align::Left),
    ];
    let rows = list.iter().map(|task| {
        vec![
            task.name.to_owned(),
            task.paper_name.to_owned(),
            task.body.to_owned(),
            task.horizon.to_string(),
            task.solved_when.to_owned(),
        ]
    });
    page::wrapped_table(&columns, rows)
}

fn show(context: &Context, task: &'static Definition) -> anyhow::Result<Outcome> {
    let cache = Cache::locate();
    let models = laboratory::available(context, &cache, Part::MyoSuite, Cache::myosuite)?;
    let library = laboratory::open_library(context, &cache, PhysicsVersion::default())?;
    let environment = laboratory::environment(task, &Bodies::new(library, &models, &context.data))?;
    if context.json {
        render::print_json(&document(task, &environment))?;
    } else {
        render::print_text(&page::text(task, &environment))?;
    }
    Ok(Outcome::Done)
}

/// Everything about a task, every element of its observation included.
fn document(task: &Definition, environment: &Environment) -> Value {
    let played = environment.task();
    let layout = played.layout();
    let muscles = environment.muscles();
    let weights = |configuration| -> serde_json::Map<String, Value> {
        let weights = played.weights(configuration).iter();
        weights.map(|(name, weight)| ((*name).to_owned(), json!(weight))).collect()
    };
    let mut observation = Vec::new();
    for block in layout.blocks() {
        for phrase in &block.phrases {
            let index = observation.len();
            observation.push(
                json!({"index": index, "key": block.key, "unit": block.unit, "words": phrase}),
            );
        }
    }
    let mut start = 0;
    let mut clean = Vec::new();
    for (key, unit, length) in page::clean_blocks(played) {
        clean.push(json!({"index": start, "key": key, "unit": unit, "length": length}));
        start += length;
    }
    let phrases = played.action_phrases(&muscles);
    let actuators: Vec<Value> = muscles
        .iter()
        .zip(&phrases)
        .enumerate()
        .map(|(index, (name, words))| json!({"index": index, "name": name, "words": words}))
        .collect();
    let mut document = facts(task);
    document["thresholds"] = played.thresholds().iter().map(threshold).collect();
    document["start"] = played.starts().iter().map(drawn).collect();
    document["reward_components"] = json!(played.components());
    document["reward_weights"] = json!({
        "sparse": weights(RewardConfiguration::Sparse),
        "dense": weights(RewardConfiguration::Dense),
    });
    document["observation"] = json!(observation);
    document["clean_observation"] = json!(clean);
    document["muscles"] = json!(muscles);
    document["actuators"] = json!(actuators);
    document
}

fn threshold(threshold: &Threshold) -> Value {
    json!({
        "event": threshold.event.word(),
        "quantity": threshold.quantity,
        "when": if threshold.above { "above" } else { "below" },
        "value": threshold.value,
        "unit": threshold.unit,
    })
}

fn drawn(start: &Start) -> Value {
    let (how, what) = match &start.chosen {
        Chosen::Uniform { low, high } => ("uniform", json!({"low": low, "high": high})),
        Chosen::Fixed(values) => ("fixed", json!(values)),
        Chosen::OneOf(choices) => ("one_of", json!(choices)),
        Chosen::Rule(rule) => ("rule", json!(rule)),
    };
    json!({"quantity": start.quantity, "unit": start.unit, how: what})
}

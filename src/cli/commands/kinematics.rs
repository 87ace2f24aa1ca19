//! `kinematics`: in how many directions do the joints move, and in how many do those of a human hand?

use clap::Args;
use serde_json::{Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::Defaults;
use crate::cli::movement::{Movement, MovementArguments};
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::ExperimentError;
use crate::experiment::kinematics;

/// Arguments of `kinematics`.
#[derive(Debug, Args)]
pub struct KinematicsArguments {
    #[command(flatten)]
    movement: MovementArguments,
}

/// Episodes per policy and task of the paper.
const EPISODES: usize = 100;

/// Runs the command.
pub fn run(context: &Context, arguments: &KinematicsArguments) -> anyhow::Result<Outcome> {
    let defaults = Defaults { tasks: "baoding_p1_ccw", episodes: EPISODES, mode: None };
    let movement = Movement::open(context, &arguments.movement, defaults, "baoding_pca")?;
    let plan = json!({"movement": movement.decides()});
    let (folder, finished) = movement.run_folder(context, "kinematics", &plan)?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let mut measured = Vec::new();
    let seconds = movement.each(context, &folder, |movements| {
        measured.push(kinematics::measure(movements, movement.episodes).map_err(hinted)?);
        Ok(())
    })?;
    let Some(seconds) = seconds else { return Ok(Outcome::Done) };
    let mut output = Output::new(&folder);
    output.tidy("dimensionality", &kinematics::dimensionality_table(&measured)?)?;
    output.tidy("cumulative_variance", &kinematics::cumulative_table(&measured)?)?;
    output.tidy("human_comparison", &kinematics::human_table(&measured)?)?;
    for task in kinematics::tasks_of(&measured) {
        let figure = kinematics::figure(&measured, &task, &movement.provenance());
        output.figure(&task, &figure.to_svg()?)?;
    }
    let manifest = movement.finish(output, kinematics::document(&measured), seconds)?;
    finish::print(context, &folder, &manifest, &table)
}

/// What to do about it.
fn hinted(error: ExperimentError) -> anyhow::Error {
    match error {
        ExperimentError::EpisodeCount { .. } => Hinted::new(
            error.to_string(),
            "`--episodes N` says how many episodes each recording must have",
        ),
        other => other.into(),
    }
}

fn table(result: &Value) -> String {
    let columns = [
        ("policy", Align::Left),
        ("task", Align::Left),
        ("quantity", Align::Left),
        ("85 %", Align::Right),
        ("95 %", Align::Right),
        ("mean", Align::Right),
        ("joints", Align::Right),
        ("n", Align::Right),
    ];
    let word = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let count = |value: &Value| value.as_u64().map_or_else(|| "–".to_owned(), |n| n.to_string());
    let line = |row: &Value, policy: String| {
        vec![
            policy,
            word(&row["task"]),
            word(&row["quantity"]),
            count(&row["dim_85"]),
            count(&row["dim_95"]),
            row["avg_dim"].as_f64().map_or_else(|| "–".to_owned(), |x| format!("{x:.1}")),
            count(&row["n_joints"]),
            count(&row["n_episodes"]),
        ]
    };
    let policies = result["dimensionality"].as_array().into_iter().flatten();
    let humans = result["human"].as_array().into_iter().flatten();
    let lines: Vec<Vec<String>> = policies
        .map(|row| line(row, word(&row["policy"])))
        .chain(humans.map(|row| line(row, "Human".to_owned())))
        .collect();
    let source = match result["input"]["recordings"].as_array() {
        Some(files) if files.len() == 1 => "1 recording".to_owned(),
        Some(files) => format!("{} recordings", files.len()),
        None => "played for this".to_owned(),
    };
    render::table(&columns, &lines)
        + "\n85 %, 95 %: fewest principal components that hold that share of the variance\n"
        + &format!("Input: {source}\n")
}

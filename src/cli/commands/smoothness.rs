//! `smoothness`: how smooth are the movements of policies, and is one smoother than another?

use clap::Args;
use serde_json::{Value, json};

use crate::analysis::smoothness::{DimensionlessJerkOptions, Metric, SmoothnessOptions};
use crate::analysis::undefined::Undefined;
use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::Defaults;
use crate::cli::movement::{Movement, MovementArguments};
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::ExperimentError;
use crate::experiment::smoothness::{self, SmoothnessPlan, SmoothnessResult};
use crate::units::{Hertz, Radians};

/// Arguments of `smoothness`.
#[derive(Debug, Args)]
pub struct SmoothnessArguments {
    /// Rate of the spectral arc length, in Hz, or `task`: each task's own; at 1, as published, time counts in steps
    #[arg(long, value_name = "HZ|task", default_value = "1", value_parser = rate)]
    sparc_fs: Rate,
    /// Least excursion of a joint with a dimensionless jerk, in rad
    #[arg(long, value_name = "RAD", default_value_t = DimensionlessJerkOptions::default().least_excursion, value_parser = positive)]
    ldlj_min_excursion: Radians,
    /// Least sum of squared third differences of a joint with a dimensionless jerk, in rad²
    #[arg(long, value_name = "SUM", default_value_t = DimensionlessJerkOptions::default().least_jerk, value_parser = positive)]
    ldlj_min_jerk: f64,
    /// Leave episodes out of a mean for which it is undefined; without it they are an error
    #[arg(long)]
    skip_undefined: bool,
    #[command(flatten)]
    movement: MovementArguments,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Rate {
    Fixed(Hertz),
    Task,
}

fn rate(text: &str) -> Result<Rate, String> {
    if text == "task" {
        return Ok(Rate::Task);
    }
    positive(text).map(Rate::Fixed).map_err(|error| format!("{error}, or `task`"))
}

fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if value > 0.0 && value.is_finite() => Ok(value),
        _ => Err("expected a positive number".to_owned()),
    }
}

/// Episodes per policy and task of the paper.
const EPISODES: usize = 100;

/// Runs the command.
pub fn run(context: &Context, arguments: &SmoothnessArguments) -> anyhow::Result<Outcome> {
    let defaults = Defaults { tasks: "hand", episodes: EPISODES, mode: None };
    let movement = Movement::open(context, &arguments.movement, defaults, "smoothness")?;
    let mut options = SmoothnessOptions::default();
    options.dimensionless_jerk.least_excursion = arguments.ldlj_min_excursion;
    options.dimensionless_jerk.least_jerk = arguments.ldlj_min_jerk;
    if let Rate::Fixed(rate) = arguments.sparc_fs {
        options.spectral_arc_length.sample_rate = rate;
    }
    let plan = SmoothnessPlan {
        options,
        task_rate: arguments.sparc_fs == Rate::Task,
        episodes: movement.episodes,
        undefined: if arguments.skip_undefined { Undefined::Skip } else { Undefined::Propagate },
    };
    let decides = json!({
        "movement": movement.decides(),
        "sparc_fs": match arguments.sparc_fs {
            Rate::Fixed(rate) => json!(rate),
            Rate::Task => json!("task"),
        },
        "ldlj_min_excursion": arguments.ldlj_min_excursion,
        "ldlj_min_jerk": arguments.ldlj_min_jerk,
        "skip_undefined": arguments.skip_undefined,
    });
    let (folder, finished) = movement.run_folder(context, "smoothness", &decides)?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let mut measured = Vec::new();
    let seconds = movement.each(context, &folder, |movements| {
        measured.push(smoothness::measure(movements, &plan).map_err(hinted)?);
        Ok(())
    })?;
    let Some(seconds) = seconds else { return Ok(Outcome::Done) };
    let result = SmoothnessResult::of(measured).map_err(hinted)?;
    let mut output = Output::new(&folder);
    output.tidy("per_episode", &result.episode_table()?)?;
    output.tidy("per_task", &result.task_table()?)?;
    if !result.comparisons.is_empty() {
        output.tidy("comparisons", &result.comparison_table()?)?;
    }
    output.figure("smoothness", &result.figure(movement.provenance()).to_svg()?)?;
    let manifest = movement.finish(output, result.document(), seconds)?;
    finish::print(context, &folder, &manifest, &table)
}

/// What to do about it.
fn hinted(error: ExperimentError) -> anyhow::Error {
    use crate::analysis::smoothness::SmoothnessError::{EpisodeCount, MissingTask, Undefined};
    let ExperimentError::Smoothness(reason) = &error else { return error.into() };
    let hint = match reason {
        EpisodeCount { .. } => "`--episodes N` says how many episodes each recording must have",
        Undefined { .. } => "`--skip-undefined` averages the others and writes how many",
        MissingTask { .. } => "`--task NAME…` compares only the tasks that every policy has",
        _ => return error.into(),
    };
    Hinted::new(error.to_string(), hint)
}

fn table(result: &Value) -> String {
    let number = |value: &Value, digits: usize| {
        value.as_f64().map_or_else(|| "–".to_owned(), |x| format!("{x:.digits$}"))
    };
    let rows = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let columns = [
        ("task", Align::Left),
        ("mean |Δa| ↓", Align::Right),
        ("SPARC ↑", Align::Right),
        ("LDLJ ↑", Align::Right),
        ("peaks ↓", Align::Right),
        ("n", Align::Right),
    ];
    let mut text = String::new();
    for policy in rows(&result["policies"]) {
        let tasks = rows(&policy["per_task"]);
        let line = |row: &Value, name: String, last: String, cell: &dyn Fn(&Value) -> Value| {
            let digits = [4, 3, 2, 2];
            let cells = Metric::ALL.into_iter().zip(digits);
            let cells = cells.map(|(metric, digits)| number(&cell(&row[metric.name()]), digits));
            [name].into_iter().chain(cells).chain([last]).collect::<Vec<String>>()
        };
        let mut lines: Vec<Vec<String>> = tasks
            .iter()
            .map(|row| {
                let name = row["task"].as_str().unwrap_or_default().to_owned();
                line(row, name, row["episodes"].to_string(), &Value::clone)
            })
            .collect();
        if tasks.len() > 1 {
            let count = tasks.len().to_string();
            lines.push(line(&policy, "mean over tasks".to_owned(), count, &|x| x["mean"].clone()));
            lines.push(line(&policy, "± s.e.m.".to_owned(), String::new(), &|x| x["sem"].clone()));
        }
        let actions = tasks.first().and_then(|row| row["actions"].as_str());
        let actions = actions.map_or_else(String::new, |word| format!(" ({word} actions)"));
        let name = policy["policy"].as_str().unwrap_or_default();
        text.extend([&format!("{name}{actions}\n\n"), &render::table(&columns, &lines), "\n"]);
    }
    text + &comparison_table(&rows(&result["comparisons"])) + &input_line(result)
}

fn comparison_table(comparisons: &[Value]) -> String {
    if comparisons.is_empty() {
        return String::new();
    }
    let columns = [
        ("metric", Align::Left),
        ("a", Align::Left),
        ("b", Align::Left),
        ("tasks", Align::Right),
        ("W", Align::Right),
        ("p", Align::Right),
        ("p Holm", Align::Right),
    ];
    let probability = |value: &Value| match value.as_f64() {
        None => "–".to_owned(),
        Some(p) => format!("{p:.4}"),
    };
    let word = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let line = |row: &Value| {
        vec![
            word(&row["metric"]),
            word(&row["a"]),
            word(&row["b"]),
            row["n_tasks"].to_string(),
            row["W"].as_f64().map_or_else(|| "–".to_owned(), |w| w.to_string()),
            probability(&row["p_raw"]),
            probability(&row["p_holm"]),
        ]
    };
    let lines: Vec<Vec<String>> = comparisons.iter().map(line).collect();
    render::table(&columns, &lines)
        + "\nWilcoxon signed rank over task means, two-sided; Holm within each metric\n\n"
}

/// Where the numbers come from, and at which rate the spectrum was taken.
fn input_line(result: &Value) -> String {
    let mut rates: Vec<String> = Vec::new();
    for policy in result["policies"].as_array().into_iter().flatten() {
        for row in policy["per_task"].as_array().into_iter().flatten() {
            let rate = row["sparc_sample_rate"].as_f64().unwrap_or(f64::NAN);
            let rate = if (rate - 1.0).abs() < 1e-9 {
                "1 per step".to_owned()
            } else {
                format!("{rate:.0} Hz")
            };
            if !rates.contains(&rate) {
                rates.push(rate);
            }
        }
    }
    let rates = rates.join(", ");
    match result["input"]["recordings"].as_array() {
        Some(files) if files.len() == 1 => format!("Input: 1 recording; SPARC at {rates}\n"),
        Some(files) => format!("Input: {} recordings; SPARC at {rates}\n", files.len()),
        None => format!("Input: played for this; SPARC at {rates}\n"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_rate_is_a_positive_number_or_the_tasks() {
        assert_eq!((rate("task"), rate("50")), (Ok(Rate::Task), Ok(Rate::Fixed(50.0))));
        for wrong in ["0", "-1", "inf", "tasks", ""] {
            assert!(rate(wrong).is_err(), "{wrong}");
        }
    }
}

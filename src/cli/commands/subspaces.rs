//! `subspaces`: how far apart are the action subspaces of tasks, and of policies?

use std::num::NonZeroUsize;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use crate::analysis::subspace::{AngleSummary, Comparison, VarianceDifference};
use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::Defaults;
use crate::cli::movement::{Movement, MovementArguments};
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::ExperimentError;
use crate::experiment::muscle_signal::EpisodeChoice;
use crate::experiment::subspaces::{self, SubspaceOptions};
use crate::record::names;

/// Arguments of `subspaces`.
#[derive(Debug, Args)]
pub struct SubspacesArguments {
    /// Percent of variance differing
    #[arg(long, value_enum, default_value_t = Pvd::Directed)]
    pvd: Pvd,
    /// Which principal angle is the principal angle difference
    #[arg(long, value_enum, default_value_t = Pad::Mean)]
    pad: Pad,
    /// Leave directions without variance out of the means
    #[arg(long)]
    drop_beyond_rank: bool,
    /// Take the first N episodes with a solved step instead of all
    #[arg(long, value_name = "N")]
    successful: Option<NonZeroUsize>,
    #[command(flatten)]
    movement: MovementArguments,
}

/// What "variance differing" means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Pvd {
    /// From the first to the second, relative to what the first's own components explain
    Directed,
    /// The mean of both directions
    Symmetric,
    /// Own share of the total variance minus the share in the other's components
    Difference,
}

/// Which angle.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Pad {
    Mean,
    Max,
    Min,
}

impl SubspacesArguments {
    fn options(&self) -> SubspaceOptions {
        SubspaceOptions {
            difference: match self.pvd {
                Pvd::Directed => VarianceDifference::Directed,
                Pvd::Symmetric => VarianceDifference::Symmetric,
                Pvd::Difference => VarianceDifference::ShareDifference,
            },
            angle: match self.pad {
                Pad::Mean => AngleSummary::Mean,
                Pad::Max => AngleSummary::Largest,
                Pad::Min => AngleSummary::Smallest,
            },
            drop_beyond_rank: self.drop_beyond_rank,
        }
    }
}

/// Episodes per policy and task of the paper.
const EPISODES: usize = 100;
/// Numbers of components in the printed table: for a hand, and for a body with few muscles.
const SHOWN: [[usize; 4]; 2] = [[1, 5, 10, 20], [1, 2, 3, 5]];

/// Runs the command.
pub fn run(context: &Context, arguments: &SubspacesArguments) -> anyhow::Result<Outcome> {
    let defaults = Defaults { tasks: "hand", episodes: EPISODES, mode: None };
    let movement = Movement::open(context, &arguments.movement, defaults, "subspaces")?;
    let options = arguments.options();
    let successful = arguments.successful.map(NonZeroUsize::get);
    let choice =
        successful.map_or(EpisodeChoice::Exactly(movement.episodes), EpisodeChoice::Successful);
    let decides = json!({
        "movement": movement.decides(),
        "pvd": word(&arguments.pvd),
        "pad": word(&arguments.pad),
        "drop_beyond_rank": arguments.drop_beyond_rank,
        "successful": successful,
    });
    let (folder, finished) = movement.run_folder(context, "subspaces", &decides)?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let needed: &[&str] =
        if successful.is_some() { &[names::ACTION, names::SOLVED] } else { &[names::ACTION] };
    let mut tasks = Vec::new();
    let seconds = movement.each_read(
        context,
        &folder,
        needed,
        |policy, recording| subspaces::read(policy, recording, choice),
        |task| {
            tasks.push(task);
            Ok(())
        },
    )?;
    let Some(seconds) = seconds else { return Ok(Outcome::Done) };
    let found = subspaces::compare(tasks, options).map_err(hinted)?;
    let mut output = Output::new(&folder);
    output.tidy("pairs", &found.pair_table()?)?;
    output.tidy("summary", &found.summary_table()?)?;
    for comparison in found.comparisons() {
        let figure = found.figure(comparison, &movement.provenance());
        output.figure(&comparison.to_string(), &figure.to_svg()?)?;
    }
    let mut document = found.document();
    document["pvd"] = json!(word(&arguments.pvd));
    document["pad"] = json!(word(&arguments.pad));
    let manifest = movement.finish(output, document, seconds)?;
    finish::print(context, &folder, &manifest, &table)
}

/// The word that was typed.
fn word(value: &impl ValueEnum) -> String {
    value.to_possible_value().map_or_else(String::new, |value| value.get_name().to_owned())
}

/// What to do about it.
fn hinted(error: ExperimentError) -> anyhow::Error {
    let hint = match &error {
        ExperimentError::NothingToCompare { .. } => {
            "give recordings of several tasks, or of several policies: `--recording a=DIR b=DIR`"
        }
        ExperimentError::MissingTask { .. } => {
            "`--task NAME…` compares only the tasks that every policy has"
        }
        ExperimentError::Muscles { .. } | ExperimentError::MuscleNames { .. } => {
            "only actions of the same muscles can be compared: `--task hand`, or other recordings"
        }
        _ => return error.into(),
    };
    Hinted::new(error.to_string(), hint)
}

fn table(result: &Value) -> String {
    let groups: Vec<&Value> = result["groups"].as_array().into_iter().flatten().collect();
    let length = |group: &&Value| group["pvd"]["mean"].as_array().map_or(0, Vec::len);
    let muscles = groups.iter().map(length).max().unwrap_or(0);
    let shown = if muscles > SHOWN[0][3] { SHOWN[0] } else { SHOWN[1] };
    let shown: Vec<usize> = shown.into_iter().filter(|&n| n < muscles.max(2)).collect();
    let mut text = String::new();
    let both = [
        (Comparison::AcrossTasks, "Between tasks of one policy"),
        (Comparison::AcrossPolicies, "Between policies in one task"),
    ];
    for (comparison, title) in both {
        let word = comparison.to_string();
        let rows: Vec<Vec<String>> = groups
            .iter()
            .filter(|group| group["comparison"] == word)
            .map(|group| row(group, &shown))
            .collect();
        if rows.is_empty() {
            continue;
        }
        let heading = |measure: &str| {
            let of = |(place, n): (usize, &usize)| match place {
                0 => format!("{measure} {n}"),
                _ => n.to_string(),
            };
            shown.iter().enumerate().map(of).collect::<Vec<_>>()
        };
        let headings = [heading("PVD"), heading("PAD")].concat();
        let mut columns = vec![("group", Align::Left), ("pairs", Align::Right)];
        columns.extend(headings.iter().map(|heading| (heading.as_str(), Align::Right)));
        text.extend([title, "\n\n", &render::table(&columns, &rows), "\n"]);
    }
    let (pvd, pad) = (result["pvd"].as_str(), result["pad"].as_str());
    let (pvd, pad) = (pvd.unwrap_or_default(), pad.unwrap_or_default());
    text.extend(["PVD: share of the variance that differs, ", pvd, "\nPAD: ", pad]);
    text += " principal angle, degrees\nMeans over pairs, for so many components\n";
    text + &input_line(result) + &render::warnings(result)
}

/// One group: its name, its pairs, and the means of both measures.
fn row(group: &Value, shown: &[usize]) -> Vec<String> {
    let mut cells =
        vec![group["group"].as_str().unwrap_or_default().to_owned(), group["pairs"].to_string()];
    for (measure, digits) in [("pvd", 3), ("pad", 1)] {
        cells.extend(shown.iter().map(|n| {
            let mean = group[measure]["mean"][n - 1].as_f64();
            mean.map_or_else(|| "–".to_owned(), |mean| format!("{mean:.digits$}"))
        }));
    }
    cells
}

/// Where the numbers come from.
fn input_line(result: &Value) -> String {
    match result["input"]["recordings"].as_array() {
        Some(files) if files.len() == 1 => "Input: 1 recording\n".to_owned(),
        Some(files) => format!("Input: {} recordings\n", files.len()),
        None => "Input: played for this\n".to_owned(),
    }
}

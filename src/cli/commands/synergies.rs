//! `synergies`: of how many components and synergies does muscle activity consist, in each task and in all together?

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::csi::{ComponentList, component_list};
use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::Defaults;
use crate::cli::movement::{Movement, MovementArguments};
use crate::cli::progress::Progress;
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::ExperimentError;
use crate::experiment::muscle_signal::EpisodeChoice;
use crate::experiment::synergies::{self, Domain, NmfPlan, SynergyPlan};
use crate::files;
use crate::record::{SubspacePoint, read_subspace_curves};

/// Arguments of `synergies`.
#[derive(Debug, Args)]
pub struct SynergiesArguments {
    /// What to compute: principal components of the action means, synergies of the muscle controls
    #[arg(long, value_enum, num_args = 1.., value_delimiter = ',', default_values_t = [Method::Pca, Method::Nmf])]
    method: Vec<Method>,
    /// Numbers of synergies to fit, e.g. `1-5,10` [default: 1 to one less than there are muscles]
    #[arg(long, value_name = "LIST", value_parser = component_list)]
    synergies: Option<ComponentList>,
    /// Fits per number of synergies, each from a seed of its own [default: 10, or 1 with `--nmf-init nndsvda`]
    #[arg(long, value_name = "N")]
    n_fits: Option<NonZeroUsize>,
    /// What is factorised
    #[arg(long, value_enum, default_value_t = NmfDomain::Excitation)]
    nmf_domain: NmfDomain,
    /// What the zeros of the starting point are filled with
    #[arg(long, value_enum, default_value_t = Start::Nndsvdar)]
    nmf_init: Start,
    /// How a task's controls are rebuilt from synergies
    #[arg(long, value_enum, default_value_t = Weights::Descent)]
    nmf_weights: Weights,
    /// Stop a fit when it violates the conditions of the optimum by this share of the first violation
    #[arg(long, value_name = "SHARE", default_value_t = 1e-4, value_parser = share)]
    nmf_tolerance: f64,
    /// Stop a fit after so many iterations
    #[arg(long, value_name = "N", default_value = "2000")]
    nmf_iterations: NonZeroUsize,
    /// Upstream's `curves.csv`, to draw beside ours; alone, they are tabulated and drawn and nothing is played
    #[arg(long, value_name = "FILE", num_args = 1..)]
    published: Vec<PathBuf>,
    #[command(flatten)]
    movement: MovementArguments,
}

/// A way of taking activity apart.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Method {
    Pca,
    Nmf,
}

/// What is factorised.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum NmfDomain {
    /// What the actuators receive
    Excitation,
    /// Actions between -1 and 1, moved to between 0 and 1
    Shift,
}

/// Where a factorisation starts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Start {
    /// Noise, another one for each fit
    Nndsvdar,
    /// The mean: every fit would be the same
    Nndsvda,
}

/// How weights are found for given synergies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Weights {
    /// By the sweeps of the factorisation, from zero
    Descent,
    /// Exactly: non-negative least squares
    Nnls,
}

fn share(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(share) if share > 0.0 && share < 1.0 => Ok(share),
        _ => Err("expected a number between 0 and 1".to_owned()),
    }
}

/// Episodes per policy and task of the paper.
const EPISODES: usize = 100;
/// Fits per number of synergies of the paper.
const FITS: usize = 10;

impl SynergiesArguments {
    fn plan(&self, movement: &Movement) -> anyhow::Result<SynergyPlan> {
        let noise = self.nmf_init == Start::Nndsvdar;
        let fits = self.n_fits.map_or(if noise { FITS } else { 1 }, NonZeroUsize::get);
        if !noise && fits > 1 {
            return Err(Hinted::new(
                format!("with `--nmf-init nndsvda` all {fits} fits would be the same"),
                "leave `--n-fits` out, or take `--nmf-init nndsvdar`",
            ));
        }
        let nmf = NmfPlan {
            ranks: self.synergies.as_ref().map(|list| list.0.clone()),
            fits,
            noise,
            domain: match self.nmf_domain {
                NmfDomain::Excitation => Domain::Excitation,
                NmfDomain::Shift => Domain::Shift,
            },
            exact_weights: self.nmf_weights == Weights::Nnls,
            tolerance: self.nmf_tolerance,
            maximum_iterations: self.nmf_iterations.get(),
        };
        Ok(SynergyPlan {
            components: self.method.contains(&Method::Pca),
            synergies: self.method.contains(&Method::Nmf).then_some(nmf),
            episodes: EpisodeChoice::Exactly(movement.episodes),
            threads: movement.threads,
        })
    }
}

/// Runs the command.
pub fn run(context: &Context, arguments: &SynergiesArguments) -> anyhow::Result<Outcome> {
    let published = Published::read(&arguments.published)?;
    if !arguments.published.is_empty() && !arguments.movement.names_something() {
        return only_published(context, arguments, &published);
    }
    let defaults = Defaults { tasks: "hand", episodes: EPISODES, mode: None };
    let movement = Movement::open(context, &arguments.movement, defaults, "action_pca")?;
    let plan = arguments.plan(&movement)?;
    let decides = json!({
        "movement": movement.decides(),
        "components": plan.components,
        "synergies": plan.synergies.as_ref().map(|nmf| json!({
            "numbers": nmf.ranks,
            "fits": nmf.fits,
            "noise": nmf.noise,
            "domain": format!("{:?}", nmf.domain),
            "exact_weights": nmf.exact_weights,
            "tolerance": nmf.tolerance,
            "iterations": nmf.maximum_iterations,
        })),
        "published": published.hashes,
    });
    let (folder, finished) = movement.run_folder(context, "synergies", &decides)?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let mut activities = Vec::new();
    let seconds = movement.each_read(
        context,
        &folder,
        &synergies::needed(&plan),
        |policy, recording| synergies::read(policy, recording, &plan),
        |activity| {
            activities.push(activity);
            Ok(())
        },
    )?;
    let Some(mut seconds) = seconds else { return Ok(Outcome::Done) };
    let total = plan.synergies.as_ref().map_or(0, |nmf| synergies::fit_count(&activities, nmf));
    let progress = Progress::start(context, "synergies", "fits", total as u64);
    let found = synergies::analyse(&activities, &plan, &|| progress.advance(1)).map_err(hinted)?;
    seconds += progress.finish();
    let mut output = Output::new(&folder);
    if plan.components {
        output.tidy("variance", &found.variance_table()?)?;
        output.tidy("components", &found.component_table()?)?;
    }
    if plan.synergies.is_some() {
        output.tidy("reconstruction", &found.reconstruction_table()?)?;
        output.tidy("synergies", &found.synergy_table()?)?;
    }
    if !published.points.is_empty() {
        output.tidy("published", &synergies::published_table(&published.points)?)?;
    }
    for (stem, figure) in found.figures(&published.points, &movement.provenance()) {
        output.figure(&stem, &figure.to_svg()?)?;
    }
    let mut document = found.document();
    if let Some(nmf) = &plan.synergies {
        document["fits"] = json!(nmf.fits);
    }
    let manifest = movement.finish(output, document, seconds)?;
    finish::print(context, &folder, &manifest, &table)
}

/// Published curves, and what tells their files from others.
struct Published {
    points: Vec<SubspacePoint>,
    hashes: Vec<String>,
}

impl Published {
    fn read(paths: &[PathBuf]) -> anyhow::Result<Self> {
        let mut published = Self { points: Vec::new(), hashes: Vec::new() };
        for path in paths {
            let points = read_subspace_curves(path).map_err(|error| {
                Hinted::new(
                    error.to_string(),
                    "upstream's `curves.csv` has the columns method, scope, basis_policy, task, dimension, reconstruction, \
                     solved_fraction, n_episodes, n_fits",
                )
            })?;
            published.points.extend(points);
            published.hashes.push(files::sha256_of_file(path)?);
        }
        Ok(published)
    }
}

/// Tabulates and draws published curves.
fn only_published(
    context: &Context,
    arguments: &SynergiesArguments,
    published: &Published,
) -> anyhow::Result<Outcome> {
    let decides = json!({"published": published.hashes});
    let out = arguments.movement.out();
    let (folder, finished) = finish::open_below(context, out, "synergies", &decides)?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let mut output = Output::new(&folder);
    output.tidy("published", &synergies::published_table(&published.points)?)?;
    for (stem, figure) in synergies::published_figures(&published.points) {
        output.figure(&stem, &figure.to_svg()?)?;
    }
    let mut result = synergies::published_document(&published.points);
    result["input"] = json!({"published": arguments.published});
    let machine = json!({"command_line": std::env::args().collect::<Vec<_>>().join(" ")});
    let manifest = output.finish_with(json!([]), result, machine)?;
    finish::print(context, &folder, &manifest, &table)
}

/// What to do about it.
fn hinted(error: ExperimentError) -> anyhow::Error {
    use crate::analysis::subspace::SubspaceError;
    match &error {
        ExperimentError::Controls {
            source: SubspaceError::ComponentCount { available, .. },
            ..
        } => {
            let hint = format!("`--synergies 1-{available}`, or leave it out for all");
            Hinted::new(error.to_string(), hint)
        }
        ExperimentError::Controls { .. } => Hinted::new(
            error.to_string(),
            "`--method pca` takes the components alone, `--nmf-domain excitation` is never zero",
        ),
        _ => error.into(),
    }
}

fn table(result: &Value) -> String {
    let mut text = match result["published"].as_array() {
        Some(curves) => published_lines(curves),
        None => own_lines(result),
    };
    let input = match result["input"]["recordings"].as_array() {
        Some(files) if files.len() == 1 => "Input: 1 recording\n".to_owned(),
        Some(files) => format!("Input: {} recordings\n", files.len()),
        None if result["published"].is_array() => "Input: published curves\n".to_owned(),
        None => "Input: played for this\n".to_owned(),
    };
    text.push_str(&input);
    text + &render::warnings(result)
}

const SHARES: &str = "0.85, 0.95: the fewest that reach that share of variance (components) or R²\n(synergies); –: none does\n";

/// The fewest components of a curve that reach each share; `≤` if smaller numbers were not tried.
fn reaching(curve: &Value) -> [String; 2] {
    [0, 1].map(|place| {
        let reached = &curve["reaching"][place];
        let sign = if reached["is_fewest"] == false { "≤" } else { "" };
        reached["dimension"].as_u64().map_or_else(|| "–".to_owned(), |n| format!("{sign}{n}"))
    })
}

fn own_lines(result: &Value) -> String {
    let tasks: Vec<&Value> = result["tasks"].as_array().into_iter().flatten().collect();
    let mut policies: Vec<&str> = Vec::new();
    for policy in tasks.iter().filter_map(|task| task["policy"].as_str()) {
        if !policies.contains(&policy) {
            policies.push(policy);
        }
    }
    let kinds = [
        ("explained_variance", "principal components of the action means"),
        ("reconstruction", "synergies of the muscle controls"),
    ];
    let mut text = String::new();
    for policy in policies {
        let own: Vec<&&Value> = tasks.iter().filter(|task| task["policy"] == policy).collect();
        let actions = own.first().and_then(|task| task["actions"].as_str());
        let actions = actions.map_or_else(String::new, |word| format!(" ({word} actions)"));
        for (key, what) in kinds {
            if own.iter().all(|task| task[key].is_null()) {
                continue;
            }
            let has_pool = own.iter().any(|task| task[key]["global"].is_object());
            let mut columns = vec![
                ("task", Align::Left),
                ("steps", Align::Right),
                ("muscles", Align::Right),
                ("own 0.85", Align::Right),
                ("0.95", Align::Right),
            ];
            if has_pool {
                columns.extend([("pooled 0.85", Align::Right), ("0.95", Align::Right)]);
            }
            let line = |task: &&&Value| {
                let mut cells = vec![
                    task["task"].as_str().unwrap_or_default().to_owned(),
                    task["steps"].to_string(),
                    task["muscles"].to_string(),
                ];
                cells.extend(reaching(&task[key]["task"]));
                if has_pool {
                    cells.extend(reaching(&task[key]["global"]));
                }
                cells
            };
            let rows: Vec<Vec<String>> = own.iter().map(line).collect();
            let table = render::table(&columns, &rows);
            text.extend([&format!("{policy}{actions}: {what}\n\n"), &table, "\n"]);
        }
    }
    let fits = result["fits"].as_u64().map_or_else(String::new, |fits| {
        let word = if fits == 1 { "fit" } else { "fits" };
        format!("Synergies: R² is the mean of {fits} {word} each\n")
    });
    text + SHARES + &fits
}

fn published_lines(curves: &[Value]) -> String {
    let columns = [
        ("method", Align::Left),
        ("basis", Align::Left),
        ("scope", Align::Left),
        ("task", Align::Left),
        ("0.85", Align::Right),
        ("0.95", Align::Right),
    ];
    let word = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let line = |curve: &Value| {
        let keys = ["method", "basis_policy", "scope", "task"];
        keys.map(|key| word(&curve[key])).into_iter().chain(reaching(curve)).collect()
    };
    let rows: Vec<Vec<String>> = curves.iter().map(line).collect();
    render::table(&columns, &rows) + "\n" + SHARES
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_tolerance_is_a_share() {
        assert_eq!(share("1e-4"), Ok(1e-4));
        for wrong in ["0", "1", "-0.1", "NaN", "x"] {
            assert!(share(wrong).is_err(), "{wrong}");
        }
    }
}

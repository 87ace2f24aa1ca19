//! `csi`: control-subspace inactivation.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::synergies::Start;
use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::{Defaults, Laboratory, PlayArguments};
use crate::cli::progress::Progress;
use crate::cli::render::{self, Align, Hinted};
#[cfg(feature = "view")]
use crate::cli::viewing::{self, ViewerArguments, WatchArguments};
use crate::cli::{signals, sweep};
use crate::experiment::csi::{self, CsiOptions, CsiScene, Design, Method, SynergyOptions};
#[cfg(feature = "view")]
use crate::experiment::run_folder::{Manifest, RunFolder};
use crate::files;
use crate::record::{Benchmark, read_benchmark};
use crate::sim::rollout::ActionMode;

/// Arguments of `csi`.
#[derive(Debug, Args)]
pub struct CsiArguments {
    #[command(flatten)]
    play: PlayArguments,
    /// Numbers of components, e.g. `1-5,10,39` [default: all]
    #[arg(long, value_name = "LIST", value_parser = component_list)]
    components: Option<ComponentList>,
    /// Leave the pooled basis out
    #[arg(long)]
    no_pooled: bool,
    /// What the components are
    #[arg(long, value_enum, value_name = "BASIS", default_value = "pca")]
    basis: BasisChoice,
    /// Factorisations of every number of synergies, each from a seed of its own and for its share of the episodes
    /// [default: 10, or 1 with `--nmf-init nndsvda`]
    #[arg(long, value_name = "N")]
    n_fits: Option<NonZeroUsize>,
    /// Where a factorisation starts [default: nndsvdar]
    #[arg(long, value_enum, value_name = "START")]
    nmf_init: Option<Start>,
    /// Play in the components of another policy's actions: a file, a folder or a name, as for `--policy`
    #[arg(long, value_name = "FILE|NAME")]
    components_of: Option<PathBuf>,
    /// Results of the experts (`results.json` of `evaluate`, or a published `…_results.json`): performance in percent of
    /// theirs as well
    #[arg(long, value_name = "FILE")]
    relative_to: Option<PathBuf>,
    /// How much to play where it is not said otherwise
    #[arg(long, value_enum, value_name = "BUDGET", default_value = "paper")]
    budget: Budget,
    #[cfg(feature = "view")]
    #[command(flatten)]
    watch: WatchArguments,
}

/// What the components are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum BasisChoice {
    /// Principal components of the mean actions; actions are projected onto them
    Pca,
    /// Synergies of the excitations (non-negative factors); excitations are rebuilt from them
    Nmf,
}

/// How much to play.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Budget {
    /// A sketch: 20 episodes, a dozen numbers of components, one factorisation of each
    Quick,
    /// As published: 100 episodes, every number of components, ten factorisations
    Paper,
}

/// The numbers of components of a sketch: few where curves bend, fewer where they are flat.
const QUICK_COMPONENTS: [usize; 15] = [1, 2, 3, 4, 6, 8, 11, 15, 20, 26, 33, 39, 50, 63, 80];
const QUICK_EPISODES: usize = 20;

/// Numbers of components as typed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct ComponentList(pub(super) Vec<usize>);

/// No body has more muscles than this.
const MOST_COMPONENTS: usize = 1000;

pub(super) fn component_list(text: &str) -> Result<ComponentList, String> {
    let number = |text: &str| match text.trim().parse::<usize>() {
        Ok(k) if (1..=MOST_COMPONENTS).contains(&k) => Ok(k),
        _ => Err(format!("`{text}` is no number of components")),
    };
    let mut list = Vec::new();
    for piece in text.split(',') {
        match piece.split_once('-') {
            Some((low, high)) => list.extend(number(low)?..=number(high)?),
            None => list.push(number(piece)?),
        }
    }
    list.sort_unstable();
    list.dedup();
    if list.is_empty() { Err("the list is empty".to_owned()) } else { Ok(ComponentList(list)) }
}

/// Episodes per point of the paper's sweep.
const EPISODES: usize = 100;

impl CsiArguments {
    fn method(&self) -> anyhow::Result<Method> {
        if self.basis == BasisChoice::Pca {
            if self.n_fits.is_some() || self.nmf_init.is_some() {
                return Err(Hinted::new(
                    "`--n-fits` and `--nmf-init` are for synergies",
                    "add `--basis nmf`, or leave them out",
                ));
            }
            return Ok(Method::PrincipalComponents);
        }
        let published = SynergyOptions::default();
        let noise = self.nmf_init.unwrap_or(Start::Nndsvdar) == Start::Nndsvdar;
        let usual = if noise && self.budget == Budget::Paper { published.fits } else { 1 };
        let fits = self.n_fits.map_or(usual, NonZeroUsize::get);
        if !noise && fits > 1 {
            return Err(Hinted::new(
                format!("with `--nmf-init nndsvda` all {fits} fits would be the same"),
                "leave `--n-fits` out, or take `--nmf-init nndsvdar`",
            ));
        }
        Ok(Method::Synergies(SynergyOptions { fits, noise }))
    }

    fn components(&self) -> Option<Vec<usize>> {
        let typed = self.components.as_ref().map(|list| list.0.clone());
        typed.or_else(|| (self.budget == Budget::Quick).then(|| QUICK_COMPONENTS.to_vec()))
    }
}

/// Opens the policies, and says what to sweep.
fn open(context: &Context, arguments: &CsiArguments) -> anyhow::Result<(Laboratory, CsiOptions)> {
    let method = arguments.method()?;
    let episodes = if arguments.budget == Budget::Quick { QUICK_EPISODES } else { EPISODES };
    let defaults = Defaults { tasks: "all", episodes, mode: Some(ActionMode::Stochastic) };
    let mut laboratory = Laboratory::open(context, &arguments.play, defaults)?;
    if let Some(name) = &arguments.components_of {
        laboratory.take_components_of(context, name)?;
    }
    let options = CsiOptions {
        episodes: laboratory.episodes,
        components: arguments.components(),
        pooled: !arguments.no_pooled,
        method,
    };
    let most = laboratory.muscle_counts.iter().copied().max().unwrap_or(0);
    if options.components.as_ref().is_some_and(|list| list.iter().all(|&k| k > most)) {
        return Err(Hinted::new(
            format!(
                "none of the numbers of components exists: these bodies have at most {most} muscles"
            ),
            format!("`--components 1-{most}`, or leave it out for all"),
        ));
    }
    if let Method::Synergies(SynergyOptions { fits, .. }) = options.method
        && fits > options.episodes
    {
        return Err(Hinted::new(
            format!("{fits} factorisations cannot share {} episodes", options.episodes),
            "fewer with `--n-fits N`, or more with `--episodes N`",
        ));
    }
    Ok((laboratory, options))
}

/// Everything that decides the result; what is as usual goes without saying.
fn decides(laboratory: &Laboratory, options: &CsiOptions, experts: Option<&Experts>) -> Value {
    let mut plan = json!({
        "play": laboratory.decides(),
        "components": options.components,
        "pooled": options.pooled,
    });
    if let Method::Synergies(SynergyOptions { fits, noise }) = options.method {
        let start = if noise { "nndsvdar" } else { "nndsvda" };
        plan["basis"] = json!({"method": "nmf", "fits": fits, "start": start});
    }
    if let Some(other) = &laboratory.components_of {
        plan["components_of"] = json!({
            "name": other.name,
            "checkpoint_blake3": other.checkpoint_hash,
            "normaliser_blake3": other.normaliser_hash,
        });
    }
    if let Some(experts) = experts {
        plan["relative_to_sha256"] = json!(experts.sha256);
    }
    plan
}

/// What performance is divided by.
struct Experts {
    results: Benchmark,
    sha256: String,
}

fn read_experts(path: &Path) -> anyhow::Result<Experts> {
    let results = read_benchmark(path).map_err(|error| {
        Hinted::new(
            error.to_string(),
            "give the `results.json` of `arnold-analyze evaluate`, or a published `…_results.json`",
        )
    })?;
    Ok(Experts { results, sha256: files::sha256_of_file(path)? })
}

/// Runs the command.
pub fn run(context: &Context, arguments: &CsiArguments) -> anyhow::Result<Outcome> {
    let experts = arguments.relative_to.as_deref().map(read_experts).transpose()?;
    let (laboratory, options) = open(context, arguments)?;
    let plan = decides(&laboratory, &options, experts.as_ref());
    let (folder, finished) = finish::open(context, &laboratory, "csi", &plan)?;
    if let Some(manifest) = finished {
        #[cfg(feature = "view")]
        if let Some(viewer) = arguments.watch.anywhere() {
            show(context, &laboratory, &options.method, &folder, &manifest, viewer)?;
        }
        return finish::print(context, &folder, &manifest, &table);
    }
    let machine = &laboratory.machine;
    let design =
        Design::new(machine, &laboratory.tasks, options, laboratory.policies().get(1).cloned())?;
    let scene = CsiScene {
        design: &design,
        players: &laboratory,
        folder: folder.path.clone(),
        threads: machine.threads,
        goes_on: &signals::go_on,
        on_fits: &|total| count_fits(context, total),
    };
    let arms = design.arms();
    #[cfg(feature = "view")]
    arguments.watch.seat(&laboratory)?;
    let Some((played, seconds)) = sweep::play(context, &folder, &laboratory, &scene, arms)? else {
        return Ok(Outcome::Done);
    };
    #[cfg(feature = "view")]
    viewing::close(context, &laboratory)?;
    let mut csi = csi::assemble(&scene, &played)?;
    if let Some(experts) = &experts {
        let fraction = |task: &str| experts.results.get(task)?.avg_solved_step_frac;
        csi.experts = Some(csi.tasks.iter().map(|task| fraction(task.task.name)).collect());
    }
    let source = laboratory.components_of.as_ref().unwrap_or(&laboratory.policy);
    let mut output = Output::new(&folder);
    output.table("curves.parquet", &csi::curve_table(&csi, &source.name)?)?;
    output.table("episodes.parquet", &csi::episode_table(&csi)?)?;
    output.table("bases.parquet", &csi::basis_table(&csi)?)?;
    let figure = csi::figure(&csi, finish::provenance(&laboratory));
    output.figure("csi", &figure.to_svg()?)?;
    let mut document = csi::document(&csi);
    if arguments.budget == Budget::Quick {
        document["budget"] = quick(&design.options);
    }
    let manifest = output.finish(&laboratory, document, seconds)?;
    #[cfg(feature = "view")]
    if let Some(viewer) = arguments.watch.file() {
        show(context, &laboratory, &design.options.method, &folder, &manifest, viewer)?;
    }
    finish::print(context, &folder, &manifest, &table)
}

/// Shows episodes of the finished sweep.
#[cfg(feature = "view")]
fn show(
    context: &Context,
    laboratory: &Laboratory,
    method: &Method,
    folder: &RunFolder,
    manifest: &Manifest,
    viewer: &ViewerArguments,
) -> anyhow::Result<()> {
    super::csi_scene::Finished { laboratory, method, folder, manifest }.show(context, viewer)
}

/// What a sketch says of itself.
fn quick(options: &CsiOptions) -> Value {
    json!({
        "name": "quick",
        "episodes": options.episodes,
        "components": options.components,
        "note": format!(
            "a sketch: {} episodes per point and some numbers of components only, where the paper has {EPISODES} and all",
            options.episodes
        ),
    })
}

/// Blocks of a curve in the table, which so is no wider than a terminal.
const CURVE: usize = 32;

/// A count of factorisations, which takes itself away with the last one.
fn count_fits(context: &Context, total: usize) -> Box<dyn Fn() + Sync> {
    let progress = Progress::start(context, "csi", "factorisations", total as u64);
    Box::new(move || progress.advance(1))
}

fn table(result: &Value) -> String {
    let columns = [
        ("task", Align::Left),
        ("basis", Align::Left),
        ("free", Align::Right),
        ("90 %", Align::Right),
        ("95 %", Align::Right),
        ("solved with 1 … all", Align::Left),
    ];
    let mut rows = Vec::new();
    for (key, basis) in [("tasks", "task"), ("pooled", "pooled")] {
        for (task, entry) in result[key].as_object().into_iter().flatten() {
            let solved = entry["solved_fraction"].as_array().into_iter().flatten();
            let needed = |share: &str| {
                let found = &entry["functional_dimensionality"][share];
                match (found["components"].as_u64(), found["at_most"].as_u64()) {
                    (Some(k), _) => k.to_string(),
                    (None, Some(k)) => format!("≤ {k}"),
                    (None, None) => "–".to_owned(),
                }
            };
            let unprojected = entry["unprojected"]["mean"].as_f64();
            rows.push(vec![
                task.clone(),
                basis.to_owned(),
                unprojected.map_or_else(|| "–".to_owned(), |x| format!("{x:.3}")),
                needed("90%"),
                needed("95%"),
                render::sparkline(
                    &solved.map(|x| x.as_f64().unwrap_or(f64::NAN)).collect::<Vec<_>>(),
                    CURVE,
                ),
            ]);
        }
    }
    let mut text = render::table(&columns, &rows);
    text.push_str("\nfree: solved fraction, not projected; 90 %, 95 %: fewest components that keep\nthat share of it; the curve goes from 0 to 1\n");
    if let Some(note) = result["budget"]["note"].as_str() {
        text.extend(["\nQuick: ", note, "\n"]);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn component_lists_are_sorted_ranges_and_numbers() {
        assert_eq!(component_list("10,1-3, 2").unwrap().0, [1, 2, 3, 10]);
        for wrong in ["", "0", "a", "3-1", "1-", "1-5000"] {
            assert!(component_list(wrong).is_err(), "{wrong}");
        }
    }
}

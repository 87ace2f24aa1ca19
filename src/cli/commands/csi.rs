//! `csi`: control-subspace inactivation.

use clap::Args;
use serde_json::{Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::{Defaults, Laboratory, PlayArguments};
use crate::cli::progress::Progress;
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::csi::{self, CsiOptions};
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
}

/// Numbers of components as typed.
#[derive(Debug, Clone, PartialEq, Eq)]
struct ComponentList(Vec<usize>);

/// No body has more muscles than this.
const MOST_COMPONENTS: usize = 1000;

fn component_list(text: &str) -> Result<ComponentList, String> {
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

/// Runs the command.
pub fn run(context: &Context, arguments: &CsiArguments) -> anyhow::Result<Outcome> {
    let defaults =
        Defaults { tasks: "all", episodes: EPISODES, mode: Some(ActionMode::Stochastic) };
    let laboratory = Laboratory::open(context, &arguments.play, defaults)?;
    let options = CsiOptions {
        episodes: laboratory.episodes,
        seed: laboratory.seed,
        components: arguments.components.as_ref().map(|list| list.0.clone()),
        pooled: !arguments.no_pooled,
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
    let plan = json!({
        "play": laboratory.decides(),
        "components": options.components,
        "pooled": options.pooled,
    });
    let (folder, finished) = finish::open(context, &laboratory, "csi", &plan)?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let total = csi::episode_count(&options, &laboratory.muscle_counts);
    let progress = Progress::start(context, "csi", "episodes", total as u64);
    let plans: Vec<_> = laboratory.tasks.iter().map(|task| laboratory.plan(task)).collect();
    let csi = csi::sweep(&laboratory.machine, &plans, &options, &|_| progress.advance(1))?;
    let seconds = progress.finish();
    let mut output = Output::new(&folder);
    output.table("curves.parquet", &csi::curve_table(&csi, &laboratory.policy.name)?)?;
    output.table("episodes.parquet", &csi::episode_table(&csi)?)?;
    output.table("bases.parquet", &csi::basis_table(&csi)?)?;
    let figure = csi::figure(&csi, finish::provenance(&laboratory));
    output.figure("csi", &figure.to_svg()?)?;
    let manifest = output.finish(&laboratory, csi::document(&csi), seconds)?;
    finish::print(context, &folder, &manifest, &table)
}

fn table(result: &Value) -> String {
    let columns = [
        ("task", Align::Left),
        ("basis", Align::Left),
        ("unprojected", Align::Right),
        ("90 % at", Align::Right),
        ("95 % at", Align::Right),
        ("solved fraction by number of components", Align::Left),
    ];
    let mut rows = Vec::new();
    for (key, basis) in [("tasks", "task"), ("pooled", "pooled")] {
        for (task, entry) in result[key].as_object().into_iter().flatten() {
            let solved = entry["solved_fraction"].as_array().into_iter().flatten();
            let needed = |share: &str| {
                let count = entry["functional_dimensionality"][share]["components"].as_u64();
                count.map_or_else(|| "–".to_owned(), |k| k.to_string())
            };
            let unprojected = entry["unprojected"]["mean"].as_f64();
            rows.push(vec![
                task.clone(),
                basis.to_owned(),
                unprojected.map_or_else(|| "–".to_owned(), |x| format!("{x:.3}")),
                needed("90%"),
                needed("95%"),
                render::sparkline(solved.map(|x| x.as_f64().unwrap_or(f64::NAN))),
            ]);
        }
    }
    let mut text = render::table(&columns, &rows);
    text.push_str("\n90 % at, 95 % at: fewest components that keep that share of the unprojected performance\n");
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

//! `factors`: which muscles of a leg act together over the gait cycle?

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use super::walking::{self, CycleArguments, Labelled, Leg, Walks};
use crate::analysis::factor::FACTOR_MUSCLES;
use crate::assets::platform;
use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::PlayArguments;
use crate::cli::render::{self, Align, Hinted};
use crate::cli::sweep;
use crate::experiment::factors::{Activations, FactorsError, FactorsResult};
use crate::experiment::run_folder::RunFolder;
use crate::files;
use crate::npz::write_npy;
use crate::record::profiles::SimulationProfiles;

/// Arguments of `factors`.
#[derive(Debug, Args)]
pub struct FactorsArguments {
    /// Recording of walking
    #[arg(long, value_name = "[LABEL=]FILE", value_parser = walking::labelled)]
    recording: Option<Labelled>,
    /// Averaged cycles that `emg` or upstream's suite wrote (`simulation.npz`)
    #[arg(long, value_name = "FILE", conflicts_with_all = ["recording", "policy"])]
    profiles: Option<PathBuf>,
    /// Which of them, e.g. `arnold_right` [default: the only one of fourteen muscles]
    #[arg(long, value_name = "NAME", requires = "profiles")]
    profile: Option<String>,
    /// Leg whose muscles, and whose heel strikes, are taken
    #[arg(long, value_enum, default_value_t = Leg::Right)]
    side: Leg,
    /// How factors are rotated; `reference` is the authors' own, which seldom settles, and writes both
    #[arg(long, value_enum, default_value_t = Turn::Varimax)]
    rotation: Turn,
    #[command(flatten)]
    cycles: CycleArguments,
    #[command(flatten)]
    play: PlayArguments,
}

/// A rotation of factors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Turn {
    Varimax,
    Reference,
}

/// Runs the command.
pub fn run(context: &Context, arguments: &FactorsArguments) -> anyhow::Result<Outcome> {
    let profiles = Profiles::open(context, arguments)?;
    let reference = arguments.rotation == Turn::Reference;
    let plan = json!({
        "source": profiles.source(arguments)?,
        "side": format!("{:?}", arguments.side),
        "cycles": arguments.cycles.decides(),
        "rotation": format!("{:?}", arguments.rotation),
    });
    let (folder, finished) = finish::open_below(context, arguments.play.out(), "factors", &plan)?;
    if let Some(manifest) = finished {
        return finish::print(context, &folder, &manifest, &table);
    }
    let Some((activations, machine)) = profiles.activations(context, arguments, &folder)? else {
        return Ok(Outcome::Done);
    };
    let result = FactorsResult::of(activations, reference)?;
    for warning in result.warnings() {
        context.say(&format!("warning: {warning}"));
    }
    let mut output = Output::new(&folder);
    let asked = result.asked();
    output.tidy("loadings", &result.loading_table(asked)?)?;
    output.written("loadings.npy", |path| Ok(write_npy(path, &result.loading_array(asked))?))?;
    output.written("factors.npy", |path| Ok(write_npy(path, &result.waveform_array(asked))?))?;
    if reference {
        let varimax = &result.varimax;
        output.tidy("loadings_varimax", &result.loading_table(varimax)?)?;
        output.written("factors_varimax.npy", |path| {
            Ok(write_npy(path, &result.waveform_array(varimax))?)
        })?;
    }
    let statistics = serde_json::to_value(result.statistics())?;
    output.json("statistics.json", &statistics)?;
    output.figure("factors", &result.figure().to_svg()?)?;
    let muscles: Vec<&str> =
        result.extraction.muscles.iter().map(|&at| FACTOR_MUSCLES[at].0).collect();
    let count = result.extraction.factor_count;
    let document = json!({
        "policy": result.activations.policy,
        "cycles": result.activations.cycles,
        "statistics": statistics,
        "muscles": muscles,
        "loadings": asked.loadings.chunks_exact(count).collect::<Vec<_>>(),
        "shares": asked.shares,
        "warnings": result.warnings(),
    });
    let manifest = output.finish_with(json!([]), document, machine)?;
    finish::print(context, &folder, &manifest, &table)
}

/// Where the averaged cycle comes from.
enum Profiles<'a> {
    Stored(&'a Path),
    Walked(Box<Walks>),
}

impl<'a> Profiles<'a> {
    fn open(context: &Context, arguments: &'a FactorsArguments) -> anyhow::Result<Self> {
        if let Some(path) = &arguments.profiles {
            return Ok(Self::Stored(path));
        }
        let options = arguments.cycles.options();
        let recordings: Vec<Labelled> = arguments.recording.iter().cloned().collect();
        let walks = Walks::open(context, &recordings, &arguments.play, &options)?;
        match walks.names().len() {
            1 => Ok(Self::Walked(Box::new(walks))),
            count => Err(Hinted::new(
                format!("factors are found in one walk, {count} were given"),
                "one of `--recording FILE`, `--profiles simulation.npz`, `--policy FILE`",
            )),
        }
    }

    /// What decides it, for the run's key.
    fn source(&self, arguments: &FactorsArguments) -> anyhow::Result<Value> {
        Ok(match self {
            Self::Stored(path) => {
                let activations = stored(path, arguments.profile.as_deref())?;
                json!({"sha256": files::sha256_of_file(path)?, "profile": activations.policy})
            }
            Self::Walked(walks) => walks.plan.clone(),
        })
    }

    /// The cycle, and what decides nothing about it; none if only a part of the playing was to be done.
    fn activations(
        self,
        context: &Context,
        arguments: &FactorsArguments,
        folder: &RunFolder,
    ) -> anyhow::Result<Option<(Activations, Value)>> {
        match self {
            Self::Stored(path) => {
                sweep::nothing_to_play(context)?;
                let activations = stored(path, arguments.profile.as_deref())?;
                let machine = json!({"profiles": path, "platform": platform::describe_here()});
                Ok(Some((activations, machine)))
            }
            Self::Walked(walks) => {
                let Some((walks, machine)) = walks.all(context, folder)? else { return Ok(None) };
                let side = arguments.side.into();
                let activations =
                    Activations::of_walk(&walks[0], side, &arguments.cycles.options());
                let activations = activations.map_err(|error| match error {
                    FactorsError::Walk(error) => walking::with_hint(error),
                    other => other.into(),
                })?;
                Ok(Some((activations, machine)))
            }
        }
    }
}

/// The profile called `name` in `path`, or the only one with enough muscles.
fn stored(path: &Path, name: Option<&str>) -> anyhow::Result<Activations> {
    let hint = "`--profile NAME` names one of those in the file";
    let simulation = SimulationProfiles::open(path).map_err(|error| {
        Hinted::new(error.to_string(), "`emg` writes such a file, `simulation.npz`")
    })?;
    let fitting: Vec<&str> = simulation
        .profiles
        .iter()
        .filter(|(_, profile)| profile.muscles == FACTOR_MUSCLES.len())
        .map(|(name, _)| name.as_str())
        .collect();
    let name = match (name, fitting.as_slice()) {
        (Some(name), _) | (None, &[name]) => name,
        (None, []) => {
            let what = format!("no profile of fourteen muscles, in `{}`", path.display());
            return Err(Hinted::new(what, hint));
        }
        (None, names) => {
            let what = format!("several profiles fit: {}", names.join(", "));
            return Err(Hinted::new(what, hint));
        }
    };
    let labels = FACTOR_MUSCLES.map(|(label, _)| label);
    if simulation.factor_muscles != labels {
        let found = simulation.factor_muscles.join(", ");
        let what = format!("the muscles are {found}, expected {}", labels.join(", "));
        return Err(Hinted::new(what, "make the profiles again with `emg`"));
    }
    let Some(profile) = simulation.profiles.get(name) else {
        let names: Vec<&str> = simulation.profiles.keys().map(String::as_str).collect();
        let what = format!("there is no profile `{name}` among {}", names.join(", "));
        return Err(Hinted::new(what, hint));
    };
    Ok(Activations::of_profile(name, profile)?)
}

fn number(value: &Value, digits: usize) -> String {
    value.as_f64().map_or_else(|| "–".to_owned(), |x| format!("{x:.digits$}"))
}

/// A p-value; zero is what no double can hold.
fn p_value(value: &Value) -> String {
    match value.as_f64() {
        None => "undefined".to_owned(),
        Some(0.0) => "<1e-300".to_owned(),
        Some(p) if p < 1e-4 => format!("{p:.1e}"),
        Some(p) => format!("{p:.4}"),
    }
}

fn table(result: &Value) -> String {
    let statistics = &result["statistics"];
    let list = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let shares = list(&result["shares"]);
    let titles: Vec<String> = (1..=shares.len()).map(|factor| format!("F{factor}")).collect();
    let columns: Vec<(&str, Align)> = [("loading", Align::Left)]
        .into_iter()
        .chain(titles.iter().map(|title| (title.as_str(), Align::Right)))
        .collect();
    let row = |label: &str, values: &[Value], format: &dyn Fn(&Value) -> String| -> Vec<String> {
        [label.to_owned()].into_iter().chain(values.iter().map(format)).collect()
    };
    let muscles = list(&result["muscles"]);
    let mut rows: Vec<Vec<String>> = muscles
        .iter()
        .zip(list(&result["loadings"]))
        .map(|(muscle, values)| {
            row(muscle.as_str().unwrap_or_default(), &list(&values), &|x| number(x, 2))
        })
        .collect();
    let percent =
        |x: &Value| x.as_f64().map_or_else(String::new, |x| format!("{:.1} %", 100.0 * x));
    rows.push(row("share", &shares, &percent));
    let word = |key: &str| statistics[key].as_str().unwrap_or_default().to_owned();
    let cycles = &result["cycles"];
    let cycles = if cycles.is_array() {
        format!("{} detected, {} averaged", cycles[0], cycles[1])
    } else {
        "averaged before".to_owned()
    };
    let settled = if statistics["converged"] == true { "converged" } else { "not converged" };
    let facts = [
        ("Policy", result["policy"].as_str().unwrap_or_default().to_owned()),
        ("Gait cycles", cycles),
        (
            "Rotation",
            format!("{}, {settled} after {} steps", word("rotation"), statistics["sweeps"]),
        ),
        ("Explained", percent(&statistics["explained_variance"])),
        (
            "Bartlett",
            format!(
                "χ² {}, {} degrees of freedom, p {}",
                number(&statistics["bartlett_chi2"], 1),
                statistics["bartlett_df"],
                p_value(&statistics["bartlett_p"])
            ),
        ),
        ("KMO", number(&statistics["kmo"], 3)),
    ];
    let line = |(label, fact): &(&str, String)| format!("{label:<11}  {fact}\n");
    let lines: String = facts.iter().map(line).collect();
    let warning = |warning: &str| format!("warning: {warning}\n");
    let warnings = list(&result["warnings"]);
    let warnings: String = warnings.iter().filter_map(Value::as_str).map(warning).collect();
    let gap = if warnings.is_empty() { "" } else { "\n" };
    format!("{}\n{lines}{gap}{warnings}", render::table(&columns, &rows))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::factor::Rotation;

    #[test]
    fn a_p_value_of_zero_is_not_claimed() {
        let shown = [json!(0.0), json!(0.0123), json!(2e-7), Value::Null].map(|p| p_value(&p));
        assert_eq!(shown, ["<1e-300", "0.0123", "2.0e-7", "undefined"]);
    }

    #[test]
    fn rotations_are_called_as_the_analysis_calls_them() {
        let word = Turn::Varimax.to_possible_value().map(|value| value.get_name().to_owned());
        assert_eq!(word.as_deref(), Some(Rotation::default().name()));
    }
}

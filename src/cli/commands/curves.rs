//! `curves`: learning curves from the logs of training. Nothing is trained or played.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use crate::analysis::curves::Smoothing;
use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::benchmarks::Results;
use crate::experiment::learning_curves::{
    CurveOptions, LearningCurves, LearningError, Logs, Recipe, RunInput,
};
use crate::files;
use crate::record::Benchmark;

/// Arguments of `curves`.
#[derive(Debug, Args)]
#[command(
    after_help = "Example: does a pretrained network learn the pen faster than a new one?\n  \
    arnold-analyze curves --recipe transfer --run pretrained:pen=logs/180 \\\n    \
    --run scratch:pen=logs/188"
)]
pub struct CurvesArguments {
    /// Tables of logged points with the columns panel, method, seed, task, stage, step, value, metric; may be gzipped
    #[arg(value_name = "TABLE", required_unless_present = "run")]
    tables: Vec<PathBuf>,
    /// A training run: folder of event files, event file, or CSV with `global_step` and `<environment>/solved`; several
    /// pieces of one seed by commas, several seeds by repeating; TASK `all` takes every environment
    #[arg(long, value_name = "METHOD:TASK=PATH[,PATH]", value_parser = run_input)]
    run: Vec<RunInput>,
    /// Which figure's rules: smoothing, scaling, averaging
    #[arg(long, value_enum, default_value_t = RecipeName::Portable)]
    recipe: RecipeName,
    /// Smoothing of `portable`: `none`, `trailing:N`, or `savgol:N` (odd, order 2)
    #[arg(long, value_name = "HOW", default_value = "trailing:5", value_parser = smoothing)]
    smoothing: Smoothing,
    /// Values as logged, not in percent of the expert
    #[arg(long)]
    raw: bool,
    /// Subtract these steps from every step of a stage, or of a method, whose runs count on from another (not
    /// `multi-task`)
    #[arg(long, value_name = "NAME=STEPS", num_args = 1.., value_parser = offset)]
    offset: Vec<(String, f64)>,
    /// Only these panels
    #[arg(long, value_name = "NAME", num_args = 1..)]
    panel: Vec<String>,
    /// Tag to read from event files [default: the task's own `/solved`, else the first that ends so, else that contains
    /// `solved`]
    #[arg(long, value_name = "TAG")]
    tag: Option<String>,
    /// Folder of the experts' results [default: in the data folder]
    #[arg(long, value_name = "DIR")]
    experts: Option<PathBuf>,
    /// Folder for results, one folder per run inside
    #[arg(long, value_name = "DIR", default_value = "runs")]
    out: PathBuf,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum RecipeName {
    /// Chosen smoothing; mean ± s.d. over the steps common to all seeds
    Portable,
    /// Pretrained against scratch: trailing mean of 5, from the origin
    Transfer,
    /// Imitation of one expert: the same, each panel with its own steps
    SingleTask,
    /// Fine-tuning by reinforcement learning: Savitzky–Golay over 101, solved fraction
    RlFinetuning,
    /// Baselines on all tasks: running mean of 20, seeds averaged on a grid
    MultiTask,
    /// Fine-tuning inside a control subspace: Savitzky–Golay over 101
    CsiFinetuning,
}

/// `METHOD:TASK=PATH[,PATH…]`.
fn run_input(text: &str) -> Result<RunInput, String> {
    let parsed = || {
        let (name, paths) = text.split_once('=')?;
        let (method, task) = name.split_once(':')?;
        let paths: Vec<PathBuf> = paths.split(',').map(PathBuf::from).collect();
        let is_whole = !method.is_empty() && !task.is_empty();
        let is_whole = is_whole && paths.iter().all(|path| !path.as_os_str().is_empty());
        is_whole.then(|| RunInput { method: method.to_owned(), task: task.to_owned(), paths })
    };
    parsed().ok_or_else(|| "expected METHOD:TASK=PATH, as `scratch:pen=logs/188`".to_owned())
}

fn smoothing(text: &str) -> Result<Smoothing, String> {
    let window = |text: &str| text.parse::<usize>().ok();
    match text.split_once(':') {
        None if text == "none" => Ok(Smoothing::None),
        Some(("trailing", points)) if window(points).is_some_and(|n| n > 0) => {
            Ok(Smoothing::Trailing(window(points).unwrap_or(1)))
        }
        Some(("savgol", points)) if window(points).is_some_and(|n| n >= 3 && n % 2 == 1) => {
            Ok(Smoothing::SavitzkyGolay(window(points).unwrap_or(3)))
        }
        _ => {
            Err("expected `none`, `trailing:N`, or `savgol:N` with an odd N of at least 3"
                .to_owned())
        }
    }
}

fn offset(text: &str) -> Result<(String, f64), String> {
    let parsed = text.split_once('=').and_then(|(stage, steps)| {
        let steps = steps.parse::<f64>().ok().filter(|steps| steps.is_finite())?;
        Some((stage.to_owned(), steps))
    });
    parsed.ok_or_else(|| "expected NAME=STEPS, as `finetuning=50000000`".to_owned())
}

/// Where the experts' results may lie in the data folder.
const EXPERT_FOLDERS: [&str; 2] =
    ["final_benchmarks/expert_policies", "arnold_published/expert_policies"];

/// Runs the command.
pub fn run(context: &Context, arguments: &CurvesArguments) -> anyhow::Result<Outcome> {
    let mut logs = Logs::default();
    for path in &arguments.tables {
        logs.add_table(path).map_err(|error| with_hint(&error))?;
    }
    for run in &arguments.run {
        logs.add_run(run, arguments.tag.as_deref()).map_err(|error| with_hint(&error))?;
    }
    context.say(&format!("Reading, not training: {} curves\n", logs.curves.len()));
    for damage in &logs.damaged {
        context.say(&format!("warning: {damage}; what comes before it is used"));
    }
    let recipe = match arguments.recipe {
        RecipeName::Portable => Recipe::Portable(arguments.smoothing),
        RecipeName::Transfer => Recipe::Transfer,
        RecipeName::SingleTask => Recipe::SingleTask,
        RecipeName::RlFinetuning => Recipe::RlFinetuning,
        RecipeName::MultiTask => Recipe::MultiTask,
        RecipeName::CsiFinetuning => Recipe::CsiFinetuning,
    };
    let options = CurveOptions {
        recipe,
        raw: arguments.raw,
        offsets: arguments.offset.iter().cloned().collect::<BTreeMap<_, _>>(),
        panels: arguments.panel.clone(),
    };
    let experts = experts(context, arguments.experts.as_deref())?;
    let curves =
        LearningCurves::of(&logs, &experts, &options).map_err(|error| with_hint(&error))?;
    let table = logs.table()?;
    let logged = crate::record::to_csv(&table);
    let plan = json!({
        "logged_sha256": files::sha256_hex(logged.as_bytes()),
        "experts": files::sha256_hex(format!("{experts:?}").as_bytes()),
        "recipe": recipe.name(),
        "smoothing": format!("{recipe:?}"),
        "raw": options.raw,
        "offsets": options.offsets,
        "panels": options.panels,
    });
    let (folder, finished) = finish::open_below(context, &arguments.out, "curves", &plan)?;
    let manifest = if let Some(manifest) = finished {
        manifest
    } else {
        let mut output = Output::new(&folder);
        output.tidy("curves", &curves.curve_table()?)?;
        let band = curves.band_table()?;
        if band.row_count() > 0 {
            output.tidy("bands", &band)?;
        }
        output.tidy("portable", &table)?;
        output.figure("curves", &curves.figure().to_svg()?)?;
        output.finish_with(json!([]), curves.document(&logs), json!({}))?
    };
    finish::print(context, &folder, &manifest, &text)?;
    let is_whole = logs.damaged.is_empty();
    Ok(if is_whole { Outcome::Done } else { Outcome::SomethingSkipped })
}

/// The experts' results: those named, else those in the data folder, else none.
fn experts(context: &Context, named: Option<&Path>) -> anyhow::Result<Benchmark> {
    let known = EXPERT_FOLDERS.map(|folder| context.data.join(folder));
    let Some(path) = named.or_else(|| known.iter().map(PathBuf::as_path).find(|p| p.is_dir()))
    else {
        return Ok(Benchmark::new());
    };
    let mut results = Results::default();
    results.add_experts_at(path).map_err(|error| {
        Hinted::new(error.to_string(), "`--experts DIR` takes a folder of `expert_*_results.json`")
    })?;
    Ok(results.experts)
}

/// What to do about it.
fn with_hint(error: &LearningError) -> anyhow::Error {
    use LearningError as E;
    let hint = match error {
        E::NoExpert { .. } => {
            "`--experts DIR` names a folder with results of that expert (`arnold-analyze setup --arnold benchmarks` \
             fetches the published ones); `--raw` draws values as logged"
        }
        E::ExpertValue { .. } => "`--raw` draws values as logged",
        E::NoSeries { .. } => "`--tag TAG` names what to read from event files",
        E::UnknownPanel { .. } => "`--panel` takes one of these",
        E::Curve { .. } => "`--smoothing` takes a shorter window, or `none`",
        E::Band { .. } => "`--recipe multi-task` averages seeds that logged other steps, on a grid",
        E::Nothing => "a table needs rows with a step and a value",
        E::Record(_) => {
            "a run is a folder of event files, an event file, or a CSV with `global_step` and `<environment>/solved`; a \
             table has the columns panel, method, seed, task, stage, step, value, metric"
        }
    };
    Hinted::new(error.to_string(), hint)
}

fn text(result: &Value) -> String {
    let is_relative = result["relative"] == true;
    let unit = if is_relative { "end (%)" } else { "end" };
    let columns = [
        ("panel", Align::Left),
        ("line", Align::Left),
        ("seeds", Align::Right),
        ("points", Align::Right),
        ("last step", Align::Right),
        (unit, Align::Right),
    ];
    let rows: Vec<Vec<String>> = result["lines"]
        .as_array()
        .into_iter()
        .flatten()
        .map(|line| {
            let step = line["last_step"]
                .as_f64()
                .map_or_else(|| "–".to_owned(), |step| render::grouped(step.max(0.0) as u64));
            vec![
                line["panel"].as_str().unwrap_or_default().to_owned(),
                line["series"].as_str().unwrap_or_default().to_owned(),
                line["seeds"].to_string(),
                line["points"].to_string(),
                step,
                render::number(&line["last_value"], if is_relative { 1 } else { 3 }),
            ]
        })
        .collect();
    let (recipe, smoothing) = (&result["recipe"], &result["smoothing"]);
    format!(
        "{}\nRecipe {}: {}\nRead from logs of training; nothing was played\n",
        render::table(&columns, &rows),
        recipe.as_str().unwrap_or_default(),
        smoothing.as_str().unwrap_or_default(),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn runs_smoothings_and_offsets_are_read_or_refused() {
        let run = run_input("obc:pen=a,b/c").unwrap();
        assert_eq!((run.method.as_str(), run.task.as_str(), run.paths.len()), ("obc", "pen", 2));
        for wrong in ["", "obc=a", "obc:pen", ":pen=a", "obc:=a", "obc:pen=", "obc:pen=a,,b"] {
            assert!(run_input(wrong).is_err(), "{wrong}");
        }
        assert_eq!(smoothing("savgol:101"), Ok(Smoothing::SavitzkyGolay(101)));
        assert_eq!(smoothing("trailing:1"), Ok(Smoothing::Trailing(1)));
        for wrong in ["savgol:4", "savgol:1", "trailing:0", "mean:5", "trailing"] {
            assert!(smoothing(wrong).is_err(), "{wrong}");
        }
        assert_eq!(offset("a=5e7"), Ok(("a".to_owned(), 5e7)));
        assert!(offset("a=inf").is_err() && offset("a").is_err());
    }
}

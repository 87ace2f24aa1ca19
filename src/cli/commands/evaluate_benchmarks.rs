//! `evaluate --benchmarks`: the paper's tables, tests and figures of performance from result files. Nothing is played.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::laboratory::PlayArguments;
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::benchmarks::{
    self, BenchmarkError, Capacity, CsiFinetuning, History, MetricMap, Performance, REFERENCE,
    Results, Vocabulary,
};
use crate::files;

/// Options that read results instead of playing.
#[derive(Debug, Args)]
#[command(next_help_heading = "Reading results instead of playing")]
pub struct BenchmarkArguments {
    /// Result files to read: a tree of methods and seeds, a selection (`policies.json`), a result file or a run of
    /// `evaluate`; a single policy may be named, and several of one name are its seeds
    #[arg(long, value_name = "[NAME=]PATH", num_args = 1.., value_parser = named, conflicts_with_all = ["policy", "normaliser", "episodes", "deterministic", "stochastic", "action_noise", "seed", "physics", "threads", "batch"])]
    benchmarks: Vec<(Option<String>, PathBuf)>,
    /// Folder of the experts' results [default: beside the others, else in the data folder]
    #[arg(long, value_name = "DIR", requires = "benchmarks")]
    experts: Option<PathBuf>,
    /// Only these methods
    #[arg(long, value_name = "NAME", num_args = 1.., requires = "benchmarks")]
    method: Vec<String>,
    /// The method that is tested against the others and the experts
    #[arg(long, value_name = "NAME", default_value = REFERENCE, requires = "benchmarks")]
    reference: String,
    /// A seed without a task leaves that cell undefined, and is no error
    #[arg(long, requires = "benchmarks")]
    allow_missing: bool,
    /// What counts as performance of a task
    #[arg(long, value_enum, default_value_t = MetricName::Fraction, requires = "benchmarks")]
    metric_map: MetricName,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum MetricName {
    /// Solved steps / horizon
    Fraction,
    /// The same, but in `reorient` and `relocate` the share of episodes solved at any step, as the radar of the authors'
    /// first release; the printed values are never of this kind
    Radar,
}

impl BenchmarkArguments {
    /// Whether results are to be read.
    #[must_use]
    pub fn are_given(&self) -> bool {
        !self.benchmarks.is_empty()
    }
}

/// `NAME=PATH`, or a path. A name has no slash.
fn named(text: &str) -> Result<(Option<String>, PathBuf), String> {
    match text.split_once('=') {
        Some((name, path)) if !name.contains(['/', '\\']) => {
            if name.is_empty() || path.is_empty() {
                return Err("expected NAME=PATH or a path".to_owned());
            }
            Ok((Some(name.to_owned()), PathBuf::from(path)))
        }
        _ => Ok((None, PathBuf::from(text))),
    }
}

/// Where the experts' results may lie in the data folder.
const EXPERT_FOLDERS: [&str; 3] =
    ["final_benchmarks/expert_policies", "arnold_published/expert_policies", "expert_policies"];

/// Runs the command.
pub fn run(
    context: &Context,
    arguments: &BenchmarkArguments,
    play: &PlayArguments,
) -> anyhow::Result<Outcome> {
    let metric = match arguments.metric_map {
        MetricName::Fraction => MetricMap::Fraction,
        MetricName::Radar => MetricMap::Radar,
    };
    let mut results = Results::measured_by(metric);
    for (name, path) in &arguments.benchmarks {
        results.add(name.as_deref(), path).map_err(|error| with_hint(error, arguments))?;
    }
    add_experts(context, &mut results, arguments)?;
    let tasks: Vec<String> = play.task.iter().filter(|task| *task != "all").cloned().collect();
    results.choose(&tasks, &arguments.method).map_err(|error| with_hint(error, arguments))?;
    let (methods, files) = (results.methods.len(), read_files(&results));
    context.say(&format!("Reading, not playing: {methods} methods, {files} result files\n"));
    for left_out in &results.left_out {
        context.say(&format!("Left out `{}`: {}", left_out.what, left_out.why));
    }
    let performance = Performance::of(&results, &arguments.reference, arguments.allow_missing)
        .map_err(|error| with_hint(error, arguments))?;
    let plan = json!({
        "benchmarks": digest(&results),
        "tasks": results.tasks,
        "reference": arguments.reference,
        "allow_missing": arguments.allow_missing,
        "metric_map": metric.name(),
    });
    let (folder, finished) = finish::open_below(context, play.out(), "evaluate", &plan)?;
    let manifest = if let Some(manifest) = finished {
        manifest
    } else {
        let mut output = Output::new(&folder);
        let document = write(&mut output, &results, &performance)?;
        let left_out = results.left_out.iter().map(|l| json!({"what": l.what, "why": l.why}));
        output.finish_with(left_out.collect(), document, json!({}))?
    };
    finish::print(context, &folder, &manifest, &text)?;
    let is_whole = results.left_out.is_empty();
    Ok(if is_whole { Outcome::Done } else { Outcome::SomethingSkipped })
}

fn add_experts(
    context: &Context,
    results: &mut Results,
    arguments: &BenchmarkArguments,
) -> anyhow::Result<()> {
    let add = |results: &mut Results, path: &Path| {
        results.add_experts_at(path).map_err(|error| with_hint(error, arguments))
    };
    if let Some(path) = &arguments.experts {
        results.experts.clear();
        return add(results, path);
    }
    if results.experts.is_empty() {
        let known = EXPERT_FOLDERS.map(|folder| context.data.join(folder));
        if let Some(path) = known.iter().find(|folder| folder.is_dir()) {
            return add(results, path);
        }
    }
    Ok(())
}

fn read_files(results: &Results) -> usize {
    let several = usize::from(!results.history.is_empty());
    results.methods.values().map(Vec::len).sum::<usize>() + results.csi.len() + several
}

/// A hash of every number that was read, by method and seed.
fn digest(results: &Results) -> Value {
    let hash = |text: String| blake3::hash(text.as_bytes()).to_hex()[..32].to_owned();
    let methods = results.methods.iter().map(|(name, seeds)| {
        let seeds: Vec<String> =
            seeds.iter().map(|seed| hash(format!("{:?}", seed.tasks))).collect();
        (name.clone(), json!(seeds))
    });
    let csi = results.csi.iter().map(|file| (&file.name, file.components, &file.entry));
    json!({
        "experts": hash(format!("{:?}", results.experts)),
        "methods": methods.collect::<serde_json::Map<_, _>>(),
        "csi": hash(format!("{:?}", csi.collect::<Vec<_>>())),
        "history": hash(format!("{:?}", results.history)),
    })
}

/// Writes every table and figure that there is something for, and gives the document.
fn write(
    output: &mut Output<'_>,
    results: &Results,
    performance: &Performance,
) -> anyhow::Result<Value> {
    if !results.experts.is_empty() {
        output.tidy("experts", &benchmarks::expert_table(results)?)?;
        output.figure("experts", &benchmarks::expert_figure(results).to_svg()?)?;
    }
    if let Some(history) = History::of(results) {
        output.tidy("history", &history.table()?)?;
        output.figure("history", &history.figure().to_svg()?)?;
    }
    let mut document = performance.document();
    document["experts"] = benchmarks::expert_document(results);
    document["input"] = json!({"played": false, "result_files": read_files(results)});
    if let Some(finetuning) = CsiFinetuning::of(results)? {
        output.tidy("csi_finetuning_runs", &finetuning.run_table()?)?;
        output.tidy("csi_finetuning", &finetuning.summary_table()?)?;
        output.figure("csi_finetuning", &finetuning.figure().to_svg()?)?;
        document["csi_finetuning"] = finetuning.document();
    }
    if performance.methods.is_empty() {
        return Ok(document);
    }
    output.tidy("seeds", &performance.seed_table(results)?)?;
    output.tidy("families", &performance.family_table()?)?;
    output.tidy("per_task", &performance.task_table()?)?;
    for (name, rows) in [
        ("families.tex", performance.family_rows_latex()),
        ("per_task.tex", performance.task_rows_latex()),
    ] {
        output.written(name, |path| Ok(files::write_atomic(path, rows.as_bytes())?))?;
    }
    if performance.reference.is_some() {
        output.tidy("significance", &performance.test_table()?)?;
        output.tidy("expert_improvement", &performance.improvement_table()?)?;
    }
    if let Some(figure) = performance.bar_figure(results) {
        output.figure("relative_performance", &figure.to_svg()?)?;
    }
    if let Some(figure) = performance.ppo_figure(results) {
        output.figure("ppo_ablation", &figure.to_svg()?)?;
    }
    if let Some(figure) = performance.radar_figure() {
        output.figure("radar", &figure.to_svg()?)?;
    }
    if let Some(capacity) = Capacity::of(results) {
        output.tidy("capacity", &capacity.task_table()?)?;
        output.tidy("capacity_summary", &capacity.summary_table()?)?;
        output.figure("capacity", &capacity.task_figure().to_svg()?)?;
        output.figure("capacity_summary", &capacity.summary_figure().to_svg()?)?;
        document["capacity"] = capacity.document();
    }
    if let Some(vocabulary) = Vocabulary::of(performance, "obc_task_sv", "obc")? {
        output.tidy("vocabulary", &vocabulary.task_table()?)?;
        output.tidy("vocabulary_seeds", &vocabulary.seed_table()?)?;
        output.figure("vocabulary", &vocabulary.figure().to_svg()?)?;
    }
    Ok(document)
}

/// What to do about it.
fn with_hint(error: BenchmarkError, arguments: &BenchmarkArguments) -> anyhow::Error {
    use crate::analysis::performance::PerformanceError::MissingTask;
    use BenchmarkError as E;
    let hint = match &error {
        E::NoExperts => {
            "`--experts DIR` names their folder; `arnold-analyze setup --arnold benchmarks` fetches the published ones"
        }
        E::Performance(MissingTask { .. }) => {
            "`--task NAME…` compares fewer tasks, `--method NAME…` fewer methods; `--allow-missing` leaves such cells \
             undefined"
        }
        E::UnknownMethod { .. } => "`--method` takes one of these",
        E::UnknownTask { .. } => "`--task` takes one of these",
        E::ExpertTwice { .. } => "`--experts DIR` says which are meant",
        E::Record(_) if arguments.benchmarks.is_empty() => return error.into(),
        E::Record(_) => {
            "`--benchmarks` takes a tree `METHOD/SEED/*_results.json` with `expert_policies/`, a selection \
             `policies.json`, a result file, or a run of `evaluate`"
        }
        E::ExpertValue { .. } | E::NoShare { .. } => {
            "`avg_solved_step_frac` is solved steps / horizon, between 0 and 1"
        }
        _ => return error.into(),
    };
    Hinted::new(error.to_string(), hint)
}

/// Short names for the columns of a table 80 characters wide.
fn short(task: &str) -> &str {
    const NAMES: [(&str, &str); 14] = [
        ("hand_index_reach", "Index"),
        ("hand_little_reach", "Little"),
        ("hand_middle_reach", "Middle"),
        ("hand_ring_reach", "Ring"),
        ("hand_thumb_reach", "Thumb"),
        ("elbow_pose", "Elbow"),
        ("baoding_p1_cw", "CW"),
        ("baoding_p1_ccw", "CCW"),
        ("baoding_p2", "harder"),
        ("baoding_p2_overlap", "hard"),
        ("reorient", "Die"),
        ("pen", "Pen"),
        ("relocate", "Reloc."),
        ("kinesis", "Walk"),
    ];
    NAMES.iter().find(|(name, _)| *name == task).map_or(task, |(_, short)| short)
}

/// Columns of a table beside the names.
const ACROSS: usize = 7;

fn text(result: &Value) -> String {
    let mut text = String::new();
    let methods = result["methods"].as_object();
    if methods.is_none_or(serde_json::Map::is_empty) {
        return expert_text(result);
    }
    text += "Relative performance, percent of the expert, by family\n";
    if result["metric_map"] == "radar" {
        text += "Die reorient and Object relocation: share of episodes solved at any step\n";
    }
    text += "\n";
    let families: Vec<String> = methods
        .into_iter()
        .flatten()
        .next()
        .and_then(|(_, method)| method["families"].as_object())
        .map(|families| families.keys().cloned().collect())
        .unwrap_or_default();
    text += &cells(result, "families", &families, &|name| benchmarks::family_label(name), true);
    text += "\nby task\n\n";
    let tasks: Vec<String> = result["tasks"]
        .as_array()
        .into_iter()
        .flatten()
        .filter_map(|task| task.as_str().map(str::to_owned))
        .collect();
    for part in tasks.chunks(ACROSS) {
        text += &cells(result, "tasks", part, &short, false);
        text += "\n";
    }
    if result["reference"].is_string() {
        text += &test_text(result);
        text += &improvement_text(result);
    } else {
        text += "No method is called as `--reference` says, so nothing is tested\n";
    }
    text + "Read from result files; nothing was played\n"
}

/// One row per method; below it s.e.m. and the printed values.
fn cells(
    result: &Value,
    what: &str,
    names: &[String],
    label: &dyn Fn(&str) -> &str,
    with_errors: bool,
) -> String {
    let mut columns: Vec<(&str, Align)> = vec![("method", Align::Left)];
    columns.extend(names.iter().map(|name| (label(name), Align::Right)));
    let mut rows: Vec<Vec<String>> = Vec::new();
    for method in result["methods"].as_object().into_iter().flatten().map(|(_, method)| method) {
        let cell = |name: &String| &method[what][name.as_str()];
        let line = |first: String, value: &dyn Fn(&Value) -> String| -> Vec<String> {
            [first].into_iter().chain(names.iter().map(|name| value(cell(name)))).collect()
        };
        let name = method["label"].as_str().unwrap_or_default().to_owned();
        rows.push(line(name, &|cell| render::number(&cell["mean"], 1)));
        if with_errors {
            let seeds = format!("  ± s.e.m., n = {}", method["seeds"]);
            rows.push(line(seeds, &|cell| render::number(&cell["sem"], 1)));
        }
        if names.iter().any(|name| cell(name)["published"].is_array()) {
            rows.push(line("  printed".to_owned(), &|cell| {
                render::number(&cell["published"][0], 1)
            }));
        }
    }
    render::table(&columns, &rows)
}

fn test_text(result: &Value) -> String {
    let label = reference_label(result);
    let columns = [
        ("against", Align::Left),
        ("W", Align::Right),
        ("p", Align::Right),
        ("p Holm", Align::Right),
        ("r", Align::Right),
        ("printed W", Align::Right),
        ("p Holm", Align::Right),
    ];
    let mut rows = rows_of(&result["tests"], |row| {
        let published = &row["published"];
        vec![
            row["label"].as_str().unwrap_or_default().to_owned(),
            render::number(&row["W"], 0),
            render::probability(&row["p"]),
            render::probability(&row["p_holm"]),
            render::number(&row["rank_biserial"], 3),
            render::number(&published["W"], 0),
            render::probability(&published["p_holm"]),
        ]
    });
    let overall = &result["overall"];
    rows.push(vec![
        "experts (no Holm)".to_owned(),
        render::number(&overall["W"], 0),
        render::probability(&overall["p"]),
        "–".to_owned(),
        render::number(&overall["rank_biserial"], 3),
        render::number(&overall["published"]["W"], 0),
        render::probability(&overall["published"]["p"]),
    ]);
    format!(
        "{label} against the others: Wilcoxon signed rank over tasks, two-sided, zeros\ndropped; unit of \
         replication: task, the mean over its seeds\n\n{}\n",
        render::table(&columns, &rows)
    )
}

fn improvement_text(result: &Value) -> String {
    let label = reference_label(result);
    let columns = [
        ("task", Align::Left),
        ("expert", Align::Right),
        (label.as_str(), Align::Right),
        ("change %", Align::Right),
        ("± s.e.m.", Align::Right),
        ("t", Align::Right),
        ("p Holm", Align::Right),
        ("printed t", Align::Right),
        ("p", Align::Right),
    ];
    let rows = rows_of(&result["improvements"], |row| {
        let published = &row["published"];
        vec![
            short(row["task"].as_str().unwrap_or_default()).to_owned(),
            render::number(&row["expert"], 3),
            render::number(&row["solved_fraction"], 3),
            render::number(&row["improvement"], 2),
            render::number(&row["sem"], 2),
            render::number(&row["t"], 3),
            render::probability(&row["p_holm"]),
            render::number(&published["t"], 3),
            if published["p_is_bound"] == true {
                "<.0001".to_owned()
            } else {
                render::probability(&published["p_holm"])
            },
        ]
    });
    let seeds = &result["improvements"][0]["n_seeds"];
    format!(
        "{label} against the expert of each task: t test over seeds (n = {seeds}), greater,\nHolm over the tasks; \
         unit of replication: seed\n\n{}\n",
        render::table(&columns, &rows)
    )
}

/// A row of a table for every entry of a list.
fn rows_of(list: &Value, row: impl Fn(&Value) -> Vec<String>) -> Vec<Vec<String>> {
    list.as_array().into_iter().flatten().map(row).collect()
}

fn reference_label(result: &Value) -> String {
    let name = result["reference"].as_str().unwrap_or_default();
    result["methods"][name]["label"].as_str().unwrap_or(name).to_owned()
}

fn expert_text(result: &Value) -> String {
    let columns = [
        ("expert of", Align::Left),
        ("solved fraction", Align::Right),
        ("± s.e.m.", Align::Right),
        ("episodes", Align::Right),
        ("printed", Align::Right),
    ];
    let rows = rows_of(&result["experts"], |row| {
        vec![
            row["task"].as_str().unwrap_or_default().to_owned(),
            render::number(&row["solved_fraction"], 4),
            render::number(&row["sem"], 4),
            render::number(&row["n_episodes"], 0),
            render::number(&row["published"], 3),
        ]
    });
    render::table(&columns, &rows) + "\nRead from result files; nothing was played\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_stands_before_a_path_and_a_path_may_hold_an_equals_sign() {
        assert_eq!(named("mine=runs/a"), Ok((Some("mine".to_owned()), "runs/a".into())));
        assert_eq!(named("runs/seed=1"), Ok((None, "runs/seed=1".into())));
        assert!(named("=runs").is_err() && named("mine=").is_err());
    }
}

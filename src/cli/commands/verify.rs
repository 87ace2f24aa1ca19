//! `verify`: does this machine reproduce what the published code recorded?
//!
//! Exit code 0 when everything agrees, 1 when something differs, 3 when all that could be checked agrees and something
//! could not be checked.

use std::path::{Path, PathBuf};

use clap::{Args, Subcommand};
use serde_json::json;

use crate::assets::{Cache, Part, PhysicsVersion};
use crate::cli::context::{Context, Outcome};
use crate::cli::laboratory;
use crate::cli::progress::Progress;
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::verify_traces::{self, TraceError, TraceReport};
use crate::policy::verify::{self, PolicyCheck};
use crate::sim::bodies::Bodies;
use crate::sim::engine::EngineError;
use crate::sim::tasks::{self, Source};

/// Arguments of `verify`.
#[derive(Debug, Args)]
pub struct VerifyArguments {
    #[command(subcommand)]
    what: What,
}

#[derive(Debug, Subcommand)]
enum What {
    /// Replay the recorded episodes found in a folder: state, observation, reward, flags. The walking model is taken from
    /// --data, else from a folder `models` beside the recordings
    Traces {
        /// Folder of `<task>_mj<version>_s<seed>.npz` files, searched with its subfolders
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
    /// Compare policies with the recorded outputs found in a folder
    Policy {
        /// Folder of recorded policy outputs
        #[arg(value_name = "DIR")]
        folder: PathBuf,
    },
}

/// Runs the command.
pub fn run(context: &Context, arguments: &VerifyArguments) -> anyhow::Result<Outcome> {
    match &arguments.what {
        What::Traces { folder } => traces(context, folder),
        What::Policy { folder } => policy(context, folder),
    }
}

fn traces(context: &Context, folder: &Path) -> anyhow::Result<Outcome> {
    let files = verify_traces::find_traces(folder).map_err(|error| {
        Hinted::new(
            error.to_string(),
            "traces are pairs of `<task>_mj<version>_s<seed>.npz` and `.json`",
        )
    })?;
    let cache = Cache::locate();
    let models = laboratory::available(context, &cache, Part::MyoSuite, Cache::myosuite)?;
    let data = data_folder(context, folder);
    let mut libraries = Vec::new();
    for version in PhysicsVersion::ALL {
        if files.iter().any(|file| file.physics == version.as_str()) {
            let library = laboratory::open_library(context, &cache, version)?;
            libraries.push((version, Bodies::new(library, &models, &data)));
        }
    }
    let progress = Progress::start(context, "verify", "traces", files.len() as u64);
    let (mut reports, mut skipped) = (Vec::new(), Vec::new());
    for file in &files {
        let name = file.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        match libraries.iter().find(|(version, _)| version.as_str() == file.physics) {
            None => skipped.push((name, format!("there is no MuJoCo {} here", file.physics))),
            Some((_, bodies)) => match verify_traces::replay(file, bodies) {
                Ok(Some(report)) => reports.push(report),
                Ok(None) => skipped.push((name, format!("`{}` is not a task here", file.task))),
                Err(TraceError::Engine(error @ EngineError::NoModel { .. })) => {
                    skipped.push((name, error.to_string()));
                }
                Err(error) => return Err(error.into()),
            },
        }
        progress.advance(1);
    }
    progress.finish();
    let agree = reports.iter().filter(|report| report.agrees()).count();
    if context.json {
        let entries: Vec<_> = reports.iter().map(trace_document).collect();
        let skipped: Vec<_> =
            skipped.iter().map(|(name, why)| json!({"trace": name, "reason": why})).collect();
        render::print_json(&json!({
            "agree": agree,
            "differ": reports.len() - agree,
            "traces": entries,
            "skipped": skipped,
        }))?;
    } else {
        render::print_text(&trace_table(&reports))?;
        for (name, why) in &skipped {
            context.say(&format!("Skipped {name}: {why}"));
        }
        render::print_text(&format!("\n{agree} of {} traces agree\n", reports.len()))?;
    }
    conclude(agree == reports.len(), !skipped.is_empty(), "traces")
}

/// The data folder, or the `models` folder beside the recordings if only that has the walking model they were made with.
fn data_folder(context: &Context, traces: &Path) -> PathBuf {
    let has_model = |folder: &Path| {
        let mut published = tasks::ALL.iter().filter(|task| task.source == Source::Data);
        published.all(|task| folder.join(task.model).is_file())
    };
    let traces = std::path::absolute(traces).unwrap_or_else(|_| traces.to_path_buf());
    let beside = traces.ancestors().skip(1).take(3).map(|folder| folder.join("models"));
    let mut candidates = std::iter::once(context.data.clone()).chain(beside);
    candidates.find(|folder| has_model(folder.as_path())).unwrap_or_else(|| context.data.clone())
}

fn conclude(agree: bool, skipped: bool, what: &str) -> anyhow::Result<Outcome> {
    if !agree {
        return Err(Hinted::new(
            format!("some {what} differ from the recorded ones"),
            "`arnold-analyze doctor` shows what physics and processor this is",
        ));
    }
    Ok(if skipped { Outcome::SomethingSkipped } else { Outcome::Done })
}

fn trace_document(report: &TraceReport) -> serde_json::Value {
    let mut document = serde_json::to_value(report).unwrap_or_default();
    document["rewards"] = report
        .rewards
        .iter()
        .map(|(name, difference)| (name.clone(), json!(difference)))
        .collect::<serde_json::Map<_, _>>()
        .into();
    document["agrees"] = json!(report.agrees());
    document
}

fn trace_table(reports: &[TraceReport]) -> String {
    let columns = [
        ("trace", Align::Left),
        ("steps", Align::Right),
        ("state", Align::Right),
        ("ctrl ulp", Align::Right),
        ("observation", Align::Right),
        ("largest reward difference", Align::Left),
        ("flags", Align::Left),
        ("words", Align::Left),
        ("", Align::Left),
    ];
    let yes = |condition: bool| if condition { "agree" } else { "DIFFER" }.to_owned();
    let difference = |x: f64| if x == 0.0 { "0".to_owned() } else { format!("{x:.1e}") };
    let rows: Vec<Vec<String>> = reports
        .iter()
        .map(|report| {
            let worst = report.rewards.iter().max_by(|a, b| a.1.total_cmp(&b.1));
            vec![
                report.name.clone(),
                report.steps.to_string(),
                difference(report.state),
                report.excitation_ulp.to_string(),
                difference(report.observation),
                worst.map_or_else(String::new, |(name, x)| format!("{} {name}", difference(*x))),
                yes(report.flags_agree),
                report.words_agree.map_or_else(|| "–".to_owned(), yes),
                if report.agrees() { "ok" } else { "FAILED" }.to_owned(),
            ]
        })
        .collect();
    render::table(&columns, &rows)
}

fn policy(context: &Context, folder: &Path) -> anyhow::Result<Outcome> {
    let checks = verify::verify_folder(folder).map_err(|error| {
        Hinted::new(
            error.to_string(),
            "the golden data's README describes the files: `<name>_model.zip` with `<name>_<task>.npz`, or \
             `baoding_phase1_<case>_mj<version>_s<seed>.npz`",
        )
    })?;
    let passed = |check: &&PolicyCheck| check.outcome == verify::Outcome::Passed;
    let failed = |check: &PolicyCheck| check.outcome == verify::Outcome::Failed;
    let skipped = |check: &PolicyCheck| matches!(check.outcome, verify::Outcome::Skipped(_));
    let word = |check: &PolicyCheck| match &check.outcome {
        verify::Outcome::Passed => "ok".to_owned(),
        verify::Outcome::Failed => "FAILED".to_owned(),
        verify::Outcome::Skipped(why) => format!("skipped: {why}"),
    };
    if context.json {
        let entries: Vec<_> = checks
            .iter()
            .map(|check| {
                json!({
                    "file": check.file,
                    "quantity": check.quantity,
                    "compared": check.compared,
                    "largest_absolute": check.largest_absolute,
                    "largest_relative": check.largest_relative,
                    "tolerance_absolute": check.tolerance.absolute,
                    "tolerance_relative": check.tolerance.relative,
                    "outcome": word(check),
                })
            })
            .collect();
        render::print_json(&json!({
            "agree": checks.iter().filter(passed).count(),
            "differ": checks.iter().filter(|c| failed(c)).count(),
            "checks": entries,
        }))?;
    } else {
        let columns = [
            ("file", Align::Left),
            ("quantity", Align::Left),
            ("numbers", Align::Right),
            ("absolute", Align::Right),
            ("relative", Align::Right),
            ("", Align::Left),
        ];
        let rows: Vec<Vec<String>> = checks
            .iter()
            .map(|check| {
                vec![
                    check.file.clone(),
                    check.quantity.to_owned(),
                    check.compared.to_string(),
                    format!("{:.1e}", check.largest_absolute),
                    format!("{:.1e}", check.largest_relative),
                    word(check),
                ]
            })
            .collect();
        let agree = checks.iter().filter(passed).count();
        render::print_text(&render::table(&columns, &rows))?;
        render::print_text(&format!("\n{agree} of {} checks agree\n", checks.len()))?;
    }
    conclude(!checks.iter().any(failed), checks.iter().any(skipped), "policy outputs")
}

//! `report`: finished runs as one HTML page.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::json;

use crate::cli::context::{Context, Outcome};
use crate::cli::render::{self, Hinted};
use crate::experiment::report::{Report, ReportError};
use crate::files;

/// Arguments of `report`.
#[derive(Debug, Args)]
pub struct ReportArguments {
    /// Folders of finished runs, as `runs/csi-4f3a…`; they follow each other on the page
    #[arg(value_name = "RUN", required = true)]
    runs: Vec<PathBuf>,
    /// The page
    #[arg(long, value_name = "FILE", default_value = "report.html")]
    out: PathBuf,
}

/// Runs the command.
pub fn run(context: &Context, arguments: &ReportArguments) -> anyhow::Result<Outcome> {
    let mut report = Report::default();
    for folder in &arguments.runs {
        report.add(folder).map_err(|error| with_hint(&error))?;
    }
    write(&arguments.out, &report.html())?;
    let left_out: Vec<(&Path, &(String, &str))> = arguments
        .runs
        .iter()
        .zip(&report.sections)
        .flat_map(|(run, section)| section.left_out.iter().map(move |left| (run.as_path(), left)))
        .collect();
    for (run, (name, why)) in &left_out {
        context.say(&format!("Not on the page: `{}`: {why}", run.join(name).display()));
    }
    if context.json {
        let left =
            left_out.iter().map(|(run, (name, why))| json!({"file": run.join(name), "why": why}));
        render::print_json(&json!({
            "command": "report",
            "page": arguments.out,
            "runs": arguments.runs,
            "left_out": left.collect::<Vec<_>>(),
        }))?;
    } else {
        render::print_text(&format!("{}\n", arguments.out.display()))?;
    }
    Ok(if left_out.is_empty() { Outcome::Done } else { Outcome::SomethingSkipped })
}

fn write(out: &Path, html: &str) -> anyhow::Result<()> {
    if let Some(folder) = out.parent().filter(|folder| !folder.as_os_str().is_empty()) {
        files::create_folder(folder)?;
    }
    files::write_atomic(out, html.as_bytes()).map_err(|error| {
        Hinted::new(error.to_string(), "choose a file that you may write with `--out FILE`")
    })
}

/// What to do about it.
fn with_hint(error: &ReportError) -> anyhow::Error {
    let hint = match error {
        ReportError::NoRun { .. } => {
            "give the folder that a command printed at its end; it holds `manifest.json`"
        }
        _ => "make the run again: delete its folder, and give the command that its manifest names",
    };
    Hinted::new(error.to_string(), hint)
}

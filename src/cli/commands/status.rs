//! `status`: how far a sweep is.

use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use clap::Args;
use serde_json::{Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::progress::duration;
use crate::cli::render::{self, Align, Hinted};
use crate::cli::signals;
use crate::experiment::plan::PLAN;
use crate::experiment::slurm;
use crate::experiment::status::Status;
use crate::files;

/// Arguments of `status`.
#[derive(Debug, Args)]
pub struct StatusArguments {
    /// Folder of the sweep; the run folder of a command that was stopped is one too
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Look again every two seconds until everything is played
    #[arg(long)]
    watch: bool,
}

/// Between two looks.
const INTERVAL: Duration = Duration::from_secs(2);
/// One line every 30 s where it cannot be overwritten.
const LOOKS_PER_LINE: usize = 15;
/// A file with one number in it.
const LARGEST_NUMBER: u64 = 64;

/// Runs the command.
pub fn run(context: &Context, arguments: &StatusArguments) -> anyhow::Result<Outcome> {
    let folder = &arguments.folder;
    if !folder.join(PLAN).exists() {
        return Err(Hinted::new(
            format!("there is no plan in `{}`", folder.display()),
            "a sweep has one until its results are there: `arnold-analyze plan --out DIR COMMAND…`",
        ));
    }
    if arguments.watch {
        watch(context, folder)?;
    }
    print(context, folder)?;
    Ok(Outcome::Done)
}

/// Says how far it is, over and over: in place on a terminal, in a line now and then elsewhere.
fn watch(context: &Context, folder: &Path) -> anyhow::Result<()> {
    signals::listen()?;
    for look in 0.. {
        let status = read(folder)?;
        if status.missing == 0 || !signals::go_on() {
            break;
        }
        if context.interactive && !context.quiet {
            eprint!("\r\x1b[2K{}", sentence(&status));
        } else if look % LOOKS_PER_LINE == 0 {
            context.say(&sentence(&status));
        }
        std::thread::sleep(INTERVAL);
    }
    if context.interactive && !context.quiet {
        eprint!("\r\x1b[2K");
    }
    Ok(())
}

/// Prints how far the sweep in `folder` is.
pub fn print(context: &Context, folder: &Path) -> anyhow::Result<()> {
    let status = read(folder)?;
    let queue = queue(folder);
    if context.json {
        let mut document = json!({"folder": folder, "slurm": queue});
        if let (Some(into), Value::Object(status)) =
            (document.as_object_mut(), serde_json::to_value(&status)?)
        {
            into.extend(status);
        }
        return render::print_json(&document);
    }
    render::print_text(&(table(&status) + "\n" + &sentence(&status) + "\n" + &jobs(&queue)))
}

fn read(folder: &Path) -> anyhow::Result<Status> {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).map_or(0, |since| since.as_secs());
    let shards = number_in(&folder.join(slurm::FOLDER).join(slurm::SHARDS)).unwrap_or(0);
    Ok(Status::read(folder, usize::try_from(shards)?, now)?)
}

/// The number that a file holds.
fn number_in(path: &Path) -> Option<u64> {
    let bytes = files::read_bounded(path, LARGEST_NUMBER).ok()?;
    std::str::from_utf8(&bytes).ok()?.trim().parse().ok()
}

/// The states of the array's jobs in Slurm's queue, each with its count; nothing where there is no Slurm, or no job.
fn queue(folder: &Path) -> Value {
    let job = number_in(&folder.join(slurm::FOLDER).join(slurm::JOB));
    let states = job.and_then(|job| {
        let job = job.to_string();
        let output = Command::new("squeue")
            .args(["--noheader", "--array", "--format=%T", "--jobs", &job])
            .output();
        let output = output.ok()?;
        let mut states = std::collections::BTreeMap::<String, usize>::new();
        for state in String::from_utf8_lossy(&output.stdout).split_whitespace() {
            *states.entry(files::printable(state).to_lowercase()).or_default() += 1;
        }
        Some(json!({"job": job, "states": states}))
    });
    states.unwrap_or(Value::Null)
}

fn jobs(queue: &Value) -> String {
    let Some(job) = queue["job"].as_str() else { return String::new() };
    let states = queue["states"].as_object().into_iter().flatten();
    let states: Vec<String> = states.map(|(state, count)| format!("{count} {state}")).collect();
    let states = if states.is_empty() { "none in the queue".to_owned() } else { states.join(", ") };
    format!("Slurm job {job}: {states}\n")
}

/// One line that says it all.
fn sentence(status: &Status) -> String {
    let Status { planned, done, missing, failed, twice, different, .. } = status;
    let mut text = format!("{done} of {planned} episodes done, {missing} missing, {failed} failed");
    if *twice > 0 {
        text.extend([format!(", {twice} played twice")]);
    }
    if *different > 0 {
        text.extend([format!(" ({different} of them with another result: other machines)")]);
    }
    match (status.rate, status.seconds_left, status.seconds_since_last) {
        (Some(rate), Some(left), _) if *missing > 0 => {
            text.extend([format!("; {rate:.1} per s, {} left", duration(left))]);
        }
        (None, _, Some(since)) if *missing > 0 => {
            text.extend([format!("; the last one ended {} ago", duration(since as f64))]);
        }
        _ => {}
    }
    text
}

fn table(status: &Status) -> String {
    let columns = [
        ("stage", Align::Right),
        ("task", Align::Left),
        ("done", Align::Right),
        ("of", Align::Right),
    ];
    let row = |stage: String, task: String, done: usize, planned: usize| {
        vec![stage, task, done.to_string(), planned.to_string()]
    };
    let tasks = status.tasks.iter();
    let mut rows: Vec<_> = tasks
        .map(|share| row(share.stage.to_string(), share.task.clone(), share.done, share.planned))
        .collect();
    for (place, share) in status.shards.iter().enumerate() {
        let name = format!("shard {}/{}", place + 1, status.shards.len());
        rows.push(row(String::new(), name, share.done, share.planned));
    }
    render::table(&columns, &rows)
}

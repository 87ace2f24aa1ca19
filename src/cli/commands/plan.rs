//! `plan`: the episodes of another command as a folder that many can work on.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::json;

use crate::cli::context::{Context, Outcome};
use crate::cli::render::{self, Hinted};
use crate::cli::replay;
use crate::cli::sweep::{Assignment, Purpose};
use crate::experiment::plan::{PLAN, Plan};
use crate::experiment::slurm::{self, Cluster, Place};
use crate::files;

/// Arguments of `plan`.
#[derive(Debug, Args)]
pub struct PlanArguments {
    /// Folder of the sweep
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Also write the scripts for a cluster
    #[arg(long, value_name = "SCHEDULER", value_enum)]
    emit: Option<Scheduler>,
    /// Shards that the scripts cut the sweep into
    #[arg(long, value_name = "N", default_value_t = 10, value_parser = count, requires = "emit")]
    shards: usize,
    /// Cores of a shard
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = count, requires = "emit")]
    cores: usize,
    /// Partition of the cluster
    #[arg(long, value_name = "NAME", value_parser = plain, requires = "emit")]
    partition: Option<String>,
    /// Time limit of a shard, as Slurm writes it, e.g. `04:00:00`
    #[arg(long, value_name = "TIME", value_parser = plain, requires = "emit")]
    time: Option<String>,
    /// Shards at work at the same time
    #[arg(long, value_name = "N", value_parser = count, requires = "emit")]
    array_limit: Option<usize>,
    /// The command to plan with all its options, e.g. `csi --task all`; or another sweep's `plan.json`, for its command
    #[arg(
        value_name = "COMMAND|FILE",
        required = true,
        trailing_var_arg = true,
        allow_hyphen_values = true
    )]
    command: Vec<String>,
}

/// What scripts are written for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Scheduler {
    /// Slurm: a job array and a job that gathers
    Sbatch,
}

fn count(text: &str) -> Result<usize, String> {
    match text.parse::<usize>() {
        Ok(number @ 1..=100_000) => Ok(number),
        _ => Err("expected a whole number from 1 to 100000".to_owned()),
    }
}

/// A word that means nothing to a shell.
fn plain(text: &str) -> Result<String, String> {
    let allowed = |c: char| c.is_ascii_alphanumeric() || "-_:.,".contains(c);
    if !text.is_empty() && text.chars().all(allowed) {
        Ok(text.to_owned())
    } else {
        Err("expected letters, digits and - _ : . ,".to_owned())
    }
}

/// Runs the command.
pub fn run(context: &Context, arguments: &PlanArguments) -> anyhow::Result<Outcome> {
    let folder = std::path::absolute(&arguments.out)?;
    let words = match &arguments.command[..] {
        [file] if std::path::Path::new(file).is_file() => {
            let beside = std::path::absolute(file)?;
            let folder = beside.parent().unwrap_or(&beside);
            Plan::read(folder)
                .map_err(|error| Hinted::new(error.to_string(), FILE_HINT))?
                .typed
                .words
        }
        words => words.to_vec(),
    };
    let assignment = Assignment { folder: folder.clone(), purpose: Purpose::Plan };
    replay::run(context, words, assignment)?;
    let plan = Plan::read(&folder)?;
    let mut scripts = Vec::new();
    if arguments.emit == Some(Scheduler::Sbatch) {
        let program = std::env::current_exe()?;
        let place = Place {
            program: &program,
            sweep: &folder,
            folder: &plan.typed.folder,
            name: plan.typed.words.first().map_or("sweep", String::as_str),
        };
        let cluster = Cluster {
            shards: arguments.shards,
            partition: arguments.partition.clone(),
            time: arguments.time.clone(),
            array_limit: arguments.array_limit,
            cores: arguments.cores,
        };
        for (name, text) in slurm::scripts(&place, &cluster) {
            let path = folder.join(slurm::FOLDER).join(name);
            files::write_atomic(&path, text.as_bytes())?;
            scripts.push(path);
        }
        let path = folder.join(slurm::FOLDER).join(slurm::SHARDS);
        files::write_atomic(&path, format!("{}\n", arguments.shards).as_bytes())?;
    }
    let (episodes, stages) = (plan.episode_count(), plan.stage_count());
    if context.json {
        render::print_json(&json!({
            "folder": folder,
            "key": plan.key,
            "episodes": episodes,
            "stages": stages,
            "scripts": scripts,
        }))?;
    } else {
        let named = arguments.out.display();
        let mut text = format!("{episodes} episodes in {stages} stages: {named}/{PLAN}\n\n");
        match scripts.last() {
            Some(submit) => text.extend([format!("bash {}\n", submit.display())]),
            None => text.extend([format!("arnold-analyze work {named} --shard 1/N\n")]),
        }
        text.extend([format!(
            "arnold-analyze status {named} --watch\narnold-analyze gather {named}\n"
        )]);
        render::print_text(&text)?;
    }
    Ok(Outcome::Done)
}

const FILE_HINT: &str =
    "give a command with its options, e.g. `csi --task all`, or the `plan.json` of another sweep";

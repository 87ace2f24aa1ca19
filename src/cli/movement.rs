//! Where the movements of an analysis come from: recordings, or a policy that is played for it.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use crate::assets;
use crate::experiment::movement::Movements;
use crate::experiment::recording::{self, Source};
use crate::experiment::run_folder::{Manifest, RunFolder};
use crate::experiment::seed;
use crate::figure::Provenance;
use crate::files;
use crate::record::{self, names};
use crate::sim::rollout::{self, Channels, RolloutPlan};
use crate::sim::tasks;

use super::context::Context;
use super::finish::{self, Output};
use super::laboratory::{self, Defaults, Laboratory, PlayArguments};
use super::progress::Progress;
use super::render::Hinted;

/// Options of every command that analyses movements.
#[derive(Debug, Clone, Args)]
pub struct MovementArguments {
    /// Recordings to analyse, instead of playing: a name for the policy, and a file or a folder of files, one per task;
    /// may be repeated. Any format that `rollout`, `convert` or upstream's recorder writes. `--task` chooses among them,
    /// `--episodes` is the number that each must have
    #[arg(long, value_name = "NAME=PATH", num_args = 1.., value_parser = labelled, conflicts_with_all = ["policy", "normaliser", "deterministic", "stochastic"])]
    recording: Vec<Labelled>,
    #[command(flatten)]
    play: PlayArguments,
}

/// A policy's name and where its recordings are.
#[derive(Debug, Clone, PartialEq, Eq)]
struct Labelled {
    policy: String,
    path: PathBuf,
}

fn labelled(text: &str) -> Result<Labelled, String> {
    match text.split_once('=') {
        Some((policy, path)) if !policy.trim().is_empty() && !path.is_empty() => {
            Ok(Labelled { policy: policy.trim().to_owned(), path: path.into() })
        }
        _ => Err("expected a name and a path, e.g. `expert=runs/expert/pen.parquet`".to_owned()),
    }
}

/// A recording that will be read.
#[derive(Debug)]
struct File {
    policy: String,
    path: PathBuf,
    task: String,
    episodes: usize,
    sha256: String,
}

enum Origin {
    Recorded(Vec<File>),
    Played(Box<Laboratory>),
}

/// Movements that can be had, one policy and task after the other.
pub struct Movement {
    origin: Origin,
    /// Episodes per policy and task.
    pub episodes: usize,
    out: PathBuf,
}

impl Movement {
    /// Finds the recordings, or opens the policy. Tells the person what was found.
    pub fn open(
        context: &Context,
        arguments: &MovementArguments,
        defaults: Defaults,
    ) -> anyhow::Result<Self> {
        let MovementArguments { recording, play } = arguments;
        if recording.is_empty() {
            let laboratory = Laboratory::open(context, play, defaults)?;
            let (episodes, out) = (laboratory.episodes, laboratory.out.clone());
            return Ok(Self { origin: Origin::Played(Box::new(laboratory)), episodes, out });
        }
        let wanted: Vec<&str> = match play.task.as_slice() {
            [] => Vec::new(),
            words => laboratory::named_tasks(words)?.tasks.iter().map(|task| task.name).collect(),
        };
        let files = find(recording, &wanted)?;
        let mut policies: Vec<&str> = files.iter().map(|file| file.policy.as_str()).collect();
        policies.dedup();
        for policy in policies {
            let tasks = files.iter().filter(|file| file.policy == policy);
            let tasks: Vec<&str> = tasks.map(|file| file.task.as_str()).collect();
            context.say(&format!("Recordings of `{policy}`: {}", tasks.join(", ")));
        }
        context.say("");
        Ok(Self {
            origin: Origin::Recorded(files),
            episodes: play.episodes.map_or(defaults.episodes, Into::into),
            out: play.out.clone(),
        })
    }

    /// Everything here that decides a result, for the run's key: of a recording its content, not where it lies.
    #[must_use]
    pub fn decides(&self) -> Value {
        match &self.origin {
            Origin::Recorded(files) => {
                let of = |file: &File| json!({"policy": file.policy, "task": file.task, "sha256": file.sha256});
                json!({"recordings": files.iter().map(of).collect::<Vec<_>>(), "episodes": self.episodes})
            }
            Origin::Played(laboratory) => laboratory.decides(),
        }
    }

    /// What is analysed, for the result document.
    #[must_use]
    pub fn document(&self) -> Value {
        match &self.origin {
            Origin::Recorded(files) => {
                let of = |file: &File| {
                    json!({
                        "policy": file.policy,
                        "task": file.task,
                        "file": file.path.display().to_string(),
                        "episodes": file.episodes,
                    })
                };
                json!({"recordings": files.iter().map(of).collect::<Vec<_>>()})
            }
            Origin::Played(_) => json!({"played": self.decides()}),
        }
    }

    /// Opens the run's folder; its manifest, if this very run was finished before.
    pub fn run_folder(
        &self,
        context: &Context,
        command: &str,
        plan: &Value,
    ) -> anyhow::Result<(RunFolder, Option<Manifest>)> {
        finish::open_below(context, &self.out, command, plan)
    }

    /// Hands every policy's movements in every task to `take`, one after the other; how long that took, in seconds.
    pub fn each(
        &self,
        context: &Context,
        command: &str,
        mut take: impl FnMut(&Movements) -> anyhow::Result<()>,
    ) -> anyhow::Result<f64> {
        let mut take = |movements: &Movements| {
            if movements.diverged_steps > 0 {
                context.say(&format!(
                    "warning: the physics of `{}` diverged in {} steps",
                    movements.task, movements.diverged_steps
                ));
            }
            take(movements)
        };
        match &self.origin {
            Origin::Recorded(files) => {
                let progress = Progress::start(context, command, "recordings", files.len() as u64);
                for file in files {
                    take(&read(file)?)?;
                    progress.advance(1);
                }
                Ok(progress.finish())
            }
            Origin::Played(laboratory) => play(context, command, laboratory, take),
        }
    }

    /// Writes the manifest.
    pub fn finish(
        &self,
        output: Output<'_>,
        mut result: Value,
        seconds: f64,
    ) -> anyhow::Result<Manifest> {
        result["input"] = self.document();
        Ok(match &self.origin {
            Origin::Played(laboratory) => output.finish(laboratory, result, seconds)?,
            Origin::Recorded(_) => output.finish_with(
                json!([]),
                result,
                json!({
                    "platform": assets::platform::describe_here(),
                    "seconds": seconds,
                    "command_line": std::env::args().collect::<Vec<_>>().join(" "),
                }),
            )?,
        })
    }

    /// Where the figures say they come from.
    #[must_use]
    pub fn provenance(&self) -> Provenance {
        match &self.origin {
            Origin::Played(laboratory) => finish::provenance(laboratory),
            Origin::Recorded(files) => {
                let mut policies: Vec<&str> = files.iter().map(|file| &*file.policy).collect();
                policies.dedup();
                Provenance { physics: "as recorded".to_owned(), policy: policies.join(", ") }
            }
        }
    }
}

/// The recordings of `wanted` tasks (all if there are none), by policy as typed and by task in the paper's order.
fn find(recordings: &[Labelled], wanted: &[&str]) -> anyhow::Result<Vec<File>> {
    let mut found: Vec<File> = Vec::new();
    for Labelled { policy, path } in recordings {
        for path in files_in(path)? {
            let summary = record::summarise(&path).map_err(|error| hinted(&error))?;
            let task = summary.about.task;
            if !wanted.is_empty() && !wanted.contains(&task.as_str()) {
                continue;
            }
            if let Some(other) = found.iter().find(|f| f.policy == *policy && f.task == task) {
                let (one, two) = (other.path.display(), path.display());
                return Err(Hinted::new(
                    format!("two recordings of `{policy}` in `{task}`: `{one}` and `{two}`"),
                    "give one of them another name, or leave it out",
                ));
            }
            let (episodes, sha256) = (summary.episodes.len(), files::sha256_of_file(&path)?);
            found.push(File { policy: policy.clone(), path, task, episodes, sha256 });
        }
    }
    if found.is_empty() {
        let tasks = wanted.join(", ");
        return Err(Hinted::new(
            format!("there is no recording of {tasks} among those named"),
            "leave `--task` out for all that there are",
        ));
    }
    let policy = |file: &File| recordings.iter().position(|l| l.policy == file.policy);
    let task = |file: &File| tasks::every().position(|task| task.name == file.task);
    found.sort_by_key(|file| (policy(file), task(file).unwrap_or(usize::MAX), file.task.clone()));
    Ok(found)
}

/// `path`, or the recordings in it if it is a folder.
fn files_in(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
    if !path.is_dir() {
        return Ok(vec![path.to_path_buf()]);
    }
    let mut inside = files::list(path)?;
    inside.retain(|path| {
        let known =
            path.extension().is_some_and(|e| ["h5", "mcap", "parquet"].iter().any(|k| e == *k));
        known && path.is_file()
    });
    if inside.is_empty() {
        return Err(Hinted::new(
            format!("there is no recording in `{}`", path.display()),
            "recordings end in `.parquet`, `.mcap` or `.h5`; `rollout` makes them",
        ));
    }
    Ok(inside)
}

fn read(file: &File) -> anyhow::Result<Movements> {
    let opened = record::read_recording(&file.path).map_err(|error| hinted(&error))?;
    Movements::of(&file.policy, &opened.recording).map_err(|error| {
        Hinted::new(
            format!("{error}, in `{}`", file.path.display()),
            format!(
                "`{}` and `{}` are needed; upstream calls them `{}` and `{}`",
                names::ACTION,
                names::JOINT,
                names::to_upstream(names::ACTION),
                names::to_upstream(names::JOINT)
            ),
        )
    })
}

fn play(
    context: &Context,
    command: &str,
    laboratory: &Laboratory,
    mut take: impl FnMut(&Movements) -> anyhow::Result<()>,
) -> anyhow::Result<f64> {
    let total = laboratory.tasks.len() * laboratory.episodes;
    let progress = Progress::start(context, command, "episodes", total as u64);
    for task in &laboratory.tasks {
        let plan = RolloutPlan { channels: Channels::All, ..laboratory.plan(task) };
        let specs: Vec<_> = (0..laboratory.episodes)
            .map(|episode| seed::episode(laboratory.seed, task.name, episode, None))
            .collect();
        let episodes = rollout::play(&laboratory.machine, &plan, &specs, &|_| progress.advance(1))?;
        let columns = rollout::channel_names(&laboratory.machine, task)?;
        let source = Source {
            task,
            policy: &laboratory.policy.name,
            mode: laboratory.mode,
            seed: laboratory.seed,
            metadata: std::collections::BTreeMap::new(),
        };
        let recording = recording::recording(source, &columns, episodes);
        take(&Movements::of(&laboratory.policy.name, &recording)?)?;
    }
    Ok(progress.finish())
}

fn hinted(error: &record::RecordError) -> anyhow::Error {
    Hinted::new(
        error.to_string(),
        "give recordings that `rollout` or `convert` wrote, or upstream's; `arnold-analyze inspect FILE` says what a file is",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_has_a_name_and_a_path_that_may_hold_what_it_likes() {
        let found = labelled("Multi-task OBC=a b/c=d.h5").unwrap();
        assert_eq!((found.policy.as_str(), found.path), ("Multi-task OBC", "a b/c=d.h5".into()));
        for wrong in ["", "pen.h5", "=pen.h5", "expert=", " =x"] {
            assert!(labelled(wrong).is_err(), "{wrong}");
        }
    }
}

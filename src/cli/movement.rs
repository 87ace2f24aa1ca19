//! Where the movements of an analysis come from: recordings, or a policy that is played for it.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Value, json};

use crate::assets;
use crate::experiment::ExperimentError;
use crate::experiment::movement::Movements;
use crate::experiment::recording;
use crate::experiment::run_folder::{Manifest, RunFolder};
use crate::figure::Provenance;
use crate::files;
use crate::record::{self, Recording, names};
use crate::sim::tasks;

use super::context::Context;
use super::finish::{self, Output};
use super::laboratory::{self, Defaults, Laboratory, PlayArguments};
use super::progress::Progress;
use super::render::Hinted;
use super::sweep;

/// Options of every command that analyses movements.
#[derive(Debug, Clone, Args)]
pub struct MovementArguments {
    /// Recordings to analyse, instead of playing: a name for the policy (else the recording's own), and a file or a folder
    /// of files, one per task; may be repeated. Any format that `rollout`, `convert` or upstream's recorder writes. `--task`
    /// chooses among them, `--episodes` is the number that each must have
    #[arg(long, value_name = "[NAME=]PATH", num_args = 1.., value_parser = labelled, conflicts_with_all = ["policy", "normaliser", "deterministic", "stochastic"])]
    recording: Vec<Labelled>,
    /// The same from upstream's `signals.json`: the recordings that it lists for this analysis
    #[arg(long, value_name = "FILE", conflicts_with_all = ["recording", "policy", "normaliser", "deterministic", "stochastic"])]
    selection: Option<PathBuf>,
    /// Which of its analyses [default: the one of this command]
    #[arg(long, value_name = "NAME", requires = "selection")]
    analysis: Option<String>,
    /// Folder of the recordings that it lists [default: `analysis/signals` or `activations` in the data folder]
    #[arg(long, value_name = "DIR", requires = "selection")]
    signals: Option<PathBuf>,
    #[command(flatten)]
    play: PlayArguments,
}

impl MovementArguments {
    /// Whether a recording or a policy was named.
    #[must_use]
    pub fn names_something(&self) -> bool {
        !self.recording.is_empty() || self.selection.is_some() || self.play.names_policy()
    }

    /// Folder for results.
    #[must_use]
    pub fn out(&self) -> &Path {
        self.play.out()
    }
}

/// A policy's name, if one was typed, and where its recordings are.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Labelled {
    pub(super) policy: Option<String>,
    pub(super) path: PathBuf,
}

/// What stands before the first `=` is the name.
pub(super) fn labelled(text: &str) -> Result<Labelled, String> {
    let (policy, path) = match text.split_once('=') {
        Some((policy, path)) => (Some(policy.trim().to_owned()), path),
        None => (None, text),
    };
    if path.is_empty() || policy.as_ref().is_some_and(String::is_empty) {
        return Err("expected a path, or a name and a path, e.g. `expert=runs/expert/pen.parquet`"
            .to_owned());
    }
    Ok(Labelled { policy, path: path.into() })
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
    /// Worker threads.
    pub threads: usize,
    out: PathBuf,
}

impl Movement {
    /// Finds the recordings, or opens the policy. Tells the person what was found. `analysis` is what upstream's selection
    /// calls this one.
    pub fn open(
        context: &Context,
        arguments: &MovementArguments,
        defaults: Defaults,
        analysis: &str,
    ) -> anyhow::Result<Self> {
        let play = &arguments.play;
        let (listed, episodes) = match &arguments.selection {
            Some(file) => selected(context, arguments, file, analysis)?,
            None => (arguments.recording.clone(), defaults.episodes),
        };
        if listed.is_empty() {
            let laboratory = Laboratory::open(context, play, defaults)?;
            let (episodes, out) = (laboratory.episodes, laboratory.out.clone());
            let origin = Origin::Played(Box::new(laboratory));
            return Ok(Self { origin, episodes, threads: play.threads(), out });
        }
        let wanted: Vec<&str> = match play.task.as_slice() {
            [] => Vec::new(),
            words => laboratory::named_tasks(words)?.tasks.iter().map(|task| task.name).collect(),
        };
        let files = find(&listed, &wanted)?;
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
            episodes: play.episodes.map_or(episodes, Into::into),
            threads: play.threads(),
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

    /// Hands every policy's movements in every task to `take`, one after the other; how long that took, in seconds, or
    /// nothing if only a part of the playing was to be done.
    pub fn each(
        &self,
        context: &Context,
        folder: &RunFolder,
        mut take: impl FnMut(&Movements) -> anyhow::Result<()>,
    ) -> anyhow::Result<Option<f64>> {
        let needed = [names::ACTION, names::JOINT];
        self.each_read(context, folder, &needed, Movements::of, |movements| take(&movements))
    }

    /// Lets `read` make something of every policy's recording of every task, one after the other, and hands it to `take`;
    /// how long that took, in seconds, or nothing if only a part of the playing was to be done. `needed` are the channels
    /// that a hint names where one is missing.
    pub fn each_read<T>(
        &self,
        context: &Context,
        folder: &RunFolder,
        needed: &[&str],
        read: impl Fn(&str, &Recording) -> Result<T, ExperimentError>,
        mut take: impl FnMut(T) -> anyhow::Result<()>,
    ) -> anyhow::Result<Option<f64>> {
        match &self.origin {
            Origin::Recorded(files) => {
                sweep::nothing_to_play(context)?;
                let total = files.len() as u64;
                let progress = Progress::start(context, folder.command(), "recordings", total);
                for file in files {
                    let opened =
                        record::read_recording(&file.path).map_err(|error| hinted(&error))?;
                    say_diverged(context, &opened.recording);
                    let read = read(&file.policy, &opened.recording)
                        .map_err(|error| unusable(&error, Some(&file.path), needed))?;
                    take(read)?;
                    progress.advance(1);
                }
                Ok(Some(progress.finish()))
            }
            Origin::Played(laboratory) => {
                let (laboratory, arms) = (laboratory.as_ref(), laboratory.recorded_arms());
                let played = sweep::play(context, folder, laboratory, laboratory, arms)?;
                let Some((played, seconds)) = played else { return Ok(None) };
                for (place, task) in laboratory.tasks.iter().enumerate() {
                    let (columns, episodes) = laboratory.recorded(&played, place)?;
                    let recording =
                        recording::recording(laboratory.source(task), &columns, episodes);
                    say_diverged(context, &recording);
                    let read = read(&laboratory.policy.name, &recording)
                        .map_err(|error| unusable(&error, None, needed))?;
                    take(read)?;
                }
                Ok(Some(seconds))
            }
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

/// Where the recordings of a selection may lie in the data folder.
const SIGNAL_FOLDERS: [&str; 2] = ["analysis/signals", "activations"];

/// What upstream's selection lists for an analysis, and how many episodes each recording must have.
fn selected(
    context: &Context,
    arguments: &MovementArguments,
    file: &Path,
    analysis: &str,
) -> anyhow::Result<(Vec<Labelled>, usize)> {
    let known = SIGNAL_FOLDERS.map(|folder| context.data.join(folder));
    let there = known.iter().find(|folder| folder.is_dir()).unwrap_or(&known[0]);
    let signals = arguments.signals.as_ref().unwrap_or(there);
    let hint =
        "`--selection` takes upstream's `signals.json`; `--analysis NAME` says which part of it";
    let selection = record::read_signal_selection(file)
        .map_err(|error| Hinted::new(error.to_string(), hint))?;
    let analysis = arguments.analysis.as_deref().unwrap_or(analysis);
    let found = selection
        .recordings(analysis, signals, file)
        .map_err(|error| Hinted::new(error.to_string(), hint))?;
    if let Some(missing) = found.iter().find(|signal| !signal.path.is_file()) {
        return Err(Hinted::new(
            format!("the selected recording `{}` is not there", missing.path.display()),
            "`--signals DIR` names the folder of `<policy>/<task>.h5`",
        ));
    }
    if found.is_empty() {
        let message = format!("`{analysis}` of `{}` lists no recording", file.display());
        return Err(Hinted::new(message, hint));
    }
    let listed = found
        .into_iter()
        .map(|signal| Labelled { policy: Some(signal.policy), path: signal.path })
        .collect();
    Ok((listed, selection.episodes))
}

/// The recordings of `wanted` tasks (all if there are none), by policy as typed and by task in the paper's order.
fn find(recordings: &[Labelled], wanted: &[&str]) -> anyhow::Result<Vec<File>> {
    let mut found: Vec<File> = Vec::new();
    for Labelled { policy, path } in recordings {
        for path in files_in(path)? {
            let summary = record::summarise(&path).map_err(|error| hinted(&error))?;
            let task = summary.about.task;
            let policy = policy.clone().unwrap_or_else(|| own_name(&summary.about.policy, &path));
            if !wanted.is_empty() && !wanted.contains(&task.as_str()) {
                continue;
            }
            if let Some(other) = found.iter().find(|f| f.policy == policy && f.task == task) {
                let (one, two) = (other.path.display(), path.display());
                return Err(Hinted::new(
                    format!("two recordings of `{policy}` in `{task}`: `{one}` and `{two}`"),
                    "give one of them another name, or leave it out",
                ));
            }
            let (episodes, sha256) = (summary.episodes.len(), files::sha256_of_file(&path)?);
            found.push(File { policy, path, task, episodes, sha256 });
        }
    }
    if found.is_empty() {
        let tasks = wanted.join(", ");
        return Err(Hinted::new(
            format!("there is no recording of {tasks} among those named"),
            "leave `--task` out for all that there are",
        ));
    }
    let mut policies: Vec<String> = found.iter().map(|file| file.policy.clone()).collect();
    let mut seen = BTreeSet::new();
    policies.retain(|policy| seen.insert(policy.clone()));
    let policy = |file: &File| policies.iter().position(|policy| *policy == file.policy);
    let task = |file: &File| tasks::every().position(|task| task.name == file.task);
    found.sort_by_key(|file| (policy(file), task(file).unwrap_or(usize::MAX), file.task.clone()));
    Ok(found)
}

/// What a recording calls its policy, else the file's name.
pub(super) fn own_name(policy: &str, path: &Path) -> String {
    if !policy.trim().is_empty() {
        return policy.trim().to_owned();
    }
    path.file_stem().unwrap_or_default().to_string_lossy().into_owned()
}

/// `path`, or the recordings in it if it is a folder.
pub(super) fn files_in(path: &Path) -> anyhow::Result<Vec<PathBuf>> {
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

fn say_diverged(context: &Context, recording: &Recording) {
    let diverged = recording.episodes.iter().filter_map(|e| e.facts.diverged_steps);
    let diverged: usize = diverged.sum();
    if diverged > 0 {
        let task = &recording.about.task;
        context.say(&format!("warning: the physics of `{task}` diverged in {diverged} steps"));
    }
}

/// A recording that cannot be analysed, and what to do about it.
fn unusable(error: &ExperimentError, path: Option<&Path>, needed: &[&str]) -> anyhow::Error {
    let message = match path {
        Some(path) => format!("{error}, in `{}`", path.display()),
        None => error.to_string(),
    };
    let hint = match error {
        ExperimentError::EpisodeCount { .. } => {
            "`--episodes N` says how many episodes each recording must have".to_owned()
        }
        ExperimentError::SuccessCount { .. } => {
            "record more episodes, or ask for fewer with `--successful N`".to_owned()
        }
        ExperimentError::NoChannel { .. } => {
            let quoted = |of: fn(&str) -> &str| {
                let names = needed.iter().map(|name| format!("`{}`", of(name)));
                names.collect::<Vec<_>>().join(" and ")
            };
            let verb = if needed.len() == 1 { "is" } else { "are" };
            let (ours, theirs) = (quoted(|name| name), quoted(names::to_upstream));
            format!("{ours} {verb} needed; upstream calls them {theirs}")
        }
        _ => {
            "`arnold-analyze inspect FILE` shows what a recording holds; leave the damaged one out"
                .to_owned()
        }
    };
    Hinted::new(message, hint)
}

pub(super) fn hinted(error: &record::RecordError) -> anyhow::Error {
    Hinted::new(
        error.to_string(),
        "give recordings that `rollout` or `convert` wrote, or upstream's; `arnold-analyze inspect FILE` says what a file is",
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_recording_has_a_path_and_perhaps_a_name_before_the_first_sign() {
        let found = labelled("Multi-task OBC=a b/c=d.h5").unwrap();
        let name = Some("Multi-task OBC");
        assert_eq!((found.policy.as_deref(), found.path), (name, "a b/c=d.h5".into()));
        let found = labelled("runs/pen.h5").unwrap();
        assert_eq!((found.policy, found.path), (None, "runs/pen.h5".into()));
        for wrong in ["", "=pen.h5", "expert=", " =x"] {
            assert!(labelled(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn a_recording_without_a_label_is_called_by_its_own_policy_else_by_its_file() {
        assert_eq!(own_name("arnold/seed_0", Path::new("a/pen.h5")), "arnold/seed_0");
        assert_eq!(own_name(" ", Path::new("a/pen.h5")), "pen");
    }
}

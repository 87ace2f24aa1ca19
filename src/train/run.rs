//! A run as a folder, from the first step to the last, or on from where it was left.
//!
//! | file | what it is |
//! | --- | --- |
//! | `args.json` | everything that decides the result |
//! | `curves.parquet`, `events.out.tfevents.…` | the curves |
//! | `rl_model_<steps>_steps.safetensors` | the policy and its normaliser at a checkpoint |
//! | `final_model.safetensors` | the same at the end |
//! | `state.npz` | what a run needs to go on |
//!
//! At a checkpoint the policy is evaluated and written, then the curves, and the state last. So a run that was killed finds
//! a state with everything that belongs to it, and what it does again it writes as the very same bytes.

use std::path::{Path, PathBuf};
use std::time::Instant;

use serde::Serialize;
use serde_json::{Value, json};

use super::TrainError;
use super::curves::Curves;
use super::learner::{Learner, Report};
use super::plan::Plan;
use crate::files;
use crate::policy::export;
use crate::sim::rollout::Machine;

pub(super) const ARGUMENTS: &str = "args.json";
pub(super) const STATE: &str = "state.npz";
const FINAL: &str = "final_model.safetensors";
/// No `args.json` is larger than this.
pub(super) const LARGEST_ARGUMENTS: u64 = 1 << 20;

/// Where and how often.
#[derive(Debug, Clone)]
pub struct RunOptions {
    pub folder: PathBuf,
    /// Version of the physics, for the run's arguments.
    pub physics: String,
    /// Steps between two checkpoints.
    pub checkpoint_steps: u64,
    /// Episodes of every task at a checkpoint; 0: no evaluation.
    pub evaluation_episodes: usize,
}

/// What is told while a run goes on.
#[derive(Debug, Clone)]
pub struct Progress<'a> {
    pub report: &'a Report,
    /// Control steps of this life of the program, and the seconds that they took.
    pub pace: (u64, f64),
    /// Mean solved fraction by task, if this was a checkpoint.
    pub evaluation: Option<&'a [f64]>,
}

/// Trains by `plan`, or goes on with what the folder holds of it. Returns the file of the trained policy.
pub fn train<L: Learner>(
    plan: Plan<L::Recipe>,
    machine: &Machine,
    options: &RunOptions,
    told: &mut dyn FnMut(&Progress<'_>),
) -> Result<PathBuf, TrainError> {
    files::create_folder(&options.folder)?;
    let arguments = arguments(&plan, options);
    check_arguments(&options.folder, &arguments)?;
    let mut trainer = L::new(plan, &machine.bodies)?;
    let state = options.folder.join(STATE);
    if state.is_file() {
        trainer.restore(&state)?;
    }
    let mut text = serde_json::to_vec_pretty(&arguments).unwrap_or_default();
    text.push(b'\n');
    files::write_atomic(&options.folder.join(ARGUMENTS), &text)?;
    let mut curves = Curves::open(&options.folder, trainer.steps(), trainer.plan().first_step())?;
    let (start, first) = (Instant::now(), trainer.steps());
    while !trainer.is_finished() {
        let (before, began) = (trainer.steps(), Instant::now());
        let report = trainer.iterate(machine.threads)?;
        let rate = (report.steps - before) as f64 / began.elapsed().as_secs_f64();
        let is_checkpoint = report.steps / options.checkpoint_steps
            > before / options.checkpoint_steps
            || trainer.is_finished();
        let evaluation = if is_checkpoint && options.evaluation_episodes > 0 {
            Some(trainer.evaluate(machine, options.evaluation_episodes)?)
        } else {
            None
        };
        curves.add(report.steps, &row(trainer.plan(), &report, evaluation.as_deref()), rate)?;
        if is_checkpoint {
            let name = format!("rl_model_{}_steps.safetensors", report.steps);
            write_policy(&trainer, &options.folder.join(name), &arguments)?;
            curves.save()?;
            trainer.save(&state)?;
        }
        let pace = (report.steps - first, start.elapsed().as_secs_f64());
        told(&Progress { report: &report, pace, evaluation: evaluation.as_deref() });
    }
    let path = options.folder.join(FINAL);
    write_policy(&trainer, &path, &arguments)?;
    Ok(path)
}

/// What decides the result, and how often it is looked at.
fn arguments<R: Serialize>(plan: &Plan<R>, options: &RunOptions) -> Value {
    let mut document = json!({"program": concat!("arnold-analyze ", env!("CARGO_PKG_VERSION"))});
    if let (Value::Object(all), Value::Object(plan)) = (&mut document, plan.document()) {
        all.extend(plan);
        all.insert("physics".to_owned(), json!(options.physics));
        all.insert("save_freq".to_owned(), json!(options.checkpoint_steps));
        all.insert("evaluation_episodes".to_owned(), json!(options.evaluation_episodes));
    }
    document
}

/// Refuses a folder with another run. A run may be made longer.
fn check_arguments(folder: &Path, wanted: &Value) -> Result<(), TrainError> {
    let path = folder.join(ARGUMENTS);
    if !path.is_file() {
        return Ok(());
    }
    let bytes = files::read_bounded(&path, LARGEST_ARGUMENTS)?;
    let found: Value = serde_json::from_slice(&bytes).unwrap_or_default();
    for (what, wanted) in wanted.as_object().into_iter().flatten() {
        if what != "num_steps" && found[what] != *wanted {
            let found = files::printable(&found[what].to_string());
            let (what, folder) = (what.clone(), folder.to_path_buf());
            return Err(TrainError::OtherRun { what, found, wanted: wanted.to_string(), folder });
        }
    }
    Ok(())
}

fn write_policy<L: Learner>(trainer: &L, path: &Path, arguments: &Value) -> Result<(), TrainError> {
    let (checkpoint, normaliser) = trainer.policy();
    let provenance = json!({"training": arguments, "steps": trainer.steps()});
    Ok(export::write_trained(path, &checkpoint, &normaliser, provenance)?)
}

/// One row of the curves.
fn row<R>(plan: &Plan<R>, report: &Report, evaluation: Option<&[f64]>) -> Vec<(String, f64)> {
    let mut row: Vec<(String, f64)> = Vec::new();
    for (task, (solved, components)) in
        plan.tasks.iter().zip(report.solved.iter().zip(&report.components))
    {
        row.push((format!("{}/solved", task.definition.name), *solved));
        for (name, mean) in components.iter().filter(|(name, _)| *name != "solved") {
            row.push((format!("{}/{name}", task.definition.name), *mean));
        }
    }
    for (task, fraction) in plan.tasks.iter().zip(evaluation.into_iter().flatten()) {
        row.push((format!("evaluation/{}/solved_fraction", task.definition.name), *fraction));
    }
    let undefined = |value: Option<f64>| value.unwrap_or(f64::NAN);
    let episodes = [
        ("rollout/ep_rew_mean", undefined(report.episode_reward)),
        ("rollout/ep_len_mean", undefined(report.episode_length)),
    ];
    let scalars = episodes.into_iter().chain(report.training.iter().copied());
    row.extend(scalars.map(|(name, value)| (name.to_owned(), value)));
    row
}

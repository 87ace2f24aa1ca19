//! What `emg` and `factors` share: where a walk comes from, and how it is cut into gait cycles.

use std::path::{Path, PathBuf};

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use crate::analysis::emg::{ContactSensors, GaitOptions, PercentileScope, Side};
use crate::analysis::signal::LowPassOptions;
use crate::assets::platform;
use crate::cli::context::Context;
use crate::cli::laboratory::{Defaults, Laboratory, PlayArguments};
use crate::cli::render::Hinted;
use crate::cli::sweep;
#[cfg(feature = "view")]
use crate::cli::{
    movement,
    viewing::{self, ViewerArguments, WatchArguments},
};
use crate::experiment::recording::{self, Source};
use crate::experiment::run_folder::RunFolder;
use crate::experiment::walking::{Walk, WalkError, WalkOptions, read_walk};
use crate::record::names;
use crate::sim::rollout::ActionMode;

/// Tasks in which a policy walks ahead.
const TASKS: [&str; 2] = ["kinesis_moving_goal", "kinesis_forward"];
/// Episodes of the paper's recording with a moving goal.
const EPISODES: usize = 300;
const RECORDING_HINT: &str = "`arnold-analyze inspect FILE` shows what a recording holds; `rollout --task kinesis_moving_goal` records what is \
     needed, and upstream's gait HDF5 has it";

/// Options of gait cycles; the defaults are the paper's.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Gait cycles")]
pub(super) struct CycleArguments {
    /// Muscle signal
    #[arg(long, value_name = "NAME", value_enum, default_value_t = Signal::Activation)]
    signal: Signal,
    /// Low-pass the muscle signal at this frequency, Hz [default: not at all]
    #[arg(long, value_name = "HZ", value_parser = positive)]
    muscle_lowpass: Option<f64>,
    /// Contact above which a foot is on the ground, in sensor units
    #[arg(long, value_name = "N", default_value_t = 300.0, value_parser = positive)]
    contact_threshold: f64,
    /// Sensors that say so
    #[arg(long, value_name = "WHICH", value_enum, default_value_t = ContactChannels::Heel)]
    contact_channels: ContactChannels,
    /// Which cycles' durations are ranked together
    #[arg(long, value_name = "WHICH", value_enum, default_value_t = Scope::Episode)]
    percentile_scope: Scope,
    /// Points of the averaged cycle
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = clap::value_parser!(u16).range(2..))]
    points: u16,
}

/// A leg.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Leg {
    Left,
    Right,
}

impl From<Leg> for Side {
    fn from(leg: Leg) -> Self {
        match leg {
            Leg::Left => Self::Left,
            Leg::Right => Self::Right,
        }
    }
}

/// A muscle signal of a recording.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Signal {
    Activation,
    Excitation,
    Action,
}

/// Sensors under a foot.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ContactChannels {
    Heel,
    #[value(name = "foot+toes")]
    FootAndToes,
}

/// Cycles whose durations are ranked together.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Scope {
    Episode,
    Pooled,
}

/// A number above zero.
fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(number) if number.is_finite() && number > 0.0 => Ok(number),
        _ => Err("expected a number above zero".to_owned()),
    }
}

impl CycleArguments {
    /// What was meant.
    pub(super) fn options(&self) -> WalkOptions {
        WalkOptions {
            signal: match self.signal {
                Signal::Activation => names::ACTIVATION,
                Signal::Excitation => names::EXCITATION,
                Signal::Action => names::ACTION,
            },
            gait: GaitOptions {
                sensors: match self.contact_channels {
                    ContactChannels::Heel => ContactSensors::Heel,
                    ContactChannels::FootAndToes => ContactSensors::FootAndToes,
                },
                contact_threshold: self.contact_threshold,
                percentile_scope: match self.percentile_scope {
                    Scope::Episode => PercentileScope::Episode,
                    Scope::Pooled => PercentileScope::Pooled,
                },
                ..GaitOptions::default()
            },
            points: usize::from(self.points),
            muscle_low_pass: self
                .muscle_lowpass
                .map(|cutoff| LowPassOptions { cutoff, ..LowPassOptions::default() }),
        }
    }

    /// The same for the run's key.
    pub(super) fn decides(&self) -> Value {
        json!(format!("{:?}", self.options()))
    }
}

/// `FILE` or `LABEL=FILE` as typed.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Labelled {
    pub(super) label: String,
    pub(super) path: PathBuf,
}

/// The label is what stands before the first `=`, unless that looks like a path; else the file's name.
pub(super) fn labelled(text: &str) -> Result<Labelled, String> {
    let (label, path) = match text.split_once('=') {
        Some((label, path)) if !label.contains(['/', '\\', '.']) => (label.to_owned(), path),
        _ => {
            let stem = Path::new(text).file_stem().unwrap_or_default();
            (stem.to_string_lossy().into_owned(), text)
        }
    };
    if label.is_empty() || path.is_empty() {
        return Err("expected a file, or `LABEL=FILE`".to_owned());
    }
    Ok(Labelled { label, path: path.into() })
}

/// Walks that can be had: those of recordings, and those of a policy that plays.
pub(super) struct Walks {
    recorded: Vec<Walk>,
    laboratory: Option<Laboratory>,
    options: WalkOptions,
    /// For the run's key.
    pub(super) plan: Value,
    /// What decides nothing.
    machine: Value,
    /// Where a scene of the first episodes goes.
    #[cfg(feature = "view")]
    scene: Option<ViewerArguments>,
}

impl Walks {
    /// Reads the `recordings`, and opens the policy if one was named.
    pub(super) fn open(
        context: &Context,
        recordings: &[Labelled],
        play: &PlayArguments,
        options: &WalkOptions,
    ) -> anyhow::Result<Self> {
        let mut recorded = Vec::new();
        let mut plan = Vec::new();
        for Labelled { label, path } in recordings {
            let (walk, hash) = read_walk(path, label, options).map_err(with_hint)?;
            plan.push(json!({"label": label, "blake3": hash}));
            recorded.push(walk);
        }
        let machine = json!({
            "recordings": recordings.iter().map(|r| &r.path).collect::<Vec<_>>(),
            "platform": platform::describe_here(),
            "command_line": std::env::args().collect::<Vec<_>>().join(" "),
        });
        let mut plan = json!({ "recordings": plan });
        let mut laboratory = None;
        if play.names_policy() {
            let mode = Some(ActionMode::Stochastic);
            let defaults = Defaults { tasks: TASKS[0], episodes: EPISODES, mode };
            let opened = Laboratory::open(context, play, defaults)?;
            check_walking(&opened)?;
            plan["play"] = opened.decides();
            laboratory = Some(opened);
        }
        Ok(Self {
            recorded,
            laboratory,
            options: options.clone(),
            plan,
            machine,
            #[cfg(feature = "view")]
            scene: None,
        })
    }

    /// The same with somebody who looks on.
    #[cfg(feature = "view")]
    pub(super) fn watched(mut self, watch: &WatchArguments) -> anyhow::Result<Self> {
        if let Some(laboratory) = &self.laboratory {
            watch.seat(laboratory)?;
            self.scene = watch.file().cloned();
        }
        Ok(self)
    }

    /// Whether a policy plays.
    #[cfg(feature = "view")]
    pub(super) fn plays(&self) -> bool {
        self.laboratory.is_some()
    }

    /// Shows walks of a run that was finished before: the policy's, else those recorded.
    #[cfg(feature = "view")]
    pub(super) fn show(
        &self,
        context: &Context,
        recordings: &[Labelled],
        viewer: Option<&ViewerArguments>,
    ) -> anyhow::Result<()> {
        match (viewer, &self.laboratory) {
            (None, _) => Ok(()),
            (Some(viewer), Some(laboratory)) => viewing::play_again(context, laboratory, viewer),
            (Some(viewer), None) => show_recorded(context, recordings, viewer),
        }
    }

    /// Whose walks they are.
    pub(super) fn names(&self) -> Vec<String> {
        let recorded = self.recorded.iter().map(|walk| walk.policy.clone());
        let played = self.laboratory.iter().flat_map(|laboratory| {
            laboratory.tasks.iter().map(|task| name_of(laboratory, task.name))
        });
        recorded.chain(played).collect()
    }

    /// All walks, and what decides nothing about them; none if only a part of the playing was to be done.
    pub(super) fn all(
        self,
        context: &Context,
        folder: &RunFolder,
    ) -> anyhow::Result<Option<(Vec<Walk>, Value)>> {
        #[cfg(feature = "view")]
        let scene = self.scene.clone();
        let Self { recorded: mut walks, laboratory, options, mut machine, .. } = self;
        let Some(laboratory) = laboratory else {
            sweep::nothing_to_play(context)?;
            return Ok(Some((walks, machine)));
        };
        let arms = laboratory.recorded_arms();
        let Some((played, seconds)) = sweep::play(context, folder, &laboratory, &laboratory, arms)?
        else {
            return Ok(None);
        };
        #[cfg(feature = "view")]
        {
            viewing::close(context, &laboratory)?;
            if let Some(viewer) = scene {
                viewing::save_played(context, &laboratory, &played, &viewer)?;
            }
        }
        for (place, task) in laboratory.tasks.iter().enumerate() {
            let (names, episodes) = laboratory.recorded(&played, place)?;
            let policy = name_of(&laboratory, task.name);
            let source = Source { policy: &policy, ..laboratory.source(task) };
            let recording = recording::recording(source, &names, episodes);
            walks.push(Walk::of(&recording, &policy, &options)?);
        }
        machine["play"] = laboratory.circumstances(seconds);
        Ok(Some((walks, machine)))
    }
}

/// Shows the first episodes of recordings.
#[cfg(feature = "view")]
pub(super) fn show_recorded(
    context: &Context,
    recordings: &[Labelled],
    viewer: &ViewerArguments,
) -> anyhow::Result<()> {
    if recordings.is_empty() {
        context.say("warning: there is no recording and no policy, so there is nothing to see");
        return Ok(());
    }
    let named = |one: &Labelled| movement::Labelled {
        policy: Some(one.label.clone()),
        path: one.path.clone(),
    };
    super::view::show_labelled(context, recordings.iter().map(named).collect(), None, viewer)
}

/// What the walk of a task is called: as the policy, unless it walks in several.
fn name_of(laboratory: &Laboratory, task: &str) -> String {
    let policy = &laboratory.policy.name;
    if laboratory.tasks.len() == 1 { policy.clone() } else { format!("{policy}:{task}") }
}

/// Whether the tasks are walks, and the episodes differ.
fn check_walking(laboratory: &Laboratory) -> anyhow::Result<()> {
    if let Some(task) = laboratory.tasks.iter().find(|task| !TASKS.contains(&task.name)) {
        return Err(Hinted::new(
            format!("nobody walks ahead in `{}`", task.name),
            format!("`--task {}` or `--task {}`", TASKS[0], TASKS[1]),
        ));
    }
    let repeats = laboratory.mode == ActionMode::Deterministic && laboratory.action_noise == 0.0;
    if repeats && laboratory.episodes > 1 {
        return Err(Hinted::new(
            format!(
                "with mean actions all {} episodes would be the same: the body always starts alike",
                laboratory.episodes
            ),
            "`--stochastic`, `--action-noise 0.1`, or `--episodes 1`",
        ));
    }
    Ok(())
}

/// A fault of a walk with what to do about it.
pub(super) fn with_hint(error: WalkError) -> anyhow::Error {
    use crate::analysis::emg::EmgError;
    match &error {
        WalkError::Emg { fault: EmgError::NoCycle { .. }, .. } => Hinted::new(
            error.to_string(),
            "a policy that does not walk has no gait cycle; look at its recording, or lower `--contact-threshold`",
        ),
        WalkError::Emg { fault: EmgError::MissingMuscle { .. }, .. }
        | WalkError::NoChannel { .. }
        | WalkError::NoRate { .. }
        | WalkError::Record(_)
        | WalkError::Kinesis { .. } => Hinted::new(error.to_string(), RECORDING_HINT),
        _ => error.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_label_stands_before_the_sign_and_a_file_names_itself() {
        let read = |text| labelled(text).map(|l| (l.label, l.path.display().to_string()));
        let both = |label: &str, path: &str| Ok((label.to_owned(), path.to_owned()));
        assert_eq!(read("obc=a/b.h5"), both("obc", "a/b.h5"));
        assert_eq!(read("a/arnold.h5"), both("arnold", "a/arnold.h5"));
        assert_eq!(read("./a=b.h5"), both("a=b", "./a=b.h5"));
        assert!(read("=x").is_err() && read("x=").is_err());
    }
}

//! Where a scene goes: into a file, or to a viewer that is found or started.

use std::path::PathBuf;

use clap::Args;
use serde_json::{Value, json};

use crate::experiment::gather::Played;
use crate::experiment::viewing::acts;
use crate::experiment::viewing::watching::{Audience, Seen};
use crate::experiment::{recording, seed};
use crate::record::Recording;
use crate::record::scene::{Act, Connection, SceneError, Viewer, write_scene};
use crate::sim::rollout::{self, Channels, EpisodeSpec, RolloutPlan};

use super::context::Context;
use super::laboratory::Laboratory;
use super::render::Hinted;

/// Episodes of each task in a scene, unless they are named.
pub const EPISODES: usize = 3;

/// Options of every command that shows something.
#[derive(Debug, Clone, Default, Args)]
#[command(next_help_heading = "Viewing")]
pub struct ViewerArguments {
    /// Write the scene to this file instead; `rerun FILE` opens it
    #[arg(long, value_name = "FILE.rrd")]
    save: Option<PathBuf>,
    /// Show it in a viewer that listens there, e.g. `rerun+http://HOST:9876/proxy`, instead of one on this machine
    #[arg(long, value_name = "URL", conflicts_with = "save")]
    connect: Option<String>,
    /// Program that is started as viewer: Rerun 0.36.3, as in the Python package `rerun-sdk` [default: `rerun`]
    #[arg(long, value_name = "PROGRAM", env = "ARNOLD_RERUN", conflicts_with_all = ["save", "connect"])]
    viewer: Option<String>,
}

/// Options of the commands that play, to watch what they play.
#[derive(Debug, Clone, Default, Args)]
pub struct WatchArguments {
    /// Watch two of the bodies in the viewer Rerun while they play
    #[arg(long, help_heading = "Viewing")]
    view: bool,
    #[command(flatten)]
    viewer: ViewerArguments,
}

impl WatchArguments {
    /// Seats an audience in `laboratory`, if one was asked for.
    pub fn seat(&self, laboratory: &Laboratory) -> anyhow::Result<()> {
        if self.view || self.viewer.connect.is_some() {
            let viewer = self.viewer.open()?;
            let bodies = laboratory.machine.bodies.clone();
            // Nobody else takes the seat.
            let audience = Audience::new(viewer, bodies, &laboratory.policy.name);
            laboratory.audience.set(audience).ok();
        }
        Ok(())
    }

    /// Where something is to be seen at all: for what was recorded or finished before.
    #[must_use]
    pub fn anywhere(&self) -> Option<&ViewerArguments> {
        let seen = self.view || self.viewer.connect.is_some() || self.viewer.save.is_some();
        seen.then_some(&self.viewer)
    }

    /// Where a scene is to be written.
    #[must_use]
    pub fn file(&self) -> Option<&ViewerArguments> {
        self.viewer.save.is_some().then_some(&self.viewer)
    }
}

/// Waits for the viewer, and says how much it showed.
pub fn close(context: &Context, laboratory: &Laboratory) -> anyhow::Result<()> {
    let Some(audience) = laboratory.audience.get() else { return Ok(()) };
    let Seen { episodes, shown, dropped, passed_over } =
        audience.finish().map_err(|error| hinted(&error))?;
    context.say(&format!(
        "Watched {episodes} episodes: {shown} frames shown, {dropped} dropped because the viewer was busy, {passed_over} \
         steps in between"
    ));
    Ok(())
}

/// Writes the first episodes of every task, which were played with all their steps kept.
pub fn save_played(
    context: &Context,
    laboratory: &Laboratory,
    played: &Played,
    viewer: &ViewerArguments,
) -> anyhow::Result<()> {
    let mut recordings = Vec::new();
    for (place, task) in laboratory.tasks.iter().enumerate() {
        let (names, mut episodes) = laboratory.recorded(played, place)?;
        episodes.truncate(EPISODES);
        recordings.push(recording::recording(laboratory.source(task), &names, episodes));
    }
    show_recordings(context, laboratory, &recordings, viewer)
}

/// Shows the first episodes of every task of a run that was finished before and kept no steps. An episode depends on nothing
/// but its seeds, so playing it once more gives the one that was played.
pub fn play_again(
    context: &Context,
    laboratory: &Laboratory,
    viewer: &ViewerArguments,
) -> anyhow::Result<()> {
    let episodes = EPISODES.min(laboratory.episodes);
    context.say(&format!(
        "No steps were kept, so the first of its free episodes are played again: {episodes} of each task"
    ));
    let mut recordings = Vec::new();
    for &task in &laboratory.tasks {
        let spec = |number| seed::episode(laboratory.seed, task.name, number, None);
        let specs: Vec<EpisodeSpec> = (0..episodes).map(spec).collect();
        let plan = RolloutPlan { channels: Channels::All, ..laboratory.plan(task) };
        let episodes = rollout::play(&laboratory.machine, &plan, &specs, &|_| ())?;
        let names = rollout::channel_names(&laboratory.machine, task)?;
        recordings.push(recording::recording(laboratory.source(task), &names, episodes));
    }
    show_recordings(context, laboratory, &recordings, viewer)
}

/// Shows all episodes of what this laboratory played.
fn show_recordings(
    context: &Context,
    laboratory: &Laboratory,
    recordings: &[Recording],
    viewer: &ViewerArguments,
) -> anyhow::Result<()> {
    let origin = format!("MuJoCo {}", laboratory.physics);
    let acts = recordings.iter().flat_map(|recording| {
        let (origin, bodies) = (&origin, &laboratory.machine.bodies);
        recording.episodes.iter().map(move |episode| {
            let mut act = acts::act(&recording.about.task, episode.facts.number);
            acts::add_take(&mut act, &laboratory.policy.name, origin, bodies, recording)?;
            Ok(act)
        })
    });
    viewer.show(context, acts).map(drop)
}

impl ViewerArguments {
    /// The viewer, found or started.
    pub fn open(&self) -> anyhow::Result<Viewer> {
        let connection = match &self.connect {
            Some(url) => Connection::Connect { url: url.clone() },
            None => Connection::Spawn { program: self.viewer.clone() },
        };
        Viewer::open(&connection).map_err(|error| hinted(&error))
    }

    /// Writes or shows `acts`, one after the other; what was done, for `--json`.
    pub fn show(
        &self,
        context: &Context,
        acts: impl Iterator<Item = anyhow::Result<Act>>,
    ) -> anyhow::Result<Value> {
        if let Some(path) = &self.save {
            let episodes = write_scene::<Failure>(path, acts.map(|act| act.map_err(Failure)))
                .map_err(|Failure(error)| error)?;
            context.say(&format!("`rerun {}` shows it", path.display()));
            return Ok(json!({"file": path, "episodes": episodes}));
        }
        let viewer = self.open()?;
        let mut arranged: Vec<String> = Vec::new();
        let mut episodes = 0;
        for act in acts {
            let act = act?;
            let is_new = !arranged.contains(&act.task);
            viewer.show(&act, is_new).map_err(|error| hinted(&error))?;
            if is_new {
                arranged.push(act.task);
            }
            episodes += 1;
        }
        viewer.finish().map_err(|error| hinted(&error))?;
        Ok(json!({"viewer": viewer.url(), "episodes": episodes}))
    }
}

/// An error on the way through a writer that has errors of its own.
struct Failure(anyhow::Error);

impl From<SceneError> for Failure {
    fn from(error: SceneError) -> Self {
        Self(hinted(&error))
    }
}

/// An error of the viewer, with what to do about it.
fn hinted(error: &SceneError) -> anyhow::Error {
    let hint = match error {
        SceneError::Spawn { .. } => {
            "install the viewer with `pip install rerun-sdk==0.36.3`, name it with `--viewer PROGRAM`, or write a file with `--save FILE.rrd`"
        }
        SceneError::Address { .. } => "an address looks like `rerun+http://127.0.0.1:9876/proxy`",
        SceneError::Lost { .. } => "is the viewer running there, and is it Rerun 0.36.3?",
        SceneError::File(_) => "choose a place you may write to with `--save FILE.rrd`",
        _ => "please report this with the command and the recording",
    };
    Hinted::new(error.to_string(), hint)
}

//! `view`: shows recorded episodes, several policies side by side.

use std::collections::BTreeMap;
use std::path::PathBuf;

use clap::Args;
use serde_json::Value;

use crate::assets::{Cache, Part, PhysicsVersion};
use crate::cli::context::{Context, Outcome};
use crate::cli::laboratory::{available, open_library};
use crate::cli::movement::{self, Labelled};
use crate::cli::render::{self, Hinted};
use crate::cli::viewing::{EPISODES, ViewerArguments};
use crate::experiment::viewing::acts;
use crate::experiment::viewing::replay::ReplayError;
use crate::record::scene::Act;
use crate::record::{self, Recording, Summary};
use crate::sim::bodies::Bodies;

/// Arguments of `view`.
#[derive(Debug, Args)]
pub struct ViewArguments {
    /// Recordings: a name for the policy (else the recording's own), and a file or a folder of files, such as a run of
    /// `rollout`. Those of the same task stand side by side
    #[arg(value_name = "[NAME=]PATH", num_args = 1.., required = true, value_parser = movement::labelled)]
    recordings: Vec<Labelled>,
    /// Numbers of the episodes to show [default: the first three]
    #[arg(long, value_name = "N", num_args = 1.., value_delimiter = ',')]
    episode: Vec<u64>,
    /// Tasks to show [default: all that were recorded]
    #[arg(long, value_name = "NAME", num_args = 1.., value_delimiter = ',')]
    task: Vec<String>,
    /// MuJoCo version [default: the one that the recording was made in, else 2.3.7]
    #[arg(long, value_name = "VERSION")]
    physics: Option<PhysicsVersion>,
    #[command(flatten)]
    viewer: ViewerArguments,
}

/// Runs the command.
pub fn run(context: &Context, arguments: &ViewArguments) -> anyhow::Result<Outcome> {
    let document = show(context, arguments)?;
    if context.json {
        render::print_json(&document)?;
    }
    Ok(Outcome::Done)
}

/// Shows the recordings; what was done.
fn show(context: &Context, arguments: &ViewArguments) -> anyhow::Result<Value> {
    let scenes = scenes(arguments)?;
    let mut theatre = Theatre { context, bodies: BTreeMap::new() };
    let chosen =
        scenes.iter().flat_map(|scene| scene.episodes.iter().map(move |&episode| (scene, episode)));
    let acts = chosen.map(|(scene, episode)| theatre.act(scene, episode, arguments.physics));
    arguments.viewer.show(context, acts)
}

/// Shows the first episodes of the recordings in `files`, in the `physics` they were made in, if that is known.
pub(super) fn show_files(
    context: &Context,
    files: Vec<PathBuf>,
    physics: Option<PhysicsVersion>,
    viewer: &ViewerArguments,
) -> anyhow::Result<()> {
    let recordings = files.into_iter().map(|path| Labelled { policy: None, path }).collect();
    show_labelled(context, recordings, physics, viewer)
}

/// The same of recordings that have names.
pub(super) fn show_labelled(
    context: &Context,
    recordings: Vec<Labelled>,
    physics: Option<PhysicsVersion>,
    viewer: &ViewerArguments,
) -> anyhow::Result<()> {
    let (episode, task) = Default::default();
    let viewer = viewer.clone();
    show(context, &ViewArguments { recordings, episode, task, physics, viewer }).map(drop)
}

/// The recordings of one task, and which of their episodes are shown.
struct Scene {
    task: String,
    files: Vec<File>,
    episodes: Vec<u64>,
}

/// A recording and what it is called.
struct File {
    label: String,
    path: PathBuf,
    summary: Summary,
}

/// Finds the recordings, by task.
fn scenes(arguments: &ViewArguments) -> anyhow::Result<Vec<Scene>> {
    let mut scenes: Vec<Scene> = Vec::new();
    for recording in &arguments.recordings {
        for path in movement::files_in(&recording.path)? {
            let summary = record::summarise(&path).map_err(|error| movement::hinted(&error))?;
            let task = &summary.about.task;
            if !arguments.task.is_empty() && !arguments.task.contains(task) {
                continue;
            }
            let own = || movement::own_name(&summary.about.policy, &path);
            let label = recording.policy.clone().unwrap_or_else(own);
            let place = scenes.iter().position(|scene| scene.task == *task).unwrap_or_else(|| {
                let (files, episodes) = Default::default();
                scenes.push(Scene { task: task.clone(), files, episodes });
                scenes.len() - 1
            });
            let files = &mut scenes[place].files;
            let same = files.iter().filter(|file| file.label == label).count();
            let label = if same == 0 { label } else { format!("{label} ({})", same + 1) };
            files.push(File { label, path, summary });
        }
    }
    if scenes.is_empty() {
        let tasks = arguments.task.join(", ");
        return Err(Hinted::new(
            format!("there is no recording of {tasks} among those named"),
            "leave `--task` out for all that there are",
        ));
    }
    for scene in &mut scenes {
        scene.episodes = episodes(scene, &arguments.episode)?;
    }
    Ok(scenes)
}

/// The episodes to show: those named, else the first ones of the first recording.
fn episodes(scene: &Scene, named: &[u64]) -> anyhow::Result<Vec<u64>> {
    let has =
        |file: &File, number: u64| file.summary.episodes.iter().any(|facts| facts.number == number);
    if named.is_empty() {
        let first = scene.files.first().into_iter().flat_map(|file| &file.summary.episodes);
        return Ok(first.map(|facts| facts.number).take(EPISODES).collect());
    }
    for &number in named {
        if !scene.files.iter().any(|file| has(file, number)) {
            return Err(Hinted::new(
                format!("there is no episode {number} in the recording of `{}`", scene.task),
                "`arnold-analyze inspect FILE` shows which episodes a recording has",
            ));
        }
    }
    Ok(named.to_vec())
}

/// The physics that episodes are played in again, opened when the first one asks.
struct Theatre<'a> {
    context: &'a Context,
    bodies: BTreeMap<String, Bodies>,
}

impl Theatre<'_> {
    /// One episode, by all recordings that have it.
    fn act(
        &mut self,
        scene: &Scene,
        number: u64,
        physics: Option<PhysicsVersion>,
    ) -> anyhow::Result<Act> {
        let mut act = acts::act(&scene.task, number);
        for file in &scene.files {
            let opened = record::read_episodes(&file.path, &[number])
                .map_err(|error| movement::hinted(&error))?;
            let physics = physics.unwrap_or_else(|| recorded_physics(&opened.recording));
            let name = file.path.file_name().unwrap_or_default().to_string_lossy();
            let origin = format!("MuJoCo {physics}, `{name}`");
            acts::add_take(
                &mut act,
                &file.label,
                &origin,
                self.bodies(physics)?,
                &opened.recording,
            )
            .map_err(|error| departed(&error, file, physics))?;
        }
        self.context.say(&format!("{}, episode {number}", scene.task));
        Ok(act)
    }

    fn bodies(&mut self, physics: PhysicsVersion) -> anyhow::Result<&Bodies> {
        let key = physics.to_string();
        if !self.bodies.contains_key(&key) {
            let cache = Cache::locate();
            let models = available(self.context, &cache, Part::MyoSuite, Cache::myosuite)?;
            let library = open_library(self.context, &cache, physics)?;
            let bodies = Bodies::new(library, &models, &self.context.data);
            self.bodies.insert(key.clone(), bodies);
        }
        Ok(&self.bodies[&key])
    }
}

/// The physics that a recording of ours says it was made in.
fn recorded_physics(recording: &Recording) -> PhysicsVersion {
    let plan = recording.about.metadata.get("plan");
    let plan = plan.and_then(|plan| serde_json::from_str::<Value>(plan).ok());
    let physics = plan.as_ref().and_then(|plan| plan.pointer("/plan/physics")?.as_str());
    physics.and_then(|physics| physics.parse().ok()).unwrap_or(PhysicsVersion::V2_3_7)
}

fn departed(error: &ReplayError, file: &File, physics: PhysicsVersion) -> anyhow::Error {
    let hint = match error {
        ReplayError::Departed { .. } => {
            let other = match physics {
                PhysicsVersion::V2_3_7 => PhysicsVersion::V3_17_0,
                PhysicsVersion::V3_17_0 => PhysicsVersion::V2_3_7,
            };
            format!("was it recorded in another physics or with other models? `--physics {other}`")
        }
        ReplayError::Engine(_) => "`arnold-analyze doctor` says what is missing".to_owned(),
        _ => "`arnold-analyze inspect FILE` shows what a recording holds".to_owned(),
    };
    Hinted::new(format!("{error}, in `{}`", file.path.display()), hint)
}

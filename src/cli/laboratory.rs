//! From typed arguments to something that can play: which policy, which physics, which tasks.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use clap::Args;
use serde_json::{Value, json};

use crate::assets::{self, AssetError, CARRIED, CARRIED_EXPERTS, Cache, Part, PhysicsVersion};
use crate::experiment::plan::Arm;
use crate::experiment::worker::Scene;
use crate::policy::{self, Loaded, Member};
use crate::sim::bodies::Bodies;
use crate::sim::engine::{EngineError, Library};
use crate::sim::environment::Environment;
use crate::sim::rollout::{ActionMode, Channels, Machine, RolloutPlan};
use crate::sim::tasks::{self, Definition, RewardConfiguration};
use crate::sim::watching::Watcher;

use super::commands::setup;
use super::context::Context;
use super::default_policy::Origin;
use super::policy_choice;
use super::render::Hinted;

/// Options of every command that plays a policy.
#[derive(Debug, Clone, Args)]
#[command(next_help_heading = "Playing")]
pub struct PlayArguments {
    /// Policy to play: a checkpoint, a folder with one, or a name: `mini` (the small transformer that comes with this
    /// program), `expert:mini` (its teachers), `arnold`, `obc`, `arnold/seed_1`, `expert` (every task's own),
    /// `expert:TASK`, `expert:CONFIGURATION` [default: the one `$ARNOLD_POLICY` names, else the published Arnold
    /// checkpoint under `--data`, else `mini`]. `random`: uniformly random actions
    #[arg(long, value_name = "FILE|NAME")]
    policy: Option<PathBuf>,
    /// Normaliser the policy was trained with, or `none` [default: the one beside the checkpoint]
    #[arg(long, value_name = "FILE")]
    normaliser: Option<PathBuf>,
    /// Tasks to play: names, or every task that fits of the paper's (`all`, `hand`) or of the others (`extra`)
    /// [default: all; for `smoothness`, `synergies`, `subspaces` hand, for `kinematics`
    /// `baoding_p1_ccw`]
    #[arg(long, value_name = "NAME", num_args = 1.., value_delimiter = ',')]
    pub(super) task: Vec<String>,
    /// Episodes per task
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    pub(super) episodes: Option<NonZeroUsize>,
    /// Play the mean action
    #[arg(long, conflicts_with = "stochastic")]
    deterministic: bool,
    /// Sample actions from the policy's distribution
    #[arg(long)]
    stochastic: bool,
    /// Standard deviation of Gaussian noise added to every action
    #[arg(long, value_name = "SD", default_value_t = 0.0, value_parser = standard_deviation, allow_negative_numbers = true)]
    action_noise: f64,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = whole, allow_negative_numbers = true)]
    seed: u64,
    /// MuJoCo version
    #[arg(long, value_name = "VERSION", default_value = "2.3.7")]
    physics: PhysicsVersion,
    /// Worker threads; results do not depend on it [default: all cores]
    #[arg(long, value_name = "N", value_parser = count, allow_negative_numbers = true)]
    threads: Option<NonZeroUsize>,
    /// Bodies that a thread plays side by side; results do not depend on it, and more than one only takes memory
    #[arg(long, value_name = "N", default_value = "1", value_parser = count, allow_negative_numbers = true)]
    batch: NonZeroUsize,
    /// Folder for results, one folder per run inside
    #[arg(long, value_name = "DIR", default_value = "runs")]
    pub(super) out: PathBuf,
}

impl PlayArguments {
    /// Whether a policy was named.
    #[must_use]
    pub fn names_policy(&self) -> bool {
        self.policy.is_some()
    }

    /// Folder for results.
    #[must_use]
    pub fn out(&self) -> &Path {
        &self.out
    }

    /// Worker threads.
    #[must_use]
    pub fn threads(&self) -> usize {
        self.threads.map_or_else(all_cores, NonZeroUsize::get)
    }
}

fn count(text: &str) -> Result<NonZeroUsize, String> {
    text.parse().map_err(|_| "expected a whole number, at least 1".to_owned())
}

fn whole(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| "expected a whole number that is not negative".to_owned())
}

fn standard_deviation(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(sd) if sd.is_finite() && sd >= 0.0 => Ok(sd),
        _ => Err("expected a number that is not negative".to_owned()),
    }
}

/// A task that was asked for and cannot be played, and why.
#[derive(Debug, Clone)]
pub struct LeftOut {
    /// The task.
    pub task: &'static str,
    /// Why.
    pub reason: String,
}

/// Everything a command needs to play.
pub struct Laboratory {
    /// The policy.
    pub policy: Loaded,
    /// How it was chosen.
    pub chosen_because: &'static str,
    /// Another one, whose actions make the components in which the first one plays.
    pub components_of: Option<Loaded>,
    /// Physics, models, threads.
    pub machine: Machine,
    /// Which physics.
    pub physics: PhysicsVersion,
    /// Tasks that will be played.
    pub tasks: Vec<&'static Definition>,
    /// Muscles of each of them.
    pub muscle_counts: Vec<usize>,
    /// Tasks that `all` or `hand` left out.
    pub left_out: Vec<LeftOut>,
    /// How actions are chosen.
    pub mode: ActionMode,
    /// Episodes per task.
    pub episodes: usize,
    /// Standard deviation of added noise.
    pub action_noise: f64,
    /// Seed of the plan.
    pub seed: u64,
    /// Folder for results.
    pub out: PathBuf,
    /// Who looks on.
    #[cfg(feature = "view")]
    pub audience: std::sync::OnceLock<crate::experiment::viewing::watching::Audience>,
}

/// What a command does when the arguments do not say.
#[derive(Debug, Clone, Copy)]
pub struct Defaults {
    /// Tasks, as one would type them.
    pub tasks: &'static str,
    /// Episodes per task.
    pub episodes: usize,
    /// `None`: the mean for single-task experts, samples for everything else, as the paper evaluates.
    pub mode: Option<ActionMode>,
}

impl Laboratory {
    /// Opens everything, or says what is missing and how to get it. Tells the person what was chosen.
    pub fn open(
        context: &Context,
        arguments: &PlayArguments,
        defaults: Defaults,
    ) -> anyhow::Result<Self> {
        let named = match arguments.task.as_slice() {
            [] => named_tasks(&[defaults.tasks.to_owned()])?,
            words => named_tasks(words)?,
        };
        let cache = Cache::locate();
        let models = available(context, &cache, Part::MyoSuite, Cache::myosuite)?;
        let library = open_library(context, &cache, arguments.physics)?;
        let (mut policy, chosen_because) = policy_choice::choose(
            context,
            arguments.policy.as_deref(),
            arguments.normaliser.as_deref(),
            &named.names(),
            &cache,
        )?;
        if chosen_because == Origin::Baseline.reason() {
            // The file is called `best_policy.pickle`, which says nothing in a figure.
            "MyoSuite elbow baseline (NPG)".clone_into(&mut policy.name);
        }
        let machine = Machine {
            bodies: Arc::new(Bodies::new(library, &models, &context.data)),
            threads: context.threads().map_or_else(|| arguments.threads(), NonZeroUsize::get),
            batch: context.batch().unwrap_or(arguments.batch).get(),
        };
        let mode = match (arguments.deterministic, arguments.stochastic, defaults.mode) {
            (true, _, _) => ActionMode::Deterministic,
            (_, true, _) => ActionMode::Stochastic,
            (_, _, Some(mode)) if policy.policy.is_stochastic() => mode,
            _ => policy_choice::published_mode(&policy),
        };
        if mode == ActionMode::Stochastic && !policy.policy.is_stochastic() {
            return Err(Hinted::new(
                format!(
                    "`{}` does not say how it explores, so its actions cannot be sampled",
                    policy.name
                ),
                "leave `--stochastic` out to play its mean actions",
            ));
        }
        let Playable { tasks, muscle_counts, left_out, warnings } =
            playable(&policy, &machine, &named)?;
        policy.warnings.extend(warnings);
        let laboratory = Self {
            policy,
            chosen_because,
            components_of: None,
            machine,
            physics: arguments.physics,
            tasks,
            muscle_counts,
            left_out,
            mode,
            episodes: arguments.episodes.map_or(defaults.episodes, NonZeroUsize::get),
            action_noise: arguments.action_noise,
            seed: arguments.seed,
            out: arguments.out.clone(),
            #[cfg(feature = "view")]
            audience: std::sync::OnceLock::new(),
        };
        laboratory.introduce(context);
        Ok(laboratory)
    }

    fn introduce(&self, context: &Context) {
        let noise = if self.action_noise > 0.0 {
            format!(", action noise {}", self.action_noise)
        } else {
            String::new()
        };
        // Where the program keeps what it carries is nobody's concern.
        let carried = [CARRIED, CARRIED_EXPERTS].into_iter().find(|name| self.policy.name == *name);
        let policy = carried.map_or(self.policy.checkpoint_path.as_path(), Path::new);
        context.say(&format!(
            "Policy: {} ({})\nPhysics: MuJoCo {}; {} actions{noise}; seed {}; {} episodes per task",
            policy.display(),
            self.chosen_because,
            self.physics,
            self.mode.word(),
            self.seed,
            self.episodes,
        ));
        let names: Vec<&str> = self.tasks.iter().map(|task| task.name).collect();
        context.say(&format!("Tasks: {}", names.join(", ")));
        // An expert that is called like its task needs no mention.
        let other = |member: &&Member| member.name.rsplit('/').next() != Some(&member.task);
        let expert = |member: &Member| format!("{} by `{}`", member.task, member.name);
        let experts: Vec<String> = self.policy.members.iter().filter(other).map(expert).collect();
        if !experts.is_empty() {
            context.say(&format!("Experts: {}", experts.join(", ")));
        }
        let mut reasons: Vec<(&str, Vec<&str>)> = Vec::new();
        for LeftOut { task, reason } in &self.left_out {
            match reasons.iter_mut().find(|(known, _)| known == reason) {
                Some((_, tasks)) => tasks.push(task),
                None => reasons.push((reason, vec![task])),
            }
        }
        for (reason, tasks) in reasons {
            context.say(&format!("Left out: {} ({reason})", tasks.join(", ")));
        }
        for warning in &self.policy.warnings {
            context.say(&format!("warning: {warning}"));
        }
        context.say("");
    }

    /// Who looks on.
    #[must_use]
    pub fn watcher(&self) -> Option<&dyn Watcher> {
        #[cfg(feature = "view")]
        return self.audience.get().map(|audience| audience as &dyn Watcher);
        #[cfg(not(feature = "view"))]
        None
    }

    /// The rollout of one task.
    #[must_use]
    pub fn plan(&self, task: &'static Definition) -> RolloutPlan<'_> {
        RolloutPlan {
            task,
            policy: self.policy.policy.as_ref(),
            mode: self.mode,
            action_noise: self.action_noise,
            projections: &[],
            channels: Channels::Counts,
            rewards: RewardConfiguration::Sparse,
        }
    }

    /// Everything here that decides a result, for the run's key.
    #[must_use]
    pub fn decides(&self) -> Value {
        json!({
            "policy": {
                "name": self.policy.name,
                "checkpoint_blake3": self.policy.checkpoint_hash,
                "normaliser_blake3": self.policy.normaliser_hash,
            },
            "physics": self.physics,
            "tasks": self.tasks.iter().map(|task| task.name).collect::<Vec<_>>(),
            "episodes": self.episodes,
            "actions": self.mode.word(),
            "action_noise": self.action_noise,
            "seed": self.seed,
        })
    }

    /// The episodes of one task, as the policy plays them.
    #[must_use]
    pub fn arm(&self, task: &Definition, channels: Channels) -> Arm {
        Arm {
            stage: 0,
            task: task.name.to_owned(),
            policy: 0,
            condition: Value::Null,
            first: 0,
            episodes: self.episodes,
            channels,
        }
    }

    /// What all episodes have in common and depend on.
    #[must_use]
    pub fn shared(&self) -> Value {
        json!({
            "physics": self.physics,
            "actions": self.mode.word(),
            "action_noise": self.action_noise,
            "rewards": "sparse",
            "seed": self.seed,
        })
    }

    /// What decides about the policies: the one that plays, and the one whose components it plays in.
    #[must_use]
    pub fn policies(&self) -> Vec<Value> {
        let hashes = |policy: &Loaded| {
            json!({
                "checkpoint_blake3": policy.checkpoint_hash,
                "normaliser_blake3": policy.normaliser_hash,
            })
        };
        std::iter::once(&self.policy).chain(&self.components_of).map(hashes).collect()
    }

    /// What decides nothing: where and how it ran.
    #[must_use]
    pub fn circumstances(&self, seconds: f64) -> Value {
        json!({
            "checkpoint": self.policy.checkpoint_path,
            "normaliser": self.policy.normaliser_path,
            "experts": self.policy.members.iter().map(expert_document).collect::<Vec<_>>(),
            "chosen_because": self.chosen_because,
            "platform": assets::platform::describe_here(),
            "threads": self.machine.threads,
            "batch": self.machine.batch,
            "seconds": seconds,
            "command_line": std::env::args().collect::<Vec<_>>().join(" "),
        })
    }

    /// The tasks left out, for `--json` and the manifest.
    #[must_use]
    pub fn left_out_document(&self) -> Value {
        let entry = |left: &LeftOut| json!({"task": left.task, "reason": left.reason});
        self.left_out.iter().map(entry).collect()
    }
}

impl Scene for Laboratory {
    fn rollout(&self, arm: &Arm) -> RolloutPlan<'_> {
        let named = |task: &&&'static Definition| task.name == arm.task;
        // A plan is made of this laboratory's tasks; see `Laboratory::arm`.
        let plan = self.plan(self.tasks.iter().find(named).unwrap_or(&self.tasks[0]));
        match &self.components_of {
            Some(other) if arm.policy == 1 => RolloutPlan { policy: other.policy.as_ref(), ..plan },
            _ => plan,
        }
    }
}

/// One of a set of experts, for the manifest.
fn expert_document(member: &Member) -> Value {
    json!({
        "task": member.task,
        "checkpoint": member.checkpoint_path,
        "checkpoint_blake3": member.checkpoint_hash,
        "normaliser": member.normaliser_path,
        "normaliser_blake3": member.normaliser_hash,
    })
}

pub(super) fn all_cores() -> usize {
    std::thread::available_parallelism().map_or(1, NonZeroUsize::get)
}

/// Opens the physics library, offering to fetch it.
pub fn open_library(
    context: &Context,
    cache: &Cache,
    version: PhysicsVersion,
) -> anyhow::Result<Arc<Library>> {
    let path =
        available(context, cache, Part::Physics(version), |cache| cache.physics_library(version))?;
    Ok(Library::open(version, &path)?)
}

/// The verified part; fetched first if it is missing and a person is watching.
pub fn available(
    context: &Context,
    cache: &Cache,
    part: Part,
    find: impl Fn(&Cache) -> Result<PathBuf, AssetError>,
) -> anyhow::Result<PathBuf> {
    match find(cache) {
        Err(AssetError::Missing { .. }) if context.interactive => {
            setup::fetch(context, cache, &[part])?;
            Ok(find(cache)?)
        }
        other => Ok(other?),
    }
}

/// The tasks named by `words`, and whether one that does not fit is an error rather than left out.
pub(super) struct Named {
    pub(super) tasks: Vec<&'static Definition>,
    strict: bool,
}

impl Named {
    fn names(&self) -> Vec<&'static str> {
        self.tasks.iter().map(|task| task.name).collect()
    }
}

pub(super) fn named_tasks(words: &[String]) -> anyhow::Result<Named> {
    let group: Option<Vec<&'static Definition>> = match words {
        [word] if word == "all" => Some(tasks::ALL.iter().collect()),
        [word] if word == "hand" => {
            Some(tasks::ALL.iter().filter(|task| task.body == "hand").collect())
        }
        [word] if word == "extra" => Some(tasks::EXTRA.iter().collect()),
        _ => None,
    };
    if let Some(tasks) = group {
        return Ok(Named { tasks, strict: false });
    }
    let mut found: Vec<&'static Definition> = Vec::new();
    for word in words {
        let task = tasks::find(word).map_err(|error| {
            Hinted::new(error.to_string(), "`arnold-analyze tasks` lists them all")
        })?;
        if !found.iter().any(|known| known.name == task.name) {
            found.push(task);
        }
    }
    Ok(Named { tasks: found, strict: true })
}

/// A body for `task`, or what to do to get one.
pub fn environment(task: &'static Definition, bodies: &Bodies) -> anyhow::Result<Environment> {
    Environment::new(task, bodies, RewardConfiguration::Sparse).map_err(|error| match error {
        EngineError::NoModel { .. } | EngineError::WrongModel { .. } => Hinted::new(
            error.to_string(),
            "run `arnold-analyze setup --kinesis`, or name the folder that holds the published model with `--data DIR` \
             or `ARNOLD_DATA`; all other tasks work without it",
        ),
        other => other.into(),
    })
}

/// What of the named tasks can be played.
struct Playable {
    tasks: Vec<&'static Definition>,
    muscle_counts: Vec<usize>,
    left_out: Vec<LeftOut>,
    warnings: Vec<String>,
}

/// Which of the named tasks the policy fits.
fn playable(policy: &Loaded, machine: &Machine, named: &Named) -> anyhow::Result<Playable> {
    let (mut tasks, mut muscle_counts, mut left_out) = (Vec::new(), Vec::new(), Vec::new());
    let mut warnings = Vec::new();
    let trained = policy.policy.trained_tasks();
    for &task in &named.tasks {
        // A transformer can be asked to move any body; of many tasks it plays those it has learned.
        if !named.strict && !trained.is_empty() && !trained.iter().any(|name| name == task.name) {
            let reason = "the policy was not trained on it; `--task` with its name plays it".into();
            left_out.push(LeftOut { task: task.name, reason });
            continue;
        }
        let interface = match environment(task, &machine.bodies) {
            Ok(environment) => environment.interface(),
            Err(error) if named.strict => return Err(error),
            Err(error) => {
                left_out.push(LeftOut { task: task.name, reason: error.to_string() });
                continue;
            }
        };
        match policy.policy.bind(&interface, 1) {
            Ok(_) => {
                warnings.extend(policy.policy.warnings(&interface));
                tasks.push(task);
                muscle_counts.push(interface.muscle_count);
            }
            Err(error) if named.strict => {
                return Err(Hinted::new(
                    format!(
                        "`{}` cannot play `{}`: {error}",
                        policy.checkpoint_path.display(),
                        task.name
                    ),
                    "`--task all` plays every task that fits",
                ));
            }
            Err(error) => {
                let reason = reason(&error);
                left_out.push(LeftOut { task: task.name, reason });
            }
        }
    }
    if tasks.is_empty() {
        let reasons: Vec<String> =
            left_out.iter().map(|l| format!("{}: {}", l.task, l.reason)).collect();
        return Err(Hinted::new(
            format!(
                "`{}` fits none of the tasks\n  {}",
                policy.checkpoint_path.display(),
                reasons.join("\n  ")
            ),
            "`arnold-analyze inspect FILE` shows what a checkpoint expects, `arnold-analyze tasks` what tasks offer",
        ));
    }
    Ok(Playable { tasks, muscle_counts, left_out, warnings })
}

/// The same reason in the same words for every task it holds for.
fn reason(error: &policy::PolicyError) -> String {
    match error {
        policy::PolicyError::DoesNotFit { what, expected, found, .. } => {
            format!("the policy expects {expected} {what}, these have {found}")
        }
        // Each lacks a folder of its own.
        policy::PolicyError::NoExpert { .. } => {
            "there is no expert; `--task` with its name says more".to_owned()
        }
        other => other.to_string(),
    }
}

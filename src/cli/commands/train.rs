//! `train`: from experience to a policy.

use std::num::{NonZeroU64, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::{Args, ValueEnum};
use serde::Serialize;
use serde::de::DeserializeOwned;
use serde_json::{Value, json};

use crate::assets::{Cache, Part, PhysicsVersion};
use crate::cli::context::{Context, Outcome};
use crate::cli::default_policy;
use crate::cli::laboratory;
use crate::cli::progress::duration;
use crate::cli::render::{self, Hinted};
use crate::policy;
use crate::policy::shelf::{self, Choice};
use crate::sim::bodies::Bodies;
use crate::sim::rollout::Machine;
use crate::sim::tasks;
use crate::train::learner::Learner;
use crate::train::plan::{Plan, TaskPlan};
use crate::train::recipe::{
    NetworkShape, PerceptronShape, Recipe, RecipeName, Regime, TransformerShape, TransformerSize,
};
use crate::train::run::{self, Progress, RunOptions};
use crate::train::schedule::Schedule;
use crate::train::start::Start;
use crate::train::teacher::TeacherPolicy;
use crate::train::trainer::Trainer;

use super::train_csi::{self, CsiArguments};
use super::train_many;

/// How often a line is printed.
const LINE_INTERVAL: Duration = Duration::from_secs(30);
/// Tasks that a line names; of more it says the mean.
const NAMED_TASKS: usize = 4;

/// Arguments of `train`.
#[derive(Debug, Args)]
pub struct TrainArguments {
    /// What is learned from
    regime: RegimeChoice,
    /// Tasks to train on, or `all` or `hand` of the paper's; one that is named twice has twice as many environments
    #[arg(long, value_name = "NAME", num_args = 1.., value_delimiter = ',', required = true)]
    task: Vec<String>,
    /// Network: a perceptron for one task, or the muscle transformer in one of the published sizes
    /// [default: mlp, or that of `--from`]
    #[arg(long, value_name = "NAME", conflicts_with = "from")]
    pub(super) network: Option<NetworkChoice>,
    /// `mt-ppo` and `mt-sac`: the perceptron sees which task it plays, as the paper says; the published ones do not, and
    /// their numbers are reproduced without
    #[arg(long)]
    pub(super) task_index: bool,
    /// What to begin with: the folder of a run, whose optimiser goes on as well, or a checkpoint. Tasks may be others
    #[arg(long, value_name = "PATH")]
    pub(super) from: Option<PathBuf>,
    /// Logarithm of the standard deviation of actions to begin with, whatever the checkpoint has
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    pub(super) reset_std: Option<f64>,
    /// Learning rate, the same in all steps [default: the recipe's]
    #[arg(long, value_name = "X")]
    learning_rate: Option<f64>,
    /// Whom to imitate: a policy as `--policy` of other commands names it, or `TASK=POLICY` for one task
    #[arg(long, value_name = "[TASK=]POLICY", num_args = 1..)]
    teacher: Vec<String>,
    /// Constants of the training [default: own; of `mt-ppo` and `mt-sac` published]
    #[arg(long, value_name = "NAME")]
    recipe: Option<RecipeChoice>,
    /// Another value for one constant of the recipe, e.g. `discount=0.99`
    #[arg(long, value_name = "NAME=VALUE")]
    set: Vec<String>,
    /// Control steps of all environments together
    #[arg(long, value_name = "N", default_value = "1000000")]
    pub(super) steps: NonZeroU64,
    /// Environments for every task that is named [default: the recipe's]
    #[arg(long, value_name = "N")]
    envs: Option<NonZeroUsize>,
    /// Seed of all random numbers
    #[arg(long, value_name = "N", default_value_t = 0)]
    pub(super) seed: u64,
    /// Steps between two checkpoints
    #[arg(long, value_name = "N", default_value = "100000")]
    pub(super) checkpoint_steps: NonZeroU64,
    /// Episodes that are played at a checkpoint to see how good the policy is
    #[arg(long, value_name = "N", default_value_t = 20)]
    pub(super) evaluation_episodes: usize,
    /// MuJoCo version
    #[arg(long, value_name = "VERSION", default_value = "2.3.7")]
    pub(super) physics: PhysicsVersion,
    /// Worker threads; results do not depend on it [default: all cores]
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Folder of the run; one that holds this run already goes on
    /// [default: `runs/train-REGIME-TASK-seed_SEED`]
    #[arg(long, value_name = "DIR")]
    pub(super) out: Option<PathBuf>,
    #[command(flatten)]
    csi: CsiArguments,
}

/// What is learned from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum RegimeChoice {
    /// Rewards, by proximal policy optimisation
    Ppo,
    /// A teacher, whose actions are played
    Bc,
    /// A teacher, asked in the states that the student comes to
    Obc,
    /// Both that teacher and rewards
    ObcPpo,
    /// Rewards of one task, from a policy that imitated (`--from`)
    FineTune,
    /// Teachers who are asked, from a policy that imitated others (`--from`)
    Distill,
    /// A teacher, then the same again and rewards inside control subspaces of few dimensions
    Csi,
    /// Rewards of many tasks, by proximal policy optimisation of one perceptron
    MtPpo,
    /// Rewards of many tasks, by a soft actor-critic of perceptrons
    MtSac,
}

impl RegimeChoice {
    /// What it is called on the command line.
    fn word(self) -> &'static str {
        match self {
            Self::Ppo => "ppo",
            Self::Bc => "bc",
            Self::Obc => "obc",
            Self::ObcPpo => "obc-ppo",
            Self::FineTune => "fine-tune",
            Self::Distill => "distill",
            Self::Csi => "csi",
            Self::MtPpo => "mt-ppo",
            Self::MtSac => "mt-sac",
        }
    }
}

/// Named constants.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum RecipeChoice {
    /// Ours: what learns fastest from few steps
    Own,
    /// Those of the published code
    Published,
    /// Those of the paper, where the code has others
    Paper,
}

/// Networks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum NetworkChoice {
    Mlp,
    Xs,
    S,
    M,
    Full,
}

impl NetworkChoice {
    fn shape(self) -> NetworkShape {
        let transformer = |size| NetworkShape::Transformer(TransformerShape::of(size));
        match self {
            Self::Mlp => NetworkShape::Perceptron(PerceptronShape::default()),
            Self::Xs => transformer(TransformerSize::ExtraSmall),
            Self::S => transformer(TransformerSize::Small),
            Self::M => transformer(TransformerSize::Medium),
            Self::Full => transformer(TransformerSize::Full),
        }
    }
}

/// Runs the command.
pub fn run(context: &Context, arguments: &TrainArguments) -> anyhow::Result<Outcome> {
    let word = arguments.regime.word();
    let of_many = matches!(arguments.regime, RegimeChoice::MtPpo | RegimeChoice::MtSac);
    if arguments.task_index && !of_many {
        return Err(Hinted::new(
            format!("`--task-index` does not belong to `train {word}`"),
            "the perceptrons of many tasks take it: `train mt-ppo` and `train mt-sac`",
        ));
    }
    let regime = match arguments.regime {
        RegimeChoice::Csi => return train_csi::run(context, arguments, &arguments.csi),
        RegimeChoice::MtPpo => return train_many::ppo(context, arguments, word),
        RegimeChoice::MtSac => return train_many::sac(context, arguments, word),
        RegimeChoice::Ppo => Regime::Ppo,
        RegimeChoice::Bc => Regime::BehaviouralCloning,
        RegimeChoice::Obc => Regime::OnlineBehaviouralCloning,
        RegimeChoice::ObcPpo => Regime::CloningAndRewards,
        RegimeChoice::FineTune => Regime::FineTuning,
        RegimeChoice::Distill => Regime::SelfDistillation,
    };
    let start = start(context, arguments, regime)?;
    let network = start.as_ref().map(|start| start.network.clone());
    let network =
        network.unwrap_or_else(|| arguments.network.unwrap_or(NetworkChoice::Mlp).shape());
    let recipe = recipe(arguments, regime, network)?;
    let tasks = tasks(context, arguments, recipe.environments)?;
    if recipe.coefficients.imitates() {
        check_teachers(&tasks)?;
    } else {
        check_no_teachers(&tasks, word)?;
    }
    if regime == Regime::FineTuning && tasks.len() > 1 {
        return Err(Hinted::new(
            format!("fine-tuning is of one task, not {}", tasks.len()),
            "fine-tune a policy for each, and bring them together with `train distill`",
        ));
    }
    let (seed, total_steps) = (arguments.seed, arguments.steps.get());
    let plan = Plan { tasks, recipe, seed, total_steps, start };
    let machine = machine(context, arguments, &plan.tasks)?;
    carry_out::<Trainer>(context, arguments, word, plan, &machine)
}

/// Trains by `plan`, and says how it went.
pub(super) fn carry_out<L: Learner>(
    context: &Context,
    arguments: &TrainArguments,
    word: &str,
    plan: Plan<L::Recipe>,
    machine: &Machine,
) -> anyhow::Result<Outcome> {
    let names: Vec<&str> = plan.tasks.iter().map(|task| task.definition.name).collect();
    let every = names.iter().eq(tasks::ALL.iter().map(|task| &task.name));
    let place = if every { "all".to_owned() } else { names.join("+") };
    let folder = arguments
        .out
        .clone()
        .unwrap_or_else(|| format!("runs/train-{word}-{place}-seed_{}", arguments.seed).into());
    let options = RunOptions {
        folder: folder.clone(),
        physics: arguments.physics.to_string(),
        checkpoint_steps: arguments.checkpoint_steps.get(),
        evaluation_episodes: arguments.evaluation_episodes,
    };
    context.say(&format!(
        "Training: {word} on {}, {} steps, seed {}\nFolder: {}\n",
        names.join(", "),
        plan.total_steps,
        plan.seed,
        folder.display()
    ));
    let mut line = Line::new(context, &plan);
    let path = run::train::<L>(plan, machine, &options, &mut |progress| line.show(progress))
        .with_context(|| format!("the run in `{}` stopped", folder.display()))?;
    let result = json!({
        "policy": path,
        "solved_fraction": line.evaluation,
        "steps": line.steps,
    });
    if context.json {
        render::print_json(&result)?;
    } else {
        render::print_text(&format!("Trained policy: {}\n", path.display()))?;
    }
    Ok(Outcome::Done)
}

/// Physics and models for `tasks`.
pub(super) fn machine(
    context: &Context,
    arguments: &TrainArguments,
    tasks: &[TaskPlan],
) -> anyhow::Result<Machine> {
    let cache = Cache::locate();
    let models = laboratory::available(context, &cache, Part::MyoSuite, Cache::myosuite)?;
    let library = laboratory::open_library(context, &cache, arguments.physics)?;
    let machine = Machine {
        bodies: Arc::new(Bodies::new(library, &models, &context.data)),
        threads: arguments.threads.map_or_else(laboratory::all_cores, NonZeroUsize::get),
        batch: 1,
    };
    // Says what to fetch if a task's model is not here.
    for task in tasks {
        laboratory::environment(task.definition, &machine.bodies)?;
    }
    Ok(machine)
}

/// Sees that every task has a teacher.
pub(super) fn check_teachers(tasks: &[TaskPlan]) -> anyhow::Result<()> {
    let Some(task) = tasks.iter().find(|task| task.teacher.is_none()) else { return Ok(()) };
    let name = task.definition.name;
    Err(Hinted::new(
        format!("there is no teacher for `{name}`"),
        format!(
            "name one with `--teacher {name}=POLICY`, or one for all tasks with `--teacher POLICY`"
        ),
    ))
}

/// Sees that no task has a teacher.
pub(super) fn check_no_teachers(tasks: &[TaskPlan], word: &str) -> anyhow::Result<()> {
    if tasks.iter().all(|task| task.teacher.is_none()) {
        return Ok(());
    }
    Err(Hinted::new(
        format!("`train {word}` learns from rewards and asks no teacher"),
        "leave `--teacher` out, or use `train obc` or `train obc-ppo`",
    ))
}

/// Which recipe was asked for, if not `other`.
pub(super) fn recipe_name(arguments: &TrainArguments, other: RecipeName) -> RecipeName {
    match arguments.recipe {
        Some(RecipeChoice::Own) => RecipeName::Own,
        Some(RecipeChoice::Published) => RecipeName::Published,
        Some(RecipeChoice::Paper) => RecipeName::Paper,
        None => other,
    }
}

/// The recipe that was asked for.
fn recipe(
    arguments: &TrainArguments,
    regime: Regime,
    network: NetworkShape,
) -> anyhow::Result<Recipe> {
    let name = recipe_name(arguments, RecipeName::Own);
    altered(arguments, Recipe::new(regime, name, network))
}

/// A recipe with everything that was asked to be otherwise.
pub(super) fn altered(arguments: &TrainArguments, recipe: Recipe) -> anyhow::Result<Recipe> {
    let recipe: Recipe = assigned(arguments, recipe)?;
    let reset_deviation = arguments.reset_std.or(recipe.reset_deviation);
    Ok(Recipe { reset_deviation, ..recipe })
}

/// A recipe of any algorithm with the constants that were given another value.
pub(super) fn assigned<R: Serialize + DeserializeOwned>(
    arguments: &TrainArguments,
    mut recipe: R,
) -> anyhow::Result<R> {
    for assignment in &arguments.set {
        recipe = changed(&recipe, assignment)?;
    }
    if let Some(environments) = arguments.envs {
        recipe = with_constant(&recipe, "environments", json!(environments))
            .map_err(anyhow::Error::msg)?;
    }
    if let Some(rate) = arguments.learning_rate {
        recipe = with_constant(&recipe, "learning_rate", json!(Schedule::Constant(rate)))
            .map_err(anyhow::Error::msg)?;
    }
    Ok(recipe)
}

/// What the run begins with, if not with nothing.
fn start(
    context: &Context,
    arguments: &TrainArguments,
    regime: Regime,
) -> anyhow::Result<Option<Start>> {
    let Some(path) = &arguments.from else {
        return if matches!(regime, Regime::FineTuning | Regime::SelfDistillation) {
            let word = arguments.regime.word();
            Err(Hinted::new(
                format!("`train {word}` goes on with a policy, and there is none"),
                "name the folder of a run or a checkpoint with `--from`",
            ))
        } else {
            Ok(None)
        };
    };
    open_start(context, path).map(Some)
}

pub(super) fn open_start(context: &Context, path: &Path) -> anyhow::Result<Start> {
    let start = Start::open(path).map_err(|error| {
        let hint =
            "give the folder of a run of `train`, or a checkpoint of a transformer or a perceptron";
        Hinted::new(error.to_string(), hint)
    })?;
    if !start.has_memory() {
        context.say(&format!(
            "warning: no state of its run lies beside `{}`; the optimiser starts anew",
            start.path.display()
        ));
    }
    Ok(start)
}

/// The tasks with their teachers.
pub(super) fn tasks(
    context: &Context,
    arguments: &TrainArguments,
    environments: usize,
) -> anyhow::Result<Vec<TaskPlan>> {
    let mut tasks: Vec<TaskPlan> = Vec::new();
    for word in &arguments.task {
        for definition in laboratory::named_tasks(std::slice::from_ref(word))?.tasks {
            match tasks.iter_mut().find(|task| task.definition.name == definition.name) {
                Some(known) => known.environments += environments,
                None => tasks.push(TaskPlan { definition, environments, teacher: None }),
            }
        }
    }
    for word in &arguments.teacher {
        // A file's name may hold the sign, too.
        let (task, name) = match word.split_once('=') {
            Some((task, name)) if tasks::find(task).is_ok() => (Some(task), name),
            _ => (None, word.as_str()),
        };
        if let Some(task) = task.filter(|name| !tasks.iter().any(|t| t.definition.name == *name)) {
            return Err(Hinted::new(
                format!("`--teacher {word}`: `{task}` is not trained on"),
                "name a task of `--task`, or leave the name out to give one teacher for all",
            ));
        }
        let taught = |t: &&mut TaskPlan| task.is_none_or(|name| t.definition.name == name);
        let names: Vec<&str> = tasks.iter_mut().filter(taught).map(|t| t.definition.name).collect();
        let teacher = teacher(context, name, &names)?;
        for task in tasks.iter_mut().filter(taught) {
            task.teacher = Some(teacher.clone());
        }
    }
    Ok(tasks)
}

/// Opens whom to imitate in `tasks`.
fn teacher(context: &Context, name: &str, tasks: &[&str]) -> anyhow::Result<TeacherPolicy> {
    let hint = "give a checkpoint file or the folder of a run with `--teacher`";
    let refuse = |error: policy::PolicyError| Hinted::new(error.to_string(), hint);
    let data = default_policy::shelf_of(Path::new(name), &context.data, &Cache::locate())?;
    let loaded = match shelf::find(Path::new(name), &data).map_err(refuse)? {
        Choice::File(path) => policy::open(&path, None).map_err(refuse)?,
        Choice::Experts(table) => policy::open_experts(&table, tasks, &data).map_err(refuse)?,
    };
    for warning in &loaded.warnings {
        context.say(&format!("warning: {warning}"));
    }
    let hash = [&loaded.checkpoint_hash, loaded.normaliser_hash.as_deref().unwrap_or("")].join("+");
    Ok(TeacherPolicy { name: loaded.name, hash, policy: loaded.policy })
}

/// The recipe with one constant changed.
fn changed<R: Serialize + DeserializeOwned>(recipe: &R, assignment: &str) -> anyhow::Result<R> {
    let hint = "write `--set NAME=VALUE` with a name of the run's `args.json`, e.g. `--set coefficients.clip=0.2`";
    let refuse = |why: String| Hinted::new(format!("`--set {assignment}`: {why}"), hint);
    let (name, value) =
        assignment.split_once('=').ok_or_else(|| refuse("there is no `=`".to_owned()))?;
    let value = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
    with_constant(recipe, name, value).map_err(refuse)
}

/// The recipe with another value for the constant called `name`, or why not.
fn with_constant<R: Serialize + DeserializeOwned>(
    recipe: &R,
    name: &str,
    value: Value,
) -> Result<R, String> {
    let mut document = serde_json::to_value(recipe).map_err(|error| error.to_string())?;
    let place = document
        .pointer_mut(&format!("/{}", name.replace('.', "/")))
        .ok_or_else(|| "there is no such constant".to_owned())?;
    *place = value;
    serde_json::from_value(document).map_err(|error| error.to_string())
}

/// The line that says how a run goes.
pub(super) struct Line<'a> {
    context: &'a Context,
    total: u64,
    tasks: Vec<&'static str>,
    last: Option<Instant>,
    evaluation: Option<Vec<f64>>,
    steps: u64,
}

impl<'a> Line<'a> {
    pub(super) fn new<R: Serialize>(context: &'a Context, plan: &Plan<R>) -> Self {
        let tasks = plan.tasks.iter().map(|task| task.definition.name).collect();
        let total = plan.last_step();
        Self { context, total, tasks, last: None, evaluation: None, steps: 0 }
    }

    pub(super) fn show(&mut self, progress: &Progress<'_>) {
        let report = progress.report;
        self.steps = report.steps;
        if let Some(evaluation) = progress.evaluation {
            self.evaluation = Some(evaluation.to_vec());
        }
        let is_due = self.last.is_none_or(|last| last.elapsed() >= LINE_INTERVAL);
        if !is_due && progress.evaluation.is_none() {
            return;
        }
        self.last = Some(Instant::now());
        let (steps, seconds) = progress.pace;
        let rate = steps as f64 / seconds.max(1e-9);
        let left = self.total.saturating_sub(report.steps) as f64 / rate.max(1e-9);
        let evaluated =
            progress.evaluation.map(|fractions| format!(", evaluated {}", self.by_task(fractions)));
        self.context.say(&format!(
            "{}/{} steps, {rate:.0} per s, solved {}{}, {} left",
            report.steps,
            self.total,
            self.by_task(&report.solved),
            evaluated.unwrap_or_default(),
            duration(left)
        ));
    }
    /// A number for every task.
    fn by_task(&self, numbers: &[f64]) -> String {
        if self.tasks.len() > NAMED_TASKS {
            let mean = numbers.iter().sum::<f64>() / numbers.len() as f64;
            return format!("{mean:.3} (mean of {} tasks)", self.tasks.len());
        }
        let text = |(task, number): (&&str, &f64)| format!("{task} {number:.3}");
        let texts: Vec<String> = self.tasks.iter().zip(numbers).map(text).collect();
        texts.join(", ")
    }
}

//! `train`: from experience to a policy.

use std::num::{NonZeroU64, NonZeroUsize};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use anyhow::Context as _;
use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use crate::assets::{Cache, Part, PhysicsVersion};
use crate::cli::context::{Context, Outcome};
use crate::cli::laboratory;
use crate::cli::progress::duration;
use crate::cli::render::{self, Hinted};
use crate::policy;
use crate::policy::shelf::{self, Choice};
use crate::sim::bodies::Bodies;
use crate::sim::rollout::Machine;
use crate::sim::tasks;
use crate::train::recipe::{
    NetworkShape, PerceptronShape, Recipe, RecipeName, Regime, TransformerShape, TransformerSize,
};
use crate::train::run::{self, Progress, RunOptions};
use crate::train::schedule::Schedule;
use crate::train::start::Start;
use crate::train::teacher::TeacherPolicy;
use crate::train::trainer::{Plan, TaskPlan};

use super::train_csi::{self, CsiArguments};

/// How often a line is printed.
const LINE_INTERVAL: Duration = Duration::from_secs(30);

/// Arguments of `train`.
#[derive(Debug, Args)]
pub struct TrainArguments {
    /// What is learned from
    regime: RegimeChoice,
    /// Tasks to train on; one that is named twice has twice as many environments
    #[arg(long, value_name = "NAME", num_args = 1.., value_delimiter = ',', required = true)]
    task: Vec<String>,
    /// Network: a perceptron for one task, or the muscle transformer in one of the published sizes
    /// [default: mlp, or that of `--from`]
    #[arg(long, value_name = "NAME", conflicts_with = "from")]
    network: Option<NetworkChoice>,
    /// What to begin with: the folder of a run, whose optimiser goes on as well, or a checkpoint. Tasks may be others
    #[arg(long, value_name = "PATH")]
    pub(super) from: Option<PathBuf>,
    /// Logarithm of the standard deviation of actions to begin with, whatever the checkpoint has
    #[arg(long, value_name = "X", allow_negative_numbers = true)]
    reset_std: Option<f64>,
    /// Learning rate, the same in all steps [default: the recipe's]
    #[arg(long, value_name = "X")]
    learning_rate: Option<f64>,
    /// Whom to imitate: a policy as `--policy` of other commands names it, or `TASK=POLICY` for one task
    #[arg(long, value_name = "[TASK=]POLICY", num_args = 1..)]
    teacher: Vec<String>,
    /// Constants of the training
    #[arg(long, value_name = "NAME", default_value = "own")]
    recipe: RecipeChoice,
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
}

impl RegimeChoice {
    /// Its name, and what it is if it is a single run.
    fn meaning(self) -> (&'static str, Option<Regime>) {
        let (word, regime) = match self {
            Self::Csi => return ("csi", None),
            Self::Ppo => ("ppo", Regime::Ppo),
            Self::Bc => ("bc", Regime::BehaviouralCloning),
            Self::Obc => ("obc", Regime::OnlineBehaviouralCloning),
            Self::ObcPpo => ("obc-ppo", Regime::CloningAndRewards),
            Self::FineTune => ("fine-tune", Regime::FineTuning),
            Self::Distill => ("distill", Regime::SelfDistillation),
        };
        (word, Some(regime))
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
enum NetworkChoice {
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
    let (word, regime) = arguments.regime.meaning();
    let Some(regime) = regime else {
        return train_csi::run(context, arguments, &arguments.csi);
    };
    let start = start(context, arguments, regime)?;
    let network = start.as_ref().map(|start| start.network.clone());
    let network =
        network.unwrap_or_else(|| arguments.network.unwrap_or(NetworkChoice::Mlp).shape());
    let recipe = recipe(arguments, regime, network)?;
    let tasks = tasks(context, arguments, recipe.environments)?;
    if !recipe.coefficients.imitates() && tasks.iter().any(|task| task.teacher.is_some()) {
        return Err(Hinted::new(
            format!("`train {word}` learns from rewards and asks no teacher"),
            "leave `--teacher` out, or use `train obc` or `train obc-ppo`",
        ));
    }
    if recipe.coefficients.imitates() {
        check_teachers(&tasks)?;
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
    let names: Vec<&str> = plan.tasks.iter().map(|task| task.definition.name).collect();
    let folder = arguments.out.clone().unwrap_or_else(|| {
        format!("runs/train-{word}-{}-seed_{}", names.join("+"), arguments.seed).into()
    });
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
    let path = run::train(plan, &machine, &options, &mut |progress| line.show(progress))
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
        batch: 8,
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

/// The recipe that was asked for.
fn recipe(
    arguments: &TrainArguments,
    regime: Regime,
    network: NetworkShape,
) -> anyhow::Result<Recipe> {
    let name = match arguments.recipe {
        RecipeChoice::Own => RecipeName::Own,
        RecipeChoice::Published => RecipeName::Published,
        RecipeChoice::Paper => RecipeName::Paper,
    };
    altered(arguments, Recipe::new(regime, name, network))
}

/// A recipe with everything that was asked to be otherwise.
pub(super) fn altered(arguments: &TrainArguments, mut recipe: Recipe) -> anyhow::Result<Recipe> {
    for assignment in &arguments.set {
        recipe = changed(&recipe, assignment)?;
    }
    if let Some(environments) = arguments.envs {
        recipe.environments = environments.get();
    }
    if let Some(rate) = arguments.learning_rate {
        recipe.learning_rate = Schedule::Constant(rate);
    }
    recipe.reset_deviation = arguments.reset_std.or(recipe.reset_deviation);
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
            let (word, _) = arguments.regime.meaning();
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
        let definition = tasks::find(word).map_err(|error| {
            Hinted::new(error.to_string(), "`arnold-analyze tasks` lists them all")
        })?;
        match tasks.iter_mut().find(|task| task.definition.name == definition.name) {
            Some(known) => known.environments += environments,
            None => tasks.push(TaskPlan { definition, environments, teacher: None }),
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
    let loaded = match shelf::find(Path::new(name), &context.data).map_err(refuse)? {
        Choice::File(path) => policy::open(&path, None).map_err(refuse)?,
        Choice::Experts(table) => {
            policy::open_experts(&table, tasks, &context.data).map_err(refuse)?
        }
    };
    for warning in &loaded.warnings {
        context.say(&format!("warning: {warning}"));
    }
    let hash = [&loaded.checkpoint_hash, loaded.normaliser_hash.as_deref().unwrap_or("")].join("+");
    Ok(TeacherPolicy { name: loaded.name, hash, policy: loaded.policy })
}

/// The recipe with one constant changed.
fn changed(recipe: &Recipe, assignment: &str) -> anyhow::Result<Recipe> {
    let hint = "write `--set NAME=VALUE` with a name of the run's `args.json`, e.g. `--set coefficients.clip=0.2`";
    let refuse = |why: String| Hinted::new(format!("`--set {assignment}`: {why}"), hint);
    let (name, value) =
        assignment.split_once('=').ok_or_else(|| refuse("there is no `=`".to_owned()))?;
    let mut document = serde_json::to_value(recipe)?;
    let place = document
        .pointer_mut(&format!("/{}", name.replace('.', "/")))
        .ok_or_else(|| refuse("there is no such constant".to_owned()))?;
    *place = serde_json::from_str(value).unwrap_or_else(|_| Value::String(value.to_owned()));
    serde_json::from_value(document).map_err(|error| refuse(error.to_string()))
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
    pub(super) fn new(context: &'a Context, plan: &Plan) -> Self {
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
        let solved: Vec<String> = self
            .tasks
            .iter()
            .zip(&report.solved)
            .map(|(task, solved)| format!("{task} {solved:.3}"))
            .collect();
        let evaluated = progress.evaluation.map(|fractions| {
            let texts: Vec<String> = fractions.iter().map(|x| format!("{x:.3}")).collect();
            format!(", evaluated {}", texts.join(" "))
        });
        self.context.say(&format!(
            "{}/{} steps, {rate:.0} per s, solved {}{}, {} left",
            report.steps,
            self.total,
            solved.join(", "),
            evaluated.unwrap_or_default(),
            duration(left)
        ));
    }
}

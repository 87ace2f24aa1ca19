//! `train csi`: how few dimensions does control need, if it may be learned again inside them? (`spec/training.md` §5.9)
//!
//! A perceptron imitates a teacher; the principal components of its sampled actions span subspaces; and inside each, of `n`
//! dimensions, the perceptron is played as it is, imitates again, or learns from rewards, with directions and mean trained
//! along. What is left in the folder:
//!
//! | path | what it is |
//! | --- | --- |
//! | `base/` | the run in the whole space, or nothing if `--from` names one |
//! | `subspace.npy`, `mean.npy`, `explained_variance.npy` | components by falling variance |
//! | `frozen/`, `obc/`, `ppo/` | a run for every number of dimensions and seed |
//! | `benchmarks/` | results in the published layout: `evaluate --benchmarks` draws the curves |

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;
use serde_json::{Map, Value, json};

use crate::analysis::subspace::{Covariance, PrincipalComponents, principal_components};
use crate::cli::context::{Context, Outcome};
use crate::cli::render;
use crate::experiment::evaluation::evaluate_task;
use crate::experiment::seed;
use crate::files;
use crate::npz::{Array, Elements, Member, write_npy};
use crate::policy::checkpoint::contents::{Tensor, TensorMap};
use crate::policy::{self, Policy};
use crate::sim::rollout::{self, ActionMode, Channels, Machine, RolloutPlan};
use crate::sim::tasks::{Definition, RewardConfiguration};
use crate::train::plan::{Plan, TaskPlan};
use crate::train::recipe::{NetworkShape, PerceptronShape, Recipe, SubspacePhase, SubspaceShape};
use crate::train::run::{self, RunOptions};
use crate::train::start::Start;
use crate::train::trainer::Trainer;

use super::train::{self, Line, TrainArguments};

/// Episodes that are played at once to find the subspace.
const BLOCK: usize = 100;
/// Seeds that the published runs of an arm are known by.
const SEEDS: usize = 3;

/// Arguments of `train csi` alone.
#[derive(Debug, Args)]
#[command(next_help_heading = "Training inside a control subspace")]
pub(super) struct CsiArguments {
    /// Numbers of dimensions
    #[arg(long, value_name = "N", num_args = 1.., value_delimiter = ',',
          default_values_t = [1, 2, 5, 10, 20, 30, 40],
          value_parser = clap::value_parser!(u16).range(1..))]
    dimensions: Vec<u16>,
    /// Runs of each arm that is trained, at most three
    #[arg(long, value_name = "N", default_value_t = 1,
          value_parser = clap::value_parser!(u8).range(1..=SEEDS as i64))]
    runs: u8,
    /// Episodes whose actions the subspace is made of
    #[arg(long, value_name = "N", default_value_t = 1000)]
    subspace_episodes: usize,
    /// Episodes of a result
    #[arg(long, value_name = "N", default_value = "200")]
    result_episodes: NonZeroUsize,
}

/// A way to act inside a subspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Arm {
    Frozen,
    Imitation,
    Rewards,
}

impl Arm {
    const ALL: [Self; 3] = [Self::Frozen, Self::Imitation, Self::Rewards];

    fn word(self) -> &'static str {
        match self {
            Self::Frozen => "frozen",
            Self::Imitation => "obc",
            Self::Rewards => "ppo",
        }
    }

    /// The published folder of its results, and how the names of its runs begin.
    fn published(self) -> (&'static str, &'static [&'static str]) {
        match self {
            Self::Frozen => ("csi_notrain_server", &["111_gpu_csi_all_bc_student"]),
            Self::Imitation => ("csi_bc_server", &["666", "777", "888"]),
            Self::Rewards => ("csi_server", &["333", "444", "555"]),
        }
    }

    fn phase(self) -> SubspacePhase {
        match self {
            Self::Frozen | Self::Imitation => SubspacePhase::Imitation,
            Self::Rewards => SubspacePhase::Rewards,
        }
    }
}

/// What all runs share.
struct Bench<'a> {
    context: &'a Context,
    arguments: &'a TrainArguments,
    task: TaskPlan,
    machine: Machine,
    folder: PathBuf,
    /// Episodes of a result.
    episodes: usize,
}

/// Runs the command.
pub(super) fn run(
    context: &Context,
    arguments: &TrainArguments,
    csi: &CsiArguments,
) -> anyhow::Result<Outcome> {
    let tasks = train::tasks(context, arguments, 1)?;
    train::check_teachers(&tasks)?;
    let [task] = tasks.as_slice() else {
        return Err(render::Hinted::new(
            format!("a subspace is of one task, not {}", tasks.len()),
            "run `train csi` once for every task",
        ));
    };
    let name = task.definition.name;
    let folder = arguments
        .out
        .clone()
        .unwrap_or_else(|| format!("runs/train-csi-{name}-seed_{}", arguments.seed).into());
    let machine = train::machine(context, arguments, &tasks)?;
    let episodes = csi.result_episodes.get();
    let bench = Bench { context, arguments, task: task.clone(), machine, folder, episodes };
    let base = match &arguments.from {
        Some(path) => path.clone(),
        None => bench.train("base", None, SubspacePhase::Base, None, 0)?,
    };
    let start = train::open_start(context, &base)?;
    let loaded = policy::open(&start.path, None)?;
    let components = bench.components(loaded.policy.as_ref(), csi.subspace_episodes)?;
    bench.write_components(&components)?;
    bench.evaluate_teacher()?;
    let mut rows = Vec::new();
    for &size in &csi.dimensions {
        for arm in Arm::ALL {
            let (_, prefixes) = arm.published();
            for (seat, prefix) in prefixes.iter().take(csi.runs.into()).enumerate() {
                let solved = bench.arm((arm, prefix, seat), size.into(), &start, &components)?;
                let word = arm.word();
                context
                    .say(&format!("{word}, {size} dimensions, run {prefix}: solved {solved:.3}"));
                rows.push(json!({
                    "dimensions": size, "arm": word, "run": prefix, "solved_fraction": solved,
                }));
            }
        }
    }
    let benchmarks = bench.folder.join("benchmarks");
    if context.json {
        render::print_json(&json!({"task": name, "benchmarks": benchmarks, "results": rows}))?;
    } else {
        render::print_text(&format!("Results: {}\n", benchmarks.display()))?;
    }
    Ok(Outcome::Done)
}

impl Bench<'_> {
    /// Trains in the folder `name` and returns the file of the policy.
    fn train(
        &self,
        name: &str,
        start: Option<Start>,
        phase: SubspacePhase,
        subspace: Option<SubspaceShape>,
        seat: usize,
    ) -> anyhow::Result<PathBuf> {
        let mut recipe = Recipe::of_subspace(phase, subspace);
        if let Some(NetworkShape::Perceptron(shape)) = start.as_ref().map(|start| &start.network) {
            recipe.network =
                NetworkShape::Perceptron(PerceptronShape { subspace, ..shape.clone() });
        }
        let recipe = train::altered(self.arguments, recipe)?;
        let mut task = self.task.clone();
        task.environments = recipe.environments;
        if !recipe.coefficients.imitates() {
            task.teacher = None;
        }
        let frozen = subspace.is_some_and(|subspace| !subspace.trainable);
        let total_steps = if frozen { 0 } else { self.arguments.steps.get() };
        let seed = self.arguments.seed + seat as u64;
        let plan = Plan { tasks: vec![task], recipe, seed, total_steps, start };
        let folder = self.folder.join(name);
        let options = RunOptions {
            folder: folder.clone(),
            physics: self.arguments.physics.to_string(),
            checkpoint_steps: self.arguments.checkpoint_steps.get(),
            evaluation_episodes: self.arguments.evaluation_episodes,
        };
        self.context.say(&format!("Training: {}", folder.display()));
        let mut line = Line::new(self.context, &plan);
        Ok(run::train::<Trainer>(plan, &self.machine, &options, &mut |progress| {
            line.show(progress);
        })?)
    }

    fn plan<'a>(&self, policy: &'a dyn Policy, mode: ActionMode) -> RolloutPlan<'a> {
        RolloutPlan {
            task: self.definition(),
            policy,
            mode,
            action_noise: 0.0,
            projections: &[],
            channels: Channels::All,
            rewards: RewardConfiguration::Sparse,
        }
    }

    fn definition(&self) -> &'static Definition {
        self.task.definition
    }

    /// Principal components of what the policy sends to the muscles when its actions are sampled.
    fn components(
        &self,
        policy: &dyn Policy,
        episodes: usize,
    ) -> anyhow::Result<PrincipalComponents> {
        let plan = self.plan(policy, ActionMode::Stochastic);
        let name = self.definition().name;
        let mut covariance: Option<Covariance> = None;
        for first in (0..episodes).step_by(BLOCK) {
            let numbers = first..episodes.min(first + BLOCK);
            let spec = |i| seed::episode(self.arguments.seed, name, i, None);
            let specs: Vec<_> = numbers.map(spec).collect();
            for episode in rollout::play(&self.machine, &plan, &specs, &|_| ())? {
                let actions = &episode.recording.action;
                let muscles = actions.len() / episode.steps.max(1);
                let sums = covariance.get_or_insert_with(|| Covariance::new(muscles));
                sums.push_rows(actions)?;
            }
        }
        Ok(principal_components(&covariance.unwrap_or_else(|| Covariance::new(1)))?)
    }

    fn write_components(&self, components: &PrincipalComponents) -> anyhow::Result<()> {
        let muscles = components.muscle_count();
        let total: f64 = components.variances.iter().sum();
        let shares = components.variances.iter().map(|variance| variance / total).collect();
        for (name, shape, numbers) in [
            ("subspace.npy", vec![muscles, muscles], components.components.clone()),
            ("mean.npy", vec![muscles], components.mean.clone()),
            ("explained_variance.npy", vec![muscles], shares),
        ] {
            let array = Array { shape, elements: Elements::F64(numbers) };
            write_npy(&self.folder.join(name), &Member::Numbers(array))?;
        }
        Ok(())
    }

    /// One run of one arm; its mean solved fraction.
    fn arm(
        &self,
        (arm, prefix, seat): (Arm, &str, usize),
        size: usize,
        start: &Start,
        components: &PrincipalComponents,
    ) -> anyhow::Result<f64> {
        let muscles = components.muscle_count();
        let tensor = |shape: Vec<usize>, numbers: &[f64]| Tensor {
            shape,
            data: numbers.iter().map(|&x| x as f32).collect(),
        };
        let tensors: TensorMap = [
            ("projection".to_owned(), tensor(vec![muscles; 2], &components.components)),
            ("mean".to_owned(), tensor(vec![muscles], &components.mean)),
        ]
        .into();
        let mut start = start.clone().with_tensors(tensors);
        if arm == Arm::Imitation {
            // As published: this arm meets its observations anew.
            start = start.without_statistics();
        }
        let subspace = SubspaceShape { size, trainable: arm != Arm::Frozen };
        let steps = start.steps + if subspace.trainable { self.arguments.steps.get() } else { 0 };
        let run = format!("{}/csi{size}/run_{prefix}", arm.word());
        let file = self.train(&run, Some(start), arm.phase(), Some(subspace), seat)?;
        let loaded = policy::open(&file, None)?;
        let name = self.definition().name;
        let (folder, _) = arm.published();
        let path = format!("{folder}/csi{size}_all/{prefix}_{name}_model_{steps}_steps_csi_{size}");
        self.evaluate(loaded.policy.as_ref(), ActionMode::Stochastic, &path)
    }

    /// The expert that performance is relative to.
    fn evaluate_teacher(&self) -> anyhow::Result<()> {
        if let Some(teacher) = &self.task.teacher {
            let path = format!("expert_policies/expert_{}", self.definition().name);
            self.evaluate(teacher.policy.as_ref(), ActionMode::Deterministic, &path)?;
        }
        Ok(())
    }

    /// Writes a result file and returns the mean solved fraction.
    fn evaluate(&self, policy: &dyn Policy, mode: ActionMode, name: &str) -> anyhow::Result<f64> {
        let plan = self.plan(policy, mode);
        let played =
            evaluate_task(&self.machine, &plan, self.episodes, self.arguments.seed, &|_| ())?;
        let record = played.benchmark_record()?;
        let mut tasks = Map::new();
        tasks.insert(self.definition().name.to_owned(), serde_json::to_value(&record)?);
        let path = self.folder.join("benchmarks").join(format!("{name}_results.json"));
        if let Some(folder) = path.parent() {
            files::create_folder(folder)?;
        }
        let mut text = serde_json::to_vec_pretty(&Value::Object(tasks))?;
        text.push(b'\n');
        files::write_atomic(&path, &text)?;
        Ok(record.avg_solved_step_frac)
    }
}

//! `train mt-ppo` and `train mt-sac`: the perceptrons of many tasks that the article compares with (`spec/training.md` §5.10).
//!
//! One perceptron sees the windows of every task, padded to the largest, and moves as many muscles as the largest has. The
//! published ones were not told which task they play, and the default is theirs; `--task-index` tells.

use super::train::{self, TrainArguments, carry_out};
use crate::cli::context::{Context, Outcome};
use crate::cli::render::Hinted;
use crate::train::plan::Plan;
use crate::train::recipe::{NetworkShape, PerceptronShape, Recipe, RecipeName, WindowsShape};
use crate::train::soft::recipe::SoftRecipe;
use crate::train::soft::trainer::{SoftTrainer, replay_bytes};
use crate::train::trainer::Trainer;

/// Runs `train mt-ppo`.
pub(super) fn ppo(
    context: &Context,
    arguments: &TrainArguments,
    word: &str,
) -> anyhow::Result<Outcome> {
    check_network(arguments, word)?;
    let start = match &arguments.from {
        Some(path) => Some(train::open_start(context, path)?),
        None => None,
    };
    let mut recipe = Recipe::of_many_tasks(train::recipe_name(arguments, RecipeName::Published));
    if let Some(start) = &start {
        recipe.network = start.network.clone();
    }
    let NetworkShape::Perceptron(PerceptronShape { windows: Some(windows), .. }) =
        &mut recipe.network
    else {
        return Err(Hinted::new(
            format!("`train {word}` does not go on with a network of that kind"),
            "give `--from` a run of `train mt-ppo`, or use the command that made the other one",
        ));
    };
    told(arguments, windows);
    let recipe = train::altered(arguments, recipe)?;
    let tasks = train::tasks(context, arguments, recipe.environments)?;
    train::check_no_teachers(&tasks, word)?;
    let machine = train::machine(context, arguments, &tasks)?;
    let (seed, total_steps) = (arguments.seed, arguments.steps.get());
    let plan = Plan { tasks, recipe, seed, total_steps, start };
    carry_out::<Trainer>(context, arguments, word, plan, &machine)
}

/// Runs `train mt-sac`.
pub(super) fn sac(
    context: &Context,
    arguments: &TrainArguments,
    word: &str,
) -> anyhow::Result<Outcome> {
    check_network(arguments, word)?;
    if arguments.from.is_some() || arguments.reset_std.is_some() {
        return Err(Hinted::new(
            format!("`train {word}` begins with nothing but its own folder"),
            "leave `--from` and `--reset-std` out; the same command in the same folder goes on",
        ));
    }
    let mut recipe = SoftRecipe::new(train::recipe_name(arguments, RecipeName::Published));
    told(arguments, &mut recipe.network.windows);
    let recipe = train::assigned(arguments, recipe)?;
    let tasks = train::tasks(context, arguments, recipe.environments)?;
    train::check_no_teachers(&tasks, word)?;
    let machine = train::machine(context, arguments, &tasks)?;
    let (seed, total_steps) = (arguments.seed, arguments.steps.get());
    let plan = Plan { tasks, recipe, seed, total_steps, start: None };
    let megabytes = replay_bytes(&plan, &machine.bodies)?.div_ceil(1_000_000);
    context.say(&format!(
        "Replay buffer: {} steps, {megabytes} MB of memory when it is full, as much on disk",
        plan.recipe.buffer
    ));
    carry_out::<SoftTrainer>(context, arguments, word, plan, &machine)
}

/// Lets a perceptron see its task, if that was asked for.
fn told(arguments: &TrainArguments, windows: &mut WindowsShape) {
    windows.task_index |= arguments.task_index;
}

/// Refuses another network.
fn check_network(arguments: &TrainArguments, word: &str) -> anyhow::Result<()> {
    if arguments.network.is_none() {
        return Ok(());
    }
    Err(Hinted::new(
        format!("`train {word}` trains a perceptron of its own"),
        "leave `--network` out; `--set` changes its layers, under the name that `args.json` gives them",
    ))
}

//! Which policy plays: the one that was named, or the default; and whose components it plays in.

use std::path::Path;

use crate::assets::{CARRIED_EXPERTS, Cache};
use crate::policy::shelf::{self, Choice};
use crate::policy::{self, Loaded, ObservationVariant};
use crate::sim::rollout::ActionMode;

use super::context::Context;
use super::default_policy;
use super::explain;
use super::laboratory::{self, Laboratory};
use super::render::Hinted;

impl Laboratory {
    /// Opens the policy whose actions make the components. It must play all tasks, and as the first one does.
    pub fn take_components_of(&mut self, context: &Context, name: &Path) -> anyhow::Result<()> {
        let tasks: Vec<&str> = self.tasks.iter().map(|task| task.name).collect();
        let other = open(context, name, None, &tasks, &Cache::locate())?;
        if self.mode == ActionMode::Stochastic && !other.policy.is_stochastic() {
            return Err(Hinted::new(
                format!(
                    "`{}` does not say how it explores, so its actions cannot be sampled",
                    other.name
                ),
                "`--deterministic` plays the mean actions of both",
            ));
        }
        for task in &self.tasks {
            let interface = laboratory::environment(task, &self.machine.bodies)?.interface();
            other.policy.bind(&interface, 1).map_err(|error| {
                Hinted::new(
                    format!("`{}` cannot play `{}`: {error}", other.name, task.name),
                    "choose tasks that both policies can play with `--task NAME…`",
                )
            })?;
        }
        context.say(&format!("Components of: {}\n", other.checkpoint_path.display()));
        self.components_of = Some(other);
        Ok(())
    }
}

/// The policy, and why that one.
pub(super) fn choose(
    context: &Context,
    named: Option<&Path>,
    normaliser: Option<&Path>,
    tasks: &[&str],
    cache: &Cache,
) -> anyhow::Result<(Loaded, &'static str)> {
    let (name, chosen_because) = if let Some(name) = named {
        (name.to_path_buf(), "named by `--policy`")
    } else {
        let (name, origin) = default_policy::choose(&context.data, cache, tasks)?;
        (name, origin.reason())
    };
    if name.as_os_str() == RANDOM {
        if normaliser.is_some() {
            return Err(Hinted::new(
                "random actions have no normaliser",
                "leave `--normaliser` out, or name a checkpoint with `--policy FILE`",
            ));
        }
        let because = if named.is_some() {
            "named by `--policy`: uniform between -1 and 1"
        } else {
            chosen_because
        };
        return Ok((Loaded::random(), because));
    }
    Ok((open(context, &name, normaliser, tasks, cache)?, chosen_because))
}

/// The policy called `name`, for `tasks`.
fn open(
    context: &Context,
    name: &Path,
    normaliser: Option<&Path>,
    tasks: &[&str],
    cache: &Cache,
) -> anyhow::Result<Loaded> {
    let data = default_policy::shelf_of(name, &context.data, cache)?;
    let choice =
        shelf::find(name, &data).map_err(|error| Hinted::new(error.to_string(), POLICY_HINT))?;
    match choice {
        Choice::File(path) => {
            if let Some(path) = normaliser.filter(|path| *path != Path::new(policy::NO_NORMALISER))
            {
                existing(path, NORMALISER_HINT)?;
            }
            policy::open(&path, normaliser)
                .map_err(|error| explain::policy_error(&error, &path, normaliser))
        }
        Choice::Experts(_) if normaliser.is_some() => Err(Hinted::new(
            "`--normaliser` names one file, but every expert has its own",
            "leave `--normaliser` out",
        )),
        Choice::Experts(table) => {
            let mut experts = policy::open_experts(&table, tasks, &data)
                .map_err(|error| Hinted::new(error.to_string(), POLICY_HINT))?;
            if name == Path::new(CARRIED_EXPERTS) {
                CARRIED_EXPERTS.clone_into(&mut experts.name);
            }
            Ok(experts)
        }
    }
}

/// The policy that comes from no file; a file of that name is `./random`.
const RANDOM: &str = "random";
/// What to type when there is no such policy.
const POLICY_HINT: &str = "give a checkpoint file or the folder of a run with `--policy`; `arnold-analyze setup --arnold` fetches the published ones into the data folder, `--data DIR` names another";
/// What to type when there is no such normaliser.
const NORMALISER_HINT: &str = "give the normaliser file itself with `--normaliser FILE`, or leave it out to use the one beside the checkpoint";

fn existing(path: &Path, hint: &str) -> anyhow::Result<()> {
    if path.is_file() {
        return Ok(());
    }
    let what = if path.is_dir() { "is a folder, not a file" } else { "does not exist" };
    Err(Hinted::new(format!("`{}` {what}", path.display()), hint))
}

/// Single-task experts, which see the clean observation, are evaluated by their mean, everything else by samples
/// (`spec/analysis.md` §1.1).
pub(super) fn published_mode(policy: &Loaded) -> ActionMode {
    use crate::policy::checkpoint::contents::Format;
    let of_all_tasks =
        policy.members.is_empty() && policy.policy.variant() == ObservationVariant::Muscle;
    // The evaluation of the transformer over time forces the mean (`spec/policy.md` §2.3).
    let over_time = policy.format == Some(Format::TemporalTransformer);
    if of_all_tasks && !over_time && policy.policy.is_stochastic() {
        ActionMode::Stochastic
    } else {
        ActionMode::Deterministic
    }
}

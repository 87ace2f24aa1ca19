//! The scene of `csi`: the first episode of every task, free and in few components, side by side on one timeline.
//!
//! A sweep keeps what it counts, not every step, so these episodes are played once more from its tables: the same seeds and
//! the same bases, so the same episodes. What was counted then must be counted again.

use serde_json::Value;

use crate::cli::context::Context;
use crate::cli::laboratory::Laboratory;
use crate::cli::render::Hinted;
use crate::cli::viewing::ViewerArguments;
use crate::experiment::csi::{Method, stored_projection};
use crate::experiment::run_folder::{Manifest, RunFolder};
use crate::experiment::viewing::acts;
use crate::experiment::{recording, seed};
use crate::record::scene::Act;
use crate::record::{Values, read_columns};
use crate::sim::rollout::{self, Channels, Episode, RolloutPlan, Subspace};
use crate::sim::tasks::Definition;

/// A finished sweep, to be looked at.
pub(super) struct Finished<'a> {
    pub(super) laboratory: &'a Laboratory,
    pub(super) method: &'a Method,
    pub(super) folder: &'a RunFolder,
    pub(super) manifest: &'a Manifest,
}

/// Steps of an episode and how many of them are solved.
type Counted = (i64, i64);

impl Finished<'_> {
    /// Writes or shows the scene.
    pub(super) fn show(&self, context: &Context, viewer: &ViewerArguments) -> anyhow::Result<()> {
        context.say("The first episode of every task is played once more, with all its steps");
        let acts = self.laboratory.tasks.iter().map(|task| self.act(task));
        viewer.show(context, acts).map(drop)
    }

    /// The task's first episode: free, in the fewest components, and in a middling number.
    fn act(&self, task: &'static Definition) -> anyhow::Result<Act> {
        let laboratory = self.laboratory;
        let names = rollout::channel_names(&laboratory.machine, task)?;
        let muscles = names.muscles.len();
        let mut takes = vec![("free".to_owned(), muscles, None)];
        for components in few(&self.manifest.result["tasks"][task.name]["components"], muscles) {
            let label = match components {
                1 => "1 component".to_owned(),
                several => format!("{several} components"),
            };
            let bases = self.folder.file("bases.parquet");
            let projection =
                stored_projection(&bases, self.method, task.name, muscles, components)?;
            takes.push((label, components, Some(projection)));
        }
        let mut act = acts::act(task.name, 0);
        for (label, components, projection) in takes {
            let scope = if projection.is_some() { "task" } else { "free" };
            let projections: Vec<Subspace> = projection.into_iter().collect();
            let plan = RolloutPlan {
                projections: &projections,
                channels: Channels::All,
                ..laboratory.plan(task)
            };
            let confined = (!projections.is_empty()).then_some(0);
            let spec = seed::episode(laboratory.seed, task.name, 0, confined);
            let episodes = rollout::play(&laboratory.machine, &plan, &[spec], &|_| ())?;
            self.compare(task, scope, components, &episodes)?;
            let recording = recording::recording(laboratory.source(task), &names, episodes);
            let origin = format!("MuJoCo {}", laboratory.physics);
            acts::add_take(&mut act, &label, &origin, &laboratory.machine.bodies, &recording)?;
        }
        Ok(act)
    }

    /// Whether the episode is the one that was counted.
    fn compare(
        &self,
        task: &Definition,
        scope: &str,
        components: usize,
        episodes: &[Episode],
    ) -> anyhow::Result<()> {
        let found = episodes.first().map(|e| (e.steps as i64, e.solved_steps as i64));
        let expected = self.counted(task, scope, components)?;
        if found == expected {
            return Ok(());
        }
        let in_words = |counted: Option<Counted>| match counted {
            Some((steps, solved)) => format!("{solved} of {steps} steps"),
            None => "none".to_owned(),
        };
        Err(Hinted::new(
            format!(
                "episode 0 of `{}` with {components} components solves {} when it is played again, expected {}, in `{}`",
                task.name,
                in_words(found),
                in_words(expected),
                self.folder.path.display()
            ),
            "delete the folder and type the command again",
        ))
    }

    /// What the table of episodes says of the first.
    fn counted(
        &self,
        task: &Definition,
        scope: &str,
        components: usize,
    ) -> anyhow::Result<Option<Counted>> {
        let columns = ["task", "scope", "dimension", "episode", "steps", "solved_steps"];
        let table = read_columns(&self.folder.file("episodes.parquet"), &columns)?;
        let columns: Vec<&Values> = table.columns().iter().map(|column| &column.values).collect();
        let [
            Values::Texts(tasks),
            Values::Texts(scopes),
            Values::Integers(dimensions),
            Values::Integers(episodes),
            Values::Integers(steps),
            Values::Integers(solved),
        ] = columns.as_slice()
        else {
            return Ok(None);
        };
        let row = (0..tasks.len()).find(|&row| {
            tasks[row] == task.name
                && scopes[row] == scope
                && dimensions[row] == components as i64
                && episodes[row] == 0
        });
        Ok(row.map(|row| (steps[row], solved[row])))
    }
}

/// The fewest of the `played` numbers of components, and one in their middle; all of a body's `muscles` are the free policy.
fn few(played: &Value, muscles: usize) -> Vec<usize> {
    let played = played.as_array().into_iter().flatten().filter_map(Value::as_u64);
    let played: Vec<usize> = played.map(|k| k as usize).filter(|&k| k < muscles).collect();
    let mut few: Vec<usize> =
        [played.first(), played.get(played.len() / 2)].into_iter().flatten().copied().collect();
    few.dedup();
    few
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    #[test]
    fn few_components_are_the_fewest_and_a_middling_number_of_those_that_were_played() {
        assert_eq!(few(&json!([1, 5, 20, 39]), 39), [1, 5]);
        assert_eq!(few(&json!([2]), 6), [2]);
        assert!(few(&json!([6]), 6).is_empty() && few(&Value::Null, 6).is_empty());
    }
}

//! The scene of `csi`: the first episode of every task, free and in few components, side by side on one timeline.
//!
//! A sweep keeps what it counts, not every step, so these episodes are played once more: the same seeds, so the same
//! episodes.

use crate::cli::context::Context;
use crate::cli::laboratory::Laboratory;
use crate::cli::viewing::ViewerArguments;
use crate::experiment::csi::CsiScene;
use crate::experiment::gather::Played;
use crate::experiment::plan::Arm;
use crate::experiment::recording;
use crate::experiment::viewing::acts;
use crate::experiment::worker::Scene;
use crate::record::scene::Act;
use crate::sim::rollout::{self, Channels, RolloutPlan, Subspace};
use crate::sim::tasks::Definition;

/// Numbers of components beside the free policy.
const TAKES: usize = 2;

/// Writes the scene.
pub(super) fn save(
    context: &Context,
    laboratory: &Laboratory,
    scene: &CsiScene<'_>,
    played: &Played,
    viewer: &ViewerArguments,
) -> anyhow::Result<()> {
    let acts = laboratory.tasks.iter().map(|task| act(laboratory, scene, played, task));
    viewer.show(context, acts).map(drop)
}

/// The task's first episode: free, in the fewest components, and in a middling number.
fn act(
    laboratory: &Laboratory,
    scene: &CsiScene<'_>,
    played: &Played,
    task: &'static Definition,
) -> anyhow::Result<Act> {
    let arms = &played.plan.arms;
    let is_first = |arm: &Arm| arm.task == task.name && arm.first == 0;
    let mut points: Vec<(u64, usize)> = (0..arms.len())
        .filter(|&place| arms[place].stage == 1 && is_first(&arms[place]))
        .filter(|&place| arms[place].condition["of_tasks"].as_array().is_some_and(|t| t.len() == 1))
        .filter_map(|place| Some((arms[place].condition["components"].as_u64()?, place)))
        .collect();
    points.sort_unstable();
    let chosen = [points.first(), points.get(points.len() / 2)];
    let mut chosen: Vec<(u64, usize)> = chosen.into_iter().flatten().copied().collect();
    chosen.dedup();
    chosen.truncate(TAKES);
    let free = arms.iter().position(|arm| arm.stage == 0 && arm.policy == 0 && is_first(arm));
    let mut takes = vec![("free".to_owned(), free.unwrap_or(0), None)];
    let places: Vec<usize> = chosen.iter().map(|&(_, place)| place).collect();
    let projections = scene.projections(&places, played)?;
    for ((components, place), projection) in chosen.into_iter().zip(projections) {
        takes.push((format!("{components} components"), place, projection));
    }
    let mut act = acts::act(task.name, 0);
    for (label, place, projection) in takes {
        let projections: Vec<Subspace> = projection.into_iter().collect();
        let arm = &arms[place];
        let plan = RolloutPlan {
            projections: &projections,
            channels: Channels::All,
            ..scene.rollout(arm)
        };
        let spec = played.plan.spec(arm, 0, (!projections.is_empty()).then_some(0));
        let episodes = rollout::play(&laboratory.machine, &plan, &[spec], &|_| ())?;
        let names = rollout::channel_names(&laboratory.machine, task)?;
        let recording = recording::recording(laboratory.source(task), &names, episodes);
        let origin = format!("MuJoCo {}", laboratory.physics);
        acts::add_take(&mut act, &label, &origin, &laboratory.machine.bodies, &recording)?;
    }
    Ok(act)
}

//! A rollout as a tidy table: one row per step, the channels of `spec/analysis.md` §0.3 in columns such as
//! `activation.ECRL`.

use crate::record::{Column, Table};
use crate::sim::rollout::{ChannelNames, Episode, Recording};
use crate::sim::tasks::Definition;

use super::ExperimentError;

/// Every step of `episodes`, which were played with all channels kept. `time` is that after the step.
pub fn step_table(
    task: &Definition,
    names: &ChannelNames,
    episodes: &[Episode],
) -> Result<Table, ExperimentError> {
    let steps = || episodes.iter().flat_map(|e| (0..e.steps).map(move |step| (e, step)));
    let mut columns = vec![
        Column::unitless("task", steps().map(|_| task.name.to_owned()).collect::<Vec<_>>()),
        Column::unitless(
            "episode",
            steps().map(|(e, _)| e.spec.episode as i64).collect::<Vec<_>>(),
        ),
        Column::unitless("step", steps().map(|(_, step)| step as i64).collect::<Vec<_>>()),
        Column::new(
            "time",
            "s",
            steps().map(|(_, s)| (s + 1) as f64 * task.control_interval()).collect::<Vec<_>>(),
        ),
        Column::unitless(
            "solved",
            steps().map(|(e, step)| e.recording.solved[step]).collect::<Vec<_>>(),
        ),
        Column::unitless(
            "reward",
            steps().map(|(e, step)| e.recording.reward[step]).collect::<Vec<_>>(),
        ),
    ];
    let mut per_element = |prefix: &str,
                           unit: &str,
                           elements: &[String],
                           value: &dyn Fn(&Recording, usize) -> f64| {
        for (place, element) in elements.iter().enumerate() {
            let values: Vec<f64> = steps()
                .map(|(e, step)| value(&e.recording, step * elements.len() + place))
                .collect();
            columns.push(Column::new(format!("{prefix}.{element}"), unit, values));
        }
    };
    let muscles = &names.muscles;
    per_element("action_mean", "", muscles, &|r, at| f64::from(r.action_mean[at]));
    per_element("action", "", muscles, &|r, at| f64::from(r.action[at]));
    per_element("excitation", "", muscles, &|r, at| r.excitation[at]);
    per_element("activation", "", muscles, &|r, at| r.activation[at]);
    per_element("joint", "rad", &names.joints, &|r, at| r.joints[at]);
    Ok(Table::new(columns)?)
}

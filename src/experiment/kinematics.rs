//! Dimensionality of joint angles over policies and tasks, beside the human hand (`spec/analysis.md` §5).

use serde_json::{Value, json};

use crate::analysis::kinematics::{
    DimensionalityRow, HUMAN, HumanDimensionality, KinematicDimensionality, Quantity, SHARES,
    kinematic_dimensionality,
};
use crate::figure::palette::{HUMAN as HUMAN_COLOUR, policy_colours};
use crate::figure::{DimensionBar, DimensionFigure, DimensionPanel, Provenance};
use crate::record::{Column, Table};
use crate::sim::tasks;

use super::ExperimentError;
use super::movement::Movements;

/// What the human hand is called beside the policies.
const HUMAN_NAME: &str = "Human";
const QUANTITIES: [Quantity; 2] = [Quantity::Position, Quantity::Velocity];

/// One policy in one task: positions, then velocities.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskKinematics {
    pub policy: String,
    pub task: String,
    /// How actions were chosen; empty if unknown.
    pub actions: &'static str,
    pub found: [KinematicDimensionality; 2],
}

/// The dimensionality of one policy's `episodes` episodes in one task.
pub fn measure(movements: &Movements, episodes: usize) -> Result<TaskKinematics, ExperimentError> {
    let Movements { policy, task, .. } = movements;
    let (expected, found) = (episodes, movements.episodes.len());
    if expected != found {
        let (policy, task) = (policy.clone(), task.clone());
        return Err(ExperimentError::EpisodeCount { policy, task, expected, found });
    }
    let rows = movements.episodes.iter().map(|episode| movements.angles(episode));
    let rows = rows.collect::<Result<Vec<_>, _>>()?;
    let of =
        |quantity| {
            kinematic_dimensionality(&rows, quantity).map_err(|source| {
                ExperimentError::Kinematics { policy: policy.clone(), task: task.clone(), source }
            })
        };
    Ok(TaskKinematics {
        policy: policy.clone(),
        task: task.clone(),
        actions: movements.actions_word(),
        found: [of(Quantity::Position)?, of(Quantity::Velocity)?],
    })
}

/// Whether the human values, which are of a hand that rotates two balls, belong beside `task`.
fn has_human_values(task: &str) -> bool {
    task.starts_with("baoding")
}

fn word(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::Position => "position",
        Quantity::Velocity => "velocity",
    }
}

fn rows(measured: &[TaskKinematics]) -> Vec<DimensionalityRow> {
    let of = |one: &TaskKinematics| one.found.each_ref().map(|f| f.row(&one.policy, &one.task));
    measured.iter().flat_map(of).collect()
}

fn dimension_columns(rows: &[DimensionalityRow]) -> Vec<Column> {
    let texts = |value: fn(&DimensionalityRow) -> &str| -> Vec<String> {
        rows.iter().map(|row| value(row).to_owned()).collect()
    };
    let integers = |value: fn(&DimensionalityRow) -> usize| -> Vec<i64> {
        rows.iter().map(|row| value(row) as i64).collect()
    };
    vec![
        Column::unitless("policy", texts(|row| &row.policy)),
        Column::unitless("task", texts(|row| &row.task)),
        Column::unitless("quantity", texts(|row| word(row.quantity))),
        Column::unitless("dim_85", integers(|row| row.dim_85)),
        Column::unitless("dim_95", integers(|row| row.dim_95)),
        Column::unitless("avg_dim", rows.iter().map(|row| row.avg_dim).collect::<Vec<_>>()),
    ]
}

/// `dimensionality`.
pub fn dimensionality_table(measured: &[TaskKinematics]) -> Result<Table, ExperimentError> {
    let rows = rows(measured);
    let integers = |value: &dyn Fn(&DimensionalityRow) -> i64| -> Vec<i64> {
        rows.iter().map(value).collect()
    };
    let mut columns = dimension_columns(&rows);
    columns.extend([
        Column::unitless("n_episodes", integers(&|row| row.n_episodes as i64)),
        Column::unitless("n_timesteps", integers(&|row| row.n_timesteps as i64)),
        Column::unitless("n_joints", integers(&|row| row.n_joints as i64)),
    ]);
    Ok(Table::new(columns)?)
}

/// `cumulative_variance`.
pub fn cumulative_table(measured: &[TaskKinematics]) -> Result<Table, ExperimentError> {
    let of = |one: &TaskKinematics| {
        one.found.each_ref().map(|f| f.cumulative_rows(&one.policy, &one.task))
    };
    let rows: Vec<_> = measured.iter().flat_map(of).flatten().collect();
    Ok(Table::new(vec![
        Column::unitless("policy", rows.iter().map(|r| r.policy.clone()).collect::<Vec<_>>()),
        Column::unitless("task", rows.iter().map(|r| r.task.clone()).collect::<Vec<_>>()),
        Column::unitless(
            "quantity",
            rows.iter().map(|r| word(r.quantity).to_owned()).collect::<Vec<_>>(),
        ),
        Column::unitless("component", rows.iter().map(|r| r.component as i64).collect::<Vec<_>>()),
        Column::unitless(
            "cumulative_variance",
            rows.iter().map(|r| r.cumulative_variance).collect::<Vec<_>>(),
        ),
    ])?)
}

/// `human_comparison`: every policy that rotates balls, and how far it is from the human hand. No rows for other tasks.
pub fn human_table(measured: &[TaskKinematics]) -> Result<Table, ExperimentError> {
    let mut rows = rows(measured);
    rows.retain(|row| has_human_values(&row.task));
    let human = |quantity: Quantity| HUMAN.iter().find(|human| human.quantity == quantity);
    let average = |row: &DimensionalityRow| {
        human(row.quantity).map_or(f64::NAN, HumanDimensionality::average)
    };
    let joints = |row: &DimensionalityRow| human(row.quantity).map_or(0, |h| h.n_joints as i64);
    let mut columns = dimension_columns(&rows);
    columns.extend([
        Column::unitless("n_joints", rows.iter().map(|r| r.n_joints as i64).collect::<Vec<_>>()),
        Column::unitless("human_avg_dim", rows.iter().map(average).collect::<Vec<_>>()),
        Column::unitless("human_n_joints", rows.iter().map(joints).collect::<Vec<_>>()),
        Column::unitless(
            "difference",
            rows.iter().map(|row| row.avg_dim - average(row)).collect::<Vec<_>>(),
        ),
    ]);
    Ok(Table::new(columns)?)
}

/// The result document.
#[must_use]
pub fn document(measured: &[TaskKinematics]) -> Value {
    let actions = |row: &DimensionalityRow| {
        let one = measured.iter().find(|m| m.policy == row.policy && m.task == row.task);
        one.map(|one| one.actions).filter(|word| !word.is_empty())
    };
    let entry = |row: DimensionalityRow| {
        let mut entry = json!(row);
        entry["actions"] = json!(actions(&row));
        entry
    };
    let human = |human: &HumanDimensionality| {
        let mut entry = json!(human);
        entry["avg_dim"] = json!(human.average());
        entry
    };
    let rotates = measured.iter().any(|one| has_human_values(&one.task));
    let humans: Vec<Value> = HUMAN.iter().filter(|_| rotates).map(human).collect();
    json!({
        "dimensionality": rows(measured).into_iter().map(entry).collect::<Vec<_>>(),
        "human": humans,
    })
}

/// The tasks, in their order.
#[must_use]
pub fn tasks_of(measured: &[TaskKinematics]) -> Vec<String> {
    let mut tasks: Vec<String> = Vec::new();
    for one in measured {
        if !tasks.contains(&one.task) {
            tasks.push(one.task.clone());
        }
    }
    tasks
}

/// The figure of one task.
#[must_use]
pub fn figure(measured: &[TaskKinematics], task: &str, provenance: &Provenance) -> DimensionFigure {
    let of_task: Vec<&TaskKinematics> = measured.iter().filter(|one| one.task == task).collect();
    let names: Vec<&str> = of_task.iter().map(|one| one.policy.as_str()).collect();
    let mut policies: Vec<(String, &'static str)> =
        names.iter().copied().map(str::to_owned).zip(policy_colours(&names)).collect();
    let panel = |place: usize, quantity: Quantity| {
        let mut bars: Vec<DimensionBar> = of_task
            .iter()
            .map(|one| DimensionBar {
                average: one.found[place].average(),
                cumulative: one.found[place].cumulative.clone(),
            })
            .collect();
        let human = HUMAN.iter().find(|human| human.quantity == quantity);
        if let Some(human) = human.filter(|_| has_human_values(task)) {
            bars.push(DimensionBar { average: human.average(), cumulative: Vec::new() });
        }
        let title = match quantity {
            Quantity::Position => "Joint angles",
            Quantity::Velocity => "Joint velocities",
        };
        DimensionPanel { title, bars }
    };
    let panels = [panel(0, QUANTITIES[0]), panel(1, QUANTITIES[1])];
    if has_human_values(task) {
        policies.push((format!("{HUMAN_NAME} ({} joints)", HUMAN[0].n_joints), HUMAN_COLOUR));
    }
    DimensionFigure {
        title: tasks::find(task).map_or(task, |task| task.paper_name).to_owned(),
        policies,
        panels,
        shares: SHARES,
        joints: of_task.first().map_or(0, |one| one.found[0].cumulative.len()),
        episodes: of_task.first().map_or(0, |one| one.found[0].episodes),
        provenance: provenance.of_policy(&names.join(", ")),
    }
}

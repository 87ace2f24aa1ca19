//! Smoothness of policies over tasks: episodes, task means, comparisons, and their figure (`spec/analysis.md` §2).

use serde_json::{Value, json};

use crate::analysis::smoothness::{
    ComparisonRow, EpisodeRow, Metric, Smoothness, SmoothnessMeter, SmoothnessOptions, TaskRow,
    comparisons, task_row,
};
use crate::analysis::stats::{Divisor, Summary};
use crate::analysis::undefined::Undefined;
use crate::figure::palette::policy_colours;
use crate::figure::{Bracket, MetricBar, MetricPanel, MetricsFigure, Provenance};
use crate::record::{Column, Table};
use crate::units::Hertz;

use super::ExperimentError;
use super::movement::Movements;

/// What is measured, and of how many episodes.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SmoothnessPlan {
    /// The sample rate of the spectral arc length stands in here unless `task_rate` is set.
    pub options: SmoothnessOptions,
    /// Takes the spectral arc length at the control rate of each task.
    pub task_rate: bool,
    /// Episodes that every policy must have of every task.
    pub episodes: usize,
    /// What a task mean does with an undefined episode.
    pub undefined: Undefined,
}

/// One policy in one task.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskSmoothness {
    pub episodes: Vec<EpisodeRow>,
    pub row: TaskRow,
    /// How actions were chosen; empty if unknown.
    pub actions: &'static str,
    /// At which rate the spectral arc length was taken.
    pub sample_rate: Hertz,
    pub diverged_steps: usize,
}

/// Measures one policy in one task.
pub fn measure(
    movements: &Movements,
    plan: &SmoothnessPlan,
) -> Result<TaskSmoothness, ExperimentError> {
    let Movements { policy, task, .. } = movements;
    let mut options = plan.options;
    if plan.task_rate {
        let interval = movements.control_interval.ok_or_else(|| {
            ExperimentError::NoControlInterval { policy: policy.clone(), task: task.clone() }
        })?;
        options.spectral_arc_length.sample_rate = 1.0 / interval;
    }
    let mut meter = SmoothnessMeter::new(&options)?;
    let mut episodes = Vec::with_capacity(movements.episodes.len());
    for movement in &movements.episodes {
        let angles = movements.angles(movement)?;
        episodes.push(EpisodeRow {
            policy: policy.clone(),
            task: task.clone(),
            episode: movement.number,
            episode_length: angles.len(),
            smoothness: meter.measure(&movements.actions(movement)?, &angles)?,
        });
    }
    Ok(TaskSmoothness {
        row: task_row(policy, task, &episodes, plan.episodes, plan.undefined)?,
        episodes,
        actions: movements.actions_word(),
        sample_rate: options.spectral_arc_length.sample_rate,
        diverged_steps: movements.diverged_steps,
    })
}

/// Everything measured: policies and tasks in the order in which they first appear.
#[derive(Debug, Clone, PartialEq)]
pub struct SmoothnessResult {
    /// Each policy with what was measured of it.
    pub policies: Vec<(String, Vec<TaskSmoothness>)>,
    pub tasks: Vec<String>,
    /// Every policy against every later one; empty for one policy.
    pub comparisons: Vec<ComparisonRow>,
}

impl SmoothnessResult {
    /// Groups what was `measured` and compares the policies, each of which must have all tasks.
    pub fn of(measured: Vec<TaskSmoothness>) -> Result<Self, ExperimentError> {
        let mut policies: Vec<(String, Vec<TaskSmoothness>)> = Vec::new();
        let mut tasks: Vec<String> = Vec::new();
        for one in measured {
            if !tasks.contains(&one.row.task) {
                tasks.push(one.row.task.clone());
            }
            match policies.iter_mut().find(|(policy, _)| *policy == one.row.policy) {
                Some((_, known)) => known.push(one),
                None => policies.push((one.row.policy.clone(), vec![one])),
            }
        }
        let mut compared = Vec::new();
        if policies.len() > 1 {
            let rows_of = |(policy, measured): &(String, Vec<TaskSmoothness>)| {
                (policy.clone(), measured.iter().map(|m| m.row.clone()).collect::<Vec<TaskRow>>())
            };
            let rows: Vec<(String, Vec<TaskRow>)> = policies.iter().map(rows_of).collect();
            compared = comparisons(&rows, &tasks)?;
        }
        Ok(Self { policies, tasks, comparisons: compared })
    }

    fn measured(&self) -> impl Iterator<Item = &TaskSmoothness> {
        self.policies.iter().flat_map(|(_, measured)| measured)
    }

    /// Mean over tasks ± s.e.m. of a policy.
    #[must_use]
    pub fn summary(measured: &[TaskSmoothness], metric: Metric) -> Summary {
        Summary::of(&task_means(measured, metric), Divisor::CountMinusOne)
    }

    /// `per_episode`.
    pub fn episode_table(&self) -> Result<Table, ExperimentError> {
        let rows: Vec<&EpisodeRow> = self.measured().flat_map(|task| &task.episodes).collect();
        let integers = |value: &dyn Fn(&EpisodeRow) -> i64| -> Vec<i64> {
            rows.iter().map(|row| value(row)).collect()
        };
        let mut columns = vec![
            Column::unitless("policy", rows.iter().map(|r| r.policy.clone()).collect::<Vec<_>>()),
            Column::unitless("task", rows.iter().map(|r| r.task.clone()).collect::<Vec<_>>()),
            Column::unitless("episode", integers(&|row| row.episode as i64)),
            Column::unitless("episode_length", integers(&|row| row.episode_length as i64)),
        ];
        columns.extend(metric_columns(&rows.iter().map(|row| &row.smoothness)));
        Ok(Table::new(columns)?)
    }

    /// `per_task`: upstream's columns, then ours.
    pub fn task_table(&self) -> Result<Table, ExperimentError> {
        let rows: Vec<&TaskSmoothness> = self.measured().collect();
        let texts = |value: fn(&TaskSmoothness) -> &str| -> Vec<String> {
            rows.iter().map(|row| value(row).to_owned()).collect()
        };
        let integers = |value: &dyn Fn(&TaskSmoothness) -> usize| -> Vec<i64> {
            rows.iter().map(|row| value(row) as i64).collect()
        };
        let mut columns = vec![
            Column::unitless("policy", texts(|m| &m.row.policy)),
            Column::unitless("task", texts(|m| &m.row.task)),
        ];
        columns.extend(metric_columns(&rows.iter().map(|m| &m.row.means)));
        columns.push(Column::unitless("episodes", integers(&|m| m.row.episodes)));
        for (place, metric) in Metric::ALL.into_iter().enumerate() {
            let name = format!("n_{}", metric.name());
            columns.push(Column::unitless(name, integers(&|m| m.row.used[place])));
        }
        let rates: Vec<f64> = rows.iter().map(|m| m.sample_rate).collect();
        columns.push(Column::new("sparc_sample_rate", "Hz", rates));
        columns.push(Column::unitless("actions", texts(|m| m.actions)));
        Ok(Table::new(columns)?)
    }

    /// `comparisons`.
    pub fn comparison_table(&self) -> Result<Table, ExperimentError> {
        let texts = |value: fn(&ComparisonRow) -> &str| -> Vec<String> {
            self.comparisons.iter().map(|row| value(row).to_owned()).collect()
        };
        let floats = |value: fn(&ComparisonRow) -> Option<f64>| -> Vec<f64> {
            self.comparisons.iter().map(|row| value(row).unwrap_or(f64::NAN)).collect()
        };
        let tasks: Vec<i64> = self.comparisons.iter().map(|row| row.n_tasks as i64).collect();
        Ok(Table::new(vec![
            Column::unitless("metric", texts(|row| row.metric)),
            Column::unitless("a", texts(|row| &row.a)),
            Column::unitless("b", texts(|row| &row.b)),
            Column::unitless("n_tasks", tasks),
            Column::unitless("W", floats(|row| row.w)),
            Column::unitless("p_raw", floats(|row| row.p_raw)),
            Column::unitless("p_holm", floats(|row| row.p_holm)),
        ])?)
    }

    /// The result document.
    #[must_use]
    pub fn document(&self) -> Value {
        let task = |measured: &TaskSmoothness| {
            let mut entry = json!(measured.row);
            entry["sparc_sample_rate"] = json!(measured.sample_rate);
            entry["actions"] = json!(Some(measured.actions).filter(|word| !word.is_empty()));
            entry["diverged_steps"] = json!(measured.diverged_steps);
            entry
        };
        let policy = |(name, measured): &(String, Vec<TaskSmoothness>)| {
            let mut entry = json!({"policy": name});
            for metric in Metric::ALL {
                let Summary { mean, standard_error, count } = Self::summary(measured, metric);
                entry[metric.name()] = json!({"mean": mean, "sem": standard_error, "n": count});
            }
            entry["per_task"] = measured.iter().map(task).collect();
            entry
        };
        json!({
            "policies": self.policies.iter().map(policy).collect::<Vec<_>>(),
            "comparisons": self.comparisons,
        })
    }

    /// Four panels of bars over tasks.
    #[must_use]
    pub fn figure(&self, provenance: Provenance) -> MetricsFigure {
        let names: Vec<&str> = self.policies.iter().map(|(name, _)| name.as_str()).collect();
        let panel = |metric: Metric| {
            let bar = |(_, measured): &(String, Vec<TaskSmoothness>)| {
                let Summary { mean, standard_error, .. } = Self::summary(measured, metric);
                let dot = |task: &String| {
                    let row = measured.iter().find(|m| m.row.task == *task);
                    row.and_then(|m| metric.of(&m.row.means)).unwrap_or(f64::NAN)
                };
                MetricBar {
                    mean: mean.unwrap_or(f64::NAN),
                    error: standard_error.unwrap_or(f64::NAN),
                    dots: self.tasks.iter().map(dot).collect(),
                }
            };
            let place = |name: &str| names.iter().position(|known| *known == name);
            let of_metric = self.comparisons.iter().filter(|row| row.metric == metric.name());
            let bracket = |row: &ComparisonRow| {
                Some(Bracket { a: place(&row.a)?, b: place(&row.b)?, p: row.p_holm? })
            };
            MetricPanel {
                title: title(metric).to_owned(),
                higher_is_better: metric.higher_is_smoother(),
                bars: self.policies.iter().map(bar).collect(),
                brackets: of_metric.filter_map(bracket).collect(),
            }
        };
        MetricsFigure {
            policies: names
                .iter()
                .copied()
                .map(str::to_owned)
                .zip(policy_colours(&names))
                .collect(),
            panels: Metric::ALL.into_iter().map(panel).collect(),
            tasks: self.tasks.len(),
            provenance,
        }
    }
}

fn title(metric: Metric) -> &'static str {
    match metric {
        Metric::ActionChange => "Mean |Δa|",
        Metric::SpectralArcLength => "SPARC",
        Metric::DimensionlessJerk => "LDLJ",
        Metric::VelocityPeaks => "Velocity peaks",
    }
}

fn task_means(measured: &[TaskSmoothness], metric: Metric) -> Vec<f64> {
    measured.iter().map(|m| metric.of(&m.row.means).unwrap_or(f64::NAN)).collect()
}

fn metric_columns<'a>(rows: &(impl Iterator<Item = &'a Smoothness> + Clone)) -> Vec<Column> {
    let column = |metric: Metric| {
        let values = rows.clone().map(|row| metric.of(row).unwrap_or(f64::NAN));
        Column::unitless(metric.name(), values.collect::<Vec<_>>())
    };
    Metric::ALL.into_iter().map(column).collect()
}

//! Returns with other histories of observations: one policy per key of a JSON file, mean cumulative reward per task.

use crate::analysis::performance::TABLE_TASKS;
use crate::figure::palette::method_colours;
use crate::figure::{GroupedBar, GroupedBarFigure, GroupedSeries, Width};
use crate::record::{Benchmark, BenchmarkEntry, RecordError, Rows, Table};

use super::{Results, task_label};

/// Policies that differ in their history, and the tasks that any of them has.
#[derive(Debug, Clone, PartialEq)]
pub struct History {
    policies: Vec<(String, Benchmark)>,
    /// In the order of the paper's table, others behind.
    tasks: Vec<String>,
}

impl History {
    /// `None` without such results.
    #[must_use]
    pub fn of(results: &Results) -> Option<Self> {
        let policies: Vec<(String, Benchmark)> =
            results.history.iter().map(|(name, tasks)| (name.clone(), tasks.clone())).collect();
        let mut tasks: Vec<String> =
            policies.iter().flat_map(|(_, tasks)| tasks.keys().cloned()).collect();
        let place = |task: &String| TABLE_TASKS.iter().position(|known| known == task);
        tasks.sort_by_key(|task| (place(task).unwrap_or(usize::MAX), task.clone()));
        tasks.dedup();
        (!tasks.is_empty()).then_some(Self { policies, tasks })
    }

    /// One row per policy and task.
    pub fn table(&self) -> Result<Table, RecordError> {
        let of = |(name, tasks): &'_ (String, Benchmark)| -> Vec<(String, String, BenchmarkEntry)> {
            tasks.iter().map(|(task, e)| (name.clone(), task.clone(), e.clone())).collect()
        };
        let rows: Vec<(String, String, BenchmarkEntry)> =
            self.policies.iter().flat_map(of).collect();
        Rows::of(&rows)
            .text("method", |(method, ..)| method.clone())
            .text("task", |(_, task, _)| task.clone())
            .number("avg_cum_reward", "", |(.., entry)| entry.avg_cum_reward)
            .count("n_episodes", |(.., entry)| entry.num_episodes.unwrap_or(0))
            .table()
    }

    /// Bars without errors: one run each.
    #[must_use]
    pub fn figure(&self) -> GroupedBarFigure {
        let names: Vec<&str> = self.policies.iter().map(|(name, _)| name.as_str()).collect();
        let series =
            self.policies.iter().zip(method_colours(&names)).map(|((name, tasks), colour)| {
                let bar = |task: &String| {
                    let reward = tasks.get(task).and_then(|entry| entry.avg_cum_reward);
                    let mean = reward.unwrap_or(f64::NAN);
                    GroupedBar { mean, error: f64::NAN, ..GroupedBar::default() }
                };
                let bars = self.tasks.iter().map(bar).collect();
                GroupedSeries { name: name.clone(), colour, bars, average: None }
            });
        GroupedBarFigure {
            groups: self.tasks.iter().map(|task| task_label(task)).collect(),
            series: series.collect(),
            measure: "Mean return of an episode".to_owned(),
            line: None,
            dots: "Episode",
            caption: "One run each: sum of rewards, mean over episodes; no interval. Read from result files, not played."
                .to_owned(),
            width: Width::TwoColumns,
        }
    }
}

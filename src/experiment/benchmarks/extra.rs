//! What else benchmark results show: performance against the size of the network, and what a vocabulary per task costs.
//!
//! * **Capacity**: the first run of each of four sizes, every task of it a bar whose error is over episodes; and per size
//!   the mean over the hand's tasks ± s.e.m. over tasks.
//! * **Vocabulary**: the change of each seed against the mean of the reference's seeds, in percent of the reference.
//!
//! `analysis::performance` has the formulas. A size or method that is not there is left out.

use serde_json::{Value, json};

use crate::analysis::performance::{
    Change, HAND_TASKS, NETWORK_SIZES, NetworkSize, PerformanceError, change_against_reference,
    episode_bar, percent_of, size_summary,
};
use crate::analysis::stats::Summary;
use crate::record::{RecordError, Rows, Table};

use super::{Performance, Results};

/// One bar of the capacity figure.
#[derive(Debug, Clone, PartialEq)]
pub struct CapacityBar {
    pub task: String,
    /// In percent of the expert, with the error over episodes; NaN where undefined.
    pub relative: f64,
    pub sem: f64,
    pub episodes: usize,
}

/// The sizes that are there, each with its bars and the mean over the hand's tasks.
#[derive(Debug, Clone, PartialEq)]
pub struct Capacity {
    pub sizes: Vec<(NetworkSize, Vec<CapacityBar>, Summary)>,
}

impl Capacity {
    /// From the first run of each size; `None` if there are fewer than two sizes.
    #[must_use]
    pub fn of(results: &Results) -> Option<Self> {
        let mut sizes = Vec::new();
        for size in NETWORK_SIZES {
            let Some(run) = results.methods.get(size.method).and_then(|seeds| seeds.first()) else {
                continue;
            };
            let bars: Vec<CapacityBar> = results
                .expert_entries()
                .filter_map(|(task, expert)| {
                    let entry = run.tasks.get(task)?;
                    let fraction = entry.avg_solved_step_frac?;
                    let expert = expert.avg_solved_step_frac?;
                    let episodes = entry.num_episodes.unwrap_or(0);
                    let bar = episode_bar(
                        expert,
                        fraction,
                        entry.std_solved_steps.unwrap_or(f64::NAN),
                        entry.max_episode_steps.unwrap_or(0),
                        episodes,
                    );
                    let (relative, sem) = bar.unwrap_or((percent_of(expert, fraction), f64::NAN));
                    Some(CapacityBar { task: task.to_owned(), relative, sem, episodes })
                })
                .collect();
            let hand: Vec<f64> = bars
                .iter()
                .filter(|bar| HAND_TASKS.contains(&bar.task.as_str()))
                .map(|bar| bar.relative)
                .collect();
            sizes.push((size, bars, size_summary(&hand)));
        }
        (sizes.len() > 1).then_some(Self { sizes })
    }

    /// Upstream's `performance.csv`: one row per size and task.
    pub fn task_table(&self) -> Result<Table, RecordError> {
        let of = |(size, bars, _): &'_ (NetworkSize, Vec<CapacityBar>, Summary)| {
            bars.iter().map(|bar| (size.method, bar.clone())).collect::<Vec<_>>()
        };
        let rows: Vec<(&str, CapacityBar)> = self.sizes.iter().flat_map(of).collect();
        Rows::of(&rows)
            .text("method", |(method, _)| *method)
            .text("task", |(_, bar)| bar.task.clone())
            .number("relative_performance", "%", |(_, bar)| bar.relative)
            .number("sem", "%", |(_, bar)| bar.sem)
            .count("n_episodes", |(_, bar)| bar.episodes)
            .table()
    }

    /// One row per size: mean over the hand's tasks.
    pub fn summary_table(&self) -> Result<Table, RecordError> {
        Rows::of(&self.sizes)
            .text("method", |(size, ..)| size.method)
            .count("parameters", |(size, ..)| size.parameters as usize)
            .number("mean", "%", |(.., summary)| summary.mean)
            .number("sem", "%", |(.., summary)| summary.standard_error)
            .count("n_tasks", |(.., summary)| summary.count)
            .table()
    }

    /// The summary as a document.
    #[must_use]
    pub fn document(&self) -> Value {
        let row = |(size, _, summary): &(NetworkSize, Vec<CapacityBar>, Summary)| {
            json!({
                "method": size.method,
                "label": size.label,
                "parameters": size.parameters,
                "mean": summary.mean,
                "sem": summary.standard_error,
                "n_tasks": summary.count,
            })
        };
        self.sizes.iter().map(row).collect()
    }
}

/// The change of a method against another, per task and seed.
#[derive(Debug, Clone, PartialEq)]
pub struct Vocabulary {
    pub method: String,
    pub reference: String,
    pub tasks: Vec<String>,
    pub change: Change,
}

impl Vocabulary {
    /// `method` against `reference`; `None` if one of them is not there.
    pub fn of(
        performance: &Performance,
        method: &str,
        reference: &str,
    ) -> Result<Option<Self>, PerformanceError> {
        let (Some(own), Some(other)) = (performance.method(method), performance.method(reference))
        else {
            return Ok(None);
        };
        Ok(Some(Self {
            method: own.label.clone(),
            reference: other.label.clone(),
            tasks: performance.tasks.clone(),
            change: change_against_reference(&own.fractions, &other.fractions)?,
        }))
    }

    /// One row per task and seed, tasks by rising mean.
    pub fn seed_table(&self) -> Result<Table, RecordError> {
        let seeds = 0..self.change.seeds.len();
        let of = |&task: &usize| seeds.clone().map(move |seed| (task, seed));
        let rows: Vec<(usize, usize)> = self.change.order.iter().flat_map(of).collect();
        Rows::of(&rows)
            .text("task", |(task, _)| self.tasks[*task].clone())
            .count("seed", |(_, seed)| *seed)
            .number("change", "%", |(task, seed)| self.change.seeds[*seed][*task])
            .table()
    }

    /// One row per task, by rising mean.
    pub fn task_table(&self) -> Result<Table, RecordError> {
        Rows::of(&self.change.order)
            .text("task", |&task| self.tasks[task].clone())
            .number("mean", "%", |&task| self.change.mean[task])
            .number("sd", "%", |&task| self.change.standard_deviation[task])
            .count("n_seeds", |_| self.change.seeds.len())
            .table()
    }
}

//! Fine-tuning inside a control subspace: performance against the number of components, in three arms.
//!
//! `analysis::performance::csi_finetuning` has the runs of each arm and the rule which of several files counts. A missing
//! run stays missing.

use serde_json::{Value, json};

use crate::analysis::performance::{
    Arm, TABLE_TASKS, finetuning_curve, newest_result_file, percent_of,
};
use crate::analysis::stats::Summary;
use crate::figure::palette::{BLACK, BLUE, RED};
use crate::figure::{LineGridFigure, LinePanel, LineSeries};
use crate::record::{CsiResult, RecordError, Rows, Table};

use super::figures::count;
use super::{BenchmarkError, Results, task_label};

/// The arms with their name in the tables, in print, and their colour.
const ARMS: [(Arm, &str, &str, &str); 3] = [
    (Arm::Frozen, "frozen", "Frozen", BLACK),
    (Arm::ReinforcementLearning, "ppo", "PPO", BLUE),
    (Arm::BehaviouralCloning, "obc", "OBC", RED),
];

/// One task and arm.
#[derive(Debug, Clone, PartialEq)]
pub struct ArmCurve {
    pub task: String,
    pub arm: &'static str,
    label: &'static str,
    colour: &'static str,
    /// Numbers of components, rising.
    pub dimensions: Vec<usize>,
    /// One per number of components, in percent of the expert.
    pub summaries: Vec<Summary>,
    /// Run, component count, percent of the expert, episodes.
    pub runs: Vec<(String, usize, f64, usize)>,
}

/// All curves.
#[derive(Debug, Clone, PartialEq)]
pub struct CsiFinetuning {
    pub curves: Vec<ArmCurve>,
}

impl CsiFinetuning {
    /// From the files found; `None` if there are none of the known runs.
    pub fn of(results: &Results) -> Result<Option<Self>, BenchmarkError> {
        let mut curves = Vec::new();
        let others = results.csi.iter().map(|file| file.task.as_str());
        let mut tasks: Vec<&str> = TABLE_TASKS.iter().copied().chain(others).collect();
        let mut seen = std::collections::BTreeSet::new();
        tasks.retain(|task| seen.insert(*task));
        for task in tasks {
            let files: Vec<&CsiResult> =
                results.csi.iter().filter(|file| file.task == task).collect();
            let expert = results.experts.get(task).and_then(|entry| entry.avg_solved_step_frac);
            let Some(expert) = expert.filter(|_| !files.is_empty()) else { continue };
            for (arm, name, label, colour) in ARMS {
                let curve = arm_curve(task, (arm, name, label, colour), &files, expert)?;
                curves.extend(curve);
            }
        }
        Ok((!curves.is_empty()).then_some(Self { curves }))
    }

    /// One row per task, arm, number of components and run.
    pub fn run_table(&self) -> Result<Table, RecordError> {
        let of = |curve: &'_ ArmCurve| {
            let (task, arm) = (curve.task.clone(), curve.arm);
            curve.runs.iter().cloned().map(move |run| (task.clone(), arm, run)).collect::<Vec<_>>()
        };
        let rows: Vec<_> = self.curves.iter().flat_map(of).collect();
        Rows::of(&rows)
            .text("task", |(task, ..)| task.clone())
            .text("method", |(_, arm, _)| *arm)
            .count("dimension", |(.., run)| run.1)
            .text("run", |(.., run)| run.0.clone())
            .number("relative_performance", "%", |(.., run)| run.2)
            .count("n_episodes", |(.., run)| run.3)
            .table()
    }

    /// One row per task, arm and number of components.
    pub fn summary_table(&self) -> Result<Table, RecordError> {
        let of = |curve: &'_ ArmCurve| {
            let (task, arm) = (curve.task.clone(), curve.arm);
            let pairs = curve.dimensions.iter().zip(&curve.summaries);
            pairs.map(|(d, s)| (task.clone(), arm, *d, *s)).collect::<Vec<_>>()
        };
        let rows: Vec<_> = self.curves.iter().flat_map(of).collect();
        Rows::of(&rows)
            .text("task", |(task, ..)| task.clone())
            .text("method", |(_, arm, ..)| *arm)
            .count("dimension", |(_, _, dimension, _)| *dimension)
            .number("mean", "%", |(.., summary)| summary.mean)
            .number("sem", "%", |(.., summary)| summary.standard_error)
            .count("n_runs", |(.., summary)| summary.count)
            .table()
    }

    /// A panel per task.
    #[must_use]
    pub fn figure(&self) -> LineGridFigure {
        let mut panels: Vec<LinePanel> = Vec::new();
        for curve in &self.curves {
            let title = task_label(&curve.task);
            let line = LineSeries {
                name: curve.label.to_owned(),
                colour: curve.colour,
                mean: points(curve, |summary| summary.mean),
                spread: points(curve, |s| s.standard_error).into_iter().map(|(_, e)| e).collect(),
                seeds: vec![curve.runs.iter().map(|run| (run.1 as f64, run.2)).collect()],
                dotted: true,
            };
            match panels.iter_mut().find(|panel| panel.title == title) {
                Some(panel) => panel.series.push(line),
                None => panels.push(LinePanel { title, series: vec![line] }),
            }
        }
        let counts = self.curves.iter().flat_map(|c| c.summaries.iter().map(|s| s.count));
        LineGridFigure {
            panels,
            across: "Number of components".to_owned(),
            upwards: "Relative performance (%)".to_owned(),
            x_end: None,
            y_end: None,
            own_x: true,
            line: Some((100.0, "Expert")),
            mark: None,
            caption: format!(
                "Mean over runs ± s.e.m., rings: runs; {}. Read from result files, not played.",
                count(counts, "run")
            ),
        }
    }

    /// How much there is.
    #[must_use]
    pub fn document(&self) -> Value {
        let curve = |curve: &ArmCurve| {
            json!({
                "task": curve.task,
                "method": curve.arm,
                "dimensions": curve.dimensions,
                "mean": curve.summaries.iter().map(|s| s.mean).collect::<Vec<_>>(),
                "n_runs": curve.summaries.iter().map(|s| s.count).collect::<Vec<_>>(),
            })
        };
        self.curves.iter().map(curve).collect()
    }
}

fn points(curve: &ArmCurve, value: fn(&Summary) -> Option<f64>) -> Vec<(f64, f64)> {
    let pairs = curve.dimensions.iter().zip(&curve.summaries);
    pairs.map(|(d, summary)| (*d as f64, value(summary).unwrap_or(f64::NAN))).collect()
}

fn arm_curve(
    task: &str,
    (arm, name, label, colour): (Arm, &'static str, &'static str, &'static str),
    files: &[&CsiResult],
    expert: f64,
) -> Result<Option<ArmCurve>, BenchmarkError> {
    let of_run = |run: &'static str| files.iter().filter(move |file| file.name.starts_with(run));
    let mut dimensions: Vec<usize> =
        arm.runs().iter().flat_map(|run| of_run(run)).map(|file| file.components).collect();
    dimensions.sort_unstable();
    dimensions.dedup();
    if dimensions.is_empty() {
        return Ok(None);
    }
    let mut runs = Vec::new();
    let mut fractions = Vec::new();
    for run in arm.runs() {
        let mut row = Vec::with_capacity(dimensions.len());
        for &dimension in &dimensions {
            let there: Vec<&&CsiResult> =
                of_run(run).filter(|file| file.components == dimension).collect();
            let names: Vec<&str> = there.iter().map(|file| file.name.as_str()).collect();
            let newest = newest_result_file(&names);
            let file = there.iter().find(|file| Some(file.name.as_str()) == newest);
            let fraction = file.and_then(|file| file.entry.avg_solved_step_frac);
            row.push(fraction.unwrap_or(f64::NAN));
            if let (Some(file), Some(fraction)) = (file, fraction) {
                let episodes = file.entry.num_episodes.unwrap_or(0);
                runs.push(((*run).to_owned(), dimension, percent_of(expert, fraction), episodes));
            }
        }
        fractions.push(row);
    }
    let summaries = finetuning_curve(&fractions, expert)?;
    let task = task.to_owned();
    Ok(Some(ArmCurve { task, arm: name, label, colour, dimensions, summaries, runs }))
}

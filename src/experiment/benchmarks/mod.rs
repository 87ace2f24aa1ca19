//! Published or own benchmark results instead of playing: what was read, and the paper's numbers from it.
//!
//! [`Results`] gathers experts and methods from any number of files and folders. [`Performance`] holds relative
//! performance per seed, task and family, the tests between methods and against the experts, all as `spec/analysis.md`
//! §1 and §13 define them. Nothing is played.

mod csi_finetuning;
mod extra;
mod figures;
mod gather;
mod history;
mod metric;
mod printed;
mod tables;

use crate::analysis::performance::{
    FamilyRow, Improvement, METHODS, Method, MethodTest, PerformanceError, RelativeMatrix, TaskRow,
    against_experts, against_methods, family_rows, improvements, task_rows,
};
use crate::analysis::stats::Wilcoxon;
use crate::record::{RecordError, SeedResult};

pub use csi_finetuning::{ArmCurve, CsiFinetuning};
pub use extra::{Capacity, CapacityBar, Vocabulary};
pub use figures::{expert_figure, printed_ablation, printed_radar};
pub use gather::{LeftOut, Results};
pub use history::History;
pub use metric::MetricMap;
pub use printed::PrintedTable;
pub use tables::{expert_document, expert_table, family_label, task_labels};

/// The method that others are compared with.
pub const REFERENCE: &str = "arnold";

/// Confidence of the intervals over seeds.
pub const CONFIDENCE: f64 = 0.95;

/// Why results do not make a table.
#[derive(Debug, thiserror::Error)]
pub enum BenchmarkError {
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error(transparent)]
    Performance(#[from] PerformanceError),
    #[error(transparent)]
    Figure(#[from] crate::figure::FigureError),
    #[error("there are no results of experts to compare with")]
    NoExperts,
    #[error("the expert of `{task}` has no solved fraction, or one that is no share: {found}")]
    ExpertValue { task: String, found: String },
    #[error("`{method}` in `{task}` has the solved fraction {value}, which is no share")]
    NoShare { method: String, task: String, value: f64 },
    #[error("two inputs hold the task `{task}` of the experts")]
    ExpertTwice { task: String },
    #[error("there is no method `{method}` in the results; there are {known}")]
    UnknownMethod { method: String, known: String },
    #[error("there is no task `{task}` among the experts' results; there are {known}")]
    UnknownTask { task: String, known: String },
}

/// One method's numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodNumbers {
    /// Name in the result folders.
    pub name: String,
    /// Name in print.
    pub label: String,
    /// Solved fractions, one row per seed, one value per task; NaN where there is none.
    pub fractions: Vec<Vec<f64>>,
    pub relative: RelativeMatrix,
    pub families: Vec<FamilyRow>,
    pub tasks: Vec<TaskRow>,
}

/// All numbers of the tables.
#[derive(Debug, Clone)]
pub struct Performance {
    /// Code names, in the order of the table.
    pub tasks: Vec<String>,
    /// Solved fractions of the experts.
    pub experts: Vec<f64>,
    /// In the order of the table.
    pub methods: Vec<MethodNumbers>,
    /// The method that is tested against the others, if it is there.
    pub reference: Option<String>,
    pub tests: Vec<MethodTest>,
    pub overall: Option<Wilcoxon>,
    pub improvements: Vec<Improvement>,
    /// What counts as performance.
    pub metric: MetricMap,
}

impl Performance {
    /// Computes everything from `results`. Missing values are errors unless allowed.
    pub fn of(
        results: &Results,
        reference: &str,
        allow_missing: bool,
    ) -> Result<Self, BenchmarkError> {
        let tasks: Vec<&str> = results.tasks.iter().map(String::as_str).collect();
        let experts = results.expert_fractions()?;
        let mut methods = Vec::new();
        for (name, seeds) in results.ordered_methods() {
            let fraction = |seed: &SeedResult, task: &str| {
                let entry = seed.tasks.get(task);
                entry.and_then(|entry| results.metric.of(task, entry)).unwrap_or(f64::NAN)
            };
            let fractions: Vec<Vec<f64>> = seeds
                .iter()
                .map(|seed| tasks.iter().map(|task| fraction(seed, task)).collect())
                .collect();
            check_shares(name, &tasks, &fractions)?;
            let method = Method { name: name.to_owned(), seeds: fractions };
            let relative = method.relative(&tasks, &experts, allow_missing)?;
            methods.push(MethodNumbers {
                name: name.to_owned(),
                label: label_of(name),
                families: family_rows(name, &tasks, &relative),
                tasks: task_rows(name, &tasks, &relative),
                fractions: method.seeds,
                relative,
            });
        }
        let mut performance = Self {
            tasks: results.tasks.clone(),
            experts,
            methods,
            reference: None,
            tests: Vec::new(),
            overall: None,
            improvements: Vec::new(),
            metric: results.metric,
        };
        performance.test(reference)?;
        Ok(performance)
    }

    /// The numbers of a method.
    #[must_use]
    pub fn method(&self, name: &str) -> Option<&MethodNumbers> {
        self.methods.iter().find(|method| method.name == name)
    }

    fn test(&mut self, reference: &str) -> Result<(), BenchmarkError> {
        let Some(ours) = self.method(reference).cloned() else { return Ok(()) };
        let tasks: Vec<&str> = self.tasks.iter().map(String::as_str).collect();
        let means = ours.relative.task_means();
        let others: Vec<(String, Vec<f64>)> = self
            .methods
            .iter()
            .filter(|method| method.name != reference)
            .map(|method| (method.name.clone(), method.relative.task_means()))
            .collect();
        let (tests, overall) = (against_methods(&means, &others)?, against_experts(&means));
        let improvements = improvements(&tasks, &self.experts, &ours.fractions)?;
        (self.tests, self.overall, self.improvements) = (tests, overall, improvements);
        self.reference = Some(reference.to_owned());
        Ok(())
    }
}

fn check_shares(
    method: &str,
    tasks: &[&str],
    fractions: &[Vec<f64>],
) -> Result<(), BenchmarkError> {
    for row in fractions {
        for (task, &value) in tasks.iter().zip(row) {
            if !value.is_nan() && !(0.0..=1.0).contains(&value) {
                let (method, task) = (method.to_owned(), (*task).to_owned());
                return Err(BenchmarkError::NoShare { method, task, value });
            }
        }
    }
    Ok(())
}

/// The printed name of a method; its own name if the paper has none.
#[must_use]
pub fn label_of(method: &str) -> String {
    let known = METHODS.iter().find(|(name, _)| *name == method);
    known.map_or(method, |(_, label)| label).to_owned()
}

/// The paper's name of a task; its code name if the paper has none.
#[must_use]
pub fn task_label(task: &str) -> String {
    crate::sim::tasks::find(task).map_or(task, |definition| definition.paper_name).to_owned()
}

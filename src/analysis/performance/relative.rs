//! Relative performance: solved fraction in percent of the expert's.
//!
//! `r[s, k] = 100 · fraction(s, k) / fraction(expert, k)` for seed s and task k. Percent; values above 100 stay.
//! Undefined (NaN) where the expert's value is zero or missing, or the seed's is.
//!
//! * A **task** is summarised over seeds: mean ± s.e.m. with divisor n − 1; one seed has no s.e.m.
//! * A **family** is averaged inside each seed first, then summarised over seeds. The mean equals the mean of the task
//!   means, the s.e.m. does not. A seed without one of the tasks has no value for the family.
//!
//! Oracle: `tests/analysis_parity.rs`, algorithms `relative_performance_tables`, `relative_matrix`.

use super::super::stats::{Divisor, Summary};
use super::PerformanceError;

/// `value` in percent of `expert`; NaN if that means nothing.
#[must_use]
pub fn percent_of(expert: f64, value: f64) -> f64 {
    if expert > 0.0 { 100.0 * value / expert } else { f64::NAN }
}

/// Percentages of one method: one row per seed, one column per task.
#[derive(Debug, Clone, PartialEq)]
pub struct RelativeMatrix {
    tasks: usize,
    /// Row-major seeds × tasks; NaN is undefined.
    percent: Vec<f64>,
}

impl RelativeMatrix {
    /// From solved fractions, one row per seed, and the expert's fraction of each task.
    pub fn new(seeds: &[Vec<f64>], experts: &[f64]) -> Result<Self, PerformanceError> {
        let rows: Vec<Vec<f64>> = seeds
            .iter()
            .map(|row| row.iter().zip(experts).map(|(x, expert)| percent_of(*expert, *x)).collect())
            .collect();
        if let Some(row) = seeds.iter().find(|row| row.len() != experts.len()) {
            return Err(PerformanceError::TaskCount { expected: experts.len(), found: row.len() });
        }
        Self::from_percent(&rows, experts.len())
    }

    /// From percentages, one row of `tasks` values per seed.
    pub fn from_percent(seeds: &[Vec<f64>], tasks: usize) -> Result<Self, PerformanceError> {
        if let Some(row) = seeds.iter().find(|row| row.len() != tasks) {
            return Err(PerformanceError::TaskCount { expected: tasks, found: row.len() });
        }
        Ok(Self { tasks, percent: seeds.concat() })
    }

    /// Number of seeds.
    #[must_use]
    pub fn seed_count(&self) -> usize {
        self.percent.len().checked_div(self.tasks).unwrap_or(0)
    }

    /// All seeds' values of one task, in the order of the seeds.
    #[must_use]
    pub fn task(&self, task: usize) -> Vec<f64> {
        self.percent.iter().skip(task).step_by(self.tasks.max(1)).copied().collect()
    }

    /// Mean ± s.e.m. over seeds of one task.
    #[must_use]
    pub fn task_summary(&self, task: usize) -> Summary {
        Summary::of(&self.task(task), Divisor::CountMinusOne)
    }

    /// The mean over `tasks` inside each seed; NaN where a seed lacks one of them.
    #[must_use]
    pub fn family(&self, tasks: &[usize]) -> Vec<f64> {
        self.percent
            .chunks_exact(self.tasks.max(1))
            .map(|row| tasks.iter().map(|&task| row[task]).sum::<f64>() / tasks.len() as f64)
            .collect()
    }

    /// Mean ± s.e.m. over seeds of the mean over `tasks`.
    #[must_use]
    pub fn family_summary(&self, tasks: &[usize]) -> Summary {
        Summary::of(&self.family(tasks), Divisor::CountMinusOne)
    }

    /// The mean over seeds of each task; NaN where no seed has it.
    #[must_use]
    pub fn task_means(&self) -> Vec<f64> {
        (0..self.tasks).map(|task| self.task_summary(task).mean.unwrap_or(f64::NAN)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn families_are_averaged_inside_each_seed_first() {
        let seeds = [vec![0.4, 0.1], vec![0.2, 0.3]];
        let matrix = RelativeMatrix::new(&seeds, &[0.5, 0.5]).unwrap();
        assert_eq!(matrix.task(0), [80.0, 40.0]);
        let family = matrix.family_summary(&[0, 1]);
        assert_eq!((family.mean, family.standard_error), (Some(50.0), Some(0.0)));
        assert!(matrix.task_summary(0).standard_error.unwrap() > 19.9);
    }

    #[test]
    fn an_expert_of_zero_leaves_its_task_and_its_families_undefined() {
        let matrix = RelativeMatrix::new(&[vec![0.4, 0.1]], &[0.5, 0.0]).unwrap();
        assert_eq!(matrix.task_summary(1).mean, None);
        assert_eq!(matrix.family_summary(&[0, 1]).count, 0);
        assert_eq!(matrix.family_summary(&[0]).mean, Some(80.0));
        assert_eq!(matrix.family_summary(&[0]).standard_error, None);
    }

    #[test]
    fn ragged_rows_are_refused_and_no_seed_is_no_value() {
        let ragged = RelativeMatrix::new(&[vec![0.4]], &[0.5, 0.5]);
        assert_eq!(ragged, Err(PerformanceError::TaskCount { expected: 2, found: 1 }));
        let empty = RelativeMatrix::new(&[], &[0.5, 0.5]).unwrap();
        assert_eq!((empty.seed_count(), empty.task_summary(0).count), (0, 0));
    }
}

//! Does a method beat the experts, task by task?
//!
//! Each seed's improvement is its relative performance − 100, in percent; a one-sample t test over seeds, one-sided
//! (greater), Holm over the tasks. The unit of replication is the seed. Rows are those of `expert_improvement.csv`.
//!
//! Fewer than two seeds, or an undefined value, leave the test undefined.
//! Oracle: `tests/analysis_parity.rs`, algorithm `relative_performance_tables`.

use super::super::stats::{Divisor, Sidedness, Summary, TTest, holm, one_sample_t};
use super::{PerformanceError, percent_of};

/// A task's row.
#[derive(Debug, Clone, PartialEq)]
pub struct Improvement {
    pub task: String,
    /// The expert's solved fraction.
    pub expert: f64,
    /// The method's solved fraction over seeds.
    pub solved: Summary,
    /// Improvement in percent with its t test.
    pub test: Option<TTest>,
    pub p_holm: f64,
}

/// The rows of a method, given by its solved fractions: one row per seed, one value per task.
pub fn improvements(
    tasks: &[&str],
    experts: &[f64],
    seeds: &[Vec<f64>],
) -> Result<Vec<Improvement>, PerformanceError> {
    let expected = tasks.len();
    let lengths = seeds.iter().map(Vec::len).chain([experts.len()]);
    if let Some(found) = lengths.into_iter().find(|&found| found != expected) {
        return Err(PerformanceError::TaskCount { expected, found });
    }
    let mut rows: Vec<Improvement> = tasks
        .iter()
        .zip(experts)
        .enumerate()
        .map(|(place, (task, &expert))| {
            let fractions: Vec<f64> = seeds.iter().map(|seed| seed[place]).collect();
            let improvement: Vec<f64> =
                fractions.iter().map(|&x| percent_of(expert, x) - 100.0).collect();
            Improvement {
                task: (*task).to_owned(),
                expert,
                solved: Summary::of(&fractions, Divisor::CountMinusOne),
                test: one_sample_t(&improvement, Sidedness::Greater),
                p_holm: f64::NAN,
            }
        })
        .collect();
    let p: Vec<f64> = rows.iter().map(|row| row.test.map_or(f64::NAN, |test| test.p)).collect();
    rows.iter_mut().zip(holm(&p)).for_each(|(row, p_holm)| row.p_holm = p_holm);
    Ok(rows)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_to_the_expert_is_no_improvement_and_one_seed_no_test() {
        let rows = improvements(&["pen"], &[0.5], &[vec![0.5], vec![0.5]]).unwrap();
        let test = rows[0].test.unwrap();
        assert_eq!((test.t, test.p, rows[0].p_holm), (Some(0.0), 1.0, 1.0));
        let rows = improvements(&["pen"], &[0.5], &[vec![0.6]]).unwrap();
        assert!(rows[0].test.is_none() && rows[0].p_holm.is_nan());
        assert!(improvements(&["pen"], &[0.5], &[vec![]]).is_err());
    }
}

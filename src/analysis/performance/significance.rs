//! Is one method better than others over all tasks?
//!
//! One value per task and method, the mean over seeds of its relative performance; paired over tasks, two-sided
//! Wilcoxon with zeros dropped, Holm over the methods compared with. The unit of replication is the task. Against the
//! experts every task's reference is 100 %, and one test needs no correction.
//!
//! Undefined values (NaN) leave W and p undefined. Oracle: `tests/analysis_parity.rs`, `relative_performance_tables`.

use super::super::stats::{Sidedness, Wilcoxon, Zeros, holm, wilcoxon};
use super::PerformanceError;

/// A comparison of two methods: a row of `significance.csv`.
#[derive(Debug, Clone, PartialEq)]
pub struct MethodTest {
    pub method: String,
    /// W, p, the number of non-zero differences and the rank-biserial correlation; `None` if a value is undefined.
    pub test: Option<Wilcoxon>,
    pub n_tasks: usize,
    pub p_holm: f64,
}

/// Tests the task means of one method against those of `others`, given with their names.
pub fn against_methods(
    task_means: &[f64],
    others: &[(String, Vec<f64>)],
) -> Result<Vec<MethodTest>, PerformanceError> {
    let mut tests = Vec::with_capacity(others.len());
    for (method, other) in others {
        if other.len() != task_means.len() {
            return Err(PerformanceError::TaskCount {
                expected: task_means.len(),
                found: other.len(),
            });
        }
        let differences: Vec<f64> = task_means.iter().zip(other).map(|(x, y)| x - y).collect();
        let test = wilcoxon(&differences, Zeros::Drop, Sidedness::TwoSided);
        tests.push((method.clone(), test));
    }
    let p: Vec<f64> = tests.iter().map(|(_, test)| test.map_or(f64::NAN, |test| test.p)).collect();
    let n_tasks = task_means.len();
    Ok(tests
        .into_iter()
        .zip(holm(&p))
        .map(|((method, test), p_holm)| MethodTest { method, test, n_tasks, p_holm })
        .collect())
}

/// Tests task means, in percent of the experts, against the experts.
#[must_use]
pub fn against_experts(task_means: &[f64]) -> Option<Wilcoxon> {
    let differences: Vec<f64> = task_means.iter().map(|percent| percent - 100.0).collect();
    wilcoxon(&differences, Zeros::Drop, Sidedness::TwoSided)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_method_that_is_better_everywhere_reaches_the_floor_of_the_test() {
        let ours: Vec<f64> = (0..14).map(|task| 100.0 + f64::from(task)).collect();
        let theirs: Vec<f64> = (0..14).map(|task| 50.0 - f64::from(task)).collect();
        let others = [("a".to_owned(), theirs.clone()), ("b".to_owned(), theirs)];
        let tests = against_methods(&ours, &others).unwrap();
        let floor = 2.0 / 16384.0;
        assert!((tests[0].test.unwrap().p - floor).abs() < 1e-15);
        assert!((tests[1].p_holm - 2.0 * floor).abs() < 1e-15);
    }

    #[test]
    fn an_undefined_task_leaves_its_method_undefined_and_the_others_tested() {
        let others = [("a".to_owned(), vec![f64::NAN, 1.0]), ("b".to_owned(), vec![1.0, 1.0])];
        let tests = against_methods(&[2.0, 3.0], &others).unwrap();
        assert!(tests[0].test.is_none() && tests[0].p_holm.is_nan());
        assert!((tests[1].p_holm - 0.5).abs() < 1e-15);
        assert!(against_methods(&[2.0], &others).is_err());
        assert_eq!(against_experts(&[f64::NAN]), None);
    }
}

//! Fine-tuning inside a control subspace: how much performance comes back, with how many components.
//!
//! Three arms (frozen, reinforcement learning, behavioural cloning), each with its runs. Value of a run = solved
//! fraction in percent of the expert; per task, arm and number of components: mean ± s.e.m. over runs (divisor n − 1).
//! A missing run stays missing and is never a zero; one run has no s.e.m.
//!
//! Oracle: `tests/analysis_parity.rs`, algorithms `csi_finetune_aggregate`, `csi_pick_file`.

use super::super::stats::{Divisor, Summary};
use super::{PerformanceError, percent_of};

/// Runs of the frozen arm, by the prefix of their folders.
pub const FROZEN_RUNS: [&str; 1] = ["111_gpu_csi_all_bc_student"];
/// Runs fine-tuned by reinforcement learning.
pub const RL_RUNS: [&str; 3] = ["333", "444", "555"];
/// Runs fine-tuned by behavioural cloning.
pub const OBC_RUNS: [&str; 3] = ["666", "777", "888"];

/// How the policy was trained after it was constrained to a subspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Arm {
    Frozen,
    ReinforcementLearning,
    BehaviouralCloning,
}

impl Arm {
    /// Prefixes of its runs.
    #[must_use]
    pub fn runs(self) -> &'static [&'static str] {
        match self {
            Self::Frozen => &FROZEN_RUNS,
            Self::ReinforcementLearning => &RL_RUNS,
            Self::BehaviouralCloning => &OBC_RUNS,
        }
    }
}

/// Numbers of components a task was run with.
#[must_use]
pub fn component_counts(task: &str) -> &'static [usize] {
    const ALL: [usize; 7] = [1, 2, 5, 10, 20, 30, 40];
    match task {
        "elbow_pose" => &ALL[..3],
        _ if task.starts_with("hand_") => &ALL[..5],
        _ => &ALL,
    }
}

/// Mean ± s.e.m. for each number of components, in percent of the expert. One row per run, one solved fraction per
/// number of components, NaN where there is none.
pub fn finetuning_curve(runs: &[Vec<f64>], expert: f64) -> Result<Vec<Summary>, PerformanceError> {
    let expected = runs.first().map_or(0, Vec::len);
    if let Some(run) = runs.iter().find(|run| run.len() != expected) {
        return Err(PerformanceError::TaskCount { expected, found: run.len() });
    }
    Ok((0..expected)
        .map(|index| {
            let percent: Vec<f64> = runs.iter().map(|run| percent_of(expert, run[index])).collect();
            Summary::of(&percent, Divisor::CountMinusOne)
        })
        .collect())
}

/// Of several result files of one run, the one of the newest checkpoint: the largest number between `model_` and
/// `_steps`, then the last name. A name without such a number comes before all others.
#[must_use]
pub fn newest_result_file<'a>(names: &[&'a str]) -> Option<&'a str> {
    names.iter().copied().max_by_key(|&name| (steps_of(name), name))
}

fn steps_of(name: &str) -> Option<u64> {
    let (_, rest) = name.rsplit_once("model_")?;
    rest.split_once("_steps")?.0.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_compared_as_numbers() {
        let names = ["a_model_9_steps", "a_model_10_steps", "b_final", "a_model_x_steps"];
        assert_eq!(newest_result_file(&names), Some("a_model_10_steps"));
        assert_eq!(newest_result_file(&["b", "a"]), Some("b"));
        assert_eq!(newest_result_file(&[]), None);
    }

    #[test]
    fn a_missing_run_is_missing_and_not_zero() {
        let runs = [vec![0.2, 0.4], vec![f64::NAN, 0.6]];
        let curve = finetuning_curve(&runs, 0.5).unwrap();
        assert_eq!((curve[0].mean, curve[0].standard_error, curve[0].count), (Some(40.0), None, 1));
        assert_eq!((curve[1].mean, curve[1].count), (Some(100.0), 2));
        assert!(finetuning_curve(&[vec![], vec![0.1]], 0.5).is_err());
        assert!(finetuning_curve(&[], 0.5).unwrap().is_empty());
    }

    #[test]
    fn small_bodies_are_run_with_few_components() {
        assert_eq!(component_counts("elbow_pose"), [1, 2, 5]);
        assert_eq!(component_counts("hand_ring_reach").len(), 5);
        assert_eq!(component_counts("kinesis").last(), Some(&40));
    }
}

//! How well a policy does its task: solved fractions and the benchmark record.
//!
//! *Solved fraction* of an episode = steps with the environment's `solved` flag / horizon; no unit, in [0, 1]. The
//! denominator is the task's fixed horizon and not the executed length, so an episode that ends early scores less.
//!
//! [`BenchmarkRecord`] holds the fields of one task in a benchmark file, spelled as the published files spell them.
//! All its `std_*` divide by n. Degenerate: no episode, a horizon of zero, or more solved than executed steps are
//! errors; an episode without a step leaves `avg_step_reward` out of its mean.
//!
//! Oracle: `tests/analysis_parity.rs`, algorithm `benchmark_fields`.

use serde::{Deserialize, Serialize};

use super::super::stats::{Divisor, mean, standard_deviation};
use super::PerformanceError;

/// What one episode came to.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct EpisodeOutcome {
    /// Sum of the rewards.
    pub cumulative_reward: f64,
    /// Steps with the environment's `solved` flag.
    pub solved_steps: u32,
    /// Executed steps.
    pub steps: u32,
}

/// Solved fraction of one episode: solved steps / horizon.
#[must_use]
pub fn solved_fraction(solved_steps: u32, horizon: u32) -> f64 {
    f64::from(solved_steps) / f64::from(horizon)
}

/// One task's entry in a benchmark file. Field names are the published ones.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct BenchmarkRecord {
    pub avg_cum_reward: f64,
    pub std_cum_reward: f64,
    /// Of each episode's mean reward per step; `None` if no episode has a step.
    pub avg_step_reward: Option<f64>,
    pub std_step_reward: Option<f64>,
    /// Share of episodes with at least one solved step.
    pub avg_solved: f64,
    pub std_solved: f64,
    pub avg_solved_steps: f64,
    pub std_solved_steps: f64,
    /// Mean over episodes of the solved fraction: the score that tables and curves show.
    pub avg_solved_step_frac: f64,
    pub avg_steps: f64,
    pub std_steps: f64,
    /// The horizon.
    pub max_episode_steps: u32,
    pub num_episodes: usize,
    pub episode_cum_rewards: Vec<f64>,
    pub episode_solve_step_fracs: Vec<f64>,
    pub episode_solved_steps: Vec<u32>,
    pub episode_steps: Vec<u32>,
}

impl BenchmarkRecord {
    /// Summarises the episodes of one task, which lasts at most `horizon` steps.
    pub fn of(episodes: &[EpisodeOutcome], horizon: u32) -> Result<Self, PerformanceError> {
        if horizon == 0 {
            return Err(PerformanceError::NoHorizon);
        }
        for (episode, &EpisodeOutcome { solved_steps: solved, steps, .. }) in
            episodes.iter().enumerate()
        {
            if solved > steps || steps > horizon {
                return Err(PerformanceError::ImpossibleSteps { episode, solved, steps, horizon });
            }
        }
        let column = |value: fn(&EpisodeOutcome) -> f64| -> Vec<f64> {
            episodes.iter().map(value).collect()
        };
        let rewards = column(|e| e.cumulative_reward);
        let step_rewards: Vec<f64> = episodes
            .iter()
            .filter(|e| e.steps > 0)
            .map(|e| e.cumulative_reward / f64::from(e.steps))
            .collect();
        let (avg_cum_reward, std_cum_reward) = moments(&rewards)?;
        let (avg_solved, std_solved) =
            moments(&column(|e| f64::from(u8::from(e.solved_steps > 0))))?;
        let (avg_solved_steps, std_solved_steps) = moments(&column(|e| f64::from(e.solved_steps)))?;
        let (avg_steps, std_steps) = moments(&column(|e| f64::from(e.steps)))?;
        let fractions: Vec<f64> =
            episodes.iter().map(|e| solved_fraction(e.solved_steps, horizon)).collect();
        let (avg_solved_step_frac, _) = moments(&fractions)?;
        Ok(Self {
            avg_cum_reward,
            std_cum_reward,
            avg_step_reward: mean(&step_rewards),
            std_step_reward: standard_deviation(&step_rewards, Divisor::Count),
            avg_solved,
            std_solved,
            avg_solved_steps,
            std_solved_steps,
            avg_solved_step_frac,
            avg_steps,
            std_steps,
            max_episode_steps: horizon,
            num_episodes: episodes.len(),
            episode_cum_rewards: rewards,
            episode_solve_step_fracs: fractions,
            episode_solved_steps: episodes.iter().map(|e| e.solved_steps).collect(),
            episode_steps: episodes.iter().map(|e| e.steps).collect(),
        })
    }
}

/// Mean and standard deviation (divisor n).
fn moments(values: &[f64]) -> Result<(f64, f64), PerformanceError> {
    mean(values).zip(standard_deviation(values, Divisor::Count)).ok_or(PerformanceError::NoEpisodes)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episode(cumulative_reward: f64, solved_steps: u32, steps: u32) -> EpisodeOutcome {
        EpisodeOutcome { cumulative_reward, solved_steps, steps }
    }

    #[test]
    fn an_episode_that_ends_early_is_divided_by_the_horizon() {
        let record = BenchmarkRecord::of(&[episode(4.0, 20, 20), episode(0.0, 0, 0)], 100).unwrap();
        assert_eq!(record.episode_solve_step_fracs, [0.2, 0.0]);
        assert_eq!(record.avg_step_reward, Some(0.2));
        assert!((record.avg_solved - 0.5).abs() < 1e-15);
    }

    #[test]
    fn impossible_episodes_are_refused() {
        assert_eq!(BenchmarkRecord::of(&[], 100), Err(PerformanceError::NoEpisodes));
        assert_eq!(BenchmarkRecord::of(&[episode(0.0, 0, 0)], 0), Err(PerformanceError::NoHorizon));
        assert!(matches!(
            BenchmarkRecord::of(&[episode(0.0, 3, 2)], 100),
            Err(PerformanceError::ImpossibleSteps {
                episode: 0,
                solved: 3,
                steps: 2,
                horizon: 100
            })
        ));
    }
}

//! What a network sees of a body, and how it is normalised while training: every component of the clean vector on its own,
//! for a perceptron; or the windows of all sensors by their signatures, for a transformer (`spec/training.md` §5.4).

use super::TrainError;
use crate::policy::checkpoint::contents::Normaliser;
use crate::policy::running_components::RunningComponents;
use crate::policy::running_statistics::{RunningStatistics, Seen};
use crate::policy::{ObservationVariant, TaskInterface};

/// Statistics of the observations of a run.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Statistics {
    Components(RunningComponents),
    Signatures {
        statistics: RunningStatistics,
        lags: usize,
        /// The rows of every task's sensors.
        rows: Vec<Vec<usize>>,
    },
}

impl Statistics {
    /// For the clean vector of one task.
    pub(super) fn of_components(task: &TaskInterface) -> Self {
        Self::Components(RunningComponents::new(task.clean_observation_length))
    }

    /// For the windows of several tasks.
    pub(super) fn of_signatures(tasks: &[TaskInterface], lags: usize) -> Self {
        let mut statistics = RunningStatistics::new(lags);
        let rows = tasks.iter().map(|task| statistics.rows_of(&task.observation_words)).collect();
        Self::Signatures { statistics, lags, rows }
    }

    /// Which of a task's observations is looked at.
    pub(super) fn variant(&self) -> ObservationVariant {
        match self {
            Self::Components(_) => ObservationVariant::Clean,
            Self::Signatures { .. } => ObservationVariant::Muscle,
        }
    }

    /// How many of the last observations are looked at.
    pub(super) fn lags(&self) -> usize {
        match self {
            Self::Components(_) => 1,
            Self::Signatures { lags, .. } => *lags,
        }
    }

    /// Takes in what all bodies saw in one step: the task and the windows of each.
    pub(super) fn update(&mut self, seen: &[(usize, &[f32])]) {
        match self {
            Self::Components(statistics) => {
                statistics.update(seen.iter().map(|(_, windows)| *windows));
            }
            Self::Signatures { statistics, rows, .. } => {
                let seen: Vec<Seen<'_>> = seen
                    .iter()
                    .map(|&(task, windows)| Seen { rows: &rows[task], windows })
                    .collect();
                statistics.update(&seen);
            }
        }
    }

    /// Normalises what one body of `task` sees.
    pub(super) fn normalise(&self, task: usize, windows: &[f32], normalised: &mut [f32]) {
        match self {
            Self::Components(statistics) => statistics.normalise(windows, normalised),
            Self::Signatures { statistics, rows, .. } => {
                statistics.normalise(&rows[task], windows, normalised);
            }
        }
    }

    /// As a policy stores them.
    pub(super) fn to_stored(&self) -> Normaliser {
        match self {
            Self::Components(statistics) => Normaliser::PerComponent(statistics.to_stored()),
            Self::Signatures { statistics, .. } => Normaliser::PerSignature(statistics.to_stored()),
        }
    }

    /// Means, variances and counts.
    pub(super) fn numbers(&self) -> [Vec<f64>; 3] {
        match self {
            Self::Components(s) => [s.mean().to_vec(), s.variance().to_vec(), vec![s.count()]],
            Self::Signatures { statistics, .. } => statistics.numbers().map(<[f64]>::to_vec),
        }
    }

    /// Goes on from what [`Self::numbers`] gave.
    pub(super) fn restore(&mut self, numbers: [Vec<f64>; 3]) -> Result<(), TrainError> {
        match self {
            Self::Components(statistics) => {
                let [mean, variance, count] = numbers;
                if mean.len() != statistics.mean().len() || count.len() != 1 {
                    let what = "statistics of observations".to_owned();
                    return Err(TrainError::State { what });
                }
                *statistics = RunningComponents::restore(mean, variance, count[0])?;
            }
            Self::Signatures { statistics, .. } => statistics.restore(numbers)?,
        }
        Ok(())
    }
}

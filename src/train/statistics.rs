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

    /// Statistics of a padded row of `longest` numbers, averaged over environments of `tasks`: mean of means, mean of variances.
    /// Padding counts as what is never seen, with mean 0 and variance 1.
    pub(super) fn averaged(
        &self,
        tasks: &[usize],
        longest: usize,
    ) -> Result<RunningComponents, TrainError> {
        let Self::Signatures { statistics, lags, rows } = self else {
            let what = "averages over tasks are of padded windows".to_owned();
            return Err(TrainError::Plan { what });
        };
        let [means, variances, _] = statistics.numbers();
        let (mut mean, mut variance) = (vec![0.0; longest], vec![0.0; longest]);
        for &task in tasks {
            for place in 0..longest {
                let row = rows[task].get(place / lags).copied().unwrap_or(0);
                let cell = row * lags + place % lags;
                mean[place] += means[cell] / tasks.len() as f64;
                variance[place] += variances[cell] / tasks.len() as f64;
            }
        }
        Ok(RunningComponents::restore(mean, variance, 1.0)?)
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn averages_over_environments_take_padding_for_what_is_never_seen() {
        let task = |name: &str, sensors: usize| TaskInterface {
            task: name.to_owned(),
            muscle_count: 1,
            muscle_observation_length: sensors,
            clean_observation_length: sensors,
            observation_words: (0..sensors).map(|i| vec![2 + i as u16]).collect(),
            action_words: Vec::new(),
            muscle_models: Vec::new(),
        };
        let mut statistics = Statistics::of_signatures(&[task("a", 1), task("b", 2)], 1);
        let (mean, variance) = (vec![0.0, 3.0, 6.0], vec![1.0, 4.0, 10.0]);
        statistics.restore([mean, variance, vec![1e-4, 5.0, 7.0]]).unwrap();
        // Two environments of `a` and one of `b`; the second sensor of `a` is padding.
        let averaged = statistics.averaged(&[0, 0, 1], 2).unwrap();
        let close = |found: &[f64], expected: [f64; 2]| {
            found.iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-12)
        };
        assert!(close(averaged.mean(), [3.0, 2.0]), "{:?}", averaged.mean());
        assert!(close(averaged.variance(), [4.0, 4.0]), "{:?}", averaged.variance());
    }
}

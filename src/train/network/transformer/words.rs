//! The word embeddings of one task: sums of table rows, feature by feature, and the way back into the table.

use std::ops::Range;

use crate::policy::PolicyError;
use crate::train::TrainError;
use crate::train::tape::lanes;

/// Vocabulary id of the word that only fills up: its row stays as it is.
const PADDING_WORD: u16 = 0;
/// Vocabulary id of the word that asks for the value.
const VALUE_WORD: u16 = 1;

/// What a task's sensors and muscles are called.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct TaskWords {
    /// Code name of the task.
    pub task: String,
    /// Vocabulary ids describing each token.
    pub sensors: Vec<Vec<u16>>,
    /// Vocabulary ids describing each muscle.
    pub muscles: Vec<Vec<u16>>,
    /// Numbers of an action; those beyond the muscles are padding, which the published training gives every body with
    /// fewer muscles than the largest.
    pub action_length: usize,
}

impl TaskWords {
    /// Whether a padding query is needed beside the muscles.
    pub(super) fn is_padded(&self) -> bool {
        self.action_length > self.muscles.len()
    }

    pub(super) fn check(&self, vocabulary: usize) -> Result<(), TrainError> {
        let sizes =
            |what: &str| TrainError::Sizes { what: format!("task `{}` with {what}", self.task) };
        if self.sensors.is_empty() || self.muscles.is_empty() {
            return Err(sizes("no sensors or no muscles"));
        }
        if self.action_length < self.muscles.len() {
            return Err(sizes("actions shorter than its muscles"));
        }
        for &word in self.sensors.iter().chain(&self.muscles).flatten() {
            if usize::from(word) >= vocabulary {
                return Err(PolicyError::UnknownWord { word, vocabulary }.into());
            }
        }
        Ok(())
    }
}

/// The table that a task uses, among all parameters.
#[derive(Debug, Clone)]
pub(super) struct Table {
    pub(super) place: Range<usize>,
    pub(super) width: usize,
}

/// The one word of the value query.
pub(super) fn value_description() -> Vec<Vec<u16>> {
    vec![vec![VALUE_WORD]]
}

impl Table {
    /// Writes one column per description: the sum of its words' rows.
    pub(super) fn sums(&self, numbers: &[f32], descriptions: &[Vec<u16>]) -> Vec<f32> {
        let columns = lanes(descriptions.len());
        let mut sums = vec![0.0; self.width * columns];
        for (column, words) in descriptions.iter().enumerate() {
            for &word in words {
                for (feature, &e) in numbers[self.row(word)].iter().enumerate() {
                    sums[feature * columns + column] += e;
                }
            }
        }
        sums
    }

    /// Adds derivatives by such sums to those by the table.
    pub(super) fn pull(&self, slopes: &[f32], descriptions: &[Vec<u16>], gradient: &mut [f32]) {
        let columns = slopes.len() / self.width;
        for (column, words) in descriptions.iter().enumerate() {
            for &word in words.iter().filter(|&&word| word != PADDING_WORD) {
                for (feature, e) in gradient[self.row(word)].iter_mut().enumerate() {
                    *e += slopes[feature * columns + column];
                }
            }
        }
    }

    fn row(&self, word: u16) -> Range<usize> {
        let start = self.place.start + usize::from(word) * self.width;
        start..start + self.width
    }
}

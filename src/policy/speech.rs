//! How a transformer is told what its tokens mean: the words of sensors and muscles as rows of its embedding tables,
//! and the statistics of those same words.
//!
//! Usually a description is several words and its embedding their sum. A policy with an *atomic* vocabulary
//! (`spec/policy.md` §2.1) has one row for every whole description, the words joined by `/`; its statistics still go by
//! the words.

use super::PolicyError;
use super::checkpoint::contents::SignatureStatistics;
use super::interface::TaskInterface;
use super::normaliser::{SignatureNormaliser, check_signature_statistics, unknown_signatures};
use super::vocabulary::Vocabulary;

/// Words and statistics of one transformer policy.
#[derive(Debug, Clone)]
pub(super) struct Speech {
    statistics: SignatureStatistics,
    /// Whole descriptions with a row each, if words are not composed.
    atomic: Option<Vocabulary>,
    /// Tasks the policy was trained on; empty if no file says.
    trained_tasks: Vec<String>,
}

/// Rows of the embedding tables, for every sensor and muscle of a task.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Descriptions {
    pub(super) sensors: Vec<Vec<u16>>,
    pub(super) muscles: Vec<Vec<u16>>,
}

impl Speech {
    /// Refuses statistics that do not fit a network with `lags` values per token.
    pub(super) fn new(statistics: SignatureStatistics, lags: usize) -> Result<Self, PolicyError> {
        check_signature_statistics(&statistics, lags)?;
        Ok(Self { statistics, atomic: None, trained_tasks: Vec::new() })
    }

    /// With the vocabulary of whole descriptions, if the policy has one, and the tasks it was trained on.
    pub(super) fn with(self, atomic: Option<Vocabulary>, trained_tasks: Vec<String>) -> Self {
        Self { atomic, trained_tasks, ..self }
    }

    /// Tasks it was trained on; empty if no file says.
    pub(super) fn trained_tasks(&self) -> &[String] {
        &self.trained_tasks
    }

    /// The normaliser for sensors described by `words`.
    pub(super) fn normaliser(&self, words: &[Vec<u16>]) -> SignatureNormaliser {
        SignatureNormaliser::for_task(&self.statistics, words)
    }

    /// Rows for the sensors and muscles of `task`. Fails if they cannot be told apart by their words, or if the
    /// normaliser has never met sensors that the policy was trained on.
    pub(super) fn describe(&self, task: &TaskInterface) -> Result<Descriptions, PolicyError> {
        for (what, expected, found) in [
            ("described tokens", task.observation_words.len(), task.muscle_observation_length),
            ("described muscles", task.action_words.len(), task.muscle_count),
        ] {
            if expected != found {
                let task = task.task.clone();
                return Err(PolicyError::DoesNotFit { what, expected, found, task });
            }
        }
        let unknown = unknown_signatures(&self.statistics, &task.observation_words).len();
        if unknown > 0 && self.trained_tasks.contains(&task.task) {
            let sensors = task.observation_words.len();
            let task = task.task.clone();
            return Err(PolicyError::ForeignNormaliser { unknown, sensors, task });
        }
        let (sensors, muscles) = (&task.observation_words, &task.action_words);
        Ok(Descriptions { sensors: self.rows(sensors)?, muscles: self.rows(muscles)? })
    }

    fn rows(&self, descriptions: &[Vec<u16>]) -> Result<Vec<Vec<u16>>, PolicyError> {
        let Some(atomic) = &self.atomic else { return Ok(descriptions.to_vec()) };
        let words = Vocabulary::standard();
        let row = |description: &Vec<u16>| {
            let description = phrase(&words, description, "/");
            match atomic.id_of(&description) {
                Some(row) => Ok(vec![row]),
                None => Err(PolicyError::UnknownDescription { description }),
            }
        };
        descriptions.iter().map(row).collect()
    }

    /// What somebody who plays `task` should be told.
    pub(super) fn warnings(&self, task: &TaskInterface) -> Vec<String> {
        let words = Vocabulary::standard();
        let text = |signature: &Vec<u16>| {
            format!(
                "task `{}`: the normaliser has never seen sensor `{}`; mean 0, variance 1 are used",
                task.task,
                phrase(&words, signature, " ")
            )
        };
        unknown_signatures(&self.statistics, &task.observation_words).iter().map(text).collect()
    }
}

fn phrase(vocabulary: &Vocabulary, words: &[u16], separator: &str) -> String {
    let word = |&id: &u16| vocabulary.word_of(id).unwrap_or("?");
    words.iter().map(word).collect::<Vec<_>>().join(separator)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn speech() -> Speech {
        let statistics = SignatureStatistics {
            signatures: vec![vec![0], vec![2, 3]],
            mean: vec![0.0; 2],
            variance: vec![1.0; 2],
            count: vec![1.0; 2],
            lags: 1,
            epsilon: 1e-8,
            clip: 10.0,
            enabled: true,
        };
        Speech::new(statistics, 1).unwrap()
    }

    fn task(sensors: &[&[u16]]) -> TaskInterface {
        TaskInterface {
            task: "pen".to_owned(),
            muscle_count: 1,
            muscle_observation_length: sensors.len(),
            clean_observation_length: 0,
            observation_words: sensors.iter().map(|words| words.to_vec()).collect(),
            action_words: vec![vec![11, 137, 129]],
            muscle_models: Vec::new(),
        }
    }

    #[test]
    fn an_atomic_vocabulary_has_one_row_per_description() {
        let words = ["padding", "value", "TRIlong/activation/muscle", "adabR/extn"];
        let atomic = Vocabulary::from_words(words.map(str::to_owned).to_vec()).unwrap();
        let speech = speech().with(Some(atomic), Vec::new());
        let rows = speech.describe(&task(&[&[3, 2]])).unwrap();
        assert_eq!((rows.sensors, rows.muscles), (vec![vec![3]], vec![vec![2]]));
        // The same words in another order are another description.
        let error = speech.describe(&task(&[&[2, 3]])).unwrap_err().to_string();
        assert!(error.contains("`extn/adabR`"), "{error}");
    }

    #[test]
    fn a_normaliser_without_the_sensors_of_a_trained_task_belongs_to_another_run() {
        let foreign = task(&[&[3, 2], &[5]]);
        speech().describe(&foreign).unwrap();
        let trained = speech().with(None, vec!["pen".to_owned()]);
        let error = trained.describe(&foreign).unwrap_err().to_string();
        assert!(error.contains("1 of the 2 sensors of task `pen`"), "{error}");
        trained.describe(&task(&[&[2, 3]])).unwrap();
    }
}

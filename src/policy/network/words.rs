//! The embeddings of the words that describe sensors and muscles (`spec/policy.md` §1.4, §2.2).
//!
//! One table serves all tasks, or every task has a table of its own. A table is learned, or fixed sines and cosines that
//! the checkpoint stores as a buffer; to the network it is all the same.

use std::collections::BTreeMap;

use super::weights::Weights;
use crate::policy::PolicyError;

/// Vocabulary id of the word that asks for the value.
const VALUE_WORD: usize = 1;

/// Where a checkpoint keeps its tables.
const TABLES: &str = "features_extractor.positional_encoder";

/// The tables of one checkpoint, each words × width.
#[derive(Debug, Clone)]
pub(super) struct WordTables {
    tables: Tables,
    vocabulary: usize,
    width: usize,
}

#[derive(Debug, Clone)]
enum Tables {
    Shared(Vec<f32>),
    PerTask(BTreeMap<String, Vec<f32>>),
}

/// The table that one task uses.
#[derive(Debug, Clone, Copy)]
pub(super) struct Words<'a> {
    table: &'a [f32],
    width: usize,
}

impl WordTables {
    /// Reads the tables of a network of `width`.
    pub(super) fn read(weights: Weights, width: usize) -> Result<Self, PolicyError> {
        let per_task = weights.names_between(&format!("{TABLES}.task_embeddings."), ".weight");
        let learned = format!("{TABLES}.embedding.weight");
        let fixed = format!("{TABLES}.embedding");
        let of_task = |task: &str| format!("{TABLES}.task_embeddings.{task}.weight");
        let first = match per_task.first() {
            Some(task) => of_task(task),
            None if !weights.has(&learned) && weights.has(&fixed) => fixed,
            None => learned,
        };
        let [vocabulary, _] = weights.matrix_size(&first)?;
        let table = |name: &str| weights.tensor(name, &[vocabulary, width]).map(<[f32]>::to_vec);
        let tables = if per_task.is_empty() {
            Tables::Shared(table(&first)?)
        } else {
            let named = per_task.iter().map(|task| Ok((task.clone(), table(&of_task(task))?)));
            Tables::PerTask(named.collect::<Result<_, PolicyError>>()?)
        };
        if vocabulary <= VALUE_WORD {
            return Err(PolicyError::TensorShape {
                name: first,
                expected: "at least two words".to_owned(),
                found: vec![vocabulary, width],
            });
        }
        Ok(Self { tables, vocabulary, width })
    }

    /// Number of words.
    pub(super) fn len(&self) -> usize {
        self.vocabulary
    }

    /// Tasks with a table of their own, sorted.
    pub(super) fn tasks(&self) -> Vec<&str> {
        match &self.tables {
            Tables::Shared(_) => Vec::new(),
            Tables::PerTask(tables) => tables.keys().map(String::as_str).collect(),
        }
    }

    /// The table of `task`. Fails if every task has its own and this one was not trained.
    pub(super) fn of_task(&self, task: &str) -> Result<Words<'_>, PolicyError> {
        let untrained = || PolicyError::UntrainedTask {
            task: task.to_owned(),
            trained: self.tasks().join(", "),
        };
        let table = match &self.tables {
            Tables::Shared(table) => table,
            Tables::PerTask(tables) => tables.get(task).ok_or_else(untrained)?,
        };
        Ok(Words { table, width: self.width })
    }
}

impl<'a> Words<'a> {
    /// One row per description: the sum of its words' embeddings, in their order, each as often as it is named.
    pub(super) fn sums(self, descriptions: &[Vec<u16>]) -> Result<Vec<f32>, PolicyError> {
        let mut sums = vec![0.0; descriptions.len() * self.width];
        for (sum, words) in sums.chunks_exact_mut(self.width).zip(descriptions) {
            for &word in words {
                let vocabulary = self.table.len() / self.width;
                let row = self
                    .row(usize::from(word))
                    .ok_or(PolicyError::UnknownWord { word, vocabulary })?;
                for (s, &e) in sum.iter_mut().zip(row) {
                    *s += e;
                }
            }
        }
        Ok(sums)
    }

    /// The embedding of the word that asks for the value.
    pub(super) fn value_query(self) -> &'a [f32] {
        self.row(VALUE_WORD).unwrap_or_default()
    }

    fn row(self, word: usize) -> Option<&'a [f32]> {
        self.table.get(word * self.width..(word + 1) * self.width)
    }
}

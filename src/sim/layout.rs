//! What the numbers of an observation are: named blocks whose elements carry the words the transformer reads.

use std::ops::Range;

/// A named run of observation elements, e.g. `muscle_len`, one element per muscle.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Block {
    /// The key in the published observation dictionary.
    pub key: &'static str,
    /// Unit of the elements, for people.
    pub unit: &'static str,
    /// The describing words of each element, in the published order.
    pub phrases: Vec<Vec<String>>,
}

/// All blocks of a task, in the order of its muscle observation, and behind them what only the clean observation shows.
#[derive(Debug, Clone, Default)]
pub struct Layout {
    blocks: Vec<Block>,
    clean_only: Vec<Unworded>,
}

/// A named run of numbers that only the clean observation shows; nobody reads words about it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unworded {
    /// The key in the published observation dictionary.
    pub key: &'static str,
    /// Unit of the elements, for people.
    pub unit: &'static str,
    /// Number of elements.
    pub length: usize,
}

impl Layout {
    /// The layout made of `blocks`.
    #[must_use]
    pub fn new(blocks: Vec<Block>) -> Self {
        Self { blocks, clean_only: Vec::new() }
    }

    /// The same with numbers behind it that only the clean observation shows.
    #[must_use]
    pub fn with_clean_only(self, clean_only: Vec<Unworded>) -> Self {
        Self { clean_only, ..self }
    }

    /// The blocks in order.
    #[must_use]
    pub fn blocks(&self) -> &[Block] {
        &self.blocks
    }

    /// What only the clean observation shows.
    #[must_use]
    pub fn clean_only(&self) -> &[Unworded] {
        &self.clean_only
    }

    /// Number of elements of the muscle observation.
    #[must_use]
    pub fn len(&self) -> usize {
        self.blocks.iter().map(|block| block.phrases.len()).sum()
    }

    /// Number of elements of both observations together: what a task writes.
    #[must_use]
    pub fn total_len(&self) -> usize {
        self.len() + self.clean_only.iter().map(|block| block.length).sum::<usize>()
    }

    /// Whether there are no elements.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Where the block `key` lies.
    #[must_use]
    pub fn range(&self, key: &str) -> Option<Range<usize>> {
        let worded = self.blocks.iter().map(|block| (block.key, block.phrases.len()));
        let unworded = self.clean_only.iter().map(|block| (block.key, block.length));
        let mut start = 0;
        for (candidate, length) in worded.chain(unworded) {
            let end = start + length;
            if candidate == key {
                return Some(start..end);
            }
            start = end;
        }
        None
    }

    /// Indices of the elements of the blocks `keys`, in that order; keys that do not exist are left out.
    #[must_use]
    pub fn indices(&self, keys: &[&str]) -> Vec<usize> {
        keys.iter().filter_map(|key| self.range(key)).flatten().collect()
    }

    /// The phrase of every element.
    pub fn phrases(&self) -> impl Iterator<Item = &[String]> {
        self.blocks.iter().flat_map(|block| &block.phrases).map(Vec::as_slice)
    }
}

/// The axes of a vector quantity.
pub const AXES: [&str; 3] = ["x", "y", "z"];

/// A block with one element per joint.
#[must_use]
pub fn per_joint(
    key: &'static str,
    unit: &'static str,
    joints: &[String],
    words: &[&str],
) -> Block {
    Block { key, unit, phrases: named(joints, words, "joint") }
}

/// A block with one element per muscle, about its `quantity`.
#[must_use]
pub fn per_muscle(
    key: &'static str,
    unit: &'static str,
    muscles: &[String],
    quantity: &str,
) -> Block {
    Block { key, unit, phrases: named(muscles, &[quantity], "muscle") }
}

/// A block with one element per axis, described by `words` and then the axis, then `tail`.
#[must_use]
pub fn per_axis(key: &'static str, unit: &'static str, words: &[&str], tail: &[&str]) -> Block {
    let phrases = AXES.map(|axis| {
        words.iter().chain([&axis]).chain(tail).map(|word| (*word).to_owned()).collect()
    });
    Block { key, unit, phrases: phrases.to_vec() }
}

fn named(names: &[String], words: &[&str], kind: &str) -> Vec<Vec<String>> {
    names
        .iter()
        .map(|name| {
            let words = words.iter().copied().chain([kind]).map(str::to_owned);
            std::iter::once(name.clone()).chain(words).collect()
        })
        .collect()
}

/// Fills an observation from front to back.
#[derive(Debug)]
pub struct Fill<'a> {
    rest: &'a mut [f64],
}

impl<'a> Fill<'a> {
    /// Starts at the front of `observation`.
    pub fn new(observation: &'a mut [f64]) -> Self {
        Self { rest: observation }
    }

    fn take(&mut self, count: usize) -> &'a mut [f64] {
        let (head, tail) = std::mem::take(&mut self.rest).split_at_mut(count);
        self.rest = tail;
        head
    }

    /// Appends `values` as they are.
    pub fn put(&mut self, values: &[f64]) {
        self.take(values.len()).copy_from_slice(values);
    }

    /// Appends `values` multiplied by `factor`.
    pub fn put_scaled(&mut self, values: &[f64], factor: f64) {
        for (to, from) in self.take(values.len()).iter_mut().zip(values) {
            *to = from * factor;
        }
    }

    /// Appends `left` − `right`.
    pub fn put_difference(&mut self, left: &[f64], right: &[f64]) {
        for ((to, l), r) in self.take(left.len()).iter_mut().zip(left).zip(right) {
            *to = l - r;
        }
    }

    /// Appends muscle readings as the published sensors clean them: NaN becomes 0, ±∞ the largest finite number of
    /// that sign (`spec/tasks.md` §1.7).
    pub fn put_cleaned(&mut self, values: &[f64]) {
        for (to, &from) in self.take(values.len()).iter_mut().zip(values) {
            *to = if from.is_nan() { 0.0 } else { from.clamp(f64::MIN, f64::MAX) };
        }
    }
}

//! What a perceptron sees of several tasks (`spec/policy.md` §2.5): what a task shows, at the beginning of a row as long as
//! the longest one's, then zeros. If asked, a one among zeros behind them says which task it is.

/// Rows for some tasks.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PaddedInput {
    /// Numbers that every task shows.
    lengths: Vec<usize>,
    longest: usize,
    /// Names of the tasks if a row says which one it is of, else none.
    index: Vec<String>,
}

impl PaddedInput {
    /// For tasks that show so many numbers.
    #[must_use]
    pub fn new(lengths: Vec<usize>) -> Self {
        let longest = lengths.iter().copied().max().unwrap_or(0);
        Self { lengths, longest, index: Vec::new() }
    }

    /// The same with the task's place among `names` behind what it shows.
    #[must_use]
    pub fn with_index(self, names: Vec<String>) -> Self {
        Self { index: names, ..self }
    }

    /// Numbers of a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.longest + self.index.len()
    }

    /// Numbers that `task` shows.
    #[must_use]
    pub fn length(&self, task: usize) -> Option<usize> {
        self.lengths.get(task).copied()
    }

    /// Numbers that the task shows that shows most.
    #[must_use]
    pub fn longest(&self) -> usize {
        self.longest
    }

    #[must_use]
    pub fn tasks(&self) -> usize {
        self.lengths.len()
    }

    /// Names of the tasks whose place stands in a row.
    #[must_use]
    pub fn index(&self) -> &[String] {
        &self.index
    }

    /// Fills what a row of `task` has behind `seen` numbers.
    pub fn complete(&self, task: usize, seen: usize, row: &mut [f32]) {
        row[seen..].fill(0.0);
        if !self.index.is_empty() {
            row[self.longest + task] = 1.0;
        }
    }

    /// Writes the row of what `task` shows.
    pub fn write(&self, task: usize, shown: &[f32], row: &mut [f32]) {
        row[..shown.len()].copy_from_slice(shown);
        self.complete(task, shown.len(), row);
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "small whole numbers are exact")]
mod tests {
    use super::*;

    #[test]
    fn rows_are_as_long_as_the_longest_and_may_say_which_task_they_are_of() {
        let input = PaddedInput::new(vec![1, 3]);
        let mut row = [7.0; 3];
        input.write(0, &[5.0], &mut row);
        assert_eq!((input.width(), row), (3, [5.0, 0.0, 0.0]));
        let input = input.with_index(vec!["a".to_owned(), "b".to_owned()]);
        let mut row = [7.0; 5];
        input.write(1, &[1.0, 2.0, 3.0], &mut row);
        assert_eq!((input.width(), row), (5, [1.0, 2.0, 3.0, 0.0, 1.0]));
        input.write(0, &[4.0], &mut row);
        assert_eq!(row, [4.0, 0.0, 0.0, 1.0, 0.0]);
    }
}

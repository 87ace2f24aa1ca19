//! A borrowed table of samples: rows are time steps, columns are channels (joints, muscles, sensors), row by row.
//!
//! Every value is finite: that is checked once, here, so that what is computed from a table need not ask again.

use super::SignalError;

/// Rows of equal length, all values finite.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Rows<'a, T = f64> {
    values: &'a [T],
    columns: usize,
}

impl<'a, T: Copy + Into<f64>> Rows<'a, T> {
    /// The table in `values`, which has rows of `columns` values.
    pub fn new(values: &'a [T], columns: usize) -> Result<Self, SignalError> {
        if columns == 0 || !values.len().is_multiple_of(columns) {
            return Err(SignalError::Ragged { values: values.len(), columns });
        }
        if let Some(index) = values.iter().position(|&value| !value.into().is_finite()) {
            let (row, column) = (index / columns, index % columns);
            return Err(SignalError::NotFinite { row, column, value: values[index].into() });
        }
        Ok(Self { values, columns })
    }

    /// Number of time steps.
    #[must_use]
    pub fn len(&self) -> usize {
        self.values.len() / self.columns
    }

    /// Whether there is no time step.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.values.is_empty()
    }

    /// Number of channels, at least one.
    #[must_use]
    pub fn columns(&self) -> usize {
        self.columns
    }

    /// All values, row by row.
    #[must_use]
    pub fn values(&self) -> &'a [T] {
        self.values
    }

    /// One time step after the other.
    pub fn iter(&self) -> std::slice::ChunksExact<'a, T> {
        self.values.chunks_exact(self.columns)
    }

    /// One time step.
    #[must_use]
    pub fn row(&self, index: usize) -> &'a [T] {
        &self.values[index * self.columns..][..self.columns]
    }

    /// One channel over time; empty if there is no such channel.
    #[must_use]
    pub fn column(&self, index: usize) -> impl ExactSizeIterator<Item = f64> + Clone + use<'a, T> {
        let first = if index < self.columns { index } else { self.values.len() };
        let values = self.values.get(first..).unwrap_or_default();
        values.iter().step_by(self.columns).map(|&value| value.into())
    }

    /// The time steps of `range`.
    #[must_use]
    pub fn slice(&self, range: std::ops::Range<usize>) -> Self {
        let values = &self.values[range.start * self.columns..range.end * self.columns];
        Self { values, columns: self.columns }
    }
}

impl<'a, T: Copy + Into<f64>> IntoIterator for &Rows<'a, T> {
    type Item = &'a [T];
    type IntoIter = std::slice::ChunksExact<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_has_rows_and_columns() {
        let rows = Rows::new(&[1.0_f32, 2.0, 3.0, 4.0, 5.0, 6.0], 2).unwrap();
        assert_eq!((rows.len(), rows.columns()), (3, 2));
        assert_eq!(rows.row(1), [3.0, 4.0]);
        assert_eq!(rows.column(1).collect::<Vec<_>>(), [2.0, 4.0, 6.0]);
        assert_eq!(rows.column(2).len(), 0);
        assert_eq!(rows.slice(1..3).values(), [3.0, 4.0, 5.0, 6.0]);
    }

    #[test]
    fn an_empty_table_has_empty_columns() {
        let rows = Rows::<f64>::new(&[], 3).unwrap();
        assert!(rows.is_empty());
        assert_eq!(rows.column(2).len(), 0);
    }

    #[test]
    fn what_is_ragged_or_not_finite_is_refused_with_its_place() {
        assert_eq!(
            Rows::new(&[0.0; 5], 2).unwrap_err(),
            SignalError::Ragged { values: 5, columns: 2 }
        );
        assert_eq!(
            Rows::new(&[0.0; 5], 0).unwrap_err(),
            SignalError::Ragged { values: 5, columns: 0 }
        );
        let found = Rows::new(&[0.0, 0.0, 0.0, f64::INFINITY], 2).unwrap_err();
        assert_eq!(found, SignalError::NotFinite { row: 1, column: 1, value: f64::INFINITY });
    }
}

//! A table filled column by column from the same rows.

use super::{Column, RecordError, Table};

/// Rows of any kind, and the columns made from them so far.
#[derive(Debug)]
pub struct Rows<'a, T> {
    rows: &'a [T],
    columns: Vec<Column>,
}

impl<'a, T> Rows<'a, T> {
    /// No column yet.
    #[must_use]
    pub fn of(rows: &'a [T]) -> Self {
        Self { rows, columns: Vec::new() }
    }

    /// A column of names.
    #[must_use]
    pub fn text<S: Into<String>>(mut self, name: &str, value: impl Fn(&T) -> S) -> Self {
        let values: Vec<String> = self.rows.iter().map(|row| value(row).into()).collect();
        self.columns.push(Column::unitless(name, values));
        self
    }

    /// A column of counts.
    #[must_use]
    pub fn count(mut self, name: &str, value: impl Fn(&T) -> usize) -> Self {
        let values: Vec<i64> = self.rows.iter().map(|row| value(row) as i64).collect();
        self.columns.push(Column::unitless(name, values));
        self
    }

    /// A column of numbers with a unit, undefined where there is none.
    #[must_use]
    pub fn number<N: Into<Option<f64>>>(
        mut self,
        name: &str,
        unit: &str,
        value: impl Fn(&T) -> N,
    ) -> Self {
        let number = |row: &T| -> f64 {
            let number: Option<f64> = value(row).into();
            number.unwrap_or(f64::NAN)
        };
        let values: Vec<f64> = self.rows.iter().map(number).collect();
        self.columns.push(Column::new(name, unit, values));
        self
    }

    /// The table.
    pub fn table(self) -> Result<Table, RecordError> {
        Table::new(self.columns)
    }
}

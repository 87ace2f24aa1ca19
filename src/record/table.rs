//! A tidy table: one row per observation, one column per quantity, each column with its unit.
//!
//! Plain Rust, so that the rooms that fill tables do not know how they are stored. Columns keep their order. Only
//! numbers with a fraction can be undefined: NaN in memory, null in Parquet, an empty cell in CSV.

use std::collections::BTreeSet;

use super::RecordError;

/// The values of a column, one per row.
#[derive(Debug, Clone, PartialEq)]
pub enum Values {
    /// NaN means undefined.
    Floats(Vec<f64>),
    Integers(Vec<i64>),
    Texts(Vec<String>),
    Flags(Vec<bool>),
}

impl Values {
    /// Number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        match self {
            Self::Floats(values) => values.len(),
            Self::Integers(values) => values.len(),
            Self::Texts(values) => values.len(),
            Self::Flags(values) => values.len(),
        }
    }

    /// Whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }
}

impl From<Vec<f64>> for Values {
    fn from(values: Vec<f64>) -> Self {
        Self::Floats(values)
    }
}

impl From<Vec<i64>> for Values {
    fn from(values: Vec<i64>) -> Self {
        Self::Integers(values)
    }
}

impl From<Vec<String>> for Values {
    fn from(values: Vec<String>) -> Self {
        Self::Texts(values)
    }
}

impl From<Vec<bool>> for Values {
    fn from(values: Vec<bool>) -> Self {
        Self::Flags(values)
    }
}

/// A named column.
#[derive(Debug, Clone, PartialEq)]
pub struct Column {
    /// What it is, e.g. `solved_fraction`.
    pub name: String,
    /// Unit of the values, e.g. `s`; empty if they have none.
    pub unit: String,
    pub values: Values,
}

impl Column {
    /// A column of numbers with a unit.
    pub fn new(
        name: impl Into<String>,
        unit: impl Into<String>,
        values: impl Into<Values>,
    ) -> Self {
        Self { name: name.into(), unit: unit.into(), values: values.into() }
    }

    /// A column of names, counts, shares: whatever has no unit.
    pub fn unitless(name: impl Into<String>, values: impl Into<Values>) -> Self {
        Self::new(name, "", values)
    }
}

/// Columns of equal length and different names.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Table {
    columns: Vec<Column>,
}

impl Table {
    /// A table of `columns`, in that order.
    pub fn new(columns: Vec<Column>) -> Result<Self, RecordError> {
        let expected = columns.first().map_or(0, |column| column.values.len());
        let mut names = BTreeSet::new();
        for column in &columns {
            let found = column.values.len();
            if found != expected {
                return Err(RecordError::RowCount { column: column.name.clone(), expected, found });
            }
            if !names.insert(column.name.as_str()) {
                return Err(RecordError::DuplicateColumn { column: column.name.clone() });
            }
        }
        Ok(Self { columns })
    }

    /// The columns in their order.
    #[must_use]
    pub fn columns(&self) -> &[Column] {
        &self.columns
    }

    /// The column called `name`.
    #[must_use]
    pub fn column(&self, name: &str) -> Option<&Column> {
        self.columns.iter().find(|column| column.name == name)
    }

    /// Number of rows.
    #[must_use]
    pub fn row_count(&self) -> usize {
        self.columns.first().map_or(0, |column| column.values.len())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn columns_of_unequal_length_are_refused() {
        let columns =
            vec![Column::unitless("a", vec![1_i64, 2]), Column::unitless("b", vec![true])];
        assert!(matches!(
            Table::new(columns),
            Err(RecordError::RowCount { expected: 2, found: 1, .. })
        ));
    }

    #[test]
    fn two_columns_of_one_name_are_refused() {
        let columns = vec![Column::unitless("a", vec![1_i64]), Column::new("a", "s", vec![1.0])];
        assert!(matches!(Table::new(columns), Err(RecordError::DuplicateColumn { .. })));
    }

    #[test]
    fn a_table_without_columns_has_no_rows() {
        assert_eq!(Table::new(Vec::new()).unwrap().row_count(), 0);
    }
}

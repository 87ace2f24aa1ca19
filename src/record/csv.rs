//! Tables as comma-separated text, RFC 4180 with line feeds.
//!
//! Numbers are written in the shortest form that reads back as the same `f64`; undefined values are empty cells, as in
//! the published result files. Units are not written: a CSV is for looking, the Parquet beside it is the record.

use std::fmt::Write;
use std::path::Path;

use super::{RecordError, Table, Values};
use crate::files;

/// Writes `table` to `path`.
pub fn write_csv(path: &Path, table: &Table) -> Result<(), RecordError> {
    Ok(files::write_atomic(path, to_csv(table).as_bytes())?)
}

/// The text of `table`: a line of names, then a line per row.
#[must_use]
pub fn to_csv(table: &Table) -> String {
    let mut text = String::new();
    let names = table.columns().iter().map(|column| quoted(&column.name));
    text.push_str(&names.collect::<Vec<_>>().join(","));
    text.push('\n');
    for row in 0..table.row_count() {
        for (index, column) in table.columns().iter().enumerate() {
            if index > 0 {
                text.push(',');
            }
            push_cell(&mut text, &column.values, row);
        }
        text.push('\n');
    }
    text
}

fn push_cell(text: &mut String, values: &Values, row: usize) {
    let written = match values {
        Values::Floats(values) if values[row].is_nan() => Ok(()),
        Values::Floats(values) => write!(text, "{:?}", values[row]),
        Values::Integers(values) => write!(text, "{}", values[row]),
        Values::Flags(values) => write!(text, "{}", values[row]),
        Values::Texts(values) => write!(text, "{}", quoted(&values[row])),
    };
    debug_assert!(written.is_ok(), "writing to a string cannot fail");
}

/// A cell in quotes if it needs them.
fn quoted(cell: &str) -> String {
    if cell.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", cell.replace('"', "\"\""))
    } else {
        cell.to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::super::Column;
    use super::*;

    #[test]
    fn cells_are_quoted_where_needed_and_undefined_ones_are_empty() {
        let table = Table::new(vec![
            Column::unitless("task, code", vec!["pen".to_owned(), "a \"b\"".to_owned()]),
            Column::new("time", "s", vec![0.1, f64::NAN]),
            Column::unitless("n", vec![-3_i64, 4]),
            Column::unitless("solved", vec![true, false]),
        ])
        .unwrap();
        let want = "\"task, code\",time,n,solved\npen,0.1,-3,true\n\"a \"\"b\"\"\",,4,false\n";
        assert_eq!(to_csv(&table), want);
    }

    #[test]
    fn numbers_read_back_as_themselves() {
        let values = vec![1.0 / 3.0, 1e300, 5e-324, -0.0, f64::INFINITY];
        let table = Table::new(vec![Column::unitless("x", values.clone())]).unwrap();
        let text = to_csv(&table);
        let read: Vec<f64> = text.lines().skip(1).map(|line| line.parse().unwrap()).collect();
        assert!(read.iter().zip(&values).all(|(a, b)| a.to_bits() == b.to_bits()));
    }
}

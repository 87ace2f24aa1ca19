//! Any tidy table: Parquet or comma-separated text, plain or gzipped, recognised by its first bytes.
//!
//! Only the columns asked for are kept; what the others hold does not matter. Columns are looked for by their exact
//! name. Limits: those of the two readers, and [`MOST_ROWS`].

use std::io::Read;
use std::path::Path;

use super::{RecordError, Table, read_csv};
use crate::files::{self, FileError};

/// No table may have more rows than this.
const MOST_ROWS: usize = 50_000_000;
/// How every Parquet file begins.
const PARQUET: [u8; 4] = *b"PAR1";
/// Of a wide table, so many names are listed.
const MOST_NAMES: usize = 30;

/// Reads the columns called `wanted`, in that order.
pub fn read_columns(path: &Path, wanted: &[&str]) -> Result<Table, RecordError> {
    if begins_as_parquet(path)? {
        return read_parquet_file(path, wanted);
    }
    let table = read_csv(path)?;
    let known: Vec<&str> = table.columns().iter().map(|column| column.name.as_str()).collect();
    check_columns(path, wanted, &known)?;
    check_rows(path, table.row_count())?;
    pick(&table, wanted)
}

/// Reads all columns.
pub(super) fn read_whole(path: &Path) -> Result<Table, RecordError> {
    if !begins_as_parquet(path)? {
        return read_csv(path);
    }
    read_whole_parquet(path)
}

#[cfg(feature = "parquet")]
fn read_whole_parquet(path: &Path) -> Result<Table, RecordError> {
    Ok(super::read_parquet(path)?.0)
}

#[cfg(not(feature = "parquet"))]
fn read_whole_parquet(path: &Path) -> Result<Table, RecordError> {
    Err(RecordError::NotBuilt { format: "Parquet", path: path.to_path_buf() })
}

#[cfg(feature = "parquet")]
fn read_parquet_file(path: &Path, wanted: &[&str]) -> Result<Table, RecordError> {
    // The reader gives columns in the order of the file.
    pick(&super::parquet::read_parquet_columns(path, wanted)?, wanted)
}

#[cfg(not(feature = "parquet"))]
fn read_parquet_file(path: &Path, _wanted: &[&str]) -> Result<Table, RecordError> {
    Err(RecordError::NotBuilt { format: "Parquet", path: path.to_path_buf() })
}

fn begins_as_parquet(path: &Path) -> Result<bool, RecordError> {
    let fail = |source| FileError::Read { path: path.to_path_buf(), source };
    let mut start = Vec::new();
    files::open(path)?.take(PARQUET.len() as u64).read_to_end(&mut start).map_err(fail)?;
    Ok(start == PARQUET)
}

fn pick(table: &Table, wanted: &[&str]) -> Result<Table, RecordError> {
    Table::new(wanted.iter().filter_map(|name| table.column(name)).cloned().collect())
}

/// Whether all `wanted` columns are among those `known`; the first that is not is named.
pub(super) fn check_columns(
    path: &Path,
    wanted: &[&str],
    known: &[&str],
) -> Result<(), RecordError> {
    let Some(missing) = wanted.iter().find(|name| !known.contains(name)) else { return Ok(()) };
    let mut names: Vec<String> = known.iter().take(MOST_NAMES).map(|n| format!("`{n}`")).collect();
    if known.len() > MOST_NAMES {
        names.push(format!("{} others", known.len() - MOST_NAMES));
    }
    Err(RecordError::NoColumn {
        column: (*missing).to_owned(),
        known: if names.is_empty() { "no columns".to_owned() } else { names.join(", ") },
        path: path.to_path_buf(),
    })
}

/// Whether so many rows are a table.
pub(super) fn check_rows(path: &Path, rows: usize) -> Result<(), RecordError> {
    if rows <= MOST_ROWS {
        return Ok(());
    }
    Err(RecordError::Malformed {
        place: format!("row {MOST_ROWS}"),
        what: format!("the table has {rows} rows, more than are ever needed"),
        path: path.to_path_buf(),
    })
}

#[cfg(test)]
mod tests {
    use super::super::{Column, Values, write_csv};
    use super::*;

    fn table() -> Table {
        Table::new(vec![
            Column::unitless("task", vec!["pen".to_owned(), "die".to_owned()]),
            Column::unitless("seed", vec![1_i64, 2]),
            Column::unitless("value", vec![0.5, f64::NAN]),
        ])
        .unwrap()
    }

    #[test]
    fn only_the_columns_asked_for_are_kept_in_the_order_asked_for() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.csv");
        write_csv(&path, &table()).unwrap();
        #[cfg_attr(
            not(feature = "parquet"),
            expect(unused_mut, reason = "only a Parquet copy is added")
        )]
        let mut paths = vec![path];
        #[cfg(feature = "parquet")]
        {
            // The ending says nothing; the first bytes do.
            let path = folder.path().join("b.csv");
            super::super::write_parquet(&path, &table(), &[]).unwrap();
            paths.push(path);
        }
        for path in paths {
            let found = read_columns(&path, &["value", "task"]).unwrap();
            let names: Vec<&str> = found.columns().iter().map(|c| c.name.as_str()).collect();
            assert_eq!((names, found.row_count()), (vec!["value", "task"], 2));
            assert!(matches!(found.columns()[1].values, Values::Texts(_)));
            let error = read_columns(&path, &["seed", "subject"]).unwrap_err().to_string();
            assert!(error.contains("no column `subject`") && error.contains("`task`"), "{error}");
        }
    }

    #[test]
    fn what_is_no_table_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.parquet");
        for bytes in [&b"PAR1 and nothing PAR1"[..], b"", b"\xFF\xFE", b"\x1F\x8B\x08"] {
            files::write_atomic(&path, bytes).unwrap();
            assert!(read_columns(&path, &["value"]).is_err());
        }
        assert!(read_columns(folder.path(), &["value"]).is_err());
        assert!(check_rows(&path, MOST_ROWS + 1).is_err());
    }
}

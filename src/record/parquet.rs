//! Tables as Parquet files, the same bytes for the same table.
//!
//! One thread encodes, row groups have a fixed size, the compression is zstd at its default level, and nothing that
//! changes from run to run is stored. Units lie in the file's metadata under the key [`UNITS`], as one JSON object from
//! column to unit; the caller's own pairs (provenance, labels) follow in the order given.
//!
//! Undefined numbers are null. Files of other programs may hold whole numbers of any width; those with nulls become
//! numbers with a fraction. A column of any other type is refused by name.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Cursor, Write};
use std::path::Path;

use polars::prelude::{
    Column as Stored, DataFrame, DataType, Float64Chunked, IntoColumn, KeyValueMetadata, NamedFrom,
    NewChunkedArray, ParquetCompression, ParquetReader, ParquetWriter, PolarsError, SerReader,
    Series,
};

use super::{Column, RecordError, Table, Values};
use crate::files;

/// Metadata key of the columns' units.
pub(super) const UNITS: &str = "units";
/// Metadata key that the Parquet library keeps the Arrow schema under.
pub(super) const ARROW_SCHEMA: &str = "ARROW:schema";
/// Rows per row group.
const ROW_GROUP: usize = 1 << 18;
/// No table file may be larger than this.
pub(super) const LARGEST_FILE: u64 = 4 << 30;

/// Writes `table` to `path`, with `metadata` in the file.
pub fn write_parquet(
    path: &Path,
    table: &Table,
    metadata: &[(String, String)],
) -> Result<(), RecordError> {
    let fail = |source| RecordError::Parquet { path: path.to_path_buf(), source };
    if let Some((key, _)) = metadata.iter().find(|(key, _)| key == UNITS || key == ARROW_SCHEMA) {
        return Err(RecordError::ReservedKey { key: key.clone() });
    }
    let mut pairs = vec![(UNITS.to_owned(), units_of(table))];
    pairs.extend_from_slice(metadata);
    let stored = table.columns().iter().map(store).collect();
    let mut frame = DataFrame::new(table.row_count(), stored).map_err(fail)?;
    files::write_atomic_with(path, |file| {
        let mut buffer = BufWriter::new(file);
        ParquetWriter::new(&mut buffer)
            .with_compression(ParquetCompression::Zstd(None))
            .with_row_group_size(Some(ROW_GROUP))
            .set_parallel(false)
            .with_key_value_metadata(Some(KeyValueMetadata::from_static(pairs)))
            .finish(&mut frame)
            .map_err(io::Error::other)?;
        buffer.flush()
    })?;
    Ok(())
}

/// Reads a table that [`write_parquet`] wrote, and the metadata given to it.
pub fn read_parquet(path: &Path) -> Result<(Table, Vec<(String, String)>), RecordError> {
    read(path, ParquetReader::new(Cursor::new(files::read_bounded(path, LARGEST_FILE)?)))
}

/// Reads the columns called `wanted` and nothing else of any Parquet file.
pub(super) fn read_parquet_columns(path: &Path, wanted: &[&str]) -> Result<Table, RecordError> {
    let fail = |source| RecordError::Parquet { path: path.to_path_buf(), source };
    let bytes = files::read_bounded(path, LARGEST_FILE)?;
    let mut reader = ParquetReader::new(Cursor::new(bytes));
    let schema = reader.schema().map_err(fail)?;
    let known: Vec<String> = schema.iter_names().map(ToString::to_string).collect();
    let known: Vec<&str> = known.iter().map(String::as_str).collect();
    super::read_table::check_columns(path, wanted, &known)?;
    let rows = reader.get_metadata().map_err(fail)?.num_rows;
    super::read_table::check_rows(path, rows)?;
    let wanted = wanted.iter().map(|&name| name.to_owned()).collect();
    Ok(read(path, reader.with_columns(Some(wanted)))?.0)
}

fn read(
    path: &Path,
    mut reader: ParquetReader<Cursor<Vec<u8>>>,
) -> Result<(Table, Vec<(String, String)>), RecordError> {
    let fail = |source| RecordError::Parquet { path: path.to_path_buf(), source };
    let pairs = reader.get_metadata().map_err(fail)?.key_value_metadata().clone();
    let mut metadata: Vec<(String, String)> = pairs
        .unwrap_or_default()
        .into_iter()
        .filter(|pair| pair.key != ARROW_SCHEMA)
        .filter_map(|pair| Some((pair.key, pair.value?)))
        .collect();
    // Files of other programs have no units; theirs are unknown and so left empty.
    let mut units = BTreeMap::<String, String>::new();
    metadata.retain(|(key, value)| {
        if key == UNITS {
            units = serde_json::from_str(value).unwrap_or_default();
        }
        key != UNITS
    });
    let frame = reader.finish().map_err(fail)?;
    let columns = frame
        .columns()
        .iter()
        .map(|stored| {
            let name = stored.name().to_string();
            let values = load(stored).map_err(fail)?.ok_or_else(|| RecordError::UnknownType {
                column: name.clone(),
                found: format!("{} ({} nulls)", stored.dtype(), stored.null_count()),
                path: path.to_path_buf(),
            })?;
            let unit = units.remove(&name).unwrap_or_default();
            Ok(Column { name, unit, values })
        })
        .collect::<Result<Vec<_>, RecordError>>()?;
    Ok((Table::new(columns)?, metadata))
}

/// The units of all columns that have one, as a JSON object with sorted keys.
fn units_of(table: &Table) -> String {
    let units: BTreeMap<&str, &str> = table
        .columns()
        .iter()
        .filter(|column| !column.unit.is_empty())
        .map(|column| (column.name.as_str(), column.unit.as_str()))
        .collect();
    serde_json::json!(units).to_string()
}

fn store(column: &Column) -> Stored {
    let name = column.name.as_str().into();
    match &column.values {
        Values::Floats(values) => {
            let defined = values.iter().map(|&x| (!x.is_nan()).then_some(x));
            Float64Chunked::from_iter_options(name, defined).into_column()
        }
        Values::Integers(values) => Series::new(name, values).into_column(),
        Values::Texts(values) => Series::new(name, values).into_column(),
        Values::Flags(values) => Series::new(name, values).into_column(),
    }
}

/// The values of a stored column; `None` for a type that [`Values`] does not have.
fn load(stored: &Stored) -> Result<Option<Values>, PolarsError> {
    Ok(match stored.dtype() {
        DataType::Float64 => {
            let values = stored.f64()?.iter().map(|x| x.unwrap_or(f64::NAN));
            Some(Values::Floats(values.collect()))
        }
        DataType::Float32 => {
            let values = stored.f32()?.iter().map(|x| x.map_or(f64::NAN, f64::from));
            Some(Values::Floats(values.collect()))
        }
        kind if kind.is_integer() && stored.null_count() > 0 => {
            let floats = stored.cast(&DataType::Float64)?;
            let values = floats.f64()?.iter().map(|x| x.unwrap_or(f64::NAN));
            Some(Values::Floats(values.collect()))
        }
        _ if stored.null_count() > 0 => None,
        DataType::Int64 => Some(Values::Integers(stored.i64()?.iter().flatten().collect())),
        // A number beyond the range becomes an error of the cast, not another number.
        kind if kind.is_integer() => {
            let whole = stored.strict_cast(&DataType::Int64)?;
            Some(Values::Integers(whole.i64()?.iter().flatten().collect()))
        }
        DataType::Boolean => Some(Values::Flags(stored.bool()?.iter().flatten().collect())),
        DataType::String => {
            let values = stored.str()?.iter().flatten().map(str::to_owned);
            Some(Values::Texts(values.collect()))
        }
        _ => None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(rows: usize) -> Table {
        let rows = 0..rows;
        Table::new(vec![
            Column::unitless(
                "task",
                rows.clone().map(|i| format!("task {}", i % 3)).collect::<Vec<_>>(),
            ),
            Column::new(
                "time",
                "s",
                rows.clone()
                    .map(|i| if i % 7 == 3 { f64::NAN } else { 0.02 * i as f64 })
                    .collect::<Vec<_>>(),
            ),
            Column::unitless("episode", rows.clone().map(|i| i as i64 - 5).collect::<Vec<_>>()),
            Column::unitless("solved", rows.map(|i| i % 2 == 0).collect::<Vec<_>>()),
        ])
        .unwrap()
    }

    fn metadata() -> Vec<(String, String)> {
        vec![("physics".to_owned(), "2.3.7".to_owned()), ("a".to_owned(), "ü \"b\"".to_owned())]
    }

    /// CSV text tells undefined values apart, which `==` on NaN cannot.
    fn assert_same(found: &Table, want: &Table) {
        assert_eq!(super::super::to_csv(found), super::super::to_csv(want));
        let units =
            |table: &Table| table.columns().iter().map(|c| c.unit.clone()).collect::<Vec<_>>();
        assert_eq!(units(found), units(want));
    }

    #[test]
    fn a_table_comes_back_with_units_and_metadata() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("episodes.parquet");
        for rows in [0, 1, 1000, ROW_GROUP + 3] {
            write_parquet(&path, &table(rows), &metadata()).unwrap();
            let (found, pairs) = read_parquet(&path).unwrap();
            assert_same(&found, &table(rows));
            assert_eq!(pairs, metadata());
        }
    }

    #[test]
    fn the_same_table_gives_the_same_bytes_from_any_thread() {
        let folder = tempfile::tempdir().unwrap();
        let write = |name: String| {
            let path = folder.path().join(name);
            write_parquet(&path, &table(20_000), &metadata()).unwrap();
            files::sha256_of_file(&path).unwrap()
        };
        let alone = write("alone".to_owned());
        std::thread::scope(|scope| {
            let threads: Vec<_> =
                (0..4).map(|i| scope.spawn(move || write(format!("thread {i}")))).collect();
            for thread in threads {
                assert_eq!(thread.join().unwrap(), alone);
            }
        });
    }

    #[test]
    fn reserved_keys_and_damaged_files_are_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("table.parquet");
        let reserved = [(UNITS.to_owned(), String::new())];
        assert!(matches!(
            write_parquet(&path, &table(3), &reserved),
            Err(RecordError::ReservedKey { .. })
        ));
        files::write_atomic(&path, b"PAR1 no table PAR1").unwrap();
        assert!(matches!(read_parquet(&path), Err(RecordError::Parquet { .. })));
    }
}

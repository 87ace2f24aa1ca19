//! The archive: tables on disk.

mod csv;
mod parquet;
mod table;

use std::path::PathBuf;

pub use csv::{to_csv, write_csv};
pub use parquet::{read_parquet, write_parquet};
pub use table::{Column, Table, Values};

use crate::files::FileError;

/// Why a table cannot be made, written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("column `{column}` has {found} rows, the first column has {expected}")]
    RowCount { column: String, expected: usize, found: usize },
    #[error("there are two columns called `{column}`")]
    DuplicateColumn { column: String },
    #[error("the metadata key `{key}` is reserved")]
    ReservedKey { key: String },
    #[error("column `{column}` holds {found}, which no table of this program holds, in `{path}`")]
    UnknownType { column: String, found: String, path: PathBuf },
    #[error("cannot write or read the Parquet table `{path}`: {source}")]
    Parquet { path: PathBuf, source: polars::error::PolarsError },
}

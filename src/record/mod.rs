//! The archive: tables and recordings on disk, and readers of published result files.
//!
//! A [`Table`] holds the numbers of an analysis. A [`Recording`] holds every step of many episodes; [`read_recording`] and
//! [`write_recording`] know the formats it can have.

mod benchmark_inputs;
mod benchmarks;
mod crc32c;
mod csi_results;
mod csv;
mod csv_reader;
mod curve_tables;
mod event_writer;
mod events;
#[cfg_attr(
    not(any(feature = "parquet", feature = "mcap", feature = "hdf5")),
    expect(unused, clippy::needless_pass_by_value, reason = "no format is built in")
)]
mod format;
#[cfg(feature = "hdf5")]
pub mod hdf5;
#[cfg_attr(
    not(any(feature = "parquet", feature = "mcap")),
    expect(unused, reason = "no format that has one is built in")
)]
mod header;
#[cfg(feature = "mcap")]
mod mcap;
#[cfg(feature = "mcap")]
mod mcap_chunk;
#[cfg(feature = "mcap")]
mod mcap_message;
#[cfg(feature = "mcap")]
mod mcap_part;
#[cfg(feature = "mcap")]
mod mcap_writer;
#[cfg(feature = "parquet")]
mod parquet;
#[cfg(feature = "parquet")]
mod parquet_part;
#[cfg_attr(
    not(any(feature = "parquet", feature = "mcap", feature = "hdf5")),
    expect(unused, reason = "no format is built in")
)]
mod place;
pub mod profiles;
mod protobuf;
mod read_table;
pub mod recording;
#[cfg(feature = "parquet")]
mod recording_parquet;
mod result_files;
mod rows;
#[cfg(feature = "view")]
pub mod scene;
mod signal_selection;
mod subspace_curves;
mod table;

use std::path::PathBuf;

pub use benchmark_inputs::{BenchmarkInput, read_benchmark_input};
pub use benchmarks::{
    Benchmark, BenchmarkEntry, BenchmarkTree, SeedResult, SurveyedTree, read_benchmark,
    read_benchmark_tree, read_merged_benchmarks, read_selection, survey_benchmark_tree,
};
pub use crc32c::{crc32c, masked_crc32c};
pub use csi_results::{CsiResult, find_csi_results};
pub use csv::{to_csv, write_csv};
pub use csv_reader::read_csv;
pub use curve_tables::{CurvePoint, RunColumn, read_curve_table, read_run_table};
pub use event_writer::EventWriter;
pub use events::{
    Damage, DamageReason, EventScalars, ScalarPoint, ScalarSeries, read_event_file,
    read_event_files, read_event_run,
};
pub use format::{
    Format, Opened, Summary, may_be_recording, read_episodes, read_recording, summarise,
    write_recording,
};
#[cfg(feature = "parquet")]
pub use parquet::{read_parquet, write_parquet};
pub use place::Place;
pub use read_table::read_columns;
pub use recording::{
    About, Channel, Element, Episode, EpisodeFacts, Precision, Recording, Samples, Seeds, Stacked,
    Timing, names,
};
pub use rows::Rows;
pub use signal_selection::{SelectedSignal, SignalSelection, read_signal_selection};
pub use subspace_curves::{SubspacePoint, read_subspace_curves};
pub use table::{Column, Table, Values};

use crate::files::FileError;

/// Why a table or a recording cannot be made, written or read.
#[derive(Debug, thiserror::Error)]
pub enum RecordError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Array(#[from] crate::npz::ArrayError),
    #[error("column `{column}` has {found} rows, the first column has {expected}")]
    RowCount { column: String, expected: usize, found: usize },
    #[error("there are two columns called `{column}`")]
    DuplicateColumn { column: String },
    #[error("the metadata key `{key}` is reserved")]
    ReservedKey { key: String },
    #[error("column `{column}` holds {found}, which no table of this program holds, in `{path}`")]
    UnknownType { column: String, found: String, path: PathBuf },
    #[cfg(feature = "parquet")]
    #[error("cannot write or read the Parquet table `{path}`: {source}")]
    Parquet { path: PathBuf, source: polars::error::PolarsError },
    /// An array that does not fit, a name that is there twice.
    #[error("{what}")]
    Inconsistent { what: String },
    /// The format was recognised, the content makes no sense.
    #[error("not a readable {format} recording: {what}, in `{path}`")]
    Damaged { format: &'static str, what: String, path: PathBuf },
    /// A Parquet or MCAP file of another kind.
    #[error("the file holds no recording of this program: `{path}`")]
    NoRecording { path: PathBuf },
    #[error("no format of a recording is known that begins as this file does: `{path}`")]
    UnknownFormat { path: PathBuf },
    #[error("this program was built without {format}, which is the format of `{path}`")]
    NotBuilt { format: &'static str, path: PathBuf },
    #[error("{format} recordings cannot hold {what}")]
    CannotHold { format: &'static str, what: String },
    #[error("`{path}` exists already and is not overwritten")]
    Exists { path: PathBuf },
    #[error("no file `{pattern}` in `{path}`")]
    NoEpisodes { pattern: String, path: PathBuf },
    #[error("there is no column `{column}` among {known}, in `{path}`")]
    NoColumn { column: String, known: String, path: PathBuf },
    #[error("{place}: {what}, in `{path}`")]
    Malformed { place: String, what: String, path: PathBuf },
    #[error("there is no file {what} in `{path}`")]
    NoFiles { what: String, path: PathBuf },
}

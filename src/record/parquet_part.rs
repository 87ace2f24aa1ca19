//! A Parquet file of which only some bytes are in memory: the directory at its end, and the row groups that were asked for.
//!
//! The reader wants the whole file as one slice. Here the slice is as long as the file but holds zeros where nothing was
//! fetched; memory that was only ever zeroed costs nothing until it is written to.

use std::fs::File;
use std::io::{Cursor, Read, Seek, SeekFrom};
use std::ops::Range;
use std::path::{Path, PathBuf};

use polars::prelude::{ParquetReader, SerReader};

use super::RecordError;
use super::parquet::LARGEST_FILE;
use crate::files::{self, FileError};

/// Length of the directory, and the letters `PAR1`.
const END: u64 = 4 + 4;

/// A file and what of it was read.
pub(super) struct PartOfFile {
    path: PathBuf,
    file: File,
    bytes: Vec<u8>,
}

impl PartOfFile {
    /// Reads the directory of the file at `path`.
    pub(super) fn open(path: &Path) -> Result<Self, RecordError> {
        let length = files::length(path)?;
        if length > LARGEST_FILE {
            let (path, found, limit) = (path.to_path_buf(), length, LARGEST_FILE);
            return Err(FileError::TooLarge { path, found, limit }.into());
        }
        let mut part = Self {
            path: path.to_path_buf(),
            file: files::open(path)?,
            bytes: vec![0; length as usize],
        };
        part.fetch(0..4.min(length))?;
        part.fetch(length.saturating_sub(END)..length)?;
        let directory = part.bytes.last_chunk::<8>().map(|[a, b, c, d, ..]| [*a, *b, *c, *d]);
        let directory = directory.map_or(0, |bytes| u64::from(u32::from_le_bytes(bytes)));
        // A length that is wrong is the reader's to complain about.
        part.fetch(length.saturating_sub(END + directory)..length.saturating_sub(END))?;
        Ok(part)
    }

    /// As long as the file.
    pub(super) fn bytes(&self) -> &[u8] {
        &self.bytes
    }

    /// Reads the row groups that `rows` are in.
    pub(super) fn fetch_rows(&mut self, rows: Range<usize>) -> Result<(), RecordError> {
        let fail = |source| RecordError::Parquet { path: self.path.clone(), source };
        let mut reader = ParquetReader::new(Cursor::new(&self.bytes[..]));
        let metadata = reader.get_metadata().map_err(fail)?.clone();
        drop(reader);
        let mut first = 0_usize;
        for group in &metadata.row_groups {
            let last = first.saturating_add(group.num_rows());
            if first < rows.end && rows.start < last {
                for column in group.byte_ranges_iter() {
                    self.fetch(column)?;
                }
            }
            first = last;
        }
        Ok(())
    }

    /// Reads what of `range` lies in the file.
    fn fetch(&mut self, range: Range<u64>) -> Result<(), RecordError> {
        let end = range.end.min(self.bytes.len() as u64);
        let start = range.start.min(end);
        let into = &mut self.bytes[start as usize..end as usize];
        let read = self.file.seek(SeekFrom::Start(start)).and_then(|_| self.file.read_exact(into));
        read.map_err(|source| FileError::Read { path: self.path.clone(), source }.into())
    }
}

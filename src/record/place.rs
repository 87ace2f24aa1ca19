//! Where a recording is written: to a new file, or over an old one.

use std::fs::File;
use std::io;
use std::path::Path;

use super::RecordError;
use crate::files;

/// What happens if the file exists already.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Place {
    /// It is left alone, and writing fails: what upstream's writers do, and `convert`.
    New,
    /// It is replaced: a run's own folder.
    Replace,
}

impl Place {
    /// Writes `path` atomically through `fill`.
    pub(super) fn write(
        self,
        path: &Path,
        fill: impl FnOnce(&mut File) -> io::Result<()>,
    ) -> Result<(), RecordError> {
        match self {
            Self::Replace => Ok(files::write_atomic_with(path, fill)?),
            Self::New if path.exists() => Err(RecordError::Exists { path: path.to_path_buf() }),
            Self::New => Ok(files::write_new_atomic_with(path, fill)?),
        }
    }
}

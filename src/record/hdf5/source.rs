//! Bounded access to an HDF5 file: groups of episodes, attributes, arrays cut to an episode's length, texts.
//!
//! The file is read piece by piece. Every claimed shape is compared with what is asked for, and with the limits below,
//! before anything of that size is read or unpacked.

use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};

use hdf5_pure::{AttrValue, DType, Dataset, File, Group, VlenStringReadOptions};

use crate::record::{RecordError, Samples};

/// No file may be larger.
const LARGEST_FILE: u64 = 16 << 30;
/// No array and no chunk of one may have more values.
const MOST_VALUES: u64 = 1 << 28;
/// Nor more than the file's own bytes can hold: gzip packs at most about a thousand to one.
const MOST_VALUES_PER_BYTE: u64 = 1024;
/// No array may have more columns.
const MOST_COLUMNS: u64 = 1 << 16;
/// No list of names may be longer, nor have more bytes.
const MOST_TEXTS: u64 = 1 << 16;
const MOST_TEXT_BYTES: u64 = 1 << 26;

/// An open file.
pub(super) struct Source {
    file: File,
    most_values: u64,
    pub(super) path: PathBuf,
}

/// The attributes of a group or the file.
pub(super) struct Attributes(HashMap<String, AttrValue>);

impl Source {
    pub(super) fn open(path: &Path) -> Result<Self, RecordError> {
        let length = crate::files::length(path)?;
        if length > LARGEST_FILE {
            let (path, limit) = (path.to_path_buf(), LARGEST_FILE);
            return Err(crate::files::FileError::TooLarge { path, found: length, limit }.into());
        }
        let file = guarded(path, || File::open_streaming(path))?;
        let most_values = length.saturating_mul(MOST_VALUES_PER_BYTE).min(MOST_VALUES);
        Ok(Self { file, most_values, path: path.to_path_buf() })
    }

    /// The error of a file that makes no sense.
    pub(super) fn damaged(&self, what: impl Into<String>) -> RecordError {
        damaged(&self.path, what.into())
    }

    fn group(&self, group: &str) -> Result<Group, RecordError> {
        if group.is_empty() {
            return Ok(self.file.root());
        }
        guarded(&self.path, || self.file.group(group))
    }

    /// The groups called `episode_<number>`, sorted by number.
    pub(super) fn episodes(&self) -> Result<Vec<(u64, String)>, RecordError> {
        let root = self.group("")?;
        let groups = guarded(&self.path, || root.groups())?;
        let number = |name: String| {
            let number = name.strip_prefix("episode_")?.parse().ok()?;
            Some((number, name))
        };
        let mut episodes: Vec<_> = groups.into_iter().filter_map(number).collect();
        episodes.sort_unstable();
        Ok(episodes)
    }

    /// The names of the data sets of a group.
    pub(super) fn data_sets(&self, group: &str) -> Result<Vec<String>, RecordError> {
        let group = self.group(group)?;
        let mut names = guarded(&self.path, || group.datasets())?;
        names.sort_unstable();
        Ok(names)
    }

    pub(super) fn has_data_set(&self, group: &str, name: &str) -> Result<bool, RecordError> {
        Ok(self.data_sets(group)?.iter().any(|found| found == name))
    }

    pub(super) fn has_group(&self, name: &str) -> Result<bool, RecordError> {
        let root = self.group("")?;
        let groups = guarded(&self.path, || root.groups())?;
        Ok(groups.iter().any(|found| found == name))
    }

    pub(super) fn attributes(&self, group: &str) -> Result<Attributes, RecordError> {
        let group = self.group(group)?;
        Ok(Attributes(guarded(&self.path, || group.attrs())?))
    }

    fn data_set(&self, group: &str, name: &str) -> Result<Dataset, RecordError> {
        let group = self.group(group)?;
        guarded(&self.path, || group.dataset(name))
    }

    /// An attribute of a data set, if it is a text.
    pub(super) fn text_of(&self, group: &str, name: &str, attribute: &str) -> Option<String> {
        let set = self.data_set(group, name).ok()?;
        let attributes = guarded(&self.path, || set.attrs()).ok()?;
        attributes.get(attribute)?.as_str().map(str::to_owned)
    }

    /// The shape of a data set.
    pub(super) fn shape(&self, group: &str, name: &str) -> Result<Vec<u64>, RecordError> {
        let set = self.data_set(group, name)?;
        guarded(&self.path, || set.shape())
    }

    /// The first `rows` rows of a data set of numbers, with their number of columns: the product of all axes but the first.
    pub(super) fn rows(
        &self,
        group: &str,
        name: &str,
        rows: usize,
    ) -> Result<(Samples, usize), RecordError> {
        let place = || if group.is_empty() { name.to_owned() } else { format!("{group}/{name}") };
        let set = self.data_set(group, name)?;
        let shape = guarded(&self.path, || set.shape())?;
        let (Some(&found), Some(width)) = (shape.first(), product(shape.get(1..).unwrap_or(&[])))
        else {
            return Err(self.damaged(format!("`{}` has shape {shape:?}", place())));
        };
        if found < rows as u64 {
            let place = place();
            return Err(
                self.damaged(format!("`{place}` has {found} rows, expected at least {rows}"))
            );
        }
        let chunk = guarded(&self.path, || set.chunk_shape())?.unwrap_or_default();
        let values = (rows as u64).checked_mul(width);
        let fits = |count: Option<u64>| count.is_some_and(|count| count <= self.most_values);
        let fits = fits(Some(rows as u64)) && fits(values) && fits(product(&chunk));
        let Some(values) = values.filter(|_| fits && width <= MOST_COLUMNS) else {
            return Err(self.damaged(format!("`{}` claims the shape {shape:?}", place())));
        };
        let rows = rows as u64;
        let samples = match guarded(&self.path, || set.dtype())? {
            DType::F32 => Samples::Single(guarded(&self.path, || set.read_f32_rows(0, rows))?),
            DType::F64
            | DType::I8
            | DType::I16
            | DType::I32
            | DType::I64
            | DType::U8
            | DType::U16
            | DType::U32
            | DType::U64
            | DType::Enum(_) => {
                Samples::Double(guarded(&self.path, || set.read_f64_rows(0, rows))?)
            }
            other => return Err(self.damaged(format!("`{}` holds {other}, not numbers", place()))),
        };
        if samples.len() as u64 != values {
            let (place, found) = (place(), samples.len());
            return Err(self.damaged(format!("`{place}` gave {found} values, expected {values}")));
        }
        Ok((samples, width as usize))
    }

    /// A list of texts of the file, if it has one of this name.
    pub(super) fn texts(&self, name: &str) -> Result<Option<Vec<String>>, RecordError> {
        if !self.has_data_set("", name)? {
            return Ok(None);
        }
        let set = self.data_set("", name)?;
        let shape = guarded(&self.path, || set.shape())?;
        let count = product(&shape).filter(|&count| count <= MOST_TEXTS);
        let Some(count) = count else {
            return Err(self.damaged(format!("`{name}` claims the shape {shape:?}")));
        };
        let options = VlenStringReadOptions::new()
            .with_max_elements(MOST_TEXTS as usize)
            .with_max_payload_bytes(MOST_TEXT_BYTES as usize);
        let texts = match guarded(&self.path, || set.dtype())? {
            DType::VariableLengthString => guarded(&self.path, || set.read_vlen_strings(options))?,
            DType::String => {
                let size = guarded(&self.path, || set.element_size())?;
                if size.checked_mul(count).is_none_or(|bytes| bytes > MOST_TEXT_BYTES) {
                    return Err(self.damaged(format!("`{name}` claims texts of {size} bytes")));
                }
                guarded(&self.path, || set.read_string())?
            }
            other => return Err(self.damaged(format!("`{name}` holds {other}, not texts"))),
        };
        Ok(Some(texts))
    }
}

impl Attributes {
    pub(super) fn text(&self, name: &str) -> Option<String> {
        self.0.get(name)?.as_str().map(str::to_owned)
    }

    pub(super) fn integer(&self, name: &str) -> Option<i64> {
        let value = self.0.get(name)?;
        let number = value.as_f64().filter(|number| number.fract().to_bits() == 0);
        value.as_i64().or(number.map(|number| number as i64))
    }

    pub(super) fn number(&self, name: &str) -> Option<f64> {
        let value = self.0.get(name)?;
        value.as_f64().or(value.as_i64().map(|integer| integer as f64))
    }

    /// A truth value, as NumPy stores it or as a number.
    pub(super) fn flag(&self, name: &str) -> Option<bool> {
        self.integer(name).map(|integer| integer != 0)
    }

    /// `episode_length`, which every layout has.
    pub(super) fn length(&self) -> Option<usize> {
        usize::try_from(self.integer("episode_length")?).ok()
    }

    /// Everything not in `known`, as text, with `flags` as `true` and `false`.
    pub(super) fn others(&self, known: &[&str], flags: &[&str]) -> Vec<(String, String)> {
        let mut others = Vec::new();
        for (name, value) in &self.0 {
            if known.contains(&name.as_str()) {
                continue;
            }
            let number = || value.as_i64().map(|integer| integer.to_string());
            let fraction = || value.as_f64().map(|number| number.to_string());
            let flag = flags.contains(&name.as_str()).then(|| self.flag(name)).flatten();
            let text =
                flag.map(|flag| flag.to_string()).or_else(|| value.as_str().map(str::to_owned));
            if let Some(text) = text.or_else(number).or_else(fraction) {
                others.push((name.clone(), text));
            }
        }
        others.sort_unstable();
        others
    }
}

fn product(shape: &[u64]) -> Option<u64> {
    shape.iter().try_fold(1_u64, |product, &n| product.checked_mul(n))
}

fn damaged(path: &Path, what: String) -> RecordError {
    RecordError::Damaged { format: "HDF5", what, path: path.to_path_buf() }
}

/// Calls into the HDF5 library. A file made to break it must not end the program, so a panic becomes an error; nothing is
/// used after one but the path.
fn guarded<T>(
    path: &Path,
    call: impl FnOnce() -> Result<T, hdf5_pure::Error>,
) -> Result<T, RecordError> {
    match catch_unwind(AssertUnwindSafe(call)) {
        Ok(result) => result.map_err(|error| damaged(path, error.to_string())),
        Err(_) => {
            Err(damaged(path, "it is damaged in a way the HDF5 library does not know".to_owned()))
        }
    }
}

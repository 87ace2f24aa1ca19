//! Bounded reader for NumPy's `.npy` and `.npz` files: recorded traces, reference outputs, upstream recordings.
//!
//! Knows little-endian `f4 f8 i1 i2 i4 i8 u1 u2 u4 b1` in C order, matrices also in Fortran order, and refuses
//! everything else, object arrays above all. Sizes are checked before memory is taken. Texts, and writing, are in
//! [`open_members`] and [`write_npz`].

mod members;

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use zip::read::{ArchiveOffset, Config, ZipArchive};
use zip::result::ZipError;

pub use members::{Member, TextArray, open_members, parse_member, write_npy, write_npz};

use crate::files::{self, FileError, printable};
use crate::zip_directory::Directory;

/// No array file may be larger than this.
const LARGEST_FILE: u64 = 512 << 20;

/// Bytes of memory for what becomes of one file: the largest recording known here takes a tenth of it.
const LARGEST_MEMORY: u64 = 192 << 20;

/// NumPy's own bound on the number of axes.
const MOST_AXES: usize = 64;

/// Why an array file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ArrayError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("not a readable .npz archive: {what}")]
    Archive { what: String },
    #[error("array `{array}`: {what}")]
    Array { array: String, what: String },
    #[error("array `{array}` is missing")]
    Missing { array: String },
    #[error("array `{array}` has shape {found:?}, expected {expected}")]
    Shape { array: String, expected: String, found: Vec<usize> },
    #[error("{fault}, in `{path}`")]
    InFile { fault: Box<ArrayError>, path: PathBuf },
}

/// Elements of an array, in the widest type of their kind that is exact.
#[derive(Debug, Clone, PartialEq)]
pub enum Elements {
    F32(Vec<f32>),
    F64(Vec<f64>),
    I64(Vec<i64>),
}

/// An n-dimensional array in C order.
#[derive(Debug, Clone, PartialEq)]
pub struct Array {
    pub shape: Vec<usize>,
    pub elements: Elements,
}

impl Array {
    /// All elements as `f64`. Exact except for integers beyond 2⁵³.
    #[must_use]
    pub fn to_f64(&self) -> Vec<f64> {
        match &self.elements {
            Elements::F32(v) => v.iter().map(|&x| f64::from(x)).collect(),
            Elements::F64(v) => v.clone(),
            #[expect(clippy::cast_precision_loss, reason = "documented")]
            Elements::I64(v) => v.iter().map(|&x| x as f64).collect(),
        }
    }

    /// All elements as `f32`, rounding `f64`.
    #[must_use]
    pub fn to_f32(&self) -> Vec<f32> {
        match &self.elements {
            Elements::F32(v) => v.clone(),
            #[expect(clippy::cast_possible_truncation, reason = "documented")]
            Elements::F64(v) => v.iter().map(|&x| x as f32).collect(),
            #[expect(clippy::cast_precision_loss, reason = "documented")]
            Elements::I64(v) => v.iter().map(|&x| x as f32).collect(),
        }
    }

    /// Number of rows, i.e. the first axis; 1 for a scalar.
    #[must_use]
    pub fn rows(&self) -> usize {
        self.shape.first().copied().unwrap_or(1)
    }
}

/// The arrays of one `.npz` file by name.
#[derive(Debug, Clone, Default)]
pub struct Arrays(pub BTreeMap<String, Array>);

impl Arrays {
    /// Reads every array of `path`.
    pub fn open(path: &Path) -> Result<Self, ArrayError> {
        Self::open_some(path, |_| true)
    }

    /// Reads the arrays of `path` whose names are `wanted`; the others may be of any kind.
    pub fn open_some(path: &Path, wanted: impl Fn(&str) -> bool) -> Result<Self, ArrayError> {
        let bytes = files::read_bounded(path, LARGEST_FILE)?;
        Self::parse(&bytes, LARGEST_MEMORY, wanted).map_err(|fault| ArrayError::InFile {
            fault: Box::new(fault),
            path: path.to_path_buf(),
        })
    }

    /// Reads the arrays of an archive whose names are `wanted`, with at most `memory` bytes for what becomes of them.
    pub fn parse(
        bytes: &[u8],
        memory: u64,
        wanted: impl Fn(&str) -> bool,
    ) -> Result<Self, ArrayError> {
        let mut arrays = BTreeMap::new();
        unpack(bytes, memory, wanted, |account, name, content| {
            arrays.insert(name.to_owned(), account.parse_npy(name, content)?);
            Ok(())
        })?;
        Ok(Self(arrays))
    }

    /// The array `name`, or an error that names it.
    pub fn get(&self, name: &str) -> Result<&Array, ArrayError> {
        self.0.get(name).ok_or_else(|| ArrayError::Missing { array: name.to_owned() })
    }
}

/// Unpacks the `wanted` arrays of an archive one after the other and gives each to `take`, by its name.
fn unpack(
    bytes: &[u8],
    memory: u64,
    wanted: impl Fn(&str) -> bool,
    mut take: impl FnMut(&mut Account, &str, &[u8]) -> Result<(), ArrayError>,
) -> Result<(), ArrayError> {
    let mut account = Account { left: memory, limit: memory };
    let directory =
        Directory::read(bytes).map_err(|e| ArrayError::Archive { what: e.to_string() })?;
    account.charge("the directory", directory.memory())?;
    let fail = |e: ZipError| ArrayError::Archive { what: printable(&e.to_string()) };
    let config = Config { archive_offset: ArchiveOffset::Known(0) };
    let mut archive = ZipArchive::with_config(config, Cursor::new(bytes)).map_err(fail)?;
    if archive.has_duplicate_names() {
        return Err(ArrayError::Archive { what: "two arrays have one name".to_owned() });
    }
    for index in 0..archive.len() {
        let member = archive.by_index(index).map_err(fail)?;
        let name = member.name().map_err(fail)?.into_owned();
        let Some(array_name) = name.strip_suffix(".npy").filter(|name| wanted(name)) else {
            continue;
        };
        let what = printable(array_name);
        let size = member.size();
        account.charge(&what, size)?;
        let mut content = Vec::with_capacity(usize::try_from(size).unwrap_or(0));
        // One byte more than announced is enough to notice a header that lies.
        member.take(size.saturating_add(1)).read_to_end(&mut content).map_err(|e| {
            let what = format!("array `{what}`: {}", printable(&e.to_string()));
            ArrayError::Archive { what }
        })?;
        if content.len() as u64 != size {
            let what = format!("array `{what}` has {} bytes, not {size}", content.len());
            return Err(ArrayError::Archive { what });
        }
        take(&mut account, array_name, &content)?;
        account.left += size;
    }
    Ok(())
}

/// Parses one `.npy` file.
pub fn parse_npy(name: &str, bytes: &[u8]) -> Result<Array, ArrayError> {
    Account { left: LARGEST_MEMORY, limit: LARGEST_MEMORY }.parse_npy(name, bytes)
}

/// What may still be allocated.
struct Account {
    left: u64,
    limit: u64,
}

impl Account {
    /// Takes `bytes` from the account. Called before the allocation.
    fn charge(&mut self, array: &str, bytes: u64) -> Result<(), ArrayError> {
        self.left = self.left.checked_sub(bytes).ok_or_else(|| ArrayError::Array {
            array: printable(array),
            what: format!("needs {bytes} bytes of memory; all may take {}", self.limit),
        })?;
        Ok(())
    }

    fn parse_npy(&mut self, name: &str, bytes: &[u8]) -> Result<Array, ArrayError> {
        let fail = |what: &str| ArrayError::Array { array: printable(name), what: what.to_owned() };
        let Npy { descr, fortran, shape, count, data } = Npy::read(name, bytes)?;
        if fortran && shape.len() > 2 {
            return Err(fail("is stored column by column, which is supported for matrices only"));
        }
        let kind = descr.strip_prefix(['<', '|']).ok_or_else(|| fail("is not little-endian"))?;
        let (size, read): (usize, fn(&[u8]) -> Elements) = match kind {
            "f8" => (8, |data| Elements::F64(decode(data, f64::from_le_bytes))),
            "f4" => (4, |data| Elements::F32(decode(data, f32::from_le_bytes))),
            "i8" => (8, |data| Elements::I64(decode(data, i64::from_le_bytes))),
            "i4" => (4, |data| Elements::I64(decode(data, |b| i32::from_le_bytes(b).into()))),
            "i2" => (2, |data| Elements::I64(decode(data, |b| i16::from_le_bytes(b).into()))),
            "i1" => (1, |data| Elements::I64(decode(data, |b| i8::from_le_bytes(b).into()))),
            "u4" => (4, |data| Elements::I64(decode(data, |b| u32::from_le_bytes(b).into()))),
            "u2" => (2, |data| Elements::I64(decode(data, |b| u16::from_le_bytes(b).into()))),
            "u1" | "b1" => (1, |data| Elements::I64(decode(data, |[b]: [u8; 1]| b.into()))),
            other => {
                let other = printable(other);
                return Err(fail(&format!("has element type `{other}`, which is not supported")));
            }
        };
        if count.checked_mul(size) != Some(data.len()) {
            return Err(fail("has another length than its shape says"));
        }
        // Up to eight bytes for each element, and once more while a matrix is turned.
        let memory = 8 * count as u64 * if fortran { 2 } else { 1 };
        self.charge(name, memory)?;
        let elements = match (read(data), fortran, shape.as_slice()) {
            (Elements::F32(v), true, &[rows, columns]) => Elements::F32(turned(&v, rows, columns)),
            (Elements::F64(v), true, &[rows, columns]) => Elements::F64(turned(&v, rows, columns)),
            (Elements::I64(v), true, &[rows, columns]) => Elements::I64(turned(&v, rows, columns)),
            (elements, _, _) => elements,
        };
        Ok(Array { shape, elements })
    }
}

/// A `.npy` file whose header has been read.
struct Npy<'a> {
    /// Element type.
    descr: String,
    fortran: bool,
    shape: Vec<usize>,
    /// Number of elements.
    count: usize,
    data: &'a [u8],
}

impl<'a> Npy<'a> {
    fn read(name: &str, bytes: &'a [u8]) -> Result<Self, ArrayError> {
        let fail = |what: &str| ArrayError::Array { array: printable(name), what: what.to_owned() };
        let (header, data) = split_header(bytes).map_err(fail)?;
        let header = std::str::from_utf8(header).map_err(|_| fail("has an unreadable header"))?;
        let (descr, fortran, shape) =
            parse_header(header).ok_or_else(|| fail("has an unreadable header"))?;
        let count = shape
            .iter()
            .try_fold(1_usize, |product, &n| product.checked_mul(n))
            .ok_or_else(|| fail("claims an impossible size"))?;
        Ok(Self { descr, fortran, shape, count, data })
    }
}

/// The header's dictionary, as text, and the data after it.
fn split_header(bytes: &[u8]) -> Result<(&[u8], &[u8]), &'static str> {
    const TRUNCATED: &str = "is truncated";
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or("is no NumPy array")?;
    let (&[major, _minor], rest) = rest.split_first_chunk::<2>().ok_or(TRUNCATED)?;
    let (length, rest) = match major {
        1 => {
            let (length, rest) = rest.split_first_chunk::<2>().ok_or(TRUNCATED)?;
            (usize::from(u16::from_le_bytes(*length)), rest)
        }
        2 | 3 => {
            let (length, rest) = rest.split_first_chunk::<4>().ok_or(TRUNCATED)?;
            (u32::from_le_bytes(*length) as usize, rest)
        }
        _ => return Err("has an unknown format version"),
    };
    rest.split_at_checked(length).ok_or(TRUNCATED)
}

/// A matrix stored column by column, in C order.
fn turned<T: Copy>(values: &[T], rows: usize, columns: usize) -> Vec<T> {
    // A matrix without columns may claim any number of rows.
    let rows = if columns == 0 { 0 } else { rows };
    (0..rows).flat_map(|row| (0..columns).map(move |column| values[column * rows + row])).collect()
}

fn decode<const N: usize, T>(data: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
    data.as_chunks::<N>().0.iter().map(|&bytes| read(bytes)).collect()
}

/// The three entries of the header's dictionary: element type, column order, shape.
fn parse_header(header: &str) -> Option<(String, bool, Vec<usize>)> {
    let value = |key: &str| {
        let start = header.find(&format!("'{key}'"))? + key.len() + 2;
        Some(header[start..].trim_start().strip_prefix(':')?.trim_start())
    };
    let descr = value("descr")?.strip_prefix('\'')?.split('\'').next()?.to_owned();
    let fortran = match value("fortran_order")? {
        text if text.starts_with("True") => true,
        text if text.starts_with("False") => false,
        _ => return None,
    };
    let shape = value("shape")?.strip_prefix('(')?.split(')').next()?;
    let shape = shape
        .split(',')
        .map(str::trim)
        .filter(|n| !n.is_empty())
        .map(|n| n.parse().ok())
        .collect::<Option<Vec<usize>>>()
        .filter(|shape| shape.len() <= MOST_AXES)?;
    Some((descr, fortran, shape))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(descr: &str, shape: &str, data: &[u8]) -> Vec<u8> {
        let header =
            format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {shape}, }}\n");
        let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
        bytes.extend(u16::try_from(header.len()).unwrap().to_le_bytes());
        bytes.extend(header.as_bytes());
        bytes.extend(data);
        bytes
    }

    #[test]
    fn reads_scalars_vectors_and_matrices() {
        let scalar = parse_npy("x", &npy("<f8", "()", &2.5_f64.to_le_bytes())).unwrap();
        assert_eq!((scalar.shape.len(), scalar.to_f64()), (0, vec![2.5]));
        let matrix = parse_npy("x", &npy("|i1", "(2, 2)", &[1, 2, 3, 255])).unwrap();
        assert_eq!((matrix.shape.clone(), matrix.to_f64()), (vec![2, 2], vec![1., 2., 3., -1.]));
    }

    #[test]
    fn a_matrix_stored_column_by_column_is_turned() {
        let mut bytes = npy("|i1", "(2, 3)", &[1, 4, 2, 5, 3, 6]);
        let order = bytes.windows(5).position(|w| w == b"False").unwrap();
        bytes[order..order + 5].copy_from_slice(b"True ");
        let matrix = parse_npy("x", &bytes).unwrap();
        assert_eq!(
            (matrix.shape.clone(), matrix.to_f64()),
            (vec![2, 3], vec![1., 2., 3., 4., 5., 6.])
        );
    }

    #[test]
    fn refuses_what_it_does_not_know() {
        for (bytes, why) in [
            (npy("|O", "(1,)", &[0; 8]), "not supported"),
            (npy(">f8", "(1,)", &[0; 8]), "little-endian"),
            (npy("<f8", "(2,)", &[0; 8]), "another length"),
            (npy("<f8", "(4294967296, 4294967296)", &[]), "impossible size"),
            (b"\x93NUMPY\x01".to_vec(), "truncated"),
        ] {
            let message = parse_npy("x", &bytes).unwrap_err().to_string();
            assert!(message.contains(why), "{message}");
        }
    }
}

//! Bounded reader for NumPy's `.npy` and `.npz` files: recorded traces, reference outputs, upstream recordings.
//!
//! Knows little-endian `f4 f8 i1 i2 i4 i8 u1 u2 u4 b1` in C order, matrices also in Fortran order, and refuses
//! everything else, object arrays above all. Sizes are checked before memory is taken.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::path::{Path, PathBuf};

use crate::files::{self, FileError};

/// No array file may be larger than this, packed or unpacked.
const LARGEST_FILE: u64 = 1 << 30;

/// Why an array file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum ArrayError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("not a readable .npz archive: {what} in `{path}`")]
    Archive { what: String, path: PathBuf },
    #[error("array `{array}`: {what}")]
    Array { array: String, what: String },
    #[error("array `{array}` is missing")]
    Missing { array: String },
    #[error("array `{array}` has shape {found:?}, expected {expected}")]
    Shape { array: String, expected: String, found: Vec<usize> },
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
        let fail = |what: String| ArrayError::Archive { what, path: path.to_path_buf() };
        let mut archive =
            zip::ZipArchive::new(Cursor::new(bytes)).map_err(|e| fail(e.to_string()))?;
        let mut arrays = BTreeMap::new();
        let mut budget = LARGEST_FILE;
        for index in 0..archive.len() {
            let mut member = archive.by_index(index).map_err(|e| fail(e.to_string()))?;
            let name = member.name().map_err(|e| fail(e.to_string()))?.into_owned();
            let Some(array_name) = name.strip_suffix(".npy").filter(|name| wanted(name)) else {
                continue;
            };
            let mut content = Vec::new();
            member
                .by_ref()
                .take(budget + 1)
                .read_to_end(&mut content)
                .map_err(|e| fail(format!("member `{name}`: {e}")))?;
            budget = budget
                .checked_sub(content.len() as u64)
                .ok_or_else(|| fail(format!("more than {LARGEST_FILE} bytes unpacked")))?;
            arrays.insert(array_name.to_owned(), parse_npy(array_name, &content)?);
        }
        Ok(Self(arrays))
    }

    /// The array `name`, or an error that names it.
    pub fn get(&self, name: &str) -> Result<&Array, ArrayError> {
        self.0.get(name).ok_or_else(|| ArrayError::Missing { array: name.to_owned() })
    }
}

/// Parses one `.npy` file.
pub fn parse_npy(name: &str, bytes: &[u8]) -> Result<Array, ArrayError> {
    let fail = |what: &str| ArrayError::Array { array: name.to_owned(), what: what.to_owned() };
    let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or_else(|| fail("is no NumPy array"))?;
    let (&[major, _minor], rest) =
        rest.split_first_chunk::<2>().ok_or_else(|| fail("is truncated"))?;
    let (header_length, rest) = match major {
        1 => {
            let (length, rest) =
                rest.split_first_chunk::<2>().ok_or_else(|| fail("is truncated"))?;
            (usize::from(u16::from_le_bytes(*length)), rest)
        }
        2 | 3 => {
            let (length, rest) =
                rest.split_first_chunk::<4>().ok_or_else(|| fail("is truncated"))?;
            (u32::from_le_bytes(*length) as usize, rest)
        }
        _ => return Err(fail("has an unknown format version")),
    };
    let (header, data) =
        rest.split_at_checked(header_length).ok_or_else(|| fail("is truncated"))?;
    let header = std::str::from_utf8(header).map_err(|_| fail("has an unreadable header"))?;
    let (descr, fortran, shape) =
        parse_header(header).ok_or_else(|| fail("has an unreadable header"))?;
    let count = shape
        .iter()
        .try_fold(1_usize, |product, &n| product.checked_mul(n))
        .ok_or_else(|| fail("claims an impossible size"))?;
    if fortran && shape.len() > 2 {
        return Err(fail("is stored column by column, which is supported for matrices only"));
    }
    let kind = descr.strip_prefix(['<', '|']).ok_or_else(|| fail("is not little-endian"))?;
    let mismatch = || fail("has another length than its shape says");
    let elements = match kind {
        "f8" => Elements::F64(decode(data, count, f64::from_le_bytes).ok_or_else(mismatch)?),
        "f4" => Elements::F32(decode(data, count, f32::from_le_bytes).ok_or_else(mismatch)?),
        "i8" => Elements::I64(decode(data, count, i64::from_le_bytes).ok_or_else(mismatch)?),
        "i4" => Elements::I64(
            decode(data, count, |b| i64::from(i32::from_le_bytes(b))).ok_or_else(mismatch)?,
        ),
        "i2" => Elements::I64(
            decode(data, count, |b| i64::from(i16::from_le_bytes(b))).ok_or_else(mismatch)?,
        ),
        "i1" => Elements::I64(
            decode(data, count, |b| i64::from(i8::from_le_bytes(b))).ok_or_else(mismatch)?,
        ),
        "u4" => Elements::I64(
            decode(data, count, |b| i64::from(u32::from_le_bytes(b))).ok_or_else(mismatch)?,
        ),
        "u2" => Elements::I64(
            decode(data, count, |b| i64::from(u16::from_le_bytes(b))).ok_or_else(mismatch)?,
        ),
        "u1" | "b1" => {
            Elements::I64(decode(data, count, |b: [u8; 1]| i64::from(b[0])).ok_or_else(mismatch)?)
        }
        other => return Err(fail(&format!("has element type `{other}`, which is not supported"))),
    };
    let elements = match (fortran, shape.as_slice()) {
        (true, &[rows, columns]) => match elements {
            Elements::F32(v) => Elements::F32(row_by_row(&v, rows, columns)),
            Elements::F64(v) => Elements::F64(row_by_row(&v, rows, columns)),
            Elements::I64(v) => Elements::I64(row_by_row(&v, rows, columns)),
        },
        _ => elements,
    };
    Ok(Array { shape, elements })
}

/// A matrix stored column by column, in C order.
fn row_by_row<T: Copy>(values: &[T], rows: usize, columns: usize) -> Vec<T> {
    (0..rows).flat_map(|row| (0..columns).map(move |column| values[column * rows + row])).collect()
}

fn decode<const N: usize, T>(
    data: &[u8],
    count: usize,
    read: impl Fn([u8; N]) -> T,
) -> Option<Vec<T>> {
    let (chunks, rest) = data.as_chunks::<N>();
    (rest.is_empty() && chunks.len() == count).then(|| chunks.iter().map(|&b| read(b)).collect())
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
        .collect::<Option<Vec<usize>>>()?;
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

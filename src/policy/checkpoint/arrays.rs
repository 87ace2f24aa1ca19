//! NumPy arrays and scalars inside a pickle: `_reconstruct(…)` with its state, `scalar(dtype, bytes)`, and
//! `_frombuffer(bytes, dtype, shape, order)` of pickle protocol 5.
//!
//! Knows little-endian `f4 f8 i1 i2 i4 i8 u1 u2 u4 b1`. Column-major arrays are turned into row-major ones. Arrays of
//! objects are refused.

use super::limits::Budget;
use super::records::{Id, Node, Records, printable};
use super::storages::{TensorError, each};
use crate::npz::{Array, Elements};

const RECONSTRUCT: &str = "numpy.core.multiarray._reconstruct";
const SCALAR: &str = "numpy.core.multiarray.scalar";
const FROM_BUFFER: &str = "numpy.core.numeric._frombuffer";

/// Reads the array `id`. `place` names it in messages.
pub(super) fn array(
    records: &Records<'_>,
    id: Id,
    place: &str,
    budget: &mut Budget,
) -> Result<Array, TensorError> {
    let malformed = || TensorError::from(records.unexpected(place, id, "a NumPy array"));
    let (shape, element_type, column_major, bytes) =
        if let Some(&[bytes, element_type, shape, order]) = records.arguments(id, FROM_BUFFER) {
            (shape, element_type, records.text(order) == Some("F"), bytes)
        } else if records.class(id) == Some(RECONSTRUCT) {
            let state = records.record(id).and_then(|record| record.state);
            match state.and_then(|state| records.elements(state)) {
                Some(&[_version, shape, element_type, column_major, bytes]) => {
                    let column_major = records.bool(column_major).ok_or_else(malformed)?;
                    (shape, element_type, column_major, bytes)
                }
                _ => return Err(malformed()),
            }
        } else {
            return Err(malformed());
        };
    let element = element_type_of(records, element_type)?;
    let shape = records
        .sizes(shape)
        .ok_or_else(|| records.unexpected(place, shape, "an array with a shape"))?;
    let bytes = records.bytes(bytes).ok_or_else(malformed)?;
    let array = decode(&element, shape, bytes, budget)?;
    if column_major { row_major(&array, budget) } else { Ok(array) }
}

/// Reads a number, however it was written: Python's own, a NumPy scalar, or an array without axes.
pub(super) fn number(records: &Records<'_>, id: Id, place: &str) -> Result<f64, TensorError> {
    let element = match *records.node(id) {
        Node::Int(value) => return Ok(value as f64),
        Node::Float(value) => return Ok(value),
        _ => match records.arguments(id, SCALAR) {
            Some(&[element_type, bytes]) => {
                records.bytes(bytes).map(|bytes| (element_type_of(records, element_type), bytes))
            }
            _ => None,
        },
    };
    // A scalar is eight bytes at most: it needs no account of its own.
    let mut small = Budget::new(&super::limits::Limits { memory: 64, ..Default::default() });
    let array = match element {
        Some((element, bytes)) => decode(&element?, Vec::new(), bytes, &mut small)?,
        None if records.class(id) == Some(RECONSTRUCT) => array(records, id, place, &mut small)?,
        None => return Err(records.unexpected(place, id, "a number").into()),
    };
    match array.to_f64()[..] {
        [value] if array.shape.is_empty() => Ok(value),
        _ => Err(TensorError::WrongShape { expected: "one number".into(), found: array.shape }),
    }
}

/// The type code of a `dtype` record, e.g. `f8`, once its byte order is known to be ours.
fn element_type_of(records: &Records<'_>, id: Id) -> Result<String, TensorError> {
    let malformed = || records.unexpected("element type", id, "a NumPy dtype");
    let code = match records.arguments(id, "numpy.dtype") {
        Some(&[code, ..]) => records.text(code).ok_or_else(malformed)?,
        _ => return Err(malformed().into()),
    };
    let state = records.record(id).and_then(|record| record.state);
    let order = state
        .and_then(|state| records.elements(state))
        .and_then(|state| records.text(*state.get(1)?))
        .ok_or_else(malformed)?;
    match (order, code.strip_prefix(['<', '|', '=']).unwrap_or(code)) {
        (">", _) => Err(TensorError::BigEndian),
        (_, code) if code.starts_with('>') => Err(TensorError::BigEndian),
        ("<" | "|" | "=", code) => Ok(code.to_owned()),
        _ => Err(malformed().into()),
    }
}

fn decode(
    element: &str,
    shape: Vec<usize>,
    bytes: &[u8],
    budget: &mut Budget,
) -> Result<Array, TensorError> {
    let size = match element {
        "f8" | "i8" => 8_usize,
        "f4" | "i4" | "u4" => 4,
        "i2" | "u2" => 2,
        "i1" | "u1" | "b1" => 1,
        other => return Err(TensorError::UnknownElementType { name: printable(other) }),
    };
    let expected = shape
        .iter()
        .try_fold(size, |product, &axis| product.checked_mul(axis))
        .ok_or_else(|| TensorError::ImpossibleShape { shape: shape.clone() })?;
    if expected != bytes.len() {
        let (expected, found) = (expected as u64, bytes.len() as u64);
        return Err(TensorError::WrongLength { expected, found });
    }
    budget.charge_memory((bytes.len() / size * 8) as u64)?;
    let elements = match element {
        "f8" => Elements::F64(each(bytes, f64::from_le_bytes)),
        "f4" => Elements::F32(each(bytes, f32::from_le_bytes)),
        "i8" => Elements::I64(each(bytes, i64::from_le_bytes)),
        "i4" => Elements::I64(each(bytes, |b| i64::from(i32::from_le_bytes(b)))),
        "u4" => Elements::I64(each(bytes, |b| i64::from(u32::from_le_bytes(b)))),
        "i2" => Elements::I64(each(bytes, |b| i64::from(i16::from_le_bytes(b)))),
        "u2" => Elements::I64(each(bytes, |b| i64::from(u16::from_le_bytes(b)))),
        "i1" => Elements::I64(each(bytes, |b| i64::from(i8::from_le_bytes(b)))),
        _ => Elements::I64(each(bytes, |b: [u8; 1]| i64::from(b[0]))),
    };
    Ok(Array { shape, elements })
}

fn pick<T: Copy>(values: &[T], order: &[usize]) -> Vec<T> {
    order.iter().map(|&index| values[index]).collect()
}

/// A column-major array in row-major order.
fn row_major(array: &Array, budget: &mut Budget) -> Result<Array, TensorError> {
    let count: usize = array.shape.iter().product();
    budget.charge_memory(16 * count as u64)?;
    let order: Vec<usize> = (0..count)
        .map(|flat| {
            let mut coordinates = Vec::with_capacity(array.shape.len());
            let mut rest = flat;
            for &axis in array.shape.iter().rev() {
                coordinates.push(rest % axis);
                rest /= axis;
            }
            // The last axis comes first in `coordinates`; the first axis varies fastest in the file.
            let axes = array.shape.iter().rev();
            coordinates.iter().zip(axes).fold(0, |index, (&along, &axis)| index * axis + along)
        })
        .collect();
    let elements = match &array.elements {
        Elements::F32(values) => Elements::F32(pick(values, &order)),
        Elements::F64(values) => Elements::F64(pick(values, &order)),
        Elements::I64(values) => Elements::I64(pick(values, &order)),
    };
    Ok(Array { shape: array.shape.clone(), elements })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::checkpoint::limits::Limits;

    #[test]
    fn a_column_major_array_is_turned_round() {
        // The 2 × 3 matrix 0 1 2 / 3 4 5, column by column.
        let stored = Array { shape: vec![2, 3], elements: Elements::I64(vec![0, 3, 1, 4, 2, 5]) };
        let turned = row_major(&stored, &mut Budget::new(&Limits::default())).unwrap();
        assert_eq!(turned.elements, Elements::I64(vec![0, 1, 2, 3, 4, 5]));
    }

    #[test]
    fn a_column_major_array_of_three_axes_is_turned_round() {
        // Element (i, j, k) of shape 2 × 2 × 2 holds 4i + 2j + k.
        let stored = vec![0, 4, 2, 6, 1, 5, 3, 7];
        let stored = Array { shape: vec![2, 2, 2], elements: Elements::I64(stored) };
        let turned = row_major(&stored, &mut Budget::new(&Limits::default())).unwrap();
        assert_eq!(turned.elements, Elements::I64((0..8).collect()));
    }
}

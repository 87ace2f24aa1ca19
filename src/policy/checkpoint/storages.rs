//! Storages and views: how torch lays a tensor out in memory and in its files.
//!
//! A tensor is a storage (a run of equal elements), an offset, a shape and a stride per axis, all counted in elements;
//! element `(i, j, …)` is `storage[offset + i·stride₀ + j·stride₁ + …]`. Everything becomes dense row-major `f32`.
//!
//! A view must lie inside its storage and may not have more elements than it, so a short file cannot unfold into a
//! long tensor. Weights that are not finite are refused: no network can be run with them.

use super::contents::Tensor;
use super::limits::{Budget, LimitExceeded};
use super::records::{Id, Node, RecordError, Records};

/// Why an array of numbers cannot be used. The message continues "tensor `name` …".
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum TensorError {
    #[error("is malformed: {0}")]
    Malformed(RecordError),
    #[error("has element type `{name}`, which is not supported")]
    UnknownElementType { name: String },
    #[error("is stored big-endian; only little-endian files are read")]
    BigEndian,
    #[error("has shape {shape:?}, which is impossible")]
    ImpossibleShape { shape: Vec<usize> },
    #[error("has shape {found:?}, expected {expected}")]
    WrongShape { expected: String, found: Vec<usize> },
    #[error("needs {expected} bytes, its storage has {found}")]
    WrongLength { expected: u64, found: u64 },
    #[error("reaches element {reached} of a storage of {count}")]
    OutsideStorage { reached: u64, count: u64 },
    #[error("has {elements} elements, more than the {count} of its storage")]
    Overlapping { elements: u64, count: u64 },
    #[error("holds {value} as element {index}")]
    NotFinite { value: f64, index: usize },
    #[error("occurs twice")]
    Duplicate,
    #[error(transparent)]
    Limit(#[from] LimitExceeded),
}

// Written out, because a derived conversion would make the record error a second cause beside the message.
impl From<RecordError> for TensorError {
    fn from(fault: RecordError) -> Self {
        Self::Malformed(fault)
    }
}

/// How a storage writes one number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Element {
    F64,
    F32,
    F16,
    Bf16,
    I64,
    I32,
    U8,
    Bool,
}

impl Element {
    fn of_storage(class: &str) -> Option<Self> {
        Some(match class {
            "torch.DoubleStorage" => Self::F64,
            "torch.FloatStorage" => Self::F32,
            "torch.HalfStorage" => Self::F16,
            "torch.BFloat16Storage" => Self::Bf16,
            "torch.LongStorage" => Self::I64,
            "torch.IntStorage" => Self::I32,
            "torch.ByteStorage" => Self::U8,
            "torch.BoolStorage" => Self::Bool,
            _ => return None,
        })
    }

    fn size(self) -> usize {
        match self {
            Self::F64 | Self::I64 => 8,
            Self::F32 | Self::I32 => 4,
            Self::F16 | Self::Bf16 => 2,
            Self::U8 | Self::Bool => 1,
        }
    }

    /// All whole elements of `bytes`, rounded to `f32`.
    fn decode(self, bytes: &[u8]) -> Vec<f32> {
        match self {
            Self::F64 => each(bytes, |b| f64::from_le_bytes(b) as f32),
            Self::F32 => each(bytes, f32::from_le_bytes),
            Self::F16 => each(bytes, |b| half_to_f32(u16::from_le_bytes(b))),
            Self::Bf16 => each(bytes, |b| f32::from_bits(u32::from(u16::from_le_bytes(b)) << 16)),
            Self::I64 => each(bytes, |b| i64::from_le_bytes(b) as f32),
            Self::I32 => each(bytes, |b| i32::from_le_bytes(b) as f32),
            Self::U8 => each(bytes, |b: [u8; 1]| f32::from(b[0])),
            Self::Bool => each(bytes, |b: [u8; 1]| f32::from(u8::from(b[0] != 0))),
        }
    }
}

/// Reads every `N` bytes as one number.
pub(super) fn each<const N: usize, T>(bytes: &[u8], read: impl Fn([u8; N]) -> T) -> Vec<T> {
    bytes.as_chunks::<N>().0.iter().map(|&chunk| read(chunk)).collect()
}

/// IEEE 754 half precision: 1 sign, 5 exponent, 10 fraction bits.
fn half_to_f32(bits: u16) -> f32 {
    let sign = if bits & 0x8000 == 0 { 1.0 } else { -1.0 };
    let exponent = i32::from((bits >> 10) & 0x1f);
    let fraction = f32::from(bits & 0x3ff);
    match exponent {
        0 => sign * fraction * 2.0_f32.powi(-24),
        31 if fraction == 0.0 => sign * f32::INFINITY,
        31 => f32::NAN,
        _ => sign * (1.0 + fraction / 1024.0) * 2.0_f32.powi(exponent - 15),
    }
}

/// A storage that a pickle refers to.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct StorageReference {
    pub(super) key: String,
    pub(super) element: Element,
    pub(super) count: usize,
}

impl StorageReference {
    /// Reads `("storage", class, key, location, count)`; old streams add a sixth entry, `None`.
    pub(super) fn parse(records: &Records<'_>, id: Id) -> Result<Self, TensorError> {
        let malformed = || records.unexpected("storage", id, "a reference to a torch storage");
        let Node::Storage(reference) = records.node(id) else { return Err(malformed().into()) };
        let (tag, class, key, count) = match records.elements(*reference) {
            Some(&[tag, class, key, _location, count]) => (tag, class, key, count),
            Some(&[tag, class, key, _location, count, view]) if records.is_none(view) => {
                (tag, class, key, count)
            }
            _ => return Err(malformed().into()),
        };
        if records.text(tag) != Some("storage") {
            return Err(malformed().into());
        }
        let class = records.global(class).ok_or_else(malformed)?;
        let element = Element::of_storage(class)
            .ok_or_else(|| TensorError::UnknownElementType { name: class.to_owned() })?;
        let key = records.text(key).filter(|key| is_plain(key)).ok_or_else(malformed)?.to_owned();
        let count = records
            .size(count)
            .ok_or_else(|| records.unexpected("storage size", count, "a size"))?;
        Ok(Self { key, element, count })
    }

    /// Checks that `bytes` are exactly this storage's elements.
    pub(super) fn check_length(&self, bytes: &[u8]) -> Result<(), TensorError> {
        let expected = (self.count as u64).saturating_mul(self.element.size() as u64);
        let found = bytes.len() as u64;
        if expected == found { Ok(()) } else { Err(TensorError::WrongLength { expected, found }) }
    }
}

/// Where a tensor lies in its storage.
#[derive(Debug, Clone, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct View {
    offset: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
    /// Product of the shape.
    elements: usize,
}

impl View {
    /// Reads offset, shape and strides and checks them against a storage of `count` elements.
    pub(super) fn parse(
        records: &Records<'_>,
        view: [Id; 3],
        count: usize,
    ) -> Result<Self, TensorError> {
        let [offset, shape, strides] = view;
        let sizes = |place, id| {
            records.sizes(id).ok_or_else(|| records.unexpected(place, id, "a tuple of sizes"))
        };
        let (shape, strides) = (sizes("shape", shape)?, sizes("stride", strides)?);
        let offset =
            records.size(offset).ok_or_else(|| records.unexpected("offset", offset, "a size"))?;
        let impossible = || TensorError::ImpossibleShape { shape: shape.clone() };
        if shape.len() != strides.len() {
            return Err(impossible());
        }
        let elements = shape
            .iter()
            .try_fold(1_usize, |product, &axis| product.checked_mul(axis))
            .ok_or_else(impossible)?;
        if elements > count {
            let (elements, count) = (elements as u64, count as u64);
            return Err(TensorError::Overlapping { elements, count });
        }
        let last = shape
            .iter()
            .zip(&strides)
            .try_fold(offset, |sum, (&axis, &stride)| {
                sum.checked_add(axis.saturating_sub(1).checked_mul(stride)?)
            })
            .ok_or_else(impossible)?;
        if elements > 0 && last >= count {
            let (reached, count) = (last as u64, count as u64);
            return Err(TensorError::OutsideStorage { reached, count });
        }
        Ok(Self { offset, shape, strides, elements })
    }

    /// Whether the elements lie one after the other in row-major order.
    fn is_dense(&self) -> bool {
        let mut expected = 1;
        self.shape.iter().zip(&self.strides).rev().all(|(&axis, &stride)| {
            let dense = axis <= 1 || stride == expected;
            expected *= axis.max(1);
            dense
        })
    }

    /// Memory of the tensor that this view becomes.
    pub(super) fn bytes(&self) -> u64 {
        self.elements as u64 * size_of::<f32>() as u64
    }

    /// Copies the view out of its storage. The caller has charged its memory.
    pub(super) fn gather(
        &self,
        bytes: &[u8],
        element: Element,
        budget: &mut Budget,
    ) -> Result<Tensor, TensorError> {
        let size = element.size();
        let data = if self.elements == 0 {
            Vec::new()
        } else if self.is_dense() {
            element.decode(&bytes[self.offset * size..(self.offset + self.elements) * size])
        } else {
            budget.charge_memory((bytes.len() / size * size_of::<f32>()) as u64)?;
            let storage = element.decode(bytes);
            self.indices().map(|index| storage[index]).collect()
        };
        if let Some(index) = data.iter().position(|value| !value.is_finite()) {
            return Err(TensorError::NotFinite { value: f64::from(data[index]), index });
        }
        Ok(Tensor { shape: self.shape.clone(), data })
    }

    /// Positions in the storage, in row-major order of the tensor.
    fn indices(&self) -> impl Iterator<Item = usize> {
        (0..self.elements).map(|flat| {
            let mut rest = flat;
            self.shape.iter().zip(&self.strides).rev().fold(
                self.offset,
                |index, (&axis, &stride)| {
                    let along = rest % axis;
                    rest /= axis;
                    index + along * stride
                },
            )
        })
    }
}

/// The storage, offset, shape and strides of a tensor record, unwrapped from its parameter.
pub(super) fn tensor_parts(records: &Records<'_>, id: Id) -> Result<(Id, [Id; 3]), RecordError> {
    let tensor = match records.arguments(id, "torch._utils._rebuild_parameter") {
        Some(&[tensor, ..]) => tensor,
        _ => id,
    };
    match records.arguments(tensor, "torch._utils._rebuild_tensor_v2") {
        Some(&[storage, offset, shape, strides, ..]) => Ok((storage, [offset, shape, strides])),
        _ => Err(records.unexpected("value", tensor, "a torch tensor")),
    }
}

/// Whether a name is one that module and storage names are made of, and harmless to print.
pub(super) fn is_plain(name: &str) -> bool {
    const LONGEST: usize = 300;
    let plain = |c: char| c.is_alphanumeric() || "._- ".contains(c);
    !name.is_empty() && name.len() <= LONGEST && name.chars().all(plain)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::checkpoint::limits::Limits;

    fn view(offset: usize, shape: &[usize], strides: &[usize]) -> View {
        let elements = shape.iter().product();
        View { offset, shape: shape.to_vec(), strides: strides.to_vec(), elements }
    }

    #[test]
    fn a_transposed_view_is_copied_in_row_major_order() {
        let storage: Vec<u8> = (0..6_u8).flat_map(|v| f32::from(v).to_le_bytes()).collect();
        let mut budget = Budget::new(&Limits::default());
        // The 2 × 3 matrix 0 1 2 / 3 4 5, seen as 3 × 2.
        let tensor = view(0, &[3, 2], &[1, 3]).gather(&storage, Element::F32, &mut budget).unwrap();
        assert_eq!(tensor.data, [0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
        assert!(view(0, &[2, 3], &[3, 1]).is_dense());
        assert!(view(0, &[2, 1, 3], &[3, 99, 1]).is_dense());
        assert!(!view(0, &[3, 2], &[1, 3]).is_dense());
    }

    #[test]
    fn halves_have_the_published_values() {
        // IEEE 754-2008, binary16: one, −2, largest, smallest subnormal, one third, infinity.
        let cases = [(0x3c00, 1.0), (0xc000, -2.0), (0x7bff, 65504.0), (0x0001, 5.960_464_5e-8)];
        for (bits, value) in cases {
            assert_eq!(half_to_f32(bits).to_bits(), f32::to_bits(value));
        }
        assert_eq!(half_to_f32(0x3555).to_bits(), 0.333_251_95_f32.to_bits());
        assert!(half_to_f32(0x7c00).is_infinite() && half_to_f32(0x7e00).is_nan());
    }

    #[test]
    fn a_weight_that_is_not_finite_is_named_by_its_position() {
        let storage: Vec<u8> = [1.0, f32::NAN].iter().flat_map(|v| v.to_le_bytes()).collect();
        let mut budget = Budget::new(&Limits::default());
        let refused = view(0, &[2], &[1]).gather(&storage, Element::F32, &mut budget);
        assert!(matches!(refused, Err(TensorError::NotFinite { index: 1, .. })));
    }
}

//! Torch's old stream format, in which `mjrl` policies embed each of their tensors: five pickles (a magic number, the
//! protocol, a description of the system, a reference to the storage, the list of storages), then the number of
//! elements and the elements (`spec/policy.md` §3.5).

use super::allowed::Kind;
use super::contents::Tensor;
use super::limits::Budget;
use super::pickle::{self, Pickle, PickleError};
use super::records::{Id, Node, Records};
use super::storages::{StorageReference, TensorError, View, tensor_parts};

/// Reads a tensor record whose storage is embedded as a stream of the old torch format.
pub(super) fn read_embedded_tensor(
    records: &Records<'_>,
    id: Id,
    budget: &mut Budget,
) -> Result<Tensor, EmbeddedTensorError> {
    let (storage, parts) = tensor_parts(records, id).map_err(TensorError::from)?;
    let stream = match records.arguments(storage, "torch.storage._load_from_bytes") {
        Some(&[stream]) => records.bytes(stream),
        _ => None,
    };
    let stream = stream.ok_or_else(|| {
        TensorError::from(records.unexpected("storage", storage, "an embedded torch storage"))
    })?;
    let (storage, bytes) = read_stream(stream, budget)?;
    let view = View::parse(records, parts, storage.count)?;
    budget.charge_memory(view.bytes()).map_err(TensorError::from)?;
    Ok(view.gather(bytes, storage.element, budget)?)
}

/// Why an embedded tensor cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum EmbeddedTensorError {
    #[error(transparent)]
    Tensor(#[from] TensorError),
    #[error("embeds a torch stream that {0}")]
    Pickle(PickleError),
}

impl From<PickleError> for EmbeddedTensorError {
    fn from(fault: PickleError) -> Self {
        Self::Pickle(fault)
    }
}

/// Splits a stream of the old format into the description of its one storage and that storage's bytes.
fn read_stream<'a>(
    stream: &'a [u8],
    budget: &mut Budget,
) -> Result<(StorageReference, &'a [u8]), EmbeddedTensorError> {
    // 0x1950a86a20f9469cfc6c, little-endian, as torch writes it.
    const MAGIC: [u8; 10] = [0x6c, 0xfc, 0x9c, 0x46, 0xf9, 0x20, 0x6a, 0xa8, 0x50, 0x19];
    const PROTOCOL: i64 = 1001;
    let mut rest = stream;
    let mut next = || -> Result<Pickle<'a>, EmbeddedTensorError> {
        let pickle = pickle::read_prefix(rest, Kind::TorchStream, budget)?;
        rest = &rest[pickle.length..];
        Ok(pickle)
    };
    let wrong = |pickle: &Pickle<'_>, place: &str, expected| {
        TensorError::from(pickle.records.unexpected(place, pickle.root, expected))
    };
    let magic = next()?;
    if !matches!(magic.records.node(magic.root), Node::WideInt(digits) if *digits == MAGIC) {
        return Err(wrong(&magic, "magic number", "that of a torch stream").into());
    }
    let protocol = next()?;
    if protocol.records.int(protocol.root) != Some(PROTOCOL) {
        return Err(wrong(&protocol, "protocol", "1001").into());
    }
    let system = next()?;
    let little = system.records.value(system.root, "little_endian");
    match little.and_then(|id| system.records.bool(id)) {
        Some(true) => {}
        Some(false) => return Err(TensorError::BigEndian.into()),
        None => return Err(wrong(&system, "system description", "one with a byte order").into()),
    }
    let object = next()?;
    let storage = StorageReference::parse(&object.records, object.root)?;
    let keys = next()?;
    let only_key = match keys.records.elements(keys.root) {
        Some(&[key]) => keys.records.text(key),
        _ => None,
    };
    if only_key != Some(storage.key.as_str()) {
        return Err(wrong(&keys, "list of storages", "the one storage it describes").into());
    }
    let (&count, bytes) = rest
        .split_first_chunk::<8>()
        .ok_or(TensorError::WrongLength { expected: 8, found: rest.len() as u64 })?;
    if u64::from_le_bytes(count) != storage.count as u64 {
        let (elements, count) = (u64::from_le_bytes(count), storage.count as u64);
        return Err(TensorError::Overlapping { elements, count }.into());
    }
    storage.check_length(bytes)?;
    Ok((storage, bytes))
}

//! Checkpoints as safetensors: what `convert` writes, and plain files of other programs.
//!
//! A safetensors file is a length, a JSON header that places every tensor, and raw numbers; there is nothing in it to
//! execute. Ours hold, besides the weights under their own names, the normaliser's arrays under
//! `observation_normaliser.`, and in the header, as the text `arnold_analyze`, a JSON document with everything else:
//! family, scalars, aliases, vocabulary, where it came from. A file without that document is taken for bare weights.

use std::borrow::Cow;
use std::collections::{BTreeMap, HashMap};

use safetensors::tensor::{Dtype, SafeTensors, TensorView, View};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::contents::{
    Checkpoint, ComponentStatistics, Format, Normaliser, Scalars, SignatureStatistics, Tensor,
    TensorMap,
};
use super::limits::Budget;
use super::records::printable;
use super::storages::{TensorError, is_plain};
use super::{CheckpointError, sb3, statistics};

/// Name of our document in the header.
const DOCUMENT: &str = "arnold_analyze";
/// What the names of the normaliser's arrays begin with.
const NORMALISER: &str = "observation_normaliser.";
/// Version of the document.
const SCHEMA: u32 = 1;
/// The format's own bound.
const LONGEST_HEADER: u64 = 100_000_000;
/// What a parsed header holds per byte of its text: a number of two bytes may become a value of thirty-two, in a list
/// that grows by doubling. A published policy has a header of 40 kB and a vocabulary of as much.
const MEMORY_PER_HEADER_BYTE: u64 = 64;

/// A checkpoint and what belongs to it, in one file.
#[derive(Debug, Clone)]
pub(in crate::policy) struct Package {
    pub(in crate::policy) checkpoint: Checkpoint,
    pub(in crate::policy) normaliser: Option<Normaliser>,
    /// `None`: it has none.
    pub(in crate::policy) vocabulary: Option<Vec<String>>,
    /// Which files it was made of.
    pub(in crate::policy) provenance: Value,
}

/// Everything but the numbers.
#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Document {
    schema: u32,
    family: Format,
    /// For people; the tensors' shapes count.
    sizes: Value,
    scalars: Scalars,
    aliases: BTreeMap<String, String>,
    vocabulary: Option<Vec<String>>,
    normaliser: Option<NormaliserDocument>,
    provenance: Value,
}

#[derive(Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct NormaliserDocument {
    statistics: Kind,
    epsilon: f64,
    clip: f64,
    enabled: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum Kind {
    PerComponent,
    PerSignature,
}

/// Whether a file is one of these: a length below the limit, then the brace of the header.
pub(super) fn recognise(bytes: &[u8]) -> bool {
    let Some((length, rest)) = bytes.split_first_chunk::<8>() else { return false };
    u64::from_le_bytes(*length) <= LONGEST_HEADER && rest.first() == Some(&b'{')
}

/// Reads a file, ours or bare weights.
pub(super) fn read(bytes: &[u8], budget: &mut Budget) -> Result<Package, CheckpointError> {
    let header = bytes.first_chunk::<8>().map_or(0, |length| u64::from_le_bytes(*length));
    let within = |fault| CheckpointError::Limit { part: "header".to_owned(), fault };
    budget.charge_memory(header.saturating_mul(MEMORY_PER_HEADER_BYTE)).map_err(within)?;
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(|e| broken(&e))?;
    let document = metadata.metadata().as_ref().and_then(|texts| texts.get(DOCUMENT)).cloned();
    let file = SafeTensors::deserialize(bytes).map_err(|e| broken(&e))?;
    let Some(document) = document else { return bare(&file, budget) };
    // These messages repeat names from the file.
    let document: Document = serde_json::from_str(&document).map_err(|error| {
        let said = printable(&error.to_string());
        CheckpointError::Safetensors {
            fault: format!("has a bad `{DOCUMENT}` in its header: {said}"),
        }
    })?;
    if document.schema != SCHEMA {
        let fault = format!("is of schema {}, this program reads {SCHEMA}", document.schema);
        return Err(CheckpointError::Safetensors { fault });
    }
    let normaliser = match &document.normaliser {
        Some(described) => Some(read_normaliser(&file, described, budget)?),
        None => None,
    };
    let mut tensors = weights(&file, budget)?;
    for (alias, original) in &document.aliases {
        let missing = || CheckpointError::Safetensors {
            fault: format!("lacks tensor `{original}`, which `{alias}` repeats"),
        };
        if !is_plain(alias) || tensors.contains_key(alias) {
            let fault = format!("names tensor `{}` twice", printable(alias));
            return Err(CheckpointError::Safetensors { fault });
        }
        let tensor = tensors.get(original).ok_or_else(missing)?;
        charge(tensor.data.len(), alias, budget)?;
        tensors.insert(alias.clone(), tensor.clone());
    }
    let Document { family: format, scalars, aliases, vocabulary, provenance, .. } = document;
    let checkpoint = Checkpoint { format, tensors, aliases, scalars, globals: Vec::new() };
    Ok(Package { checkpoint, normaliser, vocabulary, provenance })
}

/// Weights without a word about them: the names of the tensors must tell the family.
fn bare(file: &SafeTensors<'_>, budget: &mut Budget) -> Result<Package, CheckpointError> {
    let tensors = weights(file, budget)?;
    let natural_gradient = tensors.contains_key("in_shift") && tensors.contains_key("out_shift");
    let format = if natural_gradient { Format::NpgMlp } else { sb3::recognise_network(&tensors)? };
    let (aliases, scalars, globals) = (BTreeMap::new(), Scalars::default(), Vec::new());
    Ok(Package {
        checkpoint: Checkpoint { format, tensors, aliases, scalars, globals },
        normaliser: None,
        vocabulary: None,
        provenance: Value::Null,
    })
}

/// Every tensor that is not the normaliser's.
fn weights(file: &SafeTensors<'_>, budget: &mut Budget) -> Result<TensorMap, CheckpointError> {
    let mut names = file.names();
    names.sort_unstable();
    let mut tensors = TensorMap::new();
    for name in names.into_iter().filter(|name| !name.starts_with(NORMALISER)) {
        if !is_plain(name) {
            let fault = format!("has a tensor called `{}`", printable(name));
            return Err(CheckpointError::Safetensors { fault });
        }
        let tensor = file.tensor(name).map_err(|e| broken(&e))?;
        let shape = tensor.shape().to_vec();
        let data = singles(name, &tensor, budget)?;
        if let Some(index) = data.iter().position(|value| !value.is_finite()) {
            let fault = TensorError::NotFinite { value: f64::from(data[index]), index };
            return Err(CheckpointError::Tensor { tensor: name.to_owned(), fault });
        }
        tensors.insert(name.to_owned(), Tensor { shape, data });
    }
    Ok(tensors)
}

fn read_normaliser(
    file: &SafeTensors<'_>,
    described: &NormaliserDocument,
    budget: &mut Budget,
) -> Result<Normaliser, CheckpointError> {
    let &NormaliserDocument { statistics: kind, epsilon, clip, enabled } = described;
    let array = |name: &str| file.tensor(&format!("{NORMALISER}{name}")).map_err(|e| broken(&e));
    if kind == Kind::PerComponent {
        let mean = doubles("mean", &array("mean")?, budget)?;
        let variance = doubles("variance", &array("variance")?, budget)?;
        let read = ComponentStatistics { mean, variance, epsilon, clip, enabled };
        return statistics::checked(Normaliser::PerComponent(read));
    }
    let mean = array("mean")?;
    let lags = mean.shape().get(1).copied().unwrap_or(0);
    let signatures = array("signatures")?;
    let words = signatures.shape().get(1).copied().unwrap_or(0).max(1);
    if signatures.dtype() != Dtype::U16 {
        return Err(wrong_type("signatures", signatures.dtype()));
    }
    charge(signatures.data().len(), "signatures", budget)?;
    let ids: Vec<u16> =
        signatures.data().as_chunks::<2>().0.iter().map(|&b| u16::from_le_bytes(b)).collect();
    let signature = |row: &[u16]| {
        let ids: Vec<u16> = row.iter().copied().filter(|&id| id != 0).collect();
        if ids.is_empty() { vec![0] } else { ids }
    };
    statistics::checked(Normaliser::PerSignature(SignatureStatistics {
        signatures: ids.chunks(words).map(signature).collect(),
        mean: singles("mean", &mean, budget)?,
        variance: singles("variance", &array("variance")?, budget)?,
        count: doubles("count", &array("count")?, budget)?,
        lags,
        epsilon,
        clip,
        enabled,
    }))
}

/// The bytes of a file, and the document in its header.
pub(in crate::policy) fn write(
    package: &Package,
    sizes: Value,
) -> Result<(Vec<u8>, Value), CheckpointError> {
    let checkpoint = &package.checkpoint;
    let mut arrays: BTreeMap<String, RawArray> = BTreeMap::new();
    for (name, tensor) in &checkpoint.tensors {
        if !checkpoint.aliases.contains_key(name) {
            arrays.insert(name.clone(), RawArray::singles(&tensor.shape, &tensor.data));
        }
    }
    let described = package.normaliser.as_ref().map(|normaliser| {
        let mut add = |name: &str, array| arrays.insert(format!("{NORMALISER}{name}"), array);
        match normaliser {
            Normaliser::PerComponent(read) => {
                add("mean", RawArray::doubles(&read.mean));
                add("variance", RawArray::doubles(&read.variance));
                let ComponentStatistics { epsilon, clip, enabled, .. } = *read;
                NormaliserDocument { statistics: Kind::PerComponent, epsilon, clip, enabled }
            }
            Normaliser::PerSignature(read) => {
                let shape = [read.signatures.len(), read.lags];
                add("mean", RawArray::singles(&shape, &read.mean));
                add("variance", RawArray::singles(&shape, &read.variance));
                add("count", RawArray::doubles(&read.count));
                add("signatures", RawArray::signatures(&read.signatures));
                let SignatureStatistics { epsilon, clip, enabled, .. } = *read;
                NormaliserDocument { statistics: Kind::PerSignature, epsilon, clip, enabled }
            }
        }
    });
    let document = Document {
        schema: SCHEMA,
        family: checkpoint.format,
        sizes,
        scalars: checkpoint.scalars.clone(),
        aliases: checkpoint.aliases.clone(),
        vocabulary: package.vocabulary.clone(),
        normaliser: described,
        provenance: package.provenance.clone(),
    };
    let failed = |fault| CheckpointError::Settings { part: DOCUMENT.to_owned(), fault };
    let document = serde_json::to_value(&document).map_err(failed)?;
    let texts = HashMap::from([(DOCUMENT.to_owned(), document.to_string())]);
    let bytes = safetensors::tensor::serialize(arrays, Some(texts)).map_err(|e| broken(&e))?;
    Ok((bytes, document))
}

/// An array as the file holds it.
struct RawArray {
    dtype: Dtype,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl RawArray {
    fn singles(shape: &[usize], numbers: &[f32]) -> Self {
        let bytes = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        Self { dtype: Dtype::F32, shape: shape.to_vec(), bytes }
    }

    fn doubles(numbers: &[f64]) -> Self {
        let bytes = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        Self { dtype: Dtype::F64, shape: vec![numbers.len()], bytes }
    }

    /// One row each, filled with zeros on the right.
    fn signatures(signatures: &[Vec<u16>]) -> Self {
        let width = signatures.iter().map(Vec::len).max().unwrap_or(0);
        let padded = |ids: &Vec<u16>| {
            ids.iter().copied().chain(std::iter::repeat(0)).take(width).collect::<Vec<_>>()
        };
        let ids = signatures.iter().flat_map(padded);
        let bytes = ids.flat_map(u16::to_le_bytes).collect();
        Self { dtype: Dtype::U16, shape: vec![signatures.len(), width], bytes }
    }
}

impl View for RawArray {
    fn dtype(&self) -> Dtype {
        self.dtype
    }

    fn shape(&self) -> &[usize] {
        &self.shape
    }

    fn data(&self) -> Cow<'_, [u8]> {
        Cow::Borrowed(&self.bytes)
    }

    fn data_len(&self) -> usize {
        self.bytes.len()
    }
}

fn singles(
    name: &str,
    tensor: &TensorView<'_>,
    budget: &mut Budget,
) -> Result<Vec<f32>, CheckpointError> {
    charge(tensor.data().len() / 4, name, budget)?;
    match tensor.dtype() {
        Dtype::F32 => {
            let numbers = tensor.data().as_chunks::<4>().0.iter();
            Ok(numbers.map(|&bytes| f32::from_le_bytes(bytes)).collect())
        }
        other => Err(wrong_type(name, other)),
    }
}

fn doubles(
    name: &str,
    tensor: &TensorView<'_>,
    budget: &mut Budget,
) -> Result<Vec<f64>, CheckpointError> {
    charge(tensor.data().len() / 4, name, budget)?;
    match tensor.dtype() {
        Dtype::F64 => {
            Ok(tensor.data().as_chunks::<8>().0.iter().map(|&b| f64::from_le_bytes(b)).collect())
        }
        other => Err(wrong_type(name, other)),
    }
}

/// Takes the memory of `count` single-precision numbers from the account.
fn charge(count: usize, part: &str, budget: &mut Budget) -> Result<(), CheckpointError> {
    budget
        .charge_memory((count as u64).saturating_mul(4))
        .map_err(|fault| CheckpointError::Limit { part: part.to_owned(), fault })
}

fn wrong_type(name: &str, dtype: Dtype) -> CheckpointError {
    let fault = format!("has numbers of type {dtype:?} in `{name}`, which is not supported there");
    CheckpointError::Safetensors { fault }
}

fn broken(error: &safetensors::SafeTensorError) -> CheckpointError {
    CheckpointError::Safetensors { fault: format!("is damaged: {}", printable(&error.to_string())) }
}

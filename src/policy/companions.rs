//! The small files beside a checkpoint that say what it does not say itself.
//!
//! | file | what is taken from it |
//! |---|---|
//! | `sb3_data.json` | the settings of an archive, where `policy.pth` lies alone |
//! | `model_config.json` | the same, of the training run |
//! | `args.json` | `csi_subspace`: rows of the control subspace |
//!
//! All of it decides what the policy does, so the hash that stands for the policy covers the files that were used.
//!
//! What the checkpoint says goes before what they say. Where nothing says the size of a control subspace, all of it is
//! used, and that is told.

use std::path::Path;

use super::PolicyError;
use super::checkpoint::contents::{Activation, Checkpoint, Format};
use super::checkpoint::{Limits, in_file, read_settings};
use crate::files::read_bounded;

/// Far above any published one.
const LARGEST: u64 = 16 << 20;

/// Adds to `checkpoint`, read from `path`, what the files beside it say, and to its `hash` theirs. Returns what had to be
/// assumed.
pub(super) fn complete(
    checkpoint: &mut Checkpoint,
    path: &Path,
    hash: &mut String,
    limits: &Limits,
) -> Result<Vec<String>, PolicyError> {
    if !matches!(checkpoint.format, Format::PpoMlp | Format::SacMlp | Format::RecurrentPpo) {
        return Ok(Vec::new());
    }
    for name in ["sb3_data.json", "model_config.json"] {
        let beside = path.with_file_name(name);
        if beside.is_file() {
            let bytes = read(&beside, hash, limits)?;
            let said = read_settings(&bytes, name, limits).map_err(in_file(&beside))?;
            let scalars = &mut checkpoint.scalars;
            scalars.activation = scalars.activation.or(said.activation);
            scalars.training_steps = scalars.training_steps.or(said.training_steps);
            // An archive's own settings may be those of a class that was made elsewhere; the run's name the lattice.
            let more =
                said.exploration.filter(|said| said.lattice || scalars.exploration.is_none());
            scalars.exploration = more.or(scalars.exploration.take());
        }
    }
    if !checkpoint.tensors.contains_key("projection") {
        return Ok(Vec::new());
    }
    complete_subspace(checkpoint, path, hash, limits)
}

/// The content of a file, bounded, and mixed into `hash`.
fn read(path: &Path, hash: &mut String, limits: &Limits) -> Result<Vec<u8>, PolicyError> {
    let bytes = read_bounded(path, LARGEST.min(limits.file_bytes))?;
    let mut hasher = blake3::Hasher::new();
    hasher.update(hash.as_bytes());
    hasher.update(blake3::hash(&bytes).as_bytes());
    *hash = hasher.finalize().to_hex().to_string();
    Ok(bytes)
}

/// A policy with a control subspace: its size, and the activation function of the published ones.
fn complete_subspace(
    checkpoint: &mut Checkpoint,
    path: &Path,
    hash: &mut String,
    limits: &Limits,
) -> Result<Vec<String>, PolicyError> {
    let mut assumed = Vec::new();
    let beside = path.with_file_name("args.json");
    if beside.is_file() {
        let bytes = read(&beside, hash, limits)?;
        checkpoint.scalars.subspace_size =
            subspace_size(&bytes).map_err(|what| PolicyError::InFile {
                source: Box::new(PolicyError::Unsupported { what }),
                path: beside,
            })?;
    }
    if checkpoint.scalars.subspace_size.is_none() {
        let text = "no file says how many rows of its control subspace the policy was trained with \
                    (`csi_subspace` in `args.json`); all of them are used";
        assumed.push(text.to_owned());
    }
    if checkpoint.scalars.activation.is_none() {
        checkpoint.scalars.activation = Some(Activation::Relu);
        let text = "no file says the activation function; it is assumed to be that of the published \
                    policies with a control subspace, ReLU";
        assumed.push(text.to_owned());
    }
    Ok(assumed)
}

/// `csi_subspace`, if the arguments have it.
fn subspace_size(arguments: &[u8]) -> Result<Option<usize>, String> {
    let arguments: serde_json::Value = serde_json::from_slice(arguments)
        .map_err(|error| format!("arguments that are no valid JSON: {error}"))?;
    match &arguments["csi_subspace"] {
        serde_json::Value::Null => Ok(None),
        value => match value.as_u64().and_then(|size| usize::try_from(size).ok()) {
            Some(size) if size > 0 => Ok(Some(size)),
            _ => Err(format!("`csi_subspace` of {value}")),
        },
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_size_of_a_subspace_is_a_positive_number_or_not_there() {
        assert_eq!(subspace_size(br#"{"seed": 0}"#), Ok(None));
        assert_eq!(subspace_size(br#"{"csi_subspace": 12}"#), Ok(Some(12)));
        for wrong in [&br#"{"csi_subspace": 0}"#[..], br#"{"csi_subspace": "12"}"#, b"{"] {
            assert!(subspace_size(wrong).is_err());
        }
    }
}

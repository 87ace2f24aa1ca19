//! A policy in one open file: `<name>.safetensors` with weights, normaliser, vocabulary and where they came from, and
//! `<name>.json` beside it with everything that is not a number, for people and other programs.
//!
//! What was read is written as it was read, not as it is played: nothing is translated, so the file loads as the
//! original does, bit for bit. That is checked before this returns.

use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use super::PolicyError;
use super::checkpoint::contents::{Checkpoint, Format, Normaliser};
use super::checkpoint::{self, Limits, Package};
use super::loading::{self, Parts, in_file};
use super::transformer_files::is_transformer;
use super::vocabulary::Vocabulary;
use crate::files;

/// What was written.
#[derive(Debug, Clone)]
pub struct Exported {
    /// The file that can be played.
    pub policy: PathBuf,
    /// Its description for people.
    pub description: PathBuf,
    /// What the description says.
    pub document: Value,
}

/// Writes the policy in the file `path`, with `normaliser` or the one beside it, to the folder `out`. Refuses what
/// could not be played, and never overwrites another file.
pub fn export(path: &Path, normaliser: Option<&Path>, out: &Path) -> Result<Exported, PolicyError> {
    let original = loading::open(path, normaliser)?;
    let Parts { checkpoint, normaliser, vocabulary, .. } = loading::read_parts(path, normaliser)?;
    if checkpoint.format == Format::EnsembleClassifier {
        let what = "an ensemble, which is many files, as one file".to_owned();
        return Err(in_file(path)(PolicyError::Unsupported { what }));
    }
    let sizes: Map<String, Value> = checkpoint::network_sizes(&checkpoint)
        .into_iter()
        .map(|(name, sizes)| (name.to_owned(), json!(sizes)))
        .collect();
    let name = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let file = files::read_bounded(path, Limits::default().file_bytes)?;
    let hash = blake3::hash(&file).to_hex().to_string();
    let provenance = json!({
        "program": concat!("arnold-analyze ", env!("CARGO_PKG_VERSION")),
        "checkpoint": {"file": name(path), "blake3": hash},
        "normaliser": original.normaliser_path.as_deref().map(|path| {
            json!({"file": name(path), "blake3": original.normaliser_hash})
        }),
    });
    let vocabulary = is_transformer(checkpoint.format)
        .then(|| vocabulary.unwrap_or_else(Vocabulary::standard).words().to_vec());
    let package = Package { checkpoint, normaliser, vocabulary, provenance };
    let (bytes, document) = checkpoint::write_package(&package, Value::Object(sizes))?;
    let policy = out.join(format!("{}.safetensors", original.name));
    let description = out.join(format!("{}.json", original.name));
    let mut text = serde_json::to_vec_pretty(&document).unwrap_or_default();
    text.push(b'\n');
    write_once(&policy, &bytes)?;
    write_once(&description, &text)?;
    check(&policy, &package)?;
    Ok(Exported { policy, description, document })
}

/// Writes a policy that was trained here, with its normaliser, to the file `path`, which [`super::open`] reads. `provenance`
/// says how it was trained.
pub fn write_trained(
    path: &Path,
    checkpoint: &Checkpoint,
    normaliser: &Normaliser,
    provenance: Value,
) -> Result<(), PolicyError> {
    let sizes: Map<String, Value> = checkpoint::network_sizes(checkpoint)
        .into_iter()
        .map(|(name, sizes)| (name.to_owned(), json!(sizes)))
        .collect();
    let vocabulary =
        is_transformer(checkpoint.format).then(|| Vocabulary::standard().words().to_vec());
    let (checkpoint, normaliser) = (checkpoint.clone(), Some(normaliser.clone()));
    let package = Package { checkpoint, normaliser, vocabulary, provenance };
    let (bytes, _document) = checkpoint::write_package(&package, Value::Object(sizes))?;
    Ok(files::write_atomic(path, &bytes)?)
}

/// Writes a file that may exist already only if it is the same.
fn write_once(path: &Path, bytes: &[u8]) -> Result<(), PolicyError> {
    if path.exists() {
        return match files::read_bounded(path, bytes.len() as u64) {
            Ok(existing) if existing == bytes => Ok(()),
            _ => Err(PolicyError::Exists { path: path.to_path_buf() }),
        };
    }
    Ok(files::write_atomic(path, bytes)?)
}

/// Reads the file again and compares every number.
fn check(path: &Path, written: &Package) -> Result<(), PolicyError> {
    let limits = Limits::default();
    let bytes = files::read_bounded(path, limits.file_bytes)?;
    let read = checkpoint::read_package(&bytes, &limits).map_err(checkpoint::in_file(path))?;
    let same = read.is_some_and(|read| {
        read.checkpoint.tensors == written.checkpoint.tensors
            && read.checkpoint.aliases == written.checkpoint.aliases
            && read.checkpoint.scalars == written.checkpoint.scalars
            && read.checkpoint.format == written.checkpoint.format
            && read.normaliser == written.normaliser
            && read.vocabulary == written.vocabulary
    });
    if same { Ok(()) } else { Err(in_file(path)(PolicyError::NotTheSame)) }
}

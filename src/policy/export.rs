//! A policy in one open file: `<name>.safetensors` with weights, normaliser, vocabulary and where they came from, and
//! `<name>.json` beside it with everything that is not a number, for people and other programs.
//!
//! What was read is written as it was read, not as it is played: nothing is translated, so the file loads as the
//! original does, bit for bit. That is checked before this returns.

use std::path::{Path, PathBuf};

use serde_json::{Value, json};

use super::PolicyError;
use super::average::Mean;
use super::checkpoint::contents::{Checkpoint, Format, Normaliser};
use super::checkpoint::{self, Limits, Package};
use super::loading::{self, Parts, in_file};
use super::transformer_files::is_transformer;
use super::vocabulary::Vocabulary;
use crate::files;

const PROGRAM: &str = concat!("arnold-analyze ", env!("CARGO_PKG_VERSION"));

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
    let name = loading::open(path, normaliser)?.name;
    let parts = loading::read_parts(path, normaliser)?;
    let provenance = json!({
        "program": PROGRAM,
        "checkpoint": source(path)?,
        "normaliser": parts.normaliser_path.as_deref().map(|path| {
            json!({"file": file_name(path), "blake3": parts.normaliser_hash})
        }),
    });
    write(path, parts, provenance, &name, out)
}

/// Writes the policy whose weights are the means of those in the files `paths`, checkpoints of one network at several moments
/// of its training, to the folder `out`, as [`export`] does. All else, the normaliser too, is the last one's.
///
/// Near the end of training weights go round a good place, and their mean lies nearer to its middle (stochastic weight averaging:
/// Izmailov et al. 2018, "Averaging weights leads to wider optima and better generalization").
pub fn export_mean(
    paths: &[impl AsRef<Path>],
    normaliser: Option<&Path>,
    out: &Path,
) -> Result<Exported, PolicyError> {
    let nothing = || PolicyError::Unsupported { what: "the mean of no policies".to_owned() };
    let (last, earlier) = paths.split_last().ok_or_else(nothing)?;
    let last = last.as_ref();
    let name = loading::open(last, normaliser)?.name;
    let mut parts = loading::read_parts(last, normaliser)?;
    let mut sources = Vec::new();
    let mut mean = Mean::new(&parts.checkpoint);
    for path in earlier.iter().map(AsRef::as_ref) {
        let other = loading::read_parts(path, normaliser)?;
        mean.add(&other.checkpoint).map_err(|found| {
            let last = last.to_path_buf();
            in_file(path)(PolicyError::AnotherNetwork { found, other: last })
        })?;
        sources.push(source(path)?);
    }
    mean.write(&mut parts.checkpoint);
    sources.push(source(last)?);
    let provenance = json!({"program": PROGRAM, "mean_of": sources});
    write(last, parts, provenance, &format!("{name}-mean"), out)
}

/// Writes what was read of `path` to `<name>.safetensors` and `<name>.json` in `out`.
fn write(
    path: &Path,
    parts: Parts,
    provenance: Value,
    name: &str,
    out: &Path,
) -> Result<Exported, PolicyError> {
    let Parts { checkpoint, normaliser, vocabulary, .. } = parts;
    if checkpoint.format == Format::EnsembleClassifier {
        let what = "an ensemble, which is many files, as one file".to_owned();
        return Err(in_file(path)(PolicyError::Unsupported { what }));
    }
    let sizes = sizes(&checkpoint);
    let vocabulary = is_transformer(checkpoint.format)
        .then(|| vocabulary.unwrap_or_else(Vocabulary::standard).words().to_vec());
    let package = Package { checkpoint, normaliser, vocabulary, provenance };
    let (bytes, document) = checkpoint::write_package(&package, sizes)?;
    let policy = out.join(format!("{name}.safetensors"));
    let description = out.join(format!("{name}.json"));
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
    let sizes = sizes(checkpoint);
    let vocabulary =
        is_transformer(checkpoint.format).then(|| Vocabulary::standard().words().to_vec());
    let (checkpoint, normaliser) = (checkpoint.clone(), Some(normaliser.clone()));
    let package = Package { checkpoint, normaliser, vocabulary, provenance };
    let (bytes, _document) = checkpoint::write_package(&package, sizes)?;
    Ok(files::write_atomic(path, &bytes)?)
}

/// The network's sizes, by name.
fn sizes(checkpoint: &Checkpoint) -> Value {
    let sizes = checkpoint::network_sizes(checkpoint).into_iter();
    Value::Object(sizes.map(|(name, sizes)| (name.to_owned(), json!(sizes))).collect())
}

/// Name and hash of a file.
fn source(path: &Path) -> Result<Value, PolicyError> {
    let file = files::read_bounded(path, Limits::default().file_bytes)?;
    Ok(json!({"file": file_name(path), "blake3": blake3::hash(&file).to_hex().to_string()}))
}

fn file_name(path: &Path) -> Option<String> {
    path.file_name().map(|name| name.to_string_lossy().into_owned())
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

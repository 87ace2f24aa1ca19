//! The folder of an ensemble with a classifier (`spec/policy.md` §4.6). It is opened by its classifier:
//!
//! ```text
//! ensemble/
//!   classifier.pt     the file to name
//!   scaler.pkl        scikit-learn's `StandardScaler` of its features
//!   base/             recurrent policies, each `.zip` with its normaliser beside it
//!   hold/
//! ```

use std::path::{Path, PathBuf};

use super::checkpoint::contents::{Checkpoint, Format};
use super::checkpoint::{
    Limits, in_file, normaliser_beside, read_checkpoint, read_normaliser, read_scaler,
};
use super::loading::load_recurrent;
use super::policies::ensemble::{Classifier, EnsemblePolicy};
use super::policies::recurrent::RecurrentPolicy;
use super::{PolicyError, companions};
use crate::files::read_bounded;

/// Networks in one group; the published ensembles have six and five.
const MOST_NETWORKS: usize = 64;

/// Reads what lies beside `classifier`, which is the file `path`. Also returns the BLAKE3 of all of it, given the
/// classifier's own.
pub(super) fn open(
    classifier: &Checkpoint,
    path: &Path,
    classifier_hash: &str,
    limits: &Limits,
) -> Result<(EnsemblePolicy, String), PolicyError> {
    let mut reader = Reader { hasher: blake3::Hasher::new(), limits };
    reader.hasher.update(classifier_hash.as_bytes());
    let scaler_path = path.with_file_name("scaler.pkl");
    let scaler = read_scaler(&reader.read(&scaler_path)?, limits).map_err(in_file(&scaler_path))?;
    let classifier = Classifier::new(&classifier.tensors, scaler)?;
    let mut group = |name: &str| -> Result<Vec<RecurrentPolicy>, PolicyError> {
        let archives = archives_in(&path.with_file_name(name))?;
        archives.iter().map(|path| reader.network(path)).collect()
    };
    let (base, hold) = (group("base")?, group("hold")?);
    let policy = EnsemblePolicy::new(base, hold, classifier)?;
    Ok((policy, reader.hasher.finalize().to_hex().to_string()))
}

/// Reads files and remembers what it read.
struct Reader<'a> {
    hasher: blake3::Hasher,
    limits: &'a Limits,
}

impl Reader<'_> {
    fn read(&mut self, path: &Path) -> Result<Vec<u8>, PolicyError> {
        let bytes = read_bounded(path, self.limits.file_bytes)?;
        self.hasher.update(blake3::hash(&bytes).as_bytes());
        Ok(bytes)
    }

    /// One network with its normaliser.
    fn network(&mut self, path: &Path) -> Result<RecurrentPolicy, PolicyError> {
        let in_policy =
            |source| PolicyError::InFile { source: Box::new(source), path: path.to_path_buf() };
        let limits = self.limits;
        let mut checkpoint = read_checkpoint(&self.read(path)?, limits).map_err(in_file(path))?;
        if checkpoint.format != Format::RecurrentPpo {
            let what = "ensemble of other than recurrent policies".to_owned();
            return Err(in_policy(PolicyError::Unsupported { what }));
        }
        let mut settings_hash = String::new();
        companions::complete(&mut checkpoint, path, &mut settings_hash, limits)?;
        self.hasher.update(settings_hash.as_bytes());
        let normaliser_path = normaliser_beside(path).into_iter().next().ok_or_else(|| {
            in_policy(PolicyError::MissingNormaliser { format: checkpoint.format.word() })
        })?;
        let normaliser = read_normaliser(&self.read(&normaliser_path)?, limits)
            .map_err(in_file(&normaliser_path))?;
        load_recurrent(&checkpoint, Some(&normaliser)).map_err(in_policy)
    }
}

/// The archives in `folder`, sorted by name.
fn archives_in(folder: &Path) -> Result<Vec<PathBuf>, PolicyError> {
    let incomplete = |what: String| PolicyError::InFile {
        source: Box::new(PolicyError::Unsupported { what }),
        path: folder.to_path_buf(),
    };
    let entries = std::fs::read_dir(folder).map_err(|error| {
        incomplete(format!("ensemble without this folder of networks ({error})"))
    })?;
    let mut paths: Vec<PathBuf> = entries
        .filter_map(|entry| Some(entry.ok()?.path()))
        .filter(|path| path.extension().is_some_and(|extension| extension == "zip"))
        .take(MOST_NETWORKS + 1)
        .collect();
    paths.sort();
    match paths.len() {
        0 => Err(incomplete("ensemble without a network in this folder".to_owned())),
        1..=MOST_NETWORKS => Ok(paths),
        _ => Err(incomplete(format!("ensemble of more than {MOST_NETWORKS} networks"))),
    }
}

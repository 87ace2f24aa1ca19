//! Observation normalisers pickled beside a checkpoint: Stable-Baselines3's `VecNormalize` (`spec/policy.md` §3.7) and
//! Arnold's `FlexibleMultiVecNormalize` (§3.6).
//!
//! Only the observation statistics are read. Statistics that no training could have produced (not finite, a negative
//! variance, two rows for one signature) are refused.

use super::allowed::Kind;
use super::arrays;
use super::contents::{ComponentStatistics, Normaliser, SignatureStatistics};
use super::limits::Budget;
use super::pickle::{self, Pickle};
use super::records::{Id, Node, RecordError, Records};
use super::storages::TensorError;
use super::{CheckpointError, in_pickle, statistics};
use crate::npz::Array;

const PART: &str = "normaliser";
const BY_SIGNATURE: &str = "envs.multi_env.FlexibleMultiVecNormalize";
const BY_COMPONENT: [&str; 2] = [
    "stable_baselines3.common.vec_env.vec_normalize.VecNormalize",
    "envs.multi_env.MyVecNormalize",
];

/// Whether an object of `class` is a normaliser.
pub(super) fn recognise(class: &str) -> bool {
    class == BY_SIGNATURE || BY_COMPONENT.contains(&class)
}

/// Reads a normaliser of the given class, and the globals its pickle names.
pub(super) fn read(
    bytes: &[u8],
    class: &str,
    budget: &mut Budget,
) -> Result<(Normaliser, Vec<String>), CheckpointError> {
    let by_signature = class == BY_SIGNATURE;
    let kind = if by_signature { Kind::SignatureNormaliser } else { Kind::ComponentNormaliser };
    let pickle = pickle::read(bytes, kind, budget).map_err(in_pickle(PART))?;
    if pickle.records.class(pickle.root) != Some(class) {
        let fault = pickle.records.unexpected(PART, pickle.root, "the object it names first");
        return Err(CheckpointError::Record { part: PART.to_owned(), fault });
    }
    let mut globals = pickle.records.globals().to_vec();
    globals.sort();
    let mut reader = Reader { pickle, budget };
    let normaliser = if by_signature {
        Normaliser::PerSignature(reader.by_signature()?)
    } else {
        Normaliser::PerComponent(reader.by_component()?)
    };
    Ok((statistics::checked(normaliser)?, globals))
}

struct Reader<'a, 'b> {
    pickle: Pickle<'a>,
    budget: &'b mut Budget,
}

impl Reader<'_, '_> {
    fn by_component(&mut self) -> Result<ComponentStatistics, CheckpointError> {
        let (enabled, epsilon, clip) = self.settings()?;
        let empty = Vec::new();
        let mut statistics =
            ComponentStatistics { mean: empty.clone(), variance: empty, epsilon, clip, enabled };
        // A normaliser that does not touch observations may come without their statistics.
        if !enabled && self.pickle.records.attribute(self.pickle.root, "obs_rms").is_none() {
            return Ok(statistics);
        }
        let moments = self.require(self.pickle.root, "obs_rms")?;
        let mean = self.array(moments, "mean")?;
        let variance = self.array(moments, "var")?;
        let &[components] = mean.shape.as_slice() else {
            return Err(wrong_shape("mean", "one axis", &mean));
        };
        if variance.shape != [components] {
            return Err(wrong_shape("var", &format!("[{components}]"), &variance));
        }
        statistics.mean = mean.to_f64();
        statistics.variance = variance.to_f64();
        Ok(statistics)
    }

    fn by_signature(&mut self) -> Result<SignatureStatistics, CheckpointError> {
        let (enabled, epsilon, clip) = self.settings()?;
        if !enabled && self.pickle.records.attribute(self.pickle.root, "obs_rms").is_none() {
            let (signatures, lags) = (Vec::new(), 0);
            let (mean, variance, count) = (Vec::new(), Vec::new(), Vec::new());
            let empty = SignatureStatistics {
                signatures,
                mean,
                variance,
                count,
                lags,
                epsilon,
                clip,
                enabled,
            };
            return Ok(empty);
        }
        let moments = self.require(self.pickle.root, "obs_rms")?;
        let mean = self.array(moments, "mean_mat")?;
        let variance = self.array(moments, "var_mat")?;
        let count = self.array(moments, "count_mat")?;
        let &[rows, lags] = mean.shape.as_slice() else {
            return Err(wrong_shape("mean_mat", "two axes", &mean));
        };
        if variance.shape != [rows, lags] {
            return Err(wrong_shape("var_mat", &format!("[{rows}, {lags}]"), &variance));
        }
        if count.shape != [rows] {
            return Err(wrong_shape("count_mat", &format!("[{rows}]"), &count));
        }
        let table = self.require(moments, "sig_ids_dict")?;
        let signatures = self.signatures(table, rows)?;
        Ok(SignatureStatistics {
            signatures,
            // A number that is finite in eight bytes may not be in the four that are used.
            mean: mean.to_f32(),
            variance: variance.to_f32(),
            count: count.to_f64(),
            lags,
            epsilon,
            clip,
            enabled,
        })
    }

    /// Whether observations are normalised, ε, and the clipping bound.
    fn settings(&self) -> Result<(bool, f64, f64), CheckpointError> {
        let records = &self.pickle.records;
        let enabled = match records.attribute(self.pickle.root, "norm_obs") {
            Some(id) => records
                .bool(id)
                .ok_or_else(|| record_error(records.unexpected("norm_obs", id, "a boolean")))?,
            None => true,
        };
        let number = |name: &str| {
            let id = self.require(self.pickle.root, name)?;
            arrays::number(records, id, name).map_err(in_array(name))
        };
        Ok((enabled, number("epsilon")?, number("clip_obs")?))
    }

    /// The signature of each row, from the table signature → row.
    fn signatures(&self, table: Id, rows: usize) -> Result<Vec<Vec<u16>>, CheckpointError> {
        let records = &self.pickle.records;
        let malformed =
            |id, expected| record_error(records.unexpected("sig_ids_dict", id, expected));
        let pairs =
            records.pairs(table).ok_or_else(|| malformed(table, "a table of signatures"))?;
        if pairs.len() != rows {
            return Err(malformed(table, "one signature per row of the statistics"));
        }
        let mut signatures = vec![Vec::new(); rows];
        for &(key, row) in pairs {
            let signature = signature(records, key)
                .ok_or_else(|| malformed(key, "a sorted tuple of word numbers"))?;
            let place = records
                .size(row)
                .and_then(|row| signatures.get_mut(row))
                .filter(|place| place.is_empty())
                .ok_or_else(|| malformed(row, "a row number that occurs once"))?;
            *place = signature;
        }
        if signatures.first().map(Vec::as_slice) != Some(&[0]) {
            return Err(malformed(table, "a table whose row 0 is the padding signature (0,)"));
        }
        Ok(signatures)
    }

    fn require(&self, id: Id, name: &str) -> Result<Id, CheckpointError> {
        self.pickle.records.require(id, name).map_err(record_error)
    }

    fn array(&mut self, id: Id, name: &str) -> Result<Array, CheckpointError> {
        let array = self.require(id, name)?;
        arrays::array(&self.pickle.records, array, name, self.budget).map_err(in_array(name))
    }
}

/// The word numbers of a signature, which old and new files write as integers or as `f32` scalars.
fn signature(records: &Records<'_>, key: Id) -> Option<Vec<u16>> {
    let Node::Tuple(words) = records.node(key) else { return None };
    let number = |&id: &Id| {
        let value = arrays::number(records, id, "word").ok()?;
        let whole = value.fract() == 0.0 && (0.0..=f64::from(u16::MAX)).contains(&value);
        whole.then_some(value as u16)
    };
    let words: Vec<u16> = words.iter().map(number).collect::<Option<_>>()?;
    (!words.is_empty() && words.is_sorted()).then_some(words)
}

fn wrong_shape(name: &str, expected: &str, found: &Array) -> CheckpointError {
    let fault =
        TensorError::WrongShape { expected: expected.to_owned(), found: found.shape.clone() };
    CheckpointError::Tensor { tensor: name.to_owned(), fault }
}

fn in_array(name: &str) -> impl Fn(TensorError) -> CheckpointError {
    move |fault| CheckpointError::Tensor { tensor: name.to_owned(), fault }
}

fn record_error(fault: RecordError) -> CheckpointError {
    CheckpointError::Record { part: PART.to_owned(), fault }
}

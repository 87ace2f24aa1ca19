//! scikit-learn's `StandardScaler`, pickled: `(x − mean)/scale` per component (`spec/policy.md` §4.6).

use super::allowed::Kind;
use super::arrays;
use super::limits::Budget;
use super::storages::TensorError;
use super::{CheckpointError, in_pickle, pickle};

const PART: &str = "scaler";
const CLASS: &str = "sklearn.preprocessing._data.StandardScaler";

/// Mean and scale of every component.
#[derive(Debug, Clone, PartialEq)]
pub struct Scaler {
    pub mean: Vec<f64>,
    /// Finite and above zero.
    pub scale: Vec<f64>,
}

/// Reads a scaler.
pub(super) fn read(bytes: &[u8], budget: &mut Budget) -> Result<Scaler, CheckpointError> {
    let pickle = pickle::read(bytes, Kind::Scaler, budget).map_err(in_pickle(PART))?;
    let records = &pickle.records;
    let in_record = |fault| CheckpointError::Record { part: PART.to_owned(), fault };
    if records.class(pickle.root) != Some(CLASS) {
        return Err(in_record(records.unexpected(PART, pickle.root, "a `StandardScaler`")));
    }
    let mut vector = |name: &str, usable: fn(f64) -> bool| {
        let in_tensor = |fault| CheckpointError::Tensor { tensor: name.to_owned(), fault };
        let id = records.require(pickle.root, name).map_err(in_record)?;
        let array = arrays::array(records, id, name, budget).map_err(in_tensor)?;
        if array.shape.len() != 1 {
            let (expected, found) = ("one axis".to_owned(), array.shape);
            return Err(in_tensor(TensorError::WrongShape { expected, found }));
        }
        let values = array.to_f64();
        match values.iter().position(|&value| !usable(value)) {
            None => Ok(values),
            Some(index) => {
                let (name, value) = (name.to_owned(), values[index]);
                Err(CheckpointError::ImpossibleStatistic { name, value, index })
            }
        }
    };
    let mean = vector("mean_", f64::is_finite)?;
    let scale = vector("scale_", |scale| scale.is_finite() && scale > 0.0)?;
    if mean.len() != scale.len() {
        let (expected, found) = (format!("[{}]", mean.len()), vec![scale.len()]);
        let fault = TensorError::WrongShape { expected, found };
        return Err(CheckpointError::Tensor { tensor: "scale_".to_owned(), fault });
    }
    Ok(Scaler { mean, scale })
}

//! Policies of MyoSuite's baselines: a pickled `mjrl` Gaussian MLP trained by natural policy gradient
//! (`spec/policy.md` §4.5).
//!
//! Tensors are renamed to `fc_layers.{k}.weight`, `fc_layers.{k}.bias`, `in_shift`, `in_scale`, `out_shift`,
//! `out_scale` and `log_std`. The duplicates that training left in the file (`old_model`, `param_*`) are not read.

use std::collections::BTreeMap;

use super::allowed::Kind;
use super::contents::{Activation, Checkpoint, Format, Scalars, Tensor, TensorMap};
use super::limits::Budget;
use super::pickle;
use super::records::{Id, RecordError, Records};
use super::storages::TensorError;
use super::stream::read_embedded_tensor;
use super::{CheckpointError, in_pickle};

/// Class of the object such a file holds.
pub(super) const CLASS: &str = "mjrl.policies.gaussian_mlp.MLP";

const NETWORK_CLASS: &str = "mjrl.utils.fc_network.FCNetwork";
const PART: &str = "policy";

/// Reads the policy.
pub(super) fn read(bytes: &[u8], budget: &mut Budget) -> Result<Checkpoint, CheckpointError> {
    let pickle = pickle::read(bytes, Kind::NaturalGradient, budget).map_err(in_pickle(PART))?;
    let records = &pickle.records;
    let in_record = |fault: RecordError| CheckpointError::Record { part: PART.to_owned(), fault };
    if records.class(pickle.root) != Some(CLASS) {
        return Err(in_record(records.unexpected(PART, pickle.root, "an `mjrl` policy")));
    }
    let network = records.require(pickle.root, "model").map_err(in_record)?;
    if records.class(network) != Some(NETWORK_CLASS) {
        return Err(in_record(records.unexpected("model", network, "an `mjrl` network")));
    }

    let mut tensors = TensorMap::new();
    let mut add = |name: String, id: Id| match read_embedded_tensor(records, id, budget) {
        Ok(tensor) => {
            tensors.insert(name, tensor);
            Ok(())
        }
        Err(fault) => Err(CheckpointError::EmbeddedTensor { tensor: name, fault }),
    };
    for name in ["in_shift", "in_scale", "out_shift", "out_scale"] {
        add(name.to_owned(), records.require(network, name).map_err(in_record)?)?;
    }
    add("log_std".to_owned(), records.require(pickle.root, "log_std").map_err(in_record)?)?;
    let layers = layers(records, network).map_err(in_record)?;
    for (position, &layer) in layers.iter().enumerate() {
        let parameters = records.require(layer, "_parameters").map_err(in_record)?;
        for name in ["weight", "bias"] {
            let id = records.value(parameters, name).ok_or_else(|| {
                in_record(RecordError::Missing { attribute: format!("layer {position} {name}") })
            })?;
            add(format!("fc_layers.{position}.{name}"), id)?;
        }
    }
    check_widths(&tensors, layers.len())?;

    let scalars = Scalars { activation: Some(activation(records, network)?), ..Scalars::default() };
    let mut globals = records.globals().to_vec();
    globals.sort();
    Ok(Checkpoint { format: Format::NpgMlp, tensors, aliases: BTreeMap::new(), scalars, globals })
}

/// The linear layers of the network, in order of their number.
fn layers(records: &Records<'_>, network: Id) -> Result<Vec<Id>, RecordError> {
    let missing = || RecordError::Missing { attribute: "fc_layers".to_owned() };
    let modules = records.require(network, "_modules")?;
    let list = records.value(modules, "fc_layers").ok_or_else(missing)?;
    let layers = records.require(list, "_modules")?;
    let count = records.pairs(layers).map_or(0, <[_]>::len);
    if count == 0 {
        return Err(missing());
    }
    // Bounded, because the look-up of each is a search through all.
    if count > 64 {
        return Err(records.unexpected("fc_layers", layers, "at most 64 layers"));
    }
    (0..count).map(|k| records.value(layers, &k.to_string()).ok_or_else(missing)).collect()
}

/// The one activation function that these files name: `getattr(torch._C._VariableFunctions, "tanh")`.
fn activation(records: &Records<'_>, network: Id) -> Result<Activation, CheckpointError> {
    let in_record = |fault| CheckpointError::Record { part: PART.to_owned(), fault };
    let function = records.require(network, "nonlinearity").map_err(in_record)?;
    match records.class(function) {
        Some("builtins.getattr") => Ok(Activation::Tanh),
        _ => Err(in_record(records.unexpected("nonlinearity", function, "the hyperbolic tangent"))),
    }
}

/// Checks that each layer takes what the one before gives.
fn check_widths(tensors: &TensorMap, layers: usize) -> Result<(), CheckpointError> {
    let shape = |name: &str| tensors.get(name).map_or(&[][..], |tensor: &Tensor| &tensor.shape);
    let check = |name: &str, expected: &[usize]| {
        let found = shape(name);
        if found == expected {
            return Ok(());
        }
        let fault =
            TensorError::WrongShape { expected: format!("{expected:?}"), found: found.to_vec() };
        Err(CheckpointError::Tensor { tensor: name.to_owned(), fault })
    };
    let mut width = shape("in_shift").first().copied().unwrap_or(0);
    check("in_shift", &[width])?;
    check("in_scale", &[width])?;
    for layer in 0..layers {
        let weight = format!("fc_layers.{layer}.weight");
        let output = shape(&weight).first().copied().unwrap_or(0);
        check(&weight, &[output, width])?;
        check(&format!("fc_layers.{layer}.bias"), &[output])?;
        width = output;
    }
    ["out_shift", "out_scale", "log_std"].iter().try_for_each(|name| check(name, &[width]))
}

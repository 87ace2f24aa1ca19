//! Stable-Baselines3 archives: the settings in `data` (JSON), the weights in `policy.pth`, the version.
//!
//! `data` holds whatever JSON can express, and everything else as base64-coded cloudpickle under `:serialized:`. Those
//! blobs are programs; they are never decoded. What is needed of them is repeated beside them as plain JSON
//! (`spec/policy.md` §3.3). Optimiser state and other members are not read.

use std::path::Path;

use serde_json::Value;

use super::allowed::Kind;
use super::archive::Archive;
use super::contents::{Activation, Checkpoint, Format, Scalars, TensorMap};
use super::limits::Budget;
use super::records::printable;
use super::tensors::{self, StateDict};
use super::{CheckpointError, in_pickle, pickle};

const SETTINGS: &str = "data";
const WEIGHTS: &str = "policy.pth";
const VERSION: &str = "_stable_baselines3_version";

/// Whether an archive is one of these.
pub(super) fn recognise(archive: &Archive<'_>) -> bool {
    archive.contains(SETTINGS) && archive.contains(WEIGHTS)
}

/// Reads settings and weights.
pub(super) fn read(
    archive: &mut Archive<'_>,
    budget: &mut Budget,
) -> Result<Checkpoint, CheckpointError> {
    let mut scalars = read_settings(archive, budget)?;
    if archive.contains(VERSION) {
        let version = archive.read(VERSION, budget)?;
        scalars.library_version = Some(printable(String::from_utf8_lossy(&version).trim()));
    }
    let weights = archive.nested(WEIGHTS, budget)?;
    let state = tensors::read_state_dict(&weights, WEIGHTS, budget)?;
    checkpoint(state, scalars)
}

/// A checkpoint made of a state dictionary, once the kind of network is known from the names of its tensors.
pub(super) fn checkpoint(
    state: StateDict,
    scalars: Scalars,
) -> Result<Checkpoint, CheckpointError> {
    let format = recognise_network(&state.tensors)?;
    let StateDict { tensors, aliases, mut globals } = state;
    globals.sort();
    globals.dedup();
    Ok(Checkpoint { format, tensors, aliases, scalars, globals })
}

/// The kind of network, from the names that only it has.
fn recognise_network(tensors: &TensorMap) -> Result<Format, CheckpointError> {
    let any_starts = |prefix: &str| tensors.keys().any(|name| name.starts_with(prefix));
    if any_starts("mlp_extractor.encoder.") {
        Ok(Format::ArnoldTransformer)
    } else if any_starts("lstm_actor.") {
        Ok(Format::RecurrentPpo)
    } else if any_starts("mlp_extractor.policy_net.") || any_starts("action_net.") {
        Ok(Format::PpoMlp)
    } else {
        let names: Vec<&str> = tensors.keys().take(3).map(String::as_str).collect();
        Err(CheckpointError::UnknownNetwork { tensors: names.join("`, `") })
    }
}

/// What the settings say that the weights do not.
fn read_settings(
    archive: &mut Archive<'_>,
    budget: &mut Budget,
) -> Result<Scalars, CheckpointError> {
    // Every value of a parsed document but the first comes after one of four characters.
    const BYTES_PER_VALUE: u64 = 128;
    let text = archive.read(SETTINGS, budget)?;
    let values =
        text.iter().filter(|byte| matches!(byte, b',' | b':' | b'[' | b'{')).count() as u64;
    budget
        .charge_memory(text.len() as u64 + BYTES_PER_VALUE * values)
        .map_err(|fault| CheckpointError::Limit { part: SETTINGS.to_owned(), fault })?;
    let settings: Value = serde_json::from_slice(&text)
        .map_err(|fault| CheckpointError::Settings { part: SETTINGS.to_owned(), fault })?;
    let policy = &settings["policy_kwargs"];
    Ok(Scalars {
        head_count: policy["net_arch"]["num_heads"].as_u64().and_then(|n| usize::try_from(n).ok()),
        policy_outputs_variance: policy["policy_outputs_variance"].as_bool(),
        activation: policy["activation_fn"].as_str().and_then(activation),
        training_steps: settings["num_timesteps"].as_u64(),
        library_version: None,
    })
}

/// `<class 'torch.nn.modules.activation.ReLU'>`: only the class name counts, and only a known one.
fn activation(class: &str) -> Option<Activation> {
    let path = class.strip_prefix("<class '")?.strip_suffix("'>")?;
    match path.rsplit('.').next()? {
        "ReLU" => Some(Activation::Relu),
        "Tanh" => Some(Activation::Tanh),
        "ELU" => Some(Activation::Elu),
        "SiLU" => Some(Activation::Silu),
        "GELU" => Some(Activation::Gelu),
        _ => None,
    }
}

/// A member of the archive that reading the policy does not need.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct UnusedPickle {
    /// Name of the member, safe to print.
    pub member: String,
    /// Every global its pickle names, or why that cannot be told.
    pub globals: Result<Vec<String>, String>,
}

/// Lists the globals of every torch member, whatever they are. Nothing is interpreted.
pub(super) fn list_globals(archive: &mut Archive<'_>, budget: &mut Budget) -> Vec<UnusedPickle> {
    let is_torch = |name: &String| Path::new(name).extension().is_some_and(|end| end == "pth");
    let members = archive.names().into_iter().filter(is_torch);
    let list = |member: String| {
        let globals = globals_of_member(archive, &member, budget).map_err(|e| e.to_string());
        UnusedPickle { member: printable(&member), globals }
    };
    members.map(list).collect()
}

fn globals_of_member(
    archive: &mut Archive<'_>,
    member: &str,
    budget: &mut Budget,
) -> Result<Vec<String>, CheckpointError> {
    let bytes = archive.nested(member, budget)?;
    let mut inner = Archive::open(&bytes, budget)?;
    let (_, content) = tensors::read_pickle_member(&mut inner, member, budget)?;
    let listing = pickle::read(&content, Kind::Listing, budget).map_err(in_pickle(member))?;
    let mut globals = listing.records.globals().to_vec();
    globals.sort();
    Ok(globals)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_activation_is_known_by_the_end_of_its_class_name_only() {
        let relu = "<class 'torch.nn.modules.activation.ReLU'>";
        assert_eq!(activation(relu), Some(Activation::Relu));
        assert_eq!(activation("<class 'evil.NotReLU'>"), None);
        assert_eq!(activation("ReLU"), None);
    }
}

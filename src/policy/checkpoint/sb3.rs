//! Stable-Baselines3 archives: the settings in `data` (`settings.rs`), the weights in `policy.pth`, the version. Optimiser
//! state and other members are not read.

use std::path::Path;

use super::allowed::Kind;
use super::archive::Archive;
use super::contents::{Checkpoint, Format, Scalars, TensorMap};
use super::limits::Budget;
use super::records::printable;
use super::tensors::{self, StateDict};
use super::{CheckpointError, in_pickle, pickle, settings};

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
    let mut scalars = settings::read(&archive.read(SETTINGS, budget)?, SETTINGS, budget)?;
    if archive.contains(VERSION) {
        let version = archive.read(VERSION, budget)?;
        scalars.library_version = Some(printable(String::from_utf8_lossy(&version).trim()));
    }
    let weights = archive.nested(WEIGHTS, budget)?;
    let state = tensors::read_state_dict(&weights, WEIGHTS, Kind::TorchArchive, budget)?;
    checkpoint(state, scalars)
}

/// A checkpoint made of a state dictionary, once the kind of network is known from the names of its tensors.
pub(super) fn checkpoint(
    state: StateDict,
    mut scalars: Scalars,
) -> Result<Checkpoint, CheckpointError> {
    let format = recognise_network(&state.tensors)?;
    let StateDict { tensors, aliases, mut globals, activation_class } = state;
    let stated = || settings::activation_called(activation_class.as_deref()?);
    scalars.activation = scalars.activation.or_else(stated);
    globals.sort();
    globals.dedup();
    Ok(Checkpoint { format, tensors, aliases, scalars, globals })
}

/// The kind of network, from the names that only it has.
pub(super) fn recognise_network(tensors: &TensorMap) -> Result<Format, CheckpointError> {
    let any_starts = |prefix: &str| tensors.keys().any(|name| name.starts_with(prefix));
    let first_names =
        || tensors.keys().take(3).map(String::as_str).collect::<Vec<_>>().join("`, `");
    if let Some((_, what)) = FOREIGN_NETWORKS.iter().find(|(prefix, _)| any_starts(prefix)) {
        Err(CheckpointError::ForeignNetwork { what, tensors: first_names() })
    } else if any_starts("mlp_extractor.time_encoder.") {
        Ok(Format::TemporalTransformer)
    } else if any_starts("mlp_extractor.encoder.") {
        Ok(Format::ArnoldTransformer)
    } else if any_starts("lstm_actor.") {
        Ok(Format::RecurrentPpo)
    } else if any_starts("mlp_extractor.policy_net.") || any_starts("action_net.") {
        Ok(Format::PpoMlp)
    } else if any_starts("actor.mu.") {
        Ok(Format::SacMlp)
    } else if any_starts("net.affine_layers.") {
        Ok(Format::WalkingExpert)
    } else if ["layer_1.weight", "layer_2.weight", "layer_out.weight"].iter().all(|n| any_starts(n))
    {
        Ok(Format::EnsembleClassifier)
    } else {
        Err(CheckpointError::UnknownNetwork { tensors: first_names() })
    }
}

/// Networks that are known but have no task here: how their tensors' names start, and what they are.
const FOREIGN_NETWORKS: [(&str, &str); 2] = [
    (
        "policy_network.exo_policy_net.",
        "a policy of MyoAssist's 22-muscle legs with an exoskeleton, a body that no task here has",
    ),
    (
        "experts.experts.",
        "a mixture of walking experts that imitate motion; no task here shows them the motion",
    ),
];

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

//! torch files that hold a state dictionary: a zip of one pickle (`…/data.pkl`) and one raw little-endian member per
//! storage (`…/data/<key>`) (`spec/policy.md` §3.5). Each storage is read once, whatever number of tensors lie in it.

use std::collections::btree_map::Entry;
use std::collections::{BTreeMap, BTreeSet};

use super::allowed::Kind;
use super::archive::Archive;
use super::contents::TensorMap;
use super::limits::Budget;
use super::pickle;
use super::records::{Id, RecordError, Records};
use super::storages::{StorageReference, TensorError, View, is_plain, tensor_parts};
use super::{CheckpointError, in_pickle};

/// The tensors of a state dictionary.
#[derive(Debug)]
pub(super) struct StateDict {
    pub(super) tensors: TensorMap,
    /// Name of each tensor that is the same view of the same storage as an earlier one, with that one's name.
    pub(super) aliases: BTreeMap<String, String>,
    pub(super) globals: Vec<String>,
    /// The class of the activation function, if the file holds the policy's construction as well.
    pub(super) activation_class: Option<String>,
}

/// The name of the one member that ends in `/data.pkl`, if `names` are those of a torch file.
pub(super) fn pickle_member(names: &[String]) -> Option<&str> {
    let mut found = names.iter().filter(|name| name.ends_with("/data.pkl"));
    match (found.next(), found.next()) {
        (Some(name), None) => Some(name),
        _ => None,
    }
}

/// The pickle of an open torch file. `part` names the file in messages.
pub(super) fn read_pickle_member(
    archive: &mut Archive<'_>,
    part: &str,
    budget: &mut Budget,
) -> Result<(String, Vec<u8>), CheckpointError> {
    let names = archive.names();
    let member = pickle_member(&names)
        .ok_or_else(|| CheckpointError::NotATorchFile { part: part.to_owned() })?;
    let content = archive.read(member, budget)?;
    Ok((member.to_owned(), content))
}

/// Reads a modern torch file that holds a state dictionary, as a whole or under one of the customary names. `part` names
/// the file in messages.
pub(super) fn read_state_dict(
    bytes: &[u8],
    part: &str,
    kind: Kind,
    budget: &mut Budget,
) -> Result<StateDict, CheckpointError> {
    let mut archive = Archive::open(bytes, budget)?;
    let (member, content) = read_pickle_member(&mut archive, part, budget)?;
    let prefix = member.strip_suffix("data.pkl").unwrap_or_default();
    let byte_order = format!("{prefix}byteorder");
    if archive.contains(&byte_order) && archive.read(&byte_order, budget)? != b"little" {
        let tensor = part.to_owned();
        return Err(CheckpointError::Tensor { tensor, fault: TensorError::BigEndian });
    }
    let pickle = pickle::read(&content, kind, budget).map_err(in_pickle(part))?;
    let records = &pickle.records;
    let root = NAMES_OF_STATE.iter().find_map(|name| {
        records.value(pickle.root, name).filter(|&inner| records.pairs(inner).is_some())
    });
    let construction = records.value(pickle.root, "data");
    let activation_class = construction
        .and_then(|data| records.global(records.value(data, "activation_fn")?))
        .map(str::to_owned);
    let (groups, aliases) = views_by_storage(records, root.unwrap_or(pickle.root), part, budget)?;

    let mut tensors = TensorMap::new();
    let mut content = Vec::new();
    for (storage, views) in groups {
        archive.read_into(&format!("{prefix}data/{}", storage.key), &mut content, budget)?;
        for (view, name) in views {
            let tensor = storage
                .check_length(&content)
                .and_then(|()| view.gather(&content, storage.element, budget))
                .map_err(|fault| CheckpointError::Tensor { tensor: name.clone(), fault })?;
            tensors.insert(name, tensor);
        }
    }
    for (alias, original) in &aliases {
        if let Some(tensor) = tensors.get(original).cloned() {
            tensors.insert(alias.clone(), tensor);
        }
    }
    Ok(StateDict { tensors, aliases, globals: records.globals().to_vec(), activation_class })
}

/// Names under which a file keeps its state dictionary when it keeps other things as well: `policy.save` of
/// Stable-Baselines3, and the walking expert.
const NAMES_OF_STATE: [&str; 2] = ["state_dict", "policy"];

/// The different views of one storage, each with the first name it has.
type ViewGroup = (StorageReference, BTreeMap<View, String>);

/// The distinct views of a state dictionary grouped by storage, so that each storage is read once, and the aliases.
/// The memory of all tensors is charged here, before the first of them is read.
fn views_by_storage(
    records: &Records<'_>,
    root: Id,
    part: &str,
    budget: &mut Budget,
) -> Result<(Vec<ViewGroup>, BTreeMap<String, String>), CheckpointError> {
    let in_part = |fault| CheckpointError::Record { part: part.to_owned(), fault };
    let pairs = records.pairs(root).ok_or_else(|| {
        in_part(records.unexpected("state dictionary", root, "a dictionary of tensors"))
    })?;
    let mut groups: BTreeMap<String, ViewGroup> = BTreeMap::new();
    let mut aliases = BTreeMap::new();
    let mut seen = BTreeSet::new();
    for &(key, value) in pairs {
        let name = records
            .text(key)
            .filter(|name| is_plain(name))
            .ok_or_else(|| in_part(records.unexpected("tensor name", key, "a plain name")))?;
        let in_tensor =
            |fault: TensorError| CheckpointError::Tensor { tensor: name.to_owned(), fault };
        if !seen.insert(name) {
            return Err(in_tensor(TensorError::Duplicate));
        }
        let (storage, parts) =
            tensor_parts(records, value).map_err(|error| in_tensor(error.into()))?;
        let storage = StorageReference::parse(records, storage).map_err(in_tensor)?;
        let view = View::parse(records, parts, storage.count).map_err(in_tensor)?;
        budget.charge_memory(view.bytes()).map_err(|error| in_tensor(error.into()))?;
        let group =
            groups.entry(storage.key.clone()).or_insert_with(|| (storage.clone(), BTreeMap::new()));
        if group.0 != storage {
            let what = RecordError::Unexpected {
                place: format!("storage `{}`", storage.key),
                expected: "the same everywhere",
                found: "described in two ways".to_owned(),
            };
            return Err(in_tensor(what.into()));
        }
        match group.1.entry(view) {
            Entry::Occupied(original) => {
                aliases.insert(name.to_owned(), original.get().clone());
            }
            Entry::Vacant(place) => {
                place.insert(name.to_owned());
            }
        }
    }
    Ok((groups.into_values().collect(), aliases))
}

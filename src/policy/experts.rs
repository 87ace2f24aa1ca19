//! Every task's own expert, as one policy: bound to a task, it is that task's expert.

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use super::checkpoint::contents::Format;
use super::expert_table::{EXPERT_FOLDERS, ExpertEntry, ExpertTable};
use super::interface::{Actor, ObservationVariant, Policy, TaskInterface};
use super::loading::{self, Loaded, Member};
use super::transformer_files::is_transformer;
use super::{PolicyError, shelf};

/// Experts by task; for a task without one, why.
struct ExpertSet(BTreeMap<String, Result<Arc<dyn Policy>, String>>);

/// Opens the experts that `table` has for `tasks`, whose folders lie below `data`. A task whose expert cannot be read
/// is refused when it is bound; fails only if that is so for all of them.
pub fn open_experts(
    table: &ExpertTable,
    tasks: &[&str],
    data: &Path,
) -> Result<Loaded, PolicyError> {
    let root = data.join(EXPERT_FOLDERS);
    // Tasks may share an expert, but then it must be for both what the table says.
    let mut opened: BTreeMap<(&str, &str, bool), Result<Loaded, String>> = BTreeMap::new();
    let mut set = BTreeMap::new();
    let (mut members, mut warnings) = (Vec::new(), Vec::new());
    let mut format = None;
    let mut hasher = blake3::Hasher::new();
    for &task in tasks {
        let Some(entry) = table.of(task) else {
            set.insert(task.to_owned(), Err("the table of experts has none".to_owned()));
            continue;
        };
        let expert = opened
            .entry((&entry.folder, &entry.algo, entry.use_arnold))
            .or_insert_with(|| open(entry, &root).map_err(|error| error.to_string()));
        set.insert(
            task.to_owned(),
            expert.as_ref().map(|e| Arc::clone(&e.policy)).map_err(Clone::clone),
        );
        let Ok(expert) = expert else { continue };
        format = format.or(expert.format);
        warnings.extend(ExpertTable::misplaced(task, entry));
        let said = |text: &String| format!("{}: {text}", entry.folder);
        let new = expert.warnings.iter().map(said).filter(|text| !warnings.contains(text));
        let new: Vec<String> = new.collect();
        warnings.extend(new);
        for text in [task, &expert.checkpoint_hash, expert.normaliser_hash.as_deref().unwrap_or("")]
        {
            hasher.update(text.as_bytes()).update(b"\n");
        }
        members.push(Member {
            task: task.to_owned(),
            name: entry.folder.clone(),
            checkpoint_path: expert.checkpoint_path.clone(),
            checkpoint_hash: expert.checkpoint_hash.clone(),
            normaliser_path: expert.normaliser_path.clone(),
            normaliser_hash: expert.normaliser_hash.clone(),
        });
    }
    if format.is_none() {
        let reasons = set.iter().filter_map(|(task, expert)| {
            expert.as_ref().err().map(|reason| format!("\n  {task}: {reason}"))
        });
        return Err(PolicyError::NoExperts { reasons: reasons.collect(), folder: root });
    }
    Ok(Loaded {
        policy: Arc::new(ExpertSet(set)),
        name: "experts".to_owned(),
        format,
        checkpoint_path: root,
        checkpoint_hash: hasher.finalize().to_hex().to_string(),
        normaliser_path: None,
        normaliser_hash: None,
        warnings,
        members,
    })
}

/// Opens one expert and sees that it is what the table says.
fn open(entry: &ExpertEntry, root: &Path) -> Result<Loaded, PolicyError> {
    let folder = root.join(&entry.folder);
    if !folder.is_dir() {
        return Err(PolicyError::NoExpertFolder { folder });
    }
    let expert = loading::open(&shelf::checkpoint_at(&folder)?, None)?;
    let fits = expert.format.is_some_and(is_transformer) == entry.use_arnold
        && (entry.algo != "recurrent_ppo"
            || entry.use_arnold
            || expert.format == Some(Format::RecurrentPpo));
    if fits {
        return Ok(expert);
    }
    let declared = if entry.use_arnold { "a transformer" } else { entry.algo.as_str() };
    let found = expert.format.map_or_else(String::new, |format| format!("{format:?}"));
    Err(PolicyError::OtherExpert { folder, declared: declared.to_owned(), found })
}

impl ExpertSet {
    fn of(&self, task: &str) -> Result<&dyn Policy, PolicyError> {
        let without = |reason: &str| PolicyError::NoExpert {
            task: task.to_owned(),
            reason: reason.to_owned(),
        };
        match self.0.get(task) {
            Some(Ok(expert)) => Ok(expert.as_ref()),
            Some(Err(reason)) => Err(without(reason)),
            None => Err(without("it was not asked for")),
        }
    }

    fn all(&self) -> impl Iterator<Item = &dyn Policy> {
        self.0.values().filter_map(|expert| Some(expert.as_ref().ok()?.as_ref()))
    }
}

impl Policy for ExpertSet {
    /// What the first of them wants; each task's own answer is [`Policy::variant_in`].
    fn variant(&self) -> ObservationVariant {
        self.all().next().map_or(ObservationVariant::Clean, Policy::variant)
    }

    fn variant_in(&self, task: &str) -> ObservationVariant {
        self.of(task).map_or_else(|_| self.variant(), Policy::variant)
    }

    fn bind(&self, task: &TaskInterface, slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        self.of(&task.task)?.bind(task, slots)
    }

    fn is_stochastic(&self) -> bool {
        self.all().all(Policy::is_stochastic)
    }

    fn warnings(&self, task: &TaskInterface) -> Vec<String> {
        self.of(&task.task).map(|expert| expert.warnings(task)).unwrap_or_default()
    }
}

//! Where a run begins if not from nothing: with the weights and the normaliser of a checkpoint, and, if the state of the run
//! that wrote it is there, with what its optimiser remembers, the statistics of its rewards and its step count
//! (`spec/training.md` §5.8). Tasks may be others: signatures and rewards that were never met start anew.

use std::path::{Path, PathBuf};

use serde_json::Value;

use super::TrainError;
use super::adam::{Adam, AdamSettings};
use super::checkpoints::{OPTIMISER, PARAMETER, tensors_under, whole_numbers};
use super::recipe::{NetworkShape, PerceptronShape, TransformerShape, WindowsShape};
use super::reward_normaliser::{Returns, RewardNormaliser};
use super::run::{ARGUMENTS, LARGEST_ARGUMENTS, STATE};
use super::statistics::Statistics;
use crate::files;
use crate::npz::Arrays;
use crate::policy::checkpoint::contents::{Format, Normaliser, Scalars, TensorMap};
use crate::policy::running_components::RunningComponents;
use crate::policy::{self, Stored, shelf};
use crate::sim::tasks;
use crate::train::{Parameters, Trainable};

/// No run is longer: so sums of step counts stay numbers.
const MOST_STEPS: u64 = 1 << 53;

/// A checkpoint to begin with.
#[derive(Debug, Clone)]
pub struct Start {
    /// Name of the file without its extension.
    pub name: String,
    pub path: PathBuf,
    /// BLAKE3 of its files.
    pub hash: String,
    /// Control steps that it has seen.
    pub steps: u64,
    pub network: NetworkShape,
    tensors: TensorMap,
    /// Tasks whose places it sees.
    task_index: Vec<String>,
    normaliser: Option<Normaliser>,
    memory: Option<Memory>,
}

/// What only the state of a run tells.
#[derive(Debug, Clone)]
struct Memory {
    updates: u64,
    optimiser: TensorMap,
    /// Returns by the identifier of an environment.
    returns: Vec<(String, Returns)>,
}

impl Start {
    /// The checkpoint in this file, or the newest in this folder.
    pub fn open(path: &Path) -> Result<Self, TrainError> {
        let file = shelf::checkpoint_at(path)?;
        let stored = policy::read_stored(&file)?;
        let arguments = arguments_beside(&file)?;
        let own: Option<NetworkShape> = arguments
            .as_ref()
            .and_then(|all| serde_json::from_value(all["recipe"]["network"].clone()).ok());
        let network = match own {
            Some(network) => network,
            None => shape_of(&stored)?,
        };
        let tensors = stored.checkpoint.tensors;
        let state = file.with_file_name(STATE);
        let (mut memory, mut steps) = (None, stored.checkpoint.scalars.training_steps);
        if state.is_file() {
            let arrays = Arrays::open(&state)?;
            let counters = whole_numbers(&arrays, "counters")?;
            let of_this = tensors_under(&arrays, PARAMETER)
                .iter()
                .all(|(name, tensor)| tensors.get(name) == Some(tensor));
            if let (true, &[_, done, updates]) = (of_this, counters.as_slice()) {
                steps = Some(done);
                let names = arguments.as_ref().map(task_names).unwrap_or_default();
                let numbers = arrays.get("return_statistics")?.to_f64();
                let returns = numbers.as_chunks::<3>().0.iter();
                let returns = returns
                    .map(|&[mean, variance, count]| Returns { mean, variance, count })
                    .filter(|r| r.mean.is_finite() && r.variance >= 0.0 && r.count > 0.0);
                let returns = identifiers(&names).into_iter().zip(returns).collect();
                let optimiser = tensors_under(&arrays, OPTIMISER);
                memory = Some(Memory { updates, optimiser, returns });
            }
        }
        let steps = steps.unwrap_or(0);
        if steps > MOST_STEPS {
            return Err(TrainError::State { what: "step count".to_owned() });
        }
        Ok(Self {
            name: file.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
            path: file,
            hash: stored.hash,
            steps,
            network,
            tensors,
            task_index: stored.checkpoint.scalars.task_index,
            normaliser: stored.normaliser,
            memory,
        })
    }

    /// The same with other numbers for some tensors, or with some more.
    #[must_use]
    pub fn with_tensors(mut self, tensors: TensorMap) -> Self {
        self.tensors.extend(tensors);
        self
    }

    /// The same without statistics of what was seen and rewarded.
    #[must_use]
    pub fn without_statistics(mut self) -> Self {
        self.normaliser = None;
        if let Some(memory) = &mut self.memory {
            memory.returns.clear();
        }
        self
    }

    /// Whether the optimiser goes on with what it remembers.
    #[must_use]
    pub fn has_memory(&self) -> bool {
        self.memory.is_some()
    }

    pub(super) fn write_parameters(&self, network: &mut dyn Trainable) -> Result<(), TrainError> {
        let (_, Scalars { task_index, .. }) = network.description();
        if task_index != self.task_index {
            let what = format!(
                "the checkpoint is told which task it plays of [{}], this run has [{}]",
                files::printable(&self.task_index.join(", ")),
                task_index.join(", ")
            );
            return Err(TrainError::Plan { what });
        }
        network.parameters_mut().read(&self.tensors)
    }

    /// Puts its statistics of observations, if there are any, in the place of `statistics`.
    pub(super) fn write_statistics(&self, statistics: &mut Statistics) -> Result<(), TrainError> {
        match (statistics, &self.normaliser) {
            (_, None) => {}
            (Statistics::Components(own), Some(Normaliser::PerComponent(stored))) => {
                if stored.mean.len() != own.mean().len() {
                    let what = "the checkpoint's normaliser is of another observation".to_owned();
                    return Err(TrainError::Plan { what });
                }
                // A policy does not store how many observations it has seen: one in every step.
                let count = self.steps.max(1) as f64;
                let (mean, variance) = (stored.mean.clone(), stored.variance.clone());
                *own = RunningComponents::restore(mean, variance, count)?;
            }
            (Statistics::Signatures { statistics, .. }, Some(Normaliser::PerSignature(stored))) => {
                statistics.replace(stored)?;
            }
            _ => {
                let what = "the checkpoint's normaliser is of another kind of network".to_owned();
                return Err(TrainError::Plan { what });
            }
        }
        Ok(())
    }

    pub(super) fn write_returns(&self, rewards: &mut RewardNormaliser) {
        for (identifier, returns) in self.memory.iter().flat_map(|memory| &memory.returns) {
            rewards.set(identifier, *returns);
        }
    }

    /// The optimiser with its memory, or a new one if there is none or the network has other parameters.
    pub(super) fn optimiser(&self, parameters: &Parameters) -> Adam {
        let settings = AdamSettings::default();
        let known = self.memory.as_ref().and_then(|memory| {
            Adam::restore(settings, parameters, memory.updates, &memory.optimiser).ok()
        });
        known.unwrap_or_else(|| Adam::new(settings, parameters))
    }
}

fn arguments_beside(file: &Path) -> Result<Option<Value>, TrainError> {
    let path = file.with_file_name(ARGUMENTS);
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = files::read_bounded(&path, LARGEST_ARGUMENTS)?;
    Ok(serde_json::from_slice(&bytes).ok())
}

fn task_names(arguments: &Value) -> Vec<String> {
    let names = arguments["tasks"].as_array().into_iter().flatten();
    names.filter_map(|name| Some(name.as_str()?.to_owned())).collect()
}

/// Identifiers of the tasks' environments, in the order in which they are first met.
fn identifiers(names: &[String]) -> Vec<String> {
    let mut known: Vec<String> = Vec::new();
    for definition in names.iter().filter_map(|name| tasks::find(name).ok()) {
        let identifier = definition.environment.unwrap_or(definition.name);
        if !known.iter().any(|k| k == identifier) {
            known.push(identifier.to_owned());
        }
    }
    known
}

/// What a network is made of, by its tensors.
fn shape_of(stored: &Stored) -> Result<NetworkShape, TrainError> {
    let checkpoint = &stored.checkpoint;
    let shape = |name: &str| checkpoint.tensors.get(name).map(|tensor| tensor.shape.as_slice());
    let layers = |name: &dyn Fn(usize) -> String| -> Vec<usize> {
        (0..).map_while(|k| shape(&name(k))?.first().copied()).collect()
    };
    let log_deviation = checkpoint.tensors.get("log_std").and_then(|tensor| tensor.data.first());
    let log_deviation = f64::from(log_deviation.copied().unwrap_or_default());
    let scalars = &checkpoint.scalars;
    match checkpoint.format {
        Format::ArnoldTransformer => {
            let tokenizer = shape("features_extractor.tokenizer.weight");
            let hidden = layers(&|k| format!("mlp_extractor.encoder.layers.{k}.linear1.weight"));
            if let (Some(&[width, lags]), Some(&feed_forward), Some(heads)) =
                (tokenizer, hidden.first(), scalars.head_count)
            {
                let (layers, padded_actions) = (hidden.len(), true);
                return Ok(NetworkShape::Transformer(TransformerShape {
                    width,
                    layers,
                    heads,
                    feed_forward,
                    lags,
                    log_deviation,
                    padded_actions,
                }));
            }
        }
        Format::PpoMlp => {
            let exploration = scalars.exploration.clone().unwrap_or_default();
            let lattice = exploration.lattice;
            return Ok(NetworkShape::Perceptron(PerceptronShape {
                hidden: layers(&|k| format!("mlp_extractor.policy_net.{}.weight", 2 * k)),
                activation: scalars.activation.unwrap_or(PerceptronShape::default().activation),
                log_deviation: if lattice { exploration.log_scale } else { log_deviation },
                lattice,
                subspace: None,
                windows: match &stored.normaliser {
                    Some(Normaliser::PerSignature(statistics)) => Some(WindowsShape {
                        lags: statistics.lags,
                        task_index: !scalars.task_index.is_empty(),
                    }),
                    _ => None,
                },
            }));
        }
        _ => {}
    }
    let what = format!("training cannot go on with a checkpoint of {}", checkpoint.format.word());
    Err(TrainError::Plan { what })
}

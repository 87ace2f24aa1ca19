//! The muscle transformer (`spec/policy.md` §1), with derivatives.
//!
//! One sample passes through the whole network and back before the next ([`pass`]), so that its activations stay in the
//! cache and memory does not grow with the minibatch. What depends on the task alone, the sums of its words and the first
//! self-attention of its queries, is computed once per minibatch ([`constants`]); samples add up the derivatives by it.

mod blocks;
mod constants;
mod heads;
mod layout;
mod one_query;
mod pass;
mod places;
mod stacks;
#[cfg(test)]
mod tests;
mod words;

use std::ops::Range;

pub use heads::Spread;
pub use layout::{Tables, TransformerSettings};
pub use words::TaskWords;

use super::check::{Lengths, check};
use super::{Player, Trainable};
use crate::policy::checkpoint::contents::{Declared, Format, Scalars};
use crate::random::Random;
use crate::train::losses::Objective;
use crate::train::shards::{Sum, shards, sum_over_shards};
use crate::train::{Coefficients, Losses, Parameters, Sample, TrainError};
use constants::Constants;
use heads::Head;
use pass::{Deviations, Memory, TransformerPlayer};
use places::Places;
use stacks::{Decoder, Encoder};
use words::Table;

/// A muscle transformer for certain tasks.
#[derive(Debug, Clone)]
pub struct Transformer {
    settings: TransformerSettings,
    tasks: Vec<TaskWords>,
    parameters: Parameters,
    parts: Parts,
}

/// The network's parts. Those with weights of their own hold the parameters of the last minibatch they were loaded with.
#[derive(Debug, Clone)]
struct Parts {
    tokenizer: crate::train::tape::linear::Linear,
    encoder: Encoder,
    action_decoder: Decoder,
    /// Absent when actor and critic share the action decoder.
    value_decoder: Option<Decoder>,
    mean_head: Head,
    scale_head: Option<Head>,
    value_head: Head,
    log_deviation: usize,
    /// The table of each task.
    tables: Vec<Table>,
}

impl Transformer {
    /// A network for `tasks` whose parameters are drawn from `random`.
    pub fn new(
        settings: TransformerSettings,
        tasks: Vec<TaskWords>,
        random: &mut Random,
    ) -> Result<Self, TrainError> {
        let mut network = Self::untrained(settings, tasks)?;
        layout::draw(&network.settings, &mut network.parameters, random);
        Ok(network)
    }

    /// A network for `tasks` whose parameters are zeros, to be read from a checkpoint.
    pub fn untrained(
        settings: TransformerSettings,
        tasks: Vec<TaskWords>,
    ) -> Result<Self, TrainError> {
        settings.check()?;
        tasks.iter().try_for_each(|task| task.check(settings.sizes.vocabulary))?;
        let names: Vec<&str> = tasks.iter().map(|task| task.task.as_str()).collect();
        let parameters = layout::parameters(&settings, &names);
        let parts = Parts::find(&settings, &tasks, &parameters)?;
        Ok(Self { settings, tasks, parameters, parts })
    }

    #[must_use]
    pub fn settings(&self) -> &TransformerSettings {
        &self.settings
    }

    #[must_use]
    pub fn tasks(&self) -> &[TaskWords] {
        &self.tasks
    }

    fn lengths(&self, task: usize) -> Option<Lengths> {
        let task = self.tasks.get(task)?;
        Some(Lengths {
            observation: task.sensors.len() * self.settings.sizes.lags,
            action: task.action_length,
            muscles: Some(task.muscles.len()),
            noise: task.action_length,
        })
    }

    /// `Σ u` of all actions of the minibatch over their number.
    fn mean_spread(
        &self,
        constants: &Constants,
        minibatch: &[Sample<'_>],
        shards: &[Range<usize>],
        threads: usize,
    ) -> f64 {
        let mut totals = vec![0.0; minibatch.len()];
        sum_over_shards(
            shards,
            threads,
            &mut totals,
            || Memory::new(self),
            |memory, shard, totals| {
                for index in shard {
                    totals[index] = self.total_spread(constants, &minibatch[index], memory) as f32;
                }
                Losses::default()
            },
        );
        let entries: usize = minibatch.iter().map(|sample| sample.action.len()).sum();
        totals.iter().map(|&total| f64::from(total)).sum::<f64>() / entries as f64
    }
}

impl Parts {
    fn find(
        settings: &TransformerSettings,
        tasks: &[TaskWords],
        parameters: &Parameters,
    ) -> Result<Self, TrainError> {
        let (sizes, places) = (&settings.sizes, Places(parameters));
        let head = |name: &str| -> Result<Head, TrainError> {
            let bias = places.range(&format!("{name}.bias"))?.start;
            Ok(Head { weight: places.range(&format!("{name}.weight"))?, bias })
        };
        let decoder = |name: &str| {
            let norm = format!("{}.norm", layout::action_decoder(settings.shared_decoder));
            Decoder::find(parameters, name, &norm, sizes.decoder_layers, sizes.heads)
        };
        let table = |task: &TaskWords| {
            let place = places.range(&layout::table_name(settings.tables, &task.task))?;
            Ok(Table { place, width: sizes.width })
        };
        Ok(Self {
            tokenizer: places.linear("features_extractor.tokenizer")?,
            encoder: Encoder::find(
                parameters,
                "mlp_extractor.encoder",
                sizes.encoder_layers,
                sizes.heads,
            )?,
            action_decoder: decoder(layout::action_decoder(settings.shared_decoder))?,
            value_decoder: if settings.shared_decoder {
                None
            } else {
                Some(decoder("mlp_extractor._value_decoder")?)
            },
            mean_head: head("action_net.0")?,
            scale_head: if settings.scaled_variance { Some(head("log_std_net.0")?) } else { None },
            value_head: head("value_net.1")?,
            log_deviation: places.range("log_std")?.start,
            tables: tasks.iter().map(table).collect::<Result<_, TrainError>>()?,
        })
    }

    fn value_decoder(&self) -> &Decoder {
        self.value_decoder.as_ref().unwrap_or(&self.action_decoder)
    }

    /// Takes the parameters of a new minibatch.
    fn load(&mut self, numbers: &[f32]) {
        self.tokenizer.load(numbers);
        self.encoder.load(numbers);
        self.action_decoder.load(numbers);
        if let Some(decoder) = &mut self.value_decoder {
            decoder.load(numbers);
        }
    }

    /// Brings the summed derivatives into the order of the parameters.
    fn finish(&self, gradient: &mut [f32]) {
        self.tokenizer.finish(gradient);
        self.encoder.finish(gradient);
        self.action_decoder.finish(gradient);
        if let Some(decoder) = &self.value_decoder {
            decoder.finish(gradient);
        }
    }
}

impl Trainable for Transformer {
    fn parameters(&self) -> &Parameters {
        &self.parameters
    }

    fn parameters_mut(&mut self) -> &mut Parameters {
        &mut self.parameters
    }

    fn action_length(&self, task: usize) -> usize {
        self.tasks[task].action_length
    }

    fn noise_length(&self, task: usize) -> usize {
        self.tasks[task].action_length
    }

    fn gradient(
        &self,
        minibatch: &[Sample<'_>],
        coefficients: &Coefficients,
        threads: usize,
        gradient: &mut Vec<f32>,
    ) -> Result<Losses, TrainError> {
        check(minibatch, coefficients, |task| self.lengths(task), self.tasks.len())?;
        let objective = Objective::new(*coefficients, minibatch);
        let constants = Constants::new(self);
        let shards = shards(minibatch.len(), 1);
        let deviations = match (self.settings.spread, &self.parts.scale_head) {
            (Spread::Minibatch, Some(_)) => Deviations::AroundMean {
                mean: self.mean_spread(&constants, minibatch, &shards, threads),
            },
            _ => Deviations::OfObservation,
        };
        let numbers = self.parameters.numbers().len();
        gradient.resize(numbers + constants.extra_length(), 0.0);
        let losses = sum_over_shards(
            &shards,
            threads,
            gradient,
            || Memory::new(self),
            |memory, shard, sums| {
                let mut losses = Losses::default();
                for sample in &minibatch[shard] {
                    let loss = self.pull(&constants, &objective, deviations, sample, memory, sums);
                    losses.add(&loss);
                }
                losses
            },
        );
        let entries: usize = minibatch.iter().map(|sample| sample.action.len()).sum();
        self.finish(&constants, deviations, entries, gradient);
        gradient.truncate(numbers);
        Ok(losses)
    }

    fn player(&self) -> Box<dyn Player + '_> {
        Box::new(TransformerPlayer::new(self))
    }

    fn description(&self) -> (Format, Scalars) {
        let mut tasks: Vec<String> = Vec::new();
        for task in &self.tasks {
            if !tasks.contains(&task.task) {
                tasks.push(task.task.clone());
            }
        }
        let scalars = Scalars {
            head_count: Some(self.settings.sizes.heads),
            policy_outputs_variance: Some(self.settings.scaled_variance),
            declared: Declared { tasks, ..Declared::default() },
            ..Scalars::default()
        };
        (Format::ArnoldTransformer, scalars)
    }
}

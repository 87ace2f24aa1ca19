//! The transformer's tensors: names and shapes of every variant, and where they start (`spec/policy.md` §1.11, §1.13,
//! §2.2).

use crate::policy::PolicyError;
use crate::policy::network::Sizes;
use crate::random::Random;
use crate::train::{Parameters, TrainError, initialisation};

use super::Spread;

const TABLES: &str = "features_extractor.positional_encoder";
/// Standard deviation of tables that are never trained.
const FROZEN_TABLE: f64 = 0.1;

/// What a transformer is made of.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TransformerSettings {
    pub sizes: Sizes,
    pub tables: Tables,
    /// Whether actor and critic share one decoder.
    pub shared_decoder: bool,
    /// Whether standard deviations are shaped by the scale head.
    pub scaled_variance: bool,
    /// Over what that shape is averaged.
    pub spread: Spread,
    /// Logarithm of the standard deviations at the start.
    pub log_deviation: f64,
}

/// Whose word embeddings a task uses.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Tables {
    /// One table for all tasks.
    #[default]
    Shared,
    /// Every task its own.
    PerTask,
    /// Every task its own, random and never trained.
    PerTaskFrozen,
}

impl TransformerSettings {
    /// The published network of these sizes.
    #[must_use]
    pub fn published(sizes: Sizes) -> Self {
        Self {
            sizes,
            tables: Tables::Shared,
            shared_decoder: false,
            scaled_variance: true,
            spread: Spread::Observation,
            log_deviation: 0.0,
        }
    }

    pub(super) fn check(&self) -> Result<(), TrainError> {
        let Sizes { vocabulary, lags, width, heads, feed_forward, encoder_layers, decoder_layers } =
            self.sizes;
        if heads == 0 || !width.is_multiple_of(heads) {
            return Err(PolicyError::Heads { heads, width }.into());
        }
        let smallest = [lags, width, feed_forward, encoder_layers, decoder_layers];
        if vocabulary < 2 || smallest.contains(&0) {
            return Err(TrainError::Sizes { what: format!("these sizes: {:?}", self.sizes) });
        }
        Ok(())
    }
}

/// The tensor that holds the embeddings for `task`.
pub(super) fn table_name(tables: Tables, task: &str) -> String {
    match tables {
        Tables::Shared => format!("{TABLES}.embedding.weight"),
        Tables::PerTask | Tables::PerTaskFrozen => {
            format!("{TABLES}.task_embeddings.{task}.weight")
        }
    }
}

/// Name of the stack that decodes actions.
pub(super) fn action_decoder(shared: bool) -> &'static str {
    if shared { "mlp_extractor.decoder" } else { "mlp_extractor._action_decoder" }
}

/// Zeros for all tensors, in the order of the published optimiser, with the further names that a checkpoint has.
pub(super) fn parameters(settings: &TransformerSettings, tasks: &[&str]) -> Parameters {
    const VALUE_NORM: &str = "mlp_extractor._value_decoder.norm.";
    let sizes = &settings.sizes;
    let shared_table = table_name(Tables::Shared, "");
    let mut shapes: Vec<(String, Vec<usize>)> = Vec::new();
    for (name, shape) in sizes.tensor_shapes() {
        if name == shared_table && settings.tables != Tables::Shared {
            for task in tasks {
                let name = table_name(settings.tables, task);
                if !shapes.iter().any(|(known, _)| *known == name) {
                    shapes.push((name, shape.clone()));
                }
            }
        } else if name.starts_with("log_std_net.") && !settings.scaled_variance
            || name.starts_with("mlp_extractor._value_decoder.") && settings.shared_decoder
            || name.starts_with(VALUE_NORM)
        {
            // Not there, or the action decoder's.
        } else if settings.shared_decoder {
            let decoder = action_decoder(true);
            shapes.push((name.replace(action_decoder(false), decoder), shape));
        } else {
            shapes.push((name, shape));
        }
    }
    let names: Vec<String> = shapes.iter().map(|(name, _)| name.clone()).collect();
    let mut parameters = Parameters::zeros(shapes);
    for name in names.iter().filter(|name| name.starts_with("features_extractor.")) {
        parameters.add_alias(format!("pi_{name}"), name);
        parameters.add_alias(format!("vf_{name}"), name);
    }
    if !settings.shared_decoder {
        for part in ["weight", "bias"] {
            let name = format!("{}.norm.{part}", action_decoder(false));
            parameters.add_alias(format!("{VALUE_NORM}{part}"), &name);
        }
    }
    if settings.tables == Tables::PerTaskFrozen {
        parameters.freeze(|name| name.starts_with(&format!("{TABLES}.task_embeddings.")));
    }
    parameters
}

/// Draws every parameter: matrices by Xavier, the rest as PyTorch's layers start. The biases of the feed-forward branches
/// are the same in all layers of a stack, because layers are copies of one.
pub(super) fn draw(
    settings: &TransformerSettings,
    parameters: &mut Parameters,
    random: &mut Random,
) {
    let Sizes { lags, width, feed_forward, .. } = settings.sizes;
    let mut branch_biases: Vec<(String, Vec<f32>)> = Vec::new();
    for place in parameters.places().to_vec() {
        let name = place.name.as_str();
        let numbers = &mut parameters.numbers_mut()[place.range.clone()];
        let last = |n: usize| name.rsplit('.').nth(n).unwrap_or_default();
        if name == "log_std" {
            numbers.fill(settings.log_deviation as f32);
        } else if name.starts_with(TABLES) {
            if settings.tables == Tables::PerTaskFrozen {
                initialisation::normal(numbers, FROZEN_TABLE, random);
            } else {
                initialisation::xavier(numbers, width, random);
            }
            numbers[..width].fill(0.0);
        } else if ["action_net", "log_std_net", "value_net"].iter().any(|net| name.starts_with(net))
        {
            initialisation::dense(numbers, width, random);
        } else if place.shape.len() >= 2 {
            initialisation::xavier(numbers, place.shape[1], random);
        } else if last(1).starts_with("norm") {
            numbers.fill(if last(0) == "weight" { 1.0 } else { 0.0 });
        } else if last(1) == "tokenizer" {
            initialisation::dense(numbers, lags, random);
        } else if last(1).starts_with("linear") {
            // The decoders are copies of one stack, too.
            let stack = if name.contains("decoder") { "decoder" } else { "encoder" };
            let template = format!("{stack}.{}", last(1));
            let known = branch_biases.iter().find(|(known, _)| *known == template);
            if let Some((_, bias)) = known {
                numbers.copy_from_slice(bias);
            } else {
                let inputs = if last(1) == "linear1" { width } else { feed_forward };
                initialisation::dense(numbers, inputs, random);
                branch_biases.push((template, numbers.to_vec()));
            }
        }
        // Biases of attention stay zero.
    }
}

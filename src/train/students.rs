//! The network that a recipe asks for, before its first step.

use super::network::mlp::{Mlp, MlpSettings, SubspaceSettings};
use super::network::transformer::{TaskWords, Transformer, TransformerSettings};
use super::recipe::{NetworkShape, PerceptronShape, SubspaceShape, TransformerShape};
use super::statistics::Statistics;
use super::streams::{Purpose, Streams};
use super::{TrainError, Trainable};
use crate::policy::TaskInterface;
use crate::policy::network::Sizes;
use crate::policy::vocabulary::Vocabulary;

/// A network for `tasks`, and the statistics of what it sees.
pub(super) fn student(
    shape: &NetworkShape,
    tasks: &[TaskInterface],
    streams: Streams,
) -> Result<(Box<dyn Trainable>, Statistics), TrainError> {
    match shape {
        NetworkShape::Perceptron(shape) => perceptron(shape, tasks, streams),
        NetworkShape::Transformer(shape) => transformer(shape, tasks, streams),
    }
}

fn perceptron(
    shape: &PerceptronShape,
    tasks: &[TaskInterface],
    streams: Streams,
) -> Result<(Box<dyn Trainable>, Statistics), TrainError> {
    let [task] = tasks else {
        let what = format!("a perceptron learns one task, not {}", tasks.len());
        return Err(TrainError::Plan { what });
    };
    let settings = MlpSettings {
        observations: task.clean_observation_length,
        muscles: task.muscle_count,
        policy_layers: shape.hidden.clone(),
        value_layers: shape.hidden.clone(),
        activation: shape.activation,
        log_deviation: shape.log_deviation,
        lattice: shape.lattice,
        subspace: shape
            .subspace
            .map(|SubspaceShape { size, trainable }| SubspaceSettings { size, trainable }),
        ..MlpSettings::default()
    };
    let network = Mlp::new(settings, &mut streams.of(Purpose::Initialisation, [0, 0]))?;
    Ok((Box::new(network), Statistics::of_components(task)))
}

fn transformer(
    shape: &TransformerShape,
    tasks: &[TaskInterface],
    streams: Streams,
) -> Result<(Box<dyn Trainable>, Statistics), TrainError> {
    let sizes = Sizes {
        vocabulary: Vocabulary::standard().len(),
        lags: shape.lags,
        width: shape.width,
        heads: shape.heads,
        feed_forward: shape.feed_forward,
        encoder_layers: shape.layers,
        decoder_layers: shape.layers,
    };
    let log_deviation = shape.log_deviation;
    let settings = TransformerSettings { log_deviation, ..TransformerSettings::published(sizes) };
    let largest = tasks.iter().map(|task| task.muscle_count).max().unwrap_or(0);
    let words = |task: &TaskInterface| TaskWords {
        task: task.task.clone(),
        sensors: task.observation_words.clone(),
        muscles: task.action_words.clone(),
        action_length: if shape.padded_actions { largest } else { task.muscle_count },
    };
    let words = tasks.iter().map(words).collect();
    let mut random = streams.of(Purpose::Initialisation, [0, 0]);
    let network = Transformer::new(settings, words, &mut random)?;
    Ok((Box::new(network), Statistics::of_signatures(tasks, shape.lags)))
}

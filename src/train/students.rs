//! The network that a recipe asks for, before its first step.

use super::network::mlp::{Mlp, MlpSettings, SubspaceSettings};
use super::network::padded_input::PaddedInput;
use super::network::transformer::{TaskWords, Transformer, TransformerSettings};
use super::recipe::{NetworkShape, PerceptronShape, SubspaceShape, TransformerShape, WindowsShape};
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
    let (input, statistics) = if let Some(windows) = shape.windows {
        padded(windows, tasks)
    } else {
        let [task] = tasks else {
            let what = format!("a perceptron learns one task, not {}", tasks.len());
            return Err(TrainError::Plan { what });
        };
        let input = PaddedInput::new(vec![task.clean_observation_length]);
        (input, Statistics::of_components(task))
    };
    let settings = MlpSettings {
        input: Some(input),
        muscles: most_muscles(tasks),
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
    Ok((Box::new(network), statistics))
}

/// What a perceptron sees of several tasks, and its statistics.
pub(super) fn padded(shape: WindowsShape, tasks: &[TaskInterface]) -> (PaddedInput, Statistics) {
    let lengths = tasks.iter().map(|task| task.observation_words.len() * shape.lags).collect();
    let mut input = PaddedInput::new(lengths);
    if shape.task_index {
        input = input.with_index(tasks.iter().map(|task| task.task.clone()).collect());
    }
    (input, Statistics::of_signatures(tasks, shape.lags))
}

/// Muscles of the body that has most.
pub(super) fn most_muscles(tasks: &[TaskInterface]) -> usize {
    tasks.iter().map(|task| task.muscle_count).max().unwrap_or(0)
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
    let largest = most_muscles(tasks);
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::checkpoint::contents::{Activation, Checkpoint};
    use crate::policy::history::History;
    use crate::policy::{self, ObservationVariant};
    use crate::random::Random;
    use crate::train::Player;
    use crate::train::network::soft::{SoftActorCritic, SoftPlayer, SoftSettings};

    const LAGS: usize = 3;

    /// Two tasks; they share some of their words.
    fn tasks() -> Vec<TaskInterface> {
        let task = |name: &str, sensors: usize, muscle_count: usize| TaskInterface {
            task: name.to_owned(),
            muscle_count,
            muscle_observation_length: sensors,
            clean_observation_length: sensors,
            observation_words: (0..sensors).map(|i| vec![2 + i as u16, 9]).collect(),
            action_words: vec![Vec::new(); muscle_count],
            muscle_models: Vec::new(),
        };
        vec![task("small", 3, 2), task("large", 5, 4)]
    }

    /// Plays both tasks in training and as `policy` reads it back, by mean actions.
    fn assert_played_alike(
        player: &mut dyn Player,
        statistics: &mut Statistics,
        checkpoint: &Checkpoint,
    ) {
        let mut random = Random::new([8; 32]);
        let tasks = tasks();
        let mut histories: Vec<History> = tasks
            .iter()
            .map(|task| History::new(1, task.muscle_observation_length, LAGS))
            .collect();
        let mut shown: Vec<Vec<Vec<f32>>> = vec![Vec::new(); tasks.len()];
        for _ in 0..5 {
            for (task, history) in histories.iter_mut().enumerate() {
                let sensors = tasks[task].muscle_observation_length;
                let raw: Vec<f32> = (0..sensors).map(|_| 3.0 * random.normal() as f32).collect();
                history.push(0, &raw);
                shown[task].push(raw);
            }
            let seen: Vec<(usize, &[f32])> =
                histories.iter().enumerate().map(|(task, h)| (task, h.windows(0))).collect();
            statistics.update(&seen);
        }
        let policy = policy::load(checkpoint, Some(&statistics.to_stored())).unwrap();
        assert_eq!(policy.variant(), ObservationVariant::Muscle);
        for (index, task) in tasks.iter().enumerate() {
            let mut actor = policy.bind(task, 1).unwrap();
            actor.reset(0);
            let mut expected = vec![0.0; task.muscle_count];
            for raw in &shown[index] {
                actor.act(&[0], raw, &mut expected, None);
            }
            let windows = histories[index].windows(0);
            let mut normalised = vec![0.0; windows.len()];
            statistics.normalise(index, windows, &mut normalised);
            let mut action = [0.0; 4];
            player.decide(index, &normalised, &[0.0; 4], &mut action);
            for (found, expected) in action.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-6, "{action:?}, {expected:?}");
            }
        }
    }

    #[test]
    fn perceptrons_of_several_tasks_play_as_they_were_trained() {
        for task_index in [false, true] {
            let windows = Some(WindowsShape { lags: LAGS, task_index });
            let hidden = vec![8, 7];
            let shape = PerceptronShape { hidden, windows, ..PerceptronShape::default() };
            let (network, mut statistics) =
                perceptron(&shape, &tasks(), Streams { seed: 3 }).unwrap();
            let checkpoint = network.checkpoint();
            assert_played_alike(network.player().as_mut(), &mut statistics, &checkpoint);
        }
    }

    #[test]
    fn soft_actors_of_several_tasks_play_as_they_were_trained() {
        for task_index in [false, true] {
            let (input, mut statistics) = padded(WindowsShape { lags: LAGS, task_index }, &tasks());
            let (hidden, activation) = (vec![8, 7], Activation::Relu);
            let settings = SoftSettings { input, actions: 4, hidden, activation };
            let network = SoftActorCritic::new(settings, &mut Random::new([1; 32])).unwrap();
            let checkpoint = network.checkpoint();
            assert_played_alike(&mut SoftPlayer::new(&network), &mut statistics, &checkpoint);
        }
    }
}

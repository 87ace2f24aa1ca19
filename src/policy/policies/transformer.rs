//! Plays the muscle transformer: history window, normaliser, network.

use std::sync::Arc;

use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::SignatureStatistics;
use crate::policy::history::History;
use crate::policy::interface::{Actor, ObservationVariant, Policy, TaskInterface};
use crate::policy::network::transformer::{TaskConstants, Transformer, Workspace};
use crate::policy::normaliser::SignatureNormaliser;
use crate::policy::speech::{Descriptions, Speech};

/// A muscle transformer with the normaliser it was trained with.
#[derive(Debug, Clone)]
pub struct TransformerPolicy {
    network: Arc<Transformer>,
    speech: Speech,
}

impl TransformerPolicy {
    /// Refuses statistics that do not fit the network.
    pub fn new(network: Transformer, statistics: SignatureStatistics) -> Result<Self, PolicyError> {
        let speech = Speech::new(statistics, network.sizes().lags)?;
        Ok(Self::speaking(network, speech))
    }

    /// From a network and what its words mean.
    pub(in crate::policy) fn speaking(network: Transformer, speech: Speech) -> Self {
        Self { network: Arc::new(network), speech }
    }

    #[must_use]
    pub fn network(&self) -> &Transformer {
        &self.network
    }

    /// The normaliser for tokens described by `words`.
    pub(in crate::policy) fn normaliser(&self, words: &[Vec<u16>]) -> SignatureNormaliser {
        self.speech.normaliser(words)
    }
}

impl Policy for TransformerPolicy {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Muscle
    }

    fn bind(&self, task: &TaskInterface, slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        let Descriptions { sensors, muscles } = self.speech.describe(task)?;
        let constants = self.network.prepare(&task.task, &sensors, &muscles, false)?;
        let lags = self.network.sizes().lags;
        let workspace = self.network.workspace(&constants);
        Ok(Box::new(TransformerActor {
            network: Arc::clone(&self.network),
            normaliser: self.normaliser(&task.observation_words),
            history: History::new(slots, task.muscle_observation_length, lags),
            windows: vec![0.0; task.muscle_observation_length * lags],
            muscle_count: task.muscle_count,
            constants,
            workspace,
        }))
    }

    fn warnings(&self, task: &TaskInterface) -> Vec<String> {
        self.speech.warnings(task)
    }

    fn trained_tasks(&self) -> &[String] {
        self.speech.trained_tasks()
    }
}

struct TransformerActor {
    network: Arc<Transformer>,
    constants: TaskConstants,
    normaliser: SignatureNormaliser,
    history: History,
    /// Normalised windows of the body that acts.
    windows: Vec<f32>,
    workspace: Workspace,
    muscle_count: usize,
}

impl Actor for TransformerActor {
    fn reset(&mut self, slot: usize) {
        self.history.clear(slot);
    }

    fn act(
        &mut self,
        slots: &[usize],
        observations: &[f32],
        action_means: &mut [f32],
        mut standard_deviations: Option<&mut [f32]>,
    ) {
        let sensors = self.windows.len() / self.network.sizes().lags;
        for (row, &slot) in slots.iter().enumerate() {
            let newest = &observations[row * sensors..(row + 1) * sensors];
            let muscles = row * self.muscle_count..(row + 1) * self.muscle_count;
            self.normaliser.apply(self.history.push(slot, newest), &mut self.windows);
            self.network.encode(&self.constants, &self.windows, &mut self.workspace);
            let means = &mut action_means[muscles.clone()];
            self.network.action_means(&self.constants, &mut self.workspace, means);
            if let Some(deviations) = &mut standard_deviations {
                self.network.standard_deviations(&self.workspace, &mut deviations[muscles]);
            }
        }
    }

    fn clips_actions(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;
    use crate::policy::checkpoint::contents::{Tensor, TensorMap};
    use crate::policy::network::Sizes;

    const SIZES: Sizes = Sizes {
        vocabulary: 20,
        lags: 3,
        width: 16,
        heads: 2,
        feed_forward: 24,
        encoder_layers: 2,
        decoder_layers: 2,
    };
    const SENSORS: usize = 7;
    const MUSCLES: usize = 5;

    fn tensors() -> TensorMap {
        let shapes = SIZES.tensor_shapes().into_iter().enumerate();
        shapes
            .map(|(seed, (name, shape))| {
                let count: usize = shape.iter().product();
                let wave = |i: usize| 0.3 * (i as f32 * 0.61 + seed as f32).sin();
                (name, Tensor { shape, data: (0..count).map(wave).collect() })
            })
            .collect()
    }

    fn statistics() -> SignatureStatistics {
        SignatureStatistics {
            signatures: vec![vec![0], vec![2, 3]],
            mean: vec![0.0, 0.0, 0.0, 0.1, 0.2, 0.3],
            variance: vec![1.0, 1.0, 1.0, 2.0, 3.0, 4.0],
            count: vec![1.0, 100.0],
            lags: 3,
            epsilon: 1e-8,
            clip: 10.0,
            enabled: true,
        }
    }

    fn policy() -> TransformerPolicy {
        let network = Transformer::from_tensors(&tensors(), SIZES.heads, true).unwrap();
        TransformerPolicy::new(network, statistics()).unwrap()
    }

    fn task() -> TaskInterface {
        TaskInterface {
            task: "test".to_owned(),
            muscle_count: MUSCLES,
            muscle_observation_length: SENSORS,
            clean_observation_length: 0,
            observation_words: (0..SENSORS).map(|i| vec![2, 3 + i as u16]).collect(),
            action_words: (0..MUSCLES).map(|i| vec![10 + i as u16]).collect(),
            muscle_models: Vec::new(),
        }
    }

    fn observation(body: usize, step: usize) -> Vec<f32> {
        (0..SENSORS).map(|i| ((body * 31 + step * 7 + i) as f32 * 0.37).sin()).collect()
    }

    /// Means and deviations of `body` played on its own, step by step.
    fn played_alone(body: usize, steps: usize) -> Vec<Vec<f32>> {
        let mut actor = policy().bind(&task(), 1).unwrap();
        let play = |step| {
            let (mut means, mut deviations) = (vec![0.0; MUSCLES], vec![0.0; MUSCLES]);
            actor.act(&[0], &observation(body, step), &mut means, Some(&mut deviations));
            means.extend(deviations);
            means
        };
        (0..steps).map(play).collect()
    }

    proptest! {
        #![proptest_config(ProptestConfig { cases: 12, ..ProptestConfig::default() })]

        /// Bodies come in any order and number, each at its own step of its own episode.
        #[test]
        fn a_row_does_not_depend_on_its_batch(
            batches in proptest::collection::vec(
                Just((0..4_usize).collect::<Vec<_>>())
                    .prop_shuffle()
                    .prop_flat_map(|order| (1..=4_usize).prop_map(move |n| order[..n].to_vec())),
                1..8,
            ),
        ) {
            let alone: Vec<_> = (0..4).map(|body| played_alone(body, batches.len())).collect();
            let mut actor = policy().bind(&task(), 4).unwrap();
            let mut steps = [0; 4];
            for slots in batches {
                let observations: Vec<f32> =
                    slots.iter().flat_map(|&slot| observation(slot, steps[slot])).collect();
                let mut means = vec![0.0; slots.len() * MUSCLES];
                let mut deviations = means.clone();
                actor.act(&slots, &observations, &mut means, Some(&mut deviations));
                for (row, &slot) in slots.iter().enumerate() {
                    let columns = row * MUSCLES..(row + 1) * MUSCLES;
                    let got = [&means[columns.clone()], &deviations[columns]].concat();
                    let bits = |row: &[f32]| row.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                    prop_assert_eq!(bits(&got), bits(&alone[slot][steps[slot]]));
                    steps[slot] += 1;
                }
            }
        }
    }

    #[test]
    fn a_reset_forgets_the_episode() {
        let mut actor = policy().bind(&task(), 1).unwrap();
        let mut first = vec![0.0; MUSCLES];
        actor.act(&[0], &observation(0, 0), &mut first, None);
        let mut second = vec![0.0; MUSCLES];
        actor.act(&[0], &observation(0, 0), &mut second, None);
        assert_ne!(first, second, "the window did not move");
        actor.reset(0);
        actor.act(&[0], &observation(0, 0), &mut second, None);
        assert_eq!(first, second);
    }

    #[test]
    fn standard_deviations_average_to_the_base() {
        let mut actor = policy().bind(&task(), 1).unwrap();
        let (mut means, mut deviations) = (vec![0.0; MUSCLES], vec![0.0; MUSCLES]);
        actor.act(&[0], &observation(0, 0), &mut means, Some(&mut deviations));
        let base = tensors()["log_std"].data[0].exp();
        let mean = deviations.iter().sum::<f32>() / MUSCLES as f32;
        assert!((mean - base).abs() < 1e-6 * base, "{mean} instead of {base}");
        assert!(deviations.iter().any(|d| (d - base).abs() > 1e-4), "{deviations:?}");
    }

    #[test]
    fn a_shared_decoder_serves_actor_and_critic() {
        let separate = tensors();
        let shared: TensorMap = separate
            .iter()
            .filter(|(name, _)| !name.contains("_value_decoder"))
            .map(|(name, tensor)| (name.replace("_action_decoder", "decoder"), tensor.clone()))
            .collect();
        let separate = Transformer::from_tensors(&separate, SIZES.heads, true).unwrap();
        let shared = Transformer::from_tensors(&shared, SIZES.heads, true).unwrap();
        let run = |network: &Transformer| {
            let (sensors, muscles) = (task().observation_words, task().action_words);
            let task = network.prepare("test", &sensors, &muscles, false).unwrap();
            let mut workspace = network.workspace(&task);
            let mut means = vec![0.0; MUSCLES];
            network.encode(&task, &[0.5; SENSORS * 3], &mut workspace);
            network.action_means(&task, &mut workspace, &mut means);
            (means, network.value(&task, &mut workspace))
        };
        let ((means, value), (shared_means, shared_value)) = (run(&separate), run(&shared));
        assert_eq!(means, shared_means);
        assert!((value - shared_value).abs() > 1e-6, "the value decoders are the same");
    }

    #[test]
    fn damaged_tensors_are_named() {
        for name in ["action_net.0.weight", "mlp_extractor.encoder.layers.1.linear1.bias"] {
            let refusal = |tensors: &TensorMap| {
                Transformer::from_tensors(tensors, SIZES.heads, true).unwrap_err()
            };
            let mut missing = tensors();
            missing.remove(name);
            assert!(
                matches!(refusal(&missing), PolicyError::MissingTensor { name: n } if n == name)
            );
            let mut short = tensors();
            let tensor = short.get_mut(name).unwrap();
            tensor.shape = vec![3];
            tensor.data.truncate(3);
            let message = refusal(&short).to_string();
            assert!(message.contains(name) && message.contains("[3]"), "{message}");
            let mut infinite = tensors();
            infinite.get_mut(name).unwrap().data[1] = f32::INFINITY;
            assert!(matches!(refusal(&infinite), PolicyError::NotFinite { name: n } if n == name));
        }
        let error = Transformer::from_tensors(&tensors(), 3, true).unwrap_err();
        assert!(matches!(error, PolicyError::Heads { heads: 3, width: 16 }));
    }

    #[test]
    fn a_task_that_does_not_fit_is_refused_with_both_numbers() {
        let mut short = task();
        short.observation_words.pop();
        let message = policy().bind(&short, 1).err().unwrap().to_string();
        assert!(message.contains('6') && message.contains('7'), "{message}");
        let mut foreign = task();
        foreign.action_words[0] = vec![20];
        let message = policy().bind(&foreign, 1).err().unwrap().to_string();
        assert!(message.contains("20"), "{message}");
    }

    #[test]
    fn sensors_unknown_to_the_normaliser_are_reported_by_name() {
        let warnings = policy().warnings(&task());
        assert_eq!(warnings.len(), SENSORS - 1);
        assert!(warnings[0].contains("extn adabL"), "{}", warnings[0]);
    }
}

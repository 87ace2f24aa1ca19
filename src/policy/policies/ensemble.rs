//! Plays an ensemble of recurrent policies with a classifier (`spec/policy.md` §4.6): the action is the mean of what the
//! networks of one group would do.
//!
//! Each episode begins with the base group. The classifier looks at a slice of the first thirteen raw observations; if
//! it says "hold", the hold group takes over in that very step, its recurrent states fresh, and keeps the body until
//! the episode ends.

use std::sync::Arc;

use super::check_sizes;
use super::recurrent::RecurrentPolicy;
use crate::policy::PolicyError;
use crate::policy::checkpoint::Scaler;
use crate::policy::checkpoint::contents::{Activation, TensorMap};
use crate::policy::interface::{Actor, ObservationVariant, Policy, TaskInterface};
use crate::policy::network::mlp::{Mlp, MlpScratch};
use crate::policy::network::weights::Weights;

/// Components that the classifier looks at: positions and velocities of the balls.
const SLICE: std::ops::Range<usize> = 29..47;
/// Observations that it looks at, the first of the episode included.
const STEPS: usize = 13;
const FEATURES: usize = STEPS * (SLICE.end - SLICE.start);

/// Two groups of recurrent policies and what chooses between them.
#[derive(Debug, Clone)]
pub struct EnsemblePolicy {
    base: Vec<RecurrentPolicy>,
    hold: Vec<RecurrentPolicy>,
    classifier: Arc<Classifier>,
}

/// A perceptron with one output on scaled features.
#[derive(Debug, Clone)]
pub struct Classifier {
    scaler: Scaler,
    layers: Mlp,
}

impl Classifier {
    /// Reads the layers off a checkpoint's tensors.
    pub fn new(tensors: &TensorMap, scaler: Scaler) -> Result<Self, PolicyError> {
        let names = ["layer_1", "layer_2", "layer_out"].map(str::to_owned);
        let layers = Mlp::read(Weights(tensors), &names, FEATURES, Activation::Relu, false)?;
        if layers.outputs(FEATURES) != 1 {
            let (expected, found) = ("[1, …]".to_owned(), vec![layers.outputs(FEATURES)]);
            let name = "layer_out.weight".to_owned();
            return Err(PolicyError::TensorShape { name, expected, found });
        }
        if scaler.mean.len() != FEATURES {
            let (expected, found) = (FEATURES, scaler.mean.len());
            return Err(PolicyError::NormaliserLength { expected, found });
        }
        Ok(Self { scaler, layers })
    }

    /// Whether the hold group plays on. One half rounds to zero, "hold".
    fn says_hold(&self, features: &[f32], scaled: &mut [f32], scratch: &mut MlpScratch) -> bool {
        let constants = self.scaler.mean.iter().zip(&self.scaler.scale);
        for ((x, &feature), (mean, scale)) in scaled.iter_mut().zip(features).zip(constants) {
            *x = ((f64::from(feature) - mean) / scale) as f32;
        }
        let logit = self.layers.apply(scaled, scratch)[0];
        1.0 / (1.0 + (-logit).exp()) <= 0.5
    }
}

impl EnsemblePolicy {
    /// Neither group may be empty, and all networks must have the same sizes.
    pub fn new(
        base: Vec<RecurrentPolicy>,
        hold: Vec<RecurrentPolicy>,
        classifier: Classifier,
    ) -> Result<Self, PolicyError> {
        let sizes = |policy: &RecurrentPolicy| {
            (policy.network().observation_length(), policy.network().muscle_count())
        };
        let mut all = base.iter().chain(&hold).map(sizes);
        let first = all.next();
        if base.is_empty() || hold.is_empty() || all.any(|other| Some(other) != first) {
            let what =
                "ensemble without a network in each group, or with networks of different sizes";
            return Err(PolicyError::Unsupported { what: what.to_owned() });
        }
        if first.is_some_and(|(observations, _)| observations < SLICE.end) {
            let what = format!("ensemble that observes fewer than {} components", SLICE.end);
            return Err(PolicyError::Unsupported { what });
        }
        Ok(Self { base, hold, classifier: Arc::new(classifier) })
    }
}

impl Policy for EnsemblePolicy {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Clean
    }

    fn is_stochastic(&self) -> bool {
        false
    }

    fn bind(&self, task: &TaskInterface, slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        let network = self.base[0].network();
        let (observation_length, muscles) = (network.observation_length(), network.muscle_count());
        check_sizes(task, observation_length, muscles)?;
        let bind = |group: &[RecurrentPolicy]| {
            group.iter().map(|policy| policy.bind(task, slots)).collect::<Result<Vec<_>, _>>()
        };
        Ok(Box::new(EnsembleActor {
            base: bind(&self.base)?,
            hold: bind(&self.hold)?,
            bodies: vec![Body { seen: Vec::with_capacity(FEATURES), holds: false }; slots],
            observation_length,
            action: vec![0.0; muscles],
            scaled: vec![0.0; FEATURES],
            scratch: self.classifier.layers.scratch(),
            classifier: Arc::clone(&self.classifier),
        }))
    }
}

struct EnsembleActor {
    base: Vec<Box<dyn Actor>>,
    hold: Vec<Box<dyn Actor>>,
    classifier: Arc<Classifier>,
    bodies: Vec<Body>,
    observation_length: usize,
    /// Of one network.
    action: Vec<f32>,
    scaled: Vec<f32>,
    scratch: MlpScratch,
}

/// What the classifier has seen of one body, and what it said.
#[derive(Debug, Clone)]
struct Body {
    seen: Vec<f32>,
    holds: bool,
}

impl Actor for EnsembleActor {
    fn reset(&mut self, slot: usize) {
        let body = &mut self.bodies[slot];
        body.seen.clear();
        body.holds = false;
        for actor in self.base.iter_mut().chain(&mut self.hold) {
            actor.reset(slot);
        }
    }

    fn act(
        &mut self,
        slots: &[usize],
        observations: &[f32],
        action_means: &mut [f32],
        mut standard_deviations: Option<&mut [f32]>,
    ) {
        let rows = observations.chunks_exact(self.observation_length);
        let means = action_means.chunks_exact_mut(self.action.len());
        for ((&slot, observation), mean) in slots.iter().zip(rows).zip(means) {
            let body = &mut self.bodies[slot];
            if body.seen.len() < FEATURES {
                body.seen.extend_from_slice(&observation[SLICE]);
                if body.seen.len() == FEATURES {
                    body.holds =
                        self.classifier.says_hold(&body.seen, &mut self.scaled, &mut self.scratch);
                }
            }
            let group = if body.holds { &mut self.hold } else { &mut self.base };
            let share = 1.0 / group.len() as f32;
            mean.fill(0.0);
            for actor in group {
                actor.act(&[slot], observation, &mut self.action, None);
                for (mean, action) in mean.iter_mut().zip(&self.action) {
                    *mean += share * action.clamp(-1.0, 1.0);
                }
            }
        }
        if let Some(deviations) = &mut standard_deviations {
            deviations.fill(f32::NAN);
        }
    }

    fn clips_actions(&self) -> bool {
        true
    }
}

//! What is told of every step of an episode that is watched, whether its frame is shown or not.
//!
//! A frame needs a copied state and a puppet. These are a few numbers per muscle and joint, so plots and map have every step,
//! however few frames the viewer has time for.

use crate::sim::environment::Environment;
use crate::sim::watching::Stepped;

use super::gait::Walked;

/// Steps in a row, the values of one after those of the other.
#[derive(Debug, Clone, Default, PartialEq)]
pub(super) struct Told {
    pub(super) steps: Vec<usize>,
    /// Muscle activation, 0..1.
    pub(super) activation: Vec<f32>,
    /// The action with its noise, before any projection.
    pub(super) chosen: Vec<f32>,
    /// What was sent to the body.
    pub(super) action: Vec<f32>,
    /// Positions of all joints, rad or m; a free object has seven numbers.
    pub(super) positions: Vec<f64>,
    pub(super) reward_components: Vec<f64>,
    pub(super) reward: Vec<f64>,
    pub(super) solved: Vec<bool>,
    pub(super) walked: Walked,
}

impl Told {
    /// Takes in the step that `environment` just made.
    pub(super) fn take_in(&mut self, environment: &Environment, stepped: &Stepped<'_>) {
        let body = environment.simulation();
        self.steps.push(stepped.step);
        self.activation.extend(body.activation().iter().map(|&activation| activation as f32));
        self.chosen.extend_from_slice(stepped.chosen);
        self.action.extend_from_slice(stepped.action);
        self.positions.extend_from_slice(body.qpos());
        self.reward_components.extend_from_slice(environment.components());
        self.reward.push(stepped.outcome.reward);
        self.solved.push(stepped.outcome.solved);
        self.walked.feel(environment);
    }

    /// The part of `values` that belongs to the step at `place`.
    pub(super) fn row<'a, T>(&self, values: &'a [T], place: usize) -> &'a [T] {
        let width = values.len() / self.steps.len().max(1);
        &values[place * width..(place + 1) * width]
    }
}

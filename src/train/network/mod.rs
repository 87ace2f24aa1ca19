//! The networks that can be trained, each with hand-written derivatives.
//!
//! * [`mlp`]: Stable-Baselines3's actor-critic, with lattice exploration or a control subspace if asked.
//! * [`soft`]: a soft actor-critic of perceptrons.
//! * [`transformer`]: the muscle transformer, in every variant that `policy` reads.

mod check;
mod dense;
#[cfg(test)]
mod differences;
pub mod mlp;
pub mod padded_input;
pub mod soft;
mod subspace;
pub mod transformer;

use super::{Coefficients, Losses, Parameters, Sample, TrainError};
use crate::policy::checkpoint::contents::{Checkpoint, Format, Scalars};

/// A network with derivatives.
pub trait Trainable: Send + Sync {
    fn parameters(&self) -> &Parameters;

    fn parameters_mut(&mut self) -> &mut Parameters;

    /// Numbers of an action in `task`, padding included.
    fn action_length(&self, task: usize) -> usize;

    /// Normal numbers that draw an action in `task`.
    fn noise_length(&self, task: usize) -> usize;

    /// The losses of `minibatch`, and their derivative by every parameter in `gradient`. The result does not depend on
    /// `threads`.
    fn gradient(
        &self,
        minibatch: &[Sample<'_>],
        coefficients: &Coefficients,
        threads: usize,
        gradient: &mut Vec<f32>,
    ) -> Result<Losses, TrainError>;

    /// Plays with the parameters as they are now. Every thread makes its own.
    fn player(&self) -> Box<dyn Player + '_>;

    /// The family of files that a checkpoint of it belongs to, and what its tensors do not tell.
    fn description(&self) -> (Format, Scalars);

    /// What `policy` reads back.
    fn checkpoint(&self) -> Checkpoint {
        let (format, scalars) = self.description();
        Checkpoint {
            format,
            tensors: self.parameters().tensors(),
            aliases: self.parameters().aliases().clone(),
            scalars,
            globals: Vec::new(),
        }
    }
}

/// A network at work: forward only, one observation at a time, so that no row depends on another.
pub trait Player {
    /// Draws an action for one normalised observation; without noise (all zeros) it is the mean.
    fn decide(
        &mut self,
        task: usize,
        observation: &[f32],
        noise: &[f32],
        action: &mut [f32],
    ) -> Decision;

    /// The value of one normalised observation.
    fn value(&mut self, task: usize, observation: &[f32]) -> f32;
}

/// What goes into the buffer beside the action.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Decision {
    pub log_probability: f32,
    pub value: f32,
}

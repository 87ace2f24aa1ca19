//! The actor over the rows of a shard: what it draws, how likely that is, and the way back.
//!
//! With ξ fixed, `∂ ln π/∂μ = c` and `∂ ln π/∂ ln σ = cσξ − 1`, where `c = 2a(1 − a²)/(1 − a² + 10⁻⁶)`, and `∂a/∂g = 1 − a²`.

use std::ops::Range;

use super::critics::CriticMemory;
use super::{SoftActorCritic, SoftLosses, Transitions};
use crate::train::distribution::HALF_LOG_TAU;
use crate::train::network::dense::StackMemory;

/// Bounds of the logarithm of a standard deviation.
const LOG_DEVIATION: [f32; 2] = [-20.0, 2.0];
/// Added to `1 − a²` before the logarithm.
const SQUASH_EPSILON: f64 = 1e-6;

/// One thread's memory for a shard.
pub(super) struct ActorMemory {
    hidden: StackMemory,
    /// Before the squashing.
    means: Vec<f32>,
    /// Before they are held between their bounds.
    log_deviations: Vec<f32>,
    pub(super) actions: Vec<f32>,
    pub(super) log_probabilities: Vec<f64>,
    mean_slopes: Vec<f32>,
    log_deviation_slopes: Vec<f32>,
    latent_slopes: Vec<f32>,
    other_slopes: Vec<f32>,
}

impl SoftActorCritic {
    pub(super) fn actor_memory(&self, rows: usize) -> ActorMemory {
        let actions = vec![0.0; rows * self.settings.actions];
        let latents = vec![0.0; rows * self.mean.inputs];
        ActorMemory {
            hidden: self.hidden.memory(rows),
            means: actions.clone(),
            log_deviations: actions.clone(),
            actions: actions.clone(),
            log_probabilities: vec![0.0; rows],
            mean_slopes: actions.clone(),
            log_deviation_slopes: actions,
            latent_slopes: latents.clone(),
            other_slopes: latents,
        }
    }

    /// Draws an action in each of `rows` states.
    pub(super) fn act(&self, states: &[f32], noise: &[f32], rows: usize, memory: &mut ActorMemory) {
        let numbers = self.actor.numbers();
        let ActorMemory { hidden, means, log_deviations, actions, log_probabilities, .. } = memory;
        let columns = rows * self.settings.actions;
        let latent = self.hidden.forward(numbers, states, rows, hidden);
        self.mean.forward(numbers, latent, &mut means[..columns]);
        self.log_deviation.forward(numbers, latent, &mut log_deviations[..columns]);
        let width = self.settings.actions;
        for (row, log_probability) in log_probabilities[..rows].iter_mut().enumerate() {
            *log_probability = 0.0;
            for column in row * width..(row + 1) * width {
                let log = held(log_deviations[column]);
                let action = (means[column] + log.exp() * noise[column]).tanh();
                let (xi, a) = (f64::from(noise[column]), f64::from(action));
                *log_probability += -0.5 * xi * xi - f64::from(log) - HALF_LOG_TAU;
                *log_probability -= (1.0 - a * a + SQUASH_EPSILON).ln();
                actions[column] = action;
            }
        }
    }

    /// Adds the derivatives of the actor's loss for the rows `shard`.
    pub(super) fn pull_actor(
        &self,
        batch: &Transitions,
        shard: Range<usize>,
        temperature: f64,
        (memory, critics): (&mut ActorMemory, &mut CriticMemory),
        gradient: &mut [f32],
    ) -> SoftLosses {
        let (rows, width) = (shard.len(), self.settings.actions);
        let states = super::critics::rows_of(&batch.states, &shard, self.settings.input.width());
        let noise = super::critics::rows_of(&batch.noise, &shard, width);
        self.act(states, noise, rows, memory);
        self.judge_and_pull(states, &memory.actions[..rows * width], critics);
        let share = 1.0 / batch.len() as f64;
        let mut losses = SoftLosses::default();
        for (&value, log_probability) in critics.worth[..rows].iter().zip(&memory.log_probabilities)
        {
            losses.actor += share * (temperature * log_probability - f64::from(value));
            losses.log_probability += share * log_probability;
        }
        for (column, &xi) in noise.iter().enumerate() {
            let log = memory.log_deviations[column];
            let drawn = f64::from(held(log).exp()) * f64::from(xi);
            let a = f64::from(memory.actions[column]);
            let rest = 1.0 - a * a;
            let by_likelihood = 2.0 * a * rest / (rest + SQUASH_EPSILON);
            let judgement = f64::from(critics.action_slopes[column]) * rest;
            let slope = share * (temperature * by_likelihood - judgement);
            memory.mean_slopes[column] = slope as f32;
            let is_free = (LOG_DEVIATION[0]..=LOG_DEVIATION[1]).contains(&log);
            memory.log_deviation_slopes[column] =
                if is_free { (slope * drawn - share * temperature) as f32 } else { 0.0 };
        }
        let numbers = self.actor.numbers();
        let latent = memory.hidden.latent(states, rows, &self.hidden);
        let latents = rows * self.mean.inputs;
        for (head, slopes, latent_slopes) in [
            (&self.mean, &memory.mean_slopes, &mut memory.latent_slopes),
            (&self.log_deviation, &memory.log_deviation_slopes, &mut memory.other_slopes),
        ] {
            let slopes = &slopes[..rows * width];
            head.pull_weight(latent, slopes, gradient);
            head.pull_input(numbers, slopes, &mut latent_slopes[..latents]);
        }
        let latent_slopes = &mut memory.latent_slopes[..latents];
        latent_slopes.iter_mut().zip(&memory.other_slopes).for_each(|(a, b)| *a += b);
        self.hidden.backward(numbers, states, rows, latent_slopes, &mut memory.hidden, gradient);
        losses
    }
}

/// A logarithm between its bounds.
fn held(log: f32) -> f32 {
    log.clamp(LOG_DEVIATION[0], LOG_DEVIATION[1])
}

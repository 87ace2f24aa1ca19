//! The actor at work, one observation at a time, and what plays before it has learned anything.

use super::SoftActorCritic;
use super::actor::ActorMemory;
use super::critics::CriticMemory;
use crate::train::network::{Decision, Player};

/// A soft actor-critic at work.
pub struct SoftPlayer<'a> {
    network: &'a SoftActorCritic,
    x: Vec<f32>,
    /// Nothing, which draws the mean.
    silence: Vec<f32>,
    actor: ActorMemory,
    critics: CriticMemory,
}

impl<'a> SoftPlayer<'a> {
    #[must_use]
    pub fn new(network: &'a SoftActorCritic) -> Self {
        let settings = network.settings();
        Self {
            network,
            x: vec![0.0; settings.input.width()],
            silence: vec![0.0; settings.actions],
            actor: network.actor_memory(1),
            critics: network.critic_memory(1),
        }
    }
}

impl std::fmt::Debug for SoftPlayer<'_> {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "a player of {} actions", self.silence.len())
    }
}

impl Player for SoftPlayer<'_> {
    fn decide(
        &mut self,
        task: usize,
        observation: &[f32],
        noise: &[f32],
        action: &mut [f32],
    ) -> Decision {
        self.network.settings().input.write(task, observation, &mut self.x);
        self.network.act(&self.x, noise, 1, &mut self.actor);
        action.copy_from_slice(&self.actor.actions);
        Decision {
            log_probability: self.actor.log_probabilities[0] as f32,
            value: self.network.worth(&self.x, &self.actor.actions, &mut self.critics)[0],
        }
    }

    /// What the critics say of the mean action.
    fn value(&mut self, task: usize, observation: &[f32]) -> f32 {
        self.network.settings().input.write(task, observation, &mut self.x);
        self.network.act(&self.x, &self.silence, 1, &mut self.actor);
        self.network.worth(&self.x, &self.actor.actions, &mut self.critics)[0]
    }
}

/// Uniform actions between −1 and 1, whatever is seen.
#[derive(Debug, Clone, Copy)]
pub struct UniformPlayer;

impl Player for UniformPlayer {
    fn decide(&mut self, _: usize, _: &[f32], noise: &[f32], action: &mut [f32]) -> Decision {
        // 2Φ(ξ) − 1 of a normal number ξ, to 3·10⁻⁴.
        let factor = (2.0 / std::f32::consts::PI).sqrt();
        for (action, xi) in action.iter_mut().zip(noise) {
            *action = (factor * (xi + 0.044_715 * xi.powi(3))).tanh();
        }
        let log_probability = -std::f32::consts::LN_2 * action.len() as f32;
        Decision { log_probability, value: 0.0 }
    }

    fn value(&mut self, _: usize, _: &[f32]) -> f32 {
        0.0
    }
}

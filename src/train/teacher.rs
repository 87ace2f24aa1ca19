//! Whom a student imitates: any policy that can be played, in its own observation variant, asked for its mean action in the
//! state the student is in (`spec/training.md` §5.3).
//!
//! A teacher that remembers (a recurrent policy, a window of observations) follows the student's episode from its start.

use std::sync::Arc;

use super::TrainError;
use crate::policy::{Actor, ObservationVariant, Policy};
use crate::sim::environment::Environment;

/// A policy to learn from, and what a run's arguments say of it.
#[derive(Clone)]
pub struct TeacherPolicy {
    pub name: String,
    /// BLAKE3 of its files.
    pub hash: String,
    pub policy: Arc<dyn Policy>,
}

impl std::fmt::Debug for TeacherPolicy {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "teacher {} ({})", self.name, self.hash)
    }
}

/// A teacher beside one body.
pub(super) struct Teacher {
    actor: Box<dyn Actor>,
    variant: ObservationVariant,
    observation: Vec<f32>,
    /// What it would do now.
    action: Vec<f32>,
}

impl Teacher {
    pub(super) fn new(
        teacher: &TeacherPolicy,
        environment: &Environment,
    ) -> Result<Self, TrainError> {
        let interface = environment.interface();
        let variant = teacher.policy.variant_in(&interface.task);
        Ok(Self {
            actor: teacher.policy.bind(&interface, 1)?,
            variant,
            observation: vec![0.0; environment.observation_length(variant)],
            action: vec![0.0; interface.muscle_count],
        })
    }

    /// An episode begins.
    pub(super) fn reset(&mut self) {
        self.actor.reset(0);
    }

    /// Its action in the state of `environment`, clipped if its family clips. To be asked once in every step.
    pub(super) fn ask(&mut self, environment: &Environment) -> &[f32] {
        environment.read_observation(self.variant, &mut self.observation);
        self.actor.act(&[0], &self.observation, &mut self.action, None);
        if self.actor.clips_actions() {
            self.action.iter_mut().for_each(|action| *action = action.clamp(-1.0, 1.0));
        }
        &self.action
    }
}

//! Whom a student imitates: any policy that can be played, in its own observation variant, asked for its mean action in the
//! state the student is in (`spec/training.md` §5.3).
//!
//! A teacher that remembers (a recurrent policy, a window of observations) follows the student's episode from its start.

use std::sync::Arc;

use super::TrainError;
use crate::policy::{Actor, ObservationVariant, Policy};
use crate::random::Random;
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

/// What the teacher plays himself, while the student looks on.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Lead {
    Nothing,
    Everything,
    /// This share of episodes up to a step drawn over the whole of them; the student goes on from there.
    Beginnings {
        share: f64,
    },
}

impl Lead {
    /// How many steps of an episode the teacher plays.
    pub(super) fn steps(self, horizon: usize, random: &mut Random) -> usize {
        match self {
            Self::Everything => usize::MAX,
            Self::Beginnings { share } if random.unit() < share => {
                random.index(u32::try_from(horizon).unwrap_or(u32::MAX)) as usize
            }
            Self::Nothing | Self::Beginnings { .. } => 0,
        }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_teacher_leads_his_share_of_episodes_up_to_any_of_their_steps() {
        let lead = Lead::Beginnings { share: 0.5 };
        let mut random = Random::new([1; 32]);
        let steps: Vec<usize> = (0..4000).map(|_| lead.steps(200, &mut random)).collect();
        let led: Vec<usize> = steps.iter().copied().filter(|&steps| steps > 0).collect();
        let share = led.len() as f64 / steps.len() as f64;
        let mean = led.iter().sum::<usize>() as f64 / led.len() as f64;
        assert!((share - 0.5).abs() < 0.03, "{share}");
        assert!((mean - 100.0).abs() < 5.0, "{mean}");
        assert!(led.iter().all(|&steps| steps < 200) && led.iter().any(|&steps| steps > 195));
        assert_eq!(Lead::Nothing.steps(200, &mut random), 0);
        assert_eq!(Lead::Everything.steps(200, &mut random), usize::MAX);
    }
}

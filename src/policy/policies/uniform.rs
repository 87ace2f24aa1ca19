//! Acts at random: every muscle's action uniform between two bounds, whatever the body does. A floor for comparisons and
//! a way to shake every body; fits every task.

use crate::policy::PolicyError;
use crate::policy::interface::{Actor, ObservationVariant, Policy, Sampling, TaskInterface};

/// Uniformly random actions.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct UniformPolicy {
    bound: f32,
}

impl UniformPolicy {
    /// Actions between −`bound` and `bound`; the tasks' own are −1 and 1.
    #[must_use]
    pub fn new(bound: f32) -> Self {
        Self { bound: bound.abs() }
    }
}

impl Policy for UniformPolicy {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Muscle
    }

    fn bind(&self, _task: &TaskInterface, _slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        Ok(Box::new(*self))
    }
}

impl Actor for UniformPolicy {
    fn reset(&mut self, _slot: usize) {}

    fn act(
        &mut self,
        _slots: &[usize],
        _observations: &[f32],
        action_means: &mut [f32],
        standard_deviations: Option<&mut [f32]>,
    ) {
        action_means.fill(0.0);
        if let Some(deviations) = standard_deviations {
            deviations.fill(self.bound / 3.0_f32.sqrt());
        }
    }

    fn clips_actions(&self) -> bool {
        false
    }

    fn sampling(&self) -> Sampling {
        Sampling::Uniform { half_width: self.bound }
    }
}

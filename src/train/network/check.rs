//! Whether samples fit a network, before anything is computed with them.

use super::{Coefficients, Sample, TrainError};

/// The lengths that a network expects of the samples of one task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Lengths {
    pub(super) observation: usize,
    /// Numbers of an action.
    pub(super) action: usize,
    /// Numbers of an action that are no padding, if the network knows.
    pub(super) muscles: Option<usize>,
    pub(super) noise: usize,
}

/// Checks every sample against the lengths of its task.
pub(super) fn check(
    minibatch: &[Sample<'_>],
    coefficients: &Coefficients,
    lengths: impl Fn(usize) -> Option<Lengths>,
    tasks: usize,
) -> Result<(), TrainError> {
    for (index, sample) in minibatch.iter().enumerate() {
        let Some(expected) = lengths(sample.task) else {
            return Err(TrainError::UnknownTask { sample: index, task: sample.task, known: tasks });
        };
        let same = |what, expected: usize, found: usize| {
            let error = TrainError::Sample { what, sample: index, expected, found };
            if expected == found { Ok(()) } else { Err(error) }
        };
        same("observation", expected.observation, sample.observation.len())?;
        same("action", expected.action, sample.action.len())?;
        if coefficients.imitates() {
            let found = sample.expert_action.len();
            let muscles = expected.muscles.unwrap_or(found.clamp(1, expected.action));
            same("expert action", muscles, found)?;
        }
        if coefficients.draws() {
            same("noise", expected.noise, sample.noise.len())?;
        }
    }
    Ok(())
}

//! The families of policies that can be played, each behind the same two traits.

pub mod ensemble;
mod exploration;
mod input;
pub mod mlp;
pub mod muscle_model;
pub mod recurrent;
mod subspace;
pub mod temporal;
pub mod transformer;
pub mod uniform;
pub mod walking;

use super::{PolicyError, TaskInterface};

/// Fails, naming both numbers, unless the task has them as the policy expects.
fn check_sizes(
    task: &TaskInterface,
    observation_length: usize,
    muscle_count: usize,
) -> Result<(), PolicyError> {
    for (what, expected, found) in [
        ("observation components", observation_length, task.clean_observation_length),
        ("muscles", muscle_count, task.muscle_count),
    ] {
        if expected != found {
            return Err(PolicyError::DoesNotFit { what, expected, found, task: task.task.clone() });
        }
    }
    Ok(())
}

/// Fails, naming both numbers, if the task has more of `what` than the policy was made for.
fn check_at_most(
    task: &TaskInterface,
    what: &'static str,
    expected: usize,
    found: usize,
) -> Result<(), PolicyError> {
    if found > expected {
        return Err(PolicyError::DoesNotFit { what, expected, found, task: task.task.clone() });
    }
    Ok(())
}

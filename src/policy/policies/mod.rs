//! The families of policies that can be played, each behind the same two traits.

pub mod mlp;
pub mod recurrent;
pub mod transformer;

use super::network::weights::Weights;
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

/// Standard deviations of a policy, one per muscle, or that they are not known.
#[derive(Debug, Clone)]
enum Exploration {
    Gaussian(Vec<f32>),
    Unknown,
}

impl Exploration {
    /// `exp(log_std)` if there is one entry per muscle. Other shapes belong to schemes whose standard deviation depends
    /// on the state and on settings that the tensors do not tell (`spec/policy.md` §4.3).
    fn read(weights: Weights, muscle_count: usize) -> Result<Self, PolicyError> {
        Ok(match weights.vector("log_std") {
            Ok(logarithms) if logarithms.len() == muscle_count => {
                Self::Gaussian(logarithms.iter().map(|x| x.exp()).collect())
            }
            Ok(_) | Err(PolicyError::TensorShape { .. }) => Self::Unknown,
            Err(error) => return Err(error),
        })
    }

    fn is_known(&self) -> bool {
        matches!(self, Self::Gaussian(_))
    }

    /// Fills one row; NaN if they are not known.
    fn write(&self, row: &mut [f32]) {
        match self {
            Self::Gaussian(deviations) => row.copy_from_slice(deviations),
            Self::Unknown => row.fill(f32::NAN),
        }
    }
}

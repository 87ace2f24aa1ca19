//! Muscle synergies: controls as a non-negative mixture of a few fixed patterns.
//!
//! `X ≈ W H` with W, H ≥ 0. Rows of X are time steps, columns muscles; rows of H are synergies, columns of W their time
//! courses. Minimised is `‖X − W H‖²` (Frobenius). Controls lie in [0, 1] and have no unit, nor have the factors.
//!
//! * `start`: non-negative double SVD (Boutsidis & Gallopoulos 2008), zeros filled with the mean or with noise.
//! * `descent`: hierarchical coordinate descent (Cichocki & Phan 2009), one pass over the data per iteration.
//! * `weights`: the time courses for fixed synergies, as the running simulation computes them.
//! * `exact_weights`: the same as an exact non-negative least-squares problem.
//!
//! What all ranks of one data set share is computed once, in [`NonNegativeRows`]: layout, Gram matrix, singular
//! vectors. Fits of different ranks are independent of each other, in any order.

mod descent;
mod dot_products;
mod exact_weights;
mod rows;
mod start;
mod sweep;
mod weights;

pub use descent::{Factorisation, nonnegative_factorisation};
pub use exact_weights::exact_synergy_weights;
pub use rows::NonNegativeRows;
pub use weights::{SynergyProjection, SynergyWeights, synergy_weights};

use super::SubspaceError;

/// How to factorise. The default is the published choice, with the first of its ten seeds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct NmfOptions {
    /// What the zeros of the double SVD are filled with.
    pub start: NmfStart,
    /// Sweeps over both factors at most.
    pub maximum_iterations: usize,
    /// Stop when the violation of the optimality conditions is at most this share of the first one.
    pub tolerance: f64,
}

/// What the zeros of the double SVD are filled with, so that they can grow.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NmfStart {
    /// A hundredth of the data's mean, times the absolute value of a normal draw ("nndsvdar").
    Noise { seed: u64 },
    /// The data's mean ("nndsvda"): no randomness at all.
    Mean,
}

impl Default for NmfOptions {
    fn default() -> Self {
        Self { start: NmfStart::Noise { seed: 0 }, maximum_iterations: 2000, tolerance: 1e-4 }
    }
}

impl NmfOptions {
    fn check(&self) -> Result<(), SubspaceError> {
        if self.tolerance.is_finite() && self.tolerance > 0.0 {
            Ok(())
        } else {
            Err(SubspaceError::Tolerance { found: self.tolerance })
        }
    }
}

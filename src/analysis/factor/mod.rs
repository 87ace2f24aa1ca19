//! Factor analysis of the muscles of one leg over the averaged gait cycle, after Ivanenko, Poppele & Lacquaniti 2004.
//!
//! [`sum_compartments`] makes fourteen muscles of the simulated ones, [`extract`] finds the factors in their
//! correlations and says whether there is anything to find, and [`rotate`] turns them so that each muscle loads on few.

mod extraction;
mod muscles;
mod planar;
mod reference_rotation;
mod rotation;
mod suitability;
mod varimax;

pub use extraction::{Extraction, ExtractionOptions, extract};
pub use muscles::{FACTOR_MUSCLES, compartments, sum_compartments};
pub use reference_rotation::{ReferenceRotationOptions, reference_rotation};
pub use rotation::{Factors, LoadingRow, Rotation, StatisticsRow, loading_rows, rotate};
pub use suitability::{Bartlett, SamplingAdequacy, bartlett, sampling_adequacy};
pub use varimax::{Rotated, VarimaxOptions, varimax, varimax_criterion};

use super::signal::SignalError;
use super::subspace::SubspaceError;

/// Why factors cannot be found.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum FactorError {
    #[error(transparent)]
    Signal(#[from] SignalError),
    #[error(transparent)]
    Subspace(#[from] SubspaceError),
    #[error("expected {expected} columns of muscle compartments, found {found}")]
    CompartmentCount { expected: usize, found: usize },
    #[error("factors need at least 2 muscles that vary, found {found} of {recorded}")]
    TooFewMuscles { found: usize, recorded: usize },
    #[error("no eigenvalue reaches {least}, the largest is {largest}")]
    NoFactor { least: f64, largest: f64 },
    #[error("the option `{name}` is {value}, expected {expected}")]
    Option { name: &'static str, value: f64, expected: &'static str },
    #[error("the singular values of a {factors} × {factors} matrix did not converge")]
    NoConvergence { factors: usize },
}

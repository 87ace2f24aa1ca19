//! Subspaces of muscle space: components, projections, explained variance.

mod covariance;
mod dimensionality;
mod explained_variance;
mod pca;
mod projection;

pub use covariance::Covariance;
pub use dimensionality::{Dimensionality, functional_dimensionality, functional_dimensionality_of};
pub use explained_variance::{components_reaching, mean_curve, own_curve, pooled_curve};
pub use pca::{PrincipalComponents, principal_components};
pub use projection::Projection;

/// Why a subspace cannot be computed or used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SubspaceError {
    #[error("expected {expected} muscles, found {found}")]
    MuscleCount { expected: usize, found: usize },
    #[error("the value of muscle {muscle} in row {row} is {value}, not a finite number")]
    NotFinite { row: u64, muscle: usize, value: f64 },
    #[error("principal components need at least 2 rows, found {found}")]
    TooFewRows { found: u64 },
    #[error("all {rows} rows are equal, so no direction is a principal component")]
    NoVariance { rows: u64 },
    #[error("asked for {asked} components, there are 1 to {available}")]
    ComponentCount { asked: usize, available: usize },
    #[error("the eigenvalues of the {muscles} × {muscles} covariance did not converge")]
    NoConvergence { muscles: usize },
    #[error("the values overflow: their covariance is not a finite number")]
    Overflow,
}

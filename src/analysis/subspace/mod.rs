//! Subspaces of muscle space: components, projections, explained variance.

mod covariance;
mod dimensionality;
mod eigen;
mod explained_variance;
mod nmf;
mod pair_comparison;
mod pca;
mod principal_angles;
mod projection;
mod quotients;
mod reconstruction;
mod ridge_projection;
mod small_svd;
mod variance_and_angle;

pub use covariance::Covariance;
pub use dimensionality::{Dimensionality, functional_dimensionality, functional_dimensionality_of};
pub use explained_variance::{components_reaching, mean_curve, own_curve, pooled_curve};
pub use nmf::{
    Factorisation, NmfOptions, NmfStart, NonNegativeRows, SynergyProjection, SynergyWeights,
    exact_synergy_weights, nonnegative_factorisation, synergy_weights,
};
pub use pair_comparison::{
    Cell, Comparison, CurveSummary, GroupSummary, Pair, compare_cells, pairs_of, summarise_pairs,
};
pub use pca::{PrincipalComponents, principal_components};
pub use principal_angles::{leading_subspace_angles, principal_angles};
pub use projection::Projection;
pub use reconstruction::{Reconstruction, reconstruction};
pub use ridge_projection::{RIDGE, RidgeProjection};
pub use variance_and_angle::{
    AngleSummary, PairCurves, VarianceDifference, average_angle, compare_subspaces,
    variance_difference,
};

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
    #[error(
        "the value of muscle {muscle} in row {row} is {value}, but a factor model needs 0 or more"
    )]
    Negative { row: u64, muscle: usize, value: f64 },
    #[error("all {rows} rows are zero, so there is nothing to factorise")]
    AllZero { rows: u64 },
    #[error("expected {expected} values, found {found}")]
    Length { expected: usize, found: usize },
    #[error("a tolerance must be positive and finite, found {found}")]
    Tolerance { found: f64 },
    #[error("two subspaces have nothing to compare: {first} and {second} directions")]
    DirectionCount { first: usize, second: usize },
}

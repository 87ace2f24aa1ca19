//! Principal components of muscle commands.
//!
//! Eigenvectors of the covariance Σ of the rows (time steps) about their mean, divisor n − 1, by falling eigenvalue:
//! `Σ cᵢ = λᵢ cᵢ`, with λ in squared units of the values. As many components as muscles are kept.
//!
//! **Sign.** An eigenvector is only defined up to its sign. Here the entry of largest magnitude (the first of equals)
//! is positive, so the same data give the same bytes. Components of equal eigenvalue are defined only up to a
//! rotation among themselves. Eigenvalues that rounding made negative are zero.
//!
//! Degenerate: fewer than two rows, rows that are all equal, and values so large that Σ overflows are errors. With no
//! more rows than muscles the last components are arbitrary directions without variance:
//! [`PrincipalComponents::is_underdetermined`].
//!
//! Linear algebra runs on one thread. Oracle: `tests/analysis_parity.rs`, algorithms `csi_project_pca`,
//! `cumulative_ev`.

use faer::Mat;

use super::eigen::falling_eigenpairs;
use super::{Covariance, SubspaceError};

/// Components with a smaller share of the variance are beyond the numerical rank.
const NUMERICAL_RANK: f64 = 1e-12;

/// Orthonormal directions of falling variance.
#[derive(Debug, Clone, PartialEq)]
pub struct PrincipalComponents {
    /// Mean of each muscle.
    pub mean: Vec<f64>,
    /// Variance along each component, falling, never negative.
    pub variances: Vec<f64>,
    /// Row-major muscles × muscles: one component per row, one muscle per column.
    pub components: Vec<f64>,
    /// Number of rows they were computed from.
    pub rows: u64,
}

impl PrincipalComponents {
    /// Number of muscles, which is also the number of components.
    #[must_use]
    pub fn muscle_count(&self) -> usize {
        self.mean.len()
    }

    /// One component: a weight for each muscle, of unit length.
    #[must_use]
    pub fn component(&self, index: usize) -> &[f64] {
        let muscle_count = self.muscle_count();
        &self.components[index * muscle_count..][..muscle_count]
    }

    /// Number of components that have variance: at least 10⁻¹² of the total.
    #[must_use]
    pub fn rank(&self) -> usize {
        let total: f64 = self.variances.iter().sum();
        self.variances.iter().filter(|&&variance| variance >= NUMERICAL_RANK * total).count()
    }

    /// Whether there were too few rows for all components to mean something.
    #[must_use]
    pub fn is_underdetermined(&self) -> bool {
        self.rows <= self.muscle_count() as u64
    }
}

/// The principal components of everything `covariance` has seen.
pub fn principal_components(covariance: &Covariance) -> Result<PrincipalComponents, SubspaceError> {
    let rows = covariance.rows();
    let trace = covariance.trace().ok_or(SubspaceError::TooFewRows { found: rows })?;
    if !trace.is_finite() {
        return Err(SubspaceError::Overflow);
    }
    if trace <= 0.0 {
        return Err(SubspaceError::NoVariance { rows });
    }
    let muscles = covariance.muscle_count();
    let matrix =
        Mat::from_fn(muscles, muscles, |i, j| covariance.between(i, j).unwrap_or(f64::NAN));
    let (variances, vectors) = falling_eigenpairs(matrix.as_ref())?;
    let mut components = Vec::with_capacity(muscles * muscles);
    for vector in vectors.col_iter() {
        let sign = sign_of_largest(vector.iter());
        components.extend(vector.iter().map(|x| sign * x));
    }
    if !components.iter().all(|x| x.is_finite()) {
        return Err(SubspaceError::NoConvergence { muscles });
    }
    Ok(PrincipalComponents { mean: covariance.mean().to_vec(), variances, components, rows })
}

/// −1 if the first entry of largest magnitude is negative, else 1.
fn sign_of_largest<'a>(entries: impl Iterator<Item = &'a f64>) -> f64 {
    let largest =
        entries.fold(0.0_f64, |largest, &x| if x.abs() > largest.abs() { x } else { largest });
    if largest < 0.0 { -1.0 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const MUSCLES: usize = 5;

    fn of(rows: &[[f64; MUSCLES]]) -> Result<PrincipalComponents, SubspaceError> {
        let mut covariance = Covariance::new(MUSCLES);
        rows.iter().for_each(|row| covariance.push_row(row).unwrap());
        principal_components(&covariance)
    }

    #[test]
    fn a_line_has_one_component_along_itself_with_positive_largest_entry() {
        let rows = [0.0, 1.0, 2.0].map(|t| [-4.0 * t, 3.0 * t, 0.0, 0.0, 7.0]);
        let found = of(&rows).unwrap();
        let want = [0.8, -0.6, 0.0, 0.0, 0.0];
        assert!(found.component(0).iter().zip(want).all(|(x, y)| (x - y).abs() < 1e-12));
        assert!((found.variances[0] - 25.0).abs() < 1e-12);
        assert!(found.variances[1..].iter().all(|&v| (0.0..1e-12).contains(&v)));
        assert!(found.is_underdetermined());
    }

    #[test]
    fn degenerate_data_are_typed_errors() {
        assert_eq!(of(&[]), Err(SubspaceError::TooFewRows { found: 0 }));
        assert_eq!(of(&[[1.0; MUSCLES]]), Err(SubspaceError::TooFewRows { found: 1 }));
        assert_eq!(of(&[[1.0; MUSCLES]; 9]), Err(SubspaceError::NoVariance { rows: 9 }));
        assert_eq!(of(&[[1e300; MUSCLES], [-1e300; MUSCLES]]), Err(SubspaceError::Overflow));
    }

    proptest! {
        #[test]
        fn components_are_orthonormal_and_variances_fall(
            rows in prop::collection::vec(prop::array::uniform5(-1.0..1.0_f64), 2..60),
        ) {
            let found = of(&rows).unwrap();
            for i in 0..MUSCLES {
                for j in 0..MUSCLES {
                    let product: f64 =
                        found.component(i).iter().zip(found.component(j)).map(|(x, y)| x * y).sum();
                    let want = if i == j { 1.0 } else { 0.0 };
                    prop_assert!((product - want).abs() < 1e-12, "{i} {j} {product}");
                }
            }
            prop_assert!(found.variances.is_sorted_by(|a, b| a >= b));
            prop_assert!(found.variances.iter().all(|&v| v >= 0.0));
        }
    }
}

//! The projection inside a policy that learns its own subspace.
//!
//! `y = μ + (m − μ) Pᵀ (P Pᵀ + ε 1)⁻¹ P`, with P the first rows of a learnable matrix and ε = 10⁻⁶. P starts from
//! principal components but is trained, so its rows need not stay orthonormal; the ridge ε keeps the inverse finite
//! when they come to depend on each other. For orthonormal rows this is the plain projection up to ε. Noise is added
//! after it. In the unit of the action.
//!
//! More rows asked for than there are: all rows are used (40 asked of 39, as published).
//!
//! Degenerate: no row, or values that are not finite, are errors. Oracle: `tests/analysis_parity.rs`, algorithm
//! `csi_project_ridge`.

use faer::{Mat, MatRef};

use super::SubspaceError;

/// The published ridge.
pub const RIDGE: f64 = 1e-6;

/// A projection onto the span of rows that need not be orthonormal.
#[derive(Debug, Clone, PartialEq)]
pub struct RidgeProjection {
    mean: Vec<f64>,
    /// Row-major muscles × muscles: Pᵀ (P Pᵀ + ε 1)⁻¹ P.
    matrix: Vec<f64>,
}

impl RidgeProjection {
    /// Onto the first `count` of `rows` (row-major, as many columns as `mean` has entries).
    pub fn new(
        rows: &[f64],
        mean: &[f64],
        count: usize,
        ridge: f64,
    ) -> Result<Self, SubspaceError> {
        let muscles = mean.len();
        if muscles == 0 || !rows.len().is_multiple_of(muscles) {
            let found = rows.len() % muscles.max(1);
            return Err(SubspaceError::MuscleCount { expected: muscles, found });
        }
        let available = rows.len() / muscles;
        if count == 0 || available == 0 {
            return Err(SubspaceError::ComponentCount { asked: count, available });
        }
        if !(ridge.is_finite() && ridge > 0.0) {
            return Err(SubspaceError::Tolerance { found: ridge });
        }
        let count = count.min(available);
        let rows = &rows[..count * muscles];
        if let Some(at) = rows.iter().chain(mean).position(|x| !x.is_finite()) {
            let (row, muscle) = ((at / muscles) as u64, at % muscles);
            let value = if at < rows.len() { rows[at] } else { mean[muscle] };
            return Err(SubspaceError::NotFinite { row, muscle, value });
        }
        let p = MatRef::from_row_major_slice(rows, count, muscles);
        let dot = |i: usize, j: usize| (0..muscles).map(|m| p[(i, m)] * p[(j, m)]).sum::<f64>();
        let gram = Mat::from_fn(count, count, |i, j| dot(i, j) + if i == j { ridge } else { 0.0 });
        let inverse = inverse_of_positive(&gram).ok_or(SubspaceError::Overflow)?;
        let mut matrix = vec![0.0; muscles * muscles];
        for (i, row) in inverse.iter().enumerate() {
            // Row i of (P Pᵀ + ε)⁻¹ P, then its share of the outer product with row i of P.
            let solved: Vec<f64> = (0..muscles)
                .map(|m| row.iter().enumerate().map(|(j, g)| g * p[(j, m)]).sum())
                .collect();
            for (m, target) in matrix.chunks_exact_mut(muscles).enumerate() {
                target.iter_mut().zip(&solved).for_each(|(x, s)| *x += p[(i, m)] * s);
            }
        }
        Ok(Self { mean: mean.to_vec(), matrix })
    }

    /// Projects `action` in place.
    ///
    /// # Panics
    /// If `action` has another length than there are muscles.
    pub fn apply(&self, action: &mut [f64]) {
        let muscles = self.mean.len();
        assert_eq!(action.len(), muscles, "an action has one value per muscle");
        let deviation: Vec<f64> = action.iter().zip(&self.mean).map(|(x, mean)| x - mean).collect();
        action.copy_from_slice(&self.mean);
        for (deviation, row) in deviation.iter().zip(self.matrix.chunks_exact(muscles)) {
            action.iter_mut().zip(row).for_each(|(x, weight)| *x += deviation * weight);
        }
    }
}

/// Inverse of a symmetric positive matrix by Cholesky, row by row; `None` if it is not positive.
fn inverse_of_positive(matrix: &Mat<f64>) -> Option<Vec<Vec<f64>>> {
    let count = matrix.nrows();
    let mut factor = vec![vec![0.0; count]; count];
    for i in 0..count {
        for j in 0..=i {
            let dot: f64 = (0..j).map(|k| factor[i][k] * factor[j][k]).sum();
            let rest = matrix[(i, j)] - dot;
            if i != j {
                factor[i][j] = rest / factor[j][j];
            } else if rest > 0.0 {
                factor[i][i] = rest.sqrt();
            } else {
                return None;
            }
        }
    }
    let mut inverse = vec![vec![0.0; count]; count];
    for (column, solution) in inverse.iter_mut().enumerate() {
        solution[column] = 1.0;
        for i in 0..count {
            let dot: f64 = (0..i).map(|k| factor[i][k] * solution[k]).sum();
            solution[i] = (solution[i] - dot) / factor[i][i];
        }
        for i in (0..count).rev() {
            let dot: f64 = (i + 1..count).map(|k| factor[k][i] * solution[k]).sum();
            solution[i] = (solution[i] - dot) / factor[i][i];
        }
    }
    Some(inverse)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_of_any_length_project_onto_their_span() {
        let projection =
            RidgeProjection::new(&[3.0, 0.0, 0.0, 5.0, 5.0, 0.0], &[0.0, 0.0, 1.0], 2, 1e-9)
                .unwrap();
        let mut action = [2.0, -3.0, 9.0];
        projection.apply(&mut action);
        for (found, want) in action.iter().zip([2.0, -3.0, 1.0]) {
            assert!((found - want).abs() < 1e-8);
        }
    }

    #[test]
    fn more_rows_than_there_are_means_all_of_them() {
        let of = |count| RidgeProjection::new(&[1.0, 0.0], &[0.0, 0.0], count, RIDGE);
        assert_eq!(of(40), of(1));
        assert_eq!(of(0), Err(SubspaceError::ComponentCount { asked: 0, available: 1 }));
    }

    #[test]
    fn bad_input_is_refused() {
        assert!(RidgeProjection::new(&[1.0], &[0.0, 0.0], 1, RIDGE).is_err());
        assert!(RidgeProjection::new(&[1.0, f64::NAN], &[0.0, 0.0], 1, RIDGE).is_err());
        assert!(RidgeProjection::new(&[1.0, 0.0], &[f64::NAN, 0.0], 1, RIDGE).is_err());
        assert!(RidgeProjection::new(&[1.0, 0.0], &[0.0, 0.0], 1, 0.0).is_err());
        assert!(RidgeProjection::new(&[], &[], 1, RIDGE).is_err());
    }
}

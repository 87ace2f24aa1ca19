//! The control subspace that a fine-tuned policy carries: its mean action is projected onto r rows (`spec/policy.md` §2.4).
//!
//! `a = m + (a₀ − m) Pᵀ (P Pᵀ + ε I)⁻¹ P` with P the first r rows of `projection`, m the tensor `mean`, ε = 10⁻⁶. The
//! rows need not be orthonormal: fine-tuning changes them. The matrix is computed once, in double precision.

use crate::policy::PolicyError;
use crate::policy::network::weights::Weights;

const RIDGE: f64 = 1e-6;
/// Far above any body, and what keeps a hostile file from asking for hours of arithmetic.
const MOST_MUSCLES: usize = 1000;

/// Mean action and projector onto the subspace.
#[derive(Debug, Clone)]
pub(super) struct ControlSubspace {
    mean: Vec<f32>,
    /// Muscles × muscles, symmetric.
    projector: Vec<f32>,
}

impl ControlSubspace {
    /// Reads `projection` and `mean`; `size` above the number of muscles counts as that number.
    pub(super) fn read(
        weights: Weights,
        muscles: usize,
        size: Option<usize>,
    ) -> Result<Self, PolicyError> {
        if muscles > MOST_MUSCLES {
            let what = format!("control subspace of {muscles} muscles");
            return Err(PolicyError::Unsupported { what });
        }
        let rows = size.unwrap_or(muscles).clamp(1, muscles);
        let projection = weights.tensor("projection", &[muscles, muscles])?;
        let basis: Vec<Vec<f64>> = projection
            .chunks_exact(muscles)
            .take(rows)
            .map(|row| row.iter().map(|&x| f64::from(x)).collect())
            .collect();
        let mean = weights.tensor("mean", &[muscles])?.to_vec();
        Ok(Self { mean, projector: projector(basis, muscles) })
    }

    /// Projects one action in place; `scratch` is as long.
    pub(super) fn apply(&self, action: &mut [f32], scratch: &mut [f32]) {
        for ((difference, action), mean) in scratch.iter_mut().zip(&*action).zip(&self.mean) {
            *difference = action - mean;
        }
        let rows = self.projector.chunks_exact(self.mean.len());
        for ((action, row), mean) in action.iter_mut().zip(rows).zip(&self.mean) {
            *action = mean + row.iter().zip(&*scratch).map(|(q, x)| q * x).sum::<f32>();
        }
    }
}

/// `Pᵀ (P Pᵀ + ε I)⁻¹ P`. With the Cholesky factor L of the matrix in brackets and `Z = L⁻¹ P` that is `Zᵀ Z`.
fn projector(mut rows: Vec<Vec<f64>>, muscles: usize) -> Vec<f32> {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let gram: Vec<Vec<f64>> =
        rows.iter().map(|a| rows.iter().map(|b| dot(a, b)).collect()).collect();
    let mut factor: Vec<Vec<f64>> = Vec::with_capacity(rows.len());
    for i in 0..rows.len() {
        let mut row: Vec<f64> = Vec::with_capacity(i + 1);
        for j in 0..i {
            let known = dot(&row, &factor[j][..j]);
            row.push((gram[i][j] - known) / factor[j][j]);
        }
        // Positive in exact arithmetic; the ridge bounds it from below.
        row.push((gram[i][i] + RIDGE - dot(&row, &row)).max(RIDGE).sqrt());
        let (above, here) = rows.split_at_mut(i);
        for (weight, z) in row.iter().zip(&*above) {
            for (x, z) in here[0].iter_mut().zip(z) {
                *x -= weight * z;
            }
        }
        for x in &mut here[0] {
            *x /= row[i];
        }
        factor.push(row);
    }
    let element = |a: usize, b: usize| rows.iter().map(|z| z[a] * z[b]).sum::<f64>() as f32;
    (0..muscles * muscles).map(|index| element(index / muscles, index % muscles)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_projects_onto_its_own_direction() {
        // (3, 4) has length 5: the projector is the outer product over 25.
        let projector = projector(vec![vec![3.0, 4.0]], 2);
        for (found, expected) in projector.iter().zip([9.0, 12.0, 12.0, 16.0]) {
            assert!((found - expected / 25.0).abs() < 1e-7, "{projector:?}");
        }
    }

    #[test]
    fn all_rows_are_the_identity_up_to_the_ridge() {
        let rows = vec![vec![2.0, 1.0, 0.0], vec![0.0, 1.0, 1.0], vec![1.0, 0.0, 3.0]];
        let projector = projector(rows, 3);
        for (index, found) in projector.iter().enumerate() {
            let expected = if index % 4 == 0 { 1.0 } else { 0.0 };
            assert!((found - expected).abs() < 1e-5, "{projector:?}");
        }
    }
}

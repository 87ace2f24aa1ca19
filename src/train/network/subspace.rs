//! The control subspace of a perceptron, with derivatives (`spec/policy.md` §2.4).
//!
//! `a = m + Q (a₀ − m)` with `Q = Pᵀ (P Pᵀ + ε I)⁻¹ P`, P the first r rows of the projection, ε = 10⁻⁶. Q is computed once
//! per minibatch; samples add up the derivative D by Q. With `K = (P Pᵀ + ε I)⁻¹ P` and `B = D + Dᵀ` the derivative by P
//! is then `K B (I − Q)`.

const RIDGE: f64 = 1e-6;

/// A control subspace for one set of parameters.
#[derive(Debug, Clone)]
pub(super) struct Subspace {
    muscles: usize,
    mean: Vec<f32>,
    /// K, rows × muscles.
    solved: Vec<f64>,
    /// Q, muscles × muscles, symmetric.
    projector: Vec<f64>,
}

impl Subspace {
    /// `projection` is muscles × muscles, of which the first `rows` rows count.
    pub(super) fn new(projection: &[f32], mean: &[f32], rows: usize) -> Self {
        let muscles = mean.len();
        let rows = rows.clamp(1, muscles);
        let basis: Vec<f64> = projection[..rows * muscles].iter().map(|&x| f64::from(x)).collect();
        let row = |i: usize| &basis[i * muscles..(i + 1) * muscles];
        let mut gram = vec![0.0; rows * rows];
        for (i, j) in (0..rows).flat_map(|i| (0..rows).map(move |j| (i, j))) {
            let ridge = if i == j { RIDGE } else { 0.0 };
            gram[i * rows + j] = dot(row(i), row(j)) + ridge;
        }
        let mut solved = basis.clone();
        solve(&mut gram, &mut solved, rows, muscles);
        let mut projector = vec![0.0; muscles * muscles];
        for k in 0..rows {
            for i in 0..muscles {
                for j in 0..muscles {
                    projector[i * muscles + j] += basis[k * muscles + i] * solved[k * muscles + j];
                }
            }
        }
        Self { muscles, mean: mean.to_vec(), solved, projector }
    }

    /// Projects one mean action in place.
    pub(super) fn apply(&self, action: &mut [f32]) {
        let difference = self.difference(action);
        for (i, action) in action.iter_mut().enumerate() {
            let row = &self.projector[i * self.muscles..(i + 1) * self.muscles];
            *action = (f64::from(self.mean[i]) + dot(row, &difference)) as f32;
        }
    }

    fn difference(&self, action: &[f32]) -> Vec<f64> {
        action.iter().zip(&self.mean).map(|(&a, &m)| f64::from(a) - f64::from(m)).collect()
    }

    /// Turns the derivatives by the projected action in `slopes` into those by `action`, which was projected; adds to those
    /// by Q and by m.
    pub(super) fn pull(
        &self,
        action: &[f32],
        slopes: &mut [f32],
        projector_gradient: &mut [f32],
        mean_gradient: &mut [f32],
    ) {
        let difference = self.difference(action);
        for (row, &slope) in projector_gradient.chunks_exact_mut(self.muscles).zip(&*slopes) {
            row.iter_mut().zip(&difference).for_each(|(q, d)| *q += (f64::from(slope) * d) as f32);
        }
        let before: Vec<f64> = slopes.iter().map(|&s| f64::from(s)).collect();
        for (i, slope) in slopes.iter_mut().enumerate() {
            // Q is symmetric.
            let row = &self.projector[i * self.muscles..(i + 1) * self.muscles];
            let along = dot(row, &before);
            mean_gradient[i] += (before[i] - along) as f32;
            *slope = along as f32;
        }
    }

    /// Turns the sum of derivatives by Q into those by the projection, which it adds to.
    pub(super) fn finish(&self, projector_gradient: &[f32], projection_gradient: &mut [f32]) {
        let n = self.muscles;
        let element = |i: usize, j: usize| f64::from(projector_gradient[i * n + j]);
        for (row, target) in
            self.solved.chunks_exact(n).zip(projection_gradient.chunks_exact_mut(n))
        {
            let along: Vec<f64> = (0..n)
                .map(|j| (0..n).map(|i| row[i] * (element(i, j) + element(j, i))).sum())
                .collect();
            for (j, target) in target.iter_mut().enumerate() {
                let projected: f64 = (0..n).map(|i| along[i] * self.projector[i * n + j]).sum();
                *target += (along[j] - projected) as f32;
            }
        }
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

/// Replaces `right` (size × columns) by `matrix⁻¹ right`, for a positive definite matrix, which it overwrites.
fn solve(matrix: &mut [f64], right: &mut [f64], size: usize, columns: usize) {
    for pivot in 0..size {
        let (above, below) = right.split_at_mut((pivot + 1) * columns);
        let pivot_row = &above[pivot * columns..];
        for (i, row) in (pivot + 1..size).zip(below.chunks_exact_mut(columns)) {
            let factor = matrix[i * size + pivot] / matrix[pivot * size + pivot];
            for j in pivot..size {
                matrix[i * size + j] -= factor * matrix[pivot * size + j];
            }
            row.iter_mut().zip(pivot_row).for_each(|(x, p)| *x -= factor * p);
        }
    }
    for i in (0..size).rev() {
        let (above, below) = right.split_at_mut((i + 1) * columns);
        let row = &mut above[i * columns..];
        for (j, known) in (i + 1..size).zip(below.chunks_exact(columns)) {
            let factor = matrix[i * size + j];
            row.iter_mut().zip(known).for_each(|(x, k)| *x -= factor * k);
        }
        row.iter_mut().for_each(|x| *x /= matrix[i * size + i]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_row_projects_onto_its_own_direction() {
        // (3, 4) has length 5: the projector is the outer product over 25.
        let subspace = Subspace::new(&[3.0, 4.0, 9.0, 9.0], &[1.0, 1.0], 1);
        let mut action = [1.0 + 3.0, 1.0 - 1.0];
        subspace.apply(&mut action);
        for (found, want) in action.iter().zip([1.0 + 15.0 / 25.0, 1.0 + 20.0 / 25.0]) {
            assert!((found - want).abs() < 1e-5, "{action:?}");
        }
    }
}

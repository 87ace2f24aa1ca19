//! Exact weights for fixed synergies: `min ‖x − w H‖²` over w ≥ 0, row by row.
//!
//! The active-set method of Lawson & Hanson 1974 (chapter 23) on the normal equations: the component with the steepest
//! descent joins the free set, the least-squares solution of the free set is taken as far as no weight turns negative,
//! weights that reach zero leave. It ends at the optimum after finitely many steps.
//!
//! Degenerate: synergies that depend on each other have several optima; the one found first is returned, all rebuild
//! the row alike. No unit. Oracle: `tests/analysis_parity.rs`, algorithms `nnls_rows`, `csi_project_nmf`.

use super::super::SubspaceError;
use super::weights::check_synergies;

/// A gradient below this share of the largest `H xᵀ` counts as zero, and so does a pivot of its own diagonal entry.
const NEGLIGIBLE: f64 = 1e-13;

/// Weights (row-major rows × rank) of `rows` (row-major, `muscles` columns) in `synergies` (row-major, one per row).
pub fn exact_synergy_weights(
    rows: &[f64],
    synergies: &[f64],
    muscles: usize,
) -> Result<Vec<f64>, SubspaceError> {
    let rank = check_synergies(synergies, muscles)?;
    if !rows.len().is_multiple_of(muscles) {
        let found = rows.len() % muscles;
        return Err(SubspaceError::MuscleCount { expected: muscles, found });
    }
    if let Some(at) = rows.iter().position(|x| !x.is_finite()) {
        let (row, muscle) = ((at / muscles) as u64, at % muscles);
        return Err(SubspaceError::NotFinite { row, muscle, value: rows[at] });
    }
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
    let synergy_rows = || synergies.chunks_exact(muscles);
    let gram: Vec<f64> =
        synergy_rows().flat_map(|a| synergy_rows().map(move |b| dot(a, b))).collect();
    let mut weights = Vec::with_capacity(rows.len() / muscles * rank);
    for row in rows.chunks_exact(muscles) {
        let target: Vec<f64> = synergy_rows().map(|synergy| dot(synergy, row)).collect();
        weights.extend(ActiveSet::new(&gram, &target).solve());
    }
    Ok(weights)
}

/// One row's problem: `min wᵀ G w / 2 − tᵀ w` over w ≥ 0.
struct ActiveSet<'a> {
    gram: &'a [f64],
    target: &'a [f64],
    weights: Vec<f64>,
    /// Components allowed to differ from zero, in the order in which they joined.
    free: Vec<usize>,
}

impl<'a> ActiveSet<'a> {
    fn new(gram: &'a [f64], target: &'a [f64]) -> Self {
        Self { gram, target, weights: vec![0.0; target.len()], free: Vec::new() }
    }

    fn solve(mut self) -> Vec<f64> {
        let rank = self.target.len();
        let negligible = NEGLIGIBLE * self.target.iter().fold(0.0, |m: f64, x| m.max(x.abs()));
        let mut dependent = vec![false; rank];
        // Each component joins a handful of times at most; the bound is against rounding that goes in circles.
        for _ in 0..10 * rank {
            let slope = |j: usize| {
                let row = &self.gram[j * rank..][..rank];
                self.target[j] - row.iter().zip(&self.weights).map(|(g, w)| g * w).sum::<f64>()
            };
            let steepest = (0..rank)
                .filter(|j| !self.free.contains(j) && !dependent[*j])
                .map(|j| (slope(j), j))
                .filter(|(slope, _)| *slope > negligible)
                .max_by(|a, b| a.0.total_cmp(&b.0));
            let Some((_, component)) = steepest else { break };
            self.free.push(component);
            if !self.move_to_optimum() {
                self.free.retain(|&j| j != component);
                dependent[component] = true;
            }
        }
        self.weights
    }

    /// Goes to the optimum of the free components, freeing fewer where a weight would turn negative. `false` if the
    /// component that joined last depends on the others.
    fn move_to_optimum(&mut self) -> bool {
        while !self.free.is_empty() {
            let Some(wanted) = self.least_squares() else { return false };
            let step = self
                .free
                .iter()
                .zip(&wanted)
                .filter(|(_, wanted)| **wanted <= 0.0)
                .map(|(&j, wanted)| (self.weights[j] / (self.weights[j] - wanted), j))
                .min_by(|a, b| a.0.total_cmp(&b.0));
            let (share, blocking) = step.map_or((1.0, None), |(share, j)| {
                // A weight of zero that wants to stay there blocks at once.
                (if share.is_nan() { 0.0 } else { share }, Some(j))
            });
            for (&j, wanted) in self.free.iter().zip(&wanted) {
                let moved = self.weights[j] + share * (wanted - self.weights[j]);
                self.weights[j] = if blocking == Some(j) { 0.0 } else { moved.max(0.0) };
            }
            if blocking.is_none() {
                return true;
            }
            let weights = &self.weights;
            self.free.retain(|&j| weights[j] > 0.0);
        }
        true
    }

    /// Unconstrained optimum of the free components, by Cholesky; `None` if they depend on each other.
    fn least_squares(&self) -> Option<Vec<f64>> {
        let (rank, count) = (self.target.len(), self.free.len());
        let mut factor = vec![0.0; count * count];
        for i in 0..count {
            for j in 0..=i {
                let dot: f64 = (0..j).map(|k| factor[i * count + k] * factor[j * count + k]).sum();
                let entry = self.gram[self.free[i] * rank + self.free[j]];
                let rest = entry - dot;
                if i != j {
                    factor[i * count + j] = rest / factor[j * count + j];
                } else if rest > NEGLIGIBLE * entry {
                    factor[i * count + i] = rest.sqrt();
                } else {
                    return None;
                }
            }
        }
        let mut solution: Vec<f64> = self.free.iter().map(|&j| self.target[j]).collect();
        for i in 0..count {
            let dot: f64 = (0..i).map(|k| factor[i * count + k] * solution[k]).sum();
            solution[i] = (solution[i] - dot) / factor[i * count + i];
        }
        for i in (0..count).rev() {
            let dot: f64 = (i + 1..count).map(|k| factor[k * count + i] * solution[k]).sum();
            solution[i] = (solution[i] - dot) / factor[i * count + i];
        }
        Some(solution)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn a_mixture_is_taken_apart_and_what_points_away_gets_nothing() {
        let synergies = [1.0, 1.0, 0.0, 0.0, 1.0, 1.0];
        let found = exact_synergy_weights(&[2.0, 5.0, 3.0], &synergies, 3).unwrap();
        assert!((found[0] - 2.0).abs() < 1e-12 && (found[1] - 3.0).abs() < 1e-12);
        let found = exact_synergy_weights(&[-2.0, -1.0, 4.0], &synergies, 3).unwrap();
        assert!(found[0] == 0.0 && (found[1] - 1.5).abs() < 1e-12);
    }

    #[test]
    fn equal_synergies_share_one_weight() {
        let found = exact_synergy_weights(&[2.0, 2.0], &[1.0, 1.0, 1.0, 1.0], 2).unwrap();
        assert!((found[0] + found[1] - 2.0).abs() < 1e-12);
    }

    #[test]
    fn bad_rows_are_refused() {
        assert!(exact_synergy_weights(&[1.0; 3], &[1.0; 2], 2).is_err());
        assert!(exact_synergy_weights(&[1.0, f64::NAN], &[1.0; 2], 2).is_err());
        assert_eq!(exact_synergy_weights(&[], &[1.0; 2], 2), Ok(Vec::new()));
    }

    proptest! {
        /// The conditions of Karush, Kuhn and Tucker hold at the optimum and nowhere else.
        #[test]
        fn the_optimality_conditions_hold(
            synergies in prop::collection::vec(0.0..1.0_f64, 4 * 7),
            row in prop::collection::vec(-1.0..1.0_f64, 7),
        ) {
            let weights = exact_synergy_weights(&row, &synergies, 7).unwrap();
            let rest: Vec<f64> = (0..7)
                .map(|m| row[m] - (0..4).map(|t| weights[t] * synergies[t * 7 + m]).sum::<f64>())
                .collect();
            for (t, synergy) in synergies.chunks_exact(7).enumerate() {
                let slope: f64 = synergy.iter().zip(&rest).map(|(s, r)| s * r).sum();
                prop_assert!(weights[t] >= 0.0);
                prop_assert!(slope < 1e-9, "{slope}");
                prop_assert!(weights[t] == 0.0 || slope.abs() < 1e-9, "{slope}");
            }
        }
    }
}

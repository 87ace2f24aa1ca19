//! Time courses for fixed synergies, by the same coordinate descent.
//!
//! Weights start at **zero** and are swept with the synergies fixed until the violation is at most `tolerance` of the
//! first, or `maximum_iterations` sweeps were made. All rows share one violation, so a row's weights depend slightly
//! (within the tolerance) on the rows beside it; [`SynergyProjection`] gives each row its own, as in a running
//! simulation.
//!
//! Degenerate: synergies that are all zero give zero weights. A row of zeros has zero weights.
//! Oracle: `tests/analysis_parity.rs`, algorithm `nmf_transform`, by matrix and by row.

use faer::Mat;

use super::super::SubspaceError;
use super::NmfOptions;
use super::descent::{gram_of, rebuilt};
use super::rows::{BLOCK, NonNegativeRows};
use super::sweep::{Coefficients, Target, product, sweep};

/// Weights of several time steps.
#[derive(Debug, Clone, PartialEq)]
pub struct SynergyWeights {
    /// Row-major time steps × rank.
    pub weights: Vec<f64>,
    /// W H: row-major time steps × muscles.
    pub rebuilt: Vec<f64>,
    pub iterations: usize,
    pub has_converged: bool,
}

/// Weights with which `synergies` (row-major, one per row) rebuild `data` best. Of the options, the start is not used.
pub fn synergy_weights(
    data: &NonNegativeRows,
    synergies: &[f64],
    options: &NmfOptions,
) -> Result<SynergyWeights, SubspaceError> {
    options.check()?;
    let muscles = data.muscle_count();
    let rank = check_synergies(synergies, muscles)?;
    let fixed = Mat::from_fn(muscles, rank, |muscle, t| synergies[t * muscles + muscle]);
    let mut synergy_gram = Mat::<f64>::zeros(rank, rank);
    gram_of(&mut synergy_gram, &fixed);
    let (mut curvature, mut coefficients) = (Coefficients::default(), Coefficients::default());
    curvature.set(synergy_gram.as_ref(), 1.0);
    coefficients.set(fixed.as_ref(), 1.0);

    let mut wanted = data.new_factor(rank);
    for (values, wanted) in data.blocks().iter().zip(&mut wanted) {
        product(values, &coefficients, wanted, BLOCK);
    }
    let mut weights = data.new_factor(rank);
    let mut first_violation = 0.0;
    let (mut iterations, mut has_converged) = (0, false);
    while iterations < options.maximum_iterations && !has_converged {
        iterations += 1;
        let mut violation = 0.0;
        for (wanted, weights) in wanted.iter().zip(&mut weights) {
            let target = Target::Known(wanted);
            violation += sweep((synergy_gram.as_ref(), &curvature), target, weights, BLOCK);
        }
        if iterations == 1 {
            first_violation = violation;
        }
        has_converged = violation <= options.tolerance * first_violation;
    }
    let weights = data.row_major(&weights);
    let rebuilt = rebuilt(&weights, synergies, rank, muscles);
    Ok(SynergyWeights { weights, rebuilt, iterations, has_converged })
}

/// Number of synergies in a row-major matrix with `muscles` columns; an error if they are not finite and ≥ 0.
pub(super) fn check_synergies(synergies: &[f64], muscles: usize) -> Result<usize, SubspaceError> {
    if muscles == 0 || synergies.is_empty() || !synergies.len().is_multiple_of(muscles) {
        return Err(SubspaceError::MuscleCount {
            expected: muscles,
            found: synergies.len() % muscles.max(1),
        });
    }
    if let Some(at) = synergies.iter().position(|x| !x.is_finite() || *x < 0.0) {
        let (row, muscle, value) = ((at / muscles) as u64, at % muscles, synergies[at]);
        return Err(if value.is_finite() {
            SubspaceError::Negative { row, muscle, value }
        } else {
            SubspaceError::NotFinite { row, muscle, value }
        });
    }
    Ok(synergies.len() / muscles)
}

/// Excitations squeezed into the cone of fixed synergies, one time step at a time: `x' = w H` with the weights above.
#[derive(Debug, Clone, PartialEq)]
pub struct SynergyProjection {
    /// Row-major rank × muscles.
    synergies: Vec<f64>,
    /// Row-major rank × rank: H Hᵀ.
    gram: Vec<f64>,
    muscles: usize,
    maximum_iterations: usize,
    tolerance: f64,
}

impl SynergyProjection {
    /// Onto `synergies`, row-major with `muscles` columns.
    pub fn new(
        synergies: &[f64],
        muscles: usize,
        options: &NmfOptions,
    ) -> Result<Self, SubspaceError> {
        options.check()?;
        check_synergies(synergies, muscles)?;
        let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>();
        let rows = || synergies.chunks_exact(muscles);
        Ok(Self {
            synergies: synergies.to_vec(),
            gram: rows().flat_map(|a| rows().map(move |b| dot(a, b))).collect(),
            muscles,
            maximum_iterations: options.maximum_iterations,
            tolerance: options.tolerance,
        })
    }

    /// Number of synergies.
    #[must_use]
    pub fn rank(&self) -> usize {
        self.synergies.len() / self.muscles
    }

    /// Number of muscles, i.e. the length of an excitation.
    #[must_use]
    pub fn muscle_count(&self) -> usize {
        self.muscles
    }

    /// Length of the scratch memory that [`Self::apply`] needs.
    #[must_use]
    pub fn scratch_length(&self) -> usize {
        2 * self.rank()
    }

    /// Replaces `excitation` by the nearest mixture of the synergies and returns the weights, a part of `scratch`.
    /// Does not allocate. NaN in, NaN out.
    ///
    /// # Panics
    /// If `excitation` has another length than there are muscles, or `scratch` is shorter than
    /// [`Self::scratch_length`].
    pub fn apply<'a>(&self, excitation: &mut [f64], scratch: &'a mut [f64]) -> &'a [f64] {
        assert_eq!(excitation.len(), self.muscles, "an excitation has one value per muscle");
        let rank = self.rank();
        let (wanted, rest) = scratch.split_at_mut(rank);
        let weights = &mut rest[..rank];
        weights.fill(0.0);
        for (wanted, synergy) in wanted.iter_mut().zip(self.synergies.chunks_exact(self.muscles)) {
            *wanted = synergy.iter().zip(&*excitation).map(|(s, x)| s * x).sum();
        }
        let mut first_violation = 0.0;
        for iteration in 0..self.maximum_iterations {
            let violation = self.sweep(wanted, weights);
            if iteration == 0 {
                first_violation = violation;
            }
            if violation.is_nan() || violation <= self.tolerance * first_violation {
                break;
            }
        }
        excitation.fill(0.0);
        for (&weight, synergy) in weights.iter().zip(self.synergies.chunks_exact(self.muscles)) {
            excitation.iter_mut().zip(synergy).for_each(|(x, share)| *x += weight * share);
        }
        weights
    }

    fn sweep(&self, wanted: &[f64], weights: &mut [f64]) -> f64 {
        let rank = weights.len();
        let mut violation = 0.0;
        for (t, gram) in self.gram.chunks_exact(rank).enumerate() {
            let gradient = gram.iter().zip(&*weights).map(|(g, w)| g * w).sum::<f64>() - wanted[t];
            violation += if weights[t] == 0.0 { gradient.min(0.0).abs() } else { gradient.abs() };
            if gram[t] > 0.0 {
                let moved = weights[t] - gradient / gram[t];
                // `max` would turn NaN into zero.
                weights[t] = if moved < 0.0 { 0.0 } else { moved };
            }
        }
        violation
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orthogonal_synergies_give_their_dot_products() {
        let synergies = [1.0, 0.0, 0.0, 0.0, 2.0, 0.0];
        let data = NonNegativeRows::new(&[0.3, 0.8, 0.9], 3).unwrap();
        let found = synergy_weights(&data, &synergies, &NmfOptions::default()).unwrap();
        assert_eq!(found.weights, [0.3, 0.4]);
        assert_eq!(found.rebuilt, [0.3, 0.8, 0.0]);
        let projection = SynergyProjection::new(&synergies, 3, &NmfOptions::default()).unwrap();
        let mut excitation = [0.3, 0.8, 0.9];
        let mut scratch = vec![7.0; projection.scratch_length()];
        assert_eq!(projection.apply(&mut excitation, &mut scratch), [0.3, 0.4]);
        assert_eq!(excitation.as_slice(), [0.3, 0.8, 0.0]);
    }

    #[test]
    fn nan_stays_visible() {
        let projection = SynergyProjection::new(&[1.0, 1.0], 2, &NmfOptions::default()).unwrap();
        let mut excitation = [f64::NAN, 0.5];
        projection.apply(&mut excitation, &mut [0.0; 2]);
        assert!(excitation.iter().all(|x| x.is_nan()));
    }

    #[test]
    fn bad_synergies_are_refused() {
        let options = NmfOptions::default();
        let new = |synergies: &[f64]| SynergyProjection::new(synergies, 2, &options).unwrap_err();
        assert_eq!(new(&[]), SubspaceError::MuscleCount { expected: 2, found: 0 });
        assert_eq!(new(&[1.0; 3]), SubspaceError::MuscleCount { expected: 2, found: 1 });
        assert!(matches!(new(&[1.0, -1.0]), SubspaceError::Negative { row: 0, muscle: 1, .. }));
        assert!(matches!(new(&[1.0, f64::INFINITY]), SubspaceError::NotFinite { .. }));
    }

    #[test]
    fn zero_synergies_have_zero_weights() {
        let data = NonNegativeRows::new(&[0.3, 0.8], 2).unwrap();
        let found = synergy_weights(&data, &[0.0, 0.0], &NmfOptions::default()).unwrap();
        assert_eq!((found.weights[0], found.has_converged), (0.0, true));
    }
}

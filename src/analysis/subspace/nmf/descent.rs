//! Non-negative matrix factorisation by hierarchical coordinate descent.
//!
//! Each iteration sweeps over all weights with the synergies fixed, then over all synergies with the new weights. It
//! stops when the violation of the optimality conditions (the sum of |projected gradients| met on the way) is at most
//! `tolerance` times that of the first iteration, or after `maximum_iterations`.
//!
//! One iteration passes over the data once: while a block of time steps is in the cache its weights are swept and its
//! part of the sums `WᵀW` and `XᵀW`, which the synergies need, is added. Blocks go in order on one thread, so the same
//! data give the same bytes.
//!
//! Degenerate: rank 0 or above the number of rows or muscles is an error. Data of lower rank than asked for leave
//! surplus components small but not zero; that is the fill, not a synergy. Controls without unit in, factors without
//! unit out; factors are defined up to a scale moved between a synergy and its weights, and up to their order.
//!
//! Reference: Cichocki & Phan 2009. Oracle: `tests/analysis_parity.rs`, algorithms `nmf`, `nmf_r2_curves`.

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};

use super::super::SubspaceError;
use super::NmfOptions;
use super::dot_products::DotProducts;
use super::rows::{BLOCK, NonNegativeRows};
use super::start::double_svd;
use super::sweep::{Coefficients, LANES, Target, sweep};

/// Synergies and their time courses.
#[derive(Debug, Clone, PartialEq)]
pub struct Factorisation {
    pub rank: usize,
    pub muscles: usize,
    /// Row-major rank × muscles: one synergy per row.
    pub synergies: Vec<f64>,
    /// Row-major time steps × rank.
    pub weights: Vec<f64>,
    /// Sweeps over both factors that were made.
    pub iterations: usize,
    /// Whether the tolerance was reached.
    pub has_converged: bool,
}

impl Factorisation {
    /// W H, row-major time steps × muscles.
    #[must_use]
    pub fn rebuilt(&self) -> Vec<f64> {
        rebuilt(&self.weights, &self.synergies, self.rank, self.muscles)
    }
}

/// `weights` (row-major, `rank` columns) times `synergies` (row-major rank × `muscles`).
pub(super) fn rebuilt(weights: &[f64], synergies: &[f64], rank: usize, muscles: usize) -> Vec<f64> {
    let mut values = vec![0.0; weights.len() / rank * muscles];
    for (row, weights) in values.chunks_exact_mut(muscles).zip(weights.chunks_exact(rank)) {
        for (&weight, synergy) in weights.iter().zip(synergies.chunks_exact(muscles)) {
            row.iter_mut().zip(synergy).for_each(|(value, share)| *value += weight * share);
        }
    }
    values
}

/// Factorises `data` into `rank` synergies and their weights.
pub fn nonnegative_factorisation(
    data: &NonNegativeRows,
    rank: usize,
    options: &NmfOptions,
) -> Result<Factorisation, SubspaceError> {
    options.check()?;
    data.check_rank(rank)?;
    let muscles = data.muscle_count();
    let lanes = muscles.next_multiple_of(LANES);
    let (mut weights, mut synergies) = double_svd(data, rank, options.start, lanes);

    let mut gram = Mat::<f64>::zeros(rank, rank);
    let mut wanted = Mat::<f64>::zeros(lanes, rank);
    let (mut curvature, mut negative) = (Coefficients::default(), Coefficients::default());
    let mut with_values = DotProducts::new(muscles, rank);
    let mut with_weights = DotProducts::new(rank, rank);
    let mut first_violation = 0.0;
    let (mut iterations, mut has_converged) = (0, false);
    while iterations < options.maximum_iterations && !has_converged {
        iterations += 1;
        gram_of(&mut gram, &synergies);
        curvature.set(gram.as_ref(), 1.0);
        negative.set(synergies.as_ref().subrows(0, muscles), -1.0);
        with_values.clear();
        with_weights.clear();
        let mut violation = 0.0;
        for (values, weights) in data.blocks().iter().zip(&mut weights) {
            let target = Target::Product { values, negative: &negative };
            violation += sweep((gram.as_ref(), &curvature), target, weights, BLOCK);
            with_values.add(values, weights, BLOCK);
            with_weights.add(weights, weights, BLOCK);
        }
        with_values.fold_into(&mut wanted);
        with_weights.fold_into(&mut gram);
        curvature.set(gram.as_ref(), 1.0);
        let known = Target::Known(&wanted);
        violation += sweep((gram.as_ref(), &curvature), known, &mut synergies, lanes);
        if iterations == 1 {
            first_violation = violation;
        }
        has_converged = violation <= options.tolerance * first_violation;
    }
    Ok(Factorisation {
        rank,
        muscles,
        synergies: (0..rank)
            .flat_map(|component| synergies.col_as_slice(component)[..muscles].to_vec())
            .collect(),
        weights: data.row_major(&weights),
        iterations,
        has_converged,
    })
}

/// `FᵀF` of a factor with one component per column.
pub(super) fn gram_of(into: &mut Mat<f64>, factor: &Mat<f64>) {
    let factor = factor.as_ref();
    matmul(into.as_mut(), Accum::Replace, factor.transpose(), factor, 1.0, Par::Seq);
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::super::reconstruction;
    use super::super::NmfStart;
    use super::*;

    /// Ten muscles driven by two synergies with different time courses.
    fn two_synergies(rows: usize) -> Vec<f64> {
        (0..rows)
            .flat_map(|t| {
                let time = t as f64 * 0.1;
                let (a, b) = (time.sin().max(0.0), (0.37 * time).cos().max(0.0));
                (0..10_i32).map(move |m| a * f64::from(m % 3) + b * f64::from((m + 1) % 4) / 3.0)
            })
            .collect()
    }

    #[test]
    fn two_synergies_are_found_and_a_third_adds_nothing() {
        let values = two_synergies(700);
        let data = NonNegativeRows::new(&values, 10).unwrap();
        let options = NmfOptions { tolerance: 1e-8, ..Default::default() };
        let score = |rank| {
            let fit = nonnegative_factorisation(&data, rank, &options).unwrap();
            assert!(fit.has_converged, "rank {rank} after {} iterations", fit.iterations);
            reconstruction(&values, &fit.rebuilt(), 10).unwrap().centred.unwrap()
        };
        assert!(score(1) < 0.95);
        assert!(score(2) > 0.999_999);
        assert!(score(3) > 0.999_999);
    }

    #[test]
    fn a_rank_beyond_rows_or_muscles_is_refused() {
        let data = NonNegativeRows::new(&[1.0, 2.0, 3.0, 4.0, 5.0, 7.0], 3).unwrap();
        for asked in [0, 3] {
            assert_eq!(
                nonnegative_factorisation(&data, asked, &NmfOptions::default()),
                Err(SubspaceError::ComponentCount { asked, available: 2 })
            );
        }
        let options = NmfOptions { tolerance: f64::NAN, ..Default::default() };
        assert!(nonnegative_factorisation(&data, 1, &options).is_err());
    }

    #[test]
    fn a_fit_repeats_to_the_byte_and_another_seed_gives_another() {
        let data = NonNegativeRows::new(&two_synergies(300), 10).unwrap();
        let fit = |seed| {
            let start = NmfStart::Noise { seed };
            let options = NmfOptions { start, maximum_iterations: 20, ..Default::default() };
            nonnegative_factorisation(&data, 4, &options).unwrap()
        };
        assert_eq!(fit(5), fit(5));
        assert_ne!(fit(5).synergies, fit(6).synergies);
    }

    proptest! {
        #[test]
        fn factors_are_never_negative_and_the_error_never_grows(
            values in prop::collection::vec(0.0..1.0_f64, 60),
            rank in 1..=6_usize,
        ) {
            let data = NonNegativeRows::new(&values, 6).unwrap();
            let mut last = f64::INFINITY;
            for maximum_iterations in [1, 2, 5, 20] {
                let options =
                    NmfOptions { start: NmfStart::Mean, maximum_iterations, tolerance: 1e-12 };
                let fit = nonnegative_factorisation(&data, rank, &options).unwrap();
                prop_assert!(fit.weights.iter().chain(&fit.synergies).all(|&x| x >= 0.0));
                let error: f64 =
                    fit.rebuilt().iter().zip(&values).map(|(x, y)| (x - y) * (x - y)).sum();
                prop_assert!(error <= last + 1e-12, "{error} after {last}");
                last = error;
            }
        }
    }
}

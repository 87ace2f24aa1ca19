//! Varimax: the rotation of the factors after which each has few large loadings and many small ones.
//!
//! Maximises `V(T) = Σⱼ [ Σᵢ bᵢⱼ⁴/p − (Σᵢ bᵢⱼ²/p)² ]`, the variance of the squared loadings of each factor j over the p
//! muscles i, with B = X T and T orthogonal. Kaiser's normalisation first divides each muscle's loadings by their
//! length, so that all muscles count alike, and multiplies them back at the end.
//!
//! T starts at the identity; each step replaces it by the nearest orthogonal matrix to the gradient,
//! `G = Xᵀ (B³ − B diag(Σᵢ bᵢⱼ²)/p) = U S Wᵀ → T = U Wᵀ`, which never lowers the criterion, and stops when the sum of
//! the singular values no longer grows by one part in 10¹⁴. Where the criterion is flat that can take very long, so
//! passes over all pairs of factors finish it: each turns a pair to the top of its criterion, by Kaiser's
//! `θ = atan2(p Σ 2uv − 2 Σu Σv, p Σ (u² − v²) − (Σu)² + (Σv)²) / 4`. Converged is a pass without an angle of 10⁻⁹.
//!
//! Degenerate: with one factor there is nothing to rotate. Rows of no length are left alone. There may be several
//! maxima; this is the one uphill of the unrotated factors.
//!
//! Reference: Kaiser 1958; the iteration: Magnus & Neudecker's form of Horst's, as in R's `varimax`. Oracle:
//! `tests/signals_parity.rs`, algorithms `varimax`, `factor_analysis_exact`.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::svd::{ComputeSvdVectors, svd, svd_scratch};
use faer::{Mat, Par};

use super::FactorError;
use super::planar::{PairSums, turn};

/// Angles below this, in rad, turn nothing any more.
const LEVEL: f64 = 1e-9;
/// Passes converge quadratically; a handful is enough.
const MOST_PASSES: usize = 100;
/// A pair whose criterion varies by less than this share of what it could is flat: any angle is as good.
const FLAT: f64 = 1e-12;
/// Muscles whose loadings are shorter than this are not divided by their length.
const SHORTEST: f64 = 1e-12;

/// How to rotate.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VarimaxOptions {
    /// Whether to divide each muscle's loadings by their length.
    pub kaiser: bool,
    /// Relative gain of the sum of singular values below which the steps end.
    pub tolerance: f64,
    pub most_iterations: usize,
}

impl Default for VarimaxOptions {
    fn default() -> Self {
        Self { kaiser: true, tolerance: 1e-14, most_iterations: 10_000 }
    }
}

/// Loadings after a rotation.
#[derive(Debug, Clone, PartialEq)]
pub struct Rotated {
    /// Muscles × factors, row by row.
    pub loadings: Vec<f64>,
    /// The orthogonal matrix T, factors × factors, row by row.
    pub rotation: Vec<f64>,
    /// Steps (or passes) taken.
    pub iterations: usize,
    pub converged: bool,
}

/// Rotates `loadings` (muscles × factors, row by row) to the maximum of the criterion.
pub fn varimax(
    loadings: &[f64],
    factors: usize,
    options: &VarimaxOptions,
) -> Result<Rotated, FactorError> {
    let lengths = row_lengths(loadings, factors, options.kaiser);
    let muscles = lengths.len();
    let normalised = Mat::from_fn(muscles, factors, |i, j| loadings[i * factors + j] / lengths[i]);
    let (start, iterations) = climb(&normalised, options)?;
    let columns = |matrix: &Mat<f64>| -> Vec<Vec<f64>> {
        matrix.col_iter().map(|column| column.iter().copied().collect()).collect()
    };
    let mut rotation = columns(&start);
    let mut rotated = columns(&(&normalised * &start));
    let converged = finish(&mut rotated, &mut rotation);
    let entries = |rows: usize| (0..rows).flat_map(|i| (0..factors).map(move |j| (i, j)));
    Ok(Rotated {
        loadings: entries(muscles).map(|(i, j)| rotated[j][i] * lengths[i]).collect(),
        rotation: entries(factors).map(|(i, j)| rotation[j][i]).collect(),
        iterations,
        converged,
    })
}

/// Climbs from the identity towards the maximum; the rotation and the number of steps.
fn climb(
    normalised: &Mat<f64>,
    options: &VarimaxOptions,
) -> Result<(Mat<f64>, usize), FactorError> {
    let (muscles, factors) = (normalised.nrows(), normalised.ncols());
    let mut rotation = Mat::<f64>::identity(factors, factors);
    let (mut iterations, mut best, mut rises) = (0, 0.0, factors > 1);
    while rises && iterations < options.most_iterations {
        let rotated = normalised * &rotation;
        let squares: Vec<f64> =
            (0..factors).map(|j| rotated.col(j).iter().map(|b| b * b).sum()).collect();
        let steepness = Mat::from_fn(muscles, factors, |i, j| {
            let b = rotated[(i, j)];
            b * (b * b - squares[j] / muscles as f64)
        });
        let gradient = normalised.transpose() * steepness;
        let (nearest, sum) = nearest_orthogonal(&gradient)?;
        rotation = nearest;
        iterations += 1;
        rises = sum > 0.0 && sum >= best * (1.0 + options.tolerance);
        best = sum;
    }
    Ok((rotation, iterations))
}

/// Turns pairs of columns to the top until no pair turns; whether that was reached.
fn finish(rotated: &mut [Vec<f64>], rotation: &mut [Vec<f64>]) -> bool {
    for _ in 0..MOST_PASSES {
        let mut largest = 0.0_f64;
        for i in 0..rotated.len() {
            for j in i + 1..rotated.len() {
                let sums = PairSums::of(&rotated[i], &rotated[j]);
                let numerator = sums.mixed - 2.0 * sums.product;
                if numerator.hypot(sums.denominator) <= FLAT * sums.scale {
                    continue;
                }
                let angle = numerator.atan2(sums.denominator) / 4.0;
                turn(rotated, i, j, angle);
                turn(rotation, i, j, angle);
                largest = largest.max(angle.abs());
            }
        }
        if largest < LEVEL {
            return true;
        }
    }
    false
}

/// The criterion V of `loadings` as they are (muscles × factors, row by row).
#[must_use]
pub fn varimax_criterion(loadings: &[f64], factors: usize) -> f64 {
    let muscles = (loadings.len() / factors) as f64;
    let of_factor = |factor: usize| {
        let column = loadings.iter().skip(factor).step_by(factors);
        let (second, fourth) = column.fold((0.0, 0.0), |(second, fourth), b| {
            let square = b * b;
            (second + square / muscles, fourth + square * square / muscles)
        });
        fourth - second * second
    };
    (0..factors).map(of_factor).sum()
}

/// Length of each row if rows are to be divided by it, else 1.
pub(super) fn row_lengths(loadings: &[f64], factors: usize, kaiser: bool) -> Vec<f64> {
    let length = |row: &[f64]| row.iter().map(|x| x * x).sum::<f64>().sqrt();
    let divisor = |length: f64| if kaiser && length >= SHORTEST { length } else { 1.0 };
    loadings.chunks_exact(factors.max(1)).map(|row| divisor(length(row))).collect()
}

/// The orthogonal factor of the polar decomposition, and the sum of the singular values.
fn nearest_orthogonal(matrix: &Mat<f64>) -> Result<(Mat<f64>, f64), FactorError> {
    let factors = matrix.nrows();
    let (mut left, mut right) = (Mat::zeros(factors, factors), Mat::zeros(factors, factors));
    let mut singular = Diag::<f64>::zeros(factors);
    let full = ComputeSvdVectors::Full;
    let scratch = svd_scratch::<f64>(factors, factors, full, full, Par::Seq, Default::default());
    svd(
        matrix.as_ref(),
        singular.as_mut(),
        Some(left.as_mut()),
        Some(right.as_mut()),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    )
    .map_err(|_| FactorError::NoConvergence { factors })?;
    let sum: f64 = singular.column_vector().iter().sum();
    let nearest = left * right.transpose();
    sum.is_finite().then_some((nearest, sum)).ok_or(FactorError::NoConvergence { factors })
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Derivative of the criterion when factors `a` and `b` are turned into each other.
    fn slope(loadings: &[f64], factors: usize, a: usize, b: usize) -> f64 {
        let muscles = (loadings.len() / factors) as f64;
        let (mut cubic, mut product, mut difference) = (0.0, 0.0, 0.0);
        for row in loadings.chunks_exact(factors) {
            let (x, y) = (row[a], row[b]);
            cubic += x * y * (x * x - y * y);
            product += x * y;
            difference += x * x - y * y;
        }
        4.0 / muscles * (cubic - product * difference / muscles)
    }

    /// Turns factors `a` and `b` of `loadings` by `angle`.
    fn turn(loadings: &mut [f64], factors: usize, (a, b): (usize, usize), angle: f64) {
        let (sine, cosine) = angle.sin_cos();
        for row in loadings.chunks_exact_mut(factors) {
            let (x, y) = (row[a], row[b]);
            (row[a], row[b]) = (cosine * x + sine * y, cosine * y - sine * x);
        }
    }

    #[test]
    fn the_slope_of_the_tests_is_the_slope_of_the_criterion() {
        let loadings = [0.9, 0.1, -0.3, 0.2, 0.8, 0.5, -0.4, 0.6, 0.7];
        let (mut above, mut below) = (loadings, loadings);
        turn(&mut above, 3, (0, 2), 1e-5);
        turn(&mut below, 3, (0, 2), -1e-5);
        let numeric = (varimax_criterion(&above, 3) - varimax_criterion(&below, 3)) / 2e-5;
        assert!((numeric - slope(&loadings, 3, 0, 2)).abs() < 1e-9);
    }

    #[test]
    fn a_turned_simple_structure_is_found_again() {
        let simple: Vec<f64> =
            (0..12).flat_map(|i| (0..3).map(move |j| f64::from(u8::from(i % 3 == j)))).collect();
        let mut turned = simple.clone();
        turn(&mut turned, 3, (0, 1), 0.4);
        turn(&mut turned, 3, (1, 2), -0.3);
        turn(&mut turned, 3, (0, 2), 0.2);
        let found = varimax(&turned, 3, &VarimaxOptions::default()).unwrap();
        assert!(found.converged);
        for (found, want) in found.loadings.iter().zip(&simple) {
            assert!((found.abs() - want).abs() < 1e-9);
        }
    }

    #[test]
    fn one_factor_is_not_rotated() {
        let found = varimax(&[0.3, -0.5], 1, &VarimaxOptions::default()).unwrap();
        assert_eq!((found.loadings, found.rotation), (vec![0.3, -0.5], vec![1.0]));
        assert_eq!((found.iterations, found.converged), (0, true));
    }

    #[test]
    fn loadings_of_zero_stay_zero() {
        let found = varimax(&[0.0; 8], 2, &VarimaxOptions::default()).unwrap();
        assert_eq!(found.loadings, [0.0; 8]);
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(64))]

        #[test]
        fn the_maximum_is_level_and_higher_than_random_rotations(
            noise in prop::collection::vec(-0.2..0.2_f64, 14 * 4),
            starts in prop::collection::vec(-3.2..3.2_f64, 6),
            turns in prop::collection::vec(prop::array::uniform6(-3.2..3.2_f64), 40),
        ) {
            const PAIRS: [(usize, usize); 6] = [(0, 1), (0, 2), (0, 3), (1, 2), (1, 3), (2, 3)];
            let strong = |at: usize| if at / 4 % 4 == at % 4 { 0.8 } else { 0.0 };
            let mut loadings: Vec<f64> =
                noise.iter().enumerate().map(|(at, noise)| strong(at) + noise).collect();
            PAIRS.iter().zip(&starts).for_each(|(&pair, &by)| turn(&mut loadings, 4, pair, by));
            let options = VarimaxOptions { kaiser: false, ..Default::default() };
            let found = varimax(&loadings, 4, &options).unwrap();
            prop_assert!(found.converged);
            let highest = varimax_criterion(&found.loadings, 4);
            for (a, b) in PAIRS {
                prop_assert!(slope(&found.loadings, 4, a, b).abs() < 1e-9);
            }
            prop_assert!(highest >= varimax_criterion(&loadings, 4) - 1e-12);
            for angles in &turns {
                let mut other = found.loadings.clone();
                PAIRS.iter().zip(angles).for_each(|(&pair, &by)| turn(&mut other, 4, pair, by));
                prop_assert!(varimax_criterion(&other, 4) <= highest + 1e-12);
            }
        }

        #[test]
        fn lengths_of_muscles_stay_and_the_rotation_is_orthogonal(
            loadings in prop::collection::vec(-1.0..1.0_f64, 3 * 10),
            kaiser in any::<bool>(),
        ) {
            let options = VarimaxOptions { kaiser, ..Default::default() };
            let found = varimax(&loadings, 3, &options).unwrap();
            let square = |row: &[f64]| row.iter().map(|x| x * x).sum::<f64>();
            for (before, after) in loadings.chunks_exact(3).zip(found.loadings.chunks_exact(3)) {
                prop_assert!((square(before) - square(after)).abs() < 1e-12);
            }
            for i in 0..3 {
                for j in 0..3 {
                    let product: f64 =
                        (0..3).map(|k| found.rotation[3 * k + i] * found.rotation[3 * k + j]).sum();
                    prop_assert!((product - f64::from(u8::from(i == j))).abs() < 1e-12);
                }
            }
        }
    }
}

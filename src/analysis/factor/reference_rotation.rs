//! The rotation of the authors' suite. It is called varimax there, but does not maximise varimax's criterion.
//!
//! Rows of the loadings are divided by their length. Each pass goes over all pairs of columns i < j in order; with x, y
//! the two columns, u = x² − y², v = 2xy and p muscles,
//!
//! ```text
//! num = 2 (p Σ 2uv − Σu Σv)    den = p Σ (u² − v²) − (Σu)² + (Σv)²    θ = atan2(num, den) / 4
//! x ← x cos θ + y sin θ        y ← y cos θ − x sin θ
//! ```
//!
//! Kaiser's angle has `num = p Σ 2uv − 2 Σu Σv`. With the first term doubled each pass turns about twice as far as it
//! should and ends as far on the other side. Mostly this goes on to the last of 1000 passes: neighbouring passes differ
//! by about 0.1 in a loading, and a change of the input by one part in 10¹² can change the result completely.
//! [`super::rotate`] therefore says how far the result moves when its input does.
//!
//! A pair whose |den| is below 10⁻¹² is skipped. Converged is a pass that changes no entry of T by 10⁻⁶. One column is
//! not rotated. Oracle: `tests/signals_parity.rs`, algorithms `planar_rotation`, `factor_analysis`.

use super::Rotated;
use super::planar::{PairSums, turn};
use super::varimax::row_lengths;

/// Below this a pair of columns has no angle.
const LEAST_DENOMINATOR: f64 = 1e-12;

/// When to stop.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReferenceRotationOptions {
    pub most_passes: usize,
    /// Change of every entry of T below which the rotation has converged.
    pub tolerance: f64,
}

impl Default for ReferenceRotationOptions {
    fn default() -> Self {
        Self { most_passes: 1000, tolerance: 1e-6 }
    }
}

/// Rotates `loadings` (muscles × factors, row by row) as the authors' suite does.
#[must_use]
pub fn reference_rotation(
    loadings: &[f64],
    factors: usize,
    options: &ReferenceRotationOptions,
) -> Rotated {
    let lengths = row_lengths(loadings, factors, true);
    let muscles = lengths.len();
    let column = |j: usize| -> Vec<f64> {
        loadings
            .iter()
            .skip(j)
            .step_by(factors)
            .zip(&lengths)
            .map(|(x, length)| x / length)
            .collect()
    };
    let mut columns: Vec<Vec<f64>> = (0..factors).map(column).collect();
    let unit = |j: usize| (0..factors).map(|i| f64::from(u8::from(i == j))).collect();
    let mut rotation: Vec<Vec<f64>> = (0..factors).map(unit).collect();
    let (mut passes, mut converged) = (0, factors < 2);
    while !converged && passes < options.most_passes {
        let before = rotation.clone();
        for i in 0..factors {
            for j in i + 1..factors {
                if let Some(angle) = angle(&columns[i], &columns[j]) {
                    turn(&mut columns, i, j, angle);
                    turn(&mut rotation, i, j, angle);
                }
            }
        }
        passes += 1;
        let changes = before.iter().flatten().zip(rotation.iter().flatten());
        converged = changes.into_iter().all(|(old, new)| (new - old).abs() < options.tolerance);
    }
    let transposed = |columns: &[Vec<f64>], i: usize| -> Vec<f64> {
        columns.iter().map(|column| column[i]).collect()
    };
    let scaled = |i: usize| transposed(&columns, i).into_iter().map(move |x| (i, x));
    Rotated {
        loadings: (0..muscles).flat_map(scaled).map(|(i, x)| x * lengths[i]).collect(),
        rotation: (0..factors).flat_map(|i| transposed(&rotation, i)).collect(),
        iterations: passes,
        converged,
    }
}

fn angle(x: &[f64], y: &[f64]) -> Option<f64> {
    let sums = PairSums::of(x, y);
    let numerator = 2.0 * (sums.mixed - sums.product);
    let has_angle = sums.denominator.abs() >= LEAST_DENOMINATOR;
    has_angle.then(|| numerator.atan2(sums.denominator) / 4.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::factor::{VarimaxOptions, varimax, varimax_criterion};

    /// Ten muscles near the first factor, four near the second, all of unit length.
    fn loadings() -> Vec<f64> {
        let direction = |muscle: u32| {
            let quarter = if muscle.is_multiple_of(4) { 0.25 } else { 0.0 };
            (std::f64::consts::TAU * quarter + 0.2 * f64::from(muscle).sin()).sin_cos()
        };
        (1..=14).map(direction).flat_map(|(sine, cosine)| [cosine, sine]).collect()
    }

    #[test]
    fn it_uses_up_its_passes_and_ends_below_the_maximum_of_varimax() {
        let found = reference_rotation(&loadings(), 2, &ReferenceRotationOptions::default());
        assert_eq!((found.iterations, found.converged), (1000, false));
        let best = varimax(&loadings(), 2, &VarimaxOptions::default()).unwrap();
        let lost = varimax_criterion(&best.loadings, 2) - varimax_criterion(&found.loadings, 2);
        assert!(lost > 1e-3, "{lost}");
    }

    #[test]
    fn one_column_and_columns_of_zero_are_left_alone() {
        let options = ReferenceRotationOptions::default();
        let one = reference_rotation(&[0.3, -0.5], 1, &options);
        assert_eq!((one.loadings, one.iterations), (vec![0.3, -0.5], 0));
        let zeros = reference_rotation(&[0.0; 6], 2, &options);
        assert_eq!((zeros.loadings, zeros.iterations, zeros.converged), (vec![0.0; 6], 1, true));
    }
}

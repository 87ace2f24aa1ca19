//! Where the descent starts: the non-negative double singular value decomposition.
//!
//! With `X = Σ σⱼ uⱼ vⱼᵀ`, the first pair is `√σ₁|u₁|, √σ₁|v₁|`. Every other pair takes the positive or the negative
//! parts of (uⱼ, vⱼ), whichever has the larger product m of norms (ties: negative), each of unit length, scaled by
//! `√(σⱼ m)`. Entries below 10⁻⁶ become zero; zeros are then filled, because a zero can be slow to grow.
//!
//! Noise is drawn from `ChaCha8` seeded with the given seed and nothing else, first for the weights row by row, then for
//! the synergies. The published fits use another generator, so single fits agree with theirs only statistically.
//!
//! Reference: Boutsidis & Gallopoulos 2008. Oracle: `tests/analysis_parity.rs`, algorithm `nmf`.

use std::f64::consts::TAU;

use faer::Mat;
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::NmfStart;
use super::rows::{BLOCK, NonNegativeRows};
use super::sweep::{Coefficients, product};

/// Entries below this become zero before zeros are filled.
const SMALLEST: f64 = 1e-6;

/// First weights, in the blocks of the data, and first synergies (muscles × rank, in a matrix of `lanes` rows).
pub(super) fn double_svd(
    data: &NonNegativeRows,
    rank: usize,
    fill: NmfStart,
    lanes: usize,
) -> (Vec<Mat<f64>>, Mat<f64>) {
    let muscles = data.muscle_count();
    let vectors = data.right_vectors().subcols(0, rank);
    let mut coefficients = Coefficients::default();
    coefficients.set(vectors, 1.0);
    let mut weights = data.new_factor(rank);
    for (values, weights) in data.blocks().iter().zip(&mut weights) {
        // X V holds the left singular vectors, each times its singular value.
        product(values, &coefficients, weights, BLOCK);
    }
    let mut synergies = Mat::<f64>::zeros(lanes, rank);
    for component in 0..rank {
        let singular_value = data.singular_values()[component];
        let left = weights.iter().flat_map(|block| &block.col_as_slice(component)[..BLOCK]);
        let right: Vec<f64> = vectors.col(component).iter().copied().collect();
        let sides = Sides::of(component == 0, singular_value, left, &right);
        for block in &mut weights {
            let column = &mut block.col_as_slice_mut(component)[..BLOCK];
            column.iter_mut().for_each(|x| *x = sides.left(*x));
        }
        for (muscle, &x) in right.iter().enumerate() {
            synergies[(muscle, component)] = sides.right(x);
        }
    }
    let mut fill = Fill::new(fill, data.mean());
    let mut left = data.row_count();
    for block in &mut weights {
        for row in 0..BLOCK.min(left) {
            (0..rank).for_each(|component| fill.zero(&mut block[(row, component)]));
        }
        left = left.saturating_sub(BLOCK);
    }
    for component in 0..rank {
        (0..muscles).for_each(|muscle| fill.zero(&mut synergies[(muscle, component)]));
    }
    (weights, synergies)
}

/// Which part of a pair of singular vectors is kept, and how it is scaled.
struct Sides {
    /// 1: positive parts, −1: negative parts, 0: absolute values.
    sign: f64,
    left_scale: f64,
    right_scale: f64,
}

impl Sides {
    /// `left` is the left singular vector times its singular value.
    fn of<'a>(
        is_first: bool,
        singular_value: f64,
        left: impl Iterator<Item = &'a f64>,
        right: &[f64],
    ) -> Self {
        if singular_value <= 0.0 {
            return Self { sign: 1.0, left_scale: 0.0, right_scale: 0.0 };
        }
        if is_first {
            let root = singular_value.sqrt();
            return Self { sign: 0.0, left_scale: root / singular_value, right_scale: root };
        }
        let (left_positive, left_negative) = norms_of_parts(left);
        let (right_positive, right_negative) = norms_of_parts(right.iter());
        let positive = left_positive * right_positive;
        let negative = left_negative * right_negative;
        let (sign, left_norm, right_norm) = if positive > negative {
            (1.0, left_positive, right_positive)
        } else {
            (-1.0, left_negative, right_negative)
        };
        // √(σ m) with m of unit vectors; here the left norms still carry σ.
        let scale = (left_norm * right_norm).sqrt();
        let over = |norm: f64| if norm > 0.0 { scale / norm } else { 0.0 };
        Self { sign, left_scale: over(left_norm), right_scale: over(right_norm) }
    }

    fn part(&self, x: f64) -> f64 {
        if self.sign == 0.0 { x.abs() } else { (self.sign * x).max(0.0) }
    }

    fn left(&self, x: f64) -> f64 {
        cut(self.left_scale * self.part(x))
    }

    fn right(&self, x: f64) -> f64 {
        cut(self.right_scale * self.part(x))
    }
}

fn cut(x: f64) -> f64 {
    if x < SMALLEST { 0.0 } else { x }
}

/// Euclidean norms of the positive and of the negative entries.
fn norms_of_parts<'a>(entries: impl Iterator<Item = &'a f64>) -> (f64, f64) {
    let (positive, negative) = entries.fold((0.0, 0.0), |(positive, negative), &x| {
        if x > 0.0 { (positive + x * x, negative) } else { (positive, negative + x * x) }
    });
    (f64::sqrt(positive), f64::sqrt(negative))
}

/// Fills zeros.
struct Fill {
    mean: f64,
    generator: Option<ChaCha8Rng>,
    /// Normal draws come in pairs; this is the second one.
    spare: Option<f64>,
}

impl Fill {
    fn new(fill: NmfStart, mean: f64) -> Self {
        let generator = match fill {
            NmfStart::Noise { seed } => Some(ChaCha8Rng::seed_from_u64(seed)),
            NmfStart::Mean => None,
        };
        Self { mean, generator, spare: None }
    }

    fn zero(&mut self, entry: &mut f64) {
        if *entry == 0.0 {
            *entry = match &mut self.generator {
                None => self.mean,
                Some(generator) => {
                    (self.mean * standard_normal(generator, &mut self.spare) / 100.0).abs()
                }
            };
        }
    }
}

/// A normal draw (Box & Muller 1958).
fn standard_normal(generator: &mut ChaCha8Rng, spare: &mut Option<f64>) -> f64 {
    if let Some(value) = spare.take() {
        return value;
    }
    // 53 random bits, in (0, 1] and in [0, 1).
    let unit = 0.5_f64.powi(53);
    let radius = (-2.0 * (((generator.next_u64() >> 11) + 1) as f64 * unit).ln()).sqrt();
    let (sine, cosine) = (TAU * (generator.next_u64() >> 11) as f64 * unit).sin_cos();
    *spare = Some(radius * sine);
    radius * cosine
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_standard_normal() {
        let mut generator = ChaCha8Rng::seed_from_u64(3);
        let mut spare = None;
        let draws: Vec<f64> =
            (0..100_000).map(|_| standard_normal(&mut generator, &mut spare)).collect();
        let moment = |power: i32| draws.iter().map(|x| x.powi(power)).sum::<f64>() / 1e5;
        // Five standard errors of each moment: √(1, 2, 15, 96) / √100,000.
        assert!(moment(1).abs() < 0.016 && (moment(2) - 1.0).abs() < 0.023, "{}", moment(2));
        assert!(moment(3).abs() < 0.062 && (moment(4) - 3.0).abs() < 0.16, "{}", moment(4));
    }

    #[test]
    fn rank_one_data_start_at_their_own_factors() {
        let values = [2.0, 4.0, 1.0, 2.0, 3.0, 6.0];
        let data = NonNegativeRows::new(&values, 2).unwrap();
        let (weights, synergies) = double_svd(&data, 1, NmfStart::Mean, 64);
        for (row, pair) in values.chunks_exact(2).enumerate() {
            for (muscle, want) in pair.iter().enumerate() {
                let found = weights[0][(row, 0)] * synergies[(muscle, 0)];
                assert!((found - want).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn no_entry_of_the_data_starts_at_zero_and_no_padding_elsewhere() {
        let values: Vec<f64> =
            (0..40).map(|i| if i % 3 == 0 { 0.0 } else { f64::from(i) }).collect();
        let data = NonNegativeRows::new(&values, 4).unwrap();
        for fill in [NmfStart::Mean, NmfStart::Noise { seed: 1 }] {
            let (weights, synergies) = double_svd(&data, 4, fill, 64);
            for component in 0..4 {
                let column = weights[0].col_as_slice(component);
                assert!(column[..10].iter().all(|&x| x > 0.0));
                assert!(column[10..].iter().all(|&x| x == 0.0));
                let column = synergies.col_as_slice(component);
                assert!(column[..4].iter().all(|&x| x > 0.0));
                assert!(column[4..].iter().all(|&x| x == 0.0));
            }
        }
    }
}

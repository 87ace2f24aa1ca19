//! Layer normalisation of every column: `y = x̂ w + b`, `x̂ = (x − mean)/√(variance + 1e-5)`, biased variance.
//!
//! Back, with `g = w ∂y`: `∂x = (g − mean(g) − x̂ mean(g x̂))/√(variance + 1e-5)`, `∂w += Σ ∂y x̂`, `∂b += Σ ∂y`.

use std::ops::Range;

use pulp::Arch;

use super::{LANES, fold};

/// PyTorch's default.
pub(super) const EPSILON: f32 = 1e-5;

/// Columns that are worked off together: their sums stay in the first-level cache.
const BLOCK: usize = 16 * LANES;

/// A layer normalisation with the parameters of one minibatch.
#[derive(Debug, Clone)]
pub struct LayerNorm {
    pub(super) weight_place: Range<usize>,
    pub(super) bias_place: Range<usize>,
    pub(super) weight: Vec<f32>,
    pub(super) bias: Vec<f32>,
}

/// What backward needs: `x̂`, features × columns, and the factor of every column.
#[derive(Debug, Clone)]
pub struct Normed {
    scaled: Vec<f32>,
    factors: Vec<f32>,
}

impl Normed {
    #[must_use]
    pub fn new(features: usize, columns: usize) -> Self {
        Self { scaled: vec![0.0; features * columns], factors: vec![0.0; columns] }
    }
}

impl LayerNorm {
    /// The norm whose weight and bias lie at these places of all parameters.
    #[must_use]
    pub fn new(weight_place: Range<usize>, bias_place: Range<usize>) -> Self {
        let zeros = vec![0.0; bias_place.len()];
        Self { weight_place, bias_place, weight: zeros.clone(), bias: zeros }
    }

    /// Takes the parameters of a new minibatch.
    pub fn load(&mut self, numbers: &[f32]) {
        self.weight.copy_from_slice(&numbers[self.weight_place.clone()]);
        self.bias.copy_from_slice(&numbers[self.bias_place.clone()]);
    }

    /// Normalises every column of `x` into `y`.
    pub fn apply(&self, x: &[f32], columns: usize, kept: &mut Normed, y: &mut [f32]) {
        Arch::new().dispatch(
            #[inline(always)]
            move || {
                let (kept, y) = (kept, y);
                for first in (0..columns).step_by(BLOCK) {
                    self.apply_to_block(x, columns, first, kept, y);
                }
            },
        );
    }

    #[expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
    #[inline(always)]
    fn apply_to_block(
        &self,
        x: &[f32],
        columns: usize,
        first: usize,
        kept: &mut Normed,
        y: &mut [f32],
    ) {
        let count = BLOCK.min(columns - first);
        let features = self.weight.len() as f32;
        let (mut mean, mut factors) = ([0.0_f32; BLOCK], [0.0_f32; BLOCK]);
        let (mean, factors) = (&mut mean[..count], &mut factors[..count]);
        for x in x.chunks_exact(columns) {
            mean.iter_mut().zip(&x[first..]).for_each(|(m, x)| *m += x);
        }
        mean.iter_mut().for_each(|m| *m /= features);
        for x in x.chunks_exact(columns) {
            for ((v, x), m) in factors.iter_mut().zip(&x[first..]).zip(&*mean) {
                *v = (x - m).mul_add(x - m, *v);
            }
        }
        factors.iter_mut().for_each(|v| *v = 1.0 / (*v / features + EPSILON).sqrt());
        kept.factors[first..][..count].copy_from_slice(factors);
        let rows = x.chunks_exact(columns).zip(kept.scaled.chunks_exact_mut(columns));
        let rows = rows.zip(y.chunks_exact_mut(columns));
        for (((x, scaled), y), (w, b)) in rows.zip(self.weight.iter().zip(&self.bias)) {
            let (x, scaled, y) =
                (&x[first..][..count], &mut scaled[first..][..count], &mut y[first..][..count]);
            for i in 0..count {
                let normal = (x[i] - mean[i]) * factors[i];
                scaled[i] = normal;
                y[i] = normal.mul_add(*w, *b);
            }
        }
    }

    /// Adds the derivatives by the input to `x_slopes`, and those by the parameters to `gradient`. Slopes beyond the last
    /// token are zero.
    pub fn pull(
        &self,
        kept: &Normed,
        y_slopes: &[f32],
        columns: usize,
        x_slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        Arch::new().dispatch(
            #[inline(always)]
            move || {
                let (x_slopes, gradient) = (x_slopes, gradient);
                for first in (0..columns).step_by(BLOCK) {
                    self.pull_block(kept, y_slopes, columns, first, x_slopes, gradient);
                }
            },
        );
    }

    #[expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
    #[inline(always)]
    fn pull_block(
        &self,
        kept: &Normed,
        y_slopes: &[f32],
        columns: usize,
        first: usize,
        x_slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        let count = BLOCK.min(columns - first);
        let features = self.weight.len() as f32;
        let (mut mean, mut along) = ([0.0_f32; BLOCK], [0.0_f32; BLOCK]);
        let (mean, along) = (&mut mean[..count], &mut along[..count]);
        let rows = || y_slopes.chunks_exact(columns).zip(kept.scaled.chunks_exact(columns));
        for (feature, ((slopes, scaled), w)) in rows().zip(&self.weight).enumerate() {
            let (slopes, scaled) = (&slopes[first..][..count], &scaled[first..][..count]);
            for i in 0..count {
                let slope = slopes[i] * w;
                mean[i] += slope;
                along[i] = slope.mul_add(scaled[i], along[i]);
            }
            let (mut by_weight, mut by_bias) = ([0.0_f32; LANES], [0.0_f32; LANES]);
            let lanes = slopes.as_chunks::<LANES>().0.iter().zip(scaled.as_chunks::<LANES>().0);
            for (slopes, scaled) in lanes {
                for lane in 0..LANES {
                    by_weight[lane] = slopes[lane].mul_add(scaled[lane], by_weight[lane]);
                    by_bias[lane] += slopes[lane];
                }
            }
            gradient[self.weight_place.start + feature] += fold(by_weight);
            gradient[self.bias_place.start + feature] += fold(by_bias);
        }
        mean.iter_mut().for_each(|m| *m /= features);
        along.iter_mut().for_each(|a| *a /= features);
        let factors = &kept.factors[first..][..count];
        let rows = rows().zip(x_slopes.chunks_exact_mut(columns));
        for (((slopes, scaled), x_slopes), w) in rows.zip(&self.weight) {
            let (slopes, scaled) = (&slopes[first..][..count], &scaled[first..][..count]);
            let x_slopes = &mut x_slopes[first..][..count];
            for i in 0..count {
                let rest = slopes[i].mul_add(*w, -mean[i]) - scaled[i] * along[i];
                x_slopes[i] = rest.mul_add(factors[i], x_slopes[i]);
            }
        }
    }
}

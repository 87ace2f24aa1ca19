//! Layer normalisation of every column: `y = x̂ w + b`, `x̂ = (x − mean)/√(variance + 1e-5)`, biased variance.
//!
//! Back, with `g = w ∂y`: `∂x = (g − mean(g) − x̂ mean(g x̂))/√(variance + 1e-5)`, `∂w += Σ ∂y x̂`, `∂b += Σ ∂y`.

use std::ops::Range;

use faer::traits::pulp::Arch;

use super::{LANES, sum};

/// PyTorch's default.
const EPSILON: f32 = 1e-5;

/// A layer normalisation with the parameters of one minibatch.
#[derive(Debug, Clone)]
pub struct LayerNorm {
    weight_place: Range<usize>,
    bias_place: Range<usize>,
    weight: Vec<f32>,
    bias: Vec<f32>,
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
                for first in (0..columns).step_by(LANES) {
                    self.apply_to_lanes(x, columns, first, kept, y);
                }
            },
        );
    }

    #[expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
    #[inline(always)]
    fn apply_to_lanes(
        &self,
        x: &[f32],
        columns: usize,
        first: usize,
        kept: &mut Normed,
        y: &mut [f32],
    ) {
        let features = self.weight.len() as f32;
        let mut mean = [0.0_f32; LANES];
        for x in lanes_of(x, columns, first) {
            mean.iter_mut().zip(x).for_each(|(m, x)| *m += x);
        }
        mean.iter_mut().for_each(|m| *m /= features);
        let mut variance = [0.0_f32; LANES];
        for x in lanes_of(x, columns, first) {
            for ((v, x), m) in variance.iter_mut().zip(x).zip(&mean) {
                *v = (x - m).mul_add(x - m, *v);
            }
        }
        let factors = variance.map(|v| 1.0 / (v / features + EPSILON).sqrt());
        kept.factors[first..first + LANES].copy_from_slice(&factors);
        let rows = lanes_of(x, columns, first)
            .zip(lanes_of_mut(&mut kept.scaled, columns, first))
            .zip(lanes_of_mut(y, columns, first));
        for (((x, scaled), y), (w, b)) in rows.zip(self.weight.iter().zip(&self.bias)) {
            for lane in 0..LANES {
                let normal = (x[lane] - mean[lane]) * factors[lane];
                scaled[lane] = normal;
                y[lane] = normal.mul_add(*w, *b);
            }
        }
    }

    /// Adds the derivatives by the input to `x_slopes`, and those by the parameters, for the first `count` columns, to
    /// `gradient`.
    pub fn pull(
        &self,
        kept: &Normed,
        y_slopes: &[f32],
        columns: usize,
        count: usize,
        x_slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        Arch::new().dispatch(
            #[inline(always)]
            move || {
                let (x_slopes, gradient) = (x_slopes, gradient);
                for first in (0..columns).step_by(LANES) {
                    self.pull_lanes(kept, y_slopes, columns, first, x_slopes);
                }
                let rows = y_slopes.chunks_exact(columns).zip(kept.scaled.chunks_exact(columns));
                for (feature, (slopes, scaled)) in rows.take(self.weight.len()).enumerate() {
                    let (mut by_weight, mut by_bias) = ([0.0_f32; LANES], [0.0_f32; LANES]);
                    // Slopes beyond the last token are zero.
                    let slopes = slopes[..count.next_multiple_of(LANES)].as_chunks::<LANES>().0;
                    for (slopes, scaled) in slopes.iter().zip(scaled.as_chunks::<LANES>().0) {
                        for lane in 0..LANES {
                            by_weight[lane] = slopes[lane].mul_add(scaled[lane], by_weight[lane]);
                            by_bias[lane] += slopes[lane];
                        }
                    }
                    gradient[self.weight_place.start + feature] += sum(&by_weight);
                    gradient[self.bias_place.start + feature] += sum(&by_bias);
                }
            },
        );
    }

    #[expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
    #[inline(always)]
    fn pull_lanes(
        &self,
        kept: &Normed,
        y_slopes: &[f32],
        columns: usize,
        first: usize,
        x_slopes: &mut [f32],
    ) {
        let features = self.weight.len() as f32;
        let (mut mean, mut along) = ([0.0_f32; LANES], [0.0_f32; LANES]);
        let rows = lanes_of(y_slopes, columns, first).zip(lanes_of(&kept.scaled, columns, first));
        for ((slopes, scaled), w) in rows.clone().zip(&self.weight) {
            for lane in 0..LANES {
                let slope = slopes[lane] * w;
                mean[lane] += slope;
                along[lane] = slope.mul_add(scaled[lane], along[lane]);
            }
        }
        mean.iter_mut().for_each(|m| *m /= features);
        along.iter_mut().for_each(|a| *a /= features);
        let factors = &kept.factors[first..first + LANES];
        let rows = rows.zip(lanes_of_mut(x_slopes, columns, first));
        for (((slopes, scaled), x_slopes), w) in rows.zip(&self.weight) {
            for lane in 0..LANES {
                let rest = slopes[lane].mul_add(*w, -mean[lane]) - scaled[lane] * along[lane];
                x_slopes[lane] = rest.mul_add(factors[lane], x_slopes[lane]);
            }
        }
    }
}

/// Sixteen columns of every row.
#[expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
#[inline(always)]
fn lanes_of(
    matrix: &[f32],
    columns: usize,
    first: usize,
) -> impl Iterator<Item = &[f32; LANES]> + Clone {
    matrix.chunks_exact(columns).filter_map(move |row| row[first..].first_chunk())
}

/// The same, to be changed.
#[expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
#[inline(always)]
fn lanes_of_mut(
    matrix: &mut [f32],
    columns: usize,
    first: usize,
) -> impl Iterator<Item = &mut [f32; LANES]> {
    matrix.chunks_exact_mut(columns).filter_map(move |row| row[first..].first_chunk_mut())
}

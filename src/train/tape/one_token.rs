//! A dense layer and a norm on one token alone: vectors instead of matrices, nothing is filled up.
//!
//! A layer is taken some of its outputs at a time, so that a part of it, say the values of one head, needs no copy. Every
//! row of the weight is read once and in order.

#![expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]

use std::ops::Range;

use pulp::Arch;

use super::layer_norm::{EPSILON, LayerNorm};
use super::linear::Linear;
use super::{LANES, add, fold};

impl Linear {
    /// `y = W x`, for the outputs numbered `rows`.
    pub fn multiply_one(&self, rows: Range<usize>, x: &[f32], y: &mut [f32]) {
        let weights = self.rows_of(&self.weight, rows);
        Arch::new().dispatch(
            #[inline(always)]
            move || {
                let y = y;
                for (y, weights) in y.iter_mut().zip(weights.chunks_exact(x.len())) {
                    *y = dot(weights, x);
                }
            },
        );
    }

    /// `y = W x + b`, rectified if asked, for the outputs numbered `rows`.
    pub fn apply_to_one(&self, rows: Range<usize>, x: &[f32], rectify: bool, y: &mut [f32]) {
        self.multiply_one(rows.clone(), x, y);
        add(&self.bias[rows], y);
        if rectify {
            y.iter_mut().for_each(|y| *y = if *y <= 0.0 { 0.0 } else { *y });
        }
    }

    /// `x = x + Wᵀ y`, for the outputs numbered `rows`: the derivatives by the input.
    pub fn pull_one_input(&self, rows: Range<usize>, y: &[f32], x: &mut [f32]) {
        let weights = self.rows_of(&self.weight, rows);
        Arch::new().dispatch(
            #[inline(always)]
            move || {
                let x = x;
                for (&y, weights) in y.iter().zip(weights.chunks_exact(x.len())) {
                    for (x, w) in x.iter_mut().zip(weights) {
                        *x = y.mul_add(*w, *x);
                    }
                }
            },
        );
    }

    /// Adds `y xᵀ` to the derivatives by the weight, for the outputs numbered `rows`: all of them where there are fewer than
    /// inputs, because then they are summed turned over.
    pub fn pull_one_weight(&self, rows: Range<usize>, x: &[f32], y: &[f32], gradient: &mut [f32]) {
        let gradient = &mut gradient[self.weight_place.clone()];
        let (many, few, sums) = if self.outputs >= self.inputs {
            (y, x, &mut gradient[rows.start * self.inputs..rows.end * self.inputs])
        } else {
            (x, y, gradient)
        };
        Arch::new().dispatch(
            #[inline(always)]
            move || {
                let sums = sums;
                for (&m, sums) in many.iter().zip(sums.chunks_exact_mut(few.len())) {
                    for (s, f) in sums.iter_mut().zip(few) {
                        *s = m.mul_add(*f, *s);
                    }
                }
            },
        );
    }

    /// Adds to the derivatives by the bias.
    pub fn pull_one_bias(&self, rows: Range<usize>, y_slopes: &[f32], gradient: &mut [f32]) {
        add(y_slopes, &mut gradient[self.bias_place.clone()][rows]);
    }

    /// All three ways back of `y = W x + b`. Derivatives by the input are added to `x_slopes`.
    pub fn pull_one(
        &self,
        rows: Range<usize>,
        x: &[f32],
        y_slopes: &[f32],
        x_slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        self.pull_one_bias(rows.clone(), y_slopes, gradient);
        self.pull_one_weight(rows.clone(), x, y_slopes, gradient);
        self.pull_one_input(rows, y_slopes, x_slopes);
    }

    fn rows_of<'a>(&self, weight: &'a [f32], rows: Range<usize>) -> &'a [f32] {
        &weight[rows.start * self.inputs..rows.end * self.inputs]
    }
}

/// What the way back of a normalised token needs: `x̂` and its factor.
#[derive(Debug, Clone)]
pub struct NormedOne {
    scaled: Vec<f32>,
    factor: f32,
}

impl NormedOne {
    #[must_use]
    pub fn new(features: usize) -> Self {
        Self { scaled: vec![0.0; features], factor: 0.0 }
    }
}

impl LayerNorm {
    /// Normalises one token.
    pub fn apply_to_one(&self, x: &[f32], kept: &mut NormedOne, y: &mut [f32]) {
        let features = x.len() as f32;
        let mean = super::sum(x) / features;
        kept.scaled.iter_mut().zip(x).for_each(|(s, x)| *s = x - mean);
        let square = kept.scaled.iter().map(|s| s * s).sum::<f32>();
        kept.factor = 1.0 / (square / features + EPSILON).sqrt();
        let parameters = self.weight.iter().zip(&self.bias);
        for ((s, y), (w, b)) in kept.scaled.iter_mut().zip(y).zip(parameters) {
            *s *= kept.factor;
            *y = *s * w + b;
        }
    }

    /// Adds the derivatives by the input to `x_slopes`, and those by the parameters to `gradient`.
    pub fn pull_one(
        &self,
        kept: &NormedOne,
        y_slopes: &[f32],
        x_slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        let features = y_slopes.len() as f32;
        let rows = || y_slopes.iter().zip(&kept.scaled);
        let mean = rows().zip(&self.weight).map(|((y, _), w)| y * w).sum::<f32>() / features;
        let along = rows().zip(&self.weight).map(|((y, s), w)| y * w * s).sum::<f32>() / features;
        for (((y, s), w), x) in rows().zip(&self.weight).zip(x_slopes) {
            *x += (y * w - mean - s * along) * kept.factor;
        }
        add(y_slopes, &mut gradient[self.bias_place.clone()]);
        let by_weight = &mut gradient[self.weight_place.clone()];
        by_weight.iter_mut().zip(rows()).for_each(|(g, (y, s))| *g += y * s);
    }
}

/// Scalar product, in sixteen parts that are folded at the end.
#[inline(always)]
fn dot(a: &[f32], b: &[f32]) -> f32 {
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut parts = [0.0_f32; LANES];
    for (a, b) in a.iter().zip(b) {
        for lane in 0..LANES {
            parts[lane] = a[lane].mul_add(b[lane], parts[lane]);
        }
    }
    for ((part, a), b) in parts.iter_mut().zip(a_rest).zip(b_rest) {
        *part = a.mul_add(*b, *part);
    }
    fold(parts)
}

//! Layer normalisation over the last axis: `y = (x − mean)/√(variance + 1e-5) · w + b`, with the biased variance.

use super::elementwise::{sum_of, vectorised};
use super::weights::Weights;
use crate::policy::PolicyError;

/// PyTorch's default; the checkpoints' `layer_norm_eps` has no other value in any published model.
const EPSILON: f32 = 1e-5;

/// One layer normalisation.
#[derive(Debug, Clone)]
pub(super) struct LayerNorm {
    weight: Vec<f32>,
    bias: Vec<f32>,
}

impl LayerNorm {
    /// Reads `<name>.weight` and `<name>.bias`.
    pub(super) fn read(weights: Weights, name: &str, width: usize) -> Result<Self, PolicyError> {
        let weight = weights.tensor(&format!("{name}.weight"), &[width])?.to_vec();
        let bias = weights.tensor(&format!("{name}.bias"), &[width])?.to_vec();
        Ok(Self { weight, bias })
    }

    /// Normalises every row of `x` into `y`.
    pub(super) fn apply(&self, x: &[f32], y: &mut [f32]) {
        let width = self.weight.len();
        vectorised(
            #[inline(always)]
            || {
                for (x, y) in x.chunks_exact(width).zip(y.chunks_exact_mut(width)) {
                    self.apply_to_row(x, y);
                }
            },
        );
    }

    #[expect(clippy::inline_always, reason = "`vectorised` compiles only what is inlined into it")]
    #[inline(always)]
    fn apply_to_row(&self, x: &[f32], y: &mut [f32]) {
        let width = x.len() as f32;
        let mean = sum_of(x, |x| x) / width;
        let variance = sum_of(x, |x| (x - mean) * (x - mean)) / width;
        let scale = 1.0 / (variance + EPSILON).sqrt();
        for (((y, &x), &w), &b) in y.iter_mut().zip(x).zip(&self.weight).zip(&self.bias) {
            *y = ((x - mean) * scale).mul_add(w, b);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_hand_computed_row() {
        // Mean 4, variance 4: (2 − 4)/2 = −1 and (6 − 4)/2 = 1, up to the epsilon of 1e-5 under the root.
        let norm = LayerNorm { weight: vec![1.0, 3.0], bias: vec![0.0, 0.5] };
        let mut y = [0.0; 4];
        norm.apply(&[2.0, 6.0, 5.0, 5.0], &mut y);
        assert!((y[0] + 1.0).abs() < 2e-6 && (y[1] - 3.5).abs() < 6e-6, "{y:?}");
        assert_eq!(y[2..], [0.0, 0.5], "a constant row keeps only the bias");
    }
}

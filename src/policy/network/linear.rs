//! Dense layers, `y = x Wᵀ + b`, on faer's single-precision matrix product.
//!
//! A checkpoint stores `W` as outputs × inputs; it is turned over once, so that the product walks through memory in
//! order. Rows of `x` and `y` are tokens. One product runs on one thread.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::elementwise::{add_to_rows, add_to_rows_and_rectify, dot};
use super::weights::Weights;
use crate::policy::PolicyError;

/// A dense layer.
#[derive(Debug, Clone)]
pub(in crate::policy) struct Linear {
    inputs: usize,
    outputs: usize,
    /// Inputs × outputs, row-major.
    transposed: Vec<f32>,
    bias: Vec<f32>,
}

impl Linear {
    /// Reads `<name>.weight` and `<name>.bias`.
    pub(in crate::policy) fn read(
        weights: Weights,
        name: &str,
        inputs: usize,
        outputs: usize,
    ) -> Result<Self, PolicyError> {
        let weight = weights.tensor(&format!("{name}.weight"), &[outputs, inputs])?;
        let bias = weights.tensor(&format!("{name}.bias"), &[outputs])?;
        Ok(Self::new(inputs, weight, bias))
    }

    /// From a weight (outputs × inputs) and one bias per output.
    pub(in crate::policy) fn new(inputs: usize, weight: &[f32], bias: &[f32]) -> Self {
        let outputs = bias.len();
        let mut transposed = vec![0.0; inputs * outputs];
        for (output, row) in weight.chunks_exact(inputs.max(1)).enumerate() {
            for (input, &w) in row.iter().enumerate() {
                transposed[input * outputs + output] = w;
            }
        }
        Self { inputs, outputs, transposed, bias: bias.to_vec() }
    }

    pub(in crate::policy) fn inputs(&self) -> usize {
        self.inputs
    }

    pub(in crate::policy) fn outputs(&self) -> usize {
        self.outputs
    }

    /// `y = x Wᵀ + b`.
    pub(in crate::policy) fn apply(&self, x: &[f32], y: &mut [f32]) {
        self.multiply(x, y, Accum::Replace);
        add_to_rows(y, &self.bias);
    }

    /// `y = max(x Wᵀ + b, 0)`.
    pub(super) fn apply_and_rectify(&self, x: &[f32], y: &mut [f32]) {
        self.multiply(x, y, Accum::Replace);
        add_to_rows_and_rectify(y, &self.bias);
    }

    /// `y = y + x Wᵀ + b`: a residual branch ends here.
    pub(super) fn accumulate(&self, x: &[f32], y: &mut [f32]) {
        add_to_rows(y, &self.bias);
        self.multiply(x, y, Accum::Add);
    }

    fn multiply(&self, x: &[f32], y: &mut [f32], accumulate: Accum) {
        let rows = y.len() / self.outputs;
        matmul(
            MatMut::from_row_major_slice_mut(y, rows, self.outputs),
            accumulate,
            MatRef::from_row_major_slice(x, rows, self.inputs),
            MatRef::from_row_major_slice(&self.transposed, self.inputs, self.outputs),
            1.0,
            Par::Seq,
        );
    }
}

/// A dense layer with one output.
#[derive(Debug, Clone)]
pub(super) struct Head {
    weight: Vec<f32>,
    bias: f32,
}

impl Head {
    /// Reads `<name>.weight` and `<name>.bias`.
    pub(super) fn read(weights: Weights, name: &str, inputs: usize) -> Result<Self, PolicyError> {
        let weight = weights.tensor(&format!("{name}.weight"), &[1, inputs])?.to_vec();
        let bias = weights.tensor(&format!("{name}.bias"), &[1])?[0];
        Ok(Self { weight, bias })
    }

    /// The output for one row.
    pub(super) fn apply(&self, row: &[f32]) -> f32 {
        dot(&self.weight, row) + self.bias
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "small whole numbers are exact")]
mod tests {
    use super::*;

    fn layer() -> Linear {
        Linear::new(2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &[10.0, -20.0, 30.0])
    }

    #[test]
    fn a_layer_multiplies_by_its_weight_and_adds_its_bias() {
        let mut y = [0.0; 6];
        layer().apply(&[1.0, 1.0, 2.0, -1.0], &mut y);
        assert_eq!(y, [13.0, -13.0, 41.0, 10.0, -18.0, 34.0]);
        layer().apply_and_rectify(&[1.0, 1.0, 2.0, -1.0], &mut y);
        assert_eq!(y, [13.0, 0.0, 41.0, 10.0, 0.0, 34.0]);
    }

    #[test]
    fn a_residual_branch_adds_to_what_is_there() {
        let mut y = [1.0, 2.0, 3.0];
        layer().accumulate(&[1.0, 1.0], &mut y);
        assert_eq!(y, [14.0, -11.0, 44.0]);
    }
}

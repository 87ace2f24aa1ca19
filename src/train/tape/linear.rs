//! A dense layer: `Y = W X + b`, hence `∂X = Wᵀ ∂Y`, `∂W += ∂Y Xᵀ`, `∂b += Σ ∂Y`.
//!
//! Wᵀ is made once per minibatch. For ∂W one of its two factors must be turned; that is the one with fewer features. A layer
//! with fewer outputs than inputs therefore sums the derivative turned over, and [`Linear::finish`] turns it back at
//! the end.

use std::ops::Range;

use super::product::{Product, Start};
use super::{lanes, sum, turn};

/// A dense layer with the parameters of one minibatch.
#[derive(Debug, Clone)]
pub struct Linear {
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    pub(super) weight_place: Range<usize>,
    pub(super) bias_place: Range<usize>,
    /// Outputs × inputs.
    pub(super) weight: Vec<f32>,
    /// Inputs × outputs.
    turned: Vec<f32>,
    pub(super) bias: Vec<f32>,
}

impl Linear {
    /// The layer whose weight (outputs × inputs) and bias lie at these places of all parameters.
    #[must_use]
    pub fn new(weight_place: Range<usize>, bias_place: Range<usize>) -> Self {
        let outputs = bias_place.len();
        let zeros = vec![0.0; weight_place.len()];
        Self {
            inputs: weight_place.len() / outputs.max(1),
            outputs,
            weight: zeros.clone(),
            turned: zeros,
            bias: vec![0.0; outputs],
            weight_place,
            bias_place,
        }
    }

    #[must_use]
    pub fn inputs(&self) -> usize {
        self.inputs
    }

    #[must_use]
    pub fn outputs(&self) -> usize {
        self.outputs
    }

    /// Takes the parameters of a new minibatch.
    pub fn load(&mut self, numbers: &[f32]) {
        self.weight.copy_from_slice(&numbers[self.weight_place.clone()]);
        self.bias.copy_from_slice(&numbers[self.bias_place.clone()]);
        turn(&self.weight, self.inputs, self.inputs, 1.0, &mut self.turned, self.outputs);
    }

    /// `Y = W X + b`, rectified if asked.
    pub fn apply(&self, x: &[f32], columns: usize, rectify: bool, y: &mut [f32]) {
        self.multiply(x, columns, Start::Bias(&self.bias), rectify, y);
    }

    /// `Y = Y + W X + b`: a residual branch ends here.
    pub fn accumulate(&self, x: &[f32], columns: usize, y: &mut [f32]) {
        self.multiply(x, columns, Start::KeepAndBias(&self.bias), false, y);
    }

    fn multiply(&self, x: &[f32], columns: usize, start: Start<'_>, rectify: bool, y: &mut [f32]) {
        Product {
            rows: self.outputs,
            depth: self.inputs,
            columns,
            a: &self.weight,
            a_stride: self.inputs,
            b: x,
            b_stride: columns,
            start,
            rectify,
            c: y,
            c_stride: columns,
        }
        .compute();
    }

    /// Writes the derivatives by the input, or adds to them.
    pub fn pull_input(&self, y_slopes: &[f32], columns: usize, add: bool, x_slopes: &mut [f32]) {
        Product {
            rows: self.inputs,
            depth: self.outputs,
            columns,
            a: &self.turned,
            a_stride: self.outputs,
            b: y_slopes,
            b_stride: columns,
            start: if add { Start::Keep } else { Start::Zero },
            rectify: false,
            c: x_slopes,
            c_stride: columns,
        }
        .compute();
    }

    /// Adds to the derivatives by weight and bias, for the first `count` of the columns. `scratch` holds
    /// [`Self::scratch_length`] numbers.
    pub fn pull_weight(
        &self,
        x: &[f32],
        y_slopes: &[f32],
        columns: usize,
        count: usize,
        scratch: &mut [f32],
        gradient: &mut [f32],
    ) {
        let bias = &mut gradient[self.bias_place.clone()];
        for (b, row) in bias.iter_mut().zip(y_slopes.chunks_exact(columns)) {
            *b += sum(&row[..count]);
        }
        let wide = self.outputs >= self.inputs;
        let (many, few) = if wide { (y_slopes, x) } else { (x, y_slopes) };
        let few_features = self.inputs.min(self.outputs);
        let stride = lanes(few_features);
        turn(&few[..few_features * columns], columns, count, 1.0, scratch, stride);
        Product {
            rows: self.inputs.max(self.outputs),
            depth: count,
            columns: few_features,
            a: many,
            a_stride: columns,
            b: scratch,
            b_stride: stride,
            start: Start::Keep,
            rectify: false,
            c: &mut gradient[self.weight_place.clone()],
            c_stride: few_features,
        }
        .compute();
    }

    /// Numbers of scratch memory that [`Self::pull_weight`] needs for so many tokens.
    #[must_use]
    pub fn scratch_length(&self, count: usize) -> usize {
        lanes(self.inputs.min(self.outputs)) * count
    }

    /// Brings the summed derivatives into the order of the parameters.
    pub fn finish(&self, gradient: &mut [f32]) {
        if self.outputs < self.inputs {
            let weight = &mut gradient[self.weight_place.clone()];
            let summed = weight.to_vec();
            turn(&summed, self.outputs, self.outputs, 1.0, weight, self.inputs);
        }
    }
}

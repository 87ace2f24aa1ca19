//! A dense layer and its derivatives, over the rows of a shard: `Y = X Wᵀ + b`, hence `∂X = ∂Y W`, `∂W += ∂Yᵀ X`,
//! `∂b += Σ ∂Y`. Matrices are row-major with one row per sample.

use std::ops::Range;

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use crate::train::{Parameters, TrainError};

/// Where a layer's numbers lie.
#[derive(Debug, Clone)]
pub(super) struct Dense {
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    pub(super) weight: Range<usize>,
    pub(super) bias: Range<usize>,
}

impl Dense {
    /// The layer of tensors `<name>.weight` (outputs × inputs) and `<name>.bias`.
    pub(super) fn find(parameters: &Parameters, name: &str) -> Result<Self, TrainError> {
        let weight = parameters.place(&format!("{name}.weight"))?;
        let bias = parameters.place(&format!("{name}.bias"))?.range.clone();
        let (outputs, inputs) = (bias.len(), weight.range.len() / bias.len().max(1));
        Ok(Self { inputs, outputs, weight: weight.range.clone(), bias })
    }

    fn weight<'a>(&self, numbers: &'a [f32]) -> MatRef<'a, f32> {
        MatRef::from_row_major_slice(&numbers[self.weight.clone()], self.outputs, self.inputs)
    }

    /// `y = x Wᵀ + b`.
    pub(super) fn forward(&self, numbers: &[f32], x: &[f32], y: &mut [f32]) {
        let rows = y.len() / self.outputs;
        for row in y.chunks_exact_mut(self.outputs) {
            row.copy_from_slice(&numbers[self.bias.clone()]);
        }
        matmul(
            MatMut::from_row_major_slice_mut(y, rows, self.outputs),
            Accum::Add,
            MatRef::from_row_major_slice(x, rows, self.inputs),
            self.weight(numbers).transpose(),
            1.0,
            Par::Seq,
        );
    }

    /// Adds to the derivatives by weight and bias in `gradient`.
    pub(super) fn pull_weight(&self, x: &[f32], y_slopes: &[f32], gradient: &mut [f32]) {
        let rows = y_slopes.len() / self.outputs;
        let y_slopes_matrix = MatRef::from_row_major_slice(y_slopes, rows, self.outputs);
        let weight = &mut gradient[self.weight.clone()];
        matmul(
            MatMut::from_row_major_slice_mut(weight, self.outputs, self.inputs),
            Accum::Add,
            y_slopes_matrix.transpose(),
            MatRef::from_row_major_slice(x, rows, self.inputs),
            1.0,
            Par::Seq,
        );
        for row in y_slopes.chunks_exact(self.outputs) {
            gradient[self.bias.clone()].iter_mut().zip(row).for_each(|(b, y)| *b += y);
        }
    }

    /// Writes the derivatives by some columns of `x`.
    pub(super) fn pull_columns(
        &self,
        numbers: &[f32],
        y_slopes: &[f32],
        columns: Range<usize>,
        x_slopes: &mut [f32],
    ) {
        let rows = y_slopes.len() / self.outputs;
        matmul(
            MatMut::from_row_major_slice_mut(x_slopes, rows, columns.len()),
            Accum::Replace,
            MatRef::from_row_major_slice(y_slopes, rows, self.outputs),
            self.weight(numbers).subcols(columns.start, columns.len()),
            1.0,
            Par::Seq,
        );
    }

    /// Writes the derivatives by `x`.
    pub(super) fn pull_input(&self, numbers: &[f32], y_slopes: &[f32], x_slopes: &mut [f32]) {
        let rows = y_slopes.len() / self.outputs;
        matmul(
            MatMut::from_row_major_slice_mut(x_slopes, rows, self.inputs),
            Accum::Replace,
            MatRef::from_row_major_slice(y_slopes, rows, self.outputs),
            self.weight(numbers),
            1.0,
            Par::Seq,
        );
    }
}

/// Dense layers with an activation after each.
#[derive(Debug, Clone)]
pub(super) struct Stack {
    pub(super) layers: Vec<Dense>,
    pub(super) function: fn(f32) -> f32,
    pub(super) slope: fn(f32) -> f32,
}

/// What a stack keeps between forward and backward.
#[derive(Debug, Clone)]
pub(super) struct StackMemory {
    /// Per layer: before and after the activation, rows × outputs.
    kept: Vec<[Vec<f32>; 2]>,
    /// Two slopes, each wide enough for every layer.
    slopes: [Vec<f32>; 2],
}

impl Stack {
    pub(super) fn memory(&self, rows: usize) -> StackMemory {
        let kept = self.layers.iter().map(|layer| {
            let zeros = vec![0.0; rows * layer.outputs];
            [zeros.clone(), zeros]
        });
        let widest = self.layers.iter().map(|layer| layer.outputs).max().unwrap_or(0);
        let slopes = vec![0.0; rows * widest];
        StackMemory { kept: kept.collect(), slopes: [slopes.clone(), slopes] }
    }

    /// Width of what comes out for `inputs` numbers.
    pub(super) fn outputs(&self, inputs: usize) -> usize {
        self.layers.last().map_or(inputs, |layer| layer.outputs)
    }

    /// Sends `rows` rows through all layers.
    pub(super) fn forward<'a>(
        &self,
        numbers: &[f32],
        x: &'a [f32],
        rows: usize,
        memory: &'a mut StackMemory,
    ) -> &'a [f32] {
        for (k, layer) in self.layers.iter().enumerate() {
            let (before, here) = memory.kept.split_at_mut(k);
            let input = match before.last() {
                Some([_, previous]) => &previous[..rows * layer.inputs],
                None => x,
            };
            let [sums, outputs] = &mut here[0];
            let sums = &mut sums[..rows * layer.outputs];
            layer.forward(numbers, input, sums);
            for (y, &z) in outputs.iter_mut().zip(&*sums) {
                *y = (self.function)(z);
            }
        }
        memory.latent(x, rows, self)
    }

    /// Adds to the derivatives by all weights, given those by the output, for the rows sent forward last.
    pub(super) fn backward(
        &self,
        numbers: &[f32],
        x: &[f32],
        rows: usize,
        output_slopes: &[f32],
        memory: &mut StackMemory,
        gradient: &mut [f32],
    ) {
        self.descend(numbers, rows, output_slopes, memory, |layer, before, slopes| {
            let input = match before.last() {
                Some([_, previous]) => &previous[..rows * layer.inputs],
                None => x,
            };
            layer.pull_weight(input, slopes, gradient);
        });
    }

    /// The derivatives by the sums of the first layer, before their activation, given those by the output.
    pub(super) fn first_slopes<'a>(
        &self,
        numbers: &[f32],
        rows: usize,
        output_slopes: &[f32],
        memory: &'a mut StackMemory,
    ) -> &'a [f32] {
        self.descend(numbers, rows, output_slopes, memory, |_, _, _| ())
    }

    /// Goes back from the output to the first layer. `visit` is given every layer, what is kept of those before it, and the
    /// derivatives by its sums; those of the first layer are returned.
    fn descend<'a>(
        &self,
        numbers: &[f32],
        rows: usize,
        output_slopes: &[f32],
        memory: &'a mut StackMemory,
        mut visit: impl FnMut(&Dense, &[[Vec<f32>; 2]], &[f32]),
    ) -> &'a [f32] {
        let StackMemory { kept, slopes: [current, next] } = memory;
        let (mut current, mut next) = (current, next);
        current[..output_slopes.len()].copy_from_slice(output_slopes);
        let mut length = output_slopes.len();
        for (k, layer) in self.layers.iter().enumerate().rev() {
            let (before, here) = kept.split_at(k);
            length = rows * layer.outputs;
            let slopes = &mut current[..length];
            for (slope, &z) in slopes.iter_mut().zip(&here[0][0]) {
                *slope *= (self.slope)(z);
            }
            visit(layer, before, slopes);
            if k > 0 {
                layer.pull_input(numbers, slopes, &mut next[..rows * layer.inputs]);
                std::mem::swap(&mut current, &mut next);
            }
        }
        &current[..length]
    }
}

impl StackMemory {
    /// What came out last; the input itself if there are no layers.
    pub(super) fn latent<'a>(&'a self, x: &'a [f32], rows: usize, stack: &Stack) -> &'a [f32] {
        match (self.kept.last(), stack.layers.last()) {
            (Some([_, outputs]), Some(last)) => &outputs[..rows * last.outputs],
            _ => x,
        }
    }
}

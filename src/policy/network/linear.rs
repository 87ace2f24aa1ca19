//! Dense layers, `y = x Wᵀ + b`.
//!
//! A checkpoint stores `W` as outputs × inputs. It is packed once for [`Product`]: whole panels of outputs are products,
//! the few outputs that fill no panel are scalar products. Rows of `x` and `y` are tokens.

use super::elementwise::dot;
use super::product::{Finish, PANEL, Product, Rows, pack_columns};
use super::weights::Weights;
use crate::policy::PolicyError;

/// A dense layer.
#[derive(Debug, Clone)]
pub(in crate::policy) struct Linear {
    inputs: usize,
    /// The outputs that fill whole panels.
    panels: Vec<f32>,
    /// Rows of `W` of the other outputs.
    rest: Vec<f32>,
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
        let whole = bias.len() / PANEL * PANEL;
        let (weight, rest) = weight.split_at(whole * inputs);
        let mut panels = vec![0.0; weight.len()];
        pack_columns(Rows::new(weight, inputs), inputs, &mut panels);
        Self { inputs, panels, rest: rest.to_vec(), bias: bias.to_vec() }
    }

    pub(in crate::policy) fn inputs(&self) -> usize {
        self.inputs
    }

    pub(in crate::policy) fn outputs(&self) -> usize {
        self.bias.len()
    }

    /// `y = x Wᵀ + b`.
    pub(in crate::policy) fn apply(&self, x: &[f32], y: &mut [f32]) {
        self.multiply(x, Finish::AddBias(&self.bias), y);
    }

    /// `y = max(x Wᵀ + b, 0)`.
    pub(super) fn apply_and_rectify(&self, x: &[f32], y: &mut [f32]) {
        self.multiply(x, Finish::Rectify(&self.bias), y);
    }

    /// `y = y + x Wᵀ + b`: a residual branch ends here.
    pub(super) fn accumulate(&self, x: &[f32], y: &mut [f32]) {
        self.multiply(x, Finish::Accumulate(&self.bias), y);
    }

    fn multiply(&self, x: &[f32], finish: Finish<'_>, y: &mut [f32]) {
        let (inputs, outputs) = (self.inputs, self.outputs());
        let x = Rows::new(&x[..y.len() / outputs * inputs], inputs);
        Product { x, depth: inputs, panels: &self.panels, finish, y, y_stride: outputs }.compute();
        let whole = outputs / PANEL * PANEL;
        if whole == outputs {
            return;
        }
        for (row, y) in y.chunks_exact_mut(outputs).enumerate() {
            let x = x.row(row, inputs);
            for (output, y) in y.iter_mut().enumerate().skip(whole) {
                let sum = dot(&self.rest[(output - whole) * inputs..][..inputs], x);
                *y = finish.of(sum, output, *y);
            }
        }
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
    fn whole_panels_and_the_outputs_left_over_are_one_layer() {
        let (inputs, outputs, rows) = (5, 2 * PANEL + 3, 13);
        let numbers = |count: usize, modulus: usize| -> Vec<f32> {
            (0..count).map(|i| ((i * 7) % modulus) as f32 - 4.0).collect()
        };
        let (weight, bias) = (numbers(outputs * inputs, 11), numbers(outputs, 9));
        let layer = Linear::new(inputs, &weight, &bias);
        let (x, start) = (numbers(rows * inputs, 13), numbers(rows * outputs, 17));
        let [mut plain, mut rectified, mut added] = [start.clone(), start.clone(), start.clone()];
        layer.apply(&x, &mut plain);
        layer.apply_and_rectify(&x, &mut rectified);
        layer.accumulate(&x, &mut added);
        for (i, start) in start.into_iter().enumerate() {
            let (row, output) = (i / outputs, i % outputs);
            let products = (0..inputs).map(|k| x[row * inputs + k] * weight[output * inputs + k]);
            let want = products.sum::<f32>() + bias[output];
            assert_eq!(
                [plain[i], rectified[i], added[i]],
                [want, want.max(0.0), start + want],
                "row {row}, output {output}"
            );
        }
    }

    #[test]
    fn a_nan_survives_the_rectifier() {
        for outputs in [1, PANEL] {
            let layer = Linear::new(1, &vec![1.0; outputs], &vec![0.0; outputs]);
            let mut y = vec![0.0; 2 * outputs];
            layer.apply_and_rectify(&[f32::NAN, -1.0], &mut y);
            assert!(y[..outputs].iter().all(|y| y.is_nan()), "{y:?}");
            assert!(y[outputs..].iter().all(|&y| y == 0.0), "{y:?}");
        }
    }

    #[test]
    fn a_residual_branch_adds_to_what_is_there() {
        let mut y = [1.0, 2.0, 3.0];
        layer().accumulate(&[1.0, 1.0], &mut y);
        assert_eq!(y, [14.0, -11.0, 44.0]);
    }
}

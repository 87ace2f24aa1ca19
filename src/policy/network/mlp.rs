//! A plain multilayer perceptron: dense layers with one activation between them.

use super::linear::Linear;
use super::weights::Weights;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::Activation;

/// Dense layers in a row.
#[derive(Debug, Clone)]
pub(in crate::policy) struct Mlp {
    layers: Vec<Linear>,
    activation: fn(f32) -> f32,
    /// Whether the activation also follows the last layer.
    activates_last: bool,
}

/// Two rows wide enough for every layer's output, written in turn.
#[derive(Debug, Clone)]
pub(in crate::policy) struct MlpScratch([Vec<f32>; 2]);

impl Mlp {
    /// Reads the layers called `names`, each `<name>.weight` and `<name>.bias`; the first takes `inputs` numbers.
    pub(in crate::policy) fn read(
        weights: Weights,
        names: &[String],
        inputs: usize,
        activation: Activation,
        activates_last: bool,
    ) -> Result<Self, PolicyError> {
        let mut layers = Vec::with_capacity(names.len());
        let mut width = inputs;
        for name in names {
            let [outputs, _] = weights.matrix_size(&format!("{name}.weight"))?;
            layers.push(Linear::read(weights, name, width, outputs)?);
            width = outputs;
        }
        Ok(Self { layers, activation: activation.function(), activates_last })
    }

    /// Length of the output for an input of length `inputs`.
    pub(in crate::policy) fn outputs(&self, inputs: usize) -> usize {
        self.layers.last().map_or(inputs, Linear::outputs)
    }

    pub(in crate::policy) fn scratch(&self) -> MlpScratch {
        let widest = self.layers.iter().map(Linear::outputs).max().unwrap_or(0);
        MlpScratch([vec![0.0; widest], vec![0.0; widest]])
    }

    /// The output for one row; the row itself if there are no layers.
    pub(in crate::policy) fn apply<'a>(
        &self,
        row: &'a [f32],
        scratch: &'a mut MlpScratch,
    ) -> &'a [f32] {
        let [current, next] = &mut scratch.0;
        let (mut current, mut next) = (current, next);
        for (k, layer) in self.layers.iter().enumerate() {
            let input = if k == 0 { row } else { &current[..layer.inputs()] };
            let output = &mut next[..layer.outputs()];
            layer.apply(input, output);
            if self.activates_last || k + 1 < self.layers.len() {
                for x in output {
                    *x = (self.activation)(*x);
                }
            }
            std::mem::swap(&mut current, &mut next);
        }
        match self.layers.last() {
            Some(last) => &current[..last.outputs()],
            None => row,
        }
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::policy::checkpoint::contents::Tensor;

    #[test]
    fn the_last_layer_stays_linear_unless_asked() {
        let tensor =
            |shape: &[usize], data: &[f32]| Tensor { shape: shape.to_vec(), data: data.to_vec() };
        let tensors = BTreeMap::from([
            ("0.weight".to_owned(), tensor(&[2, 1], &[1.0, -1.0])),
            ("0.bias".to_owned(), tensor(&[2], &[0.0, 0.0])),
            ("1.weight".to_owned(), tensor(&[1, 2], &[-3.0, 1.0])),
            ("1.bias".to_owned(), tensor(&[1], &[1.0])),
        ]);
        let names = ["0".to_owned(), "1".to_owned()];
        for (activates_last, want) in [(false, -5.0), (true, 0.0)] {
            let weights = Weights(&tensors);
            let mlp = Mlp::read(weights, &names, 1, Activation::Relu, activates_last).unwrap();
            assert_eq!(mlp.apply(&[2.0], &mut mlp.scratch()), [want]);
        }
    }
}

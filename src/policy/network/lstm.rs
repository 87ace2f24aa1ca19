//! Long short-term memory cell as PyTorch orders it (`spec/policy.md` §4.2).
//!
//! `i, f, g, o` are the four blocks of `W_ih x + b_ih + W_hh h + b_hh`; `c' = σ(f)⊙c + σ(i)⊙tanh(g)`;
//! `h' = σ(o)⊙tanh(c')`.

use super::linear::Linear;
use super::weights::Weights;
use crate::policy::PolicyError;

/// One recurrent layer.
#[derive(Debug, Clone)]
pub(in crate::policy) struct LstmCell {
    from_input: Linear,
    from_hidden: Linear,
}

/// Hidden and cell state of every layer of one body.
#[derive(Debug, Clone, PartialEq)]
pub(in crate::policy) struct LstmState {
    pub(in crate::policy) hidden: Vec<f32>,
    pub(in crate::policy) cell: Vec<f32>,
}

/// A stack of recurrent layers.
#[derive(Debug, Clone)]
pub(in crate::policy) struct Lstm {
    cells: Vec<LstmCell>,
    width: usize,
}

impl Lstm {
    /// Reads `<name>.weight_ih_l0` and its companions, layer by layer.
    pub(in crate::policy) fn read(weights: Weights, name: &str) -> Result<Self, PolicyError> {
        let [_, width] = weights.matrix_size(&format!("{name}.weight_hh_l0"))?;
        let gates = width.saturating_mul(4);
        let mut cells = Vec::new();
        while cells.is_empty() || weights.has(&format!("{name}.weight_ih_l{}", cells.len())) {
            let layer = cells.len();
            let [_, first_inputs] = weights.matrix_size(&format!("{name}.weight_ih_l{layer}"))?;
            let inputs = if layer == 0 { first_inputs } else { width };
            let read = |part: &str, inputs: usize| {
                let weight = format!("{name}.weight_{part}_l{layer}");
                let bias = format!("{name}.bias_{part}_l{layer}");
                let weight = weights.tensor(&weight, &[gates, inputs])?;
                Ok::<_, PolicyError>(Linear::new(inputs, weight, weights.tensor(&bias, &[gates])?))
            };
            cells.push(LstmCell {
                from_input: read("ih", inputs)?,
                from_hidden: read("hh", width)?,
            });
        }
        Ok(Self { cells, width })
    }

    pub(in crate::policy) fn inputs(&self) -> usize {
        self.cells[0].from_input.inputs()
    }

    pub(in crate::policy) fn width(&self) -> usize {
        self.width
    }

    /// The state at the start of an episode.
    pub(in crate::policy) fn initial_state(&self) -> LstmState {
        let zeros = vec![0.0; self.cells.len() * self.width];
        LstmState { hidden: zeros.clone(), cell: zeros }
    }

    /// Advances `state` by one observation; `gates` is scratch of four times the width. The output is the last
    /// layer's hidden state, [`LstmState::output`].
    pub(in crate::policy) fn step(&self, x: &[f32], state: &mut LstmState, gates: &mut [f32]) {
        let width = self.width;
        let cells = self.cells.iter().zip(state.cell.chunks_exact_mut(width));
        for (layer, (weights, cell)) in cells.enumerate() {
            let (below, from_here) = state.hidden.split_at_mut(layer * width);
            let hidden = &mut from_here[..width];
            let input = if layer == 0 { x } else { &below[below.len() - width..] };
            weights.from_input.apply(input, gates);
            weights.from_hidden.accumulate(hidden, gates);
            let (input_gate, rest) = gates.split_at(width);
            let (forget_gate, rest) = rest.split_at(width);
            let (candidate, output_gate) = rest.split_at(width);
            for k in 0..width {
                cell[k] = sigmoid(forget_gate[k]) * cell[k]
                    + sigmoid(input_gate[k]) * candidate[k].tanh();
                hidden[k] = sigmoid(output_gate[k]) * cell[k].tanh();
            }
        }
    }
}

impl LstmState {
    /// The last layer's hidden state.
    pub(in crate::policy) fn output(&self, width: usize) -> &[f32] {
        &self.hidden[self.hidden.len() - width..]
    }
}

fn sigmoid(x: f32) -> f32 {
    1.0 / (1.0 + (-x).exp())
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use super::*;
    use crate::policy::checkpoint::contents::Tensor;

    #[test]
    fn a_hand_computed_step() {
        let tensor =
            |shape: &[usize], data: &[f32]| Tensor { shape: shape.to_vec(), data: data.to_vec() };
        let ln3 = 3.0_f32.ln();
        // Gates before the squashing: i = ln 3 → 3/4; f = −ln 3 → 1/4; g = atanh(1/2) → 1/2; o = 0 → 1/2.
        let g = 0.5 * ln3;
        let tensors = BTreeMap::from([
            ("l.weight_ih_l0".to_owned(), tensor(&[4, 1], &[ln3, -ln3, 0.0, 0.0])),
            ("l.bias_ih_l0".to_owned(), tensor(&[4], &[0.0, 0.0, g, 0.0])),
            ("l.weight_hh_l0".to_owned(), tensor(&[4, 1], &[0.0, 0.0, 1.0, 0.0])),
            ("l.bias_hh_l0".to_owned(), tensor(&[4], &[0.0, 0.0, -g, 0.0])),
        ]);
        let lstm = Lstm::read(Weights(&tensors), "l").unwrap();
        let mut state = LstmState { hidden: vec![g], cell: vec![8.0] };
        lstm.step(&[1.0], &mut state, &mut [0.0; 4]);
        let cell = 0.25 * 8.0 + 0.75 * 0.5;
        assert!((state.cell[0] - cell).abs() < 1e-6, "{state:?}");
        assert!((state.hidden[0] - 0.5 * cell.tanh()).abs() < 1e-6, "{state:?}");
    }
}

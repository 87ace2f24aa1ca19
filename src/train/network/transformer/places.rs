//! Layers found among the parameters by the names that a checkpoint gives them.

use crate::train::tape::layer_norm::LayerNorm;
use crate::train::tape::linear::Linear;
use crate::train::{Parameters, TrainError};

/// The parameters as a directory of layers.
#[derive(Clone, Copy)]
pub(super) struct Places<'a>(pub(super) &'a Parameters);

impl Places<'_> {
    pub(super) fn range(self, name: &str) -> Result<std::ops::Range<usize>, TrainError> {
        Ok(self.0.place(name)?.range.clone())
    }

    pub(super) fn linear(self, name: &str) -> Result<Linear, TrainError> {
        let weight = self.range(&format!("{name}.weight"))?;
        Ok(Linear::new(weight, self.range(&format!("{name}.bias"))?))
    }

    pub(super) fn norm(self, name: &str) -> Result<LayerNorm, TrainError> {
        let weight = self.range(&format!("{name}.weight"))?;
        Ok(LayerNorm::new(weight, self.range(&format!("{name}.bias"))?))
    }

    /// Queries, keys and values of an attention in one layer.
    pub(super) fn in_projection(self, name: &str) -> Result<Linear, TrainError> {
        let weight = self.range(&format!("{name}.in_proj_weight"))?;
        Ok(Linear::new(weight, self.range(&format!("{name}.in_proj_bias"))?))
    }

    /// Queries, the first third, and keys and values apart.
    pub(super) fn split_in_projection(self, name: &str) -> Result<[Linear; 2], TrainError> {
        let weight = self.range(&format!("{name}.in_proj_weight"))?;
        let bias = self.range(&format!("{name}.in_proj_bias"))?;
        let (rows, numbers) = (bias.start + bias.len() / 3, weight.start + weight.len() / 3);
        Ok([
            Linear::new(weight.start..numbers, bias.start..rows),
            Linear::new(numbers..weight.end, rows..bias.end),
        ])
    }
}

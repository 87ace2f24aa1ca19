//! The mean of several checkpoints of one network, weight by weight.

use std::collections::BTreeMap;

use super::checkpoint::contents::{Checkpoint, Format, Tensor};

/// Sums of the weights of checkpoints, in double precision.
pub(super) struct Mean {
    format: Format,
    sums: BTreeMap<String, Sum>,
    count: f64,
}

struct Sum {
    shape: Vec<usize>,
    numbers: Vec<f64>,
}

impl Mean {
    pub(super) fn new(first: &Checkpoint) -> Self {
        let sum = |tensor: &Tensor| Sum {
            shape: tensor.shape.clone(),
            numbers: tensor.data.iter().copied().map(f64::from).collect(),
        };
        let sums = first.tensors.iter().map(|(name, tensor)| (name.clone(), sum(tensor))).collect();
        Self { format: first.format, sums, count: 1.0 }
    }

    /// Adds another checkpoint, or says what it has that the first has not.
    pub(super) fn add(&mut self, other: &Checkpoint) -> Result<(), String> {
        if self.format != other.format {
            return Err(format!("weights of another kind: {}", other.format.word()));
        }
        if let Some(name) = self.sums.keys().find(|name| !other.tensors.contains_key(*name)) {
            return Err(format!("no tensor `{name}`"));
        }
        for (name, Tensor { shape, data }) in &other.tensors {
            let sum = self.sums.get_mut(name).filter(|sum| sum.shape == *shape);
            let Some(sum) = sum else { return Err(format!("tensor `{name}` of shape {shape:?}")) };
            for (sum, &x) in sum.numbers.iter_mut().zip(data) {
                *sum += f64::from(x);
            }
        }
        self.count += 1.0;
        Ok(())
    }

    /// Puts the means in place of the weights of `checkpoint`, one of those that were added.
    pub(super) fn write(&self, checkpoint: &mut Checkpoint) {
        for (tensor, sum) in checkpoint.tensors.values_mut().zip(self.sums.values()) {
            for (x, sum) in tensor.data.iter_mut().zip(&sum.numbers) {
                *x = (sum / self.count) as f32;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::checkpoint::contents::Scalars;
    use super::*;

    fn checkpoint(name: &str, data: &[f32]) -> Checkpoint {
        let tensor = Tensor { shape: vec![data.len()], data: data.to_vec() };
        Checkpoint {
            format: Format::PpoMlp,
            tensors: [(name.to_owned(), tensor)].into(),
            aliases: BTreeMap::new(),
            scalars: Scalars::default(),
            globals: Vec::new(),
        }
    }

    #[test]
    fn weights_become_their_means() {
        let mut last = checkpoint("weight", &[1.0, -4.0]);
        let mut mean = Mean::new(&last);
        mean.add(&checkpoint("weight", &[2.0, 0.5])).unwrap();
        mean.add(&checkpoint("weight", &[6.0, 0.5])).unwrap();
        mean.write(&mut last);
        assert_eq!(last.tensors["weight"].data, [3.0, -1.0]);
    }

    #[test]
    fn what_differs_is_named() {
        let refused =
            |other: &Checkpoint| Mean::new(&checkpoint("weight", &[1.0])).add(other).unwrap_err();
        assert_eq!(refused(&checkpoint("bias", &[1.0])), "no tensor `weight`");
        assert_eq!(refused(&checkpoint("weight", &[1.0; 2])), "tensor `weight` of shape [2]");
        let other = Checkpoint { format: Format::NpgMlp, ..checkpoint("weight", &[1.0]) };
        assert!(refused(&other).contains("another kind"));
    }
}

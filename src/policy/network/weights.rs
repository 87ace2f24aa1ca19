//! Named tensors of a checkpoint, handed out only if they are there, have the shape the network needs, and are finite.

use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::{Tensor, TensorMap};

/// A checkpoint's tensors under the checks above.
#[derive(Debug, Clone, Copy)]
pub(in crate::policy) struct Weights<'a>(pub(in crate::policy) &'a TensorMap);

impl<'a> Weights<'a> {
    /// Whether there is a tensor called `name`.
    pub(in crate::policy) fn has(self, name: &str) -> bool {
        self.0.contains_key(name)
    }

    /// The names `name(0)`, `name(1)`, … as far as each has a tensor `<name>.weight`.
    pub(in crate::policy) fn numbered(self, name: impl Fn(usize) -> String) -> Vec<String> {
        let names = (0..self.0.len()).map(name);
        names.take_while(|name| self.has(&format!("{name}.weight"))).collect()
    }

    /// What stands between `start` and `end` in the names that have both, sorted.
    pub(in crate::policy) fn names_between(self, start: &str, end: &str) -> Vec<String> {
        let middle = |name: &String| name.strip_prefix(start)?.strip_suffix(end).map(str::to_owned);
        self.0.keys().filter_map(middle).collect()
    }

    /// The names of an actor-critic's dense layers: those that actor and critic share, which only old files have, then
    /// those of `branch`, `policy_net` or `value_net`.
    pub(in crate::policy) fn hidden_layers(self, branch: &str) -> Vec<String> {
        let mut names = self.numbered(|k| format!("mlp_extractor.shared_net.{}", 2 * k));
        names.extend(self.numbered(|k| format!("mlp_extractor.{branch}.{}", 2 * k)));
        names
    }

    /// The shape of tensor `name`.
    pub(in crate::policy) fn shape(self, name: &str) -> Result<&'a [usize], PolicyError> {
        Ok(&self.find(name)?.shape)
    }

    /// The elements of tensor `name`, which must have exactly `shape`.
    pub(in crate::policy) fn tensor(
        self,
        name: &str,
        shape: &[usize],
    ) -> Result<&'a [f32], PolicyError> {
        let tensor = self.find(name)?;
        if tensor.shape != shape {
            return Err(PolicyError::TensorShape {
                name: name.to_owned(),
                expected: format!("{shape:?}"),
                found: tensor.shape.clone(),
            });
        }
        Self::checked(name, tensor)
    }

    /// Rows and columns of matrix `name`, neither of them zero.
    pub(in crate::policy) fn matrix_size(self, name: &str) -> Result<[usize; 2], PolicyError> {
        let tensor = self.find(name)?;
        match tensor.shape[..] {
            [rows, columns] if rows > 0 && columns > 0 => Ok([rows, columns]),
            _ => Err(PolicyError::TensorShape {
                name: name.to_owned(),
                expected: "a matrix with rows and columns".to_owned(),
                found: tensor.shape.clone(),
            }),
        }
    }

    fn find(self, name: &str) -> Result<&'a Tensor, PolicyError> {
        self.0.get(name).ok_or_else(|| PolicyError::MissingTensor { name: name.to_owned() })
    }

    fn checked(name: &str, tensor: &'a Tensor) -> Result<&'a [f32], PolicyError> {
        let count = tensor.shape.iter().try_fold(1_usize, |product, &n| product.checked_mul(n));
        if count != Some(tensor.data.len()) {
            return Err(PolicyError::TensorShape {
                name: name.to_owned(),
                expected: format!("a shape of {} elements", tensor.data.len()),
                found: tensor.shape.clone(),
            });
        }
        if tensor.data.iter().any(|x| !x.is_finite()) {
            return Err(PolicyError::NotFinite { name: name.to_owned() });
        }
        Ok(&tensor.data)
    }
}

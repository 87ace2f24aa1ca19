//! All numbers of a network in one row, under the names that a checkpoint gives its tensors.
//!
//! One row makes the optimiser a loop and a gradient another row of the same length. Tensors stand in the order in which
//! the published optimiser holds them. Names that a checkpoint has for the same numbers are kept beside
//! (`spec/policy.md` §1.11): a parameter is trained once, however often it is listed.

use std::collections::BTreeMap;
use std::ops::Range;

use super::TrainError;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::{Tensor, TensorMap};

/// The parameters of one network.
#[derive(Debug, Clone, PartialEq)]
pub struct Parameters {
    tensors: Vec<Place>,
    /// Further names, each with the name it stands for.
    aliases: BTreeMap<String, String>,
    numbers: Vec<f32>,
}

/// Where a tensor lies in the row.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Place {
    pub name: String,
    pub shape: Vec<usize>,
    pub range: Range<usize>,
    /// Whether the optimiser may change it.
    pub trainable: bool,
}

impl Parameters {
    /// Zeros for tensors of these names and shapes.
    #[must_use]
    pub fn zeros(shapes: impl IntoIterator<Item = (String, Vec<usize>)>) -> Self {
        let mut end = 0;
        let tensors = shapes.into_iter().map(|(name, shape)| {
            let start = end;
            end += shape.iter().product::<usize>();
            Place { name, shape, range: start..end, trainable: true }
        });
        let tensors: Vec<Place> = tensors.collect();
        Self { tensors, aliases: BTreeMap::new(), numbers: vec![0.0; end] }
    }

    /// Lists the numbers of tensor `name` under the name `alias`, too.
    pub fn add_alias(&mut self, alias: String, name: &str) {
        self.aliases.insert(alias, name.to_owned());
    }

    /// Keeps the optimiser from the tensors for which `is_frozen` holds as well.
    pub fn freeze(&mut self, is_frozen: impl Fn(&str) -> bool) {
        for place in &mut self.tensors {
            place.trainable &= !is_frozen(&place.name);
        }
    }

    /// The tensors in their order.
    #[must_use]
    pub fn places(&self) -> &[Place] {
        &self.tensors
    }

    /// The tensor called `name`, which must be there.
    pub fn place(&self, name: &str) -> Result<&Place, TrainError> {
        let found = self.tensors.iter().find(|place| place.name == name);
        Ok(found.ok_or_else(|| PolicyError::MissingTensor { name: name.to_owned() })?)
    }

    /// Every number, in the order of [`Self::places`].
    #[must_use]
    pub fn numbers(&self) -> &[f32] {
        &self.numbers
    }

    pub fn numbers_mut(&mut self) -> &mut [f32] {
        &mut self.numbers
    }

    /// Sets every number of tensor `name`, e.g. `log_std` before fine-tuning.
    pub fn fill(&mut self, name: &str, number: f32) -> Result<(), TrainError> {
        let range = self.place(name)?.range.clone();
        self.numbers[range].fill(number);
        Ok(())
    }

    /// Names and the names they stand for.
    #[must_use]
    pub fn aliases(&self) -> &BTreeMap<String, String> {
        &self.aliases
    }

    /// The tensors as a checkpoint holds them, aliases included.
    #[must_use]
    pub fn tensors(&self) -> TensorMap {
        let mut tensors = self.tensors_of(&self.numbers, "");
        for (alias, name) in &self.aliases {
            if let Some(tensor) = tensors.get(name).cloned() {
                tensors.insert(alias.clone(), tensor);
            }
        }
        tensors
    }

    /// A row of as many numbers as these parameters, as tensors of the same shapes whose names start with `prefix`.
    #[must_use]
    pub fn tensors_of(&self, row: &[f32], prefix: &str) -> TensorMap {
        let tensor = |place: &Place| {
            let data = row[place.range.clone()].to_vec();
            (format!("{prefix}{}", place.name), Tensor { shape: place.shape.clone(), data })
        };
        self.tensors.iter().map(tensor).collect()
    }

    /// Takes every number from a checkpoint's tensors, which must have the same names and shapes; more are ignored.
    pub fn read(&mut self, tensors: &TensorMap) -> Result<(), TrainError> {
        self.numbers = self.row_of(tensors, "")?;
        Ok(())
    }

    /// The row that [`Self::tensors_of`] made tensors of.
    pub fn row_of(&self, tensors: &TensorMap, prefix: &str) -> Result<Vec<f32>, TrainError> {
        let mut row = Vec::with_capacity(self.numbers.len());
        for place in &self.tensors {
            let name = format!("{prefix}{}", place.name);
            let Some(tensor) = tensors.get(&name) else {
                return Err(PolicyError::MissingTensor { name }.into());
            };
            if tensor.shape != place.shape || tensor.data.len() != place.range.len() {
                let (expected, found) = (format!("{:?}", place.shape), tensor.shape.clone());
                return Err(PolicyError::TensorShape { name, expected, found }.into());
            }
            if tensor.data.iter().any(|x| !x.is_finite()) {
                return Err(PolicyError::NotFinite { name }.into());
            }
            row.extend_from_slice(&tensor.data);
        }
        Ok(row)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters() -> Parameters {
        let shapes = [("a", vec![2, 3]), ("b", vec![]), ("c", vec![2])];
        let mut parameters = Parameters::zeros(shapes.map(|(name, s)| (name.to_owned(), s)));
        for (i, x) in parameters.numbers_mut().iter_mut().enumerate() {
            *x = i as f32;
        }
        parameters.add_alias("d".to_owned(), "c");
        parameters
    }

    #[test]
    fn a_scalar_is_one_number_and_tensors_follow_each_other() {
        let parameters = parameters();
        let ranges: Vec<_> = parameters.places().iter().map(|p| p.range.clone()).collect();
        assert_eq!(ranges, [0..6, 6..7, 7..9]);
        assert!(parameters.place("d").is_err(), "an alias is no parameter");
    }

    #[test]
    fn what_is_written_is_read_back_and_aliases_are_written_too() {
        let parameters = parameters();
        let mut tensors = parameters.tensors();
        assert_eq!(tensors["d"], Tensor { shape: vec![2], data: vec![7.0, 8.0] });
        let mut other = parameters.clone();
        other.numbers_mut().fill(0.0);
        other.read(&tensors).unwrap();
        assert_eq!(other, parameters);
        tensors.get_mut("a").unwrap().shape = vec![3, 2];
        assert!(other.read(&tensors).unwrap_err().to_string().contains("`a`"));
        tensors.remove("b");
        tensors.get_mut("a").unwrap().shape = vec![2, 3];
        assert!(other.read(&tensors).unwrap_err().to_string().contains("`b`"));
        assert_eq!(other, parameters, "a failed reading changes nothing");
    }
}

//! Adam (Kingma and Ba 2015), with the gradient's global norm clipped before.
//!
//! `m ← m + (1 − β₁)(g − m)`, `v ← β₂ v + (1 − β₂) g²`,
//! `θ ← θ − η · m/(1 − β₁ᵗ) / (√v/√(1 − β₂ᵗ) + ε)`: the order of operations is torch's. The gradient is scaled by
//! `min(1, limit/(norm + 1e-6))` first; the norm is that of all parameters that are trained, each counted once.

use super::TrainError;
use super::parameters::Parameters;
use crate::policy::checkpoint::contents::TensorMap;

/// Added to the norm by torch before it divides.
const NORM_EPSILON: f64 = 1e-6;

/// Constants of Adam. The default is the published training's.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AdamSettings {
    /// How long the mean of the gradient remembers, and how long its square.
    pub betas: [f64; 2],
    pub epsilon: f64,
}

impl Default for AdamSettings {
    fn default() -> Self {
        Self { betas: [0.9, 0.999], epsilon: 1e-5 }
    }
}

/// The optimiser and what it remembers.
#[derive(Debug, Clone, PartialEq)]
pub struct Adam {
    settings: AdamSettings,
    steps: u64,
    mean: Vec<f32>,
    square: Vec<f32>,
}

impl Adam {
    /// For so many parameters, before the first step.
    #[must_use]
    pub fn new(settings: AdamSettings, parameters: &Parameters) -> Self {
        let zeros = vec![0.0; parameters.numbers().len()];
        Self { settings, steps: 0, mean: zeros.clone(), square: zeros }
    }

    /// Steps taken.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// One step of `learning_rate`. Returns the norm of the gradient before it was clipped to `largest_norm`. Nothing
    /// changes if that is not finite.
    pub fn step(
        &mut self,
        parameters: &mut Parameters,
        gradient: &[f32],
        learning_rate: f64,
        largest_norm: Option<f64>,
    ) -> Result<f64, TrainError> {
        let trained = |parameters: &Parameters| -> Vec<_> {
            let places = parameters.places().iter().filter(|place| place.trainable);
            places.map(|place| place.range.clone()).collect()
        };
        let ranges = trained(parameters);
        let squares = ranges.iter().flat_map(|range| &gradient[range.clone()]);
        let norm = squares.map(|&g| f64::from(g) * f64::from(g)).sum::<f64>().sqrt();
        if !norm.is_finite() {
            return Err(TrainError::NotFinite { what: "gradient" });
        }
        let scale =
            largest_norm.map_or(1.0, |limit| (limit / (norm + NORM_EPSILON)).min(1.0)) as f32;
        self.steps += 1;
        let [mean_beta, square_beta] = self.settings.betas;
        let power = |beta: f64| 1.0 - beta.powf(self.steps as f64);
        let step = (learning_rate / power(mean_beta)) as f32;
        let root = power(square_beta).sqrt() as f32;
        let epsilon = self.settings.epsilon as f32;
        let (mean_rest, square_rest) = ((1.0 - mean_beta) as f32, (1.0 - square_beta) as f32);
        let square_beta = square_beta as f32;
        for range in ranges {
            let numbers = &mut parameters.numbers_mut()[range.clone()];
            let (mean, square) = (&mut self.mean[range.clone()], &mut self.square[range.clone()]);
            for (((x, m), v), g) in numbers.iter_mut().zip(mean).zip(square).zip(&gradient[range]) {
                let g = g * scale;
                *m += mean_rest * (g - *m);
                *v = *v * square_beta + square_rest * (g * g);
                *x -= step * (*m / (v.sqrt() / root + epsilon));
            }
        }
        Ok(norm)
    }

    /// What it remembers, as tensors called `mean.<parameter>` and `square.<parameter>`. With [`Self::steps`] this is
    /// all that [`Self::restore`] needs.
    #[must_use]
    pub fn tensors(&self, parameters: &Parameters) -> TensorMap {
        let mut tensors = parameters.tensors_of(&self.mean, "mean.");
        tensors.extend(parameters.tensors_of(&self.square, "square."));
        tensors
    }

    /// The optimiser that has taken `steps` steps and remembers `tensors`.
    pub fn restore(
        settings: AdamSettings,
        parameters: &Parameters,
        steps: u64,
        tensors: &TensorMap,
    ) -> Result<Self, TrainError> {
        let mean = parameters.row_of(tensors, "mean.")?;
        let square = parameters.row_of(tensors, "square.")?;
        Ok(Self { settings, steps, mean, square })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parameters(numbers: &[f32]) -> Parameters {
        let shapes = [("a".to_owned(), vec![1]), ("b".to_owned(), vec![numbers.len() - 1])];
        let mut parameters = Parameters::zeros(shapes);
        parameters.numbers_mut().copy_from_slice(numbers);
        parameters
    }

    #[test]
    fn the_first_step_goes_by_the_learning_rate_whatever_the_gradient() {
        // m/(1 − β₁) = g and √v/√(1 − β₂) = |g|, so the step is g/(|g| + ε).
        let mut parameters = parameters(&[1.0, 2.0, 3.0]);
        let mut adam = Adam::new(AdamSettings { epsilon: 0.0, ..Default::default() }, &parameters);
        let norm = adam.step(&mut parameters, &[3.0, -4.0, 0.5], 0.25, None).unwrap();
        assert!((norm - 25.25_f64.sqrt()).abs() < 1e-12);
        for (x, want) in parameters.numbers().iter().zip([0.75, 2.25, 2.75]) {
            assert!((x - want).abs() < 1e-5, "{:?}", parameters.numbers());
        }
    }

    #[test]
    fn two_steps_by_hand() {
        // β = (½, ¾), ε = 1, η = 1, gradients 2 and 0: m = 1, v = 1, then m = ½, v = ¾.
        let settings = AdamSettings { betas: [0.5, 0.75], epsilon: 1.0 };
        let mut parameters = parameters(&[0.0, 0.0]);
        let mut adam = Adam::new(settings, &parameters);
        adam.step(&mut parameters, &[2.0, 0.0], 1.0, None).unwrap();
        let first = -(1.0 / 0.5) / (1.0 / 0.5 + 1.0);
        assert!((f64::from(parameters.numbers()[0]) - first).abs() < 1e-6);
        adam.step(&mut parameters, &[0.0, 0.0], 1.0, None).unwrap();
        let second = first - (0.5 / 0.75) / ((0.75_f64 / 0.4375).sqrt() + 1.0);
        assert!((f64::from(parameters.numbers()[0]) - second).abs() < 1e-6);
    }

    #[test]
    fn a_long_gradient_is_clipped_and_a_frozen_tensor_neither_moves_nor_counts() {
        let mut parameters = parameters(&[1.0, 1.0]);
        parameters.freeze(|name| name == "a");
        let mut adam = Adam::new(AdamSettings { epsilon: 1e6, ..Default::default() }, &parameters);
        let norm = adam.step(&mut parameters, &[100.0, 5.0], 1e6, Some(0.5)).unwrap();
        assert!((norm - 5.0).abs() < 1e-12);
        // With a huge ε the step is the clipped gradient itself.
        assert!((parameters.numbers()[1] - 0.5).abs() < 1e-4, "{:?}", parameters.numbers());
        assert_eq!(parameters.numbers()[0].to_bits(), 1.0_f32.to_bits());
    }

    #[test]
    fn a_restored_optimiser_goes_on_bit_by_bit() {
        let mut one = parameters(&[0.3, -0.2, 0.9]);
        let mut adam = Adam::new(AdamSettings::default(), &one);
        adam.step(&mut one, &[0.1, 0.7, -0.4], 1e-2, Some(0.7)).unwrap();
        let tensors = adam.tensors(&one);
        let mut again =
            Adam::restore(AdamSettings::default(), &one, adam.steps(), &tensors).unwrap();
        assert_eq!(again, adam);
        let mut other = one.clone();
        adam.step(&mut one, &[0.2, -0.7, -0.1], 1e-2, Some(0.7)).unwrap();
        again.step(&mut other, &[0.2, -0.7, -0.1], 1e-2, Some(0.7)).unwrap();
        assert_eq!(one, other);
    }

    #[test]
    fn a_gradient_that_is_not_finite_changes_nothing() {
        let mut parameters = parameters(&[0.3, -0.2]);
        let mut adam = Adam::new(AdamSettings::default(), &parameters);
        let before = (parameters.clone(), adam.clone());
        assert!(adam.step(&mut parameters, &[f32::NAN, 0.0], 1e-2, None).is_err());
        assert_eq!((parameters, adam), before);
    }
}

//! Learning curves: values over training steps, joined, smoothed, averaged.
//!
//! A curve is a list of steps and a list of values of equal length. Steps are `f64`: they are shifted and interpolated,
//! and every step count in use is exact in it.

mod bands;
mod joining;
mod recipes;
mod smoothing;

pub use bands::{Band, band_on_grid, band_over_shared_steps};
pub use joining::{merge_resumed, stitch};
pub use recipes::{
    CONTINUED_RUN, Smoothing, TransferScale, csi_finetuning_values, multi_task_curve,
    portable_curve, rl_finetuning_values, transfer_curve,
};
pub use smoothing::{running_mean, savitzky_golay};

/// Why curves cannot be made or combined.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum CurveError {
    #[error("a curve has {steps} steps, but {values} values")]
    Length { steps: usize, values: usize },
    #[error("a smoothing window must be odd, at least 3 and at most {length}, found {window}")]
    Window { window: usize, length: usize },
    #[error("there is no curve to average")]
    NoCurves,
    #[error("the {curves} curves have no step in common")]
    NoSharedStep { curves: usize },
    #[error("the step at position {index} is {step}, not a finite number")]
    NotFinite { index: usize, step: f64 },
}

/// Values over steps.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Curve {
    steps: Vec<f64>,
    values: Vec<f64>,
}

impl Curve {
    /// Pairs steps, which must be finite, with values.
    pub fn new(steps: Vec<f64>, values: Vec<f64>) -> Result<Self, CurveError> {
        if steps.len() != values.len() {
            return Err(CurveError::Length { steps: steps.len(), values: values.len() });
        }
        if let Some(index) = steps.iter().position(|step| !step.is_finite()) {
            return Err(CurveError::NotFinite { index, step: steps[index] });
        }
        Ok(Self { steps, values })
    }

    /// The steps.
    #[must_use]
    pub fn steps(&self) -> &[f64] {
        &self.steps
    }

    /// The values, one per step.
    #[must_use]
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Number of points.
    #[must_use]
    pub fn len(&self) -> usize {
        self.steps.len()
    }

    /// Whether there is no point.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.steps.is_empty()
    }

    fn points(&self) -> impl Iterator<Item = (f64, f64)> {
        self.steps.iter().copied().zip(self.values.iter().copied())
    }
}

impl FromIterator<(f64, f64)> for Curve {
    fn from_iter<I: IntoIterator<Item = (f64, f64)>>(points: I) -> Self {
        let (steps, values) = points.into_iter().unzip();
        Self { steps, values }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_and_values_go_in_pairs_and_steps_are_finite() {
        let lengths = CurveError::Length { steps: 1, values: 0 };
        assert_eq!(Curve::new(vec![1.0], vec![]), Err(lengths));
        assert!(Curve::new(vec![1.0, f64::NAN], vec![0.0; 2]).is_err());
        assert!(Curve::new(vec![1.0], vec![f64::NAN]).is_ok());
    }
}

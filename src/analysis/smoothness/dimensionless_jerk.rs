//! Log dimensionless jerk (LDLJ): how much the acceleration changes, for the length and size of the movement.
//!
//! For each joint `LDLJ = −ln(D⁵ Σₜ (Δ³qₜ)² / q_peak²)` with D = T − 1 steps, Δ³ the third forward difference and
//! `q_peak = maxₜ |qₜ − mean q|`, the excursion. No unit; higher is smoother.
//!
//! Inputs: joint angles in rad; rows are steps, columns are joints. The value of an episode is the mean over its
//! joints that have one.
//!
//! Degenerate: a joint whose excursion is below 10⁻⁶ rad, or whose squared jerk sums to less than 10⁻¹², has no value:
//! it does not move, or moves along a line. Fewer than four samples have no third difference.
//!
//! Reference: Hogan & Sternad 2009; here scaled by the excursion of the angle, as the authors' suite does, and not by
//! the peak speed. Oracle: `tests/signals_parity.rs`, algorithm `smoothness_episode`.

use super::{FEWEST_SAMPLES, SmoothnessError};
use crate::analysis::signal::Rows;
use crate::units::Radians;

/// Below what a joint counts as still.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DimensionlessJerkOptions {
    /// Least excursion about the mean, rad.
    pub least_excursion: Radians,
    /// Least sum of squared third differences, rad².
    pub least_jerk: f64,
}

impl Default for DimensionlessJerkOptions {
    fn default() -> Self {
        Self { least_excursion: 1e-6, least_jerk: 1e-12 }
    }
}

/// Computes LDLJ of one episode after the other; buffers are kept between them.
pub struct DimensionlessJerk {
    options: DimensionlessJerkOptions,
    mean: Vec<f64>,
    excursion: Vec<f64>,
    jerk: Vec<f64>,
    joints: Vec<Option<f64>>,
}

impl DimensionlessJerk {
    /// Ready for any number of episodes.
    pub fn new(options: DimensionlessJerkOptions) -> Result<Self, SmoothnessError> {
        let checks =
            [("least excursion", options.least_excursion), ("least jerk", options.least_jerk)];
        for (name, value) in checks {
            if !(value > 0.0 && value.is_finite()) {
                let expected = "a positive number";
                return Err(SmoothnessError::Option { name, value, expected });
            }
        }
        let (mean, excursion, jerk, joints) = Default::default();
        Ok(Self { options, mean, excursion, jerk, joints })
    }

    /// LDLJ of every joint. Does not allocate after the first episode.
    pub fn per_joint(&mut self, positions: &Rows<'_>) -> &[Option<f64>] {
        self.joints.clear();
        self.joints.resize(positions.columns(), None);
        if positions.len() < FEWEST_SAMPLES {
            return &self.joints;
        }
        self.measure(positions);
        let duration = (positions.len() - 1) as f64;
        let moments = self.excursion.iter().zip(&self.jerk);
        for (joint, (&excursion, &jerk)) in self.joints.iter_mut().zip(moments) {
            let moves =
                excursion >= self.options.least_excursion && jerk >= self.options.least_jerk;
            let value = -(duration.powi(5) * jerk / (excursion * excursion)).ln();
            *joint = Some(value).filter(|value| moves && value.is_finite());
        }
        &self.joints
    }

    /// Fills `excursion` and `jerk`. All joints of a row side by side, which is how they lie in memory.
    fn measure(&mut self, positions: &Rows<'_>) {
        for buffer in [&mut self.mean, &mut self.excursion, &mut self.jerk] {
            buffer.clear();
            buffer.resize(positions.columns(), 0.0);
        }
        for row in positions {
            for (sum, position) in self.mean.iter_mut().zip(row) {
                *sum += position;
            }
        }
        let count = positions.len() as f64;
        self.mean.iter_mut().for_each(|sum| *sum /= count);
        for row in positions {
            for ((peak, mean), position) in self.excursion.iter_mut().zip(&self.mean).zip(row) {
                let distance = (position - mean).abs();
                *peak = if distance > *peak { distance } else { *peak };
            }
        }
        let columns = positions.columns();
        for four in positions.values().windows(4 * columns).step_by(columns) {
            let (a, rest) = four.split_at(columns);
            let (b, rest) = rest.split_at(columns);
            let (c, d) = rest.split_at(columns);
            for (joint, sum) in self.jerk.iter_mut().enumerate() {
                let first = [b[joint] - a[joint], c[joint] - b[joint], d[joint] - c[joint]];
                let third = (first[2] - first[1]) - (first[1] - first[0]);
                *sum += third * third;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn of(angles: &[f64]) -> Option<f64> {
        let mut meter = DimensionlessJerk::new(DimensionlessJerkOptions::default()).unwrap();
        meter.per_joint(&Rows::new(angles, 1).unwrap())[0]
    }

    #[test]
    fn a_cubic_has_constant_jerk() {
        // q = t³ for t = −2 … 2: Δ³ = 6 twice, mean 0, excursion 8, D = 4.
        let want = -(4.0_f64.powi(5) * 72.0 / 64.0).ln();
        assert!((of(&[-8.0, -1.0, 0.0, 1.0, 8.0]).unwrap() - want).abs() < 1e-14);
    }

    #[test]
    fn what_stands_still_or_moves_along_a_line_is_undefined() {
        assert_eq!(of(&[0.3; 20]), None);
        assert_eq!(of(&[0.0, 1.0, 2.0, 3.0, 4.0]), None);
        assert_eq!(of(&[0.0, 1.0, 0.0]), None);
        assert_eq!(of(&[1e200, -1e200, 1e200, -1e200]), None);
    }

    #[test]
    fn thresholds_that_are_not_positive_are_refused() {
        let options = DimensionlessJerkOptions { least_jerk: 0.0, ..Default::default() };
        assert!(DimensionlessJerk::new(options).is_err());
    }

    proptest! {
        #[test]
        fn scale_and_offset_of_the_angle_do_not_matter(
            angles in prop::collection::vec(-1.0..1.0_f64, 4..60),
            scale in 0.5..5.0_f64,
            offset in -3.0..3.0_f64,
        ) {
            let moved: Vec<f64> = angles.iter().map(|q| scale * q + offset).collect();
            if let (Some(found), Some(moved)) = (of(&angles), of(&moved)) {
                prop_assert!((found - moved).abs() < 1e-6);
            }
        }
    }
}

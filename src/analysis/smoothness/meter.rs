//! All four smoothness numbers of an episode in one go, with every buffer kept for the next.

use serde::Serialize;

use super::{
    DimensionlessJerk, DimensionlessJerkOptions, SmoothnessError, SpectralArcLength,
    SpectralArcLengthOptions, VelocityPeaks, VelocityPeaksOptions, joint_space_speed,
    mean_action_change,
};
use crate::analysis::signal::Rows;
use crate::analysis::undefined::Undefined;

/// How the four are computed; the default is the paper's.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct SmoothnessOptions {
    pub spectral_arc_length: SpectralArcLengthOptions,
    pub dimensionless_jerk: DimensionlessJerkOptions,
    pub velocity_peaks: VelocityPeaksOptions,
}

/// The smoothness of one episode; `None` where undefined. Names of the fields are those of the published tables.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Smoothness {
    /// Mean |Δa|, in units of the commands, per step.
    pub mean_abs_diff: Option<f64>,
    /// Spectral arc length of the joints' common speed.
    pub sparc: Option<f64>,
    /// Log dimensionless jerk, mean over joints.
    pub ldlj_kin: Option<f64>,
    /// Velocity peaks, mean over joints.
    pub nvp: Option<f64>,
}

/// Measures one episode after the other.
pub struct SmoothnessMeter {
    spectral_arc_length: SpectralArcLength,
    dimensionless_jerk: DimensionlessJerk,
    velocity_peaks: VelocityPeaks,
    speed: Vec<f64>,
}

impl SmoothnessMeter {
    /// Ready for any number of episodes.
    pub fn new(options: &SmoothnessOptions) -> Result<Self, SmoothnessError> {
        Ok(Self {
            spectral_arc_length: SpectralArcLength::new(options.spectral_arc_length)?,
            dimensionless_jerk: DimensionlessJerk::new(options.dimensionless_jerk)?,
            velocity_peaks: VelocityPeaks::new(options.velocity_peaks)?,
            speed: Vec::new(),
        })
    }

    /// The smoothness of an episode: `actions` as sent to the environment (steps × muscles), `positions` of the joints
    /// in rad (steps × joints), both of the executed steps only. Does not allocate after the first episode.
    pub fn measure<T: Copy + Into<f64>>(
        &mut self,
        actions: &Rows<'_, T>,
        positions: &Rows<'_>,
    ) -> Result<Smoothness, SmoothnessError> {
        if actions.len() != positions.len() {
            let (actions, positions) = (actions.len(), positions.len());
            return Err(SmoothnessError::RowCount { actions, positions });
        }
        joint_space_speed(positions, &mut self.speed);
        let jerks = self.dimensionless_jerk.per_joint(positions).iter().copied();
        let peaks = self.velocity_peaks.per_joint(positions).iter().copied();
        Ok(Smoothness {
            mean_abs_diff: mean_action_change(actions),
            sparc: self.spectral_arc_length.of(&self.speed),
            ldlj_kin: Undefined::Skip.mean(jerks),
            nvp: Undefined::Skip.mean(peaks),
        })
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn measure(actions: &[f32], positions: &[f64]) -> Result<Smoothness, SmoothnessError> {
        let mut meter = SmoothnessMeter::new(&SmoothnessOptions::default()).unwrap();
        meter.measure(&Rows::new(actions, 2).unwrap(), &Rows::new(positions, 3).unwrap())
    }

    #[test]
    fn an_episode_of_three_steps_has_no_smoothness() {
        let positions: Vec<f64> = (0..9).map(|i| f64::from(i * i)).collect();
        let nothing = Smoothness { mean_abs_diff: None, sparc: None, ldlj_kin: None, nvp: None };
        assert_eq!(measure(&[0.5; 6], &positions), Ok(nothing));
        assert_eq!(measure(&[], &[]), Ok(nothing));
    }

    #[test]
    fn signals_of_different_length_are_refused() {
        assert_eq!(
            measure(&[0.5; 8], &[0.0; 9]),
            Err(SmoothnessError::RowCount { actions: 4, positions: 3 })
        );
    }

    #[test]
    fn a_body_that_stands_still_has_only_commands() {
        let found = measure(&[0.0, 1.0].repeat(10), &[0.2; 30]).unwrap();
        let want = Smoothness { mean_abs_diff: Some(0.0), sparc: None, ldlj_kin: None, nvp: None };
        assert_eq!(found, want);
    }

    proptest! {
        #[test]
        fn any_finite_episode_is_measured_and_episodes_before_leave_no_trace(
            steps in prop::collection::vec(
                (prop::array::uniform2(any::<f32>()), prop::array::uniform3(any::<f64>())), 0..40,
            ),
            others in prop::collection::vec(-1.0..1.0_f64, 60),
        ) {
            let actions: Vec<f32> = steps.iter().flat_map(|(a, _)| *a).collect();
            let positions: Vec<f64> = steps.iter().flat_map(|(_, q)| *q).collect();
            let tables = Rows::new(&actions, 2).ok().zip(Rows::new(&positions, 3).ok());
            if let Some((actions, positions)) = tables {
                let options = SmoothnessOptions::default();
                let mut used = SmoothnessMeter::new(&options).unwrap();
                let before = Rows::new(&others, 3).unwrap();
                used.measure(&before, &before).unwrap();
                let found = used.measure(&actions, &positions).unwrap();
                let fresh = SmoothnessMeter::new(&options).unwrap().measure(&actions, &positions);
                prop_assert_eq!(found, fresh.unwrap());
                let values = [found.sparc, found.ldlj_kin, found.nvp];
                prop_assert!(values.iter().flatten().all(|x| x.is_finite()));
            }
        }
    }
}

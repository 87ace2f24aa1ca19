//! Number of velocity peaks (NVP): how often a joint speeds up and slows down again.
//!
//! For each joint the local maxima of its speed `sₜ = |qₜ₊₁ − qₜ|` that are at least 5 % of its largest speed are
//! counted. A count; lower is smoother. A flat top counts once; the first and the last sample are never maxima.
//!
//! Inputs: joint angles in rad; rows are steps, columns are joints. The value of an episode is the mean over its
//! joints that have one.
//!
//! Degenerate: a joint whose largest speed is below 10⁻⁶ rad per step never moves and has no value (not 0). Fewer than
//! four samples are undefined.
//!
//! Oracle: `tests/signals_parity.rs`, algorithms `local_maxima` (SciPy's `find_peaks`), `smoothness_episode`.

use super::{FEWEST_SAMPLES, SmoothnessError};
use crate::analysis::signal::Rows;

/// Which maxima of a joint's speed count.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct VelocityPeaksOptions {
    /// Least height of a peak, as a share of the joint's largest speed.
    pub height_share: f64,
    /// Joints that are never this fast, in rad per step, have no value.
    pub least_speed: f64,
}

impl Default for VelocityPeaksOptions {
    fn default() -> Self {
        Self { height_share: 0.05, least_speed: 1e-6 }
    }
}

/// Counts the peaks of one episode after the other; buffers are kept between them.
pub struct VelocityPeaks {
    options: VelocityPeaksOptions,
    speed: Vec<f64>,
    joints: Vec<Option<f64>>,
}

impl VelocityPeaks {
    /// Ready for any number of episodes.
    pub fn new(options: VelocityPeaksOptions) -> Result<Self, SmoothnessError> {
        let VelocityPeaksOptions { height_share, least_speed } = options;
        if !(0.0..=1.0).contains(&height_share) {
            let (name, expected) = ("height share", "0 to 1");
            return Err(SmoothnessError::Option { name, value: height_share, expected });
        }
        if !(least_speed > 0.0 && least_speed.is_finite()) {
            let (name, expected) = ("least speed", "a positive number");
            return Err(SmoothnessError::Option { name, value: least_speed, expected });
        }
        Ok(Self { options, speed: Vec::new(), joints: Vec::new() })
    }

    /// Number of peaks of every joint. Does not allocate after the first episode.
    pub fn per_joint(&mut self, positions: &Rows<'_>) -> &[Option<f64>] {
        self.joints.clear();
        self.joints.resize(positions.columns(), None);
        if positions.len() < FEWEST_SAMPLES {
            return &self.joints;
        }
        for (index, joint) in self.joints.iter_mut().enumerate() {
            let angles = positions.column(index);
            self.speed.clear();
            self.speed.extend(angles.clone().skip(1).zip(angles).map(|(b, a)| (b - a).abs()));
            let largest = self.speed.iter().copied().fold(0.0, f64::max);
            if largest >= self.options.least_speed {
                let height = self.options.height_share * largest;
                *joint = Some(local_maxima(&self.speed, height).count() as f64);
            }
        }
        &self.joints
    }
}

/// Samples of the local maxima of `signal` that are at least `height`, rising; of a flat top the middle, rounded down.
#[expect(clippy::float_cmp, reason = "a flat top is one of equal samples")]
pub fn local_maxima(signal: &[f64], height: f64) -> impl Iterator<Item = usize> {
    let mut next = 1;
    std::iter::from_fn(move || {
        while next + 1 < signal.len() {
            let (start, top) = (next, signal[next]);
            next += 1;
            if signal[start - 1] >= top {
                continue;
            }
            // Not beyond the last sample: a top that lasts to the end is no maximum.
            while next + 1 < signal.len() && signal[next] == top {
                next += 1;
            }
            if signal[next] < top && top >= height {
                return Some(usize::midpoint(start, next - 1));
            }
        }
        None
    })
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "equal samples are what a flat top is made of")]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn maxima(signal: &[f64]) -> Vec<usize> {
        local_maxima(signal, f64::NEG_INFINITY).collect()
    }

    fn of(angles: &[f64]) -> Option<f64> {
        let mut meter = VelocityPeaks::new(VelocityPeaksOptions::default()).unwrap();
        meter.per_joint(&Rows::new(angles, 1).unwrap())[0]
    }

    #[test]
    fn flat_tops_count_once_and_ends_never() {
        assert_eq!(maxima(&[0.0, 1.0, 0.0, 2.0, 2.0, 2.0, 2.0, 1.0]), [1, 4]);
        assert_eq!(maxima(&[2.0, 1.0, 1.0, 2.0]), [0; 0]);
        assert_eq!(maxima(&[0.0, 2.0, 2.0]), [0; 0]);
        assert_eq!(maxima(&[0.0, 2.0, 2.0, 3.0, 1.0]), [3]);
        assert_eq!(maxima(&[1.0]), [0; 0]);
        assert_eq!(maxima(&[]), [0; 0]);
        assert_eq!(local_maxima(&[0.0, 1.0, 0.0, 2.0, 0.0], 1.5).collect::<Vec<_>>(), [3]);
    }

    #[test]
    fn a_joint_that_never_moves_has_no_count_and_a_ramp_has_no_peak() {
        assert_eq!(of(&[0.4; 9]), None);
        assert_eq!(of(&[0.0, 1.0, 2.0, 3.0]), Some(0.0));
        assert_eq!(of(&[0.0, 0.0, 1.0]), None);
        assert_eq!(of(&[0.0, 0.0, 1.0, 1.0]), Some(1.0));
    }

    #[test]
    fn thresholds_that_mean_nothing_are_refused() {
        let of = |height_share, least_speed| {
            VelocityPeaks::new(VelocityPeaksOptions { height_share, least_speed }).is_err()
        };
        assert!(of(-0.1, 1.0) && of(f64::NAN, 1.0) && of(0.05, 0.0) && !of(0.05, 1.0));
    }

    proptest! {
        #[test]
        fn maxima_rise_stand_above_both_sides_and_are_the_same_backwards(
            signal in prop::collection::vec(0..6_i32, 0..60),
        ) {
            let signal: Vec<f64> = signal.into_iter().map(f64::from).collect();
            let found = maxima(&signal);
            prop_assert!(found.is_sorted_by(|a, b| a + 1 < *b));
            for &at in &found {
                let differs = |x: &&f64| **x != signal[at];
                let before = signal[..at].iter().rev().find(differs);
                let after = signal[at..].iter().find(differs);
                prop_assert!(before.unwrap() < &signal[at] && after.unwrap() < &signal[at]);
            }
            let backwards: Vec<f64> = signal.iter().rev().copied().collect();
            prop_assert_eq!(maxima(&backwards).len(), found.len());
        }
    }
}

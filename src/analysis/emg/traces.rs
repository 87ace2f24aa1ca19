//! Traces for drawing: profiles over the gait cycle, each divided by its own maximum.
//!
//! The people's mean is the mean of their raw profiles, divided afterwards; its band is the standard deviation over
//! people (divisor n − 1) divided by the same number. No unit; point k of n lies at `100 k/(n − 1)` % of the cycle.
//!
//! Degenerate: a profile whose maximum is not positive is drawn as zeros and marked silent. One person has no band.
//!
//! Oracle: `tests/signals_parity.rs`, algorithm `emg_comparison`.

use super::{HUMAN_CHANNELS, HumanProfiles};
use crate::analysis::stats::{Divisor, standard_deviation};

/// A profile with maximum 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Trace {
    pub values: Vec<f64>,
    /// Whether there was no positive maximum to divide by.
    pub silent: bool,
}

/// Divides a profile by its maximum.
#[must_use]
pub fn relative_to_maximum(profile: &[f64]) -> Trace {
    let maximum = profile.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    if maximum > 0.0 {
        Trace { values: profile.iter().map(|x| x / maximum).collect(), silent: false }
    } else {
        Trace { values: vec![0.0; profile.len()], silent: true }
    }
}

/// The people's traces of one muscle.
#[derive(Debug, Clone, PartialEq)]
pub struct MuscleTrace {
    /// Label of the channel.
    pub muscle: &'static str,
    /// One per person.
    pub subjects: Vec<Trace>,
    pub mean: Trace,
    /// Half width of the band about the mean, one per point; undefined for one person or a silent mean.
    pub band: Option<Vec<f64>>,
}

/// The traces of a channel of [`HUMAN_CHANNELS`].
#[must_use]
pub fn muscle_trace(people: &HumanProfiles, channel: usize) -> MuscleTrace {
    let count = people.subjects().len();
    let raw_mean = people.mean_profile(channel, None);
    let maximum = raw_mean.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let mean = relative_to_maximum(&raw_mean);
    let deviation = |point: usize| {
        let values: Vec<f64> =
            (0..count).map(|place| people.profile(place, channel)[point]).collect();
        standard_deviation(&values, Divisor::CountMinusOne).map(|deviation| deviation / maximum)
    };
    let band = (0..people.points()).map(deviation).collect::<Option<Vec<f64>>>();
    MuscleTrace {
        muscle: HUMAN_CHANNELS[channel],
        subjects: (0..count).map(|p| relative_to_maximum(people.profile(p, channel))).collect(),
        band: band.filter(|_| !mean.silent),
        mean,
    }
}

#[cfg(test)]
mod tests {
    use super::super::human::tests::people;
    use super::*;

    #[test]
    fn the_mean_is_taken_before_it_is_divided() {
        let two = people(2, 2, |subject, _, point| f64::from(1 + 2 * subject) * point as f64);
        let trace = muscle_trace(&two, 0);
        assert_eq!(trace.mean, Trace { values: vec![0.0, 1.0], silent: false });
        let band = trace.band.unwrap();
        assert!(band[0].abs() < 1e-15 && (band[1] - 2.0_f64.sqrt() / 2.0).abs() < 1e-15);
    }

    #[test]
    fn a_silent_muscle_is_zeros_and_one_person_has_no_band() {
        assert_eq!(relative_to_maximum(&[-1.0, 0.0]), Trace { values: vec![0.0; 2], silent: true });
        let one = people(1, 3, |_, channel, _| -(channel as f64));
        let trace = muscle_trace(&one, 2);
        assert!(trace.mean.silent && trace.band.is_none());
    }
}

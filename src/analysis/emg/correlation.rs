//! Correlation of muscle profiles: of a simulated walk with people, and of people with each other.
//!
//! `r = Σ (x − x̄)(y − ȳ) / √(Σ (x − x̄)² Σ (y − ȳ)²)` (Pearson) over the points of the gait cycle, for every person and
//! muscle. No unit, in [−1, 1]. A person's value is the mean over the nine muscles, a policy's the mean over people.
//!
//! The ceiling is [`leave_one_out`]: each person against the mean profile of all others. [`pairwise`], each person
//! against each other one, is an older definition with lower values, because one profile is noisier than a mean of
//! eight. [`timing`] shifts the simulated profile round the cycle; the best shift should be near none.
//!
//! A simulated profile of another number of points is first resampled to the people's, linearly.
//!
//! Degenerate: r is undefined if a profile is constant (a dead channel, a silent muscle), and then so is the person's
//! mean unless undefined values are skipped. Fewer than two people have no ceiling: an error.
//!
//! Reference: the authors' suite. Oracle: `tests/signals_parity.rs`, algorithms `emg_comparison`,
//! `emg_comparison_degenerate`, and `emg_real` (nine people at 4.5 km/h: leave-one-out .8212, pairwise .7314).

use super::{EmgError, HUMAN_CHANNELS, HumanProfiles};
use crate::analysis::signal::{Rows, SignalError, resample};
use crate::analysis::stats::pearson;
use crate::analysis::undefined::Undefined;

const CHANNELS: usize = HUMAN_CHANNELS.len();

/// One r per row (person, or pair of people) and channel of [`HUMAN_CHANNELS`].
#[derive(Debug, Clone, PartialEq)]
pub struct Correlations {
    rows: Vec<[Option<f64>; CHANNELS]>,
}

impl Correlations {
    /// The rows, in the order of the people or pairs.
    #[must_use]
    pub fn rows(&self) -> &[[Option<f64>; CHANNELS]] {
        &self.rows
    }

    /// Mean of each row over the channels, less those at the places `without`.
    #[must_use]
    pub fn row_means(&self, without: &[usize], undefined: Undefined) -> Vec<Option<f64>> {
        let kept = |row: &[Option<f64>; CHANNELS]| {
            let row = *row;
            undefined.mean((0..CHANNELS).filter(|at| !without.contains(at)).map(|at| row[at]))
        };
        self.rows.iter().map(kept).collect()
    }

    /// Mean of each channel over the rows.
    #[must_use]
    pub fn channel_means(&self, undefined: Undefined) -> [Option<f64>; CHANNELS] {
        std::array::from_fn(|channel| undefined.mean(self.rows.iter().map(|row| row[channel])))
    }

    /// Mean over rows of [`Self::row_means`].
    #[must_use]
    pub fn overall(&self, without: &[usize], undefined: Undefined) -> Option<f64> {
        undefined.mean(self.row_means(without, undefined))
    }
}

/// Correlations of each pair of people.
#[derive(Debug, Clone, PartialEq)]
pub struct PairwiseCorrelations {
    /// Numbers of the two people of each row.
    pub pairs: Vec<(u32, u32)>,
    pub correlations: Correlations,
}

/// A simulated walk, points × nine muscles in the order of [`HUMAN_CHANNELS`], against each person.
pub fn correlate(people: &HumanProfiles, simulated: &Rows<'_>) -> Result<Correlations, EmgError> {
    let profiles = simulated_profiles(people, simulated)?;
    let row = |place| {
        std::array::from_fn(|channel| pearson(people.profile(place, channel), &profiles[channel]))
    };
    Ok(Correlations { rows: (0..people.subjects().len()).map(row).collect() })
}

/// Each person against the mean profile of the others.
pub fn leave_one_out(people: &HumanProfiles) -> Result<Correlations, EmgError> {
    needs_two(people)?;
    let row = |place| {
        std::array::from_fn(|channel| {
            let others = people.mean_profile(channel, Some(place));
            pearson(people.profile(place, channel), &others)
        })
    };
    Ok(Correlations { rows: (0..people.subjects().len()).map(row).collect() })
}

/// Each person against each later one.
pub fn pairwise(people: &HumanProfiles) -> Result<PairwiseCorrelations, EmgError> {
    needs_two(people)?;
    let count = people.subjects().len();
    let places = (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b)));
    let row = |(a, b)| {
        std::array::from_fn(|channel| {
            pearson(people.profile(a, channel), people.profile(b, channel))
        })
    };
    let number = |(a, b): (usize, usize)| (people.subjects()[a], people.subjects()[b]);
    Ok(PairwiseCorrelations {
        pairs: places.clone().map(number).collect(),
        correlations: Correlations { rows: places.map(row).collect() },
    })
}

/// Mean r over people and muscles with the simulated profiles delayed by 0, 1, … points, what leaves at the end of the
/// cycle coming in at its beginning. A delay that fits says that the simulated muscles are early by so many points.
pub fn timing(
    people: &HumanProfiles,
    simulated: &Rows<'_>,
    undefined: Undefined,
) -> Result<Vec<Option<f64>>, EmgError> {
    let mut profiles = simulated_profiles(people, simulated)?;
    let mut means = Vec::with_capacity(people.points());
    for _ in 0..people.points() {
        let r = (0..people.subjects().len()).flat_map(|place| {
            let profiles = &profiles;
            (0..CHANNELS)
                .map(move |channel| pearson(people.profile(place, channel), &profiles[channel]))
        });
        means.push(undefined.mean(r));
        profiles.iter_mut().for_each(|profile| profile.rotate_right(1));
    }
    Ok(means)
}

/// The nine simulated profiles, with as many points as the people's.
fn simulated_profiles(
    people: &HumanProfiles,
    simulated: &Rows<'_>,
) -> Result<Vec<Vec<f64>>, EmgError> {
    let (values, columns) = (simulated.values().len(), simulated.columns());
    if columns != CHANNELS || simulated.is_empty() {
        return Err(SignalError::Ragged { values, columns: CHANNELS }.into());
    }
    let profile = |channel| {
        let profile: Vec<f64> = simulated.column(channel).collect();
        resample(&profile, people.points()).unwrap_or_default()
    };
    Ok((0..CHANNELS).map(profile).collect())
}

fn needs_two(people: &HumanProfiles) -> Result<(), EmgError> {
    let found = people.subjects().len();
    if found < 2 { Err(EmgError::TooFewSubjects { needed: 2, found }) } else { Ok(()) }
}

#[cfg(test)]
mod tests {
    use std::f64::consts::TAU;

    use super::super::human::tests::people;
    use super::*;

    fn wave(shift: usize) -> impl Fn(u32, usize, usize) -> f64 {
        move |subject, channel, point| {
            let phase = TAU * ((point + shift) as f64 / 20.0 + channel as f64 / 9.0);
            phase.sin() + f64::from(subject)
        }
    }

    fn table(points: usize, value: impl Fn(u32, usize, usize) -> f64) -> Vec<f64> {
        let value = &value;
        (0..points).flat_map(|p| (0..CHANNELS).map(move |c| value(0, c, p))).collect()
    }

    #[test]
    fn alike_people_correlate_perfectly_and_a_constant_channel_not_at_all() {
        let alike = people(3, 20, wave(0));
        let all = leave_one_out(&alike).unwrap().overall(&[], Undefined::Propagate).unwrap();
        assert!((all - 1.0).abs() < 1e-12);
        let dead = people(3, 20, |s, c, p| if (s, c) == (1, 6) { 0.1 } else { wave(0)(s, c, p) });
        let found = leave_one_out(&dead).unwrap();
        assert_eq!(found.rows()[1][6], None);
        assert_eq!(found.overall(&[], Undefined::Propagate), None);
        assert!(found.overall(&[], Undefined::Skip).unwrap() > 0.99);
        assert!(found.overall(&[6], Undefined::Propagate).unwrap() > 0.99);
    }

    #[test]
    fn one_person_has_no_ceiling() {
        let alone = people(1, 20, wave(0));
        let error = EmgError::TooFewSubjects { needed: 2, found: 1 };
        assert_eq!(leave_one_out(&alone), Err(error.clone()));
        assert_eq!(pairwise(&alone), Err(error));
        let simulated = table(20, wave(0));
        let found = correlate(&alone, &Rows::new(&simulated, CHANNELS).unwrap()).unwrap();
        assert_eq!(found.rows().len(), 1);
    }

    #[test]
    fn a_walk_that_is_three_points_early_fits_best_when_delayed_by_three() {
        let alike = people(2, 20, wave(0));
        let simulated = table(20, wave(3));
        let simulated = Rows::new(&simulated, CHANNELS).unwrap();
        let means = timing(&alike, &simulated, Undefined::Propagate).unwrap();
        let best = (0..20).max_by(|&a, &b| means[a].unwrap().total_cmp(&means[b].unwrap()));
        assert_eq!(best, Some(3));
    }

    #[test]
    fn a_walk_without_nine_muscles_is_refused() {
        let alike = people(2, 20, wave(0));
        let simulated = vec![0.0; 16];
        let eight = Rows::new(&simulated, 8).unwrap();
        assert!(correlate(&alike, &eight).is_err());
        assert!(correlate(&alike, &Rows::new(&[], CHANNELS).unwrap()).is_err());
    }
}

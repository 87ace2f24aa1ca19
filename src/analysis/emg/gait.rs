//! Gait segmentation: where the cycles of walking begin and end, and which of them count.
//!
//! 1. The contact signal of each heel is cut at zero from below and low-passed without delay (order 5, 5 Hz). A *heel
//!    strike* is the first sample above 300 after one that is not.
//! 2. Two strikes of the leading foot in a row with a strike of the other foot strictly between them make a *detected*
//!    cycle: the samples from the first strike up to, but not including, the second.
//! 3. Within each episode the 10th and 90th percentile of the durations are taken; a cycle is *kept* if its duration
//!    lies between them, ends included, and its mean forward speed is at least 0.2 m/s. Forward speed is the first
//!    component of the root velocity in the heading frame, low-passed alike.
//!
//! Of two detected cycles of different duration both are lost; one alone stays.
//!
//! Units: contacts in sensor units (N), velocity in m/s, durations in samples. Columns of the contacts: right foot,
//! right toes, left foot, left toes. Toes are not used unless asked for.
//!
//! Degenerate: episodes of fewer than 19 samples are skipped and listed. Rates that differ between episodes, tables of
//! different length, and other than four contacts are errors.
//!
//! Reference: the authors' suite. Oracle: `tests/signals_parity.rs`, algorithms `gait_segmentation`,
//! `gait_segmentation_empty`, `forward_velocity`, and `emg_real` (a public recording).

use super::{EmgError, Side};
use crate::analysis::signal::{LowPass, LowPassOptions, Rows};
use crate::analysis::stats::{mean, percentile};
use crate::units::Hertz;

/// Right foot, right toes, left foot, left toes.
const CONTACTS: usize = 4;

/// Which sensors say that a foot is on the ground.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum ContactSensors {
    #[default]
    Heel,
    /// The sum of both sensors of a foot, an earlier rule.
    FootAndToes,
}

/// Over which cycles the percentiles of the duration are taken.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum PercentileScope {
    #[default]
    Episode,
    /// All episodes together, an earlier rule.
    Pooled,
}

/// How cycles are found and which are kept; the default is the authors'.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct GaitOptions {
    pub sensors: ContactSensors,
    /// Contact above which a foot is on the ground, in sensor units.
    pub contact_threshold: f64,
    /// Filter of contacts and root velocity.
    pub low_pass: LowPassOptions,
    /// Percentiles of the duration between which cycles are kept, 0 to 100.
    pub duration_percentiles: [f64; 2],
    pub percentile_scope: PercentileScope,
    /// Least mean forward speed, m/s.
    pub least_speed: f64,
    /// Episodes with fewer samples are skipped.
    pub fewest_samples: usize,
}

impl Default for GaitOptions {
    fn default() -> Self {
        Self {
            sensors: ContactSensors::Heel,
            contact_threshold: 300.0,
            low_pass: LowPassOptions::default(),
            duration_percentiles: [10.0, 90.0],
            percentile_scope: PercentileScope::Episode,
            least_speed: 0.2,
            fewest_samples: 19,
        }
    }
}

impl GaitOptions {
    fn check(&self) -> Result<(), EmgError> {
        let fail = |name, value, expected| Err(EmgError::Option { name, value, expected });
        let [low, high] = self.duration_percentiles;
        if !(0.0..=100.0).contains(&low) {
            return fail("lower duration percentile", low, "0 to 100");
        }
        if !(low..=100.0).contains(&high) {
            return fail("upper duration percentile", high, "the lower percentile to 100");
        }
        if !self.contact_threshold.is_finite() {
            return fail("contact threshold", self.contact_threshold, "a finite number");
        }
        if !self.least_speed.is_finite() {
            return fail("least speed", self.least_speed, "a finite number");
        }
        Ok(())
    }
}

/// What segmentation needs of one episode; rows are samples.
#[derive(Debug, Clone, Copy)]
pub struct GaitEpisode<'a> {
    /// Right foot, right toes, left foot, left toes.
    pub contacts: Rows<'a>,
    /// In the heading frame, m/s; the first column is forward.
    pub root_velocity: Rows<'a>,
    pub sample_rate: Hertz,
}

/// Why a detected cycle is kept or not.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Verdict {
    Kept,
    TooShort,
    TooLong,
    TooSlow,
}

impl Verdict {
    /// The word in tables; empty for a kept cycle.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::Kept => "",
            Self::TooShort => "short",
            Self::TooLong => "long",
            Self::TooSlow => "slow",
        }
    }
}

/// One detected cycle: the samples `start..end` of an episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Cycle {
    /// Place of the episode in the list.
    pub episode: usize,
    pub start: usize,
    pub end: usize,
    /// Mean forward speed, m/s.
    pub mean_speed: f64,
    pub verdict: Verdict,
}

impl Cycle {
    /// Number of samples.
    #[must_use]
    pub fn duration(&self) -> usize {
        self.end - self.start
    }
}

/// Samples of the heel strikes of one episode, rising.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct EpisodeStrikes {
    pub leading: Vec<usize>,
    pub opposite: Vec<usize>,
}

/// All detected cycles, in order of episode and time.
#[derive(Debug, Clone, PartialEq)]
pub struct Segmentation {
    pub cycles: Vec<Cycle>,
    /// One entry per episode; skipped episodes have no strikes.
    pub strikes: Vec<EpisodeStrikes>,
    /// Places of the episodes that were too short.
    pub skipped: Vec<usize>,
    /// Whether the cut-off was too high for the rate, so that nothing was filtered.
    pub unfiltered: bool,
}

impl Segmentation {
    /// Number of detected cycles.
    #[must_use]
    pub fn detected(&self) -> usize {
        self.cycles.len()
    }

    /// The kept cycles.
    pub fn kept(&self) -> impl Iterator<Item = &Cycle> {
        self.cycles.iter().filter(|cycle| cycle.verdict == Verdict::Kept)
    }

    /// Number of kept cycles.
    #[must_use]
    pub fn retained(&self) -> usize {
        self.kept().count()
    }
}

/// Finds the cycles that begin with a strike of the `leading` foot.
pub fn segment(
    episodes: &[GaitEpisode<'_>],
    leading: Side,
    options: &GaitOptions,
) -> Result<Segmentation, EmgError> {
    options.check()?;
    let mut found = Segmentation {
        cycles: Vec::new(),
        strikes: Vec::with_capacity(episodes.len()),
        skipped: Vec::new(),
        unfiltered: false,
    };
    let Some(first) = episodes.first() else { return Ok(found) };
    let filter = LowPass::design(&options.low_pass, first.sample_rate)?;
    found.unfiltered = filter.is_identity();
    for (index, episode) in episodes.iter().enumerate() {
        check(index, episode, first.sample_rate)?;
        if episode.contacts.len() < options.fewest_samples {
            found.skipped.push(index);
            found.strikes.push(EpisodeStrikes::default());
            continue;
        }
        let strikes = EpisodeStrikes {
            leading: heel_strikes(episode, leading, &filter, options),
            opposite: heel_strikes(episode, opposite(leading), &filter, options),
        };
        let velocity = forward(&episode.root_velocity, &filter);
        found.cycles.extend(detect(index, &strikes, &velocity));
        found.strikes.push(strikes);
    }
    match options.percentile_scope {
        PercentileScope::Pooled => judge(&mut found.cycles, options),
        PercentileScope::Episode => found
            .cycles
            .chunk_by_mut(|a, b| a.episode == b.episode)
            .for_each(|cycles| judge(cycles, options)),
    }
    Ok(found)
}

/// Forward speed of a root that moves with (`vx`, `vy`) in the world while heading at angle `yaw`, rad.
#[must_use]
pub fn forward_velocity(vx: f64, vy: f64, yaw: f64) -> f64 {
    vx * yaw.cos() + vy * yaw.sin()
}

fn opposite(side: Side) -> Side {
    match side {
        Side::Left => Side::Right,
        Side::Right => Side::Left,
    }
}

fn check(index: usize, episode: &GaitEpisode<'_>, rate: Hertz) -> Result<(), EmgError> {
    let (contacts, velocities) = (&episode.contacts, &episode.root_velocity);
    if contacts.columns() != CONTACTS {
        let (expected, found) = (CONTACTS, contacts.columns());
        return Err(EmgError::ContactCount { episode: index, expected, found });
    }
    if velocities.len() != contacts.len() {
        return Err(EmgError::RowCount {
            episode: index,
            what: "root velocity",
            expected: contacts.len(),
            found: velocities.len(),
        });
    }
    if episode.sample_rate.to_bits() != rate.to_bits() {
        let (expected, found) = (rate, episode.sample_rate);
        return Err(EmgError::MixedRates { episode: index, expected, found });
    }
    Ok(())
}

fn heel_strikes(
    episode: &GaitEpisode<'_>,
    side: Side,
    filter: &LowPass,
    options: &GaitOptions,
) -> Vec<usize> {
    let foot = match side {
        Side::Right => 0,
        Side::Left => 2,
    };
    let contact: Vec<f64> = match options.sensors {
        ContactSensors::Heel => episode.contacts.column(foot).map(|x| x.max(0.0)).collect(),
        ContactSensors::FootAndToes => {
            let toes = episode.contacts.column(foot + 1);
            let sum = |(foot, toes): (f64, f64)| (foot + toes).max(0.0);
            episode.contacts.column(foot).zip(toes).map(sum).collect()
        }
    };
    let on_ground = |contact: &f64| *contact > options.contact_threshold;
    let contact = filter.zero_phase(&contact);
    (1..contact.len()).filter(|&i| !on_ground(&contact[i - 1]) && on_ground(&contact[i])).collect()
}

fn forward(root_velocity: &Rows<'_>, filter: &LowPass) -> Vec<f64> {
    filter.zero_phase(&root_velocity.column(0).collect::<Vec<f64>>())
}

/// Consecutive leading strikes with an opposite one strictly between, not judged yet.
fn detect(episode: usize, strikes: &EpisodeStrikes, velocity: &[f64]) -> Vec<Cycle> {
    let is_between = |start, end| strikes.opposite.iter().any(|&at| start < at && at < end);
    let pairs = strikes.leading.windows(2).map(|pair| (pair[0], pair[1]));
    pairs
        .filter(|&(start, end)| is_between(start, end))
        .filter_map(|(start, end)| {
            let mean_speed = mean(&velocity[start..end])?;
            Some(Cycle { episode, start, end, mean_speed, verdict: Verdict::Kept })
        })
        .collect()
}

/// Sets the verdicts of cycles whose durations belong together.
fn judge(cycles: &mut [Cycle], options: &GaitOptions) {
    let durations: Vec<f64> = cycles.iter().map(|cycle| cycle.duration() as f64).collect();
    let [low, high] = options.duration_percentiles;
    let Some((shortest, longest)) = percentile(&durations, low).zip(percentile(&durations, high))
    else {
        return;
    };
    for (cycle, duration) in cycles.iter_mut().zip(durations) {
        cycle.verdict = if duration < shortest {
            Verdict::TooShort
        } else if duration > longest {
            Verdict::TooLong
        } else if cycle.mean_speed >= options.least_speed {
            Verdict::Kept
        } else {
            Verdict::TooSlow
        };
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Contacts of `cycles` with the left foot down in their first half and the right in their second.
    fn steps(durations: &[usize]) -> Vec<f64> {
        let mut contacts = vec![0.0; 4 * 10];
        for &duration in durations {
            for i in 0..duration {
                let left = if i < duration / 2 { 600.0 } else { 0.0 };
                contacts.extend([600.0 - left, 0.0, left, 0.0]);
            }
        }
        contacts
    }

    fn segment_of(contacts: &[f64], speed: f64, options: &GaitOptions) -> Segmentation {
        let contacts = Rows::new(contacts, 4).unwrap();
        let velocity = vec![speed; contacts.len()];
        let root_velocity = Rows::new(&velocity, 1).unwrap();
        let episode = GaitEpisode { contacts, root_velocity, sample_rate: 30.0 };
        segment(&[episode], Side::Left, options).unwrap()
    }

    fn verdicts(durations: &[usize], speed: f64) -> Vec<Verdict> {
        let found = segment_of(&steps(durations), speed, &GaitOptions::default());
        found.cycles.iter().map(|cycle| cycle.verdict).collect()
    }

    #[test]
    fn two_cycles_of_different_duration_lose_both_and_one_alone_stays() {
        use Verdict::{Kept, TooLong, TooShort};
        // The last step begins no cycle that ends.
        assert_eq!(verdicts(&[30, 30], 1.0), [Kept]);
        assert_eq!(verdicts(&[30, 40, 40], 1.0), [TooShort, TooLong]);
        assert_eq!(verdicts(&[34, 34, 34, 34], 1.0), [Kept; 3]);
    }

    #[test]
    fn who_stands_or_walks_too_slowly_has_no_kept_cycle() {
        assert_eq!(verdicts(&[30, 30, 30], 0.19), [Verdict::TooSlow; 2]);
        assert!(verdicts(&[], 1.0).is_empty());
    }

    #[test]
    fn an_episode_of_three_steps_is_skipped_and_listed() {
        let found = segment_of(&[600.0; 12], 1.0, &GaitOptions::default());
        assert_eq!((found.skipped.as_slice(), found.detected()), ([0].as_slice(), 0));
    }

    #[test]
    fn nobody_walking_is_no_cycle_and_no_panic() {
        let found = segment(&[], Side::Left, &GaitOptions::default()).unwrap();
        assert_eq!((found.detected(), found.retained()), (0, 0));
    }

    #[test]
    fn tables_that_do_not_fit_together_are_typed_errors() {
        let zeros = vec![0.0; 120];
        let table = |columns| Rows::new(&zeros, columns).unwrap();
        let episode = |contacts, root_velocity, sample_rate| GaitEpisode {
            contacts,
            root_velocity,
            sample_rate,
        };
        let good = episode(table(4), table(4), 30.0);
        let of = |second| segment(&[good, second], Side::Left, &GaitOptions::default());
        assert_eq!(
            of(episode(table(4), table(4), 150.0)),
            Err(EmgError::MixedRates { episode: 1, expected: 30.0, found: 150.0 })
        );
        assert_eq!(
            of(episode(table(3), table(3), 30.0)),
            Err(EmgError::ContactCount { episode: 1, expected: 4, found: 3 })
        );
        assert!(matches!(
            of(episode(table(4), table(2), 30.0)),
            Err(EmgError::RowCount { episode: 1, expected: 30, found: 60, .. })
        ));
        let options = GaitOptions { duration_percentiles: [90.0, 10.0], ..Default::default() };
        assert!(matches!(
            segment(&[good], Side::Left, &options),
            Err(EmgError::Option { name: "upper duration percentile", .. })
        ));
    }

    proptest! {
        #[test]
        fn cycles_are_ordered_disjoint_and_hold_an_opposite_strike(
            contacts in prop::collection::vec(prop::array::uniform4(-900.0..900.0_f64), 0..200),
            pooled in any::<bool>(),
            toes in any::<bool>(),
        ) {
            let contacts: Vec<f64> = contacts.into_iter().flatten().collect();
            let scope = if pooled { PercentileScope::Pooled } else { PercentileScope::Episode };
            let sensors = if toes { ContactSensors::FootAndToes } else { ContactSensors::Heel };
            let options = GaitOptions {
                percentile_scope: scope, sensors, contact_threshold: 100.0, ..Default::default()
            };
            let found = segment_of(&contacts, 1.0, &options);
            prop_assert!(found.cycles.is_sorted_by(|a, b| a.end <= b.start));
            for cycle in &found.cycles {
                let inside = |at: &usize| cycle.start < *at && *at < cycle.end;
                prop_assert!(found.strikes[0].opposite.iter().any(inside));
                prop_assert!((cycle.mean_speed - 1.0).abs() < 1e-9);
            }
            let durations = |kept: bool| {
                let of_kind = move |c: &&Cycle| (c.verdict == Verdict::Kept) == kept;
                found.cycles.iter().filter(of_kind).map(Cycle::duration)
            };
            prop_assert!(durations(false).all(|lost| durations(true).all(|kept| kept != lost)));
        }
    }
}

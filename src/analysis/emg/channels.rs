//! Human channels that recorded nothing worth comparing: dead or flat ones.
//!
//! *Dead*: the envelope never reaches 0.001 of the unit it was normalised to. *Flat*: it varies over the cycle by less
//! than a quarter of its maximum. Neither is left out by itself: the channel is named, and means are given with and
//! without its muscle.
//!
//! Both limits are ours. In the nine people at 4.5 km/h they name Vastus Lateral of subject 11 (maximum 0.00015) and of
//! subject 04 (0.176 to 0.231); the next flattest channel varies by more than half of its maximum. Slow walking has
//! more of both. Oracle: `tests/signals_parity.rs`, `emg_real`.

use super::{HUMAN_CHANNELS, HumanProfiles};

/// Envelopes that stay below this are dead.
const DEAD_BELOW: f64 = 1e-3;
/// Envelopes that vary by less than this share of their maximum are flat.
const FLAT_BELOW: f64 = 0.25;

/// What is wrong with a channel.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    Dead,
    Flat,
}

/// A channel that says little.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ChannelFault {
    pub subject: u32,
    /// Place in [`HUMAN_CHANNELS`].
    pub channel: usize,
    pub fault: Fault,
    /// Smallest and largest value of the envelope.
    pub range: [f64; 2],
}

/// All dead and flat channels, by person and channel.
#[must_use]
pub fn channel_faults(people: &HumanProfiles) -> Vec<ChannelFault> {
    let mut faults = Vec::new();
    for (place, &subject) in people.subjects().iter().enumerate() {
        for channel in 0..HUMAN_CHANNELS.len() {
            let profile = people.profile(place, channel);
            let low = profile.iter().copied().fold(f64::INFINITY, f64::min);
            let high = profile.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            let fault = if high < DEAD_BELOW {
                Fault::Dead
            } else if high - low < FLAT_BELOW * high {
                Fault::Flat
            } else {
                continue;
            };
            faults.push(ChannelFault { subject, channel, fault, range: [low, high] });
        }
    }
    faults
}

/// Places in [`HUMAN_CHANNELS`] of the muscles that have a fault in anybody, rising: what to leave out of a mean
/// "without".
#[must_use]
pub fn faulty_muscles(faults: &[ChannelFault]) -> Vec<usize> {
    let is_faulty = |channel: &usize| faults.iter().any(|fault| fault.channel == *channel);
    (0..HUMAN_CHANNELS.len()).filter(is_faulty).collect()
}

#[cfg(test)]
mod tests {
    use super::super::human::tests::people;
    use super::*;

    #[test]
    fn dead_and_flat_channels_are_named_and_others_are_not() {
        let people = people(2, 4, |subject, channel, point| match (subject, channel) {
            (0, 3) => 1e-4 * point as f64,
            (1, 6) => 0.2 + 0.01 * point as f64,
            _ => 0.1 * point as f64,
        });
        let faults = channel_faults(&people);
        let found: Vec<_> = faults.iter().map(|f| (f.subject, f.channel, f.fault)).collect();
        assert_eq!(found, [(0, 3, Fault::Dead), (1, 6, Fault::Flat)]);
        assert_eq!(faulty_muscles(&faults), [3, 6]);
    }
}

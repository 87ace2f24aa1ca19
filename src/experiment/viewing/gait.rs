//! How far each leg is in its cycle, from one heel strike (0) to the next (1), of a walk that is known or still going on.
//!
//! Strikes are those of the EMG analysis. It smooths the contacts without delay, so a strike may still move while the steps
//! right after it are not known: it counts once [`SETTLED`] has gone by.

use crate::analysis::emg::{ContactSensors, GaitEpisode, GaitOptions, Side, segment};
use crate::analysis::signal::Rows;
use crate::record::names;
use crate::sim::environment::Environment;
use crate::units::Seconds;

/// Time after which a strike does not move any more: several times the memory of a filter of 5 Hz.
const SETTLED: Seconds = 0.5;

/// What feet and root felt at every step, from the start on.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Walked {
    /// Touch forces, N, a row of [`names::FEET`] per step.
    pub contacts: Vec<f64>,
    /// Velocity of the root, m/s, a row of [`names::HEADING_AXES`] per step.
    pub velocity: Vec<f64>,
}

/// The phase of each leg at every step; undefined (NaN) before its first strike and after its last.
#[derive(Debug, Clone, PartialEq)]
pub struct Phases {
    pub right: Vec<f64>,
    pub left: Vec<f64>,
    /// Steps whose phases will not change any more, whatever follows.
    pub settled: usize,
}

impl Walked {
    /// Takes in what `environment` feels now; nothing where nobody walks.
    pub fn feel(&mut self, environment: &Environment) {
        let blocks = ["feet_contact_force", "root_vel"].map(|key| environment.block(key));
        if let [Some(contacts), Some(velocity)] = blocks {
            self.contacts.extend_from_slice(contacts);
            self.velocity.extend_from_slice(velocity);
        }
    }

    /// Takes in what was felt `later`.
    pub fn append(&mut self, later: &Self) {
        self.contacts.extend_from_slice(&later.contacts);
        self.velocity.extend_from_slice(&later.velocity);
    }

    /// Number of steps.
    #[must_use]
    pub fn len(&self) -> usize {
        self.contacts.len() / names::FEET.len()
    }

    /// Whether nothing was felt.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.contacts.is_empty()
    }

    /// The phases, with a step every `interval`; `None` where the walk is too short to tell.
    #[must_use]
    pub fn phases(&self, interval: Seconds) -> Option<Phases> {
        let gait = GaitEpisode {
            contacts: Rows::new(&self.contacts, names::FEET.len()).ok()?,
            root_velocity: Rows::new(&self.velocity, names::HEADING_AXES.len()).ok()?,
            sample_rate: 1.0 / interval,
        };
        let options = GaitOptions { sensors: ContactSensors::Heel, ..GaitOptions::default() };
        let found = segment(&[gait], Side::Right, &options).ok()?;
        let strikes = found.strikes.first()?;
        let steps = self.len();
        let still_moving = steps.saturating_sub((SETTLED / interval).ceil() as usize);
        let last = |strikes: &[usize]| {
            strikes.iter().copied().rfind(|&strike| strike < still_moving).unwrap_or(0)
        };
        Some(Phases {
            settled: last(&strikes.leading).min(last(&strikes.opposite)),
            right: phase(&strikes.leading, steps),
            left: phase(&strikes.opposite, steps),
        })
    }
}

fn phase(strikes: &[usize], steps: usize) -> Vec<f64> {
    let mut phase = vec![f64::NAN; steps];
    for pair in strikes.windows(2) {
        let (start, end) = (pair[0], pair[1].min(steps));
        for (at, value) in phase[start.min(end)..end].iter_mut().enumerate() {
            *value = at as f64 / (pair[1] - pair[0]) as f64;
        }
    }
    phase
}

#[cfg(test)]
mod tests {
    use super::*;

    const INTERVAL: Seconds = 1.0 / 30.0;

    /// Two feet that strike in turn, once a second each.
    fn walk(steps: usize) -> Walked {
        let touch = |step: usize| if step % 30 < 15 { 800.0 } else { 0.0 };
        let contacts = (0..steps).flat_map(|step| [touch(step + 20), 0.0, touch(step + 5), 0.0]);
        Walked { contacts: contacts.collect(), velocity: [1.2, 0.0, 0.0].repeat(steps) }
    }

    #[test]
    fn the_phase_runs_from_strike_to_strike_and_is_undefined_outside() {
        let phase = phase(&[2, 6, 8], 10);
        assert!(phase[..2].iter().chain(&phase[8..]).all(|value| value.is_nan()));
        assert_eq!(phase[2..8], [0.0, 0.25, 0.5, 0.75, 0.0, 0.5]);
    }

    #[test]
    fn what_is_settled_stays_as_it_is_while_the_walk_goes_on() {
        let bits = |phase: &[f64]| phase.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        let whole = walk(150).phases(INTERVAL).unwrap();
        assert!(whole.right.iter().any(|phase| *phase > 0.9), "{whole:?}");
        let mut longest = 0;
        for steps in 20..150 {
            let Some(so_far) = walk(steps).phases(INTERVAL) else { continue };
            let settled = so_far.settled;
            assert!(longest <= settled && settled <= steps);
            longest = settled;
            assert_eq!(bits(&so_far.right[..settled]), bits(&whole.right[..settled]), "{steps}");
            assert_eq!(bits(&so_far.left[..settled]), bits(&whole.left[..settled]), "{steps}");
        }
        assert!(longest > 90, "{longest}");
    }
}

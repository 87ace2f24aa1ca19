//! The recorded channels of an episode as lines in a viewer, in the order in which a person asks for them.

use crate::analysis::emg::{ContactSensors, GaitEpisode, GaitOptions, Side, segment};
use crate::analysis::signal::Rows;
use crate::record::scene::Signal;
use crate::record::{Episode, Recording, Timing, names};

/// What is shown of a recording, with what a person reads above it.
const SHOWN: [(&str, &str); 9] = [
    (names::ACTIVATION, "Muscle activation"),
    (names::ACTION_MEAN, "Action before projection and noise (the policy's mean)"),
    (names::ACTION, "Action sent to the body"),
    (names::JOINT, "Joint angles"),
    (names::FOOT_CONTACT, "Touch forces"),
    (names::ROOT_VELOCITY, "Velocity of the root"),
    (names::REWARD_COMPONENT, "Reward components"),
    (names::REWARD, "Reward"),
    (names::SOLVED, "Solved"),
];

/// The signals of `episode`.
#[must_use]
pub fn signals(recording: &Recording, episode: &Episode) -> Vec<Signal> {
    let mut signals: Vec<Signal> = SHOWN
        .iter()
        .filter_map(|&(name, title)| {
            let channel = recording.channel(name).filter(|channel| channel.width() > 0)?;
            let units = channel.units().join(", ");
            let title =
                if units.is_empty() { title.to_owned() } else { format!("{title} ({units})") };
            Some(Signal {
                name: name.to_owned(),
                title,
                elements: channel.elements.iter().map(|element| element.name.clone()).collect(),
                after_step: channel.timing == Some(Timing::AfterStep),
                values: recording.samples(episode, name)?.values().collect(),
            })
        })
        .collect();
    let after_touch = signals.iter().position(|signal| signal.name == names::FOOT_CONTACT);
    if let (Some(place), Some(phase)) = (after_touch, gait_phase(recording, episode)) {
        signals.insert(place + 1, phase);
    }
    signals
}

/// How far each leg is in its cycle, from one heel strike (0) to the next (1); undefined before the first and after the
/// last. Strikes are those of the EMG analysis.
fn gait_phase(recording: &Recording, episode: &Episode) -> Option<Signal> {
    let values = |name| recording.samples(episode, name).map(|s| s.values().collect::<Vec<f64>>());
    let (contacts, velocity) = (values(names::FOOT_CONTACT)?, values(names::ROOT_VELOCITY)?);
    let rate = 1.0 / recording.about.control_interval?;
    let steps = episode.facts.length;
    let gait = GaitEpisode {
        contacts: Rows::new(&contacts, names::FEET.len()).ok()?,
        root_velocity: Rows::new(&velocity, names::HEADING_AXES.len()).ok()?,
        sample_rate: rate,
    };
    let options = GaitOptions { sensors: ContactSensors::Heel, ..GaitOptions::default() };
    let found = segment(&[gait], Side::Right, &options).ok()?;
    let strikes = found.strikes.first()?;
    let (right, left) = (phase(&strikes.leading, steps), phase(&strikes.opposite, steps));
    Some(Signal {
        name: "gait_phase".to_owned(),
        title: "Gait phase (0 to 1 from heel strike to heel strike)".to_owned(),
        elements: vec!["right".to_owned(), "left".to_owned()],
        after_step: false,
        values: right.into_iter().zip(left).flat_map(|(right, left)| [right, left]).collect(),
    })
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

    #[test]
    fn the_phase_runs_from_strike_to_strike_and_is_undefined_outside() {
        let phase = phase(&[2, 6, 8], 10);
        assert!(phase[..2].iter().chain(&phase[8..]).all(|value| value.is_nan()));
        assert_eq!(phase[2..8], [0.0, 0.25, 0.5, 0.75, 0.0, 0.5]);
    }
}

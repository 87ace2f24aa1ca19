//! The recorded channels of an episode as lines in a viewer, in the order in which a person asks for them.

use crate::record::scene::{Scale, Signal};
use crate::record::{Episode, Recording, Timing, names};

use super::gait::Walked;

/// What is shown of a recording, with what a person reads above it.
const SHOWN: [(&str, &str, Scale); 9] = [
    (names::ACTIVATION, "Muscle activation", Scale::Share),
    (names::ACTION_MEAN, "Action before projection (the policy's mean)", Scale::Free),
    (names::ACTION, "Action sent to the body", Scale::Free),
    (names::JOINT, "Joint angles", Scale::Free),
    (names::FOOT_CONTACT, "Touch forces", Scale::Free),
    (names::ROOT_VELOCITY, "Velocity of the root", Scale::Free),
    (names::REWARD_COMPONENT, "Reward components", Scale::Free),
    (names::REWARD, "Reward", Scale::Free),
    (names::SOLVED, "Solved", Scale::Flag),
];

/// The signals of `episode`.
#[must_use]
pub fn signals(recording: &Recording, episode: &Episode) -> Vec<Signal> {
    let mut signals: Vec<Signal> = SHOWN
        .iter()
        .filter_map(|&(name, title, scale)| {
            let channel = recording.channel(name).filter(|channel| channel.width() > 0)?;
            Some(Signal {
                name: name.to_owned(),
                title: with_units(title, &channel.units()),
                elements: channel.elements.iter().map(|element| element.name.clone()).collect(),
                after_step: channel.timing == Some(Timing::AfterStep),
                scale,
                values: recording.samples(episode, name)?.values().collect(),
            })
        })
        .collect();
    let after_touch = signals.iter().position(|signal| signal.name == names::FOOT_CONTACT);
    if let (Some(place), Some(values)) = (after_touch, phases(recording, episode)) {
        signals.insert(place + 1, Signal { values, ..gait_phase() });
    }
    signals
}

/// A title with the units of what it is about.
pub(super) fn with_units(title: &str, units: &[&str]) -> String {
    if units.is_empty() { title.to_owned() } else { format!("{title} ({})", units.join(", ")) }
}

/// The phase of both legs, still without values.
pub(super) fn gait_phase() -> Signal {
    Signal {
        name: "gait_phase".to_owned(),
        title: "Gait phase (0 to 1 from heel strike to heel strike)".to_owned(),
        elements: vec!["right".to_owned(), "left".to_owned()],
        scale: Scale::Share,
        ..Signal::default()
    }
}

fn phases(recording: &Recording, episode: &Episode) -> Option<Vec<f64>> {
    let values = |name| recording.samples(episode, name).map(|s| s.values().collect::<Vec<f64>>());
    let walked =
        Walked { contacts: values(names::FOOT_CONTACT)?, velocity: values(names::ROOT_VELOCITY)? };
    let phases = walked.phases(recording.about.control_interval?)?;
    Some(phases.right.into_iter().zip(phases.left).flat_map(|(r, l)| [r, l]).collect())
}

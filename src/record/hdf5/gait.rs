//! Reading the gait layout (`spec/analysis.md` §16.4): what the comparison with human muscle activity needs of walking.

use super::compact::{Names, Reading, metadata};
use super::source::Source;
use crate::record::RecordError;
use crate::record::format::Opened;
use crate::record::recording::{About, Element, Timing, names};

/// Data sets of an episode: activation, touch forces, velocity of the root in its heading frame.
pub(super) const DATA_SETS: [(&str, &str); 3] = [
    (names::ACTIVATION, "activations"),
    (names::FOOT_CONTACT, "foot_contacts"),
    (names::ROOT_VELOCITY, "root_vel"),
];
/// Root attributes that are truth values.
pub(super) const FLAGS: [&str; 1] = ["moving_goal"];
/// The task that is recorded so.
pub(super) const TASK: &str = "kinesis";

pub(super) fn read(source: &Source) -> Result<Opened, RecordError> {
    let attributes = source.attributes("")?;
    let rate = attributes.number("fs").filter(|rate| rate.is_finite() && *rate > 0.0);
    let timing = attributes.text("timing").as_deref().and_then(Timing::of_word);
    let about = About {
        task: TASK.to_owned(),
        policy: source.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        control_interval: rate.map(|rate| 1.0 / rate),
        seed: attributes.integer("seed"),
        deterministic: attributes.flag("deterministic"),
        metadata: metadata(&attributes, &["seed", "deterministic", "fs", "timing"], &FLAGS),
        ..About::default()
    };
    let axes = Names::of(source)?;
    let mut reading = Reading::default();
    for (number, group) in source.episodes()? {
        let length = source.attributes(&group)?.length();
        let length =
            length.ok_or_else(|| source.damaged(format!("`{group}` has no `episode_length`")))?;
        reading.add(source, &group, number, length, &DATA_SETS)?;
    }
    let mut opened = reading.finish(source, about, &axes)?;
    for channel in &mut opened.recording.channels {
        channel.timing = channel.timing.or(timing);
        let (elements, unit): (&[&str], _) = match channel.name.as_str() {
            names::FOOT_CONTACT => (&names::FEET, "N"),
            names::ROOT_VELOCITY => (&names::HEADING_AXES, "m/s"),
            _ => continue,
        };
        if channel.elements.len() != elements.len() {
            let (name, found, expected) = (&channel.name, channel.width(), elements.len());
            return Err(
                source.damaged(format!("`{name}` has {found} columns, expected {expected}"))
            );
        }
        let element = |name: &&str| Element { name: (*name).to_owned(), unit: unit.to_owned() };
        channel.elements = elements.iter().map(element).collect();
    }
    Ok(opened)
}

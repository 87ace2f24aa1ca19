//! Writing the compact and the gait layout (`spec/analysis.md` §16.1, §16.4).
//!
//! Data sets are one chunk per episode, compressed as upstream compresses them: byte shuffle and gzip. The library lays the
//! whole file out before it writes the first byte, so the recording is handed over and each episode is let go once its
//! numbers are in the library's hands.

use std::io;
use std::path::Path;

use hdf5_pure::{AttrValue, FileBuilder, GroupBuilder};

use super::compact::{FLAGS, SCHEMA};
use super::{HEADER, gait};
use crate::record::header::Header;
use crate::record::recording::{Channel, Episode, Recording, Samples, Timing, names};
use crate::record::{Place, RecordError};

/// Strength of gzip: what upstream's files have.
const GZIP: u32 = 4;
/// Without a horizon, the longest episode is taken.
const NO_STEPS: usize = 0;

/// Writes `recording` in the compact layout. Channels that upstream does not have become data sets of the same kind.
pub(in super::super) fn write_compact(
    path: &Path,
    recording: Recording,
    place: Place,
) -> Result<(), RecordError> {
    recording.check()?;
    let mut file = FileBuilder::new();
    let about = &recording.about;
    let longest = recording.episodes.iter().map(|e| e.facts.length).max().unwrap_or(NO_STEPS);
    file.set_attr("schema_version", AttrValue::I64(SCHEMA));
    file.set_attr("task", text(&about.task));
    file.set_attr("policy_id", text(&about.policy));
    file.set_attr("horizon", AttrValue::I64(about.horizon.unwrap_or(longest) as i64));
    if let Some(interval) = about.control_interval {
        file.set_attr("dt", AttrValue::F64(interval));
    }
    if let Some(seed) = about.seed {
        file.set_attr("seed", AttrValue::I64(seed));
    }
    if let Some(deterministic) = about.deterministic {
        file.set_attr("deterministic", AttrValue::I64(i64::from(deterministic)));
    }
    for name in FLAGS {
        if let Some(flag) = about.metadata.get(name).and_then(|flag| flag.parse::<bool>().ok()) {
            file.set_attr(name, AttrValue::I64(i64::from(flag)));
        }
    }
    let elements = |channel: &Channel| -> Vec<String> {
        channel.elements.iter().map(|element| element.name.clone()).collect()
    };
    for (name, channels) in [
        ("joint_names", [names::JOINT, names::JOINT_VELOCITY]),
        ("muscle_names", [names::ACTION, names::ACTION_MEAN]),
        ("activation_names", [names::ACTIVATION, names::ACTIVATION]),
    ] {
        let channel = channels.iter().find_map(|channel| recording.channel(channel));
        if let Some(channel) = channel {
            texts(&mut file, name, &elements(channel));
        }
    }
    texts(&mut file, HEADER, &[Header::of(&recording).to_json()]);
    let channels = recording.channels.clone();
    let (rewards, solved) = (recording.place(names::REWARD), recording.place(names::SOLVED));
    for episode in recording.episodes {
        let mut group = group_of(&mut file, &episode);
        let total = |place: Option<usize>| place.map(|place| episode.samples[place].values().sum());
        if let Some(total) = total(rewards) {
            group.set_attr("total_reward", AttrValue::F64(total));
        }
        if let Some(total) = total(solved) {
            group.set_attr("solved_steps", AttrValue::F64(total));
        }
        for (channel, samples) in channels.iter().zip(episode.samples) {
            add(
                &mut group,
                names::to_upstream(&channel.name),
                channel,
                &samples,
                episode.facts.length,
            );
        }
        file.add_group(group.finish());
    }
    finish(path, file, place)
}

/// Writes `recording` in the gait layout, and says what has no place in it.
pub(in super::super) fn write_gait(
    path: &Path,
    mut recording: Recording,
    place: Place,
) -> Result<Vec<String>, RecordError> {
    recording.check()?;
    let needed = |what: String| RecordError::CannotHold { format: "gait", what };
    for (name, _) in gait::DATA_SETS {
        let Some(channel) = recording.channel(name) else {
            return Err(needed(format!("a recording without `{name}`")));
        };
        if channel.timing != Some(Timing::BeforeStep) {
            return Err(needed(format!("`{name}`, which was not taken before the step")));
        }
        if channel.precision != super::super::Precision::Double {
            return Err(needed(format!("`{name}` in single precision")));
        }
    }
    let dropped =
        recording.retain_channels(|c| gait::DATA_SETS.iter().any(|(name, _)| *name == c.name));
    let mut file = FileBuilder::new();
    let about = &recording.about;
    file.set_attr("timing", text(Timing::BeforeStep.word()));
    if let Some(interval) = about.control_interval {
        file.set_attr("fs", AttrValue::F64(1.0 / interval));
    }
    if let Some(seed) = about.seed {
        file.set_attr("seed", AttrValue::I64(seed));
    }
    if let Some(deterministic) = about.deterministic {
        file.set_attr("deterministic", AttrValue::I64(i64::from(deterministic)));
    }
    if let Some(distance) = about.metadata.get("goal_distance").and_then(|d| d.parse().ok()) {
        file.set_attr("goal_distance", AttrValue::F64(distance));
    }
    if let Some(moving) = about.metadata.get("moving_goal").and_then(|m| m.parse::<bool>().ok()) {
        file.set_attr("moving_goal", AttrValue::I64(i64::from(moving)));
    }
    if let Some(activation) = recording.channel(names::ACTIVATION) {
        let muscles: Vec<String> = activation.elements.iter().map(|e| e.name.clone()).collect();
        texts(&mut file, "muscle_names", &muscles);
    }
    let channels = recording.channels.clone();
    for episode in recording.episodes {
        let mut group = group_of(&mut file, &episode);
        for (channel, samples) in channels.iter().zip(episode.samples) {
            let theirs = gait::DATA_SETS.iter().find(|(ours, _)| *ours == channel.name);
            let name = theirs.map_or(channel.name.as_str(), |(_, theirs)| theirs);
            add(&mut group, name, channel, &samples, episode.facts.length);
        }
        file.add_group(group.finish());
    }
    finish(path, file, place)?;
    Ok(dropped)
}

fn text(value: &str) -> AttrValue {
    AttrValue::VarLenString(value.to_owned())
}

fn texts(file: &mut FileBuilder, name: &str, values: &[String]) {
    let values: Vec<&str> = values.iter().map(String::as_str).collect();
    file.create_dataset(name).with_vlen_strings(&values);
}

fn group_of(file: &mut FileBuilder, episode: &Episode) -> GroupBuilder {
    let mut group = file.create_group(&format!("episode_{}", episode.facts.number));
    group.set_attr("episode_length", AttrValue::I64(episode.facts.length as i64));
    group
}

fn add(group: &mut GroupBuilder, name: &str, channel: &Channel, samples: &Samples, length: usize) {
    let set = group.create_dataset(name);
    match samples {
        Samples::Single(values) => set.with_f32_data(values),
        Samples::Double(values) => set.with_f64_data(values),
        Samples::Flag(values) => {
            let numbers: Vec<f64> = values.iter().map(|&flag| f64::from(u8::from(flag))).collect();
            set.with_f64_data(&numbers)
        }
    };
    let shape = match (length as u64, channel.width() as u64) {
        (rows, _) if channel.is_scalar() => vec![rows],
        (rows, width) => vec![rows, width],
    };
    set.with_shape(&shape);
    if !samples.is_empty() {
        set.with_chunks(&shape).with_shuffle().with_deflate(GZIP);
    }
    if let Some(timing) = channel.timing {
        set.set_attr("timing", text(timing.word()));
    }
    if let [unit] = channel.units()[..] {
        let unit = if unit == "rad" { "radian" } else { unit };
        set.set_attr("units", text(unit));
    }
}

fn finish(path: &Path, file: FileBuilder, place: Place) -> Result<(), RecordError> {
    place.write(path, |out| {
        let buffer = io::BufWriter::with_capacity(1 << 20, out);
        file.finish_to(buffer).map_err(io::Error::other)
    })
}

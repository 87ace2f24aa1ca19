//! Reading the compact layout (`spec/analysis.md` §16.1): root attributes about the recording, names of joints and muscles,
//! and a group `episode_<attempt>` per episode.
//!
//! Only the attribute `episode_length` and one known data set are needed. Attempts may have gaps and are sorted as numbers.
//! Exports of the first release have no attribute `seed`; their `dt` is a default that means nothing and is not believed.

use std::collections::BTreeMap;

use super::HEADER;
use super::axes::Axes;
use super::source::{Attributes, Source};
use crate::record::RecordError;
use crate::record::format::Opened;
use crate::record::header::Header;
use crate::record::recording::{
    About, Channel, Element, Episode, EpisodeFacts, Precision, Recording, Samples, Timing, names,
};

/// Root attributes that have a place of their own in [`About`].
const KNOWN: [&str; 7] =
    ["schema_version", "policy_id", "task", "horizon", "dt", "seed", "deterministic"];
/// Root attributes that are truth values.
pub(super) const FLAGS: [&str; 4] =
    ["normalize_obs", "actions_clipped", "means_clipped", "success_only"];
/// The version of the layout.
pub(super) const SCHEMA: i64 = 1;

pub(super) fn read(source: &Source) -> Result<Opened, RecordError> {
    if let Some(texts) = source.texts(HEADER)? {
        let text = texts.first().map_or("", String::as_str);
        return read_own(source, Header::parse(text, "HDF5", &source.path)?);
    }
    let about = about(source)?;
    let axes = Names::of(source)?;
    let mut reading = Reading::default();
    for (number, group) in source.episodes()? {
        let length = source.attributes(&group)?.length();
        let length =
            length.ok_or_else(|| source.damaged(format!("`{group}` has no `episode_length`")))?;
        reading.add(source, &group, number, length, &names::UPSTREAM)?;
    }
    reading.finish(source, about, &axes)
}

/// A file of our own: the header says what there must be.
fn read_own(source: &Source, header: Header) -> Result<Opened, RecordError> {
    let groups: BTreeMap<u64, String> = source.episodes()?.into_iter().collect();
    if groups.len() != header.episodes.len() {
        let (found, expected) = (groups.len(), header.episodes.len());
        return Err(source.damaged(format!("it has {found} episodes, its header says {expected}")));
    }
    let mut episodes = Vec::with_capacity(groups.len());
    for facts in header.episodes {
        let missing = || source.damaged(format!("there is no episode {}", facts.number));
        let group = groups.get(&facts.number).ok_or_else(missing)?;
        let samples = header.channels.iter().map(|channel| {
            let set = names::to_upstream(&channel.name);
            let (samples, _) = source.rows(group, set, facts.length)?;
            match (channel.precision, samples) {
                (Precision::Single, samples @ Samples::Single(_))
                | (Precision::Double, samples @ Samples::Double(_)) => Ok(samples),
                (Precision::Flag, Samples::Double(values)) => {
                    Ok(Samples::Flag(values.into_iter().map(|value| value > 0.5).collect()))
                }
                _ => Err(source.damaged(format!("`{group}/{set}` has another type of number"))),
            }
        });
        let samples = samples.collect::<Result<_, _>>()?;
        episodes.push(Episode { facts, samples });
    }
    let recording = Recording { about: header.about, channels: header.channels, episodes };
    recording.check().map_err(|error| source.damaged(error.to_string()))?;
    Ok(Opened { recording, left_out: Vec::new() })
}

fn about(source: &Source) -> Result<About, RecordError> {
    let attributes = source.attributes("")?;
    if let Some(found) = attributes.integer("schema_version").filter(|&found| found != SCHEMA) {
        return Err(source.damaged(format!("it has schema version {found}, expected {SCHEMA}")));
    }
    let is_export_of_old = attributes.integer("seed").is_none();
    let interval = attributes.number("dt").filter(|dt| dt.is_finite() && *dt > 0.0);
    let stem = || source.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let mut metadata: BTreeMap<String, String> =
        attributes.others(&KNOWN, &FLAGS).into_iter().collect();
    if is_export_of_old && let Some(interval) = interval {
        metadata.insert("dt".to_owned(), interval.to_string());
    }
    Ok(About {
        task: attributes.text("task").unwrap_or_else(stem),
        policy: attributes.text("policy_id").unwrap_or_default(),
        control_interval: interval.filter(|_| !is_export_of_old),
        horizon: attributes.integer("horizon").and_then(|steps| usize::try_from(steps).ok()),
        seed: attributes.integer("seed"),
        deterministic: attributes.flag("deterministic"),
        metadata,
        body: None,
    })
}

/// What the columns are called.
pub(super) struct Names {
    pub(super) joints: Vec<String>,
    pub(super) muscles: Vec<String>,
    /// Where activations have an order of their own.
    pub(super) activations: Option<Vec<String>>,
}

impl Names {
    /// What the file says; where it does not, the order of `MyoHand`.
    pub(super) fn of(source: &Source) -> Result<Self, RecordError> {
        Self::or(source, Axes::hand())
    }

    /// What the file says; where it does not, `otherwise`.
    pub(super) fn or(source: &Source, otherwise: Axes) -> Result<Self, RecordError> {
        Ok(Self {
            joints: source.texts("joint_names")?.unwrap_or(otherwise.joint_names),
            muscles: source.texts("muscle_names")?.unwrap_or(otherwise.muscle_names),
            activations: source.texts("activation_names")?,
        })
    }

    /// The elements of a channel of `width` columns; numbers where the names do not fit.
    fn elements(&self, channel: &str, width: usize) -> Vec<Element> {
        let (named, unit) = match channel {
            names::JOINT => (&self.joints, "rad"),
            names::ACTIVATION => (self.activations.as_ref().unwrap_or(&self.muscles), ""),
            names::REWARD | names::SOLVED if width == 1 => (&vec![String::new()], ""),
            _ => (&self.muscles, ""),
        };
        let numbered = || (0..width).map(|index| index.to_string()).collect();
        let named = if named.len() == width { named.clone() } else { numbered() };
        let element = |name| Element { name, unit: unit.to_owned() };
        named.into_iter().map(element).collect()
    }
}

/// Episodes whose channels are found out while reading.
#[derive(Default)]
pub(super) struct Reading {
    /// Our name, number of columns, timing. Those of the first episode.
    channels: Vec<(&'static str, usize, Option<Timing>)>,
    episodes: Vec<Episode>,
    left_out: Vec<String>,
}

impl Reading {
    /// Reads those of `sets` (our name, theirs) that the first episode has.
    pub(super) fn add(
        &mut self,
        source: &Source,
        group: &str,
        number: u64,
        length: usize,
        sets: &[(&'static str, &str)],
    ) -> Result<(), RecordError> {
        let found = source.data_sets(group)?;
        let is_first = self.episodes.is_empty();
        let mut samples = Vec::new();
        for &(ours, theirs) in sets {
            let wanted = is_first || self.channels.iter().any(|(name, ..)| *name == ours);
            if !wanted || is_first && !found.iter().any(|name| name == theirs) {
                continue;
            }
            let (values, width) = source.rows(group, theirs, length)?;
            if is_first {
                let timing = source.text_of(group, theirs, "timing");
                let timing = timing.as_deref().and_then(Timing::of_word);
                self.channels.push((ours, width, timing));
            }
            samples.push(values);
        }
        let unknown = found.into_iter().filter(|name| !sets.iter().any(|(_, set)| set == name));
        for name in unknown {
            self.leave_out(name);
        }
        let facts =
            EpisodeFacts { number, length, seeds: None, terminated: None, diverged_steps: None };
        self.episodes.push(Episode { facts, samples });
        Ok(())
    }

    /// Says that something in the file is not read.
    pub(super) fn leave_out(&mut self, name: String) {
        if !self.left_out.contains(&name) {
            self.left_out.push(name);
        }
    }

    /// Adds a channel to the episode that was read last.
    pub(super) fn add_samples(
        &mut self,
        source: &Source,
        name: &'static str,
        timing: Option<Timing>,
        values: Vec<f64>,
        width: usize,
    ) -> Result<(), RecordError> {
        if self.episodes.len() == 1 {
            self.channels.push((name, width, timing));
        } else if !self.channels.contains(&(name, width, timing)) {
            return Err(source.damaged(format!("`{name}` differs from the episode before")));
        }
        if let Some(episode) = self.episodes.last_mut() {
            episode.samples.push(Samples::Double(values));
        }
        Ok(())
    }

    /// Puts the channels together, all episodes of one in one type of number.
    pub(super) fn finish(
        mut self,
        source: &Source,
        about: About,
        axes: &Names,
    ) -> Result<Opened, RecordError> {
        if self.channels.is_empty() {
            return Err(source.damaged("it has no data set of an upstream recording"));
        }
        let found = std::mem::take(&mut self.channels);
        let mut channels = Vec::with_capacity(found.len());
        for (place, (name, width, timing)) in found.into_iter().enumerate() {
            let precision = self.unify(place, name == names::SOLVED);
            let elements = axes.elements(name, width);
            channels.push(Channel { name: name.to_owned(), timing, precision, elements });
        }
        let recording = Recording { about, channels, episodes: self.episodes };
        recording.check().map_err(|error| source.damaged(error.to_string()))?;
        Ok(Opened { recording, left_out: self.left_out })
    }
}

impl Reading {
    /// Makes all arrays of one channel the same type; flags of zeros and ones.
    fn unify(&mut self, place: usize, may_be_flags: bool) -> Precision {
        let mut arrays: Vec<&mut Samples> =
            self.episodes.iter_mut().filter_map(|episode| episode.samples.get_mut(place)).collect();
        let is_bit = |value: f64| value.to_bits() == 0 || value.to_bits() == 1_f64.to_bits();
        let precision = if may_be_flags && arrays.iter().all(|array| array.values().all(is_bit)) {
            Precision::Flag
        } else if arrays.iter().all(|array| array.precision() == Precision::Single) {
            Precision::Single
        } else {
            Precision::Double
        };
        for array in arrays.iter_mut().filter(|array| array.precision() != precision) {
            **array = match precision {
                Precision::Flag => Samples::Flag(array.values().map(|value| value > 0.5).collect()),
                _ => Samples::Double(array.values().collect()),
            };
        }
        precision
    }
}

/// Attributes of the file that are about the recording, for layouts that have few.
pub(super) fn metadata(
    attributes: &Attributes,
    known: &[&str],
    flags: &[&str],
) -> BTreeMap<String, String> {
    attributes.others(known, flags).into_iter().collect()
}

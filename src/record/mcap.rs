//! A recording as MCAP: one channel of JSON messages per quantity, one message per step, ready for a viewer.
//!
//! A message is `{"episode":3,"step":17,"value":{"ECRL":0.25,…}}`, or `"value":-1.5` for a single number; the channel's JSON
//! schema names every element with its unit. Undefined numbers are `null`; an infinite number has no JSON and is refused.
//! Numbers are written in the shortest form that reads back as the same bits.
//!
//! Foxglove and Lichtblick open no channel whose schema gives a value two types. So only a channel that has undefined numbers
//! says that they may be `null`; the others have numbers and nothing else.
//!
//! Log time starts at 0 and runs through the episodes one after the other, with one control interval between them; a value
//! taken after a step carries the time at the end of the step. Chunks are compressed with zstd and carry checksums, the index
//! lies at the end, and the same recording gives the same bytes (see `mcap_writer`).
//!
//! Two metadata records stand before the messages: `recording` holds the [`Header`], `metadata` the caller's own pairs. A
//! file without the first is no recording of ours. Reading never trusts a length: no record may be longer than
//! [`LONGEST_RECORD`], and samples are only kept where the header has room for them.

use std::collections::BTreeMap;
use std::io::{self, BufWriter, Read, Write};
use std::ops::RangeInclusive;
use std::path::Path;

use mcap::McapError;
use mcap::records::{ChunkHeader, Metadata, Record};
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use serde_json::json;

use super::header::Header;
use super::mcap_chunk::{self, ChunkError};
use super::mcap_message::{self, Message};
use super::mcap_writer::{Chunk, Writer};
use super::recording::{About, Channel, Recording, Samples, Timing};
use super::{Place, RecordError};
use crate::files;

/// Name of the metadata record of everything but the samples, and the one key in it.
const HEADER: &str = "recording";
/// Name of the metadata record of the caller's own pairs.
const METADATA: &str = "metadata";
/// No record may be longer than this, packed or unpacked. A header of 100,000 episodes has about 25 MB.
pub(super) const LONGEST_RECORD: usize = 1 << 26;
/// Steps of an episode for which memory is taken at once.
const LONGEST_RESERVE: usize = 1 << 12;
/// Without a control interval, steps are a second apart.
const DEFAULT_INTERVAL: f64 = 1.0;
const NANOSECONDS: f64 = 1e9;

/// Writes `recording` to `path`.
pub(super) fn write(path: &Path, recording: &Recording, place: Place) -> Result<(), RecordError> {
    recording.check()?;
    mcap_message::check_finite(recording)?;
    place.write(path, |file| {
        let mut buffer = BufWriter::with_capacity(1 << 20, file);
        fill(&mut buffer, recording)?;
        buffer.flush()
    })
}

fn fill(out: impl Write, recording: &Recording) -> io::Result<()> {
    let mut writer = Writer::new(out, concat!("arnold-analyze ", env!("CARGO_PKG_VERSION")))?;
    let mut header = Header::of(recording);
    let pairs = std::mem::take(&mut header.about.metadata);
    let document = BTreeMap::from([(HEADER.to_owned(), header.to_json())]);
    writer.metadata(HEADER, &document)?;
    writer.metadata(METADATA, &pairs)?;
    // Values taken before the step come first, so that time never runs back within a step.
    let (mut before, mut after) = (Vec::new(), Vec::new());
    for (place, channel) in recording.channels.iter().enumerate() {
        let pairs = channel.timing.map(|timing| ("timing".to_owned(), timing.word().to_owned()));
        let schema = schema(channel, has_undefined(recording, place));
        let id = writer.channel(&channel.name, &schema, &pairs.into_iter().collect())?;
        let list = if channel.timing == Some(Timing::AfterStep) { &mut after } else { &mut before };
        list.push((id, place, Message::new(channel)));
    }
    let time = clock(&recording.about);
    writer.chunks(|hand_over| {
        let (mut start, mut chunk) = (0_u64, Chunk::default());
        for episode in &recording.episodes {
            for step in 0..episode.facts.length {
                for (channels, later) in [(&before, 0), (&after, 1)] {
                    let time = time(start + step as u64 + later);
                    for (id, place, message) in channels {
                        if chunk.is_full() {
                            hand_over(std::mem::take(&mut chunk))?;
                        }
                        let write = |text: &mut _| message.write(text, episode, *place, step);
                        chunk.add(*id, step as u32, time, write);
                    }
                }
            }
            start += episode.facts.length as u64 + 1;
        }
        if chunk.is_empty() { Ok(()) } else { hand_over(chunk) }
    })?;
    writer.finish()
}

/// The log time of a step, counted through all episodes, ns.
fn clock(about: &About) -> impl Fn(u64) -> u64 + use<> {
    let interval = about.control_interval.unwrap_or(DEFAULT_INTERVAL);
    move |step| (step as f64 * interval * NANOSECONDS).round() as u64
}

/// The numbers of the episodes, each with the log times of its first and last message.
pub(super) fn spans(header: &Header) -> Vec<(u64, RangeInclusive<u64>)> {
    let time = clock(&header.about);
    let mut start = 0;
    let mut spans = Vec::with_capacity(header.episodes.len());
    for facts in &header.episodes {
        let end = start + facts.length as u64;
        spans.push((facts.number, time(start)..=time(end)));
        start = end + 1;
    }
    spans
}

/// Whether a number in the channel at `place` is undefined.
fn has_undefined(recording: &Recording, place: usize) -> bool {
    recording.episodes.iter().any(|episode| match &episode.samples[place] {
        Samples::Single(values) => values.iter().any(|value| value.is_nan()),
        Samples::Double(values) => values.iter().any(|value| value.is_nan()),
        Samples::Flag(_) => false,
    })
}

/// The JSON schema of a channel's messages, some numbers of which may be `undefined`.
fn schema(channel: &Channel, undefined: bool) -> String {
    let number = |unit: &str, name: &str| {
        let mut schema = match channel.precision {
            super::Precision::Flag => json!({"type": "boolean"}),
            _ if undefined => json!({"type": ["number", "null"]}),
            _ => json!({"type": "number"}),
        };
        if !unit.is_empty() {
            schema["description"] = json!(unit);
        }
        (name.to_owned(), schema)
    };
    let value = match channel.elements.as_slice() {
        [element] if channel.is_scalar() => number(&element.unit, "").1,
        elements => {
            let elements = elements.iter().map(|element| number(&element.unit, &element.name));
            let elements: serde_json::Map<_, _> = elements.collect();
            json!({"type": "object", "properties": elements})
        }
    };
    json!({
        "title": channel.name,
        "type": "object",
        "properties": {"episode": {"type": "integer"}, "step": {"type": "integer"}, "value": value},
        "required": ["episode", "step", "value"],
    })
    .to_string()
}

/// Everything about the recording in `path` but its samples.
pub(super) fn read_header(path: &Path) -> Result<Header, RecordError> {
    let mut header = None;
    let mut pairs = None;
    for_each_record(&mut files::open(path)?, path, |record| {
        match record {
            Record::Metadata(Metadata { name, mut metadata }) if name == HEADER => {
                header = metadata.remove(HEADER);
            }
            Record::Metadata(found) if found.name == METADATA => pairs = Some(found.metadata),
            _ => {}
        }
        // Both stand before the first message.
        Ok(header.is_none() || pairs.is_none())
    })?;
    let header = header.ok_or_else(|| RecordError::NoRecording { path: path.to_path_buf() })?;
    let mut header = Header::parse(&header, "MCAP", path)?;
    header.about.metadata = pairs.unwrap_or_default();
    Ok(header)
}

/// Reads what [`write`] wrote.
pub(super) fn read(path: &Path) -> Result<Recording, RecordError> {
    read_from(&mut files::open(path)?, path)
}

/// Reads a recording from `source`; `path` is for errors.
fn read_from(source: &mut dyn Read, path: &Path) -> Result<Recording, RecordError> {
    let damaged = |what: String| damaged(path, what);
    let mut reading: Option<Reading> = None;
    let mut metadata = BTreeMap::new();
    for_each_record(source, path, |record| {
        match record {
            Record::Metadata(Metadata { name, metadata: mut pairs }) if name == HEADER => {
                let text = pairs.remove(HEADER).unwrap_or_default();
                reading = Some(Reading::new(Header::parse(&text, "MCAP", path)?));
            }
            Record::Metadata(pairs) if pairs.name == METADATA => metadata = pairs.metadata,
            Record::Channel(channel) => {
                if let Some(reading) = &mut reading {
                    reading.add_channel(channel.id, &channel.topic);
                }
            }
            Record::Message { header, data } => {
                let no_header = || RecordError::NoRecording { path: path.to_path_buf() };
                let reading = reading.as_mut().ok_or_else(no_header)?;
                reading.take(header.channel_id, &data).map_err(damaged)?;
            }
            _ => {}
        }
        Ok(true)
    })?;
    let reading = reading.ok_or_else(|| RecordError::NoRecording { path: path.to_path_buf() })?;
    let mut recording = reading.finish(path)?;
    recording.about.metadata = metadata;
    Ok(recording)
}

pub(super) fn damaged(path: &Path, what: String) -> RecordError {
    RecordError::Damaged { format: "MCAP", what, path: path.to_path_buf() }
}

/// Calls `on_record` for every record, chunks unpacked, until it says that it has seen enough.
fn for_each_record(
    source: &mut dyn Read,
    path: &Path,
    mut on_record: impl FnMut(Record<'_>) -> Result<bool, RecordError>,
) -> Result<(), RecordError> {
    let fail = |error: McapError| damaged(path, error.to_string());
    let options = LinearReaderOptions::default()
        .with_emit_chunks(true)
        .with_validate_data_section_crc(true)
        .with_validate_summary_section_crc(true)
        .with_record_length_limit(LONGEST_RECORD);
    let mut reader = LinearReader::new_with_options(options);
    while let Some(event) = reader.next_event() {
        match event.map_err(fail)? {
            LinearReadEvent::ReadRequest(count) => {
                // Asking for less than is wanted is allowed; a claimed length alone takes no memory.
                let count = count.min(1 << 16);
                let read = source.read(reader.insert(count)).map_err(|source| {
                    files::FileError::Read { path: path.to_path_buf(), source }
                })?;
                reader.notify_read(read);
            }
            LinearReadEvent::Record { data, opcode } => {
                let more = match mcap::parse_record(opcode, data).map_err(fail)? {
                    Record::Chunk { header, data } => unpack(&header, &data, path, &mut on_record)?,
                    record => on_record(record)?,
                };
                if !more {
                    return Ok(());
                }
            }
        }
    }
    Ok(())
}

fn unpack(
    header: &ChunkHeader,
    data: &[u8],
    path: &Path,
    on_record: &mut dyn FnMut(Record<'_>) -> Result<bool, RecordError>,
) -> Result<bool, RecordError> {
    mcap_chunk::for_each(header, data, LONGEST_RECORD, on_record).map_err(|error| match error {
        ChunkError::Damaged(what) => damaged(path, what),
        ChunkError::Record(error) => error,
    })
}

/// Calls `on_record` for every record of the chunk whose record has `body`.
pub(super) fn chunk(
    body: &[u8],
    path: &Path,
    on_record: &mut dyn FnMut(Record<'_>) -> Result<bool, RecordError>,
) -> Result<(), RecordError> {
    match mcap::parse_record(mcap::records::op::CHUNK, body) {
        Ok(Record::Chunk { header, data }) => unpack(&header, &data, path, on_record).map(drop),
        Ok(_) => Err(damaged(path, "its index names no chunk".to_owned())),
        Err(error) => Err(damaged(path, error.to_string())),
    }
}

/// A recording being filled.
pub(super) struct Reading {
    /// Whether messages of episodes that the header does not name are passed over.
    only_some: bool,
    recording: Recording,
    messages: Vec<Message>,
    /// Place of the channel with each number, by number.
    places: BTreeMap<u16, usize>,
    /// Place of the episode with each number.
    episodes: BTreeMap<u64, usize>,
}

impl Reading {
    fn new(header: Header) -> Self {
        let episodes = header.empty_episodes();
        let messages = header.channels.iter().map(Message::new).collect();
        let numbers =
            header.episodes.iter().enumerate().map(|(place, facts)| (facts.number, place));
        Self {
            messages,
            places: BTreeMap::new(),
            episodes: numbers.collect(),
            only_some: false,
            recording: Recording { about: header.about, channels: header.channels, episodes },
        }
    }

    /// For the episodes that are left in `header` of those in the file.
    pub(super) fn of_some(header: Header) -> Self {
        Self { only_some: true, ..Self::new(header) }
    }

    /// What was filled, if nothing is missing.
    pub(super) fn finish(self, path: &Path) -> Result<Recording, RecordError> {
        self.recording.check().map_err(|error| damaged(path, error.to_string()))?;
        Ok(self.recording)
    }

    /// Channels that the header does not know are left alone.
    pub(super) fn add_channel(&mut self, id: u16, topic: &str) {
        let place = topic.strip_prefix('/').and_then(|name| self.recording.place(name));
        if let Some(place) = place {
            self.places.insert(id, place);
        }
    }

    pub(super) fn take(&mut self, channel: u16, text: &[u8]) -> Result<(), String> {
        let Some(&place) = self.places.get(&channel) else { return Ok(()) };
        if self.only_some
            && mcap_message::episode(text)
                .is_some_and(|number| !self.episodes.contains_key(&number))
        {
            return Ok(());
        }
        let (message, name) = (&self.messages[place], &self.recording.channels[place].name);
        let (known, episodes) = (&self.episodes, &mut self.recording.episodes);
        message.read(text, |number, step| {
            let unknown = || format!("`{name}` names episode {number}, which the header does not");
            let episode = &mut episodes[*known.get(&number).ok_or_else(unknown)?];
            let (length, samples) = (episode.facts.length, &mut episode.samples[place]);
            let next = samples.len() / message.width().max(1);
            if next >= length || step != next as u64 {
                return Err(format!(
                    "`{name}` of episode {number} has step {step} of {length} where {next} was expected"
                ));
            }
            if next == 0 {
                samples.reserve(length.min(LONGEST_RESERVE) * message.width());
            }
            Ok(samples)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::recording::testing::{assert_same, recording};
    use super::*;

    #[test]
    fn a_recording_comes_back_bit_for_bit_and_its_bytes_do_not_change() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen.mcap");
        write(&path, &recording(), Place::New).unwrap();
        assert_same(&read(&path).unwrap(), &recording());
        let header = read_header(&path).unwrap();
        assert_eq!(header.episodes.len(), 2);
        assert!(matches!(write(&path, &recording(), Place::New), Err(RecordError::Exists { .. })));
        let bytes = std::fs::read(&path).unwrap();
        write(&path, &recording(), Place::Replace).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), bytes);
    }

    #[test]
    fn other_programs_find_channels_schemas_index_and_checksums() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen.mcap");
        write(&path, &recording(), Place::New).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let stats = summary.stats.unwrap();
        assert_eq!((stats.channel_count, stats.message_count), (5, 5 * 14));
        assert!(!summary.chunk_indexes.is_empty());
        let joint = summary.channels.values().find(|c| c.topic == "/joint").unwrap();
        let schema = joint.schema.as_ref().unwrap();
        let schema: serde_json::Value = serde_json::from_slice(&schema.data).unwrap();
        let unit = &schema["properties"]["value"]["properties"]["flexion"]["description"];
        assert_eq!(unit, "rad");
        assert_eq!(joint.metadata["timing"], "before_step");
        let times: Vec<u64> =
            mcap::MessageStream::new(&bytes).unwrap().map(|m| m.unwrap().log_time).collect();
        assert!(times.is_sorted());
        assert_eq!(times.last(), Some(&150_000_000), "5 steps, a gap, 9 steps of 0.01 s");
    }

    #[test]
    fn only_a_channel_with_undefined_numbers_gives_them_a_second_type() {
        let (folder, mut recording) = (tempfile::tempdir().unwrap(), recording());
        for episode in &mut recording.episodes {
            episode.samples[3] = Samples::Double(vec![-1.5; episode.facts.length]);
        }
        let path = folder.path().join("pen.mcap");
        write(&path, &recording, Place::New).unwrap();
        let summary = mcap::Summary::read(&std::fs::read(&path).unwrap()).unwrap().unwrap();
        let mut types = std::collections::BTreeSet::new();
        for (place, channel) in recording.channels.iter().enumerate() {
            let topic = format!("/{}", channel.name);
            let found = summary.channels.values().find(|found| found.topic == topic).unwrap();
            let schema = &found.schema.as_ref().unwrap().data;
            let schema: serde_json::Value = serde_json::from_slice(schema).unwrap();
            let mut value = &schema["properties"]["value"];
            if !channel.is_scalar() {
                value = &value["properties"][&channel.elements[0].name];
            }
            let mut values = recording.episodes.iter().flat_map(|e| e.samples[place].values());
            let want = match channel.precision {
                crate::record::Precision::Flag => json!("boolean"),
                _ if values.any(f64::is_nan) => json!(["number", "null"]),
                _ => json!("number"),
            };
            assert_eq!(value["type"], want, "{topic}");
            types.insert(want.to_string());
        }
        assert_eq!(types.len(), 3, "{types:?}");
    }

    #[test]
    fn an_infinite_number_is_refused_by_name() {
        let mut wrong = recording();
        wrong.episodes[0].samples[3] = Samples::Double(vec![f64::INFINITY; 5]);
        let folder = tempfile::tempdir().unwrap();
        let error = write(&folder.path().join("a.mcap"), &wrong, Place::New).unwrap_err();
        assert!(error.to_string().contains("`reward` of episode 2"), "{error}");
    }

    #[test]
    fn every_flipped_byte_and_every_shortened_file_is_an_error_or_the_same_recording() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pen.mcap");
        write(&path, &recording(), Place::New).unwrap();
        let bytes = std::fs::read(&path).unwrap();
        for length in (0..bytes.len()).step_by(7) {
            let cut = read_from(&mut &bytes[..length], &path);
            assert!(cut.is_err(), "{length} bytes of {}", bytes.len());
        }
        for place in 0..bytes.len() {
            let mut changed = bytes.clone();
            changed[place] ^= 0x81;
            if let Ok(found) = read_from(&mut changed.as_slice(), &path) {
                assert_same(&found, &recording());
            }
        }
    }
}

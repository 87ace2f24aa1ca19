//! The JSON text of one message: `{"episode":3,"step":17,"value":…}`, members in this order.

use std::fmt;
use std::io::Write;

use serde::de::{DeserializeSeed, Deserializer, Error, IgnoredAny, MapAccess, Visitor};

use super::RecordError;
use super::recording::{Channel, Episode, Recording, Samples};

/// How the messages of one channel are written and read.
#[derive(Debug)]
pub(super) struct Message {
    /// Names of the elements; none if the channel is a single number.
    elements: Vec<String>,
    /// What stands before each value: `{"ECRL":`, `,"ECRB":`, …
    leads: Vec<Vec<u8>>,
    end: &'static [u8],
}

impl Message {
    /// The messages of `channel`.
    pub(super) fn new(channel: &Channel) -> Self {
        if channel.is_scalar() {
            return Self { elements: Vec::new(), leads: vec![Vec::new()], end: b"}" };
        }
        let elements: Vec<String> = channel.elements.iter().map(|e| e.name.clone()).collect();
        let lead = |(index, name): (usize, &String)| {
            let open = if index == 0 { "{" } else { "," };
            format!("{open}{}:", serde_json::Value::from(name.as_str())).into_bytes()
        };
        let leads = elements.iter().enumerate().map(lead).collect();
        Self { end: if elements.is_empty() { b"{}}" } else { b"}}" }, elements, leads }
    }

    /// Number of values of a message.
    pub(super) fn width(&self) -> usize {
        self.leads.len()
    }

    /// Appends to `text` the message of the channel at `place` for `step` of `episode`.
    pub(super) fn write(&self, text: &mut Vec<u8>, episode: &Episode, place: usize, step: usize) {
        let number = episode.facts.number;
        let row = step * self.width()..(step + 1) * self.width();
        // Numbers go into memory: nothing here can fail.
        let mut written = write!(text, "{{\"episode\":{number},\"step\":{step},\"value\":").is_ok();
        match &episode.samples[place] {
            Samples::Single(values) => {
                for (lead, value) in self.leads.iter().zip(&values[row]) {
                    text.extend_from_slice(lead);
                    written &= serde_json::to_writer(&mut *text, value).is_ok();
                }
            }
            Samples::Double(values) => {
                for (lead, value) in self.leads.iter().zip(&values[row]) {
                    text.extend_from_slice(lead);
                    written &= serde_json::to_writer(&mut *text, value).is_ok();
                }
            }
            Samples::Flag(values) => {
                for (lead, value) in self.leads.iter().zip(&values[row]) {
                    text.extend_from_slice(lead);
                    text.extend_from_slice(if *value { b"true" } else { b"false" });
                }
            }
        }
        text.extend_from_slice(self.end);
        debug_assert!(written, "writing to memory cannot fail");
    }

    /// Appends a message's values to the samples that `find` gives for its episode and step.
    pub(super) fn read<'a>(
        &self,
        text: &[u8],
        find: impl FnOnce(u64, u64) -> Result<&'a mut Samples, String>,
    ) -> Result<(), String> {
        let mut reader = serde_json::Deserializer::from_slice(text);
        let seed = Envelope { message: self, find };
        seed.deserialize(&mut reader)
            .and_then(|()| reader.end())
            .map_err(|error| format!("a message: {error}"))
    }
}

/// The episode that a message belongs to, from its first member.
pub(super) fn episode(text: &[u8]) -> Option<u64> {
    let digits = text.strip_prefix(b"{\"episode\":")?;
    let end = digits.iter().position(|byte| !byte.is_ascii_digit())?;
    std::str::from_utf8(&digits[..end]).ok()?.parse().ok()
}

/// An infinite number has no JSON.
pub(super) fn check_finite(recording: &Recording) -> Result<(), RecordError> {
    for episode in &recording.episodes {
        for (channel, samples) in recording.channels.iter().zip(&episode.samples) {
            let infinite = match samples {
                Samples::Single(values) => values.iter().any(|value| value.is_infinite()),
                Samples::Double(values) => values.iter().any(|value| value.is_infinite()),
                Samples::Flag(_) => false,
            };
            if infinite {
                let (name, number) = (&channel.name, episode.facts.number);
                let what = format!("the infinite numbers in `{name}` of episode {number}");
                return Err(RecordError::CannotHold { format: "MCAP", what });
            }
        }
    }
    Ok(())
}

/// The members around the values.
struct Envelope<'m, F> {
    message: &'m Message,
    find: F,
}

impl<'de, 'a, F> DeserializeSeed<'de> for Envelope<'_, F>
where
    F: FnOnce(u64, u64) -> Result<&'a mut Samples, String>,
{
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        deserializer.deserialize_map(self)
    }
}

impl<'de, 'a, F> Visitor<'de> for Envelope<'_, F>
where
    F: FnOnce(u64, u64) -> Result<&'a mut Samples, String>,
{
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object with episode, step and value")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        let (mut episode, mut step, mut find) = (None, None, Some(self.find));
        while let Some(key) = map.next_key::<String>()? {
            match (key.as_str(), episode, step) {
                ("episode", None, _) => episode = Some(map.next_value()?),
                ("step", _, None) => step = Some(map.next_value()?),
                ("value", Some(episode), Some(step)) => {
                    let find = find.take().ok_or_else(|| A::Error::duplicate_field("value"))?;
                    let samples = find(episode, step).map_err(A::Error::custom)?;
                    map.next_value_seed(Values { elements: &self.message.elements, samples })?;
                }
                ("episode" | "step" | "value", ..) => {
                    return Err(A::Error::custom("episode, step and value are not in order"));
                }
                _ => drop(map.next_value::<IgnoredAny>()?),
            }
        }
        if find.is_some() { Err(A::Error::missing_field("value")) } else { Ok(()) }
    }
}

/// The values themselves.
struct Values<'m> {
    elements: &'m [String],
    samples: &'m mut Samples,
}

impl<'de> DeserializeSeed<'de> for Values<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        if self.elements.is_empty() {
            Number(self.samples).deserialize(deserializer)
        } else {
            deserializer.deserialize_map(self)
        }
    }
}

impl<'de> Visitor<'de> for Values<'_> {
    type Value = ();

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str("an object with one number per element")
    }

    fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<(), A::Error> {
        for element in self.elements {
            let key = map.next_key::<String>()?;
            if key.as_ref() != Some(element) {
                let found = key.unwrap_or_else(|| "nothing".to_owned());
                return Err(A::Error::custom(format!("`{element}` was expected, found `{found}`")));
            }
            map.next_value_seed(Number(self.samples))?;
        }
        match map.next_key::<String>()? {
            Some(key) => Err(A::Error::custom(format!("`{key}` is one element too many"))),
            None => Ok(()),
        }
    }
}

/// One value, in the samples' own type; `null` is undefined.
struct Number<'m>(&'m mut Samples);

impl<'de> DeserializeSeed<'de> for Number<'_> {
    type Value = ();

    fn deserialize<D: Deserializer<'de>>(self, deserializer: D) -> Result<(), D::Error> {
        use serde::Deserialize;
        match self.0 {
            Samples::Single(values) => {
                values.push(Option::<f32>::deserialize(deserializer)?.unwrap_or(f32::NAN));
            }
            Samples::Double(values) => {
                values.push(Option::<f64>::deserialize(deserializer)?.unwrap_or(f64::NAN));
            }
            Samples::Flag(values) => values.push(bool::deserialize(deserializer)?),
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::super::recording::testing::recording;
    use super::*;

    #[test]
    fn a_message_says_what_it_is_and_reads_back() {
        let recording = recording();
        let message = Message::new(&recording.channels[0]);
        let mut text = Vec::new();
        message.write(&mut text, &recording.episodes[1], 0, 1);
        let want = "{\"episode\":10,\"step\":1,\"value\":{\"ECRL\":3.4028235e+38,\"ECRB\":0.33333334,\"FCU\":null}}";
        assert_eq!(String::from_utf8(text.clone()).unwrap(), want);
        let mut samples = Samples::Single(Vec::new());
        let mut place = (0, 0);
        let found = message.read(&text, |episode, step| {
            place = (episode, step);
            Ok(&mut samples)
        });
        assert_eq!((found, place), (Ok(()), (10, 1)));
        let Samples::Single(values) = samples else { panic!() };
        assert_eq!(values[..2], [f32::MAX, 1.0 / 3.0]);
        assert!(values[2].is_nan());
    }

    #[test]
    fn anything_else_is_refused() {
        let message = Message::new(&recording().channels[0]);
        for (text, complaint) in [
            ("{\"episode\":1,\"step\":0}", "missing field `value`"),
            ("{\"value\":{},\"episode\":1,\"step\":0}", "not in order"),
            ("{\"episode\":1,\"step\":0,\"value\":{\"FCU\":1}}", "`ECRL` was expected"),
            ("{\"episode\":1,\"step\":0,\"value\":{\"ECRL\":1}}", "found `nothing`"),
            ("{\"episode\":1,\"step\":-1,\"value\":0}", "invalid value"),
            ("{\"episode\":1,\"step\":0,\"value\":{\"ECRL\":\"x\"}}", "invalid type"),
            ("[[[[", "invalid type"),
        ] {
            let mut samples = Samples::Single(Vec::new());
            let error = message.read(text.as_bytes(), |_, _| Ok(&mut samples)).unwrap_err();
            assert!(error.contains(complaint), "{text}: {error}");
        }
    }
}

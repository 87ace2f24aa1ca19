//! `setup --kinesis`, `--emg`, `--arnold`: fetches published data sets into the data folder, and says what each weighs,
//! under which licence it is and what to cite.

use std::fmt::Write as _;

use serde_json::json;

use crate::assets::data::{DataError, DataEvent, DataFolder, DataSet, Origin};
use crate::cli::context::{Context, Outcome};
use crate::cli::progress::{Progress, duration};
use crate::cli::render::{self, Hinted};

const MEGABYTE: u64 = 1_000_000;

/// Makes sure that `sets` are in the data folder, or only looks if `origin` is none.
pub(super) fn run(
    context: &Context,
    sets: &[DataSet<'_>],
    origin: Option<&Origin>,
) -> anyhow::Result<Outcome> {
    let data = DataFolder::at(&context.data);
    if let Some(origin) = origin {
        announce(context, &data, sets);
        let mut display = Display { context, progress: None, received: 0 };
        data.ensure(sets, origin, &mut |event| display.show(&event))
            .map_err(|error| Hinted::new(error.to_string(), error.hint()))?;
    }
    let failures = report(context, &data, sets)?;
    match failures.first() {
        None => Ok(Outcome::Done),
        Some(first) => {
            let messages: Vec<String> = failures.iter().map(ToString::to_string).collect();
            Err(Hinted::new(messages.join("; "), first.hint()))
        }
    }
}

/// Says how much is going to come and how much room there is.
fn announce(context: &Context, data: &DataFolder, sets: &[DataSet<'_>]) {
    for set in sets {
        context.say(&format!("{}: {}, {}", set.name, size(set.bytes()), set.record));
    }
    let free = data.free_space().map_or_else(|| "an unknown amount".to_owned(), size);
    let all = sets.iter().map(DataSet::bytes).sum();
    let folder = data.root().display();
    context.say(&format!(
        "Together {}, and at least as much again unpacked; {free} free in `{folder}`",
        size(all)
    ));
}

/// Prints the state of every set; returns why those are not in place that are not.
fn report(
    context: &Context,
    data: &DataFolder,
    sets: &[DataSet<'_>],
) -> anyhow::Result<Vec<DataError>> {
    let mut failures = Vec::new();
    let mut documents = Vec::new();
    let mut text = format!("Data: {}\n\n", data.root().display());
    for set in sets {
        let verified = data.verify(set);
        let state = state_of(&verified);
        documents.push(json!({
            "name": set.name,
            "state": state,
            "folder": data.folder(set),
            "source": set.record.to_string(),
            "bytes": set.bytes(),
            "files": verified.as_ref().ok().map(|receipt| receipt.files.len()),
            "licence": set.licence,
            "citations": set.citations,
            "message": verified.as_ref().err().map(ToString::to_string),
        }));
        let (name, purpose, source) = (set.name, set.purpose, set.record);
        writeln!(text, "{name}: {state}\n  for      {purpose}\n  source   {source}")?;
        writeln!(text, "  licence  {}", set.licence)?;
        for citation in set.citations {
            writeln!(text, "  cite     {citation}")?;
        }
        failures.extend(verified.err());
    }
    if context.json {
        render::print_json(&json!({ "data": data.root(), "data_sets": documents }))?;
    } else {
        render::print_text(&text)?;
    }
    Ok(failures)
}

/// One word for the state of a data set.
pub(super) fn state_of<T>(verified: &Result<T, DataError>) -> &'static str {
    match verified {
        Ok(_) => "verified",
        Err(DataError::Missing { .. }) => "missing",
        Err(DataError::Unverified { .. }) => "unverified",
        Err(_) => "damaged",
    }
}

/// What the person at the terminal sees while files come in.
struct Display<'a> {
    context: &'a Context,
    progress: Option<Progress>,
    /// Bytes that do not make a megabyte yet.
    received: u64,
}

impl Display<'_> {
    fn show(&mut self, event: &DataEvent) {
        if let DataEvent::Received(bytes) = event {
            self.received += bytes;
            if let Some(progress) = &self.progress {
                progress.advance(self.received / MEGABYTE);
            }
            self.received %= MEGABYTE;
            return;
        }
        if let Some(progress) = self.progress.take() {
            progress.finish();
        }
        if let DataEvent::Fetching { file, start, bytes, .. } = event {
            self.received = 0;
            let left = (bytes - start).div_ceil(MEGABYTE);
            self.context.say(&describe(event));
            self.progress = Some(Progress::start(self.context, file, "MB", left));
        } else {
            self.context.say(&describe(event));
        }
    }
}

/// The line a person sees for an event.
fn describe(event: &DataEvent) -> String {
    match event {
        DataEvent::Present(name) => format!("{name} is in place"),
        DataEvent::Waiting => {
            "Another `setup` is at work in this folder, waiting for it".to_owned()
        }
        DataEvent::Fetching { address, start: 0, bytes, .. } => {
            format!("Fetching {} from `{address}`", size(*bytes))
        }
        DataEvent::Fetching { address, start, bytes, .. } => {
            format!("Fetching the rest of {} after {} from `{address}`", size(*bytes), size(*start))
        }
        DataEvent::Received(bytes) => size(*bytes),
        DataEvent::Retrying { reason, wait } => {
            format!("{reason}; trying again in {}", duration(wait.as_secs_f64()))
        }
        DataEvent::StartingOver(file) => {
            format!("{file}: what was continued has a wrong sum, fetching it from the start")
        }
        DataEvent::Checking(file) => format!("{file}: checking size and sum"),
        DataEvent::Unpacking(file) => format!("{file}: unpacking"),
        DataEvent::Installed { name, files, kept: 0 } => format!("{name}: {files} files installed"),
        DataEvent::Installed { name, files, kept } => {
            format!("{name}: {files} files in place, {kept} of them were there already")
        }
    }
}

/// A number of bytes a person can read: `968 bytes`, `13.1 MB`, `2.81 GB`.
pub(super) fn size(bytes: u64) -> String {
    match bytes {
        0..10_000 => format!("{bytes} bytes"),
        10_000..1_000_000 => format!("{:.0} kB", bytes as f64 / 1e3),
        1_000_000..1_000_000_000 => format!("{:.1} MB", bytes as f64 / 1e6),
        _ => format!("{:.2} GB", bytes as f64 / 1e9),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sizes_are_what_a_person_would_say() {
        assert_eq!(size(968), "968 bytes");
        assert_eq!(size(381_952), "382 kB");
        assert_eq!(size(13_129_926), "13.1 MB");
        assert_eq!(size(2_808_003_156), "2.81 GB");
    }
}

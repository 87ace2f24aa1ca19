//! `setup`: fetches what the program may not carry, and says under which licence it is and what to cite.
//!
//! Alone it installs physics and models into the cache. `--kinesis`, `--emg` and `--arnold` fetch published data sets
//! into the data folder instead (`data_sets.rs`).
//!
//! Exit code 0 when everything is in place, 3 when something does not exist for this machine, 1 when something is missing
//! (`--check`) or could not be fetched.

use std::fmt::Write as _;
use std::path::PathBuf;

use clap::Args;
use serde_json::json;

use super::data_sets;
use crate::assets::data::{DataSet, Origin, catalogue};
use crate::assets::{AssetError, Cache, Event, Part, Source};
use crate::cli::context::{Context, Outcome};
use crate::cli::render::{self, Hinted};

/// Arguments of `setup`.
#[derive(Debug, Args)]
pub struct SetupArguments {
    /// Only verify what is installed; fetch nothing
    #[arg(long, conflicts_with = "from")]
    check: bool,
    /// Take wheels or archives from this folder instead of the network
    #[arg(long, value_name = "DIR")]
    from: Option<PathBuf>,
    /// Fetch the leg model of the walking task instead
    #[arg(long)]
    kinesis: bool,
    /// Fetch human muscle activity during walking instead
    #[arg(long)]
    emg: bool,
    /// Fetch the released policies and their results instead: all, or those named of `checkpoints`, `experts`,
    /// `benchmarks`, `extra_results`
    #[arg(long, value_name = "ARCHIVES", num_args = 0..=1, value_delimiter = ',')]
    #[arg(default_missing_value = "checkpoints,experts,benchmarks,extra_results")]
    #[arg(value_parser = archive)]
    arnold: Option<Vec<DataSet<'static>>>,
}

impl SetupArguments {
    /// The data sets that were named, each once.
    fn data_sets(&self) -> Vec<DataSet<'static>> {
        let kinesis = self.kinesis.then_some(catalogue::KINESIS);
        let emg = self.emg.then_some(catalogue::EMG);
        let named = kinesis.into_iter().chain(emg).chain(self.arnold.iter().flatten().copied());
        named.fold(Vec::new(), |mut sets, set| {
            if !sets.contains(&set) {
                sets.push(set);
            }
            sets
        })
    }

    /// Where data sets come from: `--from`, else `$ARNOLD_MIRROR`, else where they are published.
    fn origin(&self) -> Origin {
        let mirror = std::env::var("ARNOLD_MIRROR").ok().filter(|text| !text.is_empty());
        let named = self.from.clone().map(Origin::Folder);
        named.or_else(|| Some(Origin::of_mirror(&mirror?))).unwrap_or(Origin::Published)
    }
}

fn archive(name: &str) -> Result<DataSet<'static>, String> {
    catalogue::archive(name).map_err(|error| error.to_string())
}

/// Runs the command.
pub fn run(context: &Context, arguments: &SetupArguments) -> anyhow::Result<Outcome> {
    let sets = arguments.data_sets();
    if !sets.is_empty() {
        let origin = (!arguments.check).then(|| arguments.origin());
        return data_sets::run(context, &sets, origin.as_ref());
    }
    let cache = Cache::locate();
    let (parts, unavailable): (Vec<Part>, Vec<Part>) =
        Part::ALL.into_iter().partition(|part| part.is_available());
    if !arguments.check {
        let source = arguments.from.clone().map_or(Source::Pip, Source::Folder);
        cache.ensure(&parts, &source, &mut |event| context.say(&describe(&event)))?;
    }
    let failures = report(context, &cache)?;
    if let Some(first) = failures.first() {
        let messages: Vec<String> = failures.iter().map(ToString::to_string).collect();
        return Err(Hinted::new(messages.join("; "), first.hint()));
    }
    Ok(if unavailable.is_empty() { Outcome::Done } else { Outcome::SomethingSkipped })
}

/// Fetches `parts` for another command, saying so.
#[cfg(feature = "play")]
pub(crate) fn fetch(context: &Context, cache: &Cache, parts: &[Part]) -> Result<(), AssetError> {
    cache.ensure(parts, &Source::Pip, &mut |event| context.say(&describe(&event)))
}

/// Prints the state of every part; returns why those are not in place that should be.
fn report(context: &Context, cache: &Cache) -> anyhow::Result<Vec<AssetError>> {
    let mut failures = Vec::new();
    let mut documents = Vec::new();
    let mut text = format!("Cache: {}\n\n", cache.root().display());
    for part in Part::ALL {
        let verified = cache.verify(part);
        let state = state_of(&verified);
        documents.push(json!({
            "name": part.package(),
            "version": part.version(),
            "state": state,
            "folder": cache.folder(part),
            "files": verified.as_ref().ok().map(|receipt| receipt.files.len()),
            "wheel": verified.as_ref().ok().map(|receipt| &receipt.wheel),
            "licence": part.licence(),
            "citation": part.citation(),
            "message": verified.as_ref().err().map(ToString::to_string),
        }));
        let (licence, citation) = (part.licence(), part.citation());
        writeln!(text, "{part}: {state}\n  licence  {licence}\n  cite     {citation}")?;
        match verified {
            Ok(_) | Err(AssetError::NoWheel { .. }) => {}
            Err(error) => failures.push(error),
        }
    }
    if context.json {
        render::print_json(&json!({ "cache": cache.root(), "parts": documents }))?;
    } else {
        render::print_text(&text)?;
    }
    Ok(failures)
}

/// One word for the state of a part.
pub(super) fn state_of<T>(verified: &Result<T, AssetError>) -> &'static str {
    match verified {
        Ok(_) => "verified",
        Err(AssetError::Missing { .. }) => "missing",
        Err(AssetError::NoWheel { .. }) => "unavailable",
        Err(_) => "damaged",
    }
}

/// The line a person sees for an event.
fn describe(event: &Event) -> String {
    match event {
        Event::Present(part) => format!("{part} is in place"),
        Event::Waiting => "Another `setup` is at work, waiting for it".to_owned(),
        Event::Replacing(part, reason) => format!("{part} is damaged ({reason}), replacing it"),
        Event::Fetching(part, command) => format!("{part}: fetching with `{command}`"),
        Event::Unpacking(part, wheel) => format!("{part}: unpacking `{wheel}`"),
        Event::Installed(part, files) => format!("{part}: {files} files installed"),
    }
}

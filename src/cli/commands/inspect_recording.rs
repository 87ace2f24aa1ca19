//! `inspect` on a recording: format, task, policy, episodes, channels with shapes and units, metadata.

use std::path::Path;

use serde_json::{Value, json};

use crate::cli::context::{Context, Outcome};
use crate::cli::render::{self, Align, Hinted};
use crate::files;
use crate::record::{self, EpisodeFacts, Summary};

/// Longest text that is shown of a metadata value without `-v`.
const LONGEST_VALUE: usize = 60;

/// Prints what is in `path` if it begins like a recording; else `None`.
pub(super) fn run(context: &Context, path: &Path) -> anyhow::Result<Option<Outcome>> {
    // What cannot be read here is told where a checkpoint would have been.
    if !record::may_be_recording(path).unwrap_or(false) {
        return Ok(None);
    }
    let summary = record::summarise(path).map_err(|error| {
        Hinted::new(
            error.to_string(),
            "the file begins like a recording; make it again, or fetch it again",
        )
    })?;
    if context.json {
        let mut document = json!({
            "file": path.display().to_string(),
            "bytes": files::length(path)?,
            "sha256": files::sha256_of_file(path)?,
            "kind": "recording",
        });
        if let (Value::Object(into), Value::Object(of)) = (&mut document, json!(summary)) {
            into.extend(of);
        }
        render::print_json(&document)?;
    } else {
        render::print_text(&as_text(path, &summary, context.verbosity > 0)?)?;
    }
    Ok(Some(Outcome::Done))
}

fn as_text(path: &Path, summary: &Summary, verbose: bool) -> anyhow::Result<String> {
    let about = &summary.about;
    let untold = || "not told".to_owned();
    let actions = about.deterministic.map(|mean| if mean { "mean" } else { "sampled" });
    let interval = about.control_interval.map(|seconds| format!("{seconds} s"));
    let policy = Some(about.policy.clone()).filter(|policy| !policy.is_empty());
    let mut lines = vec![
        ("File", path.display().to_string()),
        ("Size", format!("{} bytes", render::grouped(files::length(path)?))),
        ("Format", summary.format.to_owned()),
        ("Task", about.task.clone()),
        ("Policy", policy.unwrap_or_else(untold)),
        ("Body", about.body.clone().unwrap_or_else(untold)),
        ("Actions", actions.map_or_else(untold, str::to_owned)),
        ("Seed", about.seed.map_or_else(untold, |seed| seed.to_string())),
        ("Control step", interval.unwrap_or_else(untold)),
        ("Horizon", about.horizon.map_or_else(untold, |steps| format!("{steps} steps"))),
        ("Episodes", episodes(&summary.episodes)),
    ];
    if !summary.left_out.is_empty() {
        lines.push(("Not read", summary.left_out.join(", ")));
    }
    for (key, value) in &about.metadata {
        let is_long = value.chars().count() > LONGEST_VALUE && !verbose;
        let short: String = value.chars().take(LONGEST_VALUE).collect();
        let shown = if is_long { format!("{short}… (`-v` shows all)") } else { value.clone() };
        lines.push(("Metadata", format!("{key}: {shown}")));
    }
    let width = lines.iter().map(|(label, _)| label.len()).max().unwrap_or(0);
    let line = |(label, value): (&str, String)| format!("{label:width$}  {value}\n");
    let mut text: String = lines.into_iter().map(line).collect();
    text.push('\n');
    text += &channels(summary, verbose);
    Ok(text)
}

/// Number, steps, and which attempts.
fn episodes(episodes: &[EpisodeFacts]) -> String {
    let steps: usize = episodes.iter().map(|episode| episode.length).sum();
    let (count, steps) = (render::grouped(episodes.len() as u64), render::grouped(steps as u64));
    let lengths = || episodes.iter().map(|episode| episode.length);
    match (episodes, lengths().min(), lengths().max()) {
        ([first, .., last], Some(shortest), Some(longest)) => {
            let numbers = format!("numbers {} to {}", first.number, last.number);
            if shortest == longest {
                format!("{count} of {longest} steps, {numbers}")
            } else {
                format!("{count} of {shortest} to {longest} steps, {steps} together, {numbers}")
            }
        }
        ([only], ..) => format!("1 of {steps} steps, number {}", only.number),
        _ => "none".to_owned(),
    }
}

fn channels(summary: &Summary, verbose: bool) -> String {
    let mut columns = vec![
        ("channel", Align::Left),
        ("per step", Align::Right),
        ("unit", Align::Left),
        ("taken", Align::Left),
    ];
    if verbose {
        columns.push(("elements", Align::Left));
    }
    let rows: Vec<Vec<String>> = summary
        .channels
        .iter()
        .map(|channel| {
            let timing = channel.timing.map_or("not told", |timing| timing.word());
            let elements: Vec<&str> = channel.elements.iter().map(|e| e.name.as_str()).collect();
            let mut row = vec![
                channel.name.clone(),
                channel.width().to_string(),
                channel.units().join(", "),
                timing.replace('_', " the "),
            ];
            if verbose {
                row.push(elements.join(" "));
            }
            row
        })
        .collect();
    render::table(&columns, &rows)
}

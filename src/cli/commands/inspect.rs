//! `inspect`: what is inside a checkpoint or a normaliser, without running anything in it; or inside a recording.
//!
//! Prints the format, the network and its sizes, the parameters, the normaliser that lies beside the file, every global
//! that the pickles name, what would be done with it, and which tasks it fits. With `-v`, and in JSON, every tensor.

use std::path::{Path, PathBuf};

use clap::Args;
use serde_json::{Map, Value, json};

use super::inspect_recording;
use crate::cli::context::{Context, Outcome};
use crate::cli::render::{self, Align, Hinted};
use crate::files;
use crate::policy::checkpoint::contents::{Checkpoint, Format, Normaliser};
use crate::policy::checkpoint::{self, CheckpointError, Limits, PickleError, UnusedPickle};

/// Arguments of `inspect`.
#[derive(Debug, Args)]
pub struct InspectArguments {
    /// Checkpoint (.zip, .pickle, .pth, .safetensors), normaliser (.pkl) or recording (.parquet, .mcap, .h5); recognised by
    /// content, not by name
    pub file: PathBuf,
}

/// What can be inspected.
const READABLE: &str = "give a checkpoint of Stable-Baselines3 (`.zip`), of PyTorch (`.pth`), of NPG (`.pickle`) or converted (`.safetensors`), a `VecNormalize` (`.pkl`), or a recording (`.parquet`, `.mcap`, `.h5`)";

/// Runs the command.
pub fn run(context: &Context, arguments: &InspectArguments) -> anyhow::Result<Outcome> {
    if let Some(outcome) = inspect_recording::run(context, &arguments.file)? {
        return Ok(outcome);
    }
    #[cfg_attr(
        not(feature = "play"),
        expect(unused_mut, reason = "tasks are known where they can be played")
    )]
    let mut document = inspect(&arguments.file, &Limits::default())?;
    #[cfg(feature = "play")]
    if document["kind"] == "policy" {
        document["play"] = super::inspect_fit::fit(context, &arguments.file);
    }
    if context.json {
        render::print_json(&document)?;
    } else {
        render::print_text(&as_text(&document, context.verbosity > 0))?;
    }
    Ok(Outcome::Done)
}

/// Everything that can be told about `path`, as one JSON document.
pub fn inspect(path: &Path, limits: &Limits) -> anyhow::Result<Value> {
    let bytes = files::read_bounded(path, limits.file_bytes)
        .map_err(|error| Hinted::new(error.to_string(), READABLE))?;
    let mut document = json!({
        "file": path.display().to_string(),
        "bytes": bytes.len(),
        "sha256": files::sha256_hex(&bytes),
    });
    let described = match checkpoint::read_checkpoint(&bytes, limits) {
        Ok(policy) => Ok(describe_policy(path, &bytes, &policy, limits)),
        Err(CheckpointError::NotAPolicy { .. }) => {
            checkpoint::read_normaliser_and_globals(&bytes, limits).map(|(normaliser, globals)| {
                json!({
                    "kind": "normaliser",
                    "normaliser": describe_normaliser(&normaliser),
                    "globals": globals,
                    "use": "normalise the observations of the policy beside it",
                })
            })
        }
        Err(error) => Err(error),
    };
    let described = described.map_err(|error| refusal(&error, path, &bytes, limits))?;
    if let (Value::Object(document), Value::Object(described)) = (&mut document, described) {
        document.extend(described);
    }
    Ok(document)
}

/// The error of a refused file; for a forbidden global, with everything else that the file names.
fn refusal(error: &CheckpointError, path: &Path, bytes: &[u8], limits: &Limits) -> anyhow::Error {
    let message = format!("{error}, in `{}`", path.display());
    let CheckpointError::Pickle { fault: PickleError::UnknownGlobal { .. }, .. } = error else {
        return Hinted::new(message, READABLE);
    };
    let listed = checkpoint::list_globals(bytes, limits).unwrap_or_default();
    let mut globals: Vec<String> =
        listed.into_iter().filter_map(|pickle| pickle.globals.ok()).flatten().collect();
    globals.sort();
    globals.dedup();
    let hint = if globals.is_empty() {
        "nothing in the file was executed".to_owned()
    } else {
        format!("nothing in the file was executed; it names {}", globals.join(", "))
    };
    Hinted::new(message, hint)
}

fn describe_policy(path: &Path, bytes: &[u8], policy: &Checkpoint, limits: &Limits) -> Value {
    let counts = checkpoint::parameter_counts(policy);
    let sizes: Map<String, Value> = checkpoint::network_sizes(policy)
        .into_iter()
        .map(|(name, sizes)| match sizes[..] {
            [size] => (name.to_owned(), json!(size)),
            _ => (name.to_owned(), json!(sizes)),
        })
        .collect();
    let tensors: Vec<Value> = policy
        .tensors
        .iter()
        .map(|(name, tensor)| {
            json!({"name": name, "shape": tensor.shape, "same_as": policy.aliases.get(name)})
        })
        .collect();
    let mut normalisers = normalisers_beside(path, policy.format, limits);
    let mut format = container(policy.format, policy.scalars.library_version.as_deref());
    if let Ok(Some((normaliser, provenance))) = checkpoint::embedded(bytes, limits) {
        format = match provenance["checkpoint"]["file"].as_str() {
            Some(original) => format!("safetensors, converted from `{original}` ({format})"),
            None => "safetensors, bare weights".to_owned(),
        };
        normalisers.splice(..0, normaliser.as_ref().map(describe_normaliser));
    }
    json!({
        "kind": "policy",
        "format": format,
        "network": network(policy.format),
        "sizes": sizes,
        "heads": policy.scalars.head_count,
        "activation": policy.scalars.activation.map(|activation| format!("{activation:?}")),
        "parameters": {"stored": counts.stored, "distinct": counts.distinct},
        "training_steps": policy.scalars.training_steps,
        "library_version": policy.scalars.library_version,
        "use": intention(policy.format, !normalisers.is_empty()),
        "normalisers": normalisers,
        "globals": policy.globals,
        "unused_pickles": unused_pickles(bytes, policy.format, limits),
        "tensors": tensors,
    })
}

/// The members of an archive that are pickles but not needed, with what they name.
fn unused_pickles(bytes: &[u8], format: Format, limits: &Limits) -> Vec<Value> {
    if format == Format::NpgMlp {
        return Vec::new();
    }
    let listed = checkpoint::list_globals(bytes, limits).unwrap_or_default();
    listed
        .into_iter()
        .filter(|pickle| pickle.member != "policy.pth")
        .map(|UnusedPickle { member, globals }| match globals {
            Ok(globals) => json!({"member": member, "globals": globals}),
            Err(error) => json!({"member": member, "refused": error}),
        })
        .collect()
}

/// What lies beside the policy as a normaliser, readable or not.
fn normalisers_beside(path: &Path, format: Format, limits: &Limits) -> Vec<Value> {
    if format.scales_for_itself() {
        return Vec::new();
    }
    let candidates = checkpoint::normaliser_beside(path);
    candidates
        .into_iter()
        .map(|path| {
            let mut described = match checkpoint::open_normaliser(&path, limits) {
                Ok(normaliser) => describe_normaliser(&normaliser),
                Err(error) => json!({"refused": error.to_string()}),
            };
            described["file"] = json!(path.display().to_string());
            described
        })
        .collect()
}

fn describe_normaliser(normaliser: &Normaliser) -> Value {
    match normaliser {
        Normaliser::PerComponent(read) => json!({
            "statistics": "per observation component",
            "components": read.mean.len(),
            "enabled": read.enabled,
            "epsilon": read.epsilon,
            "clip": read.clip,
        }),
        Normaliser::PerSignature(read) => json!({
            "statistics": "per token signature and lag",
            "signatures": read.signatures.len(),
            "lags": read.lags,
            "enabled": read.enabled,
            "epsilon": read.epsilon,
            "clip": read.clip,
        }),
    }
}

fn container(format: Format, version: Option<&str>) -> String {
    match (format, version) {
        (Format::NpgMlp, _) => "mjrl pickle".to_owned(),
        (_, Some(version)) => format!("Stable-Baselines3 {version} archive"),
        (_, None) => "torch state dictionary, or archive without a version".to_owned(),
    }
}

fn network(format: Format) -> &'static str {
    match format {
        Format::ArnoldTransformer => "Arnold muscle transformer",
        Format::TemporalTransformer => "muscle transformer with attention over time",
        Format::RecurrentPpo => "recurrent actor-critic (LSTM)",
        Format::PpoMlp => "actor-critic multilayer perceptron",
        Format::NpgMlp => "Gaussian multilayer perceptron (natural policy gradient)",
        Format::SacMlp => "soft actor-critic multilayer perceptron",
        Format::WalkingExpert => {
            "walking expert: multilayer perceptron with an inverse muscle model"
        }
        Format::EnsembleClassifier => "classifier of an ensemble of recurrent policies",
    }
}

/// What a rollout does with such a policy.
fn intention(format: Format, has_normaliser: bool) -> String {
    let observation = match format {
        Format::ArnoldTransformer | Format::TemporalTransformer => {
            "play it on muscle observations, its mean action not clipped"
        }
        Format::RecurrentPpo | Format::PpoMlp | Format::SacMlp => {
            "play it on the observations of its own task, its mean action clipped to [-1, 1]"
        }
        Format::NpgMlp => {
            "play it on the observations of its own task, its mean action not clipped"
        }
        Format::WalkingExpert => {
            "play it on the walking task, its outputs turned into actions by an inverse muscle model"
        }
        Format::EnsembleClassifier => {
            "play the ensemble whose networks lie in `base/` and `hold/` beside it"
        }
    };
    let normaliser = match (format, has_normaliser) {
        (Format::EnsembleClassifier, _) => {
            "each normalised by the file beside it, the classifier by `scaler.pkl`"
        }
        (format, _) if format.scales_for_itself() => "normalised by the shift and scale inside it",
        (_, true) => "normalised by its normaliser",
        (_, false) => "but no normaliser lies beside it",
    };
    format!("{observation}; {normaliser}")
}

/// The document for a person: one line per fact, then the tensors if wanted.
fn as_text(document: &Value, with_tensors: bool) -> String {
    let mut lines: Vec<(&str, String)> = vec![
        ("File", plain(&document["file"])),
        ("Size", format!("{} bytes", grouped(&document["bytes"]))),
    ];
    if document["kind"] == "policy" {
        lines.push(("Format", plain(&document["format"])));
        lines.push(("Network", plain(&document["network"])));
        lines.push(("Sizes", members(&document["sizes"])));
        if !document["activation"].is_null() {
            lines.push(("Activation", plain(&document["activation"])));
        }
        let [stored, distinct] =
            ["stored", "distinct"].map(|name| grouped(&document["parameters"][name]));
        lines.push(("Parameters", format!("{stored} stored, {distinct} distinct")));
        lines.push(("Training steps", grouped(&document["training_steps"])));
        lines.extend(items(&document["normalisers"]).map(|item| ("Normaliser", members(item))));
    } else {
        lines.push(("Normaliser", members(&document["normaliser"])));
    }
    lines.push(("Globals", joined(&document["globals"])));
    lines.extend(items(&document["unused_pickles"]).map(|item| {
        let names = match &item["refused"] {
            Value::Null => format!("names {}", joined(&item["globals"])),
            error => format!("unreadable: {}", plain(error)),
        };
        ("Not needed", format!("{}: {names}", plain(&item["member"])))
    }));
    let tensor_count = items(&document["tensors"]).count();
    if tensor_count > 0 {
        let hint = if with_tensors { "" } else { ", listed by `-v`" };
        lines.push(("Tensors", format!("{tensor_count}{hint}")));
    }
    lines.push(("Use", plain(&document["use"])));
    for (label, key) in [("Observation", "observation"), ("Tasks", "tasks"), ("Refused", "refused")]
    {
        let told = &document["play"][key];
        if !told.is_null() {
            let text = if told.is_array() { joined(told) } else { plain(told) };
            lines.push((label, text));
        }
    }
    lines.extend(items(&document["play"]["warnings"]).map(|text| ("Note", plain(text))));

    let width = lines.iter().map(|(label, _)| label.len()).max().unwrap_or(0);
    let line = |(label, value): (&str, String)| format!("{label:width$}  {value}\n");
    let mut text: String = lines.into_iter().map(line).collect();
    if with_tensors && tensor_count > 0 {
        text.push('\n');
        text.push_str(&tensor_table(&document["tensors"]));
    }
    text
}

fn tensor_table(tensors: &Value) -> String {
    let columns = [("tensor", Align::Left), ("shape", Align::Right), ("same as", Align::Left)];
    let rows: Vec<Vec<String>> = items(tensors)
        .map(|tensor| {
            let shape: Vec<String> = items(&tensor["shape"]).map(Value::to_string).collect();
            let same_as = tensor["same_as"].as_str().unwrap_or_default().to_owned();
            let shape = if shape.is_empty() { "scalar".to_owned() } else { shape.join(" × ") };
            vec![plain(&tensor["name"]), shape, same_as]
        })
        .collect();
    render::table(&columns, &rows)
}

fn items(list: &Value) -> impl Iterator<Item = &Value> {
    list.as_array().into_iter().flatten()
}

/// A value without quotation marks; `not told` if there is none.
fn plain(value: &Value) -> String {
    match value {
        Value::Null => "not told".to_owned(),
        Value::String(text) => text.clone(),
        Value::Array(_) => format!("[{}]", joined(value)),
        other => other.to_string(),
    }
}

fn joined(list: &Value) -> String {
    match items(list).map(plain).collect::<Vec<_>>() {
        names if names.is_empty() => "none".to_owned(),
        names => names.join(", "),
    }
}

/// `name value, name value, …`
fn members(object: &Value) -> String {
    let members = object.as_object().into_iter().flatten();
    let texts = members.map(|(name, value)| format!("{name} {}", plain(value)));
    texts.collect::<Vec<_>>().join(", ")
}

/// An integer with its digits in groups of three.
fn grouped(value: &Value) -> String {
    let Some(number) = value.as_u64() else { return plain(value) };
    render::grouped(number)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn digits_are_grouped_from_the_right() {
        let texts = [0, 12, 999, 1000, 4_450_564].map(|number| grouped(&json!(number)));
        assert_eq!(texts, ["0", "12", "999", "1,000", "4,450,564"]);
    }

    #[test]
    fn a_file_that_is_no_checkpoint_is_named_in_the_error() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("notes.txt");
        files::write_atomic(&path, b"hello").unwrap();
        let error = inspect(&path, &Limits::default()).unwrap_err().to_string();
        assert!(error.contains("neither a zip archive nor a pickle"), "{error}");
        assert!(error.ends_with("notes.txt`"), "{error}");
    }
}

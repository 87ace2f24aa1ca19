//! `convert`, for policies: the same weights and statistics as safetensors and JSON, which load bit for bit alike.

use std::path::{Path, PathBuf};

use serde_json::json;

use crate::assets::Cache;
use crate::cli::context::{Context, Outcome};
use crate::cli::default_policy;
use crate::cli::explain;
use crate::cli::render::{self, Hinted};
use crate::policy::export;
use crate::policy::shelf::{self, Choice};

/// Writes the one policy in `policies` to the folder `out`.
pub(super) fn run(
    context: &Context,
    policies: &[PathBuf],
    normaliser: Option<&Path>,
    out: &Path,
) -> anyhow::Result<Outcome> {
    let [policy] = policies else {
        return Err(Hinted::new(
            "policies are converted one at a time",
            "for recordings, say the format: `--to parquet`, `--to mcap`, `--to hdf5`",
        ));
    };
    let data = default_policy::shelf_of(policy, &context.data, &Cache::locate())?;
    let choice = shelf::find(policy, &data).map_err(|error| {
        Hinted::new(error.to_string(), "give a checkpoint or the folder of a run")
    })?;
    let Choice::File(path) = choice else {
        return Err(Hinted::new(
            "a set of experts is several policies",
            "convert them one by one: `arnold-analyze convert pen_lattice --out DIR`",
        ));
    };
    let exported = export::export(&path, normaliser, out)
        .map_err(|error| explain::policy_error(&error, &path, normaliser))?;
    if context.json {
        render::print_json(&json!({
            "policy": exported.policy,
            "description": exported.description,
            "document": exported.document,
        }))?;
    } else {
        let (policy, description) = (exported.policy.display(), exported.description.display());
        render::print_text(&format!("{policy}\n{description}\n"))?;
    }
    Ok(Outcome::Done)
}

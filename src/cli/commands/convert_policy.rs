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

/// Writes the one policy in `policies`, or the mean of several, to the folder `out`.
pub(super) fn run(
    context: &Context,
    policies: &[PathBuf],
    normaliser: Option<&Path>,
    is_mean: bool,
    out: &Path,
) -> anyhow::Result<Outcome> {
    if policies.len() > 1 && !is_mean {
        return Err(Hinted::new(
            "policies are converted one at a time",
            "`--mean` makes one policy of checkpoints of one network; for recordings, say the format: `--to parquet`, \
             `--to mcap`, `--to hdf5`",
        ));
    }
    let paths: Vec<PathBuf> =
        policies.iter().map(|policy| file(context, policy)).collect::<anyhow::Result<_>>()?;
    let exported = match paths.as_slice() {
        [path] => export::export(path, normaliser, out),
        paths => export::export_mean(paths, normaliser, out),
    };
    let exported =
        exported.map_err(|error| explain::policy_error(&error, &paths[0], normaliser))?;
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

/// Where the policy lies that `policy` names.
fn file(context: &Context, policy: &Path) -> anyhow::Result<PathBuf> {
    let data = default_policy::shelf_of(policy, &context.data, &Cache::locate())?;
    let choice = shelf::find(policy, &data).map_err(|error| {
        Hinted::new(error.to_string(), "give a checkpoint or the folder of a run")
    })?;
    match choice {
        Choice::File(path) => Ok(path),
        Choice::Experts(_) => Err(Hinted::new(
            "a set of experts is several policies",
            "convert them one by one: `arnold-analyze convert pen_lattice --out DIR`",
        )),
    }
}

//! Which file beside a checkpoint holds its normaliser, by the naming customs of the published runs
//! (`spec/policy.md` §3.1). Only the file name is looked at, never the folders above it.

use std::path::{Path, PathBuf};

/// The existing files beside `checkpoint` that may hold its normaliser, most specific first.
///
/// | checkpoint | normaliser |
/// |---|---|
/// | `rl_model_1000_steps.zip` | `rl_model_vecnormalize_1000_steps.pkl` |
/// | `walk.zip` | `walk_vecnormalize.pkl`, `normalized_env_walk.pkl`, `env_walk.pkl` |
/// | `final_model.zip` | `final_env.pkl` |
/// | any other | `env.pkl` |
#[must_use]
pub fn normaliser_beside(checkpoint: &Path) -> Vec<PathBuf> {
    let names = checkpoint.file_name().and_then(|name| name.to_str()).map(candidates);
    let mut found: Vec<PathBuf> = Vec::new();
    for name in names.unwrap_or_default() {
        let path = checkpoint.with_file_name(name);
        if path != checkpoint && path.is_file() && !found.contains(&path) {
            found.push(path);
        }
    }
    found
}

/// File names to look for, most specific first.
fn candidates(file_name: &str) -> Vec<String> {
    let stem = file_name.rsplit_once('.').map_or(file_name, |(stem, _extension)| stem);
    let mut names = Vec::new();
    if let Some(rest) = stem.strip_prefix("rl_model_") {
        names.push(format!("rl_model_vecnormalize_{rest}.pkl"));
    }
    names.push(format!("{stem}_vecnormalize.pkl"));
    names.push(format!("normalized_env_{stem}.pkl"));
    names.push(format!("env_{stem}.pkl"));
    if let Some(prefix) = stem.strip_suffix("_model") {
        names.push(format!("{prefix}_env.pkl"));
    }
    // A run's `env.pkl` holds the statistics before its first step: it belongs to the files of an expert folder,
    // not to the numbered checkpoints of a run.
    if !stem.starts_with("rl_model_") {
        names.push("env.pkl".to_owned());
    }
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_folder_called_model_does_not_matter() {
        let folder = tempfile::tempdir().unwrap();
        let run = folder.path().join("my_model_runs");
        let file = |name: &str| {
            let path = run.join(name);
            crate::files::write_atomic(&path, b"x").unwrap();
            path
        };
        let normaliser = file("rl_model_vecnormalize_1000_steps.pkl");
        file("env.pkl");
        assert_eq!(normaliser_beside(&run.join("rl_model_1000_steps.zip")), [normaliser]);
    }

    #[test]
    fn the_published_names_are_known() {
        let first_is = |checkpoint: &str, normaliser: &str| {
            let names = candidates(checkpoint);
            assert!(names.iter().any(|name| name == normaliser), "{checkpoint}: {names:?}");
        };
        first_is("rl_model_49977000_steps.zip", "rl_model_vecnormalize_49977000_steps.pkl");
        first_is("xs_model.zip", "xs_model_vecnormalize.pkl");
        first_is("model.zip", "env.pkl");
        first_is("phase1_final.zip", "normalized_env_phase1_final.pkl");
        first_is("final_period4to6.zip", "env_final_period4to6.pkl");
        first_is("final_model.pkl", "final_env.pkl");
    }

    #[test]
    fn a_normaliser_is_not_its_own() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("env.pkl");
        crate::files::write_atomic(&path, b"x").unwrap();
        assert!(normaliser_beside(&path).is_empty());
    }
}

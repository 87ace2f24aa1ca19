//! Which policy is played when none is named: one order for every command, and for `doctor`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::assets::{AssetError, Cache};
use crate::policy::shelf;

/// Where the released archive puts the final Arnold checkpoint of seed 1 (`spec/tasks.md` §5.5).
const PUBLISHED_ARNOLD: &str = "student_policies/arnold/rl_model_64670238_steps.zip";
/// Folders of it, for archives that hold another step.
const PUBLISHED_RUNS: [&str; 2] = ["student_policies/arnold", "final_checkpoints/arnold"];

/// Where a default policy comes from, first that applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// `$ARNOLD_POLICY`.
    Variable,
    /// The published Arnold checkpoint in the data folder.
    Published,
    /// The elbow baseline that comes with the models.
    Baseline,
}

impl Origin {
    /// Why this one, for people.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::Variable => "named by `$ARNOLD_POLICY`",
            Self::Published => "the published Arnold checkpoint",
            Self::Baseline => "the default: MyoSuite's own elbow baseline",
        }
    }
}

/// The default policy's file, or what a variable names, which may be any name of a policy and need not exist. Fails if the
/// models are not installed and nothing else applies.
pub fn choose(data: &Path, cache: &Cache) -> Result<(PathBuf, Origin), AssetError> {
    if let Some(path) = std::env::var_os("ARNOLD_POLICY").filter(|path: &OsString| !path.is_empty())
    {
        return Ok((path.into(), Origin::Variable));
    }
    let published = data.join(PUBLISHED_ARNOLD);
    let newest =
        || PUBLISHED_RUNS.iter().find_map(|run| shelf::checkpoint_at(&data.join(run)).ok());
    if let Some(published) = Some(published).filter(|path| path.is_file()).or_else(newest) {
        return Ok((published, Origin::Published));
    }
    Ok((cache.npg_elbow_policy()?, Origin::Baseline))
}

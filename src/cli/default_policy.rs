//! Which policy is played when none is named: one order for every command, and for `doctor`.

use std::ffi::OsString;
use std::path::{Path, PathBuf};

use crate::assets::{AssetError, CARRIED, CARRIED_EXPERTS, Cache};
use crate::policy::shelf;

/// Where the released archive puts the final Arnold checkpoint of seed 1 (`spec/tasks.md` §5.5).
const PUBLISHED_ARNOLD: &str = "student_policies/arnold/rl_model_64670238_steps.zip";
/// Folders of it, for archives that hold another step.
const PUBLISHED_RUNS: [&str; 2] = ["student_policies/arnold", "final_checkpoints/arnold"];
/// `MyoSuite`'s own elbow task, which its baseline was trained on and nothing else plays.
const BASELINE_TASK: &str = "myosuite_elbow_pose";

/// Where a default policy comes from, first that applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Origin {
    /// `$ARNOLD_POLICY`.
    Variable,
    /// The elbow baseline that comes with the models, if its task is asked for.
    Baseline,
    /// The published Arnold checkpoint in the data folder.
    Published,
    /// The transformer that the program carries.
    Carried,
}

impl Origin {
    /// Why this one, for people.
    #[must_use]
    pub fn reason(self) -> &'static str {
        match self {
            Self::Variable => "named by `$ARNOLD_POLICY`",
            Self::Baseline => "the default of its task: MyoSuite's own elbow baseline",
            Self::Published => "the published Arnold checkpoint",
            Self::Carried => {
                "the default: the small muscle transformer that comes with this program"
            }
        }
    }
}

/// The default policy for `tasks`: a file, or a name; what a variable names need not exist.
pub fn choose(data: &Path, cache: &Cache, tasks: &[&str]) -> Result<(PathBuf, Origin), AssetError> {
    if let Some(path) = std::env::var_os("ARNOLD_POLICY").filter(|path: &OsString| !path.is_empty())
    {
        return Ok((path.into(), Origin::Variable));
    }
    if tasks.contains(&BASELINE_TASK) {
        return Ok((cache.npg_elbow_policy()?, Origin::Baseline));
    }
    let published = data.join(PUBLISHED_ARNOLD);
    let newest =
        || PUBLISHED_RUNS.iter().find_map(|run| shelf::checkpoint_at(&data.join(run)).ok());
    if let Some(published) = Some(published).filter(|path| path.is_file()).or_else(newest) {
        return Ok((published, Origin::Published));
    }
    // By its place: a file of that name may lie where the program is called.
    Ok((cache.shipped()?.join("student_policies").join(CARRIED), Origin::Carried))
}

/// The folder in which the policy called `name` is looked for: the data folder, unless the program carries it.
pub fn shelf_of(name: &Path, data: &Path, cache: &Cache) -> Result<PathBuf, AssetError> {
    let carried = [CARRIED, CARRIED_EXPERTS].map(Path::new).contains(&name);
    if carried { cache.shipped() } else { Ok(data.to_path_buf()) }
}

//! How well policies do their tasks: solved fractions, benchmark records, comparisons with the experts.

mod ablation;
mod benchmark;
mod capacity;
mod csi_finetuning;
mod families;
mod improvement;
mod published;
mod relative;
mod significance;
mod tables;

pub use ablation::{Change, DOTS, change_against_reference, evenly_spaced};
pub use benchmark::{BenchmarkRecord, EpisodeOutcome, solved_fraction};
pub use capacity::{NETWORK_SIZES, NetworkSize, episode_bar, size_summary};
pub use csi_finetuning::{
    Arm, FROZEN_RUNS, OBC_RUNS, RL_RUNS, component_counts, finetuning_curve, newest_result_file,
};
pub use families::{FAMILIES, HAND_TASKS, METHODS, TABLE_TASKS, family_of};
pub use improvement::{Improvement, improvements};
pub use published::{
    PUBLISHED_IMPROVEMENTS, PUBLISHED_METHODS, PUBLISHED_OVERALL, Printed, PublishedImprovement,
    PublishedMethod,
};
pub use relative::{RelativeMatrix, percent_of};
pub use significance::{MethodTest, against_experts, against_methods};
pub use tables::{FamilyRow, Method, TaskRow, family_rows, task_rows};

/// Why performances cannot be computed or compared.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PerformanceError {
    #[error("there is no episode to average")]
    NoEpisodes,
    #[error("the horizon is zero steps")]
    NoHorizon,
    #[error(
        "episode {episode} has {solved} solved steps, but only {steps} steps, horizon {horizon}"
    )]
    ImpossibleSteps { episode: usize, solved: u32, steps: u32, horizon: u32 },
    #[error("expected one value for each of {expected} tasks, found {found}")]
    TaskCount { expected: usize, found: usize },
    #[error("seed {seed} of `{method}` has no defined value for task `{task}`")]
    MissingTask { method: String, seed: usize, task: String },
    #[error("there is no task called `{task}` among those compared")]
    UnknownTask { task: String },
}

//! Every reference case of factorisations, subspace differences, statistics, performance and learning curves, and the
//! published tables that follow from them.
//!
//! The numbers were recorded from the authors' suite, NumPy, SciPy and scikit-learn; they lie in the `analysis` folder of
//! the golden data (`$ARNOLD_GOLDEN`, else `../shared/golden`).

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "subspaces_parity/benchmarks.rs"]
mod benchmarks;
mod common;
#[path = "subspaces_parity/curves.rs"]
mod curves;
#[path = "subspaces_parity/published.rs"]
mod published;
#[path = "subspaces_parity/statistics.rs"]
mod statistics;
#[path = "subspaces_parity/subspaces.rs"]
mod subspaces;

use common::cases::{Case, Outputs, compare_topic};

/// Compares a topic; at least `cases` of it must be of algorithms that `run` knows, and all of those agree.
fn check(topic: &str, cases: usize, run: fn(&Case) -> Option<Outputs>) {
    let Some(folder) = common::golden("analysis") else { return };
    let (compared, failures) = compare_topic(&folder, topic, run);
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(compared >= cases, "only {compared} cases of {topic} were compared");
}

//! How fast this machine plays: measured against its own limits, in one run.
//!
//! * [`forward`]: a policy's forward pass, as a share of the best single-precision matrix product of one core.
//! * [`whole_loop`]: a rollout beside its parts, the physics alone and the forward pass alone, and two threads beside one.
//! * [`peer`]: the same networks in `PyTorch`, where it is installed.

pub mod forward;
pub mod peer;
pub mod whole_loop;

use std::time::{Duration, Instant};

/// Shortest time of `work` in seconds, which is the run the rest of the machine disturbed least. Runs it once to warm up, then
/// until `budget` is spent, at least once.
pub fn best_time(budget: Duration, mut work: impl FnMut()) -> f64 {
    work();
    let start = Instant::now();
    let mut best = Duration::MAX;
    while start.elapsed() < budget || best == Duration::MAX {
        let begin = Instant::now();
        work();
        best = best.min(begin.elapsed());
    }
    best.as_secs_f64()
}

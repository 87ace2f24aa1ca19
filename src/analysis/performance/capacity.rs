//! How performance depends on the size of the network.
//!
//! * [`size_summary`]: one value per size, the mean over the hand's tasks of relative performance ± s.e.m. over tasks
//!   (divisor n − 1).
//! * [`episode_bar`]: one bar per size and task of a single run, in percent of the expert, whose error is the spread
//!   over **episodes**: `std_solved_steps / horizon / √n / expert · 100`, with the record's population deviation.
//!
//! Degenerate: an expert of zero, a horizon of zero or no episode leave the bar undefined.
//! Oracle: `tests/analysis_parity.rs`, algorithms `capacity_summary`, `capacity_bar`.

use super::super::stats::{Divisor, Summary};
use super::percent_of;

/// A network of the capacity figure.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct NetworkSize {
    /// Name in the result folders.
    pub method: &'static str,
    pub label: &'static str,
    pub parameters: u32,
}

/// The four sizes, largest first.
pub const NETWORK_SIZES: [NetworkSize; 4] = [
    NetworkSize { method: "obc", label: "OBC", parameters: 4_450_564 },
    NetworkSize { method: "obc_m", label: "M", parameters: 890_692 },
    NetworkSize { method: "obc_s", label: "S", parameters: 386_212 },
    NetworkSize { method: "obc_xs", label: "XS", parameters: 104_020 },
];

/// Mean ± s.e.m. over tasks of one size's relative performances, undefined ones left out.
#[must_use]
pub fn size_summary(relative: &[f64]) -> Summary {
    Summary::of(relative, Divisor::CountMinusOne)
}

/// Height and error of a bar, both in percent of the expert.
#[must_use]
pub fn episode_bar(
    expert: f64,
    avg_solved_step_frac: f64,
    std_solved_steps: f64,
    horizon: u32,
    episodes: usize,
) -> Option<(f64, f64)> {
    if expert.is_nan() || expert <= 0.0 || horizon == 0 || episodes == 0 {
        return None;
    }
    let error = std_solved_steps / f64::from(horizon) / (episodes as f64).sqrt();
    Some((percent_of(expert, avg_solved_step_frac), percent_of(expert, error)))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_bar_without_expert_horizon_or_episodes_is_undefined() {
        assert_eq!(episode_bar(0.5, 0.25, 10.0, 100, 4), Some((50.0, 10.0)));
        assert_eq!(episode_bar(0.0, 0.25, 10.0, 100, 4), None);
        assert_eq!(episode_bar(f64::NAN, 0.25, 10.0, 100, 4), None);
        assert_eq!(episode_bar(0.5, 0.25, 10.0, 0, 4), None);
        assert_eq!(episode_bar(0.5, 0.25, 10.0, 100, 0), None);
    }

    #[test]
    fn sizes_fall() {
        assert!(NETWORK_SIZES.is_sorted_by(|a, b| a.parameters > b.parameters));
    }
}

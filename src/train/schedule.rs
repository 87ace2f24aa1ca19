//! How large a step is, by the progress of the run (`spec/training.md` §5.7).
//!
//! Progress remaining p falls from 1 to 0 over a run. A published run has one rate, then a second phase with a smaller one.
//! The cosine is the published one: it starts at its lower rate, peaks in the middle and returns,
//! `lo + ½(hi − lo)(1 + cos(π(1 − 2p)))`. The linear schedule is ours.

use std::f64::consts::PI;

use serde::{Deserialize, Serialize};

/// Learning rate over a run.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case", deny_unknown_fields)]
pub enum Schedule {
    Constant(f64),
    /// Falls from the first to the second rate.
    Linear {
        from: f64,
        to: f64,
    },
    /// Rises from `low` to `high` and falls back.
    Cosine {
        low: f64,
        high: f64,
    },
    /// The first rate, and the second for the last `share` of the run.
    Phases {
        first: f64,
        second: f64,
        share: f64,
    },
}

impl Schedule {
    /// The rate after `done` of `total` steps.
    #[must_use]
    pub fn rate(&self, done: u64, total: u64) -> f64 {
        let remaining = 1.0 - (done as f64 / total.max(1) as f64).min(1.0);
        match *self {
            Self::Constant(rate) => rate,
            Self::Linear { from, to } => to + (from - to) * remaining,
            Self::Cosine { low, high } => {
                low + 0.5 * (high - low) * (1.0 + (PI * (1.0 - 2.0 * remaining)).cos())
            }
            Self::Phases { first, second, share } => {
                if remaining > share {
                    first
                } else {
                    second
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn close(a: f64, b: f64) -> bool {
        (a - b).abs() < 1e-12
    }

    #[test]
    fn the_cosine_peaks_in_the_middle_and_returns() {
        let cosine = Schedule::Cosine { low: 1e-5, high: 1e-3 };
        let rates = [0, 25, 50, 75, 100].map(|done| cosine.rate(done, 100));
        let expected = [1e-5, 5.05e-4, 1e-3, 5.05e-4, 1e-5];
        assert!(rates.iter().zip(expected).all(|(a, b)| close(*a, b)), "{rates:?}");
    }

    #[test]
    fn the_second_phase_is_as_long_as_it_says() {
        let phases = Schedule::Phases { first: 1e-3, second: 1e-5, share: 0.1 };
        let rates = [0, 89, 91, 99].map(|done| phases.rate(done, 100));
        assert!(rates.iter().zip([1e-3, 1e-3, 1e-5, 1e-5]).all(|(a, b)| close(*a, b)));
    }

    #[test]
    fn a_line_ends_where_it_should_and_stays_there() {
        let line = Schedule::Linear { from: 3.0, to: 1.0 };
        let rates = [0, 5, 10, 12].map(|done| line.rate(done, 10));
        assert!(rates.iter().zip([3.0, 2.0, 1.0, 1.0]).all(|(a, b)| close(*a, b)));
        assert!(close(Schedule::Constant(0.5).rate(7, 0), 0.5));
    }
}

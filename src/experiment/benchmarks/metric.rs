//! Which number of a benchmark record counts as performance.

use crate::record::BenchmarkEntry;

/// A metric for every task.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum MetricMap {
    /// The solved fraction everywhere: solved steps / horizon.
    #[default]
    Fraction,
    /// As the radar of the authors' first release: the share of episodes that were solved at any step, for die and object;
    /// the solved fraction everywhere else.
    Radar,
}

impl MetricMap {
    /// Its name, as asked for.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Fraction => "fraction",
            Self::Radar => "radar",
        }
    }

    /// What it says of itself in a caption; nothing for the usual one.
    #[must_use]
    pub fn note(self) -> &'static str {
        match self {
            Self::Fraction => "",
            Self::Radar => {
                " Die reorient and Object relocation: share of episodes solved at any step."
            }
        }
    }

    fn counts_episodes(self, task: &str) -> bool {
        self == Self::Radar && ["reorient", "relocate"].contains(&task)
    }

    /// The performance in `task`, a share; nothing where the record does not say.
    #[must_use]
    pub fn of(self, task: &str, entry: &BenchmarkEntry) -> Option<f64> {
        if self.counts_episodes(task) { entry.avg_solved } else { entry.avg_solved_step_frac }
    }

    /// The performance of one episode, from its solved fraction.
    #[must_use]
    pub fn of_episode(self, task: &str, fraction: f64) -> f64 {
        if self.counts_episodes(task) && fraction > 0.0 { 1.0 } else { fraction }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_first_release_counted_episodes_in_two_tasks() {
        let entry = BenchmarkEntry {
            avg_solved: Some(0.9),
            avg_solved_step_frac: Some(0.4),
            ..BenchmarkEntry::default()
        };
        assert_eq!(MetricMap::Radar.of("reorient", &entry), Some(0.9));
        assert_eq!(MetricMap::Radar.of("pen", &entry), Some(0.4));
        assert_eq!(MetricMap::Fraction.of("reorient", &entry), Some(0.4));
        let of_episode = |fraction: f64| MetricMap::Radar.of_episode("relocate", fraction);
        assert!(of_episode(0.0) == 0.0 && (of_episode(0.01) - 1.0).abs() < 1e-15);
    }
}

//! The paper's printed tables of performance, to be shown beside one's own numbers.
//!
//! In percent of the experts, mean and s.e.m. over seeds, with the decimals that are printed. Tasks in the order of
//! [`TABLE_TASKS`], families in that of [`super::FAMILIES`] with the average over all tasks last. Tests are those of
//! [`super::against_methods`] and [`super::improvements`].
//!
//! Chiappa, An, Simos, Li, Mathis 2025, arXiv:2508.18066. Oracle: `tests/performance_published.rs`.

use super::{FAMILIES, TABLE_TASKS};

/// A mean and its standard error.
pub type Printed = (f64, f64);

/// The rows of one method.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PublishedMethod {
    /// Name in the result folders.
    pub name: &'static str,
    pub seeds: usize,
    /// Means and their errors.
    tasks: ([f64; 14], [f64; 14]),
    /// The same of six families and the average.
    families: ([f64; 7], [f64; 7]),
    /// Rank-biserial correlation, W and Holm p of Arnold against it.
    pub test: Option<(f64, f64, f64)>,
}

/// Arnold against the expert of one task.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PublishedImprovement {
    pub task: &'static str,
    /// Solved fraction of the expert.
    pub expert: f64,
    /// Solved fraction of Arnold with its s.e.m.
    pub arnold: Printed,
    /// In percent of the expert, with its s.e.m.
    pub improvement: Printed,
    pub t: f64,
    pub p_holm: f64,
    /// Whether p is printed as "below".
    pub p_is_bound: bool,
}

/// W and p of Arnold against the experts, over the fourteen tasks, not corrected.
pub const PUBLISHED_OVERALL: (f64, f64) = (15.0, 0.0166);

impl PublishedMethod {
    /// The method called `name`.
    #[must_use]
    pub fn find(name: &str) -> Option<&'static Self> {
        PUBLISHED_METHODS.iter().find(|method| method.name == name)
    }

    /// Its value in `task`.
    #[must_use]
    pub fn task(&self, task: &str) -> Option<Printed> {
        let place = TABLE_TASKS.iter().position(|known| *known == task)?;
        Some((self.tasks.0[place], self.tasks.1[place]))
    }

    /// Its value in a family, or in `avg`.
    #[must_use]
    pub fn family(&self, family: &str) -> Option<Printed> {
        let mut names = FAMILIES.iter().map(|(name, _)| *name).chain(["avg"]);
        let place = names.position(|known| known == family)?;
        Some((self.families.0[place], self.families.1[place]))
    }
}

impl PublishedImprovement {
    /// The row of `task`.
    #[must_use]
    pub fn find(task: &str) -> Option<&'static Self> {
        PUBLISHED_IMPROVEMENTS.iter().find(|row| row.task == task)
    }
}

/// The ten methods in the order of the table.
pub const PUBLISHED_METHODS: [PublishedMethod; 10] = [
    PublishedMethod {
        name: "arnold",
        seeds: 5,
        tasks: (
            [
                99.9, 100.0, 100.0, 100.0, 103.3, 113.9, 98.9, 102.9, 106.1, 107.1, 110.1, 102.2,
                99.6, 121.3,
            ],
            [0.0, 0.0, 0.0, 0.0, 0.4, 0.1, 0.4, 1.5, 0.8, 1.0, 0.3, 0.4, 1.1, 1.3],
        ),
        families: (
            [100.7, 113.9, 103.8, 106.1, 99.6, 121.3, 104.7],
            [0.1, 0.1, 0.6, 0.1, 1.1, 1.3, 0.2],
        ),
        test: None,
    },
    PublishedMethod {
        name: "mt_sac",
        seeds: 3,
        tasks: (
            [0.0, 0.0, 0.0, 0.0, 0.3, 20.1, 6.4, 6.7, 1.8, 3.5, 0.8, 0.0, 0.0, 0.3],
            [0.0, 0.0, 0.0, 0.0, 0.0, 3.6, 3.6, 3.7, 0.5, 1.9, 0.0, 0.0, 0.0, 0.2],
        ),
        families: ([0.1, 20.1, 4.6, 0.4, 0.0, 0.3, 2.8], [0.0, 3.6, 2.1, 0.0, 0.0, 0.2, 0.8]),
        test: Some((1.0, 0.0, 0.0011)),
    },
    PublishedMethod {
        name: "mt_ppo",
        seeds: 3,
        tasks: (
            [57.8, 18.4, 47.9, 41.6, 9.1, 113.5, 61.2, 19.2, 5.6, 29.1, 2.4, 26.5, 0.0, 0.4],
            [17.4, 18.4, 16.5, 22.4, 4.8, 0.1, 4.0, 3.0, 0.4, 2.0, 0.4, 4.1, 0.0, 0.2],
        ),
        families: ([35.0, 113.5, 28.8, 14.4, 0.0, 0.4, 30.9], [9.5, 0.1, 2.0, 1.9, 0.0, 0.2, 4.0]),
        test: Some((1.0, 0.0, 0.0011)),
    },
    PublishedMethod {
        name: "ppo_t",
        seeds: 3,
        tasks: (
            [4.2, 0.0, 0.0, 0.0, 5.3, 18.3, 6.0, 6.4, 4.7, 3.0, 3.0, 1.8, 0.0, 0.3],
            [4.2, 0.0, 0.0, 0.0, 4.6, 1.2, 4.9, 5.6, 4.6, 2.7, 1.9, 1.3, 0.0, 0.2],
        ),
        families: ([1.9, 18.3, 5.0, 2.4, 0.0, 0.3, 3.8], [1.8, 1.2, 4.4, 1.6, 0.0, 0.2, 2.2]),
        test: Some((1.0, 0.0, 0.0011)),
    },
    PublishedMethod {
        name: "ppo_t_sv",
        seeds: 3,
        tasks: (
            [93.2, 94.2, 90.0, 91.8, 44.6, 110.1, 20.3, 25.9, 21.7, 49.1, 3.1, 15.6, 0.0, 0.5],
            [0.6, 1.9, 2.5, 1.0, 2.4, 0.6, 0.6, 3.8, 1.8, 9.7, 0.2, 2.8, 0.0, 0.1],
        ),
        families: ([82.8, 110.1, 29.2, 9.4, 0.0, 0.5, 47.2], [1.2, 0.6, 3.1, 1.4, 0.0, 0.1, 1.1]),
        test: Some((1.0, 0.0, 0.0011)),
    },
    PublishedMethod {
        name: "bc",
        seeds: 3,
        tasks: (
            [99.7, 99.1, 99.6, 99.3, 92.1, 97.2, 61.9, 34.4, 82.0, 90.6, 84.2, 102.3, 86.1, 7.1],
            [0.1, 0.3, 0.3, 0.3, 2.5, 0.1, 2.8, 2.7, 1.7, 1.3, 7.1, 0.4, 1.7, 0.8],
        ),
        families: ([98.0, 97.2, 67.2, 93.3, 86.1, 7.1, 81.1], [0.5, 0.1, 1.9, 3.6, 1.7, 0.8, 1.1]),
        test: Some((0.981, 1.0, 0.0011)),
    },
    PublishedMethod {
        name: "obc_task_sv",
        seeds: 3,
        tasks: (
            [98.6, 79.3, 98.7, 74.5, 89.1, 96.8, 27.3, 47.6, 67.7, 72.8, 75.9, 65.0, 46.9, 16.8],
            [1.1, 16.7, 0.6, 16.1, 7.9, 0.5, 3.0, 13.7, 6.0, 6.9, 2.1, 14.2, 4.6, 11.1],
        ),
        families: (
            [88.1, 96.8, 53.8, 70.4, 46.9, 16.8, 68.3],
            [0.1, 0.5, 5.8, 7.9, 4.6, 11.1, 3.5],
        ),
        test: Some((1.0, 0.0, 0.0011)),
    },
    PublishedMethod {
        name: "obc_wo_obs_norm",
        seeds: 5,
        tasks: (
            [99.8, 99.6, 99.9, 99.8, 95.9, 97.6, 71.1, 49.0, 75.6, 78.4, 89.6, 97.6, 74.4, 63.0],
            [0.0, 0.3, 0.0, 0.1, 3.1, 0.5, 13.4, 5.4, 1.7, 2.0, 0.8, 1.4, 3.9, 6.0],
        ),
        families: ([99.0, 97.6, 68.5, 93.6, 74.4, 63.0, 85.1], [0.6, 0.5, 4.1, 0.7, 3.9, 6.0, 1.0]),
        test: Some((1.0, 0.0, 0.0011)),
    },
    PublishedMethod {
        name: "obc_ppo",
        seeds: 5,
        tasks: (
            [
                99.9, 100.0, 100.0, 100.0, 103.2, 97.3, 97.2, 66.7, 91.6, 87.7, 94.6, 100.2, 96.4,
                89.2,
            ],
            [0.0, 0.0, 0.0, 0.0, 0.1, 0.1, 1.1, 14.7, 4.0, 4.8, 3.4, 1.3, 2.3, 2.0],
        ),
        families: (
            [100.6, 97.3, 85.8, 97.4, 96.4, 89.2, 94.6],
            [0.0, 0.1, 5.9, 2.2, 2.3, 2.0, 2.1],
        ),
        test: Some((0.981, 1.0, 0.0011)),
    },
    PublishedMethod {
        name: "obc",
        seeds: 5,
        tasks: (
            [
                99.9, 100.0, 100.0, 100.0, 102.7, 97.3, 98.6, 98.1, 94.3, 93.9, 97.6, 102.5, 99.1,
                91.4,
            ],
            [0.0, 0.0, 0.0, 0.0, 0.7, 0.0, 0.2, 3.6, 2.2, 1.3, 0.5, 0.4, 1.4, 3.4],
        ),
        families: (
            [100.5, 97.3, 96.2, 100.1, 99.1, 91.4, 98.2],
            [0.1, 0.0, 1.3, 0.3, 1.4, 3.4, 0.3],
        ),
        test: Some((0.79, 11.0, 0.0067)),
    },
];

/// The fourteen tasks in the order of the table.
pub const PUBLISHED_IMPROVEMENTS: [PublishedImprovement; 14] = [
    row("hand_index_reach", [0.963, 0.962, 0.0, -0.1, 0.01, -19.803, 1.0]),
    row("hand_little_reach", [0.921, 0.921, 0.0, 0.04, 0.0, 12.78, 0.0012]),
    row("hand_middle_reach", [0.953, 0.953, 0.0, 0.01, 0.01, 1.129, 0.6816]),
    row("hand_ring_reach", [0.956, 0.956, 0.0, 0.02, 0.02, 1.271, 0.6816]),
    row("hand_thumb_reach", [0.483, 0.499, 0.002, 3.3, 0.39, 8.424, 0.0054]),
    bounded("elbow_pose", [0.849, 0.967, 0.001, 13.9, 0.12, 111.254, 0.0001]),
    row("baoding_p1_cw", [0.955, 0.944, 0.003, -1.15, 0.35, -3.263, 1.0]),
    row("baoding_p1_ccw", [0.915, 0.942, 0.014, 2.91, 1.5, 1.941, 0.3727]),
    row("baoding_p2", [0.541, 0.574, 0.004, 6.14, 0.79, 7.746, 0.0067]),
    row("baoding_p2_overlap", [0.641, 0.687, 0.006, 7.14, 0.96, 7.463, 0.0069]),
    bounded("reorient", [0.701, 0.772, 0.002, 10.08, 0.33, 30.907, 0.0001]),
    row("pen", [0.652, 0.666, 0.003, 2.2, 0.44, 5.023, 0.0258]),
    row("relocate", [0.339, 0.337, 0.004, -0.42, 1.06, -0.398, 1.0]),
    row("kinesis", [0.404, 0.489, 0.005, 21.29, 1.34, 15.854, 0.0006]),
];

/// A row as it is printed: expert, Arnold ± s.e.m., improvement ± s.e.m., t, p.
const fn row(task: &'static str, cells: [f64; 7]) -> PublishedImprovement {
    let [expert, arnold, arnold_sem, improvement, improvement_sem, t, p_holm] = cells;
    PublishedImprovement {
        task,
        expert,
        arnold: (arnold, arnold_sem),
        improvement: (improvement, improvement_sem),
        t,
        p_holm,
        p_is_bound: false,
    }
}

/// The same where p is printed as below a bound.
const fn bounded(task: &'static str, cells: [f64; 7]) -> PublishedImprovement {
    PublishedImprovement { p_is_bound: true, ..row(task, cells) }
}

#[cfg(test)]
mod tests {
    use super::super::METHODS;
    use super::*;

    #[test]
    fn the_printed_averages_are_the_means_of_the_printed_tasks() {
        for (method, (name, _)) in PUBLISHED_METHODS.iter().zip(METHODS) {
            assert_eq!(method.name, name);
            let mean = method.tasks.0.iter().sum::<f64>() / 14.0;
            let (printed, _) = method.family("avg").unwrap();
            // Both are rounded to one decimal.
            assert!((mean - printed).abs() < 0.1, "{name}: {mean} {printed}");
        }
    }

    #[test]
    fn values_are_found_by_name() {
        let arnold = PublishedMethod::find("arnold").unwrap();
        assert_eq!(arnold.task("kinesis"), Some((121.3, 1.3)));
        assert_eq!(
            (arnold.family("reorient"), arnold.task("juggling")),
            (Some((106.1, 0.1)), None)
        );
        assert!(PublishedMethod::find("npg").is_none());
        assert_eq!(PublishedImprovement::find("pen").unwrap().improvement, (2.2, 0.44));
    }
}

//! Tables of smoothness: episodes, task means, comparisons of policies. Columns are spelled as upstream spells them.
//!
//! A task mean is the plain mean over its episodes, a hundred in the paper. An episode without a value is an error, so
//! that no mean is of fewer episodes than its table says; skipping it is an option, and the number used is written.
//!
//! Policies are compared pair by pair over the task means: Wilcoxon's signed-rank test, two-sided, zeros kept in the
//! ranking, Holm-corrected over the pairs of one metric. Equal means in every task give W 0, p 1.
//!
//! Oracle: `tests/signals_parity.rs`, algorithm `smoothness_significance`.

use serde::Serialize;

use super::{Smoothness, SmoothnessError};
use crate::analysis::stats::{Sidedness, Wilcoxon, Zeros, holm, wilcoxon};
use crate::analysis::undefined::Undefined;

/// The four numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    ActionChange,
    SpectralArcLength,
    DimensionlessJerk,
    VelocityPeaks,
}

impl Metric {
    /// In the order of the columns.
    pub const ALL: [Self; 4] =
        [Self::ActionChange, Self::SpectralArcLength, Self::DimensionlessJerk, Self::VelocityPeaks];

    /// Name of the column.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::ActionChange => "mean_abs_diff",
            Self::SpectralArcLength => "sparc",
            Self::DimensionlessJerk => "ldlj_kin",
            Self::VelocityPeaks => "nvp",
        }
    }

    /// Whether a larger value is smoother.
    #[must_use]
    pub fn higher_is_smoother(self) -> bool {
        matches!(self, Self::SpectralArcLength | Self::DimensionlessJerk)
    }

    /// Its value in an episode.
    #[must_use]
    pub fn of(self, smoothness: &Smoothness) -> Option<f64> {
        match self {
            Self::ActionChange => smoothness.mean_abs_diff,
            Self::SpectralArcLength => smoothness.sparc,
            Self::DimensionlessJerk => smoothness.ldlj_kin,
            Self::VelocityPeaks => smoothness.nvp,
        }
    }
}

/// A row of `per_episode.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct EpisodeRow {
    pub policy: String,
    pub task: String,
    pub episode: u64,
    /// Executed steps.
    pub episode_length: usize,
    #[serde(flatten)]
    pub smoothness: Smoothness,
}

/// A row of `per_task.csv`: means over episodes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct TaskRow {
    pub policy: String,
    pub task: String,
    #[serde(flatten)]
    pub means: Smoothness,
    /// Episodes measured.
    pub episodes: usize,
    /// Episodes behind each mean, in the order of [`Metric::ALL`]; fewer only where undefined values were skipped.
    pub used: [usize; 4],
}

/// The task means of the `episodes` of one policy in one task, of which there must be `required`.
pub fn task_row(
    policy: &str,
    task: &str,
    episodes: &[EpisodeRow],
    required: usize,
    undefined: Undefined,
) -> Result<TaskRow, SmoothnessError> {
    if episodes.len() != required {
        return Err(SmoothnessError::EpisodeCount {
            policy: policy.to_owned(),
            task: task.to_owned(),
            expected: required,
            found: episodes.len(),
        });
    }
    let mut means = [None; 4];
    let mut used = [0; 4];
    for (place, metric) in Metric::ALL.into_iter().enumerate() {
        let values = || episodes.iter().map(|row| metric.of(&row.smoothness));
        let missing = episodes.iter().find(|row| metric.of(&row.smoothness).is_none());
        if let (Some(row), Undefined::Propagate) = (missing, undefined) {
            return Err(SmoothnessError::Undefined {
                metric: metric.name(),
                policy: policy.to_owned(),
                task: task.to_owned(),
                episode: row.episode,
            });
        }
        used[place] = values().flatten().count();
        means[place] = undefined.mean(values());
    }
    let [mean_abs_diff, sparc, ldlj_kin, nvp] = means;
    Ok(TaskRow {
        policy: policy.to_owned(),
        task: task.to_owned(),
        means: Smoothness { mean_abs_diff, sparc, ldlj_kin, nvp },
        episodes: episodes.len(),
        used,
    })
}

/// A row of `comparisons.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparisonRow {
    pub metric: &'static str,
    pub a: String,
    pub b: String,
    pub n_tasks: usize,
    #[serde(rename = "W")]
    pub w: Option<f64>,
    pub p_raw: Option<f64>,
    pub p_holm: Option<f64>,
}

/// Every policy against every later one, for every metric. `policies` holds the name of each policy and its rows, one
/// per entry of `tasks`, in any order; a task without a row or a mean is an error.
pub fn comparisons(
    policies: &[(String, Vec<TaskRow>)],
    tasks: &[String],
) -> Result<Vec<ComparisonRow>, SmoothnessError> {
    let mut rows = Vec::new();
    for metric in Metric::ALL {
        let values = policies
            .iter()
            .map(|(policy, rows)| task_means(metric, policy, rows, tasks))
            .collect::<Result<Vec<Vec<f64>>, _>>()?;
        rows.extend(compare(metric, policies, &values));
    }
    Ok(rows)
}

/// The means of one policy in the order of `tasks`.
fn task_means(
    metric: Metric,
    policy: &str,
    rows: &[TaskRow],
    tasks: &[String],
) -> Result<Vec<f64>, SmoothnessError> {
    let mean = |task: &String| {
        let row = rows.iter().find(|row| row.task == *task);
        row.and_then(|row| metric.of(&row.means)).ok_or_else(|| SmoothnessError::MissingTask {
            metric: metric.name(),
            policy: policy.to_owned(),
            task: task.clone(),
        })
    };
    tasks.iter().map(mean).collect()
}

/// All pairs of one metric, which are one family of tests.
fn compare(
    metric: Metric,
    policies: &[(String, Vec<TaskRow>)],
    values: &[Vec<f64>],
) -> Vec<ComparisonRow> {
    let count = policies.len();
    let pairs: Vec<(usize, usize)> =
        (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))).collect();
    let test = |&(a, b): &(usize, usize)| -> Option<Wilcoxon> {
        let differences: Vec<f64> = values[a].iter().zip(&values[b]).map(|(a, b)| a - b).collect();
        wilcoxon(&differences, Zeros::Keep, Sidedness::TwoSided)
    };
    let tests: Vec<Option<Wilcoxon>> = pairs.iter().map(test).collect();
    let raw: Vec<f64> = tests.iter().map(|test| test.map_or(f64::NAN, |test| test.p)).collect();
    let rows = pairs.iter().zip(&tests).zip(holm(&raw));
    rows.map(|((&(a, b), test), corrected)| ComparisonRow {
        metric: metric.name(),
        a: policies[a].0.clone(),
        b: policies[b].0.clone(),
        n_tasks: values[a].len(),
        w: test.map(|test| test.statistic),
        p_raw: test.map(|test| test.p),
        p_holm: test.map(|_| corrected),
    })
    .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn episode(number: u64, sparc: Option<f64>) -> EpisodeRow {
        EpisodeRow {
            policy: "expert".to_owned(),
            task: "pen".to_owned(),
            episode: number,
            episode_length: 100,
            smoothness: Smoothness {
                mean_abs_diff: Some(0.1),
                sparc,
                ldlj_kin: Some(-20.0),
                nvp: Some(number as f64),
            },
        }
    }

    #[test]
    fn one_undefined_episode_is_an_error_that_names_it_unless_it_is_skipped() {
        let episodes = [episode(3, Some(-2.0)), episode(7, None), episode(9, Some(-3.0))];
        let of = |undefined| task_row("expert", "pen", &episodes, 3, undefined);
        assert_eq!(
            of(Undefined::Propagate),
            Err(SmoothnessError::Undefined {
                metric: "sparc",
                policy: "expert".to_owned(),
                task: "pen".to_owned(),
                episode: 7
            })
        );
        let row = of(Undefined::Skip).unwrap();
        assert_eq!((row.means.sparc, row.used, row.episodes), (Some(-2.5), [3, 2, 3, 3], 3));
    }

    #[test]
    fn another_number_of_episodes_is_refused() {
        let found = task_row("expert", "pen", &[episode(0, None)], 100, Undefined::Skip);
        assert!(matches!(
            found,
            Err(SmoothnessError::EpisodeCount { expected: 100, found: 1, .. })
        ));
        assert!(task_row("expert", "pen", &[], 0, Undefined::Skip).unwrap().means.nvp.is_none());
    }

    #[test]
    fn rows_are_spelled_as_upstream_spells_them() {
        let row = serde_json::to_value(episode(1, None)).unwrap();
        let names: Vec<&str> = row.as_object().unwrap().keys().map(String::as_str).collect();
        let upstream = "policy task episode episode_length mean_abs_diff sparc ldlj_kin nvp";
        assert_eq!(names.join(" "), upstream);
        assert!(row["sparc"].is_null());
        for (metric, name) in Metric::ALL.into_iter().zip(&names[4..]) {
            assert_eq!(metric.name(), *name);
        }
    }

    #[test]
    fn policies_are_compared_by_task_whatever_the_order_of_their_rows() {
        let tasks = ["a", "b", "c"].map(str::to_owned);
        let rows = |policy: &str, sparc: [f64; 3]| -> (String, Vec<TaskRow>) {
            let row = |(task, sparc): (&String, f64)| {
                let episodes = [episode(0, Some(sparc))];
                task_row(policy, task, &episodes, 1, Undefined::Propagate).unwrap()
            };
            (policy.to_owned(), tasks.iter().zip(sparc).map(row).collect())
        };
        let mut policies = [rows("expert", [-2.0, -3.0, -4.0]), rows("obc", [-1.0, -1.5, -1.0])];
        policies[1].1.reverse();
        let found = comparisons(&policies, &tasks).unwrap();
        assert_eq!(found.len(), 4);
        assert_eq!((found[1].metric, found[1].n_tasks), ("sparc", 3));
        // Three differences of one sign: 2 of the 8 sign assignments are as extreme.
        assert_eq!(
            (found[1].w, found[1].p_raw, found[1].p_holm),
            (Some(0.0), Some(0.25), Some(0.25))
        );
        assert_eq!((found[0].w, found[0].p_raw), (Some(0.0), Some(1.0)));
        let row = serde_json::to_value(&found[0]).unwrap();
        let names: Vec<&str> = row.as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(names.join(" "), "metric a b n_tasks W p_raw p_holm");

        policies[0].1.pop();
        assert_eq!(
            comparisons(&policies, &tasks),
            Err(SmoothnessError::MissingTask {
                metric: "mean_abs_diff",
                policy: "expert".to_owned(),
                task: "c".to_owned()
            })
        );
    }
}

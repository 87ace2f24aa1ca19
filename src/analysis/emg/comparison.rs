//! Tables of the comparison with people, and the test between policies. Columns are spelled as upstream spells them.
//!
//! Two policies are compared by Fisher's z of each person's mean correlation: Wilcoxon's signed-rank test, paired over
//! people, two-sided, zeros dropped; p times the number of pairs, at most 1 (Bonferroni). The ceiling is not tested.
//!
//! Degenerate: a person without a mean makes the test undefined; equal means in everybody give W 0, p 1.
//!
//! Oracle: `tests/signals_parity.rs`, algorithm `emg_comparison`, and `emg_real`.

use serde::Serialize;

use super::{Correlations, EmgError, HUMAN_CHANNELS, HumanProfiles, Segmentation, Verdict};
use crate::analysis::stats::{Sidedness, Wilcoxon, Zeros, bonferroni, fisher_z, wilcoxon};
use crate::analysis::undefined::Undefined;
use crate::units::Hertz;

/// A row of `correlations.csv`. The human reference is policy `Human`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CorrelationRow {
    pub policy: String,
    pub subject: u32,
    pub muscle: &'static str,
    pub r: Option<f64>,
}

/// A row of `subject_means.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SubjectRow {
    pub policy: String,
    pub subject: u32,
    pub r: Option<f64>,
}

/// A row of `gait_cycles.csv`, which upstream does not have.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CycleRow {
    pub policy: String,
    pub episode: usize,
    pub start: usize,
    pub end: usize,
    pub duration_s: f64,
    /// Mean forward speed, m/s.
    pub mean_v: f64,
    pub kept: bool,
    /// Why it is not kept: `short`, `long`, `slow`.
    pub reason: &'static str,
}

/// One row per person and muscle.
#[must_use]
pub fn correlation_rows(
    policy: &str,
    people: &HumanProfiles,
    correlations: &Correlations,
) -> Vec<CorrelationRow> {
    let rows = people.subjects().iter().zip(correlations.rows());
    rows.flat_map(|(&subject, row)| {
        HUMAN_CHANNELS.iter().zip(row).map(move |(&muscle, &r)| CorrelationRow {
            policy: policy.to_owned(),
            subject,
            muscle,
            r,
        })
    })
    .collect()
}

/// One row per person: the mean over muscles, less those at the places `without`.
#[must_use]
pub fn subject_rows(
    policy: &str,
    people: &HumanProfiles,
    correlations: &Correlations,
    without: &[usize],
    undefined: Undefined,
) -> Vec<SubjectRow> {
    let means = correlations.row_means(without, undefined);
    let row = |(&subject, r)| SubjectRow { policy: policy.to_owned(), subject, r };
    people.subjects().iter().zip(means).map(row).collect()
}

/// One row per detected cycle.
#[must_use]
pub fn cycle_rows(policy: &str, segmentation: &Segmentation, sample_rate: Hertz) -> Vec<CycleRow> {
    let cycles = segmentation.cycles.iter();
    cycles
        .map(|cycle| CycleRow {
            policy: policy.to_owned(),
            episode: cycle.episode,
            start: cycle.start,
            end: cycle.end,
            duration_s: cycle.duration() as f64 / sample_rate,
            mean_v: cycle.mean_speed,
            kept: cycle.verdict == Verdict::Kept,
            reason: cycle.verdict.reason(),
        })
        .collect()
}

/// A row of `comparisons.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ComparisonRow {
    pub a: String,
    pub b: String,
    pub n_subjects: usize,
    #[serde(rename = "W")]
    pub w: Option<f64>,
    pub p_raw: Option<f64>,
    pub p_bonferroni: Option<f64>,
    /// Effect size: (W⁺ − W⁻)/(W⁺ + W⁻). Not a column of upstream's.
    pub rank_biserial: Option<f64>,
}

/// Every policy against every later one; each has its subject means in the order of the same people.
pub fn comparisons(
    policies: &[(String, Vec<Option<f64>>)],
) -> Result<Vec<ComparisonRow>, EmgError> {
    let expected = policies.first().map_or(0, |(_, means)| means.len());
    if let Some((policy, means)) = policies.iter().find(|(_, means)| means.len() != expected) {
        let (policy, found) = (policy.clone(), means.len());
        return Err(EmgError::SubjectCount { policy, expected, found });
    }
    let z = |means: &[Option<f64>]| -> Option<Vec<f64>> {
        means.iter().map(|mean| mean.map(fisher_z)).collect()
    };
    let test = |a: &[Option<f64>], b: &[Option<f64>]| -> Option<Wilcoxon> {
        let differences: Vec<f64> = z(a)?.iter().zip(z(b)?).map(|(a, b)| a - b).collect();
        wilcoxon(&differences, Zeros::Drop, Sidedness::TwoSided)
    };
    let count = policies.len();
    let pairs: Vec<(usize, usize)> =
        (0..count).flat_map(|a| (a + 1..count).map(move |b| (a, b))).collect();
    let tests: Vec<Option<Wilcoxon>> =
        pairs.iter().map(|&(a, b)| test(&policies[a].1, &policies[b].1)).collect();
    let raw: Vec<f64> = tests.iter().map(|test| test.map_or(f64::NAN, |test| test.p)).collect();
    let rows = pairs.iter().zip(&tests).zip(bonferroni(&raw));
    let row =
        |((&(a, b), test), corrected): ((&(usize, usize), &Option<Wilcoxon>), f64)| ComparisonRow {
            a: policies[a].0.clone(),
            b: policies[b].0.clone(),
            n_subjects: expected,
            w: test.map(|test| test.statistic),
            p_raw: test.map(|test| test.p),
            p_bonferroni: test.map(|_| corrected),
            rank_biserial: test.map(|test| test.rank_biserial),
        };
    Ok(rows.map(row).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn policy(name: &str, means: &[f64]) -> (String, Vec<Option<f64>>) {
        (name.to_owned(), means.iter().map(|&mean| Some(mean)).collect())
    }

    #[test]
    fn nine_people_who_agree_have_the_least_possible_p_value() {
        let better: Vec<f64> = (0..9).map(|i| 0.5 + 0.03 * f64::from(i)).collect();
        let worse: Vec<f64> = (0..9).map(|i| 0.3 + 0.02 * f64::from(i)).collect();
        let policies =
            [policy("arnold", &better), policy("obc", &worse), policy("kinesis", &worse)];
        let rows = comparisons(&policies).unwrap();
        let names: Vec<(&str, &str)> = rows.iter().map(|r| (r.a.as_str(), r.b.as_str())).collect();
        assert_eq!(names, [("arnold", "obc"), ("arnold", "kinesis"), ("obc", "kinesis")]);
        assert_eq!((rows[0].w, rows[0].p_raw), (Some(0.0), Some(2.0 / 512.0)));
        assert_eq!((rows[0].p_bonferroni, rows[0].rank_biserial), (Some(6.0 / 512.0), Some(1.0)));
        assert_eq!(
            (rows[2].w, rows[2].p_raw, rows[2].p_bonferroni),
            (Some(0.0), Some(1.0), Some(1.0))
        );
    }

    #[test]
    fn a_person_without_a_mean_leaves_the_test_undefined() {
        let mut policies = [policy("arnold", &[0.5, 0.6]), policy("obc", &[0.1, 0.2])];
        policies[1].1[0] = None;
        let rows = comparisons(&policies).unwrap();
        assert_eq!((rows[0].w, rows[0].p_raw, rows[0].p_bonferroni), (None, None, None));
        let row = serde_json::to_value(&rows[0]).unwrap();
        let names: Vec<&str> = row.as_object().unwrap().keys().map(String::as_str).collect();
        assert_eq!(names[..6].join(" "), "a b n_subjects W p_raw p_bonferroni");
    }

    #[test]
    fn policies_with_other_people_are_refused() {
        let policies = [policy("arnold", &[0.5, 0.6]), policy("obc", &[0.1])];
        assert_eq!(
            comparisons(&policies),
            Err(EmgError::SubjectCount { policy: "obc".to_owned(), expected: 2, found: 1 })
        );
        assert_eq!(comparisons(&[]), Ok(Vec::new()));
    }
}

//! Which sets of actions are compared with which, and what a group of comparisons comes to.
//!
//! A *cell* is one policy on one task. All pairs of cells are taken, the first before the second in the order of the
//! list: pairs of one policy are `across_tasks` (55 for 11 tasks), pairs of one task are `across_policies` (11 per pair
//! of policies), others are left out. List policies in the order of the selection and tasks alphabetically inside
//! each; the order decides the direction, first to second. Groups: the policy, or the pair "a / b".
//!
//! A group's curves are mean and standard deviation (divisor n) over its pairs, for each number of components.
//!
//! Degenerate: a group whose pairs are all left out at some number of components has no mean there and a count of 0.
//! Oracle: `tests/analysis_parity.rs`, algorithm `pair_summary`.

use std::fmt;

use super::super::stats::{Divisor, mean, standard_deviation};
use super::{
    AngleSummary, Covariance, PairCurves, PrincipalComponents, SubspaceError, VarianceDifference,
    compare_subspaces,
};

/// One policy on one task.
#[derive(Debug, Clone, PartialEq)]
pub struct Cell {
    pub policy: String,
    pub task: String,
    pub covariance: Covariance,
    pub components: PrincipalComponents,
}

/// What two cells have in common.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Comparison {
    AcrossTasks,
    AcrossPolicies,
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::AcrossTasks => "across_tasks",
            Self::AcrossPolicies => "across_policies",
        })
    }
}

/// Two cells to compare, by their place in the list.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Pair {
    pub comparison: Comparison,
    pub first: usize,
    pub second: usize,
    /// Whose curves it is averaged with.
    pub group: String,
}

/// The pairs among cells given as (policy, task), in the order of the list.
#[must_use]
pub fn pairs_of(cells: &[(&str, &str)]) -> Vec<Pair> {
    let mut pairs = Vec::new();
    for (first, (policy, task)) in cells.iter().enumerate() {
        for (second, (other_policy, other_task)) in cells.iter().enumerate().skip(first + 1) {
            let (comparison, group) = if policy == other_policy {
                (Comparison::AcrossTasks, (*policy).to_owned())
            } else if task == other_task {
                (Comparison::AcrossPolicies, format!("{policy} / {other_policy}"))
            } else {
                continue;
            };
            pairs.push(Pair { comparison, first, second, group });
        }
    }
    pairs
}

/// Compares all pairs of `cells`.
pub fn compare_cells(
    cells: &[Cell],
    difference: VarianceDifference,
    angle: AngleSummary,
) -> Result<Vec<(Pair, PairCurves)>, SubspaceError> {
    let names: Vec<(&str, &str)> =
        cells.iter().map(|cell| (cell.policy.as_str(), cell.task.as_str())).collect();
    let set = |index: usize| (&cells[index].covariance, &cells[index].components);
    pairs_of(&names)
        .into_iter()
        .map(|pair| {
            let curves = compare_subspaces(set(pair.first), set(pair.second), difference, angle)?;
            Ok((pair, curves))
        })
        .collect()
}

/// Mean and spread of one measure over the pairs of a group, for one number of components.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct CurveSummary {
    pub mean: Option<f64>,
    /// Divisor n.
    pub standard_deviation: Option<f64>,
    pub count: usize,
}

/// The curves of a group. Entry n − 1 belongs to n components.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupSummary {
    pub comparison: Comparison,
    pub group: String,
    pub pvd: Vec<CurveSummary>,
    pub pad: Vec<CurveSummary>,
}

/// Averages the curves of each group, groups in the order in which they first appear. With `drop_beyond_rank`, values
/// that rest on directions without variance are left out.
#[must_use]
pub fn summarise_pairs(
    compared: &[(Pair, PairCurves)],
    drop_beyond_rank: bool,
) -> Vec<GroupSummary> {
    let mut groups: Vec<(Comparison, &str)> = Vec::new();
    for (pair, _) in compared {
        let group = (pair.comparison, pair.group.as_str());
        if !groups.contains(&group) {
            groups.push(group);
        }
    }
    groups
        .into_iter()
        .map(|(comparison, group)| {
            let members: Vec<&PairCurves> = compared
                .iter()
                .filter(|(pair, _)| pair.comparison == comparison && pair.group == group)
                .map(|(_, curves)| curves)
                .collect();
            let length = members.iter().map(|curves| curves.pvd.len()).max().unwrap_or(0);
            let curve = |measure: fn(&PairCurves) -> &[f64]| {
                (0..length)
                    .map(|index| {
                        let values: Vec<f64> = members
                            .iter()
                            .filter(|c| !drop_beyond_rank || !c.is_beyond_rank(index + 1))
                            .filter_map(|curves| measure(curves).get(index).copied())
                            .collect();
                        CurveSummary {
                            mean: mean(&values),
                            standard_deviation: standard_deviation(&values, Divisor::Count),
                            count: values.len(),
                        }
                    })
                    .collect()
            };
            GroupSummary {
                comparison,
                group: group.to_owned(),
                pvd: curve(|curves| &curves.pvd),
                pad: curve(|curves| &curves.pad),
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn four_policies_on_eleven_tasks_give_the_published_numbers_of_pairs() {
        let tasks: Vec<String> = (0..11).map(|task| format!("task {task:02}")).collect();
        let cells: Vec<(&str, &str)> = ["arnold", "expert", "obc", "obc_st"]
            .iter()
            .flat_map(|policy| tasks.iter().map(move |task| (*policy, task.as_str())))
            .collect();
        let pairs = pairs_of(&cells);
        let count = |group: &str| pairs.iter().filter(|pair| pair.group == group).count();
        assert_eq!(count("arnold"), 55);
        assert_eq!(count("arnold / expert"), 11);
        assert_eq!(count("expert / arnold"), 0);
        assert_eq!(pairs.len(), 4 * 55 + 6 * 11);
    }

    #[test]
    fn curves_beyond_the_rank_count_by_default_and_can_be_left_out() {
        let pair = |second| Pair {
            comparison: Comparison::AcrossTasks,
            first: 0,
            second,
            group: "arnold".to_owned(),
        };
        let curves = |pvd: f64, common_rank| PairCurves {
            pvd: vec![pvd; 2],
            pad: vec![10.0 * pvd; 2],
            common_rank,
        };
        let compared = [(pair(1), curves(1.0, 1)), (pair(2), curves(3.0, 2))];
        let all = summarise_pairs(&compared, false);
        let want = CurveSummary { mean: Some(2.0), standard_deviation: Some(1.0), count: 2 };
        assert_eq!(all[0].pvd, [want; 2]);
        let want = CurveSummary { mean: Some(30.0), standard_deviation: Some(0.0), count: 1 };
        assert_eq!(summarise_pairs(&compared, true)[0].pad[1], want);
        let compared = [(pair(1), curves(1.0, 1))];
        let want = CurveSummary { mean: None, standard_deviation: None, count: 0 };
        assert_eq!(summarise_pairs(&compared, true)[0].pvd[1], want);
        assert!(summarise_pairs(&[], false).is_empty());
    }
}

//! How far the action subspaces of tasks and policies lie apart: PVD and PAD of all pairs (`spec/analysis.md` §8).
//!
//! Rows are the actions that were sent, all steps of all episodes of one policy in one task. Policies stand in the order
//! in which they were named, tasks alphabetically inside each; the order decides the direction of PVD.

use std::collections::BTreeSet;

use serde_json::{Value, json};

use crate::analysis::subspace::{
    AngleSummary, Cell, Comparison, Covariance, CurveSummary, GroupSummary, Pair, PairCurves,
    VarianceDifference, compare_cells, principal_components, summarise_pairs,
};
use crate::figure::palette::{group_colours, policy_colours};
use crate::figure::{
    ComponentFigure, ComponentPanel, ComponentSeries, LineKind, Provenance, Scale,
};
use crate::record::{Column, Recording, Table, names};

use super::ExperimentError;
use super::muscle_signal::{Chosen, EpisodeChoice, Take, constant_columns, rates_warning};

/// How to compare.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SubspaceOptions {
    pub difference: VarianceDifference,
    pub angle: AngleSummary,
    /// Leave directions without variance out of the means.
    pub drop_beyond_rank: bool,
}

/// The actions of one policy in one task: what compares them, and what of them is odd.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskSubspace {
    pub take: Take,
    cell: Cell,
    /// Muscles whose action never changes.
    constant: Vec<String>,
}

/// All comparisons.
#[derive(Debug, Clone, PartialEq)]
pub struct Subspaces {
    /// In the order of the comparison.
    pub tasks: Vec<TaskSubspace>,
    pub pairs: Vec<(Pair, PairCurves)>,
    pub groups: Vec<GroupSummary>,
    options: SubspaceOptions,
}

/// The subspace of the chosen episodes of a recording.
pub fn read(
    policy: &str,
    recording: &Recording,
    choice: EpisodeChoice,
) -> Result<TaskSubspace, ExperimentError> {
    let chosen = Chosen::of(policy, recording, choice)?;
    let (values, muscles) = chosen.values(names::ACTION)?;
    let take = chosen.take(muscles);
    let failed = |source| ExperimentError::Actions {
        policy: take.policy.clone(),
        task: take.task.clone(),
        source,
    };
    let mut covariance = Covariance::new(take.muscles.len());
    covariance.push_rows(&values).map_err(failed)?;
    let components = principal_components(&covariance).map_err(failed)?;
    let (policy, task) = (take.policy.clone(), take.task.clone());
    let constant = constant_columns(&values, &take.muscles);
    Ok(TaskSubspace { take, cell: Cell { policy, task, covariance, components }, constant })
}

/// Compares all pairs of `tasks`, which are sorted first.
pub fn compare(
    mut tasks: Vec<TaskSubspace>,
    options: SubspaceOptions,
) -> Result<Subspaces, ExperimentError> {
    let policies = policies_of(&tasks);
    let place = |task: &TaskSubspace| policies.iter().position(|p| *p == task.take.policy);
    tasks.sort_by_key(|task| (place(task), task.take.task.clone()));
    check_tasks(&tasks, &policies)?;
    check_muscles(&tasks)?;
    let cells: Vec<Cell> = tasks.iter().map(|task| task.cell.clone()).collect();
    let pairs = compare_cells(&cells, options.difference, options.angle)
        .map_err(|source| ExperimentError::Subspace { task: "all".to_owned(), source })?;
    if let (true, Some(only)) = (pairs.is_empty(), tasks.first()) {
        let (policy, task) = (only.take.policy.clone(), only.take.task.clone());
        return Err(ExperimentError::NothingToCompare { policy, task });
    }
    let groups = summarise_pairs(&pairs, options.drop_beyond_rank);
    Ok(Subspaces { tasks, pairs, groups, options })
}

/// The policies in the order in which they first appear.
fn policies_of(tasks: &[TaskSubspace]) -> Vec<String> {
    let mut seen = BTreeSet::new();
    let policies = tasks.iter().map(|task| task.take.policy.clone());
    policies.filter(|policy| seen.insert(policy.clone())).collect()
}

/// Every policy must have every task: means over different tasks would be compared otherwise.
fn check_tasks(tasks: &[TaskSubspace], policies: &[String]) -> Result<(), ExperimentError> {
    let has = |policy: &str, task: &str| {
        tasks.iter().any(|one| one.take.policy == policy && one.take.task == task)
    };
    for one in tasks {
        if let Some(policy) = policies.iter().find(|policy| !has(policy, &one.take.task)) {
            let (policy, task) = (policy.clone(), one.take.task.clone());
            return Err(ExperimentError::MissingTask {
                policy,
                task,
                other: one.take.policy.clone(),
            });
        }
    }
    Ok(())
}

/// All must have the muscles of the first, in its order.
fn check_muscles(tasks: &[TaskSubspace]) -> Result<(), ExperimentError> {
    let Some((first, others)) = tasks.split_first() else { return Ok(()) };
    let other = || format!("`{}` in `{}`", first.take.policy, first.take.task);
    for Take { policy, task, muscles, .. } in others.iter().map(|one| &one.take) {
        let (policy, task) = (policy.clone(), task.clone());
        let (expected, found) = (first.take.muscles.len(), muscles.len());
        if expected != found {
            return Err(ExperimentError::Muscles { policy, task, other: other(), expected, found });
        }
        let mut pairs = first.take.muscles.iter().zip(muscles);
        if let Some(at) = pairs.position(|(expected, found)| expected != found) {
            return Err(ExperimentError::MuscleNames {
                policy,
                task,
                other: other(),
                place: at + 1,
                expected: first.take.muscles[at].as_str().into(),
                found: muscles[at].as_str().into(),
            });
        }
    }
    Ok(())
}

/// A curve of a group.
type Measure = fn(&GroupSummary) -> &[CurveSummary];

impl Subspaces {
    fn muscles(&self) -> usize {
        self.tasks.first().map_or(0, |task| task.take.muscles.len())
    }

    /// `pairs`: upstream's columns, and whether the directions have variance.
    pub fn pair_table(&self) -> Result<Table, ExperimentError> {
        let muscles = self.muscles();
        let rows = || {
            self.pairs
                .iter()
                .flat_map(|(pair, curves)| (0..muscles).map(move |n| (pair, curves, n)))
        };
        let take = |index: usize| &self.tasks[index].take;
        let text = |value: &dyn Fn(&Pair) -> String| -> Vec<String> {
            rows().map(|(pair, ..)| value(pair)).collect()
        };
        let count = |value: &dyn Fn(&Pair, usize) -> usize| -> Vec<i64> {
            rows().map(|(pair, _, n)| value(pair, n) as i64).collect()
        };
        let number = |measure: fn(&PairCurves) -> &[f64]| -> Vec<f64> {
            rows().map(|(_, curves, n)| measure(curves)[n]).collect()
        };
        let beyond: Vec<bool> = rows().map(|(_, curves, n)| curves.is_beyond_rank(n + 1)).collect();
        Ok(Table::new(vec![
            Column::unitless("comparison", text(&|pair| pair.comparison.to_string())),
            Column::unitless("policy_a", text(&|pair| take(pair.first).policy.clone())),
            Column::unitless("task_a", text(&|pair| take(pair.first).task.clone())),
            Column::unitless("policy_b", text(&|pair| take(pair.second).policy.clone())),
            Column::unitless("task_b", text(&|pair| take(pair.second).task.clone())),
            Column::unitless("dimension", count(&|_, n| n + 1)),
            Column::unitless("pvd", number(|curves| &curves.pvd)),
            Column::new("pad", "deg", number(|curves| &curves.pad)),
            Column::unitless("n_a", count(&|pair, _| take(pair.first).steps)),
            Column::unitless("n_b", count(&|pair, _| take(pair.second).steps)),
            Column::unitless("group", text(&|pair| pair.group.clone())),
            Column::unitless("beyond_rank", beyond),
        ])?)
    }

    /// `summary`: upstream's columns.
    pub fn summary_table(&self) -> Result<Table, ExperimentError> {
        let rows: Vec<(&GroupSummary, usize)> = self
            .groups
            .iter()
            .flat_map(|group| (0..group.pvd.len()).map(move |n| (group, n)))
            .collect();
        let mut columns = vec![
            Column::unitless(
                "comparison",
                rows.iter().map(|(g, _)| g.comparison.to_string()).collect::<Vec<_>>(),
            ),
            Column::unitless(
                "group",
                rows.iter().map(|(g, _)| g.group.clone()).collect::<Vec<_>>(),
            ),
            Column::unitless(
                "dimension",
                rows.iter().map(|(_, n)| *n as i64 + 1).collect::<Vec<_>>(),
            ),
        ];
        let measures: [(&str, &str, Measure); 2] =
            [("pvd", "", |group| &group.pvd), ("pad", "deg", |group| &group.pad)];
        for (name, unit, measure) in measures {
            let number = |value: fn(&CurveSummary) -> Option<f64>| -> Vec<f64> {
                rows.iter().map(|(g, n)| value(&measure(g)[*n]).unwrap_or(f64::NAN)).collect()
            };
            let counts: Vec<i64> = rows.iter().map(|(g, n)| measure(g)[*n].count as i64).collect();
            columns.extend([
                Column::new(format!("{name}_mean"), unit, number(|point| point.mean)),
                Column::new(format!("{name}_std"), unit, number(|point| point.standard_deviation)),
                Column::unitless(format!("{name}_count"), counts),
            ]);
        }
        Ok(Table::new(columns)?)
    }

    /// What is odd about the data, a sentence each.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings = Vec::new();
        for TaskSubspace { take, cell, constant } in &self.tasks {
            let Take { policy, task, steps, muscles, .. } = take;
            if cell.components.is_underdetermined() {
                warnings.push(format!(
                    "`{policy}` in `{task}`: {steps} steps for {} muscles, so the last components are arbitrary",
                    muscles.len()
                ));
            }
            if !constant.is_empty() {
                warnings.push(format!(
                    "`{policy}` in `{task}`: constant actions of {}",
                    constant.join(", ")
                ));
            }
        }
        let beyond = self.pairs.iter().filter(|(_, c)| c.common_rank < self.muscles()).count();
        if beyond > 0 {
            let kept = if self.options.drop_beyond_rank { "left out" } else { "kept" };
            warnings.push(format!(
                "{beyond} of {} pairs have directions without variance; {kept} in the means",
                self.pairs.len()
            ));
        }
        // Inside a policy tasks have rates of their own, as published; two policies in one task should not.
        let mut tasks: Vec<&str> = self.tasks.iter().map(|task| task.take.task.as_str()).collect();
        tasks.sort_unstable();
        tasks.dedup();
        for task in tasks {
            let all = self.tasks.iter().map(|one| &one.take);
            let takes: Vec<&Take> = all.filter(|take| take.task == task).collect();
            warnings.extend(rates_warning(&takes).map(|warning| format!("`{task}`: {warning}")));
        }
        warnings
    }

    /// The result document.
    #[must_use]
    pub fn document(&self) -> Value {
        let cells = self.tasks.iter().map(|TaskSubspace { take, cell, constant }| {
            let mut entry = take.document();
            entry["directions_with_variance"] = json!(cell.components.rank());
            entry["constant_muscles"] = json!(constant);
            entry
        });
        let curve = |points: &[CurveSummary]| {
            json!({
                "mean": points.iter().map(|point| point.mean).collect::<Vec<_>>(),
                "std": points.iter().map(|point| point.standard_deviation).collect::<Vec<_>>(),
                "count": points.iter().map(|point| point.count).collect::<Vec<_>>(),
            })
        };
        let groups = self.groups.iter().map(|group| {
            let pairs = self.pairs.iter().filter(|(pair, _)| {
                pair.comparison == group.comparison && pair.group == group.group
            });
            json!({
                "comparison": group.comparison.to_string(),
                "group": group.group,
                "pairs": pairs.count(),
                "pvd": curve(&group.pvd),
                "pad": curve(&group.pad),
            })
        });
        json!({
            "groups": groups.collect::<Vec<_>>(),
            "cells": cells.collect::<Vec<_>>(),
            "warnings": self.warnings(),
        })
    }

    /// The comparisons that were made.
    #[must_use]
    pub fn comparisons(&self) -> Vec<Comparison> {
        let both = [Comparison::AcrossTasks, Comparison::AcrossPolicies];
        both.into_iter().filter(|c| self.groups.iter().any(|g| g.comparison == *c)).collect()
    }

    /// The figure of one comparison: PVD and PAD of each group, mean and standard deviation over its pairs.
    #[must_use]
    pub fn figure(&self, comparison: Comparison, provenance: &Provenance) -> ComponentFigure {
        let groups: Vec<&GroupSummary> =
            self.groups.iter().filter(|group| group.comparison == comparison).collect();
        let names: Vec<&str> = groups.iter().map(|group| group.group.as_str()).collect();
        let colours = match comparison {
            Comparison::AcrossTasks => policy_colours(&names),
            Comparison::AcrossPolicies => group_colours(names.len()),
        };
        let series = |measure: fn(&GroupSummary) -> &[CurveSummary]| {
            let of = |(group, colour): (&&GroupSummary, &&'static str)| {
                let points = measure(group);
                let value = |x: Option<f64>| x.unwrap_or(f64::NAN);
                let end = |sign: f64| {
                    move |point: &CurveSummary| {
                        value(point.mean) + sign * value(point.standard_deviation)
                    }
                };
                ComponentSeries {
                    colour,
                    kind: LineKind::Solid,
                    points: (1..).zip(points.iter().map(|point| value(point.mean))).collect(),
                    band: points.iter().map(end(-1.0)).zip(points.iter().map(end(1.0))).collect(),
                }
            };
            groups.iter().zip(&colours).map(of).collect::<Vec<_>>()
        };
        let (what, over) = match comparison {
            Comparison::AcrossTasks => ("Between tasks", "pairs of tasks"),
            Comparison::AcrossPolicies => ("Between policies", "tasks"),
        };
        let counts = groups.iter().map(|group| {
            let count = group.pvd.first().map_or(0, |point| point.count);
            format!("{count}")
        });
        let mut counts: Vec<String> = counts.collect();
        counts.dedup();
        ComponentFigure {
            panels: vec![
                ComponentPanel {
                    title: format!("{what}: variance"),
                    label: "PVD".to_owned(),
                    scale: Scale::Share,
                    series: series(|group| &group.pvd),
                },
                ComponentPanel {
                    title: format!("{what}: angle"),
                    label: "PAD (degrees)".to_owned(),
                    scale: Scale::Degrees,
                    series: series(|group| &group.pad),
                },
            ],
            columns: 2,
            counted: "components",
            legend: names
                .iter()
                .zip(&colours)
                .map(|(name, colour)| ((*name).to_owned(), *colour, LineKind::Banded))
                .collect(),
            footer: format!(
                "Percent of variance differing, principal angle difference. Mean ± s.d. over {} {over}. {}",
                counts.join(" or "),
                provenance.label()
            ),
        }
    }
}

//! Curves over the number of components or synergies, and the document made of them.

use serde_json::{Value, json};

use crate::analysis::subspace::components_reaching;

use super::factorise::SynergyScores;
use super::{Basis, Curve, Scope, Synergies, Take};

/// Shares at which the numbers of components are read.
const SHARES: [f64; 2] = [0.85, 0.95];

/// One curve as it is drawn and written: by rising number of components.
pub(super) struct Line {
    pub(super) scope: Scope,
    pub(super) task: usize,
    pub(super) points: Vec<(usize, f64)>,
}

impl Synergies {
    pub(super) fn basis_of(&self, score: &SynergyScores) -> &Basis {
        &self.bases[score.basis]
    }

    pub(super) fn policies(&self) -> Vec<&str> {
        let mut policies: Vec<&str> = Vec::new();
        for take in &self.tasks {
            if !policies.contains(&take.policy.as_str()) {
                policies.push(&take.policy);
            }
        }
        policies
    }

    pub(super) fn places_of(&self, policy: &str) -> Vec<usize> {
        (0..self.tasks.len()).filter(|&at| self.tasks[at].policy == policy).collect()
    }

    /// Whether there is a mean over several tasks, all of the same muscles.
    pub(super) fn has_mean(&self, policy: &str) -> bool {
        let own = self.places_of(policy);
        own.len() > 1 && own.iter().all(|&at| self.tasks[at].muscles == self.tasks[own[0]].muscles)
    }

    pub(super) fn variance_lines(&self) -> Vec<Line> {
        let line = |curve: &Curve| Line {
            scope: self.bases[curve.basis].scope,
            task: curve.task,
            points: (1..).zip(curve.values.iter().copied()).collect(),
        };
        self.variance.iter().map(line).collect()
    }

    pub(super) fn score_lines(&self, score: fn(&SynergyScores) -> Option<f64>) -> Vec<Line> {
        let mut lines: Vec<(usize, Line)> = Vec::new();
        for row in self.fits.iter().flat_map(|fits| &fits.scores) {
            let point = (row.rank, score(row).unwrap_or(f64::NAN));
            let same =
                |(basis, line): &&mut (usize, Line)| *basis == row.basis && line.task == row.task;
            if let Some((_, line)) = lines.iter_mut().find(same) {
                line.points.push(point);
            } else {
                let scope = self.basis_of(row).scope;
                lines.push((row.basis, Line { scope, task: row.task, points: vec![point] }));
            }
        }
        lines.into_iter().map(|(_, line)| line).collect()
    }

    /// The result document: how many components and synergies each task needs, and the curves.
    #[must_use]
    pub fn document(&self) -> Value {
        let (variance, r2) = (self.variance_lines(), self.score_lines(|row| row.r2));
        let vaf = self.score_lines(|row| row.vaf);
        let curves = |lines: &[Line], task: usize| {
            let mut both = serde_json::Map::new();
            for line in lines.iter().filter(|line| line.task == task) {
                both.insert(line.scope.word().to_owned(), line.document());
            }
            both
        };
        let task = |(place, take): (usize, &Take)| {
            let mut entry = take.document();
            if self.plan.components {
                entry["explained_variance"] = curves(&variance, place).into();
            }
            if self.fits.is_some() {
                entry["reconstruction"] = curves(&r2, place).into();
                entry["vaf"] = curves(&vaf, place).into();
            }
            entry
        };
        let tasks: Vec<Value> = self.tasks.iter().enumerate().map(task).collect();
        let means = |policy: &str, lines: &[Line]| {
            let own = self.places_of(policy);
            let scopes = [Scope::Task, Scope::Pooled].into_iter();
            let means = scopes.filter_map(|scope| mean_line(lines, &own, scope));
            let one = |line: Line| (line.scope.word().to_owned(), line.document());
            means.map(one).collect::<serde_json::Map<_, _>>()
        };
        let policies = self.policies().into_iter().filter(|policy| self.has_mean(policy));
        let policies = policies.map(|policy| {
            json!({
                "policy": policy,
                "tasks": self.places_of(policy).len(),
                "explained_variance": means(policy, &variance),
                "reconstruction": means(policy, &r2),
                "vaf": means(policy, &vaf),
            })
        });
        let means: Vec<Value> = policies.collect();
        json!({ "tasks": tasks, "means": means, "warnings": self.warnings })
    }
}

impl Line {
    /// The curve, and the smallest number that reaches each share. It is not known to be the fewest if the number below
    /// it is not on the curve.
    pub(super) fn document(&self) -> Value {
        let values: Vec<f64> = self.points.iter().map(|point| point.1).collect();
        let reaching = SHARES.map(|share| {
            let place = components_reaching(&values, share).map(|count| count - 1);
            let dimension = place.map(|place| self.points[place].0);
            let below = |place: usize| if place == 0 { 0 } else { self.points[place - 1].0 };
            let fewest = place.map(|place| self.points[place].0 == below(place) + 1);
            json!({"share": share, "dimension": dimension, "is_fewest": fewest})
        });
        json!({
            "dimensions": self.points.iter().map(|point| point.0).collect::<Vec<_>>(),
            "values": values.iter().map(|x| Some(x).filter(|x| !x.is_nan())).collect::<Vec<_>>(),
            "reaching": reaching,
        })
    }
}

/// Mean over the tasks with a value, for every number of components that any of them has.
pub(super) fn mean_line(lines: &[Line], tasks: &[usize], scope: Scope) -> Option<Line> {
    let own: Vec<&Line> =
        lines.iter().filter(|line| line.scope == scope && tasks.contains(&line.task)).collect();
    let mut counts: Vec<usize> =
        own.iter().flat_map(|line| &line.points).map(|point| point.0).collect();
    counts.sort_unstable();
    counts.dedup();
    let mean = |count: usize| {
        let all = own.iter().flat_map(|line| &line.points);
        let values: Vec<f64> = all
            .filter(|point| point.0 == count && !point.1.is_nan())
            .map(|point| point.1)
            .collect();
        // Numbers that some tasks do not reach would make the mean jump.
        if values.len() < own.len() {
            f64::NAN
        } else {
            values.iter().sum::<f64>() / values.len() as f64
        }
    };
    let points: Vec<(usize, f64)> = counts.into_iter().map(|count| (count, mean(count))).collect();
    (!points.is_empty()).then_some(Line { scope, task: 0, points })
}

//! Published curves of control-subspace inactivation: tabulated, drawn, and laid behind one's own.
//!
//! The solved fraction is divided by the expert's and given in percent. Curves of the task's own components are blue, of
//! pooled ones red, of the expert's violet. The published file has no standard errors, so its curves have no band; the
//! curves over all tasks have one, ± s.e.m. over tasks.

use std::collections::BTreeMap;

use crate::analysis::performance::{TABLE_TASKS, percent_of};
use crate::analysis::stats::{Divisor, Summary};
use crate::figure::palette::{BLUE, RED, VIOLET};
use crate::figure::{
    Basis, CsiFigure, CsiPanel, CsiPoint, CsiSeries, LineGridFigure, LinePanel, LineSeries,
    Performance, Provenance, Reconstruction, Uncertainty, Width,
};
use crate::record::{Benchmark, Column, RecordError, SubspacePoint, Table};

use super::benchmarks::task_label;

/// The three kinds of components with their scope and basis in the file, their colour and name.
const KINDS: [(Basis, &str, Option<&str>, &str, &str); 3] = [
    (Basis::TaskSpecific, "task", None, BLUE, "Task-specific components"),
    (Basis::Pooled, "global", None, RED, "Pooled components"),
    (Basis::Expert, "global", Some(EXPERT), VIOLET, "Expert's components"),
];
/// The basis of experts.
const EXPERT: &str = "expert";

/// Curves with the experts they are compared with.
#[derive(Debug, Clone, PartialEq)]
pub struct PublishedCurves {
    pub points: Vec<SubspacePoint>,
    /// Solved fraction by task.
    experts: BTreeMap<String, f64>,
}

impl PublishedCurves {
    /// Points of tasks without an expert are left out.
    #[must_use]
    pub fn new(points: Vec<SubspacePoint>, experts: &Benchmark) -> Self {
        let experts: BTreeMap<String, f64> = experts
            .iter()
            .filter_map(|(task, entry)| Some((task.clone(), entry.avg_solved_step_frac?)))
            .collect();
        let points = points.into_iter().filter(|p| experts.contains_key(&p.task)).collect();
        Self { points, experts }
    }

    fn relative(&self, point: &SubspacePoint, value: f64) -> f64 {
        percent_of(self.experts.get(&point.task).copied().unwrap_or(f64::NAN), value)
    }

    /// Upstream's `relative_curves.csv`: one row per point.
    pub fn table(&self) -> Result<Table, RecordError> {
        let rows = || self.points.iter();
        let text = |value: fn(&SubspacePoint) -> &str| -> Vec<String> {
            rows().map(|point| value(point).to_owned()).collect()
        };
        let count = |value: fn(&SubspacePoint) -> usize| -> Vec<i64> {
            rows().map(|point| value(point) as i64).collect()
        };
        Table::new(vec![
            Column::unitless("method", text(|p| &p.method)),
            Column::unitless("scope", text(|p| &p.scope)),
            Column::unitless("basis_policy", text(|p| &p.basis_policy)),
            Column::unitless("task", text(|p| &p.task)),
            Column::unitless("dimension", count(|p| p.dimension)),
            Column::unitless(
                "reconstruction",
                rows().map(|p| p.reconstruction).collect::<Vec<_>>(),
            ),
            Column::unitless(
                "solved_fraction",
                rows().map(|p| p.solved_fraction).collect::<Vec<_>>(),
            ),
            Column::new(
                "relative_performance",
                "%",
                rows().map(|p| self.relative(p, p.solved_fraction)).collect::<Vec<_>>(),
            ),
            Column::unitless("n_episodes", count(|p| p.n_episodes)),
            Column::unitless("n_fits", count(|p| p.n_fits)),
        ])
    }

    /// One panel per factorisation: means over tasks.
    #[must_use]
    pub fn mean_figure(&self) -> LineGridFigure {
        let panels = [("pca", "PCA"), ("nmf", "NMF")].map(|(method, title)| LinePanel {
            title: title.to_owned(),
            series: KINDS
                .iter()
                .filter_map(|(basis, _, _, colour, name)| {
                    let mut by_dimension: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
                    for point in self.points.iter().filter(|p| p.method == method) {
                        if kind_of(point) == Some(*basis) {
                            let value = self.relative(point, point.solved_fraction);
                            by_dimension.entry(point.dimension).or_default().push(value);
                        }
                    }
                    let summaries = by_dimension.iter().map(|(d, values)| {
                        (*d as f64, Summary::of(values, Divisor::CountMinusOne))
                    });
                    let (mean, spread): (Vec<(f64, f64)>, Vec<f64>) = summaries
                        .map(|(d, s)| {
                            let nan = f64::NAN;
                            ((d, s.mean.unwrap_or(nan)), s.standard_error.unwrap_or(nan))
                        })
                        .unzip();
                    (!mean.is_empty()).then(|| LineSeries {
                        name: (*name).to_owned(),
                        colour,
                        mean,
                        spread,
                        seeds: Vec::new(),
                        dotted: false,
                    })
                })
                .collect(),
        });
        let tasks: std::collections::BTreeSet<&str> =
            self.points.iter().map(|point| point.task.as_str()).collect();
        LineGridFigure {
            panels: panels.into_iter().filter(|panel| !panel.series.is_empty()).collect(),
            across: "Number of components".to_owned(),
            upwards: "Relative performance (%)".to_owned(),
            x_end: None,
            y_end: None,
            own_x: false,
            line: Some((100.0, "Expert")),
            mark: None,
            caption: format!(
                "Mean over {} tasks ± s.e.m. over tasks. Published curves (arXiv:2508.18066), not played.",
                tasks.len()
            ),
        }
    }

    /// One panel per task: the curves of `method` and of the chosen `kinds`. `ours` come in front, the published ones then
    /// lie thin behind them. `None` if there is no such curve.
    pub fn task_figure(
        &self,
        method: &str,
        kinds: &[Basis],
        ours: Option<&Self>,
    ) -> Result<Option<String>, crate::figure::FigureError> {
        let mut panels = Vec::new();
        let mut behind = Vec::new();
        for task in TABLE_TASKS {
            let published = self.series(method, task, kinds);
            let own = ours.map(|ours| ours.series(method, task, kinds)).unwrap_or_default();
            if published.is_empty() && own.is_empty() {
                continue;
            }
            let title = task_label(task);
            let (series, back) =
                if own.is_empty() { (published, Vec::new()) } else { (own, published) };
            panels.push(CsiPanel { title, series, unprojected: None });
            behind.push(back);
        }
        if panels.is_empty() {
            return Ok(None);
        }
        let has_own = behind.iter().any(|series| !series.is_empty());
        let figure = CsiFigure {
            panels,
            performance: Performance::Relative,
            reconstruction: if method == "nmf" {
                Reconstruction::RSquared
            } else {
                Reconstruction::ExplainedVariance
            },
            uncertainty: if has_own { Uncertainty::StandardError } else { Uncertainty::Unknown },
            provenance: Provenance {
                physics: "as published".to_owned(),
                policy: if has_own { "as in the run" } else { "Arnold, published curves" }
                    .to_owned(),
            },
            width: Width::TwoColumns,
        };
        Ok(Some(figure.to_svg_over(&behind)?))
    }

    fn series(&self, method: &str, task: &str, kinds: &[Basis]) -> Vec<CsiSeries> {
        let of_task = || self.points.iter().filter(|p| p.method == method && p.task == task);
        kinds
            .iter()
            .filter_map(|&basis| {
                let mut points: Vec<&SubspacePoint> =
                    of_task().filter(|point| kind_of(point) == Some(basis)).collect();
                points.sort_by_key(|point| point.dimension);
                let drawn: Vec<CsiPoint> = points
                    .iter()
                    .map(|point| {
                        let mean = self.relative(point, point.solved_fraction);
                        let sem = point.solved_fraction_sem.unwrap_or(f64::NAN);
                        let error = self.relative(point, sem);
                        let (low, high) = (mean - error, mean + error);
                        CsiPoint { components: point.dimension, mean, low, high }
                    })
                    .collect();
                let is_dense = points.iter().enumerate().all(|(i, p)| p.dimension == i + 1);
                let reconstruction = points.iter().map(|point| point.reconstruction);
                (!drawn.is_empty()).then(|| CsiSeries {
                    basis,
                    points: drawn,
                    // The line of variance starts at one component and leaves none out.
                    explained_variance: reconstruction.filter(|_| is_dense).collect(),
                    episodes: points.first().map_or(0, |point| point.n_episodes),
                })
            })
            .collect()
    }
}

/// Which components a point is of.
fn kind_of(point: &SubspacePoint) -> Option<Basis> {
    let is_expert = point.basis_policy == EXPERT;
    let found = KINDS.iter().find(|(_, scope, basis, ..)| {
        *scope == point.scope && basis.map_or(!is_expert, |basis| basis == point.basis_policy)
    });
    found.map(|(kind, ..)| *kind)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::record::BenchmarkEntry;

    fn point(scope: &str, basis: &str, dimension: usize) -> SubspacePoint {
        SubspacePoint {
            method: "pca".to_owned(),
            scope: scope.to_owned(),
            basis_policy: basis.to_owned(),
            task: "pen".to_owned(),
            dimension,
            reconstruction: 0.1 * dimension as f64,
            solved_fraction: 0.05 * dimension as f64,
            solved_fraction_sem: None,
            n_episodes: 20,
            n_fits: 1,
        }
    }

    fn experts() -> Benchmark {
        let entry = BenchmarkEntry { avg_solved_step_frac: Some(0.5), ..Default::default() };
        [("pen".to_owned(), entry)].into()
    }

    #[test]
    fn points_are_compared_with_their_expert_and_others_left_out() {
        let mut points: Vec<SubspacePoint> =
            (1..=3).map(|dimension| point("task", "arnold", dimension)).collect();
        points.push(SubspacePoint { task: "juggling".to_owned(), ..points[0].clone() });
        let curves = PublishedCurves::new(points, &experts());
        assert_eq!(curves.table().unwrap().row_count(), 3);
        let figure = curves.mean_figure();
        assert_eq!(figure.panels.len(), 1);
        let (_, last) = figure.panels[0].series[0].mean[2];
        assert!((last - 30.0).abs() < 1e-9);
    }

    #[test]
    fn kinds_of_components_are_told_apart_and_ours_lie_in_front() {
        assert_eq!(kind_of(&point("task", "any", 1)), Some(Basis::TaskSpecific));
        assert_eq!(kind_of(&point("global", "any", 1)), Some(Basis::Pooled));
        assert_eq!(kind_of(&point("global", "expert", 1)), Some(Basis::Expert));
        assert_eq!(kind_of(&point("other", "arnold", 1)), None);
        let of = |scope: &str| {
            let points = (1..=3).map(|dimension| point(scope, "arnold", dimension)).collect();
            PublishedCurves::new(points, &experts())
        };
        let kinds = [Basis::TaskSpecific, Basis::Pooled];
        let published = of("task").task_figure("pca", &kinds, None).unwrap().unwrap();
        assert!(published.contains("published curves") && !published.contains("Thin: published"));
        let both = of("task").task_figure("pca", &kinds, Some(&of("global"))).unwrap().unwrap();
        assert!(both.contains("Thin: published"));
        assert!(of("task").task_figure("nmf", &kinds, None).unwrap().is_none());
    }
}

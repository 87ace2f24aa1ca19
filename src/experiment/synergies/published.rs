//! Published curves: beside ours as rings, or alone as tables and figures.

use serde_json::{Value, json};

use crate::experiment::ExperimentError;
use crate::figure::palette::VIOLET;
use crate::figure::{ComponentFigure, ComponentPanel, ComponentSeries, LineKind, Scale};
use crate::record::{Column, SubspacePoint, Table};
use crate::sim::tasks;

use super::Scope;
use super::curves::Line;
use super::figures::{COLUMNS, Figures, colour, paper_name};

/// Published values of one curve, at few enough numbers to be told apart.
pub(super) fn rings(
    published: &[SubspacePoint],
    method: &'static str,
    scope: Scope,
    policy: &str,
    task: &str,
) -> ComponentSeries {
    let shown = |n: usize| [1, 2, 3].contains(&n) || n.is_multiple_of(5);
    let of_curve = |point: &&SubspacePoint| {
        point.method == method
            && point.scope == scope.word()
            && point.basis_policy == policy
            && point.task == task
    };
    let points = published.iter().filter(of_curve).filter(|point| shown(point.dimension));
    let points = points.map(|point| (point.dimension, point.reconstruction));
    ComponentSeries {
        colour: colour(scope),
        kind: LineKind::Rings,
        points: points.collect(),
        band: Vec::new(),
    }
}

/// Whether a policy of ours is called like a published one: `arnold_nmf/seed_0` and `Arnold` are `arnold`.
pub(super) fn names_policy(ours: &str, published: &str) -> bool {
    ours.to_lowercase().contains(&published.to_lowercase())
}

/// `published`: what upstream's files of curves say, in their columns.
pub fn published_table(points: &[SubspacePoint]) -> Result<Table, ExperimentError> {
    let text = |value: fn(&SubspacePoint) -> &str| -> Vec<String> {
        points.iter().map(|point| value(point).to_owned()).collect()
    };
    let count = |value: fn(&SubspacePoint) -> usize| -> Vec<i64> {
        points.iter().map(|point| value(point) as i64).collect()
    };
    let number = |value: fn(&SubspacePoint) -> Option<f64>| -> Vec<f64> {
        points.iter().map(|point| value(point).unwrap_or(f64::NAN)).collect()
    };
    Ok(Table::new(vec![
        Column::unitless("method", text(|point| &point.method)),
        Column::unitless("scope", text(|point| &point.scope)),
        Column::unitless("basis_policy", text(|point| &point.basis_policy)),
        Column::unitless("task", text(|point| &point.task)),
        Column::unitless("dimension", count(|point| point.dimension)),
        Column::unitless("reconstruction", number(|point| Some(point.reconstruction))),
        Column::unitless("solved_fraction", number(|point| Some(point.solved_fraction))),
        Column::unitless("solved_fraction_sem", number(|point| point.solved_fraction_sem)),
        Column::unitless("n_episodes", count(|point| point.n_episodes)),
        Column::unitless("n_fits", count(|point| point.n_fits)),
    ])?)
}

/// The curves of one published task, basis and scope.
fn published_lines(points: &[SubspacePoint], method: &str) -> Vec<(String, String, String, Line)> {
    let mut lines: Vec<(String, String, String, Line)> = Vec::new();
    for point in points.iter().filter(|point| point.method == method) {
        let key = (&point.task, &point.scope, &point.basis_policy);
        let value = (point.dimension, point.reconstruction);
        let same = |line: &&mut (String, String, String, Line)| (&line.0, &line.1, &line.2) == key;
        if let Some((.., line)) = lines.iter_mut().find(same) {
            line.points.push(value);
        } else {
            let scope = if point.scope == "task" { Scope::Task } else { Scope::Pooled };
            let line = Line { scope, task: 0, points: vec![value] };
            let (task, word, basis) =
                (point.task.clone(), point.scope.clone(), point.basis_policy.clone());
            lines.push((task, word, basis, line));
        }
    }
    for (.., line) in &mut lines {
        line.points.sort_by_key(|point| point.0);
    }
    lines
}

/// The document of published curves alone.
#[must_use]
pub fn published_document(points: &[SubspacePoint]) -> Value {
    let curves = |method: &'static str| {
        published_lines(points, method).into_iter().map(move |(task, scope, basis, line)| {
            let mut entry = json!({
                "method": method, "task": task, "scope": scope, "basis_policy": basis,
            });
            if let (Some(into), Value::Object(curve)) = (entry.as_object_mut(), line.document()) {
                into.extend(curve);
            }
            entry
        })
    };
    json!({ "published": curves("pca").chain(curves("nmf")).collect::<Vec<_>>(), "warnings": [] })
}

/// The figures of published curves alone.
#[must_use]
pub fn published_figures(points: &[SubspacePoint]) -> Figures {
    let kinds = [
        ("pca", "variance", "Explained variance", Scale::Share, "components"),
        ("nmf", "reconstruction", "R²", Scale::Score, "synergies"),
    ];
    let mut figures = Figures::new();
    for (method, stem, label, scale, counted) in kinds {
        let lines = published_lines(points, method);
        let mut names: Vec<&String> = Vec::new();
        for (task, ..) in &lines {
            if !names.contains(&task) {
                names.push(task);
            }
        }
        if names.is_empty() {
            continue;
        }
        let order = |name: &str| tasks::every().position(|task| task.name == name);
        names.sort_by_key(|name| order(name).unwrap_or(usize::MAX));
        let colour_of = |basis: &str, line: &Line| {
            if names_policy(basis, "expert") { VIOLET } else { colour(line.scope) }
        };
        let panels = names.iter().map(|name| {
            let own = lines.iter().filter(|(task, ..)| task == *name);
            let series = own.map(|(_, _, basis, line)| ComponentSeries {
                colour: colour_of(basis, line),
                ..line.series(LineKind::Solid)
            });
            let series = series.collect();
            ComponentPanel { title: paper_name(name), label: label.to_owned(), scale, series }
        });
        let panels = panels.collect();
        let mut legend: Vec<(String, &'static str, LineKind)> = Vec::new();
        for (_, scope, basis, line) in &lines {
            let scope = if scope == "task" { "task-specific" } else { "pooled" };
            let entry = (format!("{basis}, {scope}"), colour_of(basis, line), LineKind::Solid);
            if !legend.contains(&entry) {
                legend.push(entry);
            }
        }
        // The task's own first, as in every figure.
        legend.sort_by_key(|(name, ..)| name.ends_with("pooled"));
        let footer = "Published values, as read from the files that were named.".to_owned();
        let figure = ComponentFigure { panels, columns: COLUMNS, counted, legend, footer };
        figures.push((stem.to_owned(), figure));
    }
    figures
}

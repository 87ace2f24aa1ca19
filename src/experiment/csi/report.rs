//! The results of a sweep: tables, the document, the figure.

use serde_json::{Map, Value, json};

use crate::analysis::performance::percent_of;
use crate::analysis::stats::BootstrapOptions;
use crate::analysis::subspace::PrincipalComponents;
use crate::figure::{
    Basis, CsiFigure, CsiPanel, CsiPoint, CsiSeries, Performance, Provenance, Reconstruction,
    Uncertainty, Width,
};
use crate::record::{Column, Table};
use crate::sim::rollout::Episode;

use super::super::ExperimentError;
use super::{Bases, Csi, Curve, ListedFit, Method, Point, Scope, TaskCsi};

/// Shares of the free policy's performance at which functional dimensionality is read.
const PERFORMANCE_SHARES: [f64; 2] = [0.90, 0.95];

/// One row per point: the published columns, then the bootstrap interval.
pub fn curve_table(csi: &Csi, policy: &str) -> Result<Table, ExperimentError> {
    let rows: Vec<(&TaskCsi, &Curve, Point)> = csi
        .tasks
        .iter()
        .flat_map(|task| {
            task.curves
                .iter()
                .flat_map(move |curve| task.points(curve).map(move |point| (task, curve, point)))
        })
        .collect();
    let text = |value: &dyn Fn(&TaskCsi, &Curve) -> String| -> Vec<String> {
        rows.iter().map(|(task, curve, _)| value(task, curve)).collect()
    };
    let number = |value: &dyn Fn(&Point) -> Option<f64>| -> Vec<f64> {
        rows.iter().map(|(_, _, point)| value(point).unwrap_or(f64::NAN)).collect()
    };
    let integer = |value: &dyn Fn(&Point) -> usize| -> Vec<i64> {
        rows.iter().map(|(_, _, point)| value(point) as i64).collect()
    };
    let mut columns = vec![
        Column::unitless("method", text(&|_, _| csi.method.word().to_owned())),
        Column::unitless("scope", text(&|_, curve| curve.scope.word().to_owned())),
        Column::unitless("basis_policy", text(&|_, _| policy.to_owned())),
        Column::unitless("task", text(&|task, _| task.task.name.to_owned())),
        Column::unitless("dimension", integer(&|point| point.components)),
        Column::unitless("reconstruction", number(&|point| Some(point.reconstruction))),
        Column::unitless("solved_fraction", number(&|point| point.solved.mean)),
        Column::unitless("solved_fraction_sem", number(&|point| point.solved.standard_error)),
        Column::unitless("solved_fraction_low", number(&|point| point.interval.map(|i| i.low))),
        Column::unitless("solved_fraction_high", number(&|point| point.interval.map(|i| i.high))),
        Column::unitless("n_episodes", integer(&|point| point.solved.count)),
        Column::unitless("n_fits", integer(&|_| csi.method.fits())),
    ];
    if csi.experts.is_some() {
        let percent = |name: &str, value: &dyn Fn(&Point) -> Option<f64>| {
            let of =
                |(task, _, point): &(&TaskCsi, &Curve, Point)| relative(csi, task, value(point));
            Column::new(name, "%", rows.iter().map(of).collect::<Vec<f64>>())
        };
        columns.extend([
            percent("relative_performance", &|point| point.solved.mean),
            percent("relative_performance_sem", &|point| point.solved.standard_error),
            percent("relative_performance_low", &|point| point.interval.map(|i| i.low)),
            percent("relative_performance_high", &|point| point.interval.map(|i| i.high)),
        ]);
    }
    Ok(Table::new(columns)?)
}

/// A solved fraction of `task` in percent of the expert's; undefined without one.
fn relative(csi: &Csi, task: &TaskCsi, fraction: Option<f64>) -> f64 {
    let place = csi.tasks.iter().position(|other| other.task.name == task.task.name);
    let expert = place.and_then(|place| *csi.experts.as_ref()?.get(place)?);
    percent_of(expert.unwrap_or(f64::NAN), fraction.unwrap_or(f64::NAN))
}

/// One row per played episode; the free policy's episodes have scope `free` and as many dimensions as muscles.
pub fn episode_table(csi: &Csi) -> Result<Table, ExperimentError> {
    let mut rows: Vec<(&TaskCsi, &'static str, usize, &Episode)> = Vec::new();
    for task in &csi.tasks {
        rows.extend(task.free.iter().map(|e| (task, "free", task.muscles.len(), e)));
        for curve in &task.curves {
            for (&dimension, episodes) in curve.components.iter().zip(&curve.episodes) {
                rows.extend(episodes.iter().map(|e| (task, curve.scope.word(), dimension, e)));
            }
        }
    }
    let text = |value: &dyn Fn(&TaskCsi, &'static str) -> &'static str| -> Vec<String> {
        rows.iter().map(|&(task, scope, ..)| value(task, scope).to_owned()).collect()
    };
    let integer = |value: &dyn Fn(&Episode) -> usize| -> Vec<i64> {
        rows.iter().map(|(.., episode)| value(episode) as i64).collect()
    };
    Ok(Table::new(vec![
        Column::unitless("task", text(&|task, _| task.task.name)),
        Column::unitless("method", text(&|_, _| csi.method.word())),
        Column::unitless("scope", text(&|_, scope| scope)),
        Column::unitless("dimension", rows.iter().map(|row| row.2 as i64).collect::<Vec<_>>()),
        Column::unitless("episode", integer(&|e| e.spec.episode)),
        Column::unitless("solved_steps", integer(&|e| e.solved_steps)),
        Column::unitless("steps", integer(&|e| e.steps)),
        Column::unitless(
            "horizon",
            rows.iter().map(|row| row.0.task.horizon as i64).collect::<Vec<_>>(),
        ),
        Column::unitless("reward", rows.iter().map(|row| row.3.reward).collect::<Vec<_>>()),
        Column::unitless("terminated", rows.iter().map(|row| row.3.terminated).collect::<Vec<_>>()),
        Column::unitless("diverged_steps", integer(&|e| e.diverged_steps)),
    ])?)
}

/// One row per basis, component and muscle.
pub fn basis_table(csi: &Csi) -> Result<Table, ExperimentError> {
    match &csi.bases {
        Bases::PrincipalComponents(bases) => principal_table(csi, bases),
        Bases::Synergies(fits) => synergy_table(csi, fits),
    }
}

/// The muscles of the task called `name`.
fn muscles_of<'a>(csi: &'a Csi, name: &str) -> &'a [String] {
    csi.tasks.iter().find(|task| task.task.name == name).map_or(&[], |task| &task.muscles)
}

fn principal_table(
    csi: &Csi,
    bases: &[(Scope, Vec<&'static str>, PrincipalComponents)],
) -> Result<Table, ExperimentError> {
    let mut columns =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (scope, names, basis) in bases {
        for component in 0..basis.muscle_count() {
            for (place, muscle) in muscles_of(csi, names[0]).iter().enumerate() {
                columns.0.push(scope.word().to_owned());
                columns.1.push(names.join(" "));
                columns.2.push(component as i64 + 1);
                columns.3.push(basis.variances[component]);
                columns.4.push(muscle.clone());
                columns.5.push(basis.component(component)[place]);
                columns.6.push(basis.mean[place]);
            }
        }
    }
    Ok(Table::new(vec![
        Column::unitless("scope", columns.0),
        Column::unitless("tasks", columns.1),
        Column::unitless("component", columns.2),
        Column::unitless("variance", columns.3),
        Column::unitless("muscle", columns.4),
        Column::unitless("weight", columns.5),
        Column::unitless("mean_action", columns.6),
    ])?)
}

fn synergy_table(csi: &Csi, fits: &[ListedFit]) -> Result<Table, ExperimentError> {
    let mut columns =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    for (scope, names, fit) in fits {
        let muscles = muscles_of(csi, names[0]);
        for (synergy, weights) in fit.synergies.chunks_exact(muscles.len()).enumerate() {
            for (muscle, &weight) in muscles.iter().zip(weights) {
                columns.0.push(scope.word().to_owned());
                columns.1.push(names.join(" "));
                columns.2.push(fit.components as i64);
                columns.3.push(fit.fit as i64);
                columns.4.push(synergy as i64 + 1);
                columns.5.push(muscle.clone());
                columns.6.push(weight);
            }
        }
    }
    Ok(Table::new(vec![
        Column::unitless("scope", columns.0),
        Column::unitless("tasks", columns.1),
        Column::unitless("dimension", columns.2),
        Column::unitless("fit", columns.3),
        Column::unitless("synergy", columns.4),
        Column::unitless("muscle", columns.5),
        Column::unitless("weight", columns.6),
    ])?)
}

/// The result document: `{"tasks": {task: curve}, "pooled": {task: curve}}`.
#[must_use]
pub fn document(csi: &Csi) -> Value {
    let of_scope = |scope: Scope| {
        let mut tasks = Map::new();
        for task in &csi.tasks {
            let Some(curve) = task.curves.iter().find(|curve| curve.scope == scope) else {
                continue;
            };
            let points: Vec<Point> = task.points(curve).collect();
            let list =
                |value: &dyn Fn(&Point) -> Value| points.iter().map(value).collect::<Value>();
            let mut dimensionality = Map::new();
            for share in PERFORMANCE_SHARES {
                dimensionality.insert(
                    format!("{:.0}%", 100.0 * share),
                    dimensionality_of(task, curve, share),
                );
            }
            let unprojected = task.unprojected();
            let mut entry = json!({
                "components": curve.components,
                "solved_fraction": list(&|p| json!(p.solved.mean)),
                "solved_fraction_sem": list(&|p| json!(p.solved.standard_error)),
                "interval_95": list(&|p| json!(p.interval.map(|i| [i.low, i.high]))),
                (csi.method.reconstruction_word()): list(&|p| json!(p.reconstruction)),
                "unprojected": {
                    "mean": unprojected.mean,
                    "sem": unprojected.standard_error,
                    "n": unprojected.count,
                },
                "functional_dimensionality": dimensionality,
            });
            if csi.experts.is_some() {
                let percent = |fraction| defined(relative(csi, task, fraction));
                entry["relative_performance"] = list(&|p| percent(p.solved.mean));
                entry["unprojected"]["relative_performance"] = percent(unprojected.mean);
            }
            tasks.insert(task.task.name.to_owned(), entry);
        }
        Value::Object(tasks)
    };
    json!({"tasks": of_scope(Scope::Task), "pooled": of_scope(Scope::Pooled)})
}

/// Functional dimensionality, with an upper bound where numbers of components were left out.
fn dimensionality_of(task: &TaskCsi, curve: &Curve, share: f64) -> Value {
    let found = task.dimensionality(curve, share);
    let mut entry = json!({
        "components": found.and_then(|d| d.components),
        "interval_95": found.and_then(|d| d.interval).map(|i| [i.low, i.high]),
    });
    if found.and_then(|d| d.components).is_none()
        && let Some(bound) = task.dimensionality_at_most(curve, share)
    {
        entry["at_most"] = json!(bound.components);
        entry["at_most_interval_95"] = json!(bound.interval.map(|i| [i.low, i.high]));
    }
    entry
}

fn defined(number: f64) -> Value {
    if number.is_nan() { Value::Null } else { json!(number) }
}

/// The figure: one panel per task.
#[must_use]
pub fn figure(csi: &Csi, provenance: Provenance) -> CsiFigure {
    let panels: Vec<CsiPanel> = csi
        .tasks
        .iter()
        .map(|task| CsiPanel {
            title: task.task.paper_name.to_owned(),
            unprojected: task.unprojected().mean.map(|mean| shown(csi, task, mean)),
            series: task
                .curves
                .iter()
                // Where the pooled curve is the task's own, drawing it twice would only hide the first.
                .filter(|curve| curve.scope == Scope::Task || shares_its_body(csi, task))
                .map(|curve| series(csi, task, curve))
                .collect(),
        })
        .collect();
    CsiFigure {
        width: if panels.len() == 1 { Width::OneColumn } else { Width::TwoColumns },
        panels,
        performance: if csi.experts.is_some() {
            Performance::Relative
        } else {
            Performance::SolvedFraction
        },
        reconstruction: match csi.method {
            Method::PrincipalComponents => Reconstruction::ExplainedVariance,
            Method::Synergies(_) => Reconstruction::RSquared,
        },
        uncertainty: Uncertainty::Bootstrap { confidence: BootstrapOptions::default().confidence },
        provenance,
    }
}

/// A solved fraction as the figure has it.
fn shown(csi: &Csi, task: &TaskCsi, fraction: f64) -> f64 {
    if csi.experts.is_some() { relative(csi, task, Some(fraction)) } else { fraction }
}

fn shares_its_body(csi: &Csi, task: &TaskCsi) -> bool {
    let place = csi.tasks.iter().position(|other| other.task.name == task.task.name);
    place.is_some_and(|place| csi.shared_with[place].len() > 1)
}

fn series(csi: &Csi, task: &TaskCsi, curve: &Curve) -> CsiSeries {
    let undefined = f64::NAN;
    CsiSeries {
        basis: match curve.scope {
            Scope::Task if csi.foreign => Basis::Other,
            Scope::Task => Basis::TaskSpecific,
            Scope::Pooled => Basis::Pooled,
        },
        points: task
            .points(curve)
            .map(|point| CsiPoint {
                components: point.components,
                mean: shown(csi, task, point.solved.mean.unwrap_or(undefined)),
                low: shown(csi, task, point.interval.map_or(undefined, |i| i.low)),
                high: shown(csi, task, point.interval.map_or(undefined, |i| i.high)),
            })
            .collect(),
        explained_variance: curve.drawn_reconstruction.clone(),
        episodes: task.free.len(),
    }
}

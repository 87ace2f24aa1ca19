//! Control-subspace inactivation: how many components of its own muscle space does a policy need? (`spec/analysis.md`
//! §6.1, §7)
//!
//! Per task: episodes of the free policy give the principal components of its action means. The same episodes are then
//! played again with every action projected onto the first k components, for k = 1 … M. All components are the identity,
//! so the last point is the free policy itself and is not played twice. The *pooled* basis is that of all tasks of one body
//! stacked without weights; for a body with one task it is the task's own, and the curve is not played twice either.

use serde_json::{Map, Value, json};

use crate::analysis::stats::{BootstrapOptions, Divisor, Interval, Summary, bootstrap_mean};
use crate::analysis::subspace::{
    self, Covariance, Dimensionality, PrincipalComponents, Projection,
};
use crate::figure::{
    Basis, CsiFigure, CsiPanel, CsiPoint, CsiSeries, Performance, Provenance, Uncertainty, Width,
};
use crate::record::{Column, Table};
use crate::sim::rollout::{self, Channels, Episode, Machine, RolloutPlan};
use crate::sim::tasks::Definition;

use super::{ExperimentError, seed};

/// Shares of the free policy's performance at which functional dimensionality is read.
const PERFORMANCE_SHARES: [f64; 2] = [0.90, 0.95];

/// What to sweep.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct CsiOptions {
    /// Episodes per point.
    pub episodes: usize,
    /// Seed of the plan.
    pub seed: u64,
    /// Numbers of components to play; those beyond the muscle count are left out. `None`: all.
    pub components: Option<Vec<usize>>,
    /// Whether the pooled basis is played as well.
    pub pooled: bool,
}

/// Where a basis comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scope {
    /// The task's own actions.
    Task,
    /// The actions of all tasks of the same body.
    Pooled,
}

impl Scope {
    /// The word in tables: `task` or `global`, as published.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Task => "task",
            Self::Pooled => "global",
        }
    }
}

/// Performance and explained variance against the number of components.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Where the basis comes from.
    pub scope: Scope,
    /// Numbers of components, rising.
    pub components: Vec<usize>,
    /// Share of the task's action variance inside the subspace, one per entry of `components`.
    pub explained_variance: Vec<f64>,
    /// The same for every number of components from 1 on, for drawing.
    pub all_explained_variance: Vec<f64>,
    /// Episodes of each point.
    pub episodes: Vec<Vec<Episode>>,
}

/// One task's sweep.
#[derive(Debug, Clone)]
pub struct TaskCsi {
    /// The task.
    pub task: &'static Definition,
    /// Names of its muscles.
    pub muscles: Vec<String>,
    /// Episodes of the free policy.
    pub free: Vec<Episode>,
    /// The task's own basis.
    pub basis: PrincipalComponents,
    /// Its curves: the task's own, then the pooled one if asked for.
    pub curves: Vec<Curve>,
}

/// A whole sweep.
#[derive(Debug, Clone)]
pub struct Csi {
    /// Tasks in the order asked for.
    pub tasks: Vec<TaskCsi>,
    /// Pooled bases: the tasks that made it, and the basis.
    pub pooled: Vec<(Vec<&'static str>, PrincipalComponents)>,
}

/// The free policy's episodes of one task and what they say of its actions.
struct Collected {
    task: &'static Definition,
    muscles: Vec<String>,
    free: Vec<Episode>,
    covariance: Covariance,
    basis: PrincipalComponents,
}

/// Number of episodes that [`sweep`] will play for a body of `muscle_counts` muscles per task.
#[must_use]
pub fn episode_count(options: &CsiOptions, muscle_counts: &[usize]) -> usize {
    let points = |muscles: usize| played(options, muscles).len();
    let per_task = |&muscles: &usize| {
        let shared = muscle_counts.iter().filter(|&&other| other == muscles).count() > 1;
        let scopes = if options.pooled && shared { 2 } else { 1 };
        1 + scopes * points(muscles)
    };
    options.episodes * muscle_counts.iter().map(per_task).sum::<usize>()
}

/// The numbers of components on a curve.
fn asked(options: &CsiOptions, muscles: usize) -> Vec<usize> {
    match &options.components {
        None => (1..=muscles).collect(),
        Some(list) => {
            let mut list: Vec<usize> =
                list.iter().copied().filter(|k| (1..=muscles).contains(k)).collect();
            list.sort_unstable();
            list.dedup();
            list
        }
    }
}

/// Those of them that must be played: all components are the free policy.
fn played(options: &CsiOptions, muscles: usize) -> Vec<usize> {
    asked(options, muscles).into_iter().filter(|&k| k < muscles).collect()
}

/// Plays the sweep. `plans` has one entry per task.
pub fn sweep(
    machine: &Machine,
    plans: &[RolloutPlan<'_>],
    options: &CsiOptions,
    on_episode: &(dyn Fn(&Episode) + Sync),
) -> Result<Csi, ExperimentError> {
    let collected = plans
        .iter()
        .map(|plan| collect(machine, plan, options, on_episode))
        .collect::<Result<Vec<_>, _>>()?;
    let pooled = if options.pooled { pool(&collected)? } else { Vec::new() };
    let mut tasks = Vec::with_capacity(plans.len());
    for (plan, collected) in plans.iter().zip(collected) {
        let pooled = pooled.iter().find(|(names, _)| names.contains(&plan.task.name));
        tasks.push(play_task(machine, plan, options, collected, pooled, on_episode)?);
    }
    Ok(Csi { tasks, pooled })
}

fn collect(
    machine: &Machine,
    plan: &RolloutPlan<'_>,
    options: &CsiOptions,
    on_episode: &(dyn Fn(&Episode) + Sync),
) -> Result<Collected, ExperimentError> {
    let plan = RolloutPlan { channels: Channels::ActionMeans, projections: &[], ..plan.clone() };
    let specs: Vec<_> = (0..options.episodes)
        .map(|i| seed::episode(options.seed, plan.task.name, i, None))
        .collect();
    let mut free = rollout::play(machine, &plan, &specs, on_episode)?;
    let muscles = rollout::channel_names(machine, plan.task)?.muscles;
    let failed = |source| ExperimentError::Subspace { task: plan.task.name.to_owned(), source };
    let mut covariance = Covariance::new(muscles.len());
    for episode in &mut free {
        let means = std::mem::take(&mut episode.recording.action_mean);
        covariance.push_rows(&means).map_err(failed)?;
    }
    let basis = subspace::principal_components(&covariance).map_err(failed)?;
    Ok(Collected { task: plan.task, muscles, free, covariance, basis })
}

/// One pooled basis per body, from the tasks that share its muscles.
fn pool(
    collected: &[Collected],
) -> Result<Vec<(Vec<&'static str>, PrincipalComponents)>, ExperimentError> {
    let mut groups: Vec<(Vec<&'static str>, Covariance, &[String])> = Vec::new();
    for task in collected {
        let failed = |source| ExperimentError::Subspace { task: "pooled".to_owned(), source };
        match groups.iter_mut().find(|(_, _, muscles)| *muscles == task.muscles.as_slice()) {
            Some((names, covariance, _)) => {
                names.push(task.task.name);
                covariance.merge(&task.covariance).map_err(failed)?;
            }
            None => {
                groups.push((vec![task.task.name], task.covariance.clone(), &task.muscles));
            }
        }
    }
    groups
        .into_iter()
        .map(|(names, covariance, _)| {
            let basis = subspace::principal_components(&covariance).map_err(|source| {
                ExperimentError::Subspace { task: "pooled".to_owned(), source }
            })?;
            Ok((names, basis))
        })
        .collect()
}

fn play_task(
    machine: &Machine,
    plan: &RolloutPlan<'_>,
    options: &CsiOptions,
    collected: Collected,
    pooled: Option<&(Vec<&'static str>, PrincipalComponents)>,
    on_episode: &(dyn Fn(&Episode) + Sync),
) -> Result<TaskCsi, ExperimentError> {
    let Collected { task, muscles, free, covariance, basis } = collected;
    let failed = |source| ExperimentError::Subspace { task: task.name.to_owned(), source };
    let mut bases = vec![(Scope::Task, &basis)];
    let copied = pooled.is_some_and(|(names, _)| names.len() == 1);
    if let (Some((_, pooled)), false) = (pooled, copied) {
        bases.push((Scope::Pooled, pooled));
    }
    let points = played(options, muscles.len());
    let mut projections = Vec::new();
    for (_, basis) in &bases {
        for &count in &points {
            projections.push(Projection::new(basis, count).map_err(failed)?);
        }
    }
    let specs: Vec<_> = (0..projections.len())
        .flat_map(|arm| {
            (0..options.episodes).map(move |i| seed::episode(options.seed, task.name, i, Some(arm)))
        })
        .collect();
    let plan =
        RolloutPlan { channels: Channels::Counts, projections: &projections, ..plan.clone() };
    let mut episodes = rollout::play(machine, &plan, &specs, on_episode)?.into_iter();
    let mut curves = Vec::new();
    for (scope, basis) in bases {
        let explained = subspace::pooled_curve(basis, &covariance).map_err(failed)?;
        let components = asked(options, muscles.len());
        curves.push(Curve {
            scope,
            explained_variance: components.iter().map(|&k| explained[k - 1]).collect(),
            episodes: components
                .iter()
                .map(|&k| {
                    if k == muscles.len() {
                        free.clone()
                    } else {
                        episodes.by_ref().take(options.episodes).collect()
                    }
                })
                .collect(),
            components,
            all_explained_variance: explained,
        });
    }
    if copied {
        curves.push(Curve { scope: Scope::Pooled, ..curves[0].clone() });
    }
    Ok(TaskCsi { task, muscles, free, basis, curves })
}

impl TaskCsi {
    fn fractions(&self, episodes: &[Episode]) -> Vec<f64> {
        episodes.iter().map(|e| e.solved_steps as f64 / self.task.horizon as f64).collect()
    }

    /// Solved fraction of the free policy.
    #[must_use]
    pub fn unprojected(&self) -> Summary {
        Summary::of(&self.fractions(&self.free), Divisor::Count)
    }

    fn points<'a>(&'a self, curve: &'a Curve) -> impl Iterator<Item = Point> + 'a {
        (0..curve.components.len()).map(move |place| {
            let fractions = self.fractions(&curve.episodes[place]);
            Point {
                components: curve.components[place],
                explained_variance: curve.explained_variance[place],
                solved: Summary::of(&fractions, Divisor::Count),
                interval: bootstrap_mean(&fractions, &BootstrapOptions::default()),
            }
        })
    }

    /// Functional dimensionality of a curve at a share of the free policy's performance. Undefined if the curve leaves
    /// out a smaller number of components: the fewest cannot be known then.
    #[must_use]
    pub fn dimensionality(&self, curve: &Curve, share: f64) -> Option<Dimensionality> {
        let unbroken = curve.components.iter().zip(1..).take_while(|&(&k, i)| k == i).count();
        let performance: Vec<Vec<f64>> =
            curve.episodes[..unbroken].iter().map(|episodes| self.fractions(episodes)).collect();
        subspace::functional_dimensionality_of(
            &curve.components[..unbroken],
            &performance,
            &self.fractions(&self.free),
            share,
            &BootstrapOptions::default(),
        )
    }
}

/// One point of a curve.
struct Point {
    components: usize,
    explained_variance: f64,
    solved: Summary,
    interval: Option<Interval>,
}

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
    Ok(Table::new(vec![
        Column::unitless("method", text(&|_, _| "pca".to_owned())),
        Column::unitless("scope", text(&|_, curve| curve.scope.word().to_owned())),
        Column::unitless("basis_policy", text(&|_, _| policy.to_owned())),
        Column::unitless("task", text(&|task, _| task.task.name.to_owned())),
        Column::unitless("dimension", integer(&|point| point.components)),
        Column::unitless("reconstruction", number(&|point| Some(point.explained_variance))),
        Column::unitless("solved_fraction", number(&|point| point.solved.mean)),
        Column::unitless("solved_fraction_sem", number(&|point| point.solved.standard_error)),
        Column::unitless("solved_fraction_low", number(&|point| point.interval.map(|i| i.low))),
        Column::unitless("solved_fraction_high", number(&|point| point.interval.map(|i| i.high))),
        Column::unitless("n_episodes", integer(&|point| point.solved.count)),
        Column::unitless("n_fits", integer(&|_| 1)),
    ])?)
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
        Column::unitless("method", text(&|_, _| "pca")),
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
    let mut columns =
        (Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new(), Vec::new());
    let mut add = |scope: Scope, name: &str, muscles: &[String], basis: &PrincipalComponents| {
        for component in 0..basis.muscle_count() {
            for (place, muscle) in muscles.iter().enumerate() {
                columns.0.push(scope.word().to_owned());
                columns.1.push(name.to_owned());
                columns.2.push(component as i64 + 1);
                columns.3.push(basis.variances[component]);
                columns.4.push(muscle.clone());
                columns.5.push(basis.component(component)[place]);
                columns.6.push(basis.mean[place]);
            }
        }
    };
    for task in &csi.tasks {
        add(Scope::Task, task.task.name, &task.muscles, &task.basis);
    }
    for (names, basis) in &csi.pooled {
        let muscles = csi.tasks.iter().find(|task| names.contains(&task.task.name));
        if let Some(task) = muscles {
            add(Scope::Pooled, &names.join(" "), &task.muscles, basis);
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
                let found = task.dimensionality(curve, share);
                dimensionality.insert(
                    format!("{:.0}%", 100.0 * share),
                    json!({
                        "components": found.and_then(|d| d.components),
                        "interval_95": found.and_then(|d| d.interval).map(|i| [i.low, i.high]),
                    }),
                );
            }
            let unprojected = task.unprojected();
            let entry = json!({
                "components": curve.components,
                "solved_fraction": list(&|p| json!(p.solved.mean)),
                "solved_fraction_sem": list(&|p| json!(p.solved.standard_error)),
                "interval_95": list(&|p| json!(p.interval.map(|i| [i.low, i.high]))),
                "explained_variance": list(&|p| json!(p.explained_variance)),
                "unprojected": {
                    "mean": unprojected.mean,
                    "sem": unprojected.standard_error,
                    "n": unprojected.count,
                },
                "functional_dimensionality": dimensionality,
            });
            tasks.insert(task.task.name.to_owned(), entry);
        }
        Value::Object(tasks)
    };
    json!({"tasks": of_scope(Scope::Task), "pooled": of_scope(Scope::Pooled)})
}

/// The figure: one panel per task.
#[must_use]
pub fn figure(csi: &Csi, provenance: Provenance) -> CsiFigure {
    let panels: Vec<CsiPanel> = csi
        .tasks
        .iter()
        .map(|task| CsiPanel {
            title: task.task.paper_name.to_owned(),
            unprojected: task.unprojected().mean,
            series: task
                .curves
                .iter()
                // Where the pooled curve is the task's own, drawing it twice would only hide the first.
                .filter(|curve| curve.scope == Scope::Task || shares_its_body(csi, task))
                .map(|curve| series(task, curve))
                .collect(),
        })
        .collect();
    CsiFigure {
        width: if panels.len() == 1 { Width::OneColumn } else { Width::TwoColumns },
        panels,
        performance: Performance::SolvedFraction,
        uncertainty: Uncertainty::Bootstrap { confidence: BootstrapOptions::default().confidence },
        provenance,
    }
}

fn shares_its_body(csi: &Csi, task: &TaskCsi) -> bool {
    csi.pooled.iter().any(|(names, _)| names.len() > 1 && names.contains(&task.task.name))
}

fn series(task: &TaskCsi, curve: &Curve) -> CsiSeries {
    let undefined = f64::NAN;
    CsiSeries {
        basis: match curve.scope {
            Scope::Task => Basis::TaskSpecific,
            Scope::Pooled => Basis::Pooled,
        },
        points: task
            .points(curve)
            .map(|point| CsiPoint {
                components: point.components,
                mean: point.solved.mean.unwrap_or(undefined),
                low: point.interval.map_or(undefined, |i| i.low),
                high: point.interval.map_or(undefined, |i| i.high),
            })
            .collect(),
        explained_variance: curve.all_explained_variance.clone(),
        episodes: task.free.len(),
    }
}

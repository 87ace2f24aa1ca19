//! Muscle activity taken apart: principal components and non-negative synergies, per task and pooled
//! (`spec/analysis.md` §6).
//!
//! * Principal components are those of the action means, before noise and clipping. Their curve is the share of a task's
//!   variance in the first n of them: of the task's own, and of those of all its policy's tasks stacked.
//! * Synergies are those of the muscle controls: what the actuators receive after their sigmoid. Every number of
//!   synergies is a fit of its own, repeated with as many seeds as asked for. A fit's score is how well the task's
//!   controls are rebuilt from its synergies with new weights; scores are averaged over the fits.
//!
//! Tasks are pooled without weights, in their order, if their muscles are the same. A policy with one task of a body has no
//! pooled curve of it: it would be the task's own.
//!
//! Degenerate: a task whose actions never change has no components of its own (undefined) and none of its variance in
//! others' (0). There are no more synergies than steps or muscles; curves end there, with a warning.

mod curves;
mod factorise;
mod figures;
mod published;
mod tables;

use crate::analysis::excitation::excitation;
use crate::analysis::subspace::{
    Covariance, NmfOptions, NmfStart, PrincipalComponents, SubspaceError, own_curve, pooled_curve,
    principal_components,
};
use crate::record::{Recording, names};

use super::ExperimentError;
use super::muscle_signal::{Chosen, EpisodeChoice, Take, constant_columns, rates_warning};

pub use factorise::fit_count;
pub use figures::Figures;
pub use published::{published_document, published_figures, published_table};

/// What to compute.
#[derive(Debug, Clone, PartialEq)]
pub struct SynergyPlan {
    /// Whether principal components are computed.
    pub components: bool,
    /// How synergies are computed; `None`: not.
    pub synergies: Option<NmfPlan>,
    pub episodes: EpisodeChoice,
    pub threads: usize,
}

/// How synergies are computed.
#[derive(Debug, Clone, PartialEq)]
pub struct NmfPlan {
    /// Numbers of synergies; `None`: 1 to one less than there are muscles.
    pub ranks: Option<Vec<usize>>,
    /// Fits per number of synergies.
    pub fits: usize,
    /// Whether the zeros of the start are filled with noise, by the number of the fit; else with the mean.
    pub noise: bool,
    pub domain: Domain,
    pub exact_weights: bool,
    pub tolerance: f64,
    pub maximum_iterations: usize,
}

impl NmfPlan {
    fn options(&self, fit: usize) -> NmfOptions {
        NmfOptions {
            start: if self.noise { NmfStart::Noise { seed: fit as u64 } } else { NmfStart::Mean },
            maximum_iterations: self.maximum_iterations,
            tolerance: self.tolerance,
        }
    }
}

/// What is factorised.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Domain {
    /// What the actuators receive: `1 / (1 + exp(−5 (a − 0.5)))`.
    Excitation,
    /// Actions moved to where nothing is negative: `(clip(a, −1, 1) + 1) / 2`.
    Shift,
}

/// Muscle activity of one policy in one task.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskActivity {
    pub take: Take,
    /// Row-major steps × muscles; empty if no components are wanted.
    means: Vec<f64>,
    /// Row-major steps × muscles, not negative; empty if no synergies are wanted.
    controls: Vec<f64>,
    constant: Vec<String>,
}

/// The channels that a recording must have.
#[must_use]
pub fn needed(plan: &SynergyPlan) -> Vec<&'static str> {
    let mut needed = Vec::new();
    if plan.components {
        needed.push(names::ACTION_MEAN);
    }
    match plan.synergies.as_ref().map(|plan| plan.domain) {
        Some(Domain::Excitation) => needed.push(names::EXCITATION),
        Some(Domain::Shift) => needed.push(names::ACTION),
        None => {}
    }
    needed
}

/// What of a recording is analysed.
pub fn read(
    policy: &str,
    recording: &Recording,
    plan: &SynergyPlan,
) -> Result<TaskActivity, ExperimentError> {
    let chosen = Chosen::of(policy, recording, plan.episodes)?;
    let (mut means, mut controls, mut muscles) = (Vec::new(), Vec::new(), Vec::new());
    if plan.components {
        (means, muscles) = chosen.values(names::ACTION_MEAN)?;
    }
    if let Some(synergies) = &plan.synergies {
        let found;
        (controls, found) = match synergies.domain {
            Domain::Excitation if chosen.has(names::EXCITATION) => {
                chosen.values(names::EXCITATION)?
            }
            // The sent action goes through the sigmoid and nothing else on its way to the muscle.
            Domain::Excitation if chosen.has(names::ACTION) => {
                let (mut values, muscles) = chosen.values(names::ACTION)?;
                values.iter_mut().for_each(|a| *a = excitation(*a));
                (values, muscles)
            }
            Domain::Excitation => chosen.values(names::EXCITATION)?,
            Domain::Shift => {
                let (mut values, muscles) = chosen.values(names::ACTION)?;
                values.iter_mut().for_each(|a| *a = f64::midpoint(a.clamp(-1.0, 1.0), 1.0));
                (values, muscles)
            }
        };
        if muscles.is_empty() {
            muscles = found;
        } else if muscles.len() != found.len() {
            return Err(ExperimentError::Muscles {
                policy: policy.to_owned(),
                task: recording.about.task.clone(),
                other: format!("its `{}`", names::ACTION_MEAN),
                expected: muscles.len(),
                found: found.len(),
            });
        }
    }
    let signal = if means.is_empty() { &controls } else { &means };
    let constant = constant_columns(signal, &muscles);
    Ok(TaskActivity { take: chosen.take(muscles), means, controls, constant })
}

/// Whose components or synergies these are.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Scope {
    /// The task's own.
    Task,
    /// Those of all tasks of the same body.
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

/// Tasks of one policy with the same muscles; by their place in the list.
#[derive(Debug, Clone, PartialEq)]
struct Pool {
    policy: String,
    members: Vec<usize>,
    /// What its components are called beside those of tasks.
    name: String,
}

/// A set of data with components or synergies of its own.
#[derive(Debug, Clone, PartialEq)]
struct Basis {
    policy: String,
    /// The task, or the pool's name.
    name: String,
    scope: Scope,
    /// Tasks that it is measured in.
    members: Vec<usize>,
    components: Option<PrincipalComponents>,
}

/// Everything that was found.
#[derive(Debug, Clone, PartialEq)]
pub struct Synergies {
    pub tasks: Vec<Take>,
    bases: Vec<Basis>,
    /// Share of variance in the first n components: one curve per basis and member, in their order; empty without them.
    variance: Vec<Curve>,
    fits: Option<factorise::Fits>,
    plan: SynergyPlan,
    pub warnings: Vec<String>,
}

/// Share of a task's variance in the first n components of a basis; NaN where undefined.
#[derive(Debug, Clone, PartialEq)]
struct Curve {
    basis: usize,
    task: usize,
    values: Vec<f64>,
}

/// Takes the activity apart. `on_fit` is called from several threads, after every fit.
pub fn analyse(
    activities: &[TaskActivity],
    plan: &SynergyPlan,
    on_fit: &(dyn Fn() + Sync),
) -> Result<Synergies, ExperimentError> {
    let mut warnings = warnings_of(activities, plan);
    let mut bases = bases(activities);
    let variance = if plan.components {
        components(activities, &mut bases, &mut warnings)?
    } else {
        Vec::new()
    };
    let fits = match &plan.synergies {
        Some(nmf) => {
            Some(factorise::all(activities, &bases, nmf, plan.threads, &mut warnings, on_fit)?)
        }
        None => None,
    };
    let tasks = activities.iter().map(|activity| activity.take.clone()).collect();
    Ok(Synergies { tasks, bases, variance, fits, plan: plan.clone(), warnings })
}

/// What is odd about the data.
fn warnings_of(activities: &[TaskActivity], plan: &SynergyPlan) -> Vec<String> {
    let mut warnings = Vec::new();
    for TaskActivity { take: Take { policy, task, steps, muscles, .. }, constant, .. } in activities
    {
        if plan.components && *steps <= muscles.len() {
            warnings.push(format!(
                "`{policy}` in `{task}`: {steps} steps for {} muscles, so the last components are arbitrary",
                muscles.len()
            ));
        }
        if !constant.is_empty() {
            let which = if constant.len() == muscles.len() {
                "all muscles".to_owned()
            } else {
                constant.join(", ")
            };
            warnings.push(format!("`{policy}` in `{task}`: constant activity of {which}"));
        }
    }
    let pools = pools(activities);
    for pool in &pools {
        let takes: Vec<&Take> = pool.members.iter().map(|&at| &activities[at].take).collect();
        if pool.members.len() > 1 {
            let warning = rates_warning(&takes);
            warnings.extend(warning.map(|warning| format!("`{}`: {warning}", pool.policy)));
        }
    }
    for policy in policies_of(&pools) {
        let own: Vec<&Pool> = pools.iter().filter(|pool| pool.policy == policy).collect();
        if own.len() > 1 {
            let sizes: Vec<String> = own
                .iter()
                .map(|pool| activities[pool.members[0]].take.muscles.len().to_string())
                .collect();
            warnings.push(format!(
                "`{policy}`: tasks with other muscles ({}) are pooled apart",
                sizes.join(", ")
            ));
        }
    }
    warnings
}

fn policies_of(pools: &[Pool]) -> Vec<&str> {
    let mut policies: Vec<&str> = Vec::new();
    for pool in pools {
        if !policies.contains(&pool.policy.as_str()) {
            policies.push(&pool.policy);
        }
    }
    policies
}

/// One pool per policy and set of muscles, in the order of their first tasks.
fn pools(activities: &[TaskActivity]) -> Vec<Pool> {
    let mut pools: Vec<Pool> = Vec::new();
    for (place, TaskActivity { take, .. }) in activities.iter().enumerate() {
        let fits = |pool: &&mut Pool| {
            pool.policy == take.policy && activities[pool.members[0]].take.muscles == take.muscles
        };
        match pools.iter_mut().find(fits) {
            Some(pool) => pool.members.push(place),
            None => pools.push(Pool {
                policy: take.policy.clone(),
                members: vec![place],
                name: "pooled".to_owned(),
            }),
        }
    }
    for policy in activities.iter().map(|activity| &activity.take.policy) {
        let own: Vec<usize> = (0..pools.len()).filter(|&at| pools[at].policy == *policy).collect();
        if own.len() > 1 {
            for at in own {
                let muscles = activities[pools[at].members[0]].take.muscles.len();
                pools[at].name = format!("pooled ({muscles} muscles)");
            }
        }
    }
    pools
}

/// The tasks' own, then the pools of more than one task.
fn bases(activities: &[TaskActivity]) -> Vec<Basis> {
    let own = activities.iter().enumerate().map(|(place, activity)| Basis {
        policy: activity.take.policy.clone(),
        name: activity.take.task.clone(),
        scope: Scope::Task,
        members: vec![place],
        components: None,
    });
    let pooled = pools(activities).into_iter().filter(|pool| pool.members.len() > 1);
    let pooled = pooled.map(|Pool { policy, members, name }| Basis {
        policy,
        name,
        scope: Scope::Pooled,
        members,
        components: None,
    });
    own.chain(pooled).collect()
}

/// Computes the components of every basis, and their curves in its tasks.
fn components(
    activities: &[TaskActivity],
    bases: &mut [Basis],
    warnings: &mut Vec<String>,
) -> Result<Vec<Curve>, ExperimentError> {
    let failed = |take: &Take| {
        let (policy, task) = (take.policy.clone(), take.task.clone());
        move |source| ExperimentError::Actions { policy, task, source }
    };
    let mut covariances = Vec::with_capacity(activities.len());
    for TaskActivity { take, means, .. } in activities {
        let mut covariance = Covariance::new(take.muscles.len());
        covariance.push_rows(means).map_err(failed(take))?;
        covariances.push(covariance);
    }
    let mut curves = Vec::new();
    for (place, basis) in bases.iter_mut().enumerate() {
        let first = &activities[basis.members[0]].take;
        let mut covariance = covariances[basis.members[0]].clone();
        for &member in &basis.members[1..] {
            covariance.merge(&covariances[member]).map_err(failed(first))?;
        }
        basis.components = match principal_components(&covariance) {
            Ok(components) => Some(components),
            Err(reason @ (SubspaceError::NoVariance { .. } | SubspaceError::TooFewRows { .. })) => {
                warnings.push(format!(
                    "`{}` in `{}` has no components: {reason}",
                    basis.policy, basis.name
                ));
                None
            }
            Err(source) => return Err(failed(first)(source)),
        };
        for &task in &basis.members {
            let values = match &basis.components {
                None => vec![f64::NAN; first.muscles.len()],
                Some(components) if basis.scope == Scope::Task => own_curve(components),
                Some(components) => pooled_curve(components, &covariances[task])
                    .unwrap_or_else(|_| vec![f64::NAN; first.muscles.len()]),
            };
            curves.push(Curve { basis: place, task, values });
        }
    }
    Ok(curves)
}

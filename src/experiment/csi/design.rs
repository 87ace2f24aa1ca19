//! Which episodes a sweep takes.
//!
//! First stage: the free policy in every task; and the policy whose components are used, if it is another. Second stage:
//! for every task, basis and number of components the same episodes again. Where several factorisations stand behind a
//! point, each serves its share of the episodes: fit *f* of *F* those from *f·n/F* on.

use serde_json::{Value, json};

use crate::sim::rollout::{self, Channels, Machine, RolloutError};
use crate::sim::tasks::Definition;

use super::super::plan::Arm;
use super::{CsiOptions, Method, Scope};

/// A task of a sweep.
#[derive(Debug, Clone)]
pub struct Sweeper {
    pub task: &'static Definition,
    /// Names of its muscles.
    pub muscles: Vec<String>,
}

/// A sweep as it will be played.
#[derive(Debug, Clone)]
pub struct Design {
    pub options: CsiOptions,
    pub tasks: Vec<Sweeper>,
    /// What decides about the policy whose components are used, if it is not the one that acts.
    pub components_of: Option<Value>,
}

/// An arm of the second stage.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Point {
    /// Place of the task.
    pub(super) task: usize,
    pub(super) scope: Scope,
    pub(super) components: usize,
    pub(super) fit: usize,
}

impl Design {
    /// The sweep of `tasks`.
    pub fn new(
        machine: &Machine,
        tasks: &[&'static Definition],
        options: CsiOptions,
        components_of: Option<Value>,
    ) -> Result<Self, RolloutError> {
        let sweeper = |&task: &&'static Definition| {
            Ok(Sweeper { task, muscles: rollout::channel_names(machine, task)?.muscles })
        };
        let tasks = tasks.iter().map(sweeper).collect::<Result<_, RolloutError>>()?;
        Ok(Self { options, tasks, components_of })
    }

    /// All episodes: those of the free policy, of the policy whose components are used, and the projected ones.
    #[must_use]
    pub fn arms(&self) -> Vec<Arm> {
        let channels = match self.options.method {
            Method::PrincipalComponents => Channels::ActionMeans,
            Method::Synergies(_) => Channels::Excitations,
        };
        let free = |policy: usize| {
            self.tasks.iter().map(move |sweeper| Arm {
                stage: 0,
                task: sweeper.task.name.to_owned(),
                policy,
                condition: Value::Null,
                first: 0,
                episodes: self.options.episodes,
                channels,
            })
        };
        let source = self.components_of.iter().flat_map(|_| free(1));
        let projected = self.points().into_iter().map(|point| self.arm(point));
        free(0).chain(source).chain(projected).collect()
    }

    fn arm(&self, point: Point) -> Arm {
        let (first, end) = self.served(point.fit);
        Arm {
            stage: 1,
            task: self.tasks[point.task].task.name.to_owned(),
            policy: 0,
            condition: self.condition(point),
            first,
            episodes: end - first,
            channels: Channels::Counts,
        }
    }

    /// Everything that decides the basis of `point`, beside the policy that acts and what all episodes share.
    pub(super) fn condition(&self, point: Point) -> Value {
        let mut condition = json!({
            "basis": self.options.method.word(),
            "of_tasks": self.sources(point.task, point.scope).1,
            "of_episodes": self.options.episodes,
            "components": point.components,
        });
        if let Some(policy) = &self.components_of {
            condition["of_policy"] = policy.clone();
        }
        if let Method::Synergies(options) = &self.options.method {
            condition["fit"] = options.document(point.fit);
        }
        condition
    }

    /// The first of the episodes that `fit` serves, and the one after the last.
    fn served(&self, fit: usize) -> (usize, usize) {
        let (episodes, fits) = (self.options.episodes, self.options.method.fits());
        (fit * episodes / fits, (fit + 1) * episodes / fits)
    }

    /// The arms of the second stage, in order.
    pub(super) fn points(&self) -> Vec<Point> {
        let mut points = Vec::new();
        for task in 0..self.tasks.len() {
            let mut scopes = vec![Scope::Task];
            if self.options.pooled && self.sources(task, Scope::Pooled).0.len() > 1 {
                scopes.push(Scope::Pooled);
            }
            for scope in scopes {
                for components in self.played(task) {
                    let fits = 0..self.options.method.fits();
                    points.extend(fits.map(|fit| Point { task, scope, components, fit }));
                }
            }
        }
        points
    }

    /// Number of arms of the first stage.
    pub(super) fn free_arms(&self) -> usize {
        self.tasks.len() * if self.components_of.is_some() { 2 } else { 1 }
    }

    /// The arm of the first stage whose actions make the basis of `task`.
    pub(super) fn source_arm(&self, task: usize) -> usize {
        task + if self.components_of.is_some() { self.tasks.len() } else { 0 }
    }

    /// The places and names of the tasks whose actions make the basis.
    pub(super) fn sources(&self, task: usize, scope: Scope) -> (Vec<usize>, Vec<&'static str>) {
        let shares = |other: &usize| match scope {
            Scope::Task => *other == task,
            Scope::Pooled => self.tasks[*other].muscles == self.tasks[task].muscles,
        };
        let places: Vec<usize> = (0..self.tasks.len()).filter(shares).collect();
        let names = places.iter().map(|&place| self.tasks[place].task.name).collect();
        (places, names)
    }

    /// The numbers of components on a curve of `task`.
    pub(super) fn asked(&self, task: usize) -> Vec<usize> {
        let muscles = self.tasks[task].muscles.len();
        match &self.options.components {
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
    fn played(&self, task: usize) -> Vec<usize> {
        let muscles = self.tasks[task].muscles.len();
        self.asked(task).into_iter().filter(|&k| k < muscles).collect()
    }
}

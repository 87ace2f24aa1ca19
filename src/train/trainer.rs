//! One training run in memory: play a rollout, improve the parameters, and again (`spec/training.md` §5.3–5.6).

use std::collections::VecDeque;

use serde_json::{Value, json};

use super::adam::{Adam, AdamSettings};
use super::body::FinishedEpisode;
use super::collector::{Collected, Collector};
use super::recipe::{NetworkShape, Recipe};
use super::start::Start;
use super::streams::{Purpose, Streams};
use super::students;
use super::teacher::TeacherPolicy;
use super::{Losses, Sample, TrainError, Trainable};
use crate::policy::checkpoint::contents::{Checkpoint, Normaliser};
use crate::sim::bodies::Bodies;
use crate::sim::environment::Environment;
use crate::sim::tasks::Definition;

/// Episodes that the mean return and length are taken over.
const RECENT: usize = 100;
/// The tensor of the exploration.
const LOG_DEVIATION: &str = "log_std";

/// Everything that decides the result of a run.
#[derive(Debug, Clone)]
pub struct Plan {
    /// What is trained on.
    pub tasks: Vec<TaskPlan>,
    pub recipe: Recipe,
    pub seed: u64,
    /// Control steps of all environments together, on top of those that `start` has seen.
    pub total_steps: u64,
    /// What it begins with, if not with nothing.
    pub start: Option<Start>,
}

/// One task of a run.
#[derive(Debug, Clone)]
pub struct TaskPlan {
    pub definition: &'static Definition,
    /// How many bodies play it.
    pub environments: usize,
    /// Whom it is learned from.
    pub teacher: Option<TeacherPolicy>,
}

impl Plan {
    /// Control steps that were done before this run.
    #[must_use]
    pub fn first_step(&self) -> u64 {
        self.start.as_ref().map_or(0, |start| start.steps)
    }

    /// Control steps at its end.
    #[must_use]
    pub fn last_step(&self) -> u64 {
        self.first_step().saturating_add(self.total_steps)
    }

    /// As `args.json` holds it.
    #[must_use]
    pub fn document(&self) -> Value {
        let teacher = |task: &TaskPlan| {
            let teacher = task.teacher.as_ref();
            teacher.map(|teacher| json!({"name": teacher.name, "blake3": teacher.hash}))
        };
        let start = self
            .start
            .as_ref()
            .map(|start| json!({"name": start.name, "blake3": start.hash, "steps": start.steps}));
        json!({
            "tasks": self.tasks.iter().map(|task| task.definition.name).collect::<Vec<_>>(),
            "environments": self.tasks.iter().map(|task| task.environments).collect::<Vec<_>>(),
            "teachers": self.tasks.iter().map(teacher).collect::<Vec<_>>(),
            "recipe": self.recipe,
            "seed": self.seed,
            "num_steps": self.total_steps,
            "start": start,
        })
    }
}

/// What one iteration showed.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    /// Control steps so far.
    pub steps: u64,
    pub learning_rate: f64,
    /// Means over the minibatches of the update.
    pub losses: Losses,
    /// Mean norm of the gradient before clipping.
    pub gradient_norm: f64,
    /// Mean standard deviation of the exploration, if it is the same in every state.
    pub deviation: Option<f64>,
    pub explained_variance: Option<f64>,
    /// Share of solved steps of the rollout, by task.
    pub solved: Vec<f64>,
    /// By task, the mean of every reward component.
    pub components: Vec<Vec<(&'static str, f64)>>,
    /// Mean raw return of the last hundred episodes.
    pub episode_reward: Option<f64>,
    /// Their mean length.
    pub episode_length: Option<f64>,
}

/// A run.
pub struct Trainer {
    pub(super) plan: Plan,
    pub(super) network: Box<dyn Trainable>,
    pub(super) adam: Adam,
    pub(super) collector: Collector,
    pub(super) streams: Streams,
    /// Iterations done.
    pub(super) iteration: usize,
    /// Control steps done.
    pub(super) steps: u64,
    pub(super) recent: VecDeque<FinishedEpisode>,
    gradient: Vec<f32>,
}

impl std::fmt::Debug for Trainer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "a run after {} of {} steps", self.steps, self.plan.total_steps)
    }
}

impl Trainer {
    /// A run before its first step.
    pub fn new(plan: Plan, bodies: &Bodies) -> Result<Self, TrainError> {
        let streams = Streams { seed: plan.seed };
        if plan.recipe.coefficients.imitates() && plan.tasks.iter().any(|t| t.teacher.is_none()) {
            let what = "imitating takes a teacher for every task".to_owned();
            return Err(TrainError::Plan { what });
        }
        let interfaces = plan.tasks.iter().map(|task| {
            let rewards = plan.recipe.rewards.configuration();
            Ok(Environment::new(task.definition, bodies, rewards)?.interface())
        });
        let interfaces = interfaces.collect::<Result<Vec<_>, TrainError>>()?;
        let (mut network, mut statistics) =
            students::student(&plan.recipe.network, &interfaces, streams)?;
        if plan.recipe.log_deviation.is_some() {
            if matches!(&plan.recipe.network, NetworkShape::Perceptron(shape) if shape.lattice) {
                let what = "the deviation of a lattice is learned, it has no schedule".to_owned();
                return Err(TrainError::Plan { what });
            }
            network.parameters_mut().freeze(|name| name == LOG_DEVIATION);
        }
        let mut adam = Adam::new(AdamSettings::default(), network.parameters());
        if let Some(start) = &plan.start {
            start.write_parameters(network.parameters_mut())?;
            adam = start.optimiser(network.parameters());
            start.write_statistics(&mut statistics)?;
        }
        if let Some(log_deviation) = plan.recipe.reset_deviation {
            network.parameters_mut().fill(LOG_DEVIATION, log_deviation as f32)?;
        }
        let mut collector = Collector::new(&plan, bodies, streams, network.as_ref(), statistics)?;
        if let Some(start) = &plan.start {
            start.write_returns(&mut collector.rewards);
        }
        collector.begin();
        let steps = plan.first_step();
        Ok(Self {
            plan,
            network,
            adam,
            collector,
            streams,
            iteration: 0,
            steps,
            recent: VecDeque::with_capacity(RECENT),
            gradient: Vec::new(),
        })
    }

    #[must_use]
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Control steps so far.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Whether the run has all its steps.
    #[must_use]
    pub fn is_finished(&self) -> bool {
        self.steps >= self.plan.last_step()
    }

    /// The policy as it is now, with its normaliser.
    #[must_use]
    pub fn policy(&self) -> (Checkpoint, Normaliser) {
        let mut checkpoint = self.network.checkpoint();
        checkpoint.scalars.training_steps = Some(self.steps);
        (checkpoint, self.collector.observations.to_stored())
    }

    /// One rollout and one update.
    pub fn iterate(&mut self, threads: usize) -> Result<Report, TrainError> {
        let recipe = &self.plan.recipe;
        let done = self.steps - self.plan.first_step();
        let learning_rate = recipe.learning_rate.rate(done, self.plan.total_steps);
        if let Some(schedule) = &recipe.log_deviation {
            let log = schedule.rate(done, self.plan.total_steps);
            self.network.parameters_mut().fill(LOG_DEVIATION, log as f32)?;
        }
        let (network, steps) = (self.network.as_ref(), recipe.rollout_steps);
        let collected = self.collector.collect(network, self.iteration, steps, threads);
        let Update { losses, gradient_norm } = self.update(learning_rate, threads)?;
        self.steps += (self.plan.recipe.rollout_steps * self.collector.bodies.len()) as u64;
        self.iteration += 1;
        let Collected { episodes, solved, components, explained_variance } = collected;
        for episode in episodes {
            if self.recent.len() == RECENT {
                self.recent.pop_front();
            }
            self.recent.push_back(episode);
        }
        Ok(Report {
            steps: self.steps,
            learning_rate,
            losses,
            gradient_norm,
            deviation: self.deviation(),
            explained_variance,
            solved,
            components,
            episode_reward: self.mean_of_recent(|episode| episode.reward),
            episode_length: self.mean_of_recent(|episode| episode.steps as f64),
        })
    }

    /// Goes over the rollout several times, in minibatches drawn without regard to environment and time.
    fn update(&mut self, learning_rate: f64, threads: usize) -> Result<Update, TrainError> {
        let recipe = &self.plan.recipe;
        let mut random = self.streams.of(Purpose::Update, [self.iteration, 0]);
        let bodies = &self.collector.bodies;
        let mut order: Vec<u32> = (0..(bodies.len() * recipe.rollout_steps) as u32).collect();
        let mut noise = Vec::with_capacity(recipe.minibatch);
        let (mut sum, mut norms, mut updates) = (Losses::default(), 0.0, 0.0);
        for _ in 0..recipe.epochs {
            for place in (1..order.len()).rev() {
                order.swap(place, random.index(place as u32 + 1) as usize);
            }
            for minibatch in order.chunks(recipe.minibatch) {
                let place = |&index: &u32| {
                    let (index, steps) = (index as usize, recipe.rollout_steps);
                    (&bodies[index / steps], index % steps)
                };
                noise.clear();
                for (body, _) in minibatch.iter().map(place) {
                    let draws = recipe.coefficients.draws();
                    let length = if draws { self.network.noise_length(body.task) } else { 0 };
                    noise.push((0..length).map(|_| random.normal() as f32).collect::<Vec<f32>>());
                }
                let samples = minibatch.iter().map(place).zip(&noise);
                let samples: Vec<Sample<'_>> =
                    samples.map(|((body, step), noise)| body.sample(step, noise)).collect();
                let losses = self.network.gradient(
                    &samples,
                    &recipe.coefficients,
                    threads,
                    &mut self.gradient,
                )?;
                if !losses.total.is_finite() {
                    return Err(TrainError::NotFinite { what: "loss" });
                }
                let limit = Some(recipe.gradient_norm);
                let parameters = self.network.parameters_mut();
                norms += self.adam.step(parameters, &self.gradient, learning_rate, limit)?;
                sum.add(&losses);
                updates += 1.0;
            }
        }
        Ok(Update { losses: sum.over(updates), gradient_norm: norms / updates })
    }

    fn deviation(&self) -> Option<f64> {
        let parameters = self.network.parameters();
        let range = parameters.place(LOG_DEVIATION).ok()?.range.clone();
        let logs = &parameters.numbers()[range];
        Some(logs.iter().map(|&log| f64::from(log).exp()).sum::<f64>() / logs.len() as f64)
    }

    fn mean_of_recent(&self, value: impl Fn(&FinishedEpisode) -> f64) -> Option<f64> {
        let count = self.recent.len();
        (count > 0).then(|| self.recent.iter().map(value).sum::<f64>() / count as f64)
    }
}

/// What an update showed.
struct Update {
    losses: Losses,
    gradient_norm: f64,
}

//! One training run in memory: play a rollout, improve the parameters, and again (`spec/training.md` §5.3–5.6).

use std::path::Path;

use super::adam::{Adam, AdamSettings};
use super::collector::{Collector, Conditions, Stretch, interfaces};
use super::evaluation;
use super::learner::{Learner, Report};
use super::plan::Plan;
use super::recipe::{NetworkShape, Recipe};
use super::shards::Sum;
use super::streams::{Purpose, Streams};
use super::students;
use super::teacher::Lead;
use super::{Losses, Sample, TrainError, Trainable};
use crate::policy::checkpoint::contents::{Checkpoint, Normaliser};
use crate::sim::bodies::Bodies;
use crate::sim::rollout::{ActionMode, Machine};

/// The tensor of the exploration.
const LOG_DEVIATION: &str = "log_std";

/// A run.
pub struct Trainer {
    pub(super) plan: Plan,
    pub(super) network: Box<dyn Trainable>,
    pub(super) adam: Adam,
    pub(super) collector: Collector,
    streams: Streams,
    /// Iterations done.
    pub(super) iteration: usize,
    /// Control steps done.
    pub(super) steps: u64,
    gradient: Vec<f32>,
}

impl std::fmt::Debug for Trainer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "a run after {} of {} steps", self.steps, self.plan.total_steps)
    }
}

/// What the teacher plays himself.
fn lead(recipe: &Recipe) -> Result<Lead, TrainError> {
    let share = recipe.teacher_leads;
    let what = if !(0.0..=1.0).contains(&share) {
        format!("`teacher_leads` is a share of episodes, from 0 to 1, not {share}")
    } else if share > 0.0 && recipe.coefficients.policy_gradient != 0.0 {
        "rewards teach by the student's own actions: `teacher_leads` goes with imitation alone"
            .to_owned()
    } else if recipe.teacher_acts {
        return Ok(Lead::Everything);
    } else if share > 0.0 {
        return Ok(Lead::Beginnings { share });
    } else {
        return Ok(Lead::Nothing);
    };
    Err(TrainError::Plan { what })
}

impl Learner for Trainer {
    type Recipe = Recipe;

    fn new(plan: Plan, bodies: &Bodies) -> Result<Self, TrainError> {
        let streams = Streams { seed: plan.seed };
        let recipe = &plan.recipe;
        if recipe.coefficients.imitates() && plan.tasks.iter().any(|t| t.teacher.is_none()) {
            let what = "imitating takes a teacher for every task".to_owned();
            return Err(TrainError::Plan { what });
        }
        let interfaces = interfaces(&plan, &recipe.rewards, bodies)?;
        let (mut network, mut statistics) =
            students::student(&recipe.network, &interfaces, streams)?;
        if recipe.log_deviation.is_some() {
            if matches!(&recipe.network, NetworkShape::Perceptron(shape) if shape.lattice) {
                let what = "the deviation of a lattice is learned, it has no schedule".to_owned();
                return Err(TrainError::Plan { what });
            }
            network.parameters_mut().freeze(|name| name == LOG_DEVIATION);
        }
        let mut adam = Adam::new(AdamSettings::default(), network.parameters());
        if let Some(start) = &plan.start {
            start.write_parameters(network.as_mut())?;
            adam = start.optimiser(network.parameters());
            start.write_statistics(&mut statistics)?;
        }
        if let Some(log_deviation) = recipe.reset_deviation {
            network.parameters_mut().fill(LOG_DEVIATION, log_deviation as f32)?;
        }
        let conditions = Conditions {
            rewards: &recipe.rewards,
            discount: recipe.discount,
            lead: lead(recipe)?,
            lengths: &|task| [network.action_length(task), network.noise_length(task)],
        };
        let mut collector = Collector::new(&plan, &conditions, bodies, statistics)?;
        if let Some(start) = &plan.start {
            start.write_returns(&mut collector.scales.rewards);
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
            gradient: Vec::new(),
        })
    }

    fn plan(&self) -> &Plan {
        &self.plan
    }

    fn steps(&self) -> u64 {
        self.steps
    }

    fn policy(&self) -> (Checkpoint, Normaliser) {
        let mut checkpoint = self.network.checkpoint();
        checkpoint.scalars.training_steps = Some(self.steps);
        (checkpoint, self.collector.scales.observations.to_stored())
    }

    /// One rollout and one update.
    fn iterate(&mut self, threads: usize) -> Result<Report, TrainError> {
        let recipe = &self.plan.recipe;
        let done = self.steps - self.plan.first_step();
        let learning_rate = recipe.learning_rate.rate(done, self.plan.total_steps);
        if let Some(schedule) = &recipe.log_deviation {
            let log = schedule.rate(done, self.plan.total_steps);
            self.network.parameters_mut().fill(LOG_DEVIATION, log as f32)?;
        }
        let (network, discounts) = (self.network.as_ref(), recipe.discounts());
        let mut player = network.player();
        let stretch = Stretch { iteration: self.iteration, steps: recipe.rollout_steps, threads };
        let shown =
            self.collector.play(stretch, &|| network.player(), &mut |seat, body, scales| {
                let raw = body.reward;
                let mut reward =
                    if recipe.normalise_rewards { scales.rewards.scale(seat, raw) } else { raw };
                if body.outcome.truncated {
                    // The episode would have gone on: what it was still worth counts as reward.
                    scales.observations.normalise(body.task, &body.terminal, &mut body.observation);
                    let value = player.value(body.task, &body.observation);
                    reward += discounts.reward * f64::from(value);
                }
                body.course.rewards.push(reward as f32);
            });
        let explained_variance = self.collector.advantages(player.as_mut(), discounts);
        drop(player);
        let Update { losses, gradient_norm } = self.update(learning_rate, threads)?;
        self.steps += (self.plan.recipe.rollout_steps * self.collector.bodies.len()) as u64;
        self.iteration += 1;
        let [episode_reward, episode_length] = self.collector.mean_episode();
        let training = vec![
            ("train/loss", losses.total),
            ("train/policy_gradient_loss", losses.policy_gradient),
            ("train/value_loss", losses.value),
            ("train/entropy_loss", losses.entropy),
            ("train/imitation_loss", losses.imitation),
            ("train/approx_kl", losses.approximate_divergence),
            ("train/clip_fraction", losses.clip_fraction),
            ("train/explained_variance", explained_variance.unwrap_or(f64::NAN)),
            ("train/gradient_norm", gradient_norm),
            ("train/std", self.deviation().unwrap_or(f64::NAN)),
            ("train/learning_rate", learning_rate),
        ];
        let (steps, solved, components) = (self.steps, shown.solved, shown.components);
        Ok(Report { steps, solved, components, episode_reward, episode_length, training })
    }

    fn evaluate(&self, machine: &Machine, episodes: usize) -> Result<Vec<f64>, TrainError> {
        let mode = match &self.plan.recipe.network {
            NetworkShape::Perceptron(shape) if shape.windows.is_none() => ActionMode::Deterministic,
            _ => ActionMode::Stochastic,
        };
        let rewards = &self.plan.recipe.rewards;
        evaluation::evaluate(&self.plan, rewards, &self.policy(), mode, machine, episodes)
    }

    fn save(&self, path: &Path) -> Result<(), TrainError> {
        self.write_state(path)
    }

    fn restore(&mut self, path: &Path) -> Result<(), TrainError> {
        self.read_state(path)
    }
}

impl Trainer {
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
}

/// What an update showed.
struct Update {
    losses: Losses,
    gradient_norm: f64,
}

//! A soft actor-critic in memory: play a stretch, draw from what is remembered as often as there were new transitions, and
//! again (`spec/training.md` §5.10).
//!
//! Of an update, in this order: the critics take a step, the actor takes one by the new critics, the targets follow, and the
//! temperature takes one by what the actor drew. All use the temperature as it was before, as Stable-Baselines3 does.

use std::path::Path;

use super::recipe::SoftRecipe;
use super::replay::{self, Replay};
use crate::policy::TaskInterface;
use crate::policy::checkpoint::contents::{Checkpoint, Normaliser};
use crate::policy::running_components::RunningComponents;
use crate::random::Random;
use crate::sim::bodies::Bodies;
use crate::sim::rollout::{ActionMode, Machine};
use crate::train::adam::{Adam, AdamSettings};
use crate::train::collector::{Collector, Conditions, Stretch, interfaces};
use crate::train::evaluation;
use crate::train::learner::{Learner, Report};
use crate::train::network::soft::{
    SoftActorCritic, SoftLosses, SoftPlayer, SoftSettings, Transitions, UniformPlayer,
};
use crate::train::plan::Plan;
use crate::train::streams::{Purpose, Streams};
use crate::train::students;
use crate::train::teacher::Lead;
use crate::train::{Parameters, Player, TrainError};

/// Added by the optimiser to the root of a gradient's mean square: PyTorch's own default.
pub(super) const ADAM: AdamSettings = AdamSettings { betas: [0.9, 0.999], epsilon: 1e-8 };
/// The temperature's logarithm, as a parameter.
const LOG_TEMPERATURE: &str = "log_ent_coef";

/// A run.
pub struct SoftTrainer {
    pub(super) plan: Plan<SoftRecipe>,
    pub(super) network: SoftActorCritic,
    pub(super) temperature: Parameters,
    pub(super) optimisers: Optimisers,
    pub(super) collector: Collector,
    pub(super) replay: Replay,
    streams: Streams,
    /// Iterations done.
    pub(super) iteration: usize,
    /// Control steps done.
    pub(super) steps: u64,
    batch: Transitions,
    gradient: Vec<f32>,
}

/// One for each of what is learned.
pub(super) struct Optimisers {
    pub(super) actor: Adam,
    pub(super) critics: Adam,
    pub(super) temperature: Adam,
}

impl std::fmt::Debug for SoftTrainer {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "a run after {} of {} steps", self.steps, self.plan.total_steps)
    }
}

/// Bytes of the full replay buffer of `plan`.
pub fn replay_bytes(plan: &Plan<SoftRecipe>, bodies: &Bodies) -> Result<u64, TrainError> {
    let interfaces = interfaces(plan, &plan.recipe.rewards, bodies)?;
    let width = students::most_muscles(&interfaces);
    Ok(replay::bytes(plan.recipe.buffer, &sensors(plan, &interfaces), width))
}

/// Sensors of every environment.
fn sensors(plan: &Plan<SoftRecipe>, interfaces: &[TaskInterface]) -> Vec<usize> {
    let of_task = |(task, interface): (&crate::train::plan::TaskPlan, &TaskInterface)| {
        std::iter::repeat_n(interface.observation_words.len(), task.environments)
    };
    plan.tasks.iter().zip(interfaces).flat_map(of_task).collect()
}

impl Learner for SoftTrainer {
    type Recipe = SoftRecipe;

    fn new(plan: Plan<SoftRecipe>, bodies: &Bodies) -> Result<Self, TrainError> {
        let recipe = &plan.recipe;
        check(recipe)?;
        let streams = Streams { seed: plan.seed };
        let interfaces = interfaces(&plan, &recipe.rewards, bodies)?;
        let (input, statistics) = students::padded(recipe.network.windows, &interfaces);
        let actions = students::most_muscles(&interfaces);
        let settings = SoftSettings {
            input,
            actions,
            hidden: recipe.network.hidden.clone(),
            activation: recipe.network.activation,
        };
        let mut random = streams.of(Purpose::Initialisation, [0, 0]);
        let network = SoftActorCritic::new(settings, &mut random)?;
        let mut temperature = Parameters::zeros([(LOG_TEMPERATURE.to_owned(), Vec::new())]);
        temperature.fill(LOG_TEMPERATURE, recipe.log_temperature as f32)?;
        let conditions = Conditions {
            rewards: &recipe.rewards,
            discount: recipe.discount,
            lead: Lead::Nothing,
            lengths: &|_| [actions; 2],
        };
        let mut collector = Collector::new(&plan, &conditions, bodies, statistics)?;
        collector.begin();
        let sensors = sensors(&plan, &interfaces);
        let mut replay =
            Replay::new(recipe.buffer, &sensors, actions, recipe.network.windows.lags)?;
        for (ring, body) in replay.rings.iter_mut().zip(&collector.bodies) {
            ring.begin(body.raw());
        }
        let optimisers = Optimisers {
            actor: Adam::new(ADAM, &network.actor),
            critics: Adam::new(ADAM, &network.critics),
            temperature: Adam::new(ADAM, &temperature),
        };
        Ok(Self {
            plan,
            network,
            temperature,
            optimisers,
            collector,
            replay,
            streams,
            iteration: 0,
            steps: 0,
            batch: Transitions::default(),
            gradient: Vec::new(),
        })
    }

    fn plan(&self) -> &Plan<SoftRecipe> {
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

    /// A stretch and its updates; the first one, played at random, has none.
    fn iterate(&mut self, threads: usize) -> Result<Report, TrainError> {
        let recipe = &self.plan.recipe;
        let learning_rate = recipe.learning_rate.rate(self.steps, self.plan.total_steps);
        let environments = self.collector.bodies.len();
        let is_start = self.iteration == 0 && recipe.start_steps > 0;
        let steps =
            if is_start { recipe.start_steps.div_ceil(environments) } else { recipe.rollout_steps };
        let (network, rings) = (&self.network, &mut self.replay.rings);
        let player = || -> Box<dyn Player + '_> {
            if is_start { Box::new(UniformPlayer) } else { Box::new(SoftPlayer::new(network)) }
        };
        let stretch = Stretch { iteration: self.iteration, steps, threads };
        let lags = recipe.network.windows.lags;
        let mut last = Vec::new();
        let shown = self.collector.play(stretch, &player, &mut |seat, body, _| {
            let (ring, reward, ends) =
                (&mut rings[seat], body.reward as f32, body.outcome.terminated);
            if body.finished.is_some() {
                last.clear();
                last.extend(body.terminal.iter().skip(lags - 1).step_by(lags));
                ring.step(body.action(), reward, ends, &last);
                ring.begin(body.raw());
            } else {
                ring.step(body.action(), reward, ends, body.raw());
            }
        });
        let updates = if is_start { 0 } else { recipe.updates.unwrap_or(steps * environments) };
        let (losses, temperature_loss) = self.update(updates, learning_rate, threads)?;
        self.steps += (steps * environments) as u64;
        self.iteration += 1;
        let [episode_reward, episode_length] = self.collector.mean_episode();
        let training = vec![
            ("train/critic_loss", losses.critic),
            ("train/actor_loss", losses.actor),
            ("train/ent_coef", self.temperature()),
            ("train/ent_coef_loss", temperature_loss),
            ("train/entropy", -losses.log_probability),
            ("train/learning_rate", learning_rate),
        ];
        let (steps, solved, components) = (self.steps, shown.solved, shown.components);
        Ok(Report { steps, solved, components, episode_reward, episode_length, training })
    }

    fn evaluate(&self, machine: &Machine, episodes: usize) -> Result<Vec<f64>, TrainError> {
        let rewards = &self.plan.recipe.rewards;
        let mode = ActionMode::Stochastic;
        evaluation::evaluate(&self.plan, rewards, &self.policy(), mode, machine, episodes)
    }

    fn save(&self, path: &Path) -> Result<(), TrainError> {
        self.write_state(path)
    }

    fn restore(&mut self, path: &Path) -> Result<(), TrainError> {
        self.read_state(path)
    }
}

/// Refuses constants that no run can have.
fn check(recipe: &SoftRecipe) -> Result<(), TrainError> {
    let wrong = [
        (recipe.minibatch == 0, "a minibatch of no transitions"),
        (recipe.rollout_steps == 0, "no steps between its updates"),
        (recipe.environments == 0, "no environments"),
        (recipe.network.windows.lags == 0, "windows of no observations"),
    ];
    match wrong.iter().find(|(is_wrong, _)| *is_wrong) {
        Some((_, what)) => Err(TrainError::Plan { what: format!("a run cannot have {what}") }),
        None => Ok(()),
    }
}

impl SoftTrainer {
    fn temperature(&self) -> f64 {
        f64::from(self.temperature.numbers()[0]).exp()
    }

    /// So many updates. Returns their mean losses, and that of the temperature.
    fn update(
        &mut self,
        updates: usize,
        learning_rate: f64,
        threads: usize,
    ) -> Result<(SoftLosses, f64), TrainError> {
        let (discount, target_rate, target_entropy) = {
            let recipe = &self.plan.recipe;
            let most = -(self.network.settings().actions as f64);
            (recipe.discount, recipe.target_rate, recipe.target_entropy.unwrap_or(most))
        };
        let mut random = self.streams.of(Purpose::Update, [self.iteration, 0]);
        let averaged = self.averaged()?;
        let (mut sum, mut temperature_sum) = (SoftLosses::default(), 0.0);
        for _ in 0..updates {
            self.draw(&mut random, averaged.as_ref());
            let temperature = self.temperature();
            let Self { network, batch, gradient, optimisers, .. } = self;
            let judged = network.critic_gradient(batch, temperature, discount, threads, gradient);
            optimisers.critics.step(&mut network.critics, gradient, learning_rate, None)?;
            let acted = network.actor_gradient(batch, temperature, threads, gradient);
            optimisers.actor.step(&mut network.actor, gradient, learning_rate, None)?;
            network.follow(target_rate);
            let excess = acted.log_probability + target_entropy;
            temperature_sum -= temperature.ln() * excess;
            optimisers.temperature.step(
                &mut self.temperature,
                &[-excess as f32],
                learning_rate,
                None,
            )?;
            sum = SoftLosses {
                critic: sum.critic + judged.critic,
                actor: sum.actor + acted.actor,
                log_probability: sum.log_probability + acted.log_probability,
            };
        }
        let count = updates as f64;
        Ok((sum.over(count), temperature_sum / count))
    }

    /// Statistics averaged over all environments, if the recipe asks for them.
    fn averaged(&self) -> Result<Option<RunningComponents>, TrainError> {
        if !self.plan.recipe.averaged_statistics {
            return Ok(None);
        }
        let tasks: Vec<usize> = self.collector.bodies.iter().map(|body| body.task).collect();
        let longest = self.network.settings().input.longest();
        Ok(Some(self.collector.scales.observations.averaged(&tasks, longest)?))
    }

    /// Fills the minibatch with what is remembered, scaled as it is scaled now.
    fn draw(&mut self, random: &mut Random, averaged: Option<&RunningComponents>) {
        let Self { replay, collector, network, plan, batch, .. } = self;
        let (recipe, scales) = (&plan.recipe, &collector.scales);
        let (input, actions) = (&network.settings().input, network.settings().actions);
        let (count, width) = (recipe.minibatch, input.width());
        batch.states.resize(count * width, 0.0);
        batch.next_states.resize(count * width, 0.0);
        batch.actions.clear();
        batch.rewards.clear();
        batch.goes_on.clear();
        let mut raw = vec![0.0; input.longest()];
        let states =
            batch.states.chunks_exact_mut(width).zip(batch.next_states.chunks_exact_mut(width));
        for (state, next_state) in states {
            let pick = replay.pick(random);
            let task = collector.bodies[pick.seat].task;
            let seen = input.length(task).unwrap_or(0);
            for (row, is_next) in [(state, false), (next_state, true)] {
                let windows = &mut raw[..seen];
                if is_next {
                    replay.next_state(pick, windows);
                } else {
                    replay.state(pick, windows);
                }
                if let Some(averaged) = averaged {
                    // Padding, too, is scaled by what other tasks have there.
                    raw[seen..].fill(0.0);
                    averaged.normalise(&raw, &mut row[..raw.len()]);
                    input.complete(task, raw.len(), row);
                } else {
                    scales.observations.normalise(task, windows, &mut row[..seen]);
                    input.complete(task, seen, row);
                }
            }
            batch.actions.extend_from_slice(replay.action(pick));
            let (reward, ends) = replay.outcome(pick);
            let reward = f64::from(reward);
            let reward = match (recipe.normalise_rewards, averaged) {
                (false, _) => reward,
                (true, None) => scales.rewards.scale(pick.seat, reward),
                (true, Some(_)) => scales.rewards.scale_by_mean(reward),
            };
            batch.rewards.push(reward as f32);
            batch.goes_on.push(if ends { 0.0 } else { 1.0 });
        }
        for noise in [&mut batch.noise, &mut batch.next_noise] {
            noise.clear();
            noise.extend((0..count * actions).map(|_| random.normal() as f32));
        }
    }
}

//! All environments of a run, played side by side (`spec/training.md` §5.3).
//!
//! Every step has two halves. First each environment acts and steps on its own: environments are dealt out to threads, and
//! travel there and back. Then, in their order and on one thread, statistics take in what all of them saw, and rewards and
//! observations are scaled. So the number of threads changes nothing.

use std::sync::mpsc;

use super::advantages::{self, Course, Discount};
use super::body::{Body, BodyParts, FinishedEpisode};
use super::reward_normaliser::RewardNormaliser;
use super::statistics::Statistics;
use super::streams::Streams;
use super::teacher::Teacher;
use super::trainer::Plan;
use super::{Player, TrainError, Trainable};
use crate::sim::bodies::Bodies;
use crate::sim::environment::Environment;

/// Environments, and the statistics of what they give.
pub(super) struct Collector {
    pub(super) bodies: Vec<Body>,
    pub(super) observations: Statistics,
    pub(super) rewards: RewardNormaliser,
    discounts: Discount,
    normalise_rewards: bool,
}

/// What a rollout showed, beside its samples.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Collected {
    /// Episodes that ended, in the order of steps, then of environments.
    pub(super) episodes: Vec<FinishedEpisode>,
    /// Share of solved steps by task.
    pub(super) solved: Vec<f64>,
    /// By task, the mean of every reward component.
    pub(super) components: Vec<Vec<(&'static str, f64)>>,
    pub(super) explained_variance: Option<f64>,
}

impl Collector {
    /// Environments for the plan's tasks, before their first episode.
    pub(super) fn new(
        plan: &Plan,
        bodies: &Bodies,
        streams: Streams,
        network: &dyn Trainable,
        observations: Statistics,
    ) -> Result<Self, TrainError> {
        let recipe = &plan.recipe;
        let (mut seats, mut identifiers) = (Vec::new(), Vec::new());
        for (task, entry) in plan.tasks.iter().enumerate() {
            let definition = entry.definition;
            for _ in 0..entry.environments {
                let environment =
                    Environment::new(definition, bodies, recipe.rewards.configuration())?;
                let teacher = match &entry.teacher {
                    Some(teacher) => Some(Teacher::new(teacher, &environment)?),
                    None => None,
                };
                seats.push(Body::new(BodyParts {
                    task,
                    seat: seats.len(),
                    streams,
                    variant: observations.variant(),
                    lags: observations.lags(),
                    action_length: network.action_length(task),
                    noise_length: network.noise_length(task),
                    weights: recipe.rewards.weights(environment.task()),
                    teacher,
                    teacher_acts: recipe.teacher_acts,
                    environment,
                }));
                identifiers.push(definition.environment.unwrap_or(definition.name));
            }
        }
        Ok(Self {
            bodies: seats,
            observations,
            rewards: RewardNormaliser::new(recipe.discount, &identifiers),
            discounts: recipe.discounts(),
            normalise_rewards: recipe.normalise_rewards,
        })
    }

    /// Starts the first episodes.
    pub(super) fn begin(&mut self) {
        self.bodies.iter_mut().for_each(Body::begin);
        let seen: Vec<_> = self.bodies.iter().map(|body| (body.task, body.windows())).collect();
        self.observations.update(&seen);
        self.look();
    }

    /// Normalises what every body sees.
    pub(super) fn look(&mut self) {
        self.bodies.iter_mut().for_each(|body| body.see(&self.observations));
    }

    /// Plays `steps` steps of every environment with the parameters as they are.
    pub(super) fn collect(
        &mut self,
        network: &dyn Trainable,
        iteration: usize,
        steps: usize,
        threads: usize,
    ) -> Collected {
        let total = self.bodies.len();
        let share = total.div_ceil(threads.clamp(1, total.max(1)));
        let mut own = std::mem::take(&mut self.bodies);
        own.iter_mut().for_each(|body| body.begin_rollout(iteration));
        let mut lent: Vec<Vec<Body>> = Vec::new();
        while own.len() > share {
            lent.push(own.split_off(own.len() - share));
        }
        // What is split off last lies first.
        lent.reverse();
        let mut tally = Tally { episodes: Vec::new(), solved: vec![0; total] };
        let mut player = network.player();
        std::thread::scope(|scope| {
            let crew: Vec<_> = lent
                .iter()
                .map(|_| {
                    let (give, take) = mpsc::channel::<Vec<Body>>();
                    let (give_back, take_back) = mpsc::channel();
                    scope.spawn(move || {
                        let mut player = network.player();
                        for mut bodies in take {
                            step_all(&mut bodies, player.as_mut());
                            if give_back.send(bodies).is_err() {
                                return;
                            }
                        }
                    });
                    (give, take_back)
                })
                .collect();
            for _ in 0..steps {
                for ((give, _), bodies) in crew.iter().zip(&mut lent) {
                    // A thread that is gone has panicked; the scope repeats its panic.
                    let _gone = give.send(std::mem::take(bodies));
                }
                step_all(&mut own, player.as_mut());
                for ((_, take_back), bodies) in crew.iter().zip(&mut lent) {
                    let Ok(back) = take_back.recv() else { return };
                    *bodies = back;
                }
                self.settle(&mut own, &mut lent, player.as_mut(), &mut tally);
            }
        });
        own.extend(lent.into_iter().flatten());
        self.bodies = own;
        self.finish(player.as_mut(), tally, steps)
    }

    /// The second half of a step: in the order of environments, on one thread.
    fn settle(
        &mut self,
        own: &mut [Body],
        lent: &mut [Vec<Body>],
        player: &mut dyn Player,
        tally: &mut Tally,
    ) {
        let mut bodies: Vec<&mut Body> = own.iter_mut().chain(lent.iter_mut().flatten()).collect();
        let seen: Vec<_> = bodies.iter().map(|body| (body.task, body.windows())).collect();
        self.observations.update(&seen);
        let rewards: Vec<f64> = bodies.iter().map(|body| body.reward).collect();
        self.rewards.update(&rewards);
        for (seat, body) in bodies.iter_mut().enumerate() {
            let raw = body.reward;
            let mut reward =
                if self.normalise_rewards { self.rewards.scale(seat, raw) } else { raw };
            if body.outcome.truncated {
                // The episode would have gone on: what it was still worth counts as reward.
                self.observations.normalise(body.task, &body.terminal, &mut body.observation);
                let value = player.value(body.task, &body.observation);
                reward += self.discounts.reward * f64::from(value);
            }
            body.course.rewards.push(reward as f32);
            tally.solved[seat] += usize::from(body.outcome.solved);
            if let Some(episode) = body.finished {
                tally.episodes.push(episode);
                self.rewards.end_episode(seat);
            }
            body.see(&self.observations);
        }
    }

    /// Advantages, and what the rollout showed.
    fn finish(&mut self, player: &mut dyn Player, tally: Tally, steps: usize) -> Collected {
        let (mut values, mut targets) = (Vec::new(), Vec::new());
        for body in &mut self.bodies {
            let next_value = player.value(body.task, &body.observation);
            let course = &mut body.course;
            course.advantages.resize(course.rewards.len(), 0.0);
            let (rewards, ended) = (&course.rewards, &course.ended);
            let given = Course { rewards, values: &course.values, ended, next_value };
            advantages::advantages(given, self.discounts, &mut course.advantages);
            course.value_targets.clear();
            let sums = course.advantages.iter().zip(&course.values).map(|(a, v)| a + v);
            course.value_targets.extend(sums);
            values.extend_from_slice(&course.values);
            targets.extend_from_slice(&course.value_targets);
        }
        let tasks = self.bodies.last().map_or(0, |body| body.task + 1);
        let members =
            |task| self.bodies.iter().enumerate().filter(move |(_, body)| body.task == task);
        let all_steps = |task| (members(task).count() * steps) as f64;
        let solved = |task| {
            let steps: usize = members(task).map(|(seat, _)| tally.solved[seat]).sum();
            steps as f64 / all_steps(task)
        };
        let components = |task| {
            let names = members(task)
                .next()
                .map_or(&[][..], |(_, body)| body.environment.task().components());
            let mean = |(index, &name): (usize, &&'static str)| {
                let sum: f64 = members(task).map(|(_, body)| body.course.components[index]).sum();
                (name, sum / all_steps(task))
            };
            names.iter().enumerate().map(mean).collect()
        };
        Collected {
            solved: (0..tasks).map(solved).collect(),
            components: (0..tasks).map(components).collect(),
            explained_variance: advantages::explained_variance(&values, &targets),
            episodes: tally.episodes,
        }
    }
}

/// What is counted during a rollout.
struct Tally {
    episodes: Vec<FinishedEpisode>,
    /// Solved steps of every environment.
    solved: Vec<usize>,
}

fn step_all(bodies: &mut [Body], player: &mut dyn Player) {
    bodies.iter_mut().for_each(|body| body.step(player));
}

//! All environments of a run, played side by side (`spec/training.md` §5.3).
//!
//! Every step has two halves. First each environment acts and steps on its own: environments are dealt out to threads, and
//! travel there and back. Then, in their order and on one thread, statistics take in what all of them saw, the algorithm
//! takes what it wants to keep, and observations are scaled. So the number of threads changes nothing.

use std::collections::VecDeque;
use std::sync::mpsc;

use super::advantages::{self, Course, Discount};
use super::body::{Body, BodyParts, FinishedEpisode};
use super::plan::Plan;
use super::recipe::Rewards;
use super::reward_normaliser::RewardNormaliser;
use super::statistics::Statistics;
use super::streams::Streams;
use super::teacher::{Lead, Teacher};
use super::{Player, TrainError};
use crate::policy::TaskInterface;
use crate::sim::bodies::Bodies;
use crate::sim::environment::Environment;

/// Episodes that the mean return and length are taken over.
const RECENT: usize = 100;

/// Environments, and the statistics of what they give.
pub(super) struct Collector {
    pub(super) bodies: Vec<Body>,
    pub(super) scales: Scales,
    /// The last episodes that ended, in the order of steps, then of environments.
    pub(super) recent: VecDeque<FinishedEpisode>,
}

/// Statistics that grow with every step.
pub(super) struct Scales {
    pub(super) observations: Statistics,
    pub(super) rewards: RewardNormaliser,
}

/// How the environments of a run are made.
pub(super) struct Conditions<'a> {
    pub(super) rewards: &'a Rewards,
    /// What a reward is worth one step earlier, for the statistics of returns.
    pub(super) discount: f64,
    /// What the teacher plays himself.
    pub(super) lead: Lead,
    /// By task, numbers of an action and of the noise that draws it.
    pub(super) lengths: &'a dyn Fn(usize) -> [usize; 2],
}

/// What is to be played.
#[derive(Debug, Clone, Copy)]
pub(super) struct Stretch {
    pub(super) iteration: usize,
    /// Steps of every environment.
    pub(super) steps: usize,
    pub(super) threads: usize,
}

/// What a stretch showed, beside what the algorithm keeps of it.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Shown {
    /// Share of solved steps by task.
    pub(super) solved: Vec<f64>,
    /// By task, the mean of every reward component.
    pub(super) components: Vec<Vec<(&'static str, f64)>>,
}

/// What the tasks of `plan` are to a policy.
pub(super) fn interfaces<R>(
    plan: &Plan<R>,
    rewards: &Rewards,
    bodies: &Bodies,
) -> Result<Vec<TaskInterface>, TrainError> {
    let interface = |task: &super::plan::TaskPlan| {
        Ok(Environment::new(task.definition, bodies, rewards.configuration())?.interface())
    };
    plan.tasks.iter().map(interface).collect()
}

impl Collector {
    /// Environments for the plan's tasks, before their first episode.
    pub(super) fn new<R>(
        plan: &Plan<R>,
        conditions: &Conditions<'_>,
        bodies: &Bodies,
        observations: Statistics,
    ) -> Result<Self, TrainError> {
        let streams = Streams { seed: plan.seed };
        let rewards = conditions.rewards;
        let (mut seats, mut identifiers) = (Vec::new(), Vec::new());
        for (task, entry) in plan.tasks.iter().enumerate() {
            let definition = entry.definition;
            let [action_length, noise_length] = (conditions.lengths)(task);
            for _ in 0..entry.environments {
                let environment = Environment::new(definition, bodies, rewards.configuration())?;
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
                    action_length,
                    noise_length,
                    weights: rewards.weights(environment.task()),
                    teacher,
                    lead: conditions.lead,
                    horizon: definition.horizon,
                    environment,
                }));
                identifiers.push(definition.environment.unwrap_or(definition.name));
            }
        }
        let rewards = RewardNormaliser::new(conditions.discount, &identifiers);
        let recent = VecDeque::with_capacity(RECENT);
        Ok(Self { bodies: seats, scales: Scales { observations, rewards }, recent })
    }

    /// Starts the first episodes.
    pub(super) fn begin(&mut self) {
        self.bodies.iter_mut().for_each(Body::begin);
        let seen: Vec<_> = self.bodies.iter().map(|body| (body.task, body.windows())).collect();
        self.scales.observations.update(&seen);
        self.look();
    }

    /// Normalises what every body sees.
    pub(super) fn look(&mut self) {
        self.bodies.iter_mut().for_each(|body| body.see(&self.scales.observations));
    }

    /// Plays a stretch with players that `player` makes, one for each thread. `keep` is given every environment after every
    /// step, in their order, before it looks at what it sees now.
    pub(super) fn play<'p>(
        &mut self,
        Stretch { iteration, steps, threads }: Stretch,
        player: &(dyn Fn() -> Box<dyn Player + 'p> + Sync),
        keep: &mut dyn FnMut(usize, &mut Body, &Scales),
    ) -> Shown {
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
        let mut solved = vec![0; total];
        let mut own_player = player();
        std::thread::scope(|scope| {
            let crew: Vec<_> = lent
                .iter()
                .map(|_| {
                    let (give, take) = mpsc::channel::<Vec<Body>>();
                    let (give_back, take_back) = mpsc::channel();
                    scope.spawn(move || {
                        let mut player = player();
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
                step_all(&mut own, own_player.as_mut());
                for ((_, take_back), bodies) in crew.iter().zip(&mut lent) {
                    let Ok(back) = take_back.recv() else { return };
                    *bodies = back;
                }
                self.settle(&mut own, &mut lent, keep, &mut solved);
            }
        });
        own.extend(lent.into_iter().flatten());
        self.bodies = own;
        self.shown(&solved, steps)
    }

    /// The second half of a step: in the order of environments, on one thread.
    fn settle(
        &mut self,
        own: &mut [Body],
        lent: &mut [Vec<Body>],
        keep: &mut dyn FnMut(usize, &mut Body, &Scales),
        solved: &mut [usize],
    ) {
        let mut bodies: Vec<&mut Body> = own.iter_mut().chain(lent.iter_mut().flatten()).collect();
        let seen: Vec<_> = bodies.iter().map(|body| (body.task, body.windows())).collect();
        self.scales.observations.update(&seen);
        let rewards: Vec<f64> = bodies.iter().map(|body| body.reward).collect();
        self.scales.rewards.update(&rewards);
        for (seat, body) in bodies.iter_mut().enumerate() {
            keep(seat, body, &self.scales);
            solved[seat] += usize::from(body.outcome.solved);
            if let Some(episode) = body.finished {
                if self.recent.len() == RECENT {
                    self.recent.pop_front();
                }
                self.recent.push_back(episode);
                self.scales.rewards.end_episode(seat);
            }
            body.see(&self.scales.observations);
        }
    }

    /// Advantages of the last rollout. Returns how much of the variance of its λ-returns the values explain.
    pub(super) fn advantages(
        &mut self,
        player: &mut dyn Player,
        discounts: Discount,
    ) -> Option<f64> {
        let (mut values, mut targets) = (Vec::new(), Vec::new());
        for body in &mut self.bodies {
            let next_value = player.value(body.task, &body.observation);
            let course = &mut body.course;
            course.advantages.resize(course.rewards.len(), 0.0);
            let (rewards, ended) = (&course.rewards, &course.ended);
            let given = Course { rewards, values: &course.values, ended, next_value };
            advantages::advantages(given, discounts, &mut course.advantages);
            course.value_targets.clear();
            let sums = course.advantages.iter().zip(&course.values).map(|(a, v)| a + v);
            course.value_targets.extend(sums);
            values.extend_from_slice(&course.values);
            targets.extend_from_slice(&course.value_targets);
        }
        advantages::explained_variance(&values, &targets)
    }

    /// What `steps` steps showed, of which so many were solved by each environment.
    fn shown(&self, solved: &[usize], steps: usize) -> Shown {
        let tasks = self.bodies.last().map_or(0, |body| body.task + 1);
        let members =
            |task| self.bodies.iter().enumerate().filter(move |(_, body)| body.task == task);
        let all_steps = |task| (members(task).count() * steps) as f64;
        let share = |task| {
            let steps: usize = members(task).map(|(seat, _)| solved[seat]).sum();
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
        Shown {
            solved: (0..tasks).map(share).collect(),
            components: (0..tasks).map(components).collect(),
        }
    }

    /// Mean raw return and length of the last episodes.
    pub(super) fn mean_episode(&self) -> [Option<f64>; 2] {
        let mean = |value: &dyn Fn(&FinishedEpisode) -> f64| {
            let count = self.recent.len();
            (count > 0).then(|| self.recent.iter().map(value).sum::<f64>() / count as f64)
        };
        [mean(&|episode| episode.reward), mean(&|episode| episode.steps as f64)]
    }
}

fn step_all(bodies: &mut [Body], player: &mut dyn Player) {
    bodies.iter_mut().for_each(|body| body.step(player));
}

//! The one rollout loop: whole episodes of a policy, many bodies at a time.
//!
//! Each worker thread owns a batch of bodies and steps them in turn: one forward pass of the policy for all of them, then
//! the physics of each. When an episode ends, its body takes the next one from the list, so that batches stay full. A
//! thread that finds its list empty goes on with another one ([`Job`]) and waits for nobody. An episode depends on nothing
//! but its own [`EpisodeSpec`]: results are the same bytes whatever the number of threads, the batch size and the order of
//! the lists.

use std::ops::ControlFlow;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use crate::analysis::subspace::{Projection, SynergyProjection};
use crate::policy::{Actor, Policy, PolicyError, Sampling};

use super::bodies::Bodies;
use super::engine::EngineError;
use super::environment::Environment;
use super::muscles;
use super::random::Random;
use super::recording::{self, Recorder, Sent};
use super::tasks::{Definition, RewardConfiguration};
use super::watching::{Stepped, Watcher};

pub use super::recording::{ChannelNames, Channels, Recording};

/// Why a rollout could not be made.
#[derive(Debug, thiserror::Error)]
pub enum RolloutError {
    /// Physics.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// The policy does not fit.
    #[error(transparent)]
    Policy(#[from] PolicyError),
    /// The projection is for another number of muscles.
    #[error("the projection is for {projection} muscles, task `{task}` has {muscles}")]
    Projection {
        /// Muscles of the projection.
        projection: usize,
        /// Muscles of the task.
        muscles: usize,
        /// The task.
        task: &'static str,
    },
}

/// How actions are chosen.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ActionMode {
    /// The mean of the policy's distribution.
    Deterministic,
    /// A sample of it.
    Stochastic,
}

impl ActionMode {
    /// `deterministic` or `stochastic`.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Deterministic => "deterministic",
            Self::Stochastic => "stochastic",
        }
    }
}

/// Everything an episode depends on, apart from the policy and the task.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct EpisodeSpec {
    /// Number of the episode within its arm.
    pub episode: usize,
    /// Seed of the goal and the initial state.
    pub reset_seed: [u8; 32],
    /// Seed of the sampled actions and the action noise.
    pub action_seed: [u8; 32],
    /// Which of the plan's projections acts, if any.
    pub projection: Option<usize>,
}

/// Where an episode is confined to, and on which side of the sigmoid.
#[derive(Debug, Clone, PartialEq)]
pub enum Subspace {
    /// Principal components of the actions: the action is projected.
    Actions(Projection),
    /// Synergies: the excitations are rebuilt from them, the action stays as it is.
    Excitations(SynergyProjection),
}

impl Subspace {
    /// Components that are left.
    fn count(&self) -> usize {
        match self {
            Self::Actions(projection) => projection.count(),
            Self::Excitations(projection) => projection.rank(),
        }
    }

    fn muscle_count(&self) -> usize {
        match self {
            Self::Actions(projection) => projection.muscle_count(),
            Self::Excitations(projection) => projection.muscle_count(),
        }
    }
}

/// What to play.
#[derive(Clone)]
pub struct RolloutPlan<'a> {
    /// The task.
    pub task: &'static Definition,
    /// The policy.
    pub policy: &'a dyn Policy,
    /// How actions are chosen.
    pub mode: ActionMode,
    /// Standard deviation of Gaussian noise added to every action after the policy's own clipping; 0: none.
    pub action_noise: f64,
    /// Projections that episodes may name.
    pub projections: &'a [Subspace],
    /// Which channels are kept.
    pub channels: Channels,
    /// Weights of the reward.
    pub rewards: RewardConfiguration,
}

/// Where to play it.
#[derive(Debug, Clone)]
pub struct Machine {
    /// Physics and models.
    pub bodies: Arc<Bodies>,
    /// Number of worker threads.
    pub threads: usize,
    /// Bodies per thread.
    pub batch: usize,
}

/// One played episode.
#[derive(Debug, Clone, PartialEq)]
pub struct Episode {
    /// What it was played from.
    pub spec: EpisodeSpec,
    /// Executed control steps.
    pub steps: usize,
    /// Steps that count as solved.
    pub solved_steps: usize,
    /// Sum of rewards.
    pub reward: f64,
    /// The task ended it.
    pub terminated: bool,
    /// Steps in which the physics diverged and was reset.
    pub diverged_steps: usize,
    /// Per-step channels.
    pub recording: Recording,
}

/// Plays `specs` and returns the episodes in their order. `on_episode` is called from the worker threads as episodes end.
pub fn play(
    machine: &Machine,
    plan: &RolloutPlan<'_>,
    specs: &[EpisodeSpec],
    on_episode: &(dyn Fn(&Episode) + Sync),
) -> Result<Vec<Episode>, RolloutError> {
    let finished = Mutex::new(Vec::with_capacity(specs.len()));
    let job = Job { plan: plan.clone(), specs };
    play_jobs(machine, &[job], None, &|| true, &|_, index, episode| {
        on_episode(&episode);
        locked(&finished).push((index, episode));
        ControlFlow::Continue(())
    })?;
    let mut finished = finished.into_inner().unwrap_or_else(PoisonError::into_inner);
    finished.sort_unstable_by_key(|(index, _)| *index);
    Ok(finished.into_iter().map(|(_, episode)| episode).collect())
}

/// Episodes of one plan, played beside those of others.
#[derive(Clone)]
pub struct Job<'a> {
    /// What to play.
    pub plan: RolloutPlan<'a>,
    /// The episodes.
    pub specs: &'a [EpisodeSpec],
}

/// Plays all `jobs`. `on_episode` is given the places of job and episode, from the worker threads as episodes end; if it
/// breaks, everything stops where it is. No episode begins once `goes_on` says no; those in play are finished. A `watcher`
/// sees every step and changes nothing.
pub fn play_jobs(
    machine: &Machine,
    jobs: &[Job<'_>],
    watcher: Option<&dyn Watcher>,
    goes_on: &(dyn Fn() -> bool + Sync),
    on_episode: &(dyn Fn(usize, usize, Episode) -> ControlFlow<()> + Sync),
) -> Result<(), RolloutError> {
    let lists = jobs.iter().map(|job| List::new(machine, job)).collect::<Result<Vec<_>, _>>()?;
    let board = Board { lists, threads_on: Mutex::new(vec![0; jobs.len()]) };
    let broken = AtomicBool::new(false);
    let failure = Mutex::new(None);
    let episodes: usize = jobs.iter().map(|job| job.specs.len()).sum();
    let threads = machine.threads.clamp(1, episodes.max(1));
    std::thread::scope(|scope| {
        for _ in 0..threads {
            let (board, broken, failure) = (&board, &broken, &failure);
            scope.spawn(move || {
                while let Some((job, batch)) = board.join(machine.batch, threads) {
                    let list = &board.lists[job];
                    let next = || goes_on().then(|| list.take()).flatten();
                    let finish = |index, episode| {
                        if on_episode(job, index, episode).is_break() {
                            broken.store(true, Ordering::Relaxed);
                        }
                    };
                    // The lock ends here: bodies are made one after the other, and play side by side.
                    let worker = Worker::new(&locked(&list.template), list.plan, batch);
                    match worker {
                        Ok(mut worker) => {
                            worker.watcher = watcher.map(|watcher| (watcher, job));
                            worker.run(list.plan, &next, broken, &finish);
                        }
                        Err(error) => {
                            broken.store(true, Ordering::Relaxed);
                            *locked(failure) = Some(error);
                        }
                    }
                    board.leave(job);
                    if broken.load(Ordering::Relaxed) || !goes_on() {
                        return;
                    }
                }
            });
        }
    });
    failure.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), Err)
}

/// The lists that threads choose from.
struct Board<'a> {
    lists: Vec<List<'a>>,
    threads_on: Mutex<Vec<usize>>,
}

impl Board<'_> {
    /// Joins the list with the fewest threads on it, among equals the longest; its place and a fair number of bodies.
    fn join(&self, batch: usize, threads: usize) -> Option<(usize, usize)> {
        let mut threads_on = locked(&self.threads_on);
        let open = (0..self.lists.len()).filter(|&job| self.lists[job].left() > 0);
        let steps = |job: usize| self.lists[job].left() * self.lists[job].plan.task.horizon;
        let job = open.min_by_key(|&job| (threads_on[job], usize::MAX - steps(job)))?;
        threads_on[job] += 1;
        // Where this is the only list left, every thread will join it: nobody takes all.
        let sharing = if self.lists.iter().filter(|list| list.left() > 0).count() == 1 {
            threads
        } else {
            threads_on[job]
        };
        Some((job, batch.clamp(1, self.lists[job].left().div_ceil(sharing).max(1))))
    }

    fn leave(&self, job: usize) {
        locked(&self.threads_on)[job] -= 1;
    }
}

/// The episodes of a job, which threads take one by one.
struct List<'a> {
    plan: &'a RolloutPlan<'a>,
    specs: &'a [EpisodeSpec],
    next: AtomicUsize,
    /// Duplicating a body reads it, and bodies are not made to be read by two threads at once.
    template: Mutex<Environment>,
}

impl<'a> List<'a> {
    fn new(machine: &Machine, job: &'a Job<'_>) -> Result<Self, RolloutError> {
        let plan = &job.plan;
        let template = Environment::new(plan.task, &machine.bodies, plan.rewards)?;
        let muscles = template.simulation().excitation().len();
        if let Some(wrong) = plan.projections.iter().find(|p| p.muscle_count() != muscles) {
            let projection = wrong.muscle_count();
            return Err(RolloutError::Projection { projection, muscles, task: plan.task.name });
        }
        Ok(Self { plan, specs: job.specs, next: AtomicUsize::new(0), template: template.into() })
    }

    fn left(&self) -> usize {
        self.specs.len().saturating_sub(self.next.load(Ordering::Relaxed))
    }

    fn take(&self) -> Option<(usize, EpisodeSpec)> {
        let index = self.next.fetch_add(1, Ordering::Relaxed);
        self.specs.get(index).map(|spec| (index, *spec))
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// What the columns of `task`'s recordings mean.
pub fn channel_names(
    machine: &Machine,
    task: &'static Definition,
) -> Result<ChannelNames, RolloutError> {
    let environment = Environment::new(task, &machine.bodies, RewardConfiguration::Sparse)?;
    Ok(recording::names_of(&environment))
}

/// A thread's bodies and everything they need, allocated once.
struct Worker<'a> {
    /// Who looks on, and the place of the job that is watched.
    watcher: Option<(&'a dyn Watcher, usize)>,
    environments: Vec<Environment>,
    slots: Vec<Slot>,
    actor: Box<dyn Actor>,
    recorder: Recorder,
    observation_length: usize,
    muscles: usize,
    // Rows for the bodies that are playing.
    playing: Vec<usize>,
    observations: Vec<f32>,
    means: Vec<f32>,
    deviations: Vec<f32>,
    action: Vec<f32>,
    /// The action before it is projected; kept only for a watcher.
    chosen: Vec<f32>,
    excitation: Vec<f64>,
    projection_scratch: Vec<f64>,
}

/// The episode a body is playing.
struct Slot {
    index: usize,
    action_random: Random,
    episode: Option<Episode>,
}

impl Worker<'_> {
    fn new(
        template: &Environment,
        plan: &RolloutPlan<'_>,
        batch: usize,
    ) -> Result<Self, RolloutError> {
        let environments: Vec<Environment> =
            (0..batch).map(|_| template.duplicate(plan.rewards)).collect::<Result<_, _>>()?;
        let interface = template.interface();
        let observation_length =
            template.observation_length(plan.policy.variant_in(plan.task.name));
        let muscles = interface.muscle_count;
        let scratch_of = |subspace: &Subspace| match subspace {
            Subspace::Actions(projection) => projection.scratch_length(),
            Subspace::Excitations(projection) => projection.scratch_length(),
        };
        let scratch = plan.projections.iter().map(scratch_of).max().unwrap_or(0);
        Ok(Self {
            watcher: None,
            slots: (0..batch)
                .map(|_| Slot { index: 0, action_random: Random::new([0; 32]), episode: None })
                .collect(),
            actor: plan.policy.bind(&interface, batch)?,
            recorder: Recorder::new(template, plan.channels),
            observation_length,
            muscles,
            playing: Vec::with_capacity(batch),
            observations: vec![0.0; batch * observation_length],
            means: vec![0.0; batch * muscles],
            deviations: vec![0.0; batch * muscles],
            action: vec![0.0; muscles],
            chosen: vec![0.0; muscles],
            excitation: vec![0.0; muscles],
            projection_scratch: vec![0.0; scratch],
            environments,
        })
    }

    fn run(
        &mut self,
        plan: &RolloutPlan<'_>,
        next: &dyn Fn() -> Option<(usize, EpisodeSpec)>,
        broken: &AtomicBool,
        finish: &dyn Fn(usize, Episode),
    ) {
        while !broken.load(Ordering::Relaxed) {
            for slot in 0..self.slots.len() {
                if self.slots[slot].episode.is_none()
                    && let Some((index, spec)) = next()
                {
                    self.begin(plan, slot, index, spec);
                }
            }
            self.playing.clear();
            self.playing.extend((0..self.slots.len()).filter(|&s| self.slots[s].episode.is_some()));
            if self.playing.is_empty() {
                return;
            }
            self.decide(plan);
            for row in 0..self.playing.len() {
                let slot = self.playing[row];
                if let Some(episode) = self.advance(plan, row, slot) {
                    finish(self.slots[slot].index, episode);
                }
            }
        }
    }

    fn begin(&mut self, plan: &RolloutPlan<'_>, slot: usize, index: usize, spec: EpisodeSpec) {
        self.environments[slot].reset(&mut Random::new(spec.reset_seed));
        self.actor.reset(slot);
        if let Some((watcher, job)) = self.watcher {
            let components = spec.projection.map(|place| plan.projections[place].count());
            watcher.begins(job, index, &spec, components, &self.environments[slot]);
        }
        self.slots[slot] = Slot {
            index,
            action_random: Random::new(spec.action_seed),
            episode: Some(Episode {
                spec,
                steps: 0,
                solved_steps: 0,
                reward: 0.0,
                terminated: false,
                diverged_steps: 0,
                recording: self.recorder.begin(),
            }),
        };
    }

    /// One forward pass for all bodies that are playing.
    fn decide(&mut self, plan: &RolloutPlan<'_>) {
        let (rows, length) = (self.playing.len(), self.observation_length);
        for (row, &slot) in self.playing.iter().enumerate() {
            let into = &mut self.observations[row * length..][..length];
            self.environments[slot].read_observation(plan.policy.variant_in(plan.task.name), into);
        }
        let deviations = (plan.mode == ActionMode::Stochastic)
            .then_some(&mut self.deviations[..rows * self.muscles]);
        self.actor.act(
            &self.playing,
            &self.observations[..rows * length],
            &mut self.means[..rows * self.muscles],
            deviations,
        );
    }

    /// One control step of the body in `slot`; its finished episode if it ended.
    fn advance(&mut self, plan: &RolloutPlan<'_>, row: usize, slot: usize) -> Option<Episode> {
        let columns = row * self.muscles..(row + 1) * self.muscles;
        let means = &self.means[columns.clone()];
        let Slot { action_random, episode, index } = &mut self.slots[slot];
        let playing = episode.as_mut()?;
        self.action.copy_from_slice(means);
        if plan.mode == ActionMode::Stochastic {
            match self.actor.sampling() {
                Sampling::Gaussian => {
                    let deviations = &self.deviations[columns];
                    let mut normal = || action_random.normal();
                    self.actor.sample(slot, deviations, &mut self.action, &mut normal);
                }
                Sampling::Uniform { half_width } => {
                    for action in &mut self.action {
                        *action += half_width * action_random.uniform(-1.0, 1.0) as f32;
                    }
                }
            }
        }
        if self.actor.clips_actions() {
            for action in &mut self.action {
                *action = action.clamp(-1.0, 1.0);
            }
        }
        if plan.action_noise > 0.0 {
            for action in &mut self.action {
                *action += (plan.action_noise * action_random.normal()) as f32;
            }
        }
        let subspace = playing.spec.projection.map(|place| &plan.projections[place]);
        if self.watcher.is_some() {
            self.chosen.copy_from_slice(&self.action);
        }
        if let Some(Subspace::Actions(projection)) = subspace {
            projection.apply(&mut self.action, &mut self.projection_scratch);
        }
        for (excitation, &action) in self.excitation.iter_mut().zip(&self.action) {
            *excitation = muscles::excitation(action);
        }
        if let Some(Subspace::Excitations(projection)) = subspace {
            projection.apply(&mut self.excitation, &mut self.projection_scratch);
        }
        let environment = &mut self.environments[slot];
        self.recorder.before_step(environment, means, &mut playing.recording);
        let outcome = environment.step_with(&self.excitation);
        let sent = Sent { action: &self.action, excitation: &self.excitation };
        self.recorder.after_step(environment, &sent, &outcome, &mut playing.recording);
        playing.steps += 1;
        playing.solved_steps += usize::from(outcome.solved);
        playing.reward += outcome.reward;
        playing.diverged_steps += usize::from(outcome.diverged);
        if let Some((watcher, job)) = self.watcher {
            let (chosen, action) = (&self.chosen, &self.action);
            let stepped = Stepped { step: playing.steps, chosen, action, outcome: &outcome };
            watcher.stepped(job, *index, environment, &stepped);
        }
        if outcome.ended() {
            playing.terminated = outcome.terminated;
            return episode.take();
        }
        None
    }
}

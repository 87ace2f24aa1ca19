//! One environment of a training run: it acts, steps, starts anew when its episode ends, and remembers one rollout.
//!
//! What it does depends on the parameters, its observations and its own streams of random numbers, on nothing beside it. An
//! episode under way can be stored as the number of the episode and the actions so far: the start is drawn from that
//! episode's stream, physics is exact, so playing the actions again ends in the same state ([`Body::replay`]).

use super::statistics::Statistics;
use super::streams::{Purpose, Streams};
use super::teacher::{Lead, Teacher};
use super::{Player, Sample};
use crate::policy::ObservationVariant;
use crate::policy::history::History;
use crate::random::Random;
use crate::sim::environment::{Environment, StepOutcome};

/// An environment and the rollout it plays.
pub(super) struct Body {
    pub(super) environment: Environment,
    /// Position of its task in the run's list.
    pub(super) task: usize,
    /// Its number among the run's environments.
    seat: usize,
    streams: Streams,
    variant: ObservationVariant,
    /// Number of the episode it plays.
    pub(super) episode: usize,
    /// What it sent to the muscles in this episode.
    pub(super) executed: Vec<f32>,
    /// Raw rewards of this episode so far.
    pub(super) episode_return: f64,
    muscles: usize,
    exploration: Random,
    noise: Vec<f32>,
    /// What the network chose, padding included.
    action: Vec<f32>,
    /// The newest observation, raw.
    raw: Vec<f32>,
    /// The last observations, raw.
    history: History,
    /// The same normalised: what the network sees next.
    pub(super) observation: Vec<f32>,
    /// Raw windows at the end of an episode that the last step ended.
    pub(super) terminal: Vec<f32>,
    teacher: Option<Teacher>,
    lead: Lead,
    /// Steps of this episode that the teacher plays.
    led: usize,
    /// Steps of a whole episode.
    horizon: usize,
    pub(super) outcome: StepOutcome,
    /// Weights of reward components, if not the environment's own.
    pub(super) weights: Option<Vec<(usize, f64)>>,
    /// Raw reward of the last step.
    pub(super) reward: f64,
    /// Return and length of the episode that the last step ended.
    pub(super) finished: Option<FinishedEpisode>,
    pub(super) course: Rollout,
}

/// A finished episode.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct FinishedEpisode {
    /// Sum of raw rewards.
    pub reward: f64,
    pub steps: usize,
}

/// One rollout of one body: an entry, or a row, per step.
#[derive(Debug, Default)]
pub(super) struct Rollout {
    pub(super) observations: Vec<f32>,
    pub(super) actions: Vec<f32>,
    pub(super) expert_actions: Vec<f32>,
    pub(super) log_probabilities: Vec<f32>,
    pub(super) values: Vec<f32>,
    pub(super) rewards: Vec<f32>,
    pub(super) ended: Vec<bool>,
    pub(super) advantages: Vec<f32>,
    pub(super) value_targets: Vec<f32>,
    /// Sums of the reward components over the rollout.
    pub(super) components: Vec<f64>,
}

impl Rollout {
    fn clear(&mut self) {
        self.observations.clear();
        self.actions.clear();
        self.expert_actions.clear();
        self.log_probabilities.clear();
        self.values.clear();
        self.rewards.clear();
        self.ended.clear();
        self.components.fill(0.0);
    }
}

/// What a body is made of.
pub(super) struct BodyParts {
    pub(super) environment: Environment,
    pub(super) task: usize,
    pub(super) seat: usize,
    pub(super) streams: Streams,
    pub(super) variant: ObservationVariant,
    pub(super) lags: usize,
    pub(super) action_length: usize,
    pub(super) noise_length: usize,
    pub(super) weights: Option<Vec<(usize, f64)>>,
    pub(super) teacher: Option<Teacher>,
    pub(super) lead: Lead,
    pub(super) horizon: usize,
}

impl Body {
    pub(super) fn new(parts: BodyParts) -> Self {
        let BodyParts { environment, variant, lags, .. } = parts;
        let sensors = environment.observation_length(variant);
        let windows = vec![0.0; sensors * lags];
        let components = vec![0.0; environment.components().len()];
        Self {
            muscles: environment.simulation().excitation().len(),
            environment,
            task: parts.task,
            seat: parts.seat,
            streams: parts.streams,
            variant,
            episode: 0,
            executed: Vec::new(),
            episode_return: 0.0,
            exploration: Random::new([0; 32]),
            noise: vec![0.0; parts.noise_length],
            action: vec![0.0; parts.action_length],
            raw: vec![0.0; sensors],
            history: History::new(1, sensors, lags),
            terminal: windows.clone(),
            observation: windows,
            teacher: parts.teacher,
            lead: parts.lead,
            led: 0,
            horizon: parts.horizon,
            outcome: StepOutcome {
                reward: 0.0,
                solved: false,
                terminated: false,
                truncated: false,
                diverged: false,
            },
            weights: parts.weights,
            reward: 0.0,
            finished: None,
            course: Rollout { components, ..Rollout::default() },
        }
    }

    pub(super) fn muscles(&self) -> usize {
        self.muscles
    }

    /// The last observations, raw.
    pub(super) fn windows(&self) -> &[f32] {
        self.history.windows(0)
    }

    /// The newest observation, raw.
    pub(super) fn raw(&self) -> &[f32] {
        &self.raw
    }

    /// What the network chose last, padding included; muscles held between −1 and 1.
    pub(super) fn action(&self) -> &[f32] {
        &self.action
    }

    /// Normalises what the network sees next.
    pub(super) fn see(&mut self, statistics: &Statistics) {
        statistics.normalise(self.task, self.history.windows(0), &mut self.observation);
    }

    fn look(&mut self) {
        self.environment.read_observation(self.variant, &mut self.raw);
        self.history.push(0, &self.raw);
    }

    /// Starts the episode whose number is set.
    pub(super) fn begin(&mut self) {
        self.executed.clear();
        self.episode_return = 0.0;
        let start = self.streams.of(Purpose::Episode, [self.seat, self.episode]);
        self.environment.reset(&mut { start });
        let mut random = self.streams.of(Purpose::Lead, [self.seat, self.episode]);
        self.led = self.lead.steps(self.horizon, &mut random);
        if let Some(teacher) = &mut self.teacher {
            teacher.reset();
        }
        self.history.clear(0);
        self.look();
    }

    /// Plays the episode called `episode` up to where `executed` ends.
    pub(super) fn replay(&mut self, episode: usize, executed: &[f32]) {
        self.episode = episode;
        self.begin();
        for action in executed.chunks_exact(self.muscles) {
            if let Some(teacher) = &mut self.teacher {
                teacher.ask(&self.environment);
            }
            self.outcome = self.environment.step(action);
            self.look();
            self.episode_return += self.rewarded();
        }
        self.executed.extend_from_slice(executed);
    }

    /// The last step's reward.
    fn rewarded(&self) -> f64 {
        let Some(weights) = &self.weights else { return self.outcome.reward };
        let components = self.environment.components();
        weights.iter().map(|&(index, weight)| weight * components[index]).sum()
    }

    /// Forgets the last rollout.
    pub(super) fn begin_rollout(&mut self, iteration: usize) {
        self.exploration = self.streams.of(Purpose::Exploration, [self.seat, iteration]);
        self.course.clear();
    }

    /// One control step.
    pub(super) fn step(&mut self, player: &mut dyn Player) {
        for noise in &mut self.noise {
            *noise = self.exploration.normal() as f32;
        }
        let decision = player.decide(self.task, &self.observation, &self.noise, &mut self.action);
        let course = &mut self.course;
        course.observations.extend_from_slice(&self.observation);
        course.actions.extend_from_slice(&self.action);
        course.log_probabilities.push(decision.log_probability);
        course.values.push(decision.value);
        let muscles = &mut self.action[..self.muscles];
        muscles.iter_mut().for_each(|action| *action = action.clamp(-1.0, 1.0));
        if let Some(teacher) = &mut self.teacher {
            let wanted = teacher.ask(&self.environment);
            course.expert_actions.extend_from_slice(wanted);
            if self.executed.len() / self.muscles < self.led {
                muscles.copy_from_slice(wanted);
            }
        }
        self.outcome = self.environment.step(muscles);
        self.executed.extend_from_slice(muscles);
        self.look();
        self.reward = self.rewarded();
        self.episode_return += self.reward;
        let course = &mut self.course;
        course.ended.push(self.outcome.ended());
        for (sum, x) in course.components.iter_mut().zip(self.environment.components()) {
            *sum += x;
        }
        self.finished = None;
        if self.outcome.ended() {
            let steps = self.executed.len() / self.muscles;
            self.finished = Some(FinishedEpisode { reward: self.episode_return, steps });
            self.terminal.copy_from_slice(self.history.windows(0));
            self.episode += 1;
            self.begin();
        }
    }

    /// Step `step` of the rollout, as a gradient needs it.
    pub(super) fn sample<'a>(&'a self, step: usize, noise: &'a [f32]) -> Sample<'a> {
        let (sees, chosen) = (self.observation.len(), self.action.len());
        let course = &self.course;
        let expert_action = match self.teacher {
            Some(_) => &course.expert_actions[step * self.muscles..][..self.muscles],
            None => &[],
        };
        Sample {
            task: self.task,
            observation: &course.observations[step * sees..][..sees],
            action: &course.actions[step * chosen..][..chosen],
            old_log_probability: course.log_probabilities[step],
            advantage: course.advantages[step],
            value_target: course.value_targets[step],
            expert_action,
            noise,
        }
    }
}

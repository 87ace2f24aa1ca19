//! The soft actor-critic of perceptrons (Haarnoja et al. 2018; `spec/policy.md` §2.5, `spec/training.md` §5.10).
//!
//! The actor draws `a = tanh(g)`, `g = μ + σξ`, with μ and `ln σ` (held between −20 and 2) of the same hidden layers. Two
//! critics judge state and action, and a slow copy of each, its target, judges the next ones. With the temperature α, over
//! the B transitions of a minibatch:
//!
//! * critics: `½ Σ_k mean((Q_k(s, a) − y)²)`, `y = r + γ(1 − end)(min_k Q'_k(s', a') − α ln π(a'|s'))`, a' drawn in s';
//! * actor: `mean(α ln π(â|s) − min_k Q_k(s, â))`, â drawn in s;
//! * α: `−mean(ln α (ln π(â|s) + H))`, H the entropy that is wanted.
//!
//! `ln π(a) = Σ −½ξ² − ln σ − ½ ln 2π − ln(1 − a² + 10⁻⁶)`, the last number as in Stable-Baselines3. The normal numbers ξ are
//! given, so every loss is a function of parameters and samples, and gradients are sums over samples in shards.

mod actor;
mod critics;
mod player;

use super::dense::{Dense, Stack};
use super::padded_input::PaddedInput;
use crate::policy::checkpoint::contents::{Activation, Checkpoint, Format, Scalars, TensorMap};
use crate::random::Random;
use crate::train::shards::{Sum, shards, smallest_of_dense, sum_over_shards};
use crate::train::{Parameters, TrainError, initialisation};

pub use player::{SoftPlayer, UniformPlayer};

/// What a soft actor-critic is made of.
#[derive(Debug, Clone, PartialEq)]
pub struct SoftSettings {
    pub input: PaddedInput,
    /// Numbers of an action, padding included.
    pub actions: usize,
    /// Widths of the hidden layers, the same for the actor and the critics.
    pub hidden: Vec<usize>,
    pub activation: Activation,
}

/// A minibatch of transitions, one row each.
#[derive(Debug, Clone, Default)]
pub struct Transitions {
    pub states: Vec<f32>,
    pub actions: Vec<f32>,
    pub rewards: Vec<f32>,
    /// 1, or 0 where the task ended the episode.
    pub goes_on: Vec<f32>,
    pub next_states: Vec<f32>,
    /// Normal numbers that draw an action in the state.
    pub noise: Vec<f32>,
    /// The same in the next state.
    pub next_noise: Vec<f32>,
}

impl Transitions {
    #[must_use]
    pub fn len(&self) -> usize {
        self.rewards.len()
    }

    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.rewards.is_empty()
    }
}

/// What the gradients show besides.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct SoftLosses {
    pub critic: f64,
    pub actor: f64,
    /// Mean of `ln π` of the actions drawn.
    pub log_probability: f64,
}

impl Sum for SoftLosses {
    fn add(&mut self, other: &Self) {
        self.critic += other.critic;
        self.actor += other.actor;
        self.log_probability += other.log_probability;
    }
}

impl SoftLosses {
    /// The mean, where this is a sum over `count` minibatches.
    #[must_use]
    pub fn over(self, count: f64) -> Self {
        Self {
            critic: self.critic / count,
            actor: self.actor / count,
            log_probability: self.log_probability / count,
        }
    }
}

/// Actor, critics and their targets.
#[derive(Debug, Clone)]
pub struct SoftActorCritic {
    settings: SoftSettings,
    pub actor: Parameters,
    pub critics: Parameters,
    /// As many numbers as the critics have.
    targets: Vec<f32>,
    hidden: Stack,
    mean: Dense,
    log_deviation: Dense,
    judges: [Judge; 2],
}

/// Layers of one critic.
#[derive(Debug, Clone)]
struct Judge {
    hidden: Stack,
    head: Dense,
}

impl SoftActorCritic {
    /// Networks whose parameters are drawn from `random`, as torch draws those of dense layers.
    pub fn new(settings: SoftSettings, random: &mut Random) -> Result<Self, TrainError> {
        let mut made = Self::untrained(settings)?;
        let judges = made.judges.clone();
        let critics =
            judges.iter().flat_map(|judge| judge.hidden.layers.iter().chain([&judge.head]));
        let heads = [made.mean.clone(), made.log_deviation.clone()];
        let actor = made.hidden.layers.clone();
        for layer in actor.iter().chain(&heads) {
            layer.draw(made.actor.numbers_mut(), random);
        }
        for layer in critics {
            layer.draw(made.critics.numbers_mut(), random);
        }
        made.targets.copy_from_slice(made.critics.numbers());
        Ok(made)
    }

    /// Networks whose parameters are zeros.
    pub fn untrained(settings: SoftSettings) -> Result<Self, TrainError> {
        let (seen, actions) = (settings.input.width(), settings.actions);
        if seen == 0 || actions == 0 || settings.hidden.is_empty() || settings.hidden.contains(&0) {
            return Err(TrainError::Sizes { what: "a layer without inputs or outputs".to_owned() });
        }
        let last = settings.hidden[settings.hidden.len() - 1];
        let mut actor = stack_shapes("actor.latent_pi", seen, &settings.hidden);
        for head in ["actor.mu", "actor.log_std"] {
            add_dense(&mut actor, head, last, actions);
        }
        let mut critics = Vec::new();
        for name in CRITICS {
            critics.extend(stack_shapes(name, seen + actions, &settings.hidden));
            add_dense(&mut critics, &format!("{name}.{}", 2 * settings.hidden.len()), last, 1);
        }
        let (actor, critics) = (Parameters::zeros(actor), Parameters::zeros(critics));
        let stack = |parameters: &Parameters, name: &str| -> Result<Stack, TrainError> {
            let names = (0..settings.hidden.len()).map(|k| format!("{name}.{}", 2 * k));
            let layers =
                names.map(|name| Dense::find(parameters, &name)).collect::<Result<_, _>>()?;
            let (function, slope) = (settings.activation.function(), settings.activation.slope());
            Ok(Stack { layers, function, slope })
        };
        let judge = |name: &str| -> Result<Judge, TrainError> {
            let head = format!("{name}.{}", 2 * settings.hidden.len());
            Ok(Judge { hidden: stack(&critics, name)?, head: Dense::find(&critics, &head)? })
        };
        Ok(Self {
            hidden: stack(&actor, "actor.latent_pi")?,
            mean: Dense::find(&actor, "actor.mu")?,
            log_deviation: Dense::find(&actor, "actor.log_std")?,
            judges: [judge(CRITICS[0])?, judge(CRITICS[1])?],
            targets: vec![0.0; critics.numbers().len()],
            settings,
            actor,
            critics,
        })
    }

    #[must_use]
    pub fn settings(&self) -> &SoftSettings {
        &self.settings
    }

    /// The targets' numbers, in the order of the critics'.
    #[must_use]
    pub fn targets(&self) -> &[f32] {
        &self.targets
    }

    /// The targets as tensors whose names are the critics' behind `prefix`.
    #[must_use]
    pub fn target_tensors(&self, prefix: &str) -> TensorMap {
        self.critics.tensors_of(&self.targets, prefix)
    }

    /// Takes the targets from what [`Self::target_tensors`] made.
    pub fn read_targets(&mut self, tensors: &TensorMap, prefix: &str) -> Result<(), TrainError> {
        self.targets = self.critics.row_of(tensors, prefix)?;
        Ok(())
    }

    /// Moves the targets towards the critics: `Q' ← (1 − τ) Q' + τ Q`.
    pub fn follow(&mut self, rate: f64) {
        let (rest, rate) = ((1.0 - rate) as f32, rate as f32);
        for (target, &x) in self.targets.iter_mut().zip(self.critics.numbers()) {
            *target = *target * rest + rate * x;
        }
    }

    /// Loss and gradient of the critics.
    pub fn critic_gradient(
        &self,
        batch: &Transitions,
        temperature: f64,
        discount: f64,
        threads: usize,
        gradient: &mut Vec<f32>,
    ) -> SoftLosses {
        gradient.resize(self.critics.numbers().len(), 0.0);
        let shards = shards(batch.len(), smallest_of_dense(gradient.len()));
        let rows = shards.first().map_or(0, ExactSizeIterator::len);
        let memory = || (self.actor_memory(rows), self.critic_memory(rows));
        sum_over_shards(&shards, threads, gradient, memory, |(actor, critics), shard, sums| {
            self.pull_critics(batch, shard, temperature, discount, (actor, critics), sums)
        })
    }

    /// Loss and gradient of the actor.
    pub fn actor_gradient(
        &self,
        batch: &Transitions,
        temperature: f64,
        threads: usize,
        gradient: &mut Vec<f32>,
    ) -> SoftLosses {
        gradient.resize(self.actor.numbers().len(), 0.0);
        let shards = shards(batch.len(), smallest_of_dense(gradient.len()));
        let rows = shards.first().map_or(0, ExactSizeIterator::len);
        let memory = || (self.actor_memory(rows), self.critic_memory(rows));
        sum_over_shards(&shards, threads, gradient, memory, |(actor, critics), shard, sums| {
            self.pull_actor(batch, shard, temperature, (actor, critics), sums)
        })
    }

    /// What `policy` reads back: the actor. Playing asks no critic.
    #[must_use]
    pub fn checkpoint(&self) -> Checkpoint {
        let scalars = Scalars {
            activation: Some(self.settings.activation),
            task_index: self.settings.input.index().to_vec(),
            ..Scalars::default()
        };
        Checkpoint {
            format: Format::SacMlp,
            tensors: self.actor.tensors(),
            aliases: std::collections::BTreeMap::new(),
            scalars,
            globals: Vec::new(),
        }
    }
}

/// Names of the critics in a checkpoint.
const CRITICS: [&str; 2] = ["critic.qf0", "critic.qf1"];

/// Names and shapes of hidden layers, in the order of the published optimiser.
fn stack_shapes(name: &str, inputs: usize, widths: &[usize]) -> Vec<(String, Vec<usize>)> {
    let mut shapes = Vec::new();
    let mut end = inputs;
    for (k, &width) in widths.iter().enumerate() {
        add_dense(&mut shapes, &format!("{name}.{}", 2 * k), end, width);
        end = width;
    }
    shapes
}

fn add_dense(shapes: &mut Vec<(String, Vec<usize>)>, name: &str, inputs: usize, outputs: usize) {
    shapes.push((format!("{name}.weight"), vec![outputs, inputs]));
    shapes.push((format!("{name}.bias"), vec![outputs]));
}

impl Dense {
    /// Draws weight and bias as torch does.
    fn draw(&self, numbers: &mut [f32], random: &mut Random) {
        initialisation::dense(&mut numbers[self.weight.clone()], self.inputs, random);
        initialisation::dense(&mut numbers[self.bias.clone()], self.inputs, random);
    }
}

#[cfg(test)]
mod tests;

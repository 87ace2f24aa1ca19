//! The constants of a training run, under a name (`spec/training.md` §5.1, §7).
//!
//! | name | what it is |
//! | --- | --- |
//! | `published` | the published code: clip 0.3, λ 0.9, gradient norm 0.7 |
//! | `paper` | the paper's own: clip 0.2, λ 0.95, gradient norm 0.5 |
//! | `own` | ours: what learned fastest per control step of physics |
//!
//! The published constants were chosen for fifty million steps of fourteen tasks at once. A few tasks learn from a
//! hundredth of that, if larger steps may be taken; `own` says how.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

use super::Coefficients;
use super::advantages::Discount;
use super::schedule::Schedule;
use crate::policy::checkpoint::contents::Activation;
use crate::sim::tasks::{RewardConfiguration, Task};

/// What a run is made of, apart from its tasks, its length and its seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    pub coefficients: Coefficients,
    pub learning_rate: Schedule,
    /// γ: what a reward is worth one step earlier.
    pub discount: f64,
    /// λ of the generalised advantage.
    pub lambda: f64,
    /// Largest norm of a gradient.
    pub gradient_norm: f64,
    /// Control steps of every environment between two updates.
    pub rollout_steps: usize,
    pub minibatch: usize,
    /// How often an update goes over the samples.
    pub epochs: usize,
    /// Environments of every task.
    pub environments: usize,
    /// Whether rewards are divided by the spread of returns.
    pub normalise_rewards: bool,
    pub rewards: Rewards,
    /// Whether the teacher's actions are played rather than the student's.
    pub teacher_acts: bool,
    /// Share of episodes that the teacher begins: he plays up to a step drawn over the whole episode, the student from there.
    /// So an episode in which the student fails early (a ball is dropped) is learned to its end.
    #[serde(default)]
    pub teacher_leads: f64,
    /// The logarithm of an action's standard deviation over the run, if it is led there rather than learned.
    #[serde(default)]
    pub log_deviation: Option<Schedule>,
    pub network: NetworkShape,
    /// Logarithm of the standard deviation of an action that a run starts with, whatever the checkpoint has that it begins
    /// from: imitation leaves next to nothing to explore with.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reset_deviation: Option<f64>,
}

/// What is rewarded.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Rewards {
    /// The benchmark's weights.
    Sparse,
    /// The weights the published checkpoints were trained with.
    Dense,
    /// The dense weights, except where the way to the goal is rewarded by a few centimetres' worth only: a reach counts its
    /// distance ten times, and half a point each for being near, for being there, and for being solved ([`REACH`]).
    Shaped,
    /// Weights of one's own for the task's reward components; those that a task does not have count for nothing.
    Weighted(BTreeMap<String, f64>),
}

/// Weights of [`Rewards::Shaped`] for a reach. Its `bonus` counts one for twice the distance that is solved and one for
/// that distance.
const REACH: [(&str, f64); 4] =
    [("reach", 10.0), ("bonus", 0.5), ("solved", 0.5), ("act_reg", 1.0)];

impl Rewards {
    /// Components of `task` with the weights of one's own.
    #[must_use]
    pub fn weights(&self, task: &dyn Task) -> Option<Vec<(usize, f64)>> {
        let of = |weight: &dyn Fn(&str) -> Option<f64>| {
            let names = task.components().iter().enumerate();
            names.filter_map(|(index, name)| Some((index, weight(name)?))).collect()
        };
        match self {
            Self::Sparse | Self::Dense => None,
            Self::Shaped => task.components().contains(&"reach").then(|| {
                of(&|name| {
                    REACH.iter().find(|(known, _)| *known == name).map(|(_, weight)| *weight)
                })
            }),
            Self::Weighted(weights) => Some(of(&|name| weights.get(name).copied())),
        }
    }

    /// Which of the published configurations an environment has.
    #[must_use]
    pub fn configuration(&self) -> RewardConfiguration {
        match self {
            Self::Sparse => RewardConfiguration::Sparse,
            Self::Dense | Self::Shaped | Self::Weighted(_) => RewardConfiguration::Dense,
        }
    }
}

/// What a network is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum NetworkShape {
    Perceptron(PerceptronShape),
    Transformer(TransformerShape),
}

/// What a perceptron is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PerceptronShape {
    /// Widths of the hidden layers, the same before the action and before the value.
    pub hidden: Vec<usize>,
    pub activation: Activation,
    /// Logarithm of the standard deviation of an action at the start.
    pub log_deviation: f64,
    /// Noise on the latent vector as well as on the muscles.
    pub lattice: bool,
    /// A control subspace that mean actions are projected onto.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub subspace: Option<SubspaceShape>,
    /// Several tasks, whose windows are padded to the largest; else one task and its clean vector.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub windows: Option<WindowsShape>,
}

/// What a perceptron sees of several tasks (`spec/policy.md` §2.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct WindowsShape {
    /// Observations that a window holds.
    pub lags: usize,
    /// Whether it sees which task it plays: the article's intent, which the published code does not follow.
    pub task_index: bool,
}

/// A control subspace (`spec/policy.md` §2.4).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SubspaceShape {
    /// Its dimensions.
    pub size: usize,
    /// Whether its directions and its mean are trained.
    pub trainable: bool,
}

/// What a muscle transformer is made of.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TransformerShape {
    pub width: usize,
    /// Layers of the encoder, and of each decoder.
    pub layers: usize,
    pub heads: usize,
    pub feed_forward: usize,
    /// Observations that a token holds.
    pub lags: usize,
    /// Logarithm of the standard deviation of an action at the start.
    pub log_deviation: f64,
    /// Whether actions of smaller bodies are filled up to those of the largest, as published.
    pub padded_actions: bool,
}

/// The published sizes (`spec/policy.md` §1.12).
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum TransformerSize {
    ExtraSmall,
    Small,
    Medium,
    Full,
}

impl TransformerShape {
    /// The published network of this size.
    #[must_use]
    pub fn of(size: TransformerSize) -> Self {
        let (width, layers, heads, feed_forward) = match size {
            TransformerSize::ExtraSmall => (16, 3, 2, 256),
            TransformerSize::Small => (32, 3, 2, 512),
            TransformerSize::Medium => (64, 3, 4, 512),
            TransformerSize::Full => (128, 6, 4, 512),
        };
        let (lags, log_deviation, padded_actions) = (6, 0.0, true);
        Self { width, layers, heads, feed_forward, lags, log_deviation, padded_actions }
    }
}

/// Names of the recipes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum RecipeName {
    Published,
    Paper,
    Own,
}

/// What is learned from.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Regime {
    /// Rewards.
    Ppo,
    /// A teacher who acts.
    BehaviouralCloning,
    /// A teacher who is asked what he would do.
    OnlineBehaviouralCloning,
    /// Both that teacher and rewards.
    CloningAndRewards,
    /// Rewards of one task, from a policy that imitated.
    FineTuning,
    /// Teachers who are asked, from a policy that imitated others: the fine-tuned ones among them may be its own.
    SelfDistillation,
}

/// The phases of training inside a control subspace.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum SubspacePhase {
    /// Imitation in the whole space; the value is not learned.
    Base,
    /// Imitation inside the subspace.
    Imitation,
    /// Rewards inside the subspace.
    Rewards,
}

/// The published runs end with a second phase of five in fifty-five million steps.
const SECOND_PHASE: Schedule = Schedule::Phases { first: 1e-3, second: 1e-5, share: 1.0 / 11.0 };

impl Recipe {
    /// The recipe called `name` for `regime` and a network.
    #[must_use]
    pub fn new(regime: Regime, name: RecipeName, network: NetworkShape) -> Self {
        let published = Self::published(regime, network);
        match name {
            RecipeName::Published => published,
            RecipeName::Paper => Self {
                coefficients: Coefficients { clip: 0.2, ..published.coefficients },
                lambda: 0.95,
                gradient_norm: 0.5,
                ..published
            },
            RecipeName::Own => published.own(regime),
        }
    }

    fn published(regime: Regime, network: NetworkShape) -> Self {
        let rewards = Coefficients::default();
        let cloning =
            Coefficients { policy_gradient: 0.0, entropy: 0.0, imitation: 1.0, ..rewards };
        let (coefficients, learning_rate) = match regime {
            Regime::Ppo => (rewards, Schedule::Constant(2e-5)),
            Regime::BehaviouralCloning | Regime::OnlineBehaviouralCloning => {
                (cloning, SECOND_PHASE)
            }
            Regime::FineTuning => (rewards, Schedule::Constant(2e-6)),
            Regime::SelfDistillation => (cloning, Schedule::Constant(1e-5)),
            Regime::CloningAndRewards => (Coefficients { imitation: 1.0, ..rewards }, SECOND_PHASE),
        };
        Self {
            coefficients,
            learning_rate,
            discount: 0.99,
            lambda: 0.9,
            gradient_norm: 0.7,
            rollout_steps: 512,
            minibatch: 128,
            epochs: 3,
            environments: if regime == Regime::FineTuning { 32 } else { 2 },
            normalise_rewards: true,
            rewards: Rewards::Dense,
            teacher_acts: regime == Regime::BehaviouralCloning,
            teacher_leads: 0.0,
            log_deviation: None,
            network,
            reset_deviation: (regime == Regime::FineTuning).then_some(-6.9),
        }
    }

    /// Our own constants where they differ.
    fn own(self, regime: Regime) -> Self {
        if regime != Regime::Ppo {
            return Self { rollout_steps: 128, ..self };
        }
        let mut network = self.network;
        match &mut network {
            NetworkShape::Perceptron(shape) => shape.log_deviation = -0.5,
            NetworkShape::Transformer(shape) => shape.padded_actions = false,
        }
        Self {
            coefficients: Coefficients { clip: 0.2, entropy: 0.0, ..self.coefficients },
            learning_rate: Schedule::Linear { from: 1e-3, to: 5e-5 },
            discount: 0.95,
            gradient_norm: 0.5,
            rollout_steps: 128,
            minibatch: 256,
            epochs: 10,
            environments: 16,
            rewards: Rewards::Shaped,
            network,
            ..self
        }
    }

    /// Training inside a control subspace (`spec/training.md` §5.9): sixteen environments, short rollouts, a small rate.
    #[must_use]
    pub fn of_subspace(phase: SubspacePhase, subspace: Option<SubspaceShape>) -> Self {
        let shape = PerceptronShape { hidden: vec![256, 256], subspace, ..Default::default() };
        let published = Self::published(Regime::Ppo, NetworkShape::Perceptron(shape));
        let (policy_gradient, entropy, value, imitation) = match phase {
            SubspacePhase::Base => (0.0, 0.0, 0.0, 1.0),
            SubspacePhase::Imitation => (0.0, 0.0, 0.5, 1.0),
            SubspacePhase::Rewards => (1.0, 1e-6, 0.8, 0.0),
        };
        let rest = published.coefficients;
        Self {
            coefficients: Coefficients { policy_gradient, entropy, value, imitation, ..rest },
            rollout_steps: 128,
            minibatch: 256,
            epochs: 10,
            environments: 16,
            ..published
        }
    }

    /// Rewards of many tasks for one perceptron (`spec/training.md` §5.10). The published constants are those of
    /// Stable-Baselines3; the article adds the index of the task; ours are those for one task.
    #[must_use]
    pub fn of_many_tasks(name: RecipeName) -> Self {
        let windows = WindowsShape { lags: 6, task_index: name == RecipeName::Paper };
        let shape = PerceptronShape {
            hidden: vec![512, 512],
            activation: Activation::Tanh,
            windows: Some(windows),
            ..Default::default()
        };
        let base = Self::published(Regime::Ppo, NetworkShape::Perceptron(shape));
        if name == RecipeName::Own {
            return base.own(Regime::Ppo);
        }
        Self {
            coefficients: Coefficients { entropy: 0.0, clip: 0.2, ..base.coefficients },
            learning_rate: Schedule::Constant(1e-5),
            lambda: 0.95,
            gradient_norm: 0.5,
            rollout_steps: 256,
            minibatch: 256,
            epochs: 10,
            rewards: Rewards::Sparse,
            ..base
        }
    }

    /// γ and λ together.
    #[must_use]
    pub fn discounts(&self) -> Discount {
        Discount { reward: self.discount, advantage: self.lambda }
    }
}

impl Default for PerceptronShape {
    fn default() -> Self {
        Self {
            hidden: vec![128, 128],
            activation: Activation::Relu,
            log_deviation: 0.0,
            lattice: false,
            subspace: None,
            windows: None,
        }
    }
}

//! The constants of a soft actor-critic, under a name (`spec/training.md` §5.10, §7).

use serde::{Deserialize, Serialize};

use crate::policy::checkpoint::contents::Activation;
use crate::train::recipe::{RecipeName, Rewards, WindowsShape};
use crate::train::schedule::Schedule;

/// What a run is made of, apart from its tasks, its length and its seed.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoftRecipe {
    /// Of actor, critics and temperature.
    pub learning_rate: Schedule,
    /// γ: what a reward is worth one step earlier.
    pub discount: f64,
    pub minibatch: usize,
    /// Environments of every task.
    pub environments: usize,
    /// Whether rewards are divided by the spread of returns.
    pub normalise_rewards: bool,
    pub rewards: Rewards,
    /// Control steps of every environment between two rounds of updates.
    pub rollout_steps: usize,
    /// Updates of a round; `None`: one for each new transition.
    pub updates: Option<usize>,
    /// Control steps of all environments together that are played at random before anything is learned.
    pub start_steps: usize,
    /// Steps that are remembered, those of all environments together.
    pub buffer: usize,
    /// τ: how far the targets move towards the critics in an update.
    pub target_rate: f64,
    /// The entropy that is wanted; `None`: minus the numbers of an action.
    pub target_entropy: Option<f64>,
    /// Logarithm of the temperature at the start.
    pub log_temperature: f64,
    /// Whether what is remembered is scaled by statistics averaged over all environments, as the published code does, which
    /// does not remember where a transition came from. Else by those of its own task, like what is played.
    pub averaged_statistics: bool,
    pub network: SoftShape,
}

/// What its perceptrons are made of.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SoftShape {
    /// Widths of the hidden layers, the same for actor and critics.
    pub hidden: Vec<usize>,
    pub activation: Activation,
    pub windows: WindowsShape,
}

impl SoftRecipe {
    /// The recipe called `name`. The published constants are those of Stable-Baselines3; the article adds the index of the
    /// task; ours are for few tasks and few steps, and look at one observation instead of six: it holds velocities and
    /// forces, and an update takes a third of the time.
    #[must_use]
    pub fn new(name: RecipeName) -> Self {
        let windows = WindowsShape { lags: 6, task_index: name == RecipeName::Paper };
        let network = SoftShape { hidden: vec![512, 512], activation: Activation::Relu, windows };
        let published = Self {
            learning_rate: Schedule::Constant(1e-5),
            discount: 0.99,
            minibatch: 256,
            environments: 2,
            normalise_rewards: true,
            rewards: Rewards::Sparse,
            rollout_steps: 64,
            updates: None,
            start_steps: 100,
            buffer: 1_000_000,
            target_rate: 0.005,
            target_entropy: None,
            log_temperature: 0.0,
            averaged_statistics: false,
            network: network.clone(),
        };
        if name != RecipeName::Own {
            return published;
        }
        Self {
            learning_rate: Schedule::Constant(1e-3),
            discount: 0.95,
            minibatch: 128,
            environments: 4,
            rewards: Rewards::Shaped,
            rollout_steps: 8,
            start_steps: 1000,
            network: SoftShape {
                hidden: vec![128, 128],
                windows: WindowsShape { lags: 1, ..windows },
                ..network
            },
            ..published
        }
    }
}

//! What a checkpoint says once it has been read: named tensors, a few scalars, a normaliser. Inert data, whatever
//! container it came from.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

pub use super::declared::Declared;

/// A dense tensor, row-major (C order), converted to `f32`.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    pub shape: Vec<usize>,
    pub data: Vec<f32>,
}

/// Tensors by their state-dict name.
pub type TensorMap = BTreeMap<String, Tensor>;

/// Which family of files a checkpoint belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Format {
    /// Stable-Baselines3 archive of the Arnold muscle transformer.
    ArnoldTransformer,
    /// The muscle transformer that attends over time, too: the paper's bilateral model.
    TemporalTransformer,
    /// Stable-Baselines3-contrib archive of a recurrent (LSTM) policy.
    RecurrentPpo,
    /// Stable-Baselines3 archive of a plain multilayer perceptron.
    PpoMlp,
    /// `mjrl` natural-policy-gradient Gaussian MLP pickle.
    NpgMlp,
    /// Stable-Baselines3 archive of a soft actor-critic perceptron.
    SacMlp,
    /// Torch file of the walking expert: a perceptron that asks for muscle lengths.
    WalkingExpert,
    /// Torch file of the classifier that chooses between the two groups of an ensemble.
    EnsembleClassifier,
}

impl Format {
    /// What the family is called in messages.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::ArnoldTransformer => "transformer",
            Self::TemporalTransformer => "transformer over time",
            Self::RecurrentPpo => "recurrent PPO",
            Self::PpoMlp => "PPO perceptron",
            Self::NpgMlp => "natural-policy-gradient",
            Self::SacMlp => "soft actor-critic perceptron",
            Self::WalkingExpert => "walking expert",
            Self::EnsembleClassifier => "ensemble",
        }
    }

    /// Whether the normaliser is part of the policy's own files, so that none may be given.
    #[must_use]
    pub fn scales_for_itself(self) -> bool {
        matches!(self, Self::NpgMlp | Self::WalkingExpert | Self::EnsembleClassifier)
    }
}

/// Activation functions that a checkpoint may name.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub enum Activation {
    Relu,
    Tanh,
    Elu,
    Silu,
    Gelu,
}

/// Facts that the tensors' shapes do not tell. `None`: the file does not say.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default)]
pub struct Scalars {
    pub head_count: Option<usize>,
    pub policy_outputs_variance: Option<bool>,
    pub activation: Option<Activation>,
    /// Environment steps seen in training.
    pub training_steps: Option<u64>,
    /// Version of Stable-Baselines3 that wrote the file.
    pub library_version: Option<String>,
    /// What the file says of a transformer beside its tensors.
    #[serde(skip_serializing_if = "Declared::is_empty")]
    pub declared: Declared,
    /// How it explores, as far as the standard deviations themselves do not tell.
    pub exploration: Option<ExplorationSettings>,
    /// Rows of its control subspace that it was trained with.
    pub subspace_size: Option<usize>,
    /// Tasks whose place in this list a perceptron sees behind the padded observation. Ours; published ones see none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub task_index: Vec<String>,
}

/// Settings of the exploration schemes whose noise depends on the state (`spec/policy.md` §4.3). The default is what the
/// libraries take when a setting is not given.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExplorationSettings {
    /// Noise on the latent vector as well as on the actions.
    pub lattice: bool,
    /// Standard deviation from its parameter by "expln" rather than by the exponential.
    pub expln: bool,
    /// Bounds of the lattice's standard deviations.
    pub clip: [f64; 2],
    /// Weight of the lattice's correlated noise.
    pub alpha: f64,
    /// Standard deviation added to every muscle when probabilities are computed.
    pub regulariser: f64,
    /// Logarithm of a factor of the state-independent lattice's standard deviations.
    pub log_scale: f64,
    /// Steps after which the noise is drawn anew; `None`: once an episode.
    pub steps_between_draws: Option<usize>,
}

impl Default for ExplorationSettings {
    fn default() -> Self {
        Self {
            lattice: false,
            expln: false,
            clip: [1e-3, 10.0],
            alpha: 1.0,
            regulariser: 0.0,
            log_scale: 0.0,
            steps_between_draws: None,
        }
    }
}

/// Running statistics per observation component (`VecNormalize`, `spec/policy.md` §3.7).
#[derive(Debug, Clone, PartialEq)]
pub struct ComponentStatistics {
    pub mean: Vec<f64>,
    pub variance: Vec<f64>,
    pub epsilon: f64,
    pub clip: f64,
    /// Whether observations are normalised at all.
    pub enabled: bool,
}

/// Running statistics per token signature and history lag (`spec/policy.md` §3.6).
#[derive(Debug, Clone, PartialEq)]
pub struct SignatureStatistics {
    /// Sorted vocabulary ids of each row's signature; `[0]` is the padding row.
    pub signatures: Vec<Vec<u16>>,
    /// Rows × `lags`, row-major.
    pub mean: Vec<f32>,
    /// Rows × `lags`, row-major.
    pub variance: Vec<f32>,
    /// One per row.
    pub count: Vec<f64>,
    pub lags: usize,
    pub epsilon: f64,
    pub clip: f64,
    pub enabled: bool,
}

/// A normaliser read from its own file beside the checkpoint.
#[derive(Debug, Clone, PartialEq)]
pub enum Normaliser {
    PerComponent(ComponentStatistics),
    PerSignature(SignatureStatistics),
}

impl Normaliser {
    /// One that leaves every observation as it is.
    #[must_use]
    pub fn none() -> Self {
        let (mean, variance) = (Vec::new(), Vec::new());
        let (epsilon, clip, enabled) = (0.0, f64::MAX, false);
        Self::PerComponent(ComponentStatistics { mean, variance, epsilon, clip, enabled })
    }
}

/// A checkpoint as read.
#[derive(Debug, Clone)]
pub struct Checkpoint {
    pub format: Format,
    pub tensors: TensorMap,
    /// For each tensor name that shares its storage with an earlier one (by name order in the file): that one's name.
    pub aliases: BTreeMap<String, String>,
    pub scalars: Scalars,
    /// Every global that the pickles name, sorted, without duplicates.
    pub globals: Vec<String>,
}

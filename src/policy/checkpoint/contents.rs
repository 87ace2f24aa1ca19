//! What a checkpoint says once it has been read: named tensors, a few scalars, a normaliser. Inert data, whatever
//! container it came from.

use std::collections::BTreeMap;

/// A dense tensor, row-major (C order), converted to `f32`.
#[derive(Debug, Clone, PartialEq)]
pub struct Tensor {
    pub shape: Vec<usize>,
    pub data: Vec<f32>,
}

/// Tensors by their state-dict name.
pub type TensorMap = BTreeMap<String, Tensor>;

/// Which family of files a checkpoint belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Stable-Baselines3 archive of the Arnold muscle transformer.
    ArnoldTransformer,
    /// Stable-Baselines3-contrib archive of a recurrent (LSTM) policy.
    RecurrentPpo,
    /// Stable-Baselines3 archive of a plain multilayer perceptron.
    PpoMlp,
    /// `mjrl` natural-policy-gradient Gaussian MLP pickle.
    NpgMlp,
}

/// Activation functions that a checkpoint may name.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Activation {
    Relu,
    Tanh,
    Elu,
    Silu,
    Gelu,
}

/// Facts that the tensors' shapes do not tell. `None`: the file does not say.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Scalars {
    pub head_count: Option<usize>,
    pub policy_outputs_variance: Option<bool>,
    pub activation: Option<Activation>,
    /// Environment steps seen in training.
    pub training_steps: Option<u64>,
    /// Version of Stable-Baselines3 that wrote the file.
    pub library_version: Option<String>,
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

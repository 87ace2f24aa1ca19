//! The muscle transformer (`spec/policy.md` §1), inference only.
//!
//! Every sensor is a token: its last six normalised values through one linear map, plus the sum of the embeddings of the
//! words that describe it. An encoder lets the tokens look at each other; a decoder lets one query per muscle, the sum
//! of the words that describe the muscle, look at them. One linear map turns each decoded query into the mean of that
//! muscle's action. A second decoder, run only when asked, gives the value.
//!
//! One observation passes through the whole network at a time, so its activations stay in the cache and no row knows of
//! any other. What depends on the task alone is computed once, by [`Transformer::prepare`].

use super::attention::Keys;
use super::layer_norm::LayerNorm;
use super::layers::{DecoderLayer, EncoderLayer, Scratch, Sizes};
use super::linear::{Head, Linear};
use super::weights::Weights;
use super::words::WordTables;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::TensorMap;

/// The network of one checkpoint.
#[derive(Debug, Clone)]
pub struct Transformer {
    sizes: Sizes,
    tokenizer: Linear,
    words: WordTables,
    encoder: Encoder,
    action_decoder: Decoder,
    /// Absent when actor and critic share the action decoder.
    value_decoder: Option<Decoder>,
    mean_head: Head,
    scale_head: Option<Head>,
    value_head: Head,
    log_standard_deviation: f32,
}

/// A stack of encoder layers and its final norm.
#[derive(Debug, Clone)]
pub(super) struct Encoder {
    pub(super) layers: Vec<EncoderLayer>,
    pub(super) norm: LayerNorm,
}

/// A stack of decoder layers and its final norm.
#[derive(Debug, Clone)]
struct Decoder {
    layers: Vec<DecoderLayer>,
    norm: LayerNorm,
}

/// What the network computes once per task.
#[derive(Debug, Clone)]
pub struct TaskConstants {
    token_count: usize,
    /// Number of decoder queries: the muscles, and one more that stands for padding if that was asked for.
    query_count: usize,
    muscle_count: usize,
    /// Sum of the word embeddings of each token, tokens × width.
    token_words: Vec<f32>,
    /// Sum of the word embeddings of each query, queries × width.
    pub(super) query_words: Vec<f32>,
    /// Embedding of the word that asks for the value.
    value_query: Vec<f32>,
    /// The queries after the first decoder layer's self-attention, which sees nothing but them.
    first_queries: Vec<f32>,
}

/// Memory for one observation's way through the network.
#[derive(Debug, Clone)]
pub struct Workspace {
    pub(super) stream: Vec<f32>,
    pub(super) memory: Vec<f32>,
    pub(super) queries: Vec<f32>,
    latent: Vec<f32>,
    pub(super) scratch: Scratch,
}

impl Transformer {
    /// Reads the network off a checkpoint's tensors. The scale head is used if `scaled_variance`.
    pub fn from_tensors(
        tensors: &TensorMap,
        heads: usize,
        scaled_variance: bool,
    ) -> Result<Self, PolicyError> {
        let weights = Weights(tensors);
        let tokens = "features_extractor.tokenizer";
        let encoder = "mlp_extractor.encoder";
        let shared = weights.has("mlp_extractor.decoder.norm.weight");
        let action_decoder =
            if shared { "mlp_extractor.decoder" } else { "mlp_extractor._action_decoder" };

        let [width, lags] = weights.matrix_size(&format!("{tokens}.weight"))?;
        let words = WordTables::read(weights, width)?;
        let [feed_forward, _] =
            weights.matrix_size(&format!("{encoder}.layers.0.linear1.weight"))?;
        if heads == 0 || !width.is_multiple_of(heads) {
            return Err(PolicyError::Heads { heads, width });
        }
        let sizes = Sizes {
            vocabulary: words.len(),
            lags,
            width,
            heads,
            feed_forward,
            encoder_layers: count_layers(weights, encoder),
            decoder_layers: count_layers(weights, action_decoder),
        };
        let scale_head =
            if scaled_variance { Some(Head::read(weights, "log_std_net.0", width)?) } else { None };
        Ok(Self {
            sizes,
            tokenizer: Linear::read(weights, tokens, lags, width)?,
            words,
            encoder: Encoder::read(weights, encoder, &sizes)?,
            action_decoder: Decoder::read(weights, action_decoder, &sizes)?,
            value_decoder: if shared {
                None
            } else {
                Some(Decoder::read(weights, "mlp_extractor._value_decoder", &sizes)?)
            },
            mean_head: Head::read(weights, "action_net.0", width)?,
            scale_head,
            value_head: Head::read(weights, "value_net.1", width)?,
            log_standard_deviation: weights.tensor("log_std", &[])?[0],
        })
    }

    #[must_use]
    pub fn sizes(&self) -> &Sizes {
        &self.sizes
    }

    /// The tasks that have a table of embeddings of their own; empty if all tasks share one.
    #[must_use]
    pub fn tasks_with_own_words(&self) -> Vec<&str> {
        self.words.tasks()
    }

    /// Everything that depends on the task alone, which is named for networks that give every task its own words.
    /// `with_padding` adds one query without words: what a muscle that only pads a batch looks like to the network. No
    /// muscle looks at it.
    pub fn prepare(
        &self,
        task: &str,
        observation_words: &[Vec<u16>],
        action_words: &[Vec<u16>],
        with_padding: bool,
    ) -> Result<TaskConstants, PolicyError> {
        let words = self.words.of_task(task)?;
        let token_words = words.sums(observation_words)?;
        let mut query_words = words.sums(action_words)?;
        let muscle_count = action_words.len();
        let query_count = muscle_count + usize::from(with_padding);
        query_words.resize(query_count * self.sizes.width, 0.0);
        let mut first_queries = query_words.clone();
        if let Some(first) = self.action_decoder.layers.first() {
            let mut scratch = Scratch::new(&self.sizes, query_count);
            first.attend_to_queries(&mut first_queries, muscle_count, &mut scratch);
        }
        let token_count = observation_words.len();
        Ok(TaskConstants {
            token_count,
            query_count,
            muscle_count,
            token_words,
            query_words,
            value_query: words.value_query().to_vec(),
            first_queries,
        })
    }

    /// Memory for observations of `task`.
    #[must_use]
    pub fn workspace(&self, task: &TaskConstants) -> Workspace {
        let rows = task.token_count.max(task.query_count).max(1);
        let zeros = |rows: usize| vec![0.0; rows * self.sizes.width];
        Workspace {
            stream: zeros(task.token_count),
            memory: zeros(task.token_count),
            queries: zeros(task.query_count.max(1)),
            latent: zeros(task.query_count.max(1)),
            scratch: Scratch::new(&self.sizes, rows),
        }
    }

    /// Encodes one observation: normalised windows, tokens × lags, oldest first.
    pub fn encode(&self, task: &TaskConstants, windows: &[f32], workspace: &mut Workspace) {
        self.embed(task, windows, workspace);
        let Workspace { stream, memory, scratch, .. } = workspace;
        self.encoder.apply(stream, Keys::All, memory, scratch);
    }

    /// Fills the stream with one observation's tokens: its windows and its words.
    pub(super) fn embed(&self, task: &TaskConstants, windows: &[f32], workspace: &mut Workspace) {
        workspace.stream.copy_from_slice(&task.token_words);
        self.tokenizer.accumulate(windows, &mut workspace.stream);
    }

    /// Decodes the actions of the observation encoded last and writes their means, one per muscle.
    pub fn action_means(&self, task: &TaskConstants, workspace: &mut Workspace, means: &mut [f32]) {
        workspace.queries.copy_from_slice(&task.first_queries);
        self.decode_actions(task, true, workspace, means);
    }

    /// Decodes the queries in the workspace. `past_first` says that they have been through the first layer's
    /// self-attention already.
    pub(super) fn decode_actions(
        &self,
        task: &TaskConstants,
        past_first: bool,
        workspace: &mut Workspace,
        means: &mut [f32],
    ) {
        let width = self.sizes.width;
        let Workspace { memory, queries, latent, scratch, .. } = workspace;
        for (k, layer) in self.action_decoder.layers.iter().enumerate() {
            if k > 0 || !past_first {
                layer.attend_to_queries(queries, task.muscle_count, scratch);
            }
            layer.attend_to_memory(queries, memory, scratch);
        }
        self.action_decoder.norm.apply(queries, latent);
        for (mean, row) in means.iter_mut().zip(latent.chunks_exact(width)) {
            *mean = self.mean_head.apply(row);
        }
    }

    /// Standard deviations of the actions decoded last, for a batch of this one observation:
    /// `exp(log_std) · u / mean(u)` with `u = exp(softmax(z))` over the muscles.
    pub fn standard_deviations(&self, workspace: &Workspace, deviations: &mut [f32]) {
        let base = f64::from(self.log_standard_deviation).exp();
        let Some(head) = &self.scale_head else {
            deviations.fill(base as f32);
            return;
        };
        for (z, row) in deviations.iter_mut().zip(workspace.latent.chunks_exact(self.sizes.width)) {
            *z = head.apply(row);
        }
        let largest = deviations.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        let weight = |z: f32| f64::from(z - largest).exp();
        let weights: f64 = deviations.iter().map(|&z| weight(z)).sum();
        let spread = |z: f32| (weight(z) / weights).exp();
        let mean = deviations.iter().map(|&z| spread(z)).sum::<f64>() / deviations.len() as f64;
        for z in deviations {
            *z = (base * spread(*z) / mean) as f32;
        }
    }

    /// Value of the observation encoded last. Overwrites the decoded actions.
    pub fn value(&self, task: &TaskConstants, workspace: &mut Workspace) -> f32 {
        let width = self.sizes.width;
        let decoder = self.value_decoder.as_ref().unwrap_or(&self.action_decoder);
        let Workspace { memory, queries, latent, scratch, .. } = workspace;
        let query = &mut queries[..width];
        query.copy_from_slice(&task.value_query);
        for layer in &decoder.layers {
            layer.attend_to_queries(query, 1, scratch);
            layer.attend_to_memory(query, memory, scratch);
        }
        decoder.norm.apply(query, &mut latent[..width]);
        self.value_head.apply(&latent[..width])
    }

    /// Scale logits `z` of the queries decoded last, padding query included; `None` if the policy has no scale head.
    /// With [`Self::log_standard_deviation`] this is what σ of a batch is made of.
    #[must_use]
    pub fn scale_logits(&self, workspace: &Workspace) -> Option<Vec<f32>> {
        let head = self.scale_head.as_ref()?;
        Some(workspace.latent.chunks_exact(self.sizes.width).map(|row| head.apply(row)).collect())
    }

    #[must_use]
    pub fn log_standard_deviation(&self) -> f32 {
        self.log_standard_deviation
    }
}

impl TaskConstants {
    #[must_use]
    pub fn token_count(&self) -> usize {
        self.token_count
    }
}

impl Encoder {
    /// Reads as many layers as `sizes` says.
    pub(super) fn read(weights: Weights, name: &str, sizes: &Sizes) -> Result<Self, PolicyError> {
        Ok(Self {
            layers: (0..sizes.encoder_layers)
                .map(|k| EncoderLayer::read(weights, &format!("{name}.layers.{k}"), sizes))
                .collect::<Result<_, _>>()?,
            norm: LayerNorm::read(weights, &format!("{name}.norm"), sizes.width)?,
        })
    }

    /// Sends the stream through all layers and writes it, normalised, to `memory`.
    pub(super) fn apply(
        &self,
        stream: &mut [f32],
        keys: Keys,
        memory: &mut [f32],
        scratch: &mut Scratch,
    ) {
        for layer in &self.layers {
            layer.apply(stream, keys, scratch);
        }
        self.norm.apply(stream, memory);
    }
}

impl Decoder {
    fn read(weights: Weights, name: &str, sizes: &Sizes) -> Result<Self, PolicyError> {
        Ok(Self {
            layers: (0..sizes.decoder_layers)
                .map(|k| DecoderLayer::read(weights, &format!("{name}.layers.{k}"), sizes))
                .collect::<Result<_, _>>()?,
            norm: LayerNorm::read(weights, &format!("{name}.norm"), sizes.width)?,
        })
    }
}

impl Workspace {
    /// Encoder output of the observation encoded last, tokens × width.
    #[must_use]
    pub fn memory(&self) -> &[f32] {
        &self.memory
    }

    /// Decoder output of the queries decoded last, queries × width.
    #[must_use]
    pub fn latent(&self) -> &[f32] {
        &self.latent
    }
}

fn count_layers(weights: Weights, stack: &str) -> usize {
    weights.numbered(|k| format!("{stack}.layers.{k}.norm1")).len()
}

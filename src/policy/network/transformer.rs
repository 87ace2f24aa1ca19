//! The muscle transformer (`spec/policy.md` §1), inference only.
//!
//! Every sensor is a token: its last six normalised values through one linear map, plus the sum of the embeddings of the
//! words that describe it. An encoder lets the tokens look at each other; a decoder lets one query per muscle, the sum
//! of the words that describe the muscle, look at them. One linear map turns each decoded query into the mean of that
//! muscle's action. A second decoder, run only when asked, gives the value.
//!
//! One observation passes through the whole network at a time, so its activations stay in the cache and no row knows of
//! any other. What depends on the task alone is computed once, by [`Transformer::prepare`].

use super::layer_norm::LayerNorm;
use super::layers::{DecoderLayer, EncoderLayer, Scratch, Sizes};
use super::linear::{Head, Linear};
use super::weights::Weights;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::TensorMap;

/// Vocabulary id of the word that asks for the value.
const VALUE_WORD: usize = 1;

/// The network of one checkpoint.
#[derive(Debug, Clone)]
pub struct Transformer {
    sizes: Sizes,
    tokenizer: Linear,
    /// Words × width.
    embedding: Vec<f32>,
    encoder: Vec<EncoderLayer>,
    encoder_norm: LayerNorm,
    action_decoder: Decoder,
    /// Absent when actor and critic share the action decoder.
    value_decoder: Option<Decoder>,
    mean_head: Head,
    scale_head: Option<Head>,
    value_head: Head,
    log_standard_deviation: f32,
}

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
    /// The queries after the first decoder layer's self-attention, which sees nothing but them.
    first_queries: Vec<f32>,
}

/// Memory for one observation's way through the network.
#[derive(Debug, Clone)]
pub struct Workspace {
    stream: Vec<f32>,
    memory: Vec<f32>,
    queries: Vec<f32>,
    latent: Vec<f32>,
    scratch: Scratch,
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
        let words = "features_extractor.positional_encoder.embedding.weight";
        let encoder = "mlp_extractor.encoder";
        let shared = weights.has("mlp_extractor.decoder.norm.weight");
        let action_decoder =
            if shared { "mlp_extractor.decoder" } else { "mlp_extractor._action_decoder" };

        let [vocabulary, width] = weights.matrix_size(words)?;
        let [_, lags] = weights.matrix_size(&format!("{tokens}.weight"))?;
        let [feed_forward, _] =
            weights.matrix_size(&format!("{encoder}.layers.0.linear1.weight"))?;
        if vocabulary <= VALUE_WORD {
            return Err(PolicyError::TensorShape {
                name: words.to_owned(),
                expected: "at least two words".to_owned(),
                found: vec![vocabulary, width],
            });
        }
        if heads == 0 || !width.is_multiple_of(heads) {
            return Err(PolicyError::Heads { heads, width });
        }
        let sizes = Sizes {
            vocabulary,
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
            embedding: weights.tensor(words, &[vocabulary, width])?.to_vec(),
            encoder: (0..sizes.encoder_layers)
                .map(|k| EncoderLayer::read(weights, &format!("{encoder}.layers.{k}"), &sizes))
                .collect::<Result<_, _>>()?,
            encoder_norm: LayerNorm::read(weights, &format!("{encoder}.norm"), width)?,
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

    /// Everything that depends on the task alone. `with_padding` adds one query without words: what a muscle that only
    /// pads a batch looks like to the network. No muscle looks at it.
    pub fn prepare(
        &self,
        observation_words: &[Vec<u16>],
        action_words: &[Vec<u16>],
        with_padding: bool,
    ) -> Result<TaskConstants, PolicyError> {
        let token_words = self.sum_of_words(observation_words)?;
        let mut first_queries = self.sum_of_words(action_words)?;
        let muscle_count = action_words.len();
        let query_count = muscle_count + usize::from(with_padding);
        first_queries.resize(query_count * self.sizes.width, 0.0);
        if let Some(first) = self.action_decoder.layers.first() {
            let mut scratch = Scratch::new(&self.sizes, query_count);
            first.attend_to_queries(&mut first_queries, muscle_count, &mut scratch);
        }
        let token_count = observation_words.len();
        Ok(TaskConstants { token_count, query_count, muscle_count, token_words, first_queries })
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
        let stream = &mut workspace.stream;
        stream.copy_from_slice(&task.token_words);
        self.tokenizer.accumulate(windows, stream);
        for layer in &self.encoder {
            layer.apply(stream, &mut workspace.scratch);
        }
        self.encoder_norm.apply(stream, &mut workspace.memory);
    }

    /// Decodes the actions of the observation encoded last and writes their means, one per muscle.
    pub fn action_means(&self, task: &TaskConstants, workspace: &mut Workspace, means: &mut [f32]) {
        let width = self.sizes.width;
        let Workspace { memory, queries, latent, scratch, .. } = workspace;
        queries.copy_from_slice(&task.first_queries);
        for (k, layer) in self.action_decoder.layers.iter().enumerate() {
            if k > 0 {
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
    pub fn value(&self, workspace: &mut Workspace) -> f32 {
        let width = self.sizes.width;
        let decoder = self.value_decoder.as_ref().unwrap_or(&self.action_decoder);
        let Workspace { memory, queries, latent, scratch, .. } = workspace;
        let query = &mut queries[..width];
        query.copy_from_slice(&self.embedding[VALUE_WORD * width..(VALUE_WORD + 1) * width]);
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

    fn sum_of_words(&self, descriptions: &[Vec<u16>]) -> Result<Vec<f32>, PolicyError> {
        let width = self.sizes.width;
        let mut sums = vec![0.0; descriptions.len() * width];
        for (sum, words) in sums.chunks_exact_mut(width).zip(descriptions) {
            for &word in words {
                let start = usize::from(word) * width;
                let row = self
                    .embedding
                    .get(start..start + width)
                    .ok_or(PolicyError::UnknownWord { word, vocabulary: self.sizes.vocabulary })?;
                for (s, &e) in sum.iter_mut().zip(row) {
                    *s += e;
                }
            }
        }
        Ok(sums)
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

//! The transformer's layers: each adds its branches to a running stream of rows, normalising before every branch.

use super::attention::{AttentionScratch, CrossAttention, Keys, SelfAttention};
use super::layer_norm::LayerNorm;
use super::linear::Linear;
use super::weights::Weights;
use crate::policy::PolicyError;

/// Rows that pass through a feed-forward branch together, so that their wide middle stays in the cache.
const FEED_FORWARD_BLOCK: usize = 48;

/// Sizes of one transformer, read off its tensors.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Sizes {
    /// Words in the vocabulary.
    pub vocabulary: usize,
    /// History steps per token.
    pub lags: usize,
    /// Width of the stream, `d`.
    pub width: usize,
    pub heads: usize,
    /// Width of the feed-forward branches, `f`.
    pub feed_forward: usize,
    pub encoder_layers: usize,
    pub decoder_layers: usize,
}

impl Sizes {
    /// Name and shape of every tensor that a network of these sizes reads from a checkpoint, without aliases.
    #[must_use]
    pub fn tensor_shapes(&self) -> Vec<(String, Vec<usize>)> {
        let Self { vocabulary, lags, width, feed_forward, .. } = *self;
        let mut shapes = vec![("log_std".to_owned(), Vec::new())];
        let mut add = |name: String, shape: &[usize]| shapes.push((name, shape.to_vec()));
        let extractor = "features_extractor";
        add(format!("{extractor}.tokenizer.weight"), &[width, lags]);
        add(format!("{extractor}.tokenizer.bias"), &[width]);
        add(format!("{extractor}.positional_encoder.embedding.weight"), &[vocabulary, width]);
        let (encoder, decoder) = (&["self_attn"][..], &["self_attn", "multihead_attn"][..]);
        for (stack, layers, attentions) in [
            ("encoder", self.encoder_layers, encoder),
            ("_action_decoder", self.decoder_layers, decoder),
            ("_value_decoder", self.decoder_layers, decoder),
        ] {
            for layer in (0..layers).map(|k| format!("mlp_extractor.{stack}.layers.{k}")) {
                for attention in attentions {
                    add(format!("{layer}.{attention}.in_proj_weight"), &[3 * width, width]);
                    add(format!("{layer}.{attention}.in_proj_bias"), &[3 * width]);
                    add(format!("{layer}.{attention}.out_proj.weight"), &[width, width]);
                    add(format!("{layer}.{attention}.out_proj.bias"), &[width]);
                }
                add(format!("{layer}.linear1.weight"), &[feed_forward, width]);
                add(format!("{layer}.linear1.bias"), &[feed_forward]);
                add(format!("{layer}.linear2.weight"), &[width, feed_forward]);
                add(format!("{layer}.linear2.bias"), &[width]);
                for norm in 1..=attentions.len() + 1 {
                    add(format!("{layer}.norm{norm}.weight"), &[width]);
                    add(format!("{layer}.norm{norm}.bias"), &[width]);
                }
            }
            add(format!("mlp_extractor.{stack}.norm.weight"), &[width]);
            add(format!("mlp_extractor.{stack}.norm.bias"), &[width]);
        }
        for head in ["action_net.0", "log_std_net.0", "value_net.1"] {
            add(format!("{head}.weight"), &[1, width]);
            add(format!("{head}.bias"), &[1]);
        }
        shapes
    }
}

/// Memory that layers write intermediate rows to.
#[derive(Debug, Clone)]
pub(super) struct Scratch {
    normed: Vec<f32>,
    projected: Vec<f32>,
    queries: Vec<f32>,
    mixed: Vec<f32>,
    hidden: Vec<f32>,
    attention: AttentionScratch,
}

impl Scratch {
    /// For sequences of up to `rows` rows.
    pub(super) fn new(sizes: &Sizes, rows: usize) -> Self {
        let zeros = |columns: usize| vec![0.0; rows * columns];
        Self {
            normed: zeros(sizes.width),
            projected: zeros(3 * sizes.width),
            queries: zeros(sizes.width),
            mixed: zeros(sizes.width),
            hidden: vec![0.0; FEED_FORWARD_BLOCK * sizes.feed_forward],
            attention: AttentionScratch::new(rows, sizes.width / sizes.heads),
        }
    }
}

/// `W₂ · relu(W₁ · LN(x) + b₁) + b₂`, added to the stream.
#[derive(Debug, Clone)]
struct FeedForward {
    norm: LayerNorm,
    widen: Linear,
    narrow: Linear,
}

impl FeedForward {
    fn read(weights: Weights, layer: &str, norm: &str, sizes: &Sizes) -> Result<Self, PolicyError> {
        let (width, feed_forward) = (sizes.width, sizes.feed_forward);
        Ok(Self {
            norm: LayerNorm::read(weights, &format!("{layer}.{norm}"), width)?,
            widen: Linear::read(weights, &format!("{layer}.linear1"), width, feed_forward)?,
            narrow: Linear::read(weights, &format!("{layer}.linear2"), feed_forward, width)?,
        })
    }

    fn accumulate(&self, stream: &mut [f32], scratch: &mut Scratch) {
        let width = self.widen.inputs();
        for block in stream.chunks_mut(FEED_FORWARD_BLOCK * width) {
            let normed = &mut scratch.normed[..block.len()];
            let hidden = &mut scratch.hidden[..block.len() / width * self.widen.outputs()];
            self.norm.apply(block, normed);
            self.widen.apply_and_rectify(normed, hidden);
            self.narrow.accumulate(hidden, block);
        }
    }
}

/// One encoder layer: self-attention, then feed-forward.
#[derive(Debug, Clone)]
pub(super) struct EncoderLayer {
    norm: LayerNorm,
    attention: SelfAttention,
    feed_forward: FeedForward,
}

impl EncoderLayer {
    pub(super) fn read(weights: Weights, layer: &str, sizes: &Sizes) -> Result<Self, PolicyError> {
        Ok(Self {
            norm: LayerNorm::read(weights, &format!("{layer}.norm1"), sizes.width)?,
            attention: SelfAttention::read(
                weights,
                &format!("{layer}.self_attn"),
                sizes.width,
                sizes.heads,
            )?,
            feed_forward: FeedForward::read(weights, layer, "norm2", sizes)?,
        })
    }

    pub(super) fn apply(&self, stream: &mut [f32], keys: Keys, scratch: &mut Scratch) {
        attend_to_itself(&self.norm, &self.attention, stream, keys, scratch);
        self.feed_forward.accumulate(stream, scratch);
    }
}

/// One decoder layer: self-attention among the queries, cross-attention to the memory, feed-forward.
#[derive(Debug, Clone)]
pub(super) struct DecoderLayer {
    self_norm: LayerNorm,
    self_attention: SelfAttention,
    cross_norm: LayerNorm,
    cross_attention: CrossAttention,
    feed_forward: FeedForward,
}

impl DecoderLayer {
    pub(super) fn read(weights: Weights, layer: &str, sizes: &Sizes) -> Result<Self, PolicyError> {
        let (width, heads) = (sizes.width, sizes.heads);
        let attention = format!("{layer}.self_attn");
        let cross = format!("{layer}.multihead_attn");
        Ok(Self {
            self_norm: LayerNorm::read(weights, &format!("{layer}.norm1"), width)?,
            self_attention: SelfAttention::read(weights, &attention, width, heads)?,
            cross_norm: LayerNorm::read(weights, &format!("{layer}.norm2"), width)?,
            cross_attention: CrossAttention::read(weights, &cross, width, heads)?,
            feed_forward: FeedForward::read(weights, layer, "norm3", sizes)?,
        })
    }

    /// The first branch, whose keys are the first `key_count` rows of the stream.
    pub(super) fn attend_to_queries(
        &self,
        stream: &mut [f32],
        key_count: usize,
        scratch: &mut Scratch,
    ) {
        let keys = Keys::First(key_count);
        attend_to_itself(&self.self_norm, &self.self_attention, stream, keys, scratch);
    }

    /// The other two branches.
    pub(super) fn attend_to_memory(
        &self,
        stream: &mut [f32],
        memory: &[f32],
        scratch: &mut Scratch,
    ) {
        let normed = &mut scratch.normed[..stream.len()];
        self.cross_norm.apply(stream, normed);
        self.cross_attention.accumulate(
            normed,
            memory,
            &mut scratch.queries[..stream.len()],
            &mut scratch.projected[..2 * memory.len()],
            &mut scratch.mixed[..stream.len()],
            &mut scratch.attention,
            stream,
        );
        self.feed_forward.accumulate(stream, scratch);
    }
}

fn attend_to_itself(
    norm: &LayerNorm,
    attention: &SelfAttention,
    stream: &mut [f32],
    keys: Keys,
    scratch: &mut Scratch,
) {
    let normed = &mut scratch.normed[..stream.len()];
    norm.apply(stream, normed);
    attention.accumulate(
        normed,
        keys,
        &mut scratch.projected[..3 * stream.len()],
        &mut scratch.mixed[..stream.len()],
        &mut scratch.attention,
        stream,
    );
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_published_size_has_the_published_number_of_parameters() {
        // `spec/policy.md` §1.12: width, layers, heads, feed-forward; stored in the file, distinct.
        for (width, layers, heads, feed_forward, stored, distinct) in [
            (128, 6, 4, 512, 4_450_564, 4_393_732),
            (64, 3, 4, 512, 890_692, 862_276),
            (32, 3, 2, 512, 386_212, 372_004),
            (16, 3, 2, 256, 104_020, 96_916),
        ] {
            let sizes = Sizes {
                vocabulary: 214,
                lags: 6,
                width,
                heads,
                feed_forward,
                encoder_layers: layers,
                decoder_layers: layers,
            };
            let count = |prefix: &str| -> usize {
                let shapes = sizes.tensor_shapes().into_iter();
                let named = shapes.filter(|(name, _)| name.starts_with(prefix));
                named.map(|(_, shape)| shape.iter().product::<usize>()).sum()
            };
            // The extractor is in the file three times, the decoders' last norm twice.
            assert_eq!(count("") + 2 * count("features_extractor."), stored);
            assert_eq!(count("") - count("mlp_extractor._value_decoder.norm."), distinct);
        }
    }
}

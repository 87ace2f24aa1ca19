//! The branches of a layer, forward and back. Each normalises the running stream, computes something of it and adds that to
//! the stream; back, each adds its part to the derivatives by the stream.

use crate::train::network::transformer::places::Places;
use crate::train::tape::attention::{Attended, Attention, AttentionScratch};
use crate::train::tape::lanes;
use crate::train::tape::layer_norm::{LayerNorm, Normed};
use crate::train::tape::linear::Linear;
use crate::train::{Parameters, TrainError};

/// Tokens, or queries, of one sample.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Extent {
    pub(super) count: usize,
    pub(super) columns: usize,
}

impl Extent {
    pub(super) fn new(count: usize) -> Self {
        Self { count, columns: lanes(count) }
    }
}

/// Memory that branches share, for one thread.
#[derive(Debug, Clone)]
pub(super) struct Scratch {
    /// Derivatives by the hidden features, or by queries, keys and values.
    wide: Vec<f32>,
    /// Derivatives by what a norm gave, or by mixed values.
    narrow: Vec<f32>,
    queries: Vec<f32>,
    weights: Vec<f32>,
    attention: AttentionScratch,
}

impl Scratch {
    /// For streams of `width` features, branches of `widest` and up to so many tokens.
    pub(super) fn new(width: usize, widest: usize, heads: usize, most: usize) -> Self {
        let columns = lanes(most);
        Self {
            wide: vec![0.0; widest.max(3 * width) * columns],
            narrow: vec![0.0; width * columns],
            queries: vec![0.0; width * columns],
            weights: vec![0.0; lanes(width) * columns],
            attention: AttentionScratch::new(width / heads, columns),
        }
    }
}

impl Scratch {
    /// Room to turn the narrower factor of a weight's derivative.
    pub(super) fn weights(&mut self) -> &mut [f32] {
        &mut self.weights
    }
}

/// Self-attention with its norm.
#[derive(Debug, Clone)]
pub(super) struct SelfBlock {
    pub(super) heads: usize,
    pub(super) norm: LayerNorm,
    pub(super) project: Linear,
    pub(super) output: Linear,
}

/// What its way back needs.
#[derive(Debug, Clone)]
pub(super) struct SelfMemory {
    normed: Normed,
    y: Vec<f32>,
    projected: Vec<f32>,
    attended: Attended,
    mixed: Vec<f32>,
}

impl SelfBlock {
    pub(super) fn find(
        parameters: &Parameters,
        layer: &str,
        heads: usize,
    ) -> Result<Self, TrainError> {
        let places = Places(parameters);
        Ok(Self {
            heads,
            norm: places.norm(&format!("{layer}.norm1"))?,
            project: places.in_projection(&format!("{layer}.self_attn"))?,
            output: places.linear(&format!("{layer}.self_attn.out_proj"))?,
        })
    }

    pub(super) fn memory(&self, most: usize) -> SelfMemory {
        let (width, columns) = (self.output.inputs(), lanes(most));
        let zeros = |rows: usize| vec![0.0; rows * columns];
        SelfMemory {
            normed: Normed::new(width, columns),
            y: zeros(width),
            projected: zeros(3 * width),
            attended: Attended::new(self.heads, most, columns),
            mixed: zeros(width),
        }
    }

    pub(super) fn load(&mut self, numbers: &[f32]) {
        self.norm.load(numbers);
        self.project.load(numbers);
        self.output.load(numbers);
    }

    fn attention(&self, extent: Extent, keys: usize) -> Attention {
        let Extent { count, columns } = extent;
        Attention {
            width: self.output.inputs(),
            heads: self.heads,
            queries: count,
            query_columns: columns,
            keys,
            key_columns: columns,
        }
    }

    /// Everyone in the stream looks at the first `keys` of them.
    pub(super) fn forward(
        &self,
        stream: &mut [f32],
        extent: Extent,
        keys: usize,
        memory: &mut SelfMemory,
        scratch: &mut Scratch,
    ) {
        let (columns, size) = (extent.columns, stream.len());
        let y = &mut memory.y[..size];
        self.norm.apply(stream, columns, &mut memory.normed, y);
        let projected = &mut memory.projected[..3 * size];
        self.project.apply(y, columns, false, projected);
        let mixed = &mut memory.mixed[..size];
        let parts = [&projected[..size], &projected[size..2 * size], &projected[2 * size..]];
        let attention = self.attention(extent, keys);
        attention.apply(parts, &mut memory.attended, &mut scratch.attention, mixed);
        self.output.accumulate(mixed, columns, stream);
    }

    /// `slopes` are those by the stream, after the branch and then before.
    pub(super) fn backward(
        &self,
        slopes: &mut [f32],
        extent: Extent,
        keys: usize,
        memory: &SelfMemory,
        scratch: &mut Scratch,
        gradient: &mut [f32],
    ) {
        let (Extent { count, columns }, size) = (extent, slopes.len());
        let mixed = &memory.mixed[..size];
        let narrow = &mut scratch.narrow[..size];
        self.output.pull_weight(mixed, slopes, columns, count, &mut scratch.weights, gradient);
        self.output.pull_input(slopes, columns, false, narrow);
        let projected = &memory.projected[..3 * size];
        let parts = [&projected[..size], &projected[size..2 * size], &projected[2 * size..]];
        let wide = &mut scratch.wide[..3 * size];
        let (query_slopes, rest) = wide.split_at_mut(size);
        let (key_slopes, value_slopes) = rest.split_at_mut(size);
        self.attention(extent, keys).pull(
            parts,
            mixed,
            narrow,
            &memory.attended,
            &mut scratch.attention,
            [query_slopes, key_slopes, value_slopes],
        );
        let y = &memory.y[..size];
        self.project.pull_weight(y, wide, columns, count, &mut scratch.weights, gradient);
        self.project.pull_input(wide, columns, false, narrow);
        self.norm.pull(&memory.normed, narrow, columns, slopes, gradient);
    }

    pub(super) fn finish(&self, gradient: &mut [f32]) {
        self.project.finish(gradient);
        self.output.finish(gradient);
    }
}

/// Cross-attention with its norm: the stream looks at a memory.
#[derive(Debug, Clone)]
pub(super) struct CrossBlock {
    pub(super) heads: usize,
    pub(super) norm: LayerNorm,
    pub(super) query: Linear,
    pub(super) key_value: Linear,
    pub(super) output: Linear,
}

/// What its way back needs.
#[derive(Debug, Clone)]
pub(super) struct CrossMemory {
    normed: Normed,
    y: Vec<f32>,
    queries: Vec<f32>,
    keys_values: Vec<f32>,
    attended: Attended,
    mixed: Vec<f32>,
}

/// What is looked at, and the derivatives by it.
#[derive(Debug)]
pub(super) struct Seen<'a> {
    pub(super) memory: &'a [f32],
    pub(super) slopes: &'a mut [f32],
    pub(super) extent: Extent,
}

impl CrossBlock {
    pub(super) fn find(
        parameters: &Parameters,
        layer: &str,
        heads: usize,
    ) -> Result<Self, TrainError> {
        let places = Places(parameters);
        let [query, key_value] = places.split_in_projection(&format!("{layer}.multihead_attn"))?;
        Ok(Self {
            heads,
            norm: places.norm(&format!("{layer}.norm2"))?,
            query,
            key_value,
            output: places.linear(&format!("{layer}.multihead_attn.out_proj"))?,
        })
    }

    pub(super) fn memory(&self, most: usize, most_tokens: usize) -> CrossMemory {
        let (width, columns) = (self.output.inputs(), lanes(most));
        let zeros = |columns: usize| vec![0.0; width * columns];
        CrossMemory {
            normed: Normed::new(width, columns),
            y: zeros(columns),
            queries: zeros(columns),
            keys_values: zeros(2 * lanes(most_tokens)),
            attended: Attended::new(self.heads, most, lanes(most_tokens)),
            mixed: zeros(columns),
        }
    }

    pub(super) fn load(&mut self, numbers: &[f32]) {
        self.norm.load(numbers);
        self.query.load(numbers);
        self.key_value.load(numbers);
        self.output.load(numbers);
    }

    fn attention(&self, extent: Extent, tokens: Extent) -> Attention {
        Attention {
            width: self.output.inputs(),
            heads: self.heads,
            queries: extent.count,
            query_columns: extent.columns,
            keys: tokens.count,
            key_columns: tokens.columns,
        }
    }

    pub(super) fn forward(
        &self,
        stream: &mut [f32],
        extent: Extent,
        (seen, tokens): (&[f32], Extent),
        memory: &mut CrossMemory,
        scratch: &mut Scratch,
    ) {
        let size = stream.len();
        let y = &mut memory.y[..size];
        self.norm.apply(stream, extent.columns, &mut memory.normed, y);
        let queries = &mut memory.queries[..size];
        self.query.apply(y, extent.columns, false, queries);
        let keys_values = &mut memory.keys_values[..2 * seen.len()];
        self.key_value.apply(seen, tokens.columns, false, keys_values);
        let (keys, values) = keys_values.split_at(seen.len());
        let mixed = &mut memory.mixed[..size];
        let attention = self.attention(extent, tokens);
        let parts = [&*queries, keys, values];
        attention.apply(parts, &mut memory.attended, &mut scratch.attention, mixed);
        self.output.accumulate(mixed, extent.columns, stream);
    }

    pub(super) fn backward(
        &self,
        slopes: &mut [f32],
        extent: Extent,
        seen: &mut Seen<'_>,
        memory: &CrossMemory,
        scratch: &mut Scratch,
        gradient: &mut [f32],
    ) {
        let (Extent { count, columns }, size) = (extent, slopes.len());
        let (tokens, token_size) = (seen.extent, seen.memory.len());
        let mixed = &memory.mixed[..size];
        let narrow = &mut scratch.narrow[..size];
        self.output.pull_weight(mixed, slopes, columns, count, &mut scratch.weights, gradient);
        self.output.pull_input(slopes, columns, false, narrow);
        let (keys, values) = memory.keys_values[..2 * token_size].split_at(token_size);
        let query_slopes = &mut scratch.queries[..size];
        let wide = &mut scratch.wide[..2 * token_size];
        let (key_slopes, value_slopes) = wide.split_at_mut(token_size);
        self.attention(extent, tokens).pull(
            [&memory.queries[..size], keys, values],
            mixed,
            narrow,
            &memory.attended,
            &mut scratch.attention,
            [&mut *query_slopes, key_slopes, value_slopes],
        );
        self.key_value.pull_weight(
            seen.memory,
            wide,
            tokens.columns,
            tokens.count,
            &mut scratch.weights,
            gradient,
        );
        self.key_value.pull_input(wide, tokens.columns, true, seen.slopes);
        let y = &memory.y[..size];
        self.query.pull_weight(y, query_slopes, columns, count, &mut scratch.weights, gradient);
        self.query.pull_input(query_slopes, columns, false, narrow);
        self.norm.pull(&memory.normed, narrow, columns, slopes, gradient);
    }

    pub(super) fn finish(&self, gradient: &mut [f32]) {
        self.query.finish(gradient);
        self.key_value.finish(gradient);
        self.output.finish(gradient);
    }
}

/// `W₂ relu(W₁ LN(x) + b₁) + b₂`.
#[derive(Debug, Clone)]
pub(super) struct FeedForward {
    pub(super) norm: LayerNorm,
    pub(super) widen: Linear,
    pub(super) narrow: Linear,
}

/// What its way back needs.
#[derive(Debug, Clone)]
pub(super) struct FeedForwardMemory {
    normed: Normed,
    y: Vec<f32>,
    hidden: Vec<f32>,
}

impl FeedForward {
    pub(super) fn find(
        parameters: &Parameters,
        layer: &str,
        norm: &str,
    ) -> Result<Self, TrainError> {
        let places = Places(parameters);
        Ok(Self {
            norm: places.norm(&format!("{layer}.{norm}"))?,
            widen: places.linear(&format!("{layer}.linear1"))?,
            narrow: places.linear(&format!("{layer}.linear2"))?,
        })
    }

    pub(super) fn memory(&self, most: usize) -> FeedForwardMemory {
        let columns = lanes(most);
        FeedForwardMemory {
            normed: Normed::new(self.widen.inputs(), columns),
            y: vec![0.0; self.widen.inputs() * columns],
            hidden: vec![0.0; self.widen.outputs() * columns],
        }
    }

    pub(super) fn load(&mut self, numbers: &[f32]) {
        self.norm.load(numbers);
        self.widen.load(numbers);
        self.narrow.load(numbers);
    }

    pub(super) fn forward(
        &self,
        stream: &mut [f32],
        extent: Extent,
        memory: &mut FeedForwardMemory,
    ) {
        let columns = extent.columns;
        let y = &mut memory.y[..stream.len()];
        self.norm.apply(stream, columns, &mut memory.normed, y);
        let hidden = &mut memory.hidden[..self.widen.outputs() * columns];
        self.widen.apply(y, columns, true, hidden);
        self.narrow.accumulate(hidden, columns, stream);
    }

    pub(super) fn backward(
        &self,
        slopes: &mut [f32],
        extent: Extent,
        memory: &FeedForwardMemory,
        scratch: &mut Scratch,
        gradient: &mut [f32],
    ) {
        let Extent { count, columns } = extent;
        let hidden = &memory.hidden[..self.widen.outputs() * columns];
        let wide = &mut scratch.wide[..hidden.len()];
        self.narrow.pull_weight(hidden, slopes, columns, count, &mut scratch.weights, gradient);
        self.narrow.pull_input(slopes, columns, false, wide);
        for (slope, &h) in wide.iter_mut().zip(hidden) {
            *slope = if h > 0.0 { *slope } else { 0.0 };
        }
        let y = &memory.y[..slopes.len()];
        self.widen.pull_weight(y, wide, columns, count, &mut scratch.weights, gradient);
        let narrow = &mut scratch.narrow[..slopes.len()];
        self.widen.pull_input(wide, columns, false, narrow);
        self.norm.pull(&memory.normed, narrow, columns, slopes, gradient);
    }

    pub(super) fn finish(&self, gradient: &mut [f32]) {
        self.widen.finish(gradient);
        self.narrow.finish(gradient);
    }
}

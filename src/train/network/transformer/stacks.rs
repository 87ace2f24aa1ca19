//! Encoder and decoder: layers of branches, and a norm at the end.

use super::blocks::{
    CrossBlock, CrossMemory, Extent, FeedForward, FeedForwardMemory, Scratch, Seen, SelfBlock,
    SelfMemory,
};
use super::places::Places;
use crate::train::tape::lanes;
use crate::train::tape::layer_norm::{LayerNorm, Normed};
use crate::train::{Parameters, TrainError};

/// Lets tokens look at each other.
#[derive(Debug, Clone)]
pub(super) struct Encoder {
    layers: Vec<(SelfBlock, FeedForward)>,
    norm: LayerNorm,
}

/// What its way back needs.
#[derive(Debug, Clone)]
pub(super) struct EncoderMemory {
    layers: Vec<(SelfMemory, FeedForwardMemory)>,
    normed: Normed,
}

impl Encoder {
    pub(super) fn find(
        parameters: &Parameters,
        name: &str,
        layers: usize,
        heads: usize,
    ) -> Result<Self, TrainError> {
        let layer = |k: usize| {
            let layer = format!("{name}.layers.{k}");
            let attention = SelfBlock::find(parameters, &layer, heads)?;
            Ok((attention, FeedForward::find(parameters, &layer, "norm2")?))
        };
        Ok(Self {
            layers: (0..layers).map(layer).collect::<Result<_, TrainError>>()?,
            norm: Places(parameters).norm(&format!("{name}.norm"))?,
        })
    }

    pub(super) fn memory(&self, width: usize, most: usize) -> EncoderMemory {
        let layers = self.layers.iter().map(|(a, f)| (a.memory(most), f.memory(most)));
        EncoderMemory { layers: layers.collect(), normed: Normed::new(width, lanes(most)) }
    }

    pub(super) fn load(&mut self, numbers: &[f32]) {
        for (attention, feed_forward) in &mut self.layers {
            attention.load(numbers);
            feed_forward.load(numbers);
        }
        self.norm.load(numbers);
    }

    pub(super) fn forward(
        &self,
        stream: &mut [f32],
        extent: Extent,
        memory: &mut EncoderMemory,
        scratch: &mut Scratch,
        encoded: &mut [f32],
    ) {
        for ((attention, feed_forward), kept) in self.layers.iter().zip(&mut memory.layers) {
            attention.forward(stream, extent, extent.count, &mut kept.0, scratch);
            feed_forward.forward(stream, extent, &mut kept.1);
        }
        self.norm.apply(stream, extent.columns, &mut memory.normed, encoded);
    }

    /// From derivatives by what was encoded to those by the stream at the start, which are written to `slopes`.
    pub(super) fn backward(
        &self,
        encoded_slopes: &[f32],
        extent: Extent,
        memory: &EncoderMemory,
        scratch: &mut Scratch,
        slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        slopes.fill(0.0);
        self.norm.pull(&memory.normed, encoded_slopes, extent.columns, slopes, gradient);
        for ((attention, feed_forward), kept) in self.layers.iter().zip(&memory.layers).rev() {
            feed_forward.backward(slopes, extent, &kept.1, scratch, gradient);
            attention.backward(slopes, extent, extent.count, &kept.0, scratch, gradient);
        }
    }

    pub(super) fn finish(&self, gradient: &mut [f32]) {
        for (attention, feed_forward) in &self.layers {
            attention.finish(gradient);
            feed_forward.finish(gradient);
        }
    }
}

/// Lets queries look at each other and at what was encoded.
#[derive(Debug, Clone)]
pub(super) struct Decoder {
    pub(super) layers: Vec<(SelfBlock, CrossBlock, FeedForward)>,
    pub(super) norm: LayerNorm,
}

/// What its way back needs.
#[derive(Debug, Clone)]
pub(super) struct DecoderMemory {
    layers: Vec<(SelfMemory, CrossMemory, FeedForwardMemory)>,
    normed: Normed,
}

/// The queries of one sample: how many there are and how many of them are looked at.
#[derive(Debug, Clone, Copy)]
pub(super) struct Queries {
    pub(super) extent: Extent,
    pub(super) keys: usize,
}

impl Decoder {
    pub(super) fn find(
        parameters: &Parameters,
        name: &str,
        norm: &str,
        layers: usize,
        heads: usize,
    ) -> Result<Self, TrainError> {
        let layer = |k: usize| {
            let layer = format!("{name}.layers.{k}");
            Ok((
                SelfBlock::find(parameters, &layer, heads)?,
                CrossBlock::find(parameters, &layer, heads)?,
                FeedForward::find(parameters, &layer, "norm3")?,
            ))
        };
        Ok(Self {
            layers: (0..layers).map(layer).collect::<Result<_, TrainError>>()?,
            norm: Places(parameters).norm(norm)?,
        })
    }

    pub(super) fn memory(&self, width: usize, most: usize, most_tokens: usize) -> DecoderMemory {
        let layers = self.layers.iter().map(|(attention, cross, feed_forward)| {
            let cross = cross.memory(most, most_tokens);
            (attention.memory(most), cross, feed_forward.memory(most))
        });
        DecoderMemory { layers: layers.collect(), normed: Normed::new(width, lanes(most)) }
    }

    pub(super) fn load(&mut self, numbers: &[f32]) {
        for (attention, cross, feed_forward) in &mut self.layers {
            attention.load(numbers);
            cross.load(numbers);
            feed_forward.load(numbers);
        }
        self.norm.load(numbers);
    }

    /// The first branch, which sees nothing but the queries and so is the same for every sample of a task.
    pub(super) fn first(&self) -> Option<&SelfBlock> {
        self.layers.first().map(|(attention, ..)| attention)
    }

    /// The other branches, from the queries after the first.
    pub(super) fn forward(
        &self,
        stream: &mut [f32],
        Queries { extent, keys }: Queries,
        (encoded, tokens): (&[f32], Extent),
        memory: &mut DecoderMemory,
        scratch: &mut Scratch,
        decoded: &mut [f32],
    ) {
        let layers = self.layers.iter().zip(&mut memory.layers);
        for (k, ((attention, cross, feed_forward), kept)) in layers.enumerate() {
            if k > 0 {
                attention.forward(stream, extent, keys, &mut kept.0, scratch);
            }
            cross.forward(stream, extent, (encoded, tokens), &mut kept.1, scratch);
            feed_forward.forward(stream, extent, &mut kept.2);
        }
        self.norm.apply(stream, extent.columns, &mut memory.normed, decoded);
    }

    /// From derivatives by what was decoded to those by the queries after the first branch, which are written to `slopes`,
    /// and by what was encoded.
    #[expect(clippy::too_many_arguments, reason = "memory is the caller's")]
    pub(super) fn backward(
        &self,
        decoded_slopes: &[f32],
        Queries { extent, keys }: Queries,
        seen: &mut Seen<'_>,
        memory: &DecoderMemory,
        scratch: &mut Scratch,
        slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        slopes.fill(0.0);
        self.norm.pull(&memory.normed, decoded_slopes, extent.columns, slopes, gradient);
        let layers = self.layers.iter().zip(&memory.layers).enumerate();
        for (k, ((attention, cross, feed_forward), kept)) in layers.rev() {
            feed_forward.backward(slopes, extent, &kept.2, scratch, gradient);
            cross.backward(slopes, extent, seen, &kept.1, scratch, gradient);
            if k > 0 {
                attention.backward(slopes, extent, keys, &kept.0, scratch, gradient);
            }
        }
    }

    pub(super) fn finish(&self, gradient: &mut [f32]) {
        for (attention, cross, feed_forward) in &self.layers {
            attention.finish(gradient);
            cross.finish(gradient);
            feed_forward.finish(gradient);
        }
    }
}

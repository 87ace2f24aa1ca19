//! A decoder with one query, that of the value: its stream is one vector, which attends to itself alone, and keys and values
//! of what was encoded are not needed ([`Lookup`]).

use super::blocks::{CrossBlock, Extent, FeedForward, Seen, SelfBlock};
use super::stacks::Decoder;
use crate::train::tape::lookup::{LookedUp, Lookup, LookupScratch};
use crate::train::tape::one_token::NormedOne;
use crate::train::tape::{add, lanes};

/// What the way back of a decoder with one query needs.
#[derive(Debug, Clone)]
pub(super) struct OneMemory {
    layers: Vec<(SelfOne, CrossOne, FeedForwardOne)>,
    normed: NormedOne,
    scratch: OneScratch,
}

#[derive(Debug, Clone)]
struct SelfOne {
    normed: NormedOne,
    y: Vec<f32>,
    value: Vec<f32>,
}

#[derive(Debug, Clone)]
struct CrossOne {
    normed: NormedOne,
    y: Vec<f32>,
    query: Vec<f32>,
    looked_up: LookedUp,
    mixed: Vec<f32>,
}

#[derive(Debug, Clone)]
struct FeedForwardOne {
    normed: NormedOne,
    y: Vec<f32>,
    hidden: Vec<f32>,
}

/// Memory that branches share.
#[derive(Debug, Clone)]
struct OneScratch {
    /// What a branch gives, or the derivatives by what its last layer takes.
    end: Vec<f32>,
    /// Derivatives by what its norm gave.
    start: Vec<f32>,
    query: Vec<f32>,
    hidden: Vec<f32>,
    lookup: LookupScratch,
}

impl SelfBlock {
    fn forward_one(&self, stream: &mut [f32], memory: &mut SelfOne, scratch: &mut OneScratch) {
        let width = stream.len();
        self.norm.apply_to_one(stream, &mut memory.normed, &mut memory.y);
        self.project.apply_to_one(2 * width..3 * width, &memory.y, false, &mut memory.value);
        self.output.apply_to_one(0..width, &memory.value, false, &mut scratch.end);
        add(&scratch.end, stream);
    }

    fn backward_one(
        &self,
        slopes: &mut [f32],
        memory: &SelfOne,
        scratch: &mut OneScratch,
        gradient: &mut [f32],
    ) {
        let width = slopes.len();
        let OneScratch { end, start, .. } = scratch;
        end.fill(0.0);
        self.output.pull_one(0..width, &memory.value, slopes, end, gradient);
        start.fill(0.0);
        self.project.pull_one(2 * width..3 * width, &memory.y, end, start, gradient);
        self.norm.pull_one(&memory.normed, start, slopes, gradient);
    }
}

impl CrossBlock {
    fn lookup(&self, tokens: Extent) -> Lookup {
        let (width, heads) = (self.output.inputs(), self.heads);
        Lookup { width, heads, tokens: tokens.count, columns: tokens.columns }
    }

    fn forward_one(
        &self,
        stream: &mut [f32],
        (seen, tokens): (&[f32], Extent),
        memory: &mut CrossOne,
        scratch: &mut OneScratch,
    ) {
        let width = stream.len();
        let CrossOne { normed, y, query, looked_up, mixed } = memory;
        let OneScratch { end, lookup, .. } = scratch;
        self.norm.apply_to_one(stream, normed, y);
        self.query.apply_to_one(0..width, y, false, query);
        self.lookup(tokens).apply(query, seen, &self.key_value, looked_up, lookup, mixed);
        self.output.apply_to_one(0..width, mixed, false, end);
        add(end, stream);
    }

    fn backward_one(
        &self,
        slopes: &mut [f32],
        seen: &mut Seen<'_>,
        memory: &CrossOne,
        scratch: &mut OneScratch,
        gradient: &mut [f32],
    ) {
        let width = slopes.len();
        let OneScratch { end, start, query, lookup, .. } = scratch;
        end.fill(0.0);
        self.output.pull_one(0..width, &memory.mixed, slopes, end, gradient);
        self.lookup(seen.extent).pull(
            &memory.query,
            seen.memory,
            &self.key_value,
            end,
            &memory.looked_up,
            lookup,
            query,
            seen.slopes,
            gradient,
        );
        start.fill(0.0);
        self.query.pull_one(0..width, &memory.y, query, start, gradient);
        self.norm.pull_one(&memory.normed, start, slopes, gradient);
    }
}

impl FeedForward {
    fn forward_one(
        &self,
        stream: &mut [f32],
        memory: &mut FeedForwardOne,
        scratch: &mut OneScratch,
    ) {
        let FeedForwardOne { normed, y, hidden } = memory;
        self.norm.apply_to_one(stream, normed, y);
        self.widen.apply_to_one(0..hidden.len(), y, true, hidden);
        self.narrow.apply_to_one(0..stream.len(), hidden, false, &mut scratch.end);
        add(&scratch.end, stream);
    }

    fn backward_one(
        &self,
        slopes: &mut [f32],
        memory: &FeedForwardOne,
        scratch: &mut OneScratch,
        gradient: &mut [f32],
    ) {
        let OneScratch { start, hidden, .. } = scratch;
        hidden.fill(0.0);
        self.narrow.pull_one(0..slopes.len(), &memory.hidden, slopes, hidden, gradient);
        for (slope, &h) in hidden.iter_mut().zip(&memory.hidden) {
            *slope = if h > 0.0 { *slope } else { 0.0 };
        }
        start.fill(0.0);
        self.widen.pull_one(0..hidden.len(), &memory.y, hidden, start, gradient);
        self.norm.pull_one(&memory.normed, start, slopes, gradient);
    }
}

impl Decoder {
    pub(super) fn memory_of_one(&self, width: usize, most_tokens: usize) -> OneMemory {
        let (zeros, normed) = (vec![0.0; width], NormedOne::new(width));
        let (columns, mut heads, mut widest) = (lanes(most_tokens), 1, 0);
        let layers = self.layers.iter().map(|(_, cross, feed_forward)| {
            (heads, widest) = (cross.heads, feed_forward.widen.outputs());
            let (normed, y) = (normed.clone(), zeros.clone());
            let attention = SelfOne { normed: normed.clone(), y: y.clone(), value: zeros.clone() };
            let cross = CrossOne {
                normed: normed.clone(),
                y: y.clone(),
                query: zeros.clone(),
                looked_up: LookedUp::new(width, cross.heads, columns),
                mixed: zeros.clone(),
            };
            (attention, cross, FeedForwardOne { normed, y, hidden: vec![0.0; widest] })
        });
        let layers = layers.collect();
        let scratch = OneScratch {
            end: zeros.clone(),
            start: zeros.clone(),
            query: zeros,
            hidden: vec![0.0; widest],
            lookup: LookupScratch::new(width, heads, columns),
        };
        OneMemory { layers, normed, scratch }
    }

    /// [`Decoder::forward`] for one query.
    pub(super) fn forward_one(
        &self,
        stream: &mut [f32],
        encoded: (&[f32], Extent),
        memory: &mut OneMemory,
        decoded: &mut [f32],
    ) {
        let OneMemory { layers, normed, scratch } = memory;
        for (k, ((attention, cross, feed_forward), kept)) in
            self.layers.iter().zip(layers).enumerate()
        {
            if k > 0 {
                attention.forward_one(stream, &mut kept.0, scratch);
            }
            cross.forward_one(stream, encoded, &mut kept.1, scratch);
            feed_forward.forward_one(stream, &mut kept.2, scratch);
        }
        self.norm.apply_to_one(stream, normed, decoded);
    }

    /// [`Decoder::backward`] for one query.
    pub(super) fn backward_one(
        &self,
        decoded_slopes: &[f32],
        seen: &mut Seen<'_>,
        memory: &mut OneMemory,
        slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        let OneMemory { layers, normed, scratch } = memory;
        slopes.fill(0.0);
        self.norm.pull_one(normed, decoded_slopes, slopes, gradient);
        for (k, ((attention, cross, feed_forward), kept)) in
            self.layers.iter().zip(layers).enumerate().rev()
        {
            feed_forward.backward_one(slopes, &kept.2, scratch, gradient);
            cross.backward_one(slopes, seen, &kept.1, scratch, gradient);
            if k > 0 {
                attention.backward_one(slopes, &kept.0, scratch, gradient);
            }
        }
    }
}

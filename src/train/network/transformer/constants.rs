//! What all samples of a minibatch share: the loaded layers, and for every task the sums of its words and its queries
//! after the first self-attention. Samples add up the derivatives by the latter; [`Transformer::finish`] sends the sums on.

use std::ops::Range;

use super::blocks::{Extent, Scratch, SelfBlock, SelfMemory};
use super::pass::Deviations;
use super::stacks::Queries;
use super::words::value_description;
use super::{Parts, Transformer};

/// Numbers that are the same for every sample of a minibatch.
pub(super) struct Constants {
    pub(super) parts: Parts,
    pub(super) tasks: Vec<TaskConstants>,
    /// Where the sums of the scale head's part of `∂ Σ u` begin, behind all parameters: one number for each feature, one for
    /// the bias, and one for `Σ ∂ ln σ`.
    pub(super) spread: Range<usize>,
    end: usize,
    start: usize,
}

/// The part of them that belongs to a task.
pub(super) struct TaskConstants {
    pub(super) tokens: Extent,
    /// Sums of the tokens' words, features × columns.
    pub(super) token_words: Vec<f32>,
    pub(super) action: First,
    pub(super) value: First,
    /// Where derivatives by the tokens' words are summed.
    pub(super) token_sums: Range<usize>,
}

/// Queries after a decoder's first branch.
pub(super) struct First {
    pub(super) queries: Queries,
    pub(super) stream: Vec<f32>,
    memory: Option<SelfMemory>,
    /// Where derivatives by `stream` are summed.
    pub(super) sums: Range<usize>,
}

impl Constants {
    pub(super) fn new(network: &Transformer) -> Self {
        let numbers = network.parameters.numbers();
        let mut parts = network.parts.clone();
        parts.load(numbers);
        let width = network.settings.sizes.width;
        let start = numbers.len();
        let mut end = start;
        let mut place = |length: usize| {
            end += length;
            end - length..end
        };
        let tasks = network.tasks.iter().zip(&parts.tables).map(|(words, table)| {
            let tokens = Extent::new(words.sensors.len());
            let mut descriptions = words.muscles.clone();
            if words.is_padded() {
                descriptions.push(Vec::new());
            }
            let mut first = |block: Option<&SelfBlock>, descriptions: &[Vec<u16>], keys: usize| {
                let extent = Extent::new(descriptions.len());
                let mut stream = table.sums(numbers, descriptions);
                let memory = block.map(|block| {
                    let sizes = &network.settings.sizes;
                    let mut scratch = Scratch::new(width, 0, sizes.heads, extent.count);
                    let mut memory = block.memory(extent.count);
                    block.forward(&mut stream, extent, keys, &mut memory, &mut scratch);
                    memory
                });
                let sums = place(stream.len());
                First { queries: Queries { extent, keys }, stream, memory, sums }
            };
            let action = first(parts.action_decoder.first(), &descriptions, words.muscles.len());
            let value = first(parts.value_decoder().first(), &value_description(), 1);
            let token_words = table.sums(numbers, &words.sensors);
            let token_sums = place(token_words.len());
            TaskConstants { tokens, token_words, action, value, token_sums }
        });
        let tasks = tasks.collect();
        let spread = place(width + 2);
        Self { parts, tasks, spread, end, start }
    }

    /// Numbers that samples sum beside the parameters.
    pub(super) fn extra_length(&self) -> usize {
        self.end - self.start
    }
}

impl Transformer {
    /// Turns what the samples summed beside the parameters into derivatives by parameters.
    pub(super) fn finish(
        &self,
        constants: &Constants,
        deviations: Deviations,
        entries: usize,
        sums: &mut [f32],
    ) {
        let width = self.settings.sizes.width;
        let (gradient, extra) = sums.split_at_mut(self.parameters.numbers().len());
        let of = |place: &Range<usize>| place.start - constants.start..place.end - constants.start;
        let parts = &constants.parts;
        for ((words, table), task) in self.tasks.iter().zip(&parts.tables).zip(&constants.tasks) {
            let value = value_description();
            for (first, block, descriptions) in [
                (&task.action, parts.action_decoder.first(), &words.muscles),
                (&task.value, parts.value_decoder().first(), &value),
            ] {
                let slopes = &mut extra[of(&first.sums)];
                let Queries { extent, keys } = first.queries;
                if let (Some(block), Some(memory)) = (block, &first.memory) {
                    let heads = self.settings.sizes.heads;
                    let mut scratch = Scratch::new(width, 0, heads, extent.count);
                    block.backward(slopes, extent, keys, memory, &mut scratch, gradient);
                }
                table.pull(slopes, descriptions, gradient);
            }
            table.pull(&extra[of(&task.token_sums)], &words.sensors, gradient);
        }
        if let (Deviations::AroundMean { mean }, Some(head)) = (deviations, &parts.scale_head) {
            let spread = &extra[of(&constants.spread)];
            // −Σ ∂ ln σ · ∂ ln mean(u), and mean(u) is a sum over so many entries.
            let factor = spread[width + 1] / (mean * entries as f64) as f32;
            for (g, along) in gradient[head.weight.clone()].iter_mut().zip(spread) {
                *g -= factor * along;
            }
            gradient[head.bias] -= factor * spread[width];
        }
        parts.finish(gradient);
        for place in self.parameters.places().iter().filter(|place| !place.trainable) {
            gradient[place.range.clone()].fill(0.0);
        }
    }
}

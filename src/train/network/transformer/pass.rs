//! The way of one sample through the transformer, forward and back.

use super::Transformer;
use super::blocks::{Extent, Scratch, Seen};
use super::constants::{Constants, First, TaskConstants};
use super::heads::Shape;
use super::one_query::OneMemory;
use super::stacks::{DecoderMemory, EncoderMemory};
use crate::train::distribution::{Distribution, Gaussian};
use crate::train::losses::{LossScratch, Objective, Slopes};
use crate::train::network::{Decision, Player};
use crate::train::tape::{add, lanes, turn};
use crate::train::{Losses, Sample};

/// What the shape of standard deviations is measured by.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Deviations {
    /// Its mean over the observation's own action.
    OfObservation,
    /// Its mean over the minibatch.
    AroundMean { mean: f64 },
}

/// One thread's memory, large enough for every task.
pub(super) struct Memory {
    /// Lags × columns.
    windows: Vec<f32>,
    stream: Vec<f32>,
    encoded: Vec<f32>,
    encoded_slopes: Vec<f32>,
    encoder: EncoderMemory,
    action: Decoded,
    value: Valued,
    scratch: Scratch,
    /// Numbers of an action.
    means: Vec<f32>,
    mean_slopes: Vec<f32>,
    log_deviations: Vec<f32>,
    log_slopes: Vec<f32>,
    shape: Shape,
    loss: LossScratch,
}

/// A decoder's output and what its way back needs.
struct Decoded {
    kept: DecoderMemory,
    stream: Vec<f32>,
    latent: Vec<f32>,
    slopes: Vec<f32>,
    /// One number for each column.
    numbers: Vec<f32>,
    head_slopes: Vec<f32>,
    /// Derivatives by the scale head's numbers.
    scale_slopes: Vec<f32>,
}

/// The same for the one query of the value.
struct Valued {
    kept: OneMemory,
    stream: Vec<f32>,
    latent: Vec<f32>,
    slopes: Vec<f32>,
}

impl Decoded {
    fn new(kept: DecoderMemory, width: usize, most: usize) -> Self {
        let rows = |count: usize| vec![0.0; count * lanes(most)];
        Self {
            kept,
            stream: rows(width),
            latent: rows(width),
            slopes: rows(width),
            numbers: rows(1),
            head_slopes: rows(1),
            scale_slopes: rows(1),
        }
    }
}

impl Memory {
    pub(super) fn new(network: &Transformer) -> Self {
        let (sizes, parts) = (&network.settings.sizes, &network.parts);
        let most = |count: fn(&super::TaskWords) -> usize| {
            network.tasks.iter().map(count).max().unwrap_or(1)
        };
        let tokens = most(|task| task.sensors.len());
        let queries = most(|task| task.muscles.len() + 1);
        let actions = most(|task| task.action_length);
        let rows = |count: usize| vec![0.0; count * lanes(tokens)];
        let action = parts.action_decoder.memory(sizes.width, queries, tokens);
        let zeros = vec![0.0; sizes.width];
        Self {
            windows: rows(sizes.lags),
            stream: rows(sizes.width),
            encoded: rows(sizes.width),
            encoded_slopes: rows(sizes.width),
            encoder: parts.encoder.memory(sizes.width, tokens),
            action: Decoded::new(action, sizes.width, queries),
            value: Valued {
                kept: parts.value_decoder().memory_of_one(sizes.width, tokens),
                stream: zeros.clone(),
                latent: zeros.clone(),
                slopes: zeros,
            },
            scratch: Scratch::new(
                sizes.width,
                sizes.feed_forward,
                sizes.heads,
                tokens.max(queries),
            ),
            means: vec![0.0; actions],
            mean_slopes: vec![0.0; actions],
            log_deviations: vec![0.0; actions],
            log_slopes: vec![0.0; actions],
            shape: Shape::default(),
            loss: LossScratch::new(actions),
        }
    }
}

impl Transformer {
    fn encode(
        &self,
        constants: &Constants,
        task: &TaskConstants,
        observation: &[f32],
        memory: &mut Memory,
    ) {
        let (lags, Extent { count, columns }) = (self.settings.sizes.lags, task.tokens);
        let Memory { windows, stream, encoded, encoder, scratch, .. } = memory;
        let windows = &mut windows[..lags * columns];
        for row in windows.chunks_exact_mut(columns) {
            row[count..].fill(0.0);
        }
        turn(observation, lags, lags, 1.0, windows, columns);
        let stream = &mut stream[..task.token_words.len()];
        stream.copy_from_slice(&task.token_words);
        let parts = &constants.parts;
        parts.tokenizer.accumulate(windows, columns, stream);
        let encoded = &mut encoded[..stream.len()];
        parts.encoder.forward(stream, task.tokens, encoder, scratch, encoded);
    }

    /// Decodes the actions of what was encoded last, and their standard deviations.
    fn decode_actions(
        &self,
        constants: &Constants,
        task: &TaskConstants,
        deviations: Deviations,
        entries: usize,
        memory: &mut Memory,
    ) {
        let (numbers, parts) = (self.parameters.numbers(), &constants.parts);
        let Memory { encoded, action, scratch, means, log_deviations, shape, .. } = memory;
        let encoded = (&encoded[..task.token_words.len()], task.tokens);
        decode(&parts.action_decoder, &task.action, encoded, action, scratch);
        let columns = task.action.queries.extent.columns;
        let latent = &action.latent[..task.action.stream.len()];
        parts.mean_head.apply(numbers, latent, columns, &mut action.numbers);
        let last = task.action.queries.extent.count - 1;
        // Every entry beyond the muscles is the padding query.
        let entry = |i: usize| i.min(last);
        for (i, mean) in means[..entries].iter_mut().enumerate() {
            *mean = action.numbers[entry(i)];
        }
        let (logs, log) = (&mut log_deviations[..entries], numbers[parts.log_deviation]);
        let Some(head) = &parts.scale_head else {
            logs.fill(log);
            return;
        };
        head.apply(numbers, latent, columns, &mut action.numbers);
        let logits = &action.numbers;
        shape.set((0..entries).map(|i| logits[entry(i)]));
        let mean = match deviations {
            Deviations::OfObservation => shape.total() / entries as f64,
            Deviations::AroundMean { mean } => mean,
        };
        shape.write(log, mean, logs);
    }

    fn decode_value(
        &self,
        constants: &Constants,
        task: &TaskConstants,
        memory: &mut Memory,
    ) -> f32 {
        let (numbers, parts) = (self.parameters.numbers(), &constants.parts);
        let Memory { encoded, value: Valued { kept, stream, latent, .. }, .. } = memory;
        let encoded = (&encoded[..task.token_words.len()], task.tokens);
        let columns = task.value.queries.extent.columns;
        for (x, row) in stream.iter_mut().zip(task.value.stream.chunks_exact(columns)) {
            *x = row[0];
        }
        parts.value_decoder().forward_one(stream, encoded, kept, latent);
        let mut value = [0.0];
        parts.value_head.apply(numbers, latent, 1, &mut value);
        value[0]
    }

    /// `Σ u` of one sample's action.
    pub(super) fn total_spread(
        &self,
        constants: &Constants,
        sample: &Sample<'_>,
        memory: &mut Memory,
    ) -> f64 {
        let task = &constants.tasks[sample.task];
        self.encode(constants, task, sample.observation, memory);
        let entries = sample.action.len();
        self.decode_actions(constants, task, Deviations::OfObservation, entries, memory);
        memory.shape.total()
    }

    /// Adds one sample's derivatives to `sums`.
    pub(super) fn pull(
        &self,
        constants: &Constants,
        objective: &Objective,
        deviations: Deviations,
        sample: &Sample<'_>,
        memory: &mut Memory,
        sums: &mut [f32],
    ) -> Losses {
        let (task, entries) = (&constants.tasks[sample.task], sample.action.len());
        self.encode(constants, task, sample.observation, memory);
        self.decode_actions(constants, task, deviations, entries, memory);
        let value = self.decode_value(constants, task, memory);

        let log_slopes = &mut memory.log_slopes[..entries];
        log_slopes.fill(0.0);
        let mut value_slope = 0.0;
        let losses = objective.pull(
            sample,
            &Gaussian { log_deviations: &memory.log_deviations[..entries] },
            &memory.means[..entries],
            value,
            &mut memory.loss,
            &mut Slopes {
                mean: &mut memory.mean_slopes[..entries],
                own: log_slopes,
                value: &mut value_slope,
            },
        );

        let size = task.token_words.len();
        memory.encoded_slopes[..size].fill(0.0);
        self.pull_actions(constants, task, deviations, entries, memory, sums);
        if value_slope != 0.0 {
            self.pull_value(constants, task, value_slope, memory, sums);
        }
        let Memory { windows, stream, encoded_slopes, encoder, scratch, .. } = memory;
        let (parts, Extent { count, columns }) = (&constants.parts, task.tokens);
        // The stream has done its work; now it holds the derivatives by itself.
        let (encoded_slopes, slopes) = (&encoded_slopes[..size], &mut stream[..size]);
        parts.encoder.backward(encoded_slopes, task.tokens, encoder, scratch, slopes, sums);
        add(slopes, &mut sums[task.token_sums.clone()]);
        let windows = &windows[..self.settings.sizes.lags * columns];
        parts.tokenizer.pull_weight(windows, slopes, columns, count, scratch.weights(), sums);
        losses
    }

    fn pull_actions(
        &self,
        constants: &Constants,
        task: &TaskConstants,
        deviations: Deviations,
        entries: usize,
        memory: &mut Memory,
        sums: &mut [f32],
    ) {
        let (numbers, parts) = (self.parameters.numbers(), &constants.parts);
        let Memory {
            encoded, encoded_slopes, action, scratch, mean_slopes, log_slopes, shape, ..
        } = memory;
        let (columns, size) = (task.action.queries.extent.columns, task.action.stream.len());
        let last = task.action.queries.extent.count - 1;
        let (latent, log_slopes) = (&action.latent[..size], &log_slopes[..entries]);
        let head_slopes = &mut action.head_slopes[..columns];
        head_slopes.fill(0.0);
        for (i, &slope) in mean_slopes[..entries].iter().enumerate() {
            head_slopes[i.min(last)] += slope;
        }
        let slopes = &mut action.slopes[..size];
        parts.mean_head.pull_weight(latent, head_slopes, sums);
        parts.mean_head.pull_input(numbers, head_slopes, slopes);

        let total: f32 = log_slopes.iter().sum();
        sums[parts.log_deviation] += total;
        if let Some(head) = &parts.scale_head {
            let scale_slopes = &mut action.scale_slopes[..columns];
            scale_slopes.fill(0.0);
            let write = |i: usize, slope: f64| scale_slopes[i.min(last)] += slope as f32;
            match deviations {
                Deviations::OfObservation => shape.pull(log_slopes, write),
                Deviations::AroundMean { .. } => shape.pull_direct(log_slopes, write),
            }
            head.pull_weight(latent, scale_slopes, sums);
            if let Deviations::AroundMean { .. } = deviations {
                scale_slopes.fill(0.0);
                shape.pull_total(|i, slope| scale_slopes[i.min(last)] += slope as f32);
                let spread = &constants.spread;
                let bias = spread.end - 2;
                let through_mean = super::Head { weight: spread.start..bias, bias };
                through_mean.pull_weight(latent, scale_slopes, sums);
                sums[spread.end - 1] += total;
            }
        }
        let mut seen = Seen {
            memory: &encoded[..task.token_words.len()],
            slopes: &mut encoded_slopes[..task.token_words.len()],
            extent: task.tokens,
        };
        // As above: the queries' stream becomes the derivatives by itself.
        let stream_slopes = &mut action.stream[..size];
        parts.action_decoder.backward(
            slopes,
            task.action.queries,
            &mut seen,
            &action.kept,
            scratch,
            stream_slopes,
            sums,
        );
        add(stream_slopes, &mut sums[task.action.sums.clone()]);
    }

    fn pull_value(
        &self,
        constants: &Constants,
        task: &TaskConstants,
        slope: f32,
        memory: &mut Memory,
        sums: &mut [f32],
    ) {
        let (numbers, parts) = (self.parameters.numbers(), &constants.parts);
        let Memory { encoded, encoded_slopes, value, .. } = memory;
        let Valued { kept, stream, latent, slopes } = value;
        parts.value_head.pull_weight(latent, &[slope], sums);
        parts.value_head.pull_input(numbers, &[slope], slopes);
        let mut seen = Seen {
            memory: &encoded[..task.token_words.len()],
            slopes: &mut encoded_slopes[..task.token_words.len()],
            extent: task.tokens,
        };
        // As above: the query's stream becomes the derivatives by itself.
        parts.value_decoder().backward_one(slopes, &mut seen, kept, stream, sums);
        let columns = task.value.queries.extent.columns;
        let sums = sums[task.value.sums.clone()].chunks_exact_mut(columns);
        for (sums, slope) in sums.zip(&*stream) {
            sums[0] += slope;
        }
    }
}

fn decode(
    decoder: &super::Decoder,
    first: &First,
    encoded: (&[f32], Extent),
    decoded: &mut Decoded,
    scratch: &mut Scratch,
) {
    let size = first.stream.len();
    let Decoded { kept, stream, latent, .. } = decoded;
    let (stream, latent) = (&mut stream[..size], &mut latent[..size]);
    stream.copy_from_slice(&first.stream);
    decoder.forward(stream, first.queries, encoded, kept, scratch, latent);
}

/// A transformer at work. Standard deviations are those of one observation, whatever it is trained with.
pub(super) struct TransformerPlayer<'a> {
    network: &'a Transformer,
    constants: Constants,
    memory: Memory,
}

impl<'a> TransformerPlayer<'a> {
    pub(super) fn new(network: &'a Transformer) -> Self {
        Self { network, constants: Constants::new(network), memory: Memory::new(network) }
    }
}

impl Player for TransformerPlayer<'_> {
    fn decide(
        &mut self,
        task: usize,
        observation: &[f32],
        noise: &[f32],
        action: &mut [f32],
    ) -> Decision {
        let Self { network, constants, memory } = self;
        let (task, entries) = (&constants.tasks[task], action.len());
        network.encode(constants, task, observation, memory);
        network.decode_actions(constants, task, Deviations::OfObservation, entries, memory);
        let distribution = Gaussian { log_deviations: &memory.log_deviations[..entries] };
        let mean = &memory.means[..entries];
        distribution.draw(mean, noise, action);
        let log_probability = distribution.log_probability(mean, action) as f32;
        Decision { log_probability, value: network.decode_value(constants, task, memory) }
    }

    fn value(&mut self, task: usize, observation: &[f32]) -> f32 {
        let Self { network, constants, memory } = self;
        let task = &constants.tasks[task];
        network.encode(constants, task, observation, memory);
        network.decode_value(constants, task, memory)
    }
}

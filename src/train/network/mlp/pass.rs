//! The way of a shard through the perceptron, forward and back.

use super::Mlp;
use crate::train::distribution::{Distribution, Gaussian, Lattice, LatticeShape};
use crate::train::losses::{LossScratch, Objective, Slopes};
use crate::train::network::dense::StackMemory;
use crate::train::network::subspace::Subspace;
use crate::train::network::{Decision, Player};
use crate::train::shards::Sum;
use crate::train::{Losses, Sample};

/// What depends on the parameters alone.
pub(super) struct Constants<'a> {
    spread: Spread<'a>,
    subspace: Option<Subspace>,
}

enum Spread<'a> {
    Gaussian(Gaussian<'a>),
    Lattice(Lattice),
}

/// One thread's memory for a shard.
pub(super) struct Memory {
    x: Vec<f32>,
    policy: StackMemory,
    value_stack: StackMemory,
    /// Mean actions before the projection.
    raw: Vec<f32>,
    means: Vec<f32>,
    mean_slopes: Vec<f32>,
    values: Vec<f32>,
    value_slopes: Vec<f32>,
    latent_slopes: Vec<f32>,
    loss: LossScratch,
}

impl Mlp {
    /// What all samples share.
    pub(super) fn constants(&self) -> Constants<'_> {
        let numbers = self.parameters.numbers();
        let log_deviations = &numbers[self.log_deviations.clone()];
        let spread = if self.settings.lattice {
            let weight = &numbers[self.action.weight.clone()];
            let (muscles, log_scale) = (self.settings.muscles, self.settings.log_deviation);
            Spread::Lattice(Lattice::new(muscles, weight, log_deviations, log_scale))
        } else {
            Spread::Gaussian(Gaussian { log_deviations })
        };
        let subspace = self.subspace.as_ref().zip(self.settings.subspace).map(
            |([projection, mean], settings)| {
                let (projection, mean) = (&numbers[projection.clone()], &numbers[mean.clone()]);
                Subspace::new(projection, mean, settings.size)
            },
        );
        Constants { spread, subspace }
    }

    /// Lengths of what samples sum beside the parameters: the lattice's own numbers and the derivative by a projector.
    pub(super) fn extra_lengths(&self) -> [usize; 2] {
        let (muscles, latents) = (self.settings.muscles, self.action.inputs);
        let lattice = LatticeShape { muscles, latents };
        [
            if self.settings.lattice { lattice.own_length() } else { 0 },
            if self.subspace.is_some() { muscles * muscles } else { 0 },
        ]
    }

    pub(super) fn memory(&self, rows: usize) -> Memory {
        let latents = self.policy.outputs(self.input.width());
        let value_latents = self.value_stack.outputs(self.input.width());
        let actions = vec![0.0; rows * self.settings.muscles];
        Memory {
            x: vec![0.0; rows * self.input.width()],
            policy: self.policy.memory(rows),
            value_stack: self.value_stack.memory(rows),
            raw: actions.clone(),
            means: actions.clone(),
            mean_slopes: actions,
            values: vec![0.0; rows],
            value_slopes: vec![0.0; rows],
            latent_slopes: vec![0.0; rows * latents.max(value_latents)],
            loss: LossScratch::new(self.settings.muscles),
        }
    }

    fn forward(&self, constants: &Constants<'_>, rows: usize, memory: &mut Memory) {
        let numbers = self.parameters.numbers();
        let Memory { x, policy, value_stack, raw, means, values, .. } = memory;
        let x = &x[..rows * self.input.width()];
        let latent = self.policy.forward(numbers, x, rows, policy);
        let raw = &mut raw[..rows * self.settings.muscles];
        self.action.forward(numbers, latent, raw);
        let means = &mut means[..rows * self.settings.muscles];
        means.copy_from_slice(raw);
        if let Some(subspace) = &constants.subspace {
            means.chunks_exact_mut(self.settings.muscles).for_each(|mean| subspace.apply(mean));
        }
        let latent = self.value_stack.forward(numbers, x, rows, value_stack);
        self.value.forward(numbers, latent, &mut values[..rows]);
    }

    /// Adds one shard's derivatives to `sums`.
    pub(super) fn pull(
        &self,
        constants: &Constants<'_>,
        objective: &Objective,
        samples: &[Sample<'_>],
        memory: &mut Memory,
        sums: &mut [f32],
    ) -> Losses {
        let (rows, muscles) = (samples.len(), self.settings.muscles);
        for (row, sample) in memory.x.chunks_exact_mut(self.input.width()).zip(samples) {
            self.input.write(sample.task, sample.observation, row);
        }
        self.forward(constants, rows, memory);
        let (gradient, extra) = sums.split_at_mut(self.parameters.numbers().len());
        let (lattice, projector) = extra.split_at_mut(self.extra_lengths()[0]);

        let mut losses = Losses::default();
        for (row, sample) in samples.iter().enumerate() {
            let columns = row * muscles..(row + 1) * muscles;
            let mean = &memory.means[columns.clone()];
            let slopes = &mut memory.mean_slopes[columns.clone()];
            let own = match constants.spread {
                Spread::Gaussian(_) => &mut gradient[self.log_deviations.clone()],
                Spread::Lattice(_) => &mut *lattice,
            };
            let places = &mut Slopes { mean: slopes, own, value: &mut memory.value_slopes[row] };
            let (value, scratch) = (memory.values[row], &mut memory.loss);
            losses.add(&match &constants.spread {
                Spread::Gaussian(d) => objective.pull(sample, d, mean, value, scratch, places),
                Spread::Lattice(d) => objective.pull(sample, d, mean, value, scratch, places),
            });
            if let (Some(subspace), Some([_, mean])) = (&constants.subspace, &self.subspace) {
                let slopes = &mut memory.mean_slopes[columns.clone()];
                let (raw, mean_gradient) = (&memory.raw[columns], &mut gradient[mean.clone()]);
                subspace.pull(raw, slopes, projector, mean_gradient);
            }
        }
        let x = &memory.x[..rows * self.input.width()];
        for (stack, head, kept, slopes) in [
            (&self.policy, &self.action, &mut memory.policy, &memory.mean_slopes[..rows * muscles]),
            (&self.value_stack, &self.value, &mut memory.value_stack, &memory.value_slopes[..rows]),
        ] {
            let numbers = self.parameters.numbers();
            head.pull_weight(kept.latent(x, rows, stack), slopes, gradient);
            if !stack.layers.is_empty() {
                let latent_slopes = &mut memory.latent_slopes[..rows * head.inputs];
                head.pull_input(numbers, slopes, latent_slopes);
                stack.backward(numbers, x, rows, latent_slopes, kept, gradient);
            }
        }
        losses
    }

    /// Turns what the samples summed beside the parameters into derivatives by parameters.
    pub(super) fn finish(&self, constants: &Constants<'_>, sums: &mut [f32]) {
        let (gradient, extra) = sums.split_at_mut(self.parameters.numbers().len());
        let (lattice, projector) = extra.split_at_mut(self.extra_lengths()[0]);
        if let Spread::Lattice(distribution) = &constants.spread {
            // `log_std` comes before `action_net.weight`.
            let (before, from_weight) = gradient.split_at_mut(self.action.weight.start);
            let weight = &mut from_weight[..self.action.weight.len()];
            distribution.finish(lattice, weight, &mut before[self.log_deviations.clone()]);
        }
        if let (Some(subspace), Some([projection, mean])) = (&constants.subspace, &self.subspace) {
            subspace.finish(projector, &mut gradient[projection.clone()]);
            if self.settings.subspace.is_some_and(|subspace| !subspace.trainable) {
                gradient[projection.clone()].fill(0.0);
                gradient[mean.clone()].fill(0.0);
            }
        }
    }
}

/// A perceptron at work.
pub(super) struct MlpPlayer<'a> {
    network: &'a Mlp,
    constants: Constants<'a>,
    memory: Memory,
}

impl<'a> MlpPlayer<'a> {
    pub(super) fn new(network: &'a Mlp) -> Self {
        Self { network, constants: network.constants(), memory: network.memory(1) }
    }
}

impl Player for MlpPlayer<'_> {
    fn decide(
        &mut self,
        task: usize,
        observation: &[f32],
        noise: &[f32],
        action: &mut [f32],
    ) -> Decision {
        self.network.input.write(task, observation, &mut self.memory.x);
        self.network.forward(&self.constants, 1, &mut self.memory);
        let mean = &self.memory.means;
        let log_probability = match &self.constants.spread {
            Spread::Gaussian(distribution) => {
                distribution.draw(mean, noise, action);
                distribution.log_probability(mean, action)
            }
            Spread::Lattice(distribution) => {
                distribution.draw(mean, noise, action);
                distribution.log_probability(mean, action)
            }
        };
        Decision { log_probability: log_probability as f32, value: self.memory.values[0] }
    }

    fn value(&mut self, task: usize, observation: &[f32]) -> f32 {
        let Memory { x, value_stack, values, .. } = &mut self.memory;
        self.network.input.write(task, observation, x);
        let numbers = self.network.parameters.numbers();
        let latent = self.network.value_stack.forward(numbers, x, 1, value_stack);
        self.network.value.forward(numbers, latent, values);
        values[0]
    }
}

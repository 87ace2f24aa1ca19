//! Tests of derivatives by finite differences.
//!
//! For every tensor the loss is taken at four points along a direction, `(8(f(h) − f(−h)) − (f(2h) − f(−2h)))/12h`, and
//! compared with the gradient's component along it: its own direction and two random ones. What is tolerated is 10⁻⁴ of
//! the tensor's gradient, and what one rounding to single precision, of the loss or of the numbers about one that it
//! is a difference of, makes of a difference quotient.

use super::Trainable;
use crate::random::Random;
use crate::train::parameters::Place;
use crate::train::{Coefficients, ImitationLoss, Sample};

/// Largest relative difference that is tolerated.
const TOLERANCE: f64 = 1e-4;

/// Steps, in units of the one asked for, over which a difference quotient is averaged.
const SCALES: [f64; 6] = [0.75, 0.8, 0.85, 0.9, 0.95, 1.0];

/// Numbers that samples are made of.
pub(super) struct Batch {
    rows: Vec<Row>,
}

struct Row {
    task: usize,
    observation: Vec<f32>,
    action: Vec<f32>,
    expert_action: Vec<f32>,
    noise: Vec<f32>,
    old_log_probability: f32,
    advantage: f32,
    value_target: f32,
}

impl Batch {
    /// Random samples for `network`: `tasks` holds the length of the observation and the number of muscles of each task. The
    /// old log-probability is near the present one, and on either side of the clipping.
    pub(super) fn new(network: &dyn Trainable, tasks: &[[usize; 2]], count: usize) -> Self {
        let mut random = Random::new([5; 32]);
        let mut player = network.player();
        let rows = (0..count).map(|index| {
            let task = index % tasks.len();
            let [observation, muscles] = tasks[task];
            let mut normal =
                |n: usize| -> Vec<f32> { (0..n).map(|_| random.normal() as f32).collect() };
            let observation = normal(observation);
            let mut action = vec![0.0; network.action_length(task)];
            let noise = normal(network.noise_length(task));
            let decision = player.decide(task, &observation, &noise, &mut action);
            // ρ = exp(−shift): near 1, or out of range on either side.
            let shift = match index % 8 {
                3 => 0.6,
                7 => -0.6,
                _ => 0.1 * normal(1)[0].tanh(),
            };
            Row {
                task,
                expert_action: normal(muscles),
                noise: normal(network.noise_length(task)),
                old_log_probability: decision.log_probability + shift,
                advantage: normal(1)[0] + 0.3,
                value_target: decision.value + 1.0,
                observation,
                action,
            }
        });
        Self { rows: rows.collect() }
    }

    pub(super) fn samples(&self) -> Vec<Sample<'_>> {
        self.rows.iter().map(Row::sample).collect()
    }
}

impl Row {
    fn sample(&self) -> Sample<'_> {
        Sample {
            task: self.task,
            observation: &self.observation,
            action: &self.action,
            old_log_probability: self.old_log_probability,
            advantage: self.advantage,
            value_target: self.value_target,
            expert_action: &self.expert_action,
            noise: &self.noise,
        }
    }
}

/// One combination for every loss: by name, with coefficients that make its gradient large.
pub(super) fn every_loss() -> Vec<(&'static str, Coefficients)> {
    let none = Coefficients {
        policy_gradient: 0.0,
        entropy: 0.0,
        value: 0.0,
        imitation: 0.0,
        ..Coefficients::default()
    };
    let imitation = |imitation_loss, imitation| Coefficients { imitation, imitation_loss, ..none };
    vec![
        ("policy gradient", Coefficients { policy_gradient: 1.0, ..none }),
        ("entropy", Coefficients { entropy: 0.1, ..none }),
        ("value", Coefficients { value: 0.5, ..none }),
        ("imitation, mean", imitation(ImitationLoss::SquaredPerSample, 0.1)),
        ("imitation, constant", imitation(ImitationLoss::SquaredOverAll, 1.0)),
        ("imitation, excitation", imitation(ImitationLoss::Excitation, 0.1)),
        ("imitation, density", imitation(ImitationLoss::NegativeLogProbability, 0.05)),
        ("all", every_loss_at_once()),
    ]
}

/// All terms together, every one with its own weight.
pub(super) fn every_loss_at_once() -> Coefficients {
    Coefficients {
        policy_gradient: 0.7,
        entropy: 0.01,
        value: 0.5,
        imitation: 0.1,
        standardise_advantages: false,
        ..Coefficients::default()
    }
}

/// Compares the gradient of every tensor whose name `is_compared` with finite differences of the loss, `step` apart.
pub(super) fn compare(
    network: &mut dyn Trainable,
    tasks: &[[usize; 2]],
    losses: &[(&str, Coefficients)],
    is_compared: impl Fn(&str) -> bool,
    step: f64,
) {
    let batch = Batch::new(network, tasks, 12);
    let samples = batch.samples();
    let mut random = Random::new([6; 32]);
    let mut moved = 0;
    for (name, coefficients) in losses {
        let mut gradient = Vec::new();
        network.gradient(&samples, coefficients, 1, &mut gradient).unwrap();
        let mut places = network.parameters().places().to_vec();
        places.retain(|place| is_compared(&place.name));
        let start = network.parameters().numbers().to_vec();
        moved += compare_tensors(name, &places, &start, &gradient, step, &mut random, &mut |n| {
            network.parameters_mut().numbers_mut().copy_from_slice(n);
            network.gradient(&samples, coefficients, 1, &mut Vec::new()).unwrap().total
        });
        network.parameters_mut().numbers_mut().copy_from_slice(&start);
    }
    assert!(moved > 0, "every gradient was negligible");
}

/// Compares `gradient` in some tensors with finite differences of `loss`, which is a function of all numbers. Returns how many
/// comparisons were of more than a negligible gradient.
pub(super) fn compare_tensors(
    name: &str,
    places: &[Place],
    start: &[f32],
    gradient: &[f32],
    step: f64,
    random: &mut Random,
    loss: &mut dyn FnMut(&[f32]) -> f64,
) -> usize {
    let mut moved = 0;
    let total = loss(start);
    let rounding = f64::from(f32::EPSILON) * total.abs().max(1.0) / step;
    for place in places {
        let slopes = &gradient[place.range.clone()];
        let norm = slopes.iter().map(|&g| f64::from(g).powi(2)).sum::<f64>().sqrt();
        for kind in 0..3 {
            let mut direction: Vec<f64> = match kind {
                0 if norm > 0.0 => slopes.iter().map(|&g| f64::from(g)).collect(),
                _ => slopes.iter().map(|_| random.normal()).collect(),
            };
            let length = direction.iter().map(|d| d * d).sum::<f64>().sqrt();
            direction.iter_mut().for_each(|d| *d /= length);
            let along: f64 = slopes.iter().zip(&direction).map(|(&g, d)| f64::from(g) * d).sum();
            // What was really moved, after rounding, along the direction.
            let mut at = |far: f64| {
                let mut numbers = start.to_vec();
                for (x, d) in numbers[place.range.clone()].iter_mut().zip(&direction) {
                    *x = (f64::from(*x) + far * d) as f32;
                }
                loss(&numbers)
            };
            let mut quotient = |step: f64| {
                let near = at(step) - at(-step);
                let far = at(2.0 * step) - at(-2.0 * step);
                (8.0 * near - far) / (12.0 * step)
            };
            // Roundings differ from step to step, the derivative does not.
            let difference = SCALES.map(|scale| quotient(scale * step)).iter().sum::<f64>()
                / SCALES.len() as f64;
            let error = (difference - along).abs();
            assert!(
                error <= TOLERANCE * norm + rounding,
                "{name}, `{}`, direction {kind}: {along} by the gradient of norm {norm}, \
                 {difference} by differences",
                place.name
            );
            moved += usize::from(norm > 1e-2);
        }
    }
    moved
}

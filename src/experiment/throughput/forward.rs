//! The forward pass of the muscle transformer against what this machine's matrix product can do.
//!
//! The ceiling is the best rate of square single-precision products of three sizes on one core. A network's rate counts the
//! multiplications and additions of its matrix products only; what it spends on normalisation, softmax and rectifiers shows as
//! distance from the ceiling. The time does not depend on the values of the weights, so they are made up.

use std::hint::black_box;
use std::time::Duration;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};
use serde::Serialize;

use crate::policy::checkpoint::contents::{SignatureStatistics, Tensor, TensorMap};
use crate::policy::network::Sizes;
use crate::policy::network::transformer::Transformer;
use crate::policy::policies::transformer::TransformerPolicy;
use crate::policy::{Policy, PolicyError, TaskInterface};

use super::best_time;

/// A published network by name (`spec/policy.md` §1.12).
#[derive(Debug, Clone, Copy)]
pub struct Network {
    /// `full`, `m`, `s` or `xs`.
    pub name: &'static str,
    /// Its sizes.
    pub sizes: Sizes,
}

const fn network(
    name: &'static str,
    width: usize,
    layers: usize,
    heads: usize,
    feed_forward: usize,
) -> Network {
    let (encoder_layers, decoder_layers) = (layers, layers);
    let (vocabulary, lags) = (214, 6);
    let sizes =
        Sizes { vocabulary, lags, width, heads, feed_forward, encoder_layers, decoder_layers };
    Network { name, sizes }
}

/// The published networks, largest first.
pub const NETWORKS: [Network; 4] = [
    network("full", 128, 6, 4, 512),
    network("m", 64, 3, 4, 512),
    network("s", 32, 3, 2, 512),
    network("xs", 16, 3, 2, 256),
];

/// A body as the transformer sees it.
#[derive(Debug, Clone, Copy)]
pub struct Body {
    /// `hand`, `arm` or `legs`.
    pub name: &'static str,
    /// Tokens.
    pub sensors: usize,
    /// Queries.
    pub muscles: usize,
}

/// The bodies of the paper's tasks, the hand as the finger reaches see it.
pub const BODIES: [Body; 3] = [
    Body { name: "hand", sensors: 211, muscles: 39 },
    Body { name: "arm", sensors: 340, muscles: 63 },
    Body { name: "legs", sensors: 388, muscles: 80 },
];

/// Rates of square products, 10⁹ operations per second, on one core.
#[derive(Debug, Clone, Serialize)]
pub struct Ceiling {
    /// Edge of the square and its rate.
    pub rates: Vec<(usize, f64)>,
}

impl Ceiling {
    /// Spends `budget` on each size.
    #[must_use]
    pub fn measure(budget: Duration) -> Self {
        Self { rates: [256, 512, 1024].map(|size| (size, product_rate(size, budget))).to_vec() }
    }

    /// The highest rate.
    #[must_use]
    pub fn best(&self) -> f64 {
        self.rates.iter().map(|(_, rate)| *rate).fold(0.0, f64::max)
    }
}

/// One measured forward pass.
#[derive(Debug, Clone, Serialize)]
pub struct ForwardRow {
    /// Network.
    pub network: &'static str,
    /// Body.
    pub body: &'static str,
    /// Observations per call.
    pub batch: usize,
    /// Time per observation, ms.
    pub milliseconds: f64,
    /// Rate of arithmetic in matrix products, 10⁹ operations per second.
    pub gigaflops: f64,
}

/// Best rate of a square product within `budget`, in 10⁹ operations per second.
fn product_rate(size: usize, budget: Duration) -> f64 {
    let left = Mat::from_fn(size, size, |i, j| ((i * 7 + j * 3) % 11) as f32 - 5.0);
    let right = Mat::from_fn(size, size, |i, j| ((i * 5 + j * 2) % 13) as f32 - 6.0);
    let mut product = Mat::zeros(size, size);
    let best = best_time(budget, || {
        matmul(product.as_mut(), Accum::Replace, left.as_ref(), right.as_ref(), 1.0_f32, Par::Seq);
        black_box(&product);
    });
    2.0 * (size as f64).powi(3) / best / 1e9
}

/// Times `network` on `body` with `batch` observations per call.
pub fn measure(
    network: &Network,
    body: &Body,
    batch: usize,
    budget: Duration,
) -> Result<ForwardRow, PolicyError> {
    let policy = made_up_policy(&network.sizes)?;
    let seconds = seconds_per_observation(&policy, &interface(body), batch, budget)?;
    let gigaflops = operations(&network.sizes, body) / seconds / 1e9;
    let (network, body) = (network.name, body.name);
    Ok(ForwardRow { network, body, batch, milliseconds: 1e3 * seconds, gigaflops })
}

/// Best time of one observation's action means, s.
pub fn seconds_per_observation(
    policy: &dyn Policy,
    task: &TaskInterface,
    batch: usize,
    budget: Duration,
) -> Result<f64, PolicyError> {
    let mut actor = policy.bind(task, batch)?;
    let slots: Vec<usize> = (0..batch).collect();
    let length = batch * task.muscle_observation_length;
    let observations: Vec<f32> = (0..length).map(|i| (i as f32 * 0.37).sin()).collect();
    let mut means = vec![0.0; batch * task.muscle_count];
    let best = best_time(budget, || {
        actor.act(&slots, black_box(&observations), &mut means, None);
        black_box(&means);
    });
    Ok(best / batch as f64)
}

/// A task with as many sensors and muscles as `body`, described by two words each.
fn interface(body: &Body) -> TaskInterface {
    let words = |count: usize| (0..count).map(|i| vec![2 + (i % 200) as u16, 129]).collect();
    TaskInterface {
        task: body.name.to_owned(),
        muscle_count: body.muscles,
        muscle_observation_length: body.sensors,
        clean_observation_length: 0,
        observation_words: words(body.sensors),
        action_words: words(body.muscles),
        muscle_models: Vec::new(),
    }
}

/// A transformer of these sizes whose weights come from a formula and whose normaliser changes nothing.
pub fn made_up_policy(sizes: &Sizes) -> Result<TransformerPolicy, PolicyError> {
    let shapes = sizes.tensor_shapes().into_iter().enumerate();
    let tensors: TensorMap = shapes
        .map(|(seed, (name, shape))| {
            let count: usize = shape.iter().product();
            let data = (0..count).map(|i| 0.05 * (i as f32 * 0.61 + seed as f32).sin()).collect();
            (name, Tensor { shape, data })
        })
        .collect();
    let network = Transformer::from_tensors(&tensors, sizes.heads, true)?;
    let lags = sizes.lags;
    let statistics = SignatureStatistics {
        signatures: vec![vec![0]],
        mean: vec![0.0; lags],
        variance: vec![1.0; lags],
        count: vec![1.0],
        lags,
        epsilon: 1e-8,
        clip: 10.0,
        enabled: true,
    };
    TransformerPolicy::new(network, statistics)
}

/// Multiplications and additions in the matrix products of one action (`spec/policy.md` §1.4 to §1.8), without the
/// first decoder layer's self-attention, which is constant for a task.
#[must_use]
pub fn operations(sizes: &Sizes, body: &Body) -> f64 {
    let [n, a] = [body.sensors as f64, body.muscles as f64];
    let [d, f, lags] = [sizes.width as f64, sizes.feed_forward as f64, sizes.lags as f64];
    let feed_forward = |rows: f64| 4.0 * rows * d * f;
    let self_attention = |rows: f64| 8.0 * rows * d * d + 4.0 * rows * rows * d;
    let cross_attention = 4.0 * a * d * d + 4.0 * n * d * d + 4.0 * a * n * d;
    let layers = sizes.encoder_layers as f64 * (self_attention(n) + feed_forward(n))
        + sizes.decoder_layers as f64 * (self_attention(a) + cross_attention + feed_forward(a));
    2.0 * n * lags * d + layers - self_attention(a)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_published_networks_have_their_published_number_of_parameters() {
        // Distinct parameters of `spec/policy.md` §1.12, plus the second name of the decoders' shared last norm.
        let distinct = [4_393_732, 862_276, 372_004, 96_916];
        for (network, distinct) in NETWORKS.iter().zip(distinct) {
            let count: usize = network
                .sizes
                .tensor_shapes()
                .iter()
                .map(|(_, s)| s.iter().product::<usize>())
                .sum();
            assert_eq!(count, distinct + 2 * network.sizes.width, "{}", network.name);
        }
    }

    #[test]
    fn one_hand_action_of_the_full_network_costs_some_850_million_operations() {
        let operations = operations(&NETWORKS[0].sizes, &BODIES[0]);
        assert!((0.8e9..0.9e9).contains(&operations), "{operations}");
    }
}

//! How fast a policy acts, against what this machine's matrix product can do.
//!
//! Prints the best single-precision rates of square products on one core (the highest is the ceiling), then, for the small and
//! the full muscle transformer, the hand (211 sensors, 39 muscles) and the legs (388, 80), and batches of 1 and 16:
//! milliseconds per observation, the rate of arithmetic in matrix products, and its share of the ceiling.
//!
//! Weights come from the recorded checkpoints (`$ARNOLD_GOLDEN/policy`) if they are there, else from a formula; the time
//! does not depend on them. `cargo bench --bench policy -- --quick` takes seconds.

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use arnold_analyze::policy::checkpoint::contents::{SignatureStatistics, Tensor, TensorMap};
use arnold_analyze::policy::checkpoint::{self, Limits};
use arnold_analyze::policy::network::Sizes;
use arnold_analyze::policy::network::transformer::Transformer;
use arnold_analyze::policy::policies::transformer::TransformerPolicy;
use arnold_analyze::policy::{Policy, TaskInterface};
use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, Par};

/// The published networks by name; `heads` is the only size that a checkpoint's tensors do not tell.
const NETWORKS: [(&str, Sizes); 2] = [
    (
        "xs",
        Sizes {
            vocabulary: 214,
            lags: 6,
            width: 16,
            heads: 2,
            feed_forward: 256,
            encoder_layers: 3,
            decoder_layers: 3,
        },
    ),
    (
        "full",
        Sizes {
            vocabulary: 214,
            lags: 6,
            width: 128,
            heads: 4,
            feed_forward: 512,
            encoder_layers: 6,
            decoder_layers: 6,
        },
    ),
];

/// Bodies: name, sensors, muscles.
const BODIES: [(&str, usize, usize); 2] = [("hand", 211, 39), ("leg", 388, 80)];

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let budget = Duration::from_millis(if quick { 100 } else { 2000 });
    let rates = [256, 512, 1024].map(|size| product_rate(size, budget));
    let ceiling = rates.into_iter().fold(0.0, f64::max);
    let [small, middle, large] = rates;
    println!(
        "square matrix product, f32, one core: {small:.1} GFLOP/s at 256, {middle:.1} at 512, {large:.1} at 1024"
    );
    println!("network  body  batch  weights   ms/observation  GFLOP/s  share of ceiling");
    for (name, sizes) in &NETWORKS {
        let (tensors, origin) = weights(name, sizes);
        let network = Transformer::from_tensors(&tensors, sizes.heads, true)
            .expect("the weights have the sizes of the network");
        assert_eq!(network.sizes(), sizes, "the checkpoint holds another network");
        let policy = TransformerPolicy::new(network, statistics(sizes.lags))
            .expect("the statistics fit the network");
        for (body, sensors, muscles) in BODIES {
            for batch in [1, 16] {
                let seconds = seconds_per_observation(&policy, sensors, muscles, batch, budget);
                let rate = operations(sizes, sensors, muscles) / seconds / 1e9;
                println!(
                    "{name:7}  {body:4}  {batch:5}  {origin:8}  {:14.3}  {rate:7.1}  {:14.0} %",
                    seconds * 1e3,
                    100.0 * rate / ceiling
                );
            }
        }
    }
}

/// Best rate of a square product of this size within `budget`, in 10⁹ operations per second.
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

fn seconds_per_observation(
    policy: &dyn Policy,
    sensors: usize,
    muscles: usize,
    batch: usize,
    budget: Duration,
) -> f64 {
    let task = TaskInterface {
        task: "benchmark".to_owned(),
        muscle_count: muscles,
        muscle_observation_length: sensors,
        clean_observation_length: 0,
        observation_words: (0..sensors).map(|i| vec![2 + (i % 200) as u16, 129]).collect(),
        action_words: (0..muscles).map(|i| vec![2 + (i % 200) as u16]).collect(),
    };
    let mut actor = policy.bind(&task, batch).expect("the words are in the vocabulary");
    let slots: Vec<usize> = (0..batch).collect();
    let observations: Vec<f32> = (0..batch * sensors).map(|i| (i as f32 * 0.37).sin()).collect();
    let mut means = vec![0.0; batch * muscles];
    let best = best_time(budget, || {
        actor.act(&slots, black_box(&observations), &mut means, None);
        black_box(&means);
    });
    best / batch as f64
}

/// Shortest time of `work` in seconds; runs it at least twice and until `budget` is spent.
fn best_time(budget: Duration, mut work: impl FnMut()) -> f64 {
    work();
    let start = Instant::now();
    let mut best = Duration::MAX;
    while start.elapsed() < budget || best == Duration::MAX {
        let begin = Instant::now();
        work();
        best = best.min(begin.elapsed());
    }
    best.as_secs_f64()
}

/// Multiplications and additions in the matrix products of one action (`spec/policy.md` §1.4 to §1.8), without the
/// first decoder layer's self-attention, which is constant for a task.
fn operations(sizes: &Sizes, sensors: usize, muscles: usize) -> f64 {
    let [n, a] = [sensors as f64, muscles as f64];
    let [d, f, lags] = [sizes.width as f64, sizes.feed_forward as f64, sizes.lags as f64];
    let feed_forward = |rows: f64| 4.0 * rows * d * f;
    let self_attention = |rows: f64| 8.0 * rows * d * d + 4.0 * rows * rows * d;
    let cross_attention = 4.0 * a * d * d + 4.0 * n * d * d + 4.0 * a * n * d;
    let layers = sizes.encoder_layers as f64 * (self_attention(n) + feed_forward(n))
        + sizes.decoder_layers as f64 * (self_attention(a) + cross_attention + feed_forward(a));
    2.0 * n * lags * d + layers - self_attention(a)
}

fn statistics(lags: usize) -> SignatureStatistics {
    SignatureStatistics {
        signatures: vec![vec![0]],
        mean: vec![0.0; lags],
        variance: vec![1.0; lags],
        count: vec![1.0],
        lags,
        epsilon: 1e-8,
        clip: 10.0,
        enabled: true,
    }
}

/// The recorded checkpoint's tensors, or made-up ones of the same sizes.
fn weights(name: &str, sizes: &Sizes) -> (TensorMap, &'static str) {
    let root = std::env::var_os("ARNOLD_GOLDEN").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/golden"),
        PathBuf::from,
    );
    let path = root.join("policy").join(format!("{name}_model.zip"));
    match checkpoint::open(&path, &Limits::default()) {
        Ok(checkpoint) => (checkpoint.tensors, "recorded"),
        Err(_) => (made_up_weights(sizes), "made up"),
    }
}

fn made_up_weights(sizes: &Sizes) -> TensorMap {
    let shapes = sizes.tensor_shapes().into_iter().enumerate();
    shapes
        .map(|(seed, (name, shape))| {
            let count: usize = shape.iter().product();
            let data = (0..count).map(|i| 0.05 * (i as f32 * 0.61 + seed as f32).sin()).collect();
            (name, Tensor { shape, data })
        })
        .collect()
}

//! One training step of the smallest and the full transformer on a hand task: forward, backward, gradient clipping, Adam, in
//! minibatches of 128. With `$PYTHON` set to a Python that has `torch`, the same step in PyTorch
//! (`scripts/peers/training.py`) on as many threads, in the same run. `cargo bench --bench training -- --quick` takes
//! seconds; `--threads N` sets the threads (else 2).

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]
#![expect(clippy::unwrap_used, reason = "a benchmark may fail")]

use std::process::Command;
use std::time::{Duration, Instant};

use arnold_analyze::policy::network::Sizes;
use arnold_analyze::random::Random;
use arnold_analyze::train::adam::{Adam, AdamSettings};
use arnold_analyze::train::network::transformer::{TaskWords, Transformer, TransformerSettings};
use arnold_analyze::train::{Coefficients, Sample, Trainable};
use serde_json::{Value, json};

const SENSORS: usize = 211;
const MUSCLES: usize = 39;
const BATCH: usize = 128;

/// Name, width, heads, feed-forward width, layers.
const NETWORKS: [(&str, usize, usize, usize, usize); 2] =
    [("xs", 16, 2, 256, 3), ("full", 128, 4, 512, 6)];

fn main() {
    let arguments: Vec<String> = std::env::args().collect();
    let quick = arguments.iter().any(|argument| argument == "--quick");
    let threads = arguments.iter().position(|argument| argument == "--threads");
    let threads = threads.map_or(2, |position| arguments[position + 1].parse().unwrap());
    let budget = Duration::from_secs(if quick { 1 } else { 15 });
    let peer = std::env::var("PYTHON").ok().and_then(|python| peer(&python, threads, budget));
    for (index, (name, ..)) in NETWORKS.iter().enumerate() {
        let ours = measure(index, threads, budget);
        let theirs =
            peer.as_ref().and_then(|peer| peer["rows"][index]["samples_per_second"].as_f64());
        match theirs {
            Some(theirs) => println!(
                "{name:4}: {ours:7.1} samples/s, PyTorch {theirs:6.1}: {:.2} times as many",
                ours / theirs
            ),
            None => println!("{name:4}: {ours:7.1} samples/s"),
        }
    }
}

fn sizes(index: usize) -> Sizes {
    let (_, width, heads, feed_forward, layers) = NETWORKS[index];
    let (encoder_layers, decoder_layers) = (layers, layers);
    Sizes { vocabulary: 214, lags: 6, width, heads, feed_forward, encoder_layers, decoder_layers }
}

/// Four words for each sensor, three for each muscle.
fn words() -> TaskWords {
    let describe = |count: usize, words: usize| -> Vec<Vec<u16>> {
        let word = |i: usize, k: usize| 2 + ((i * 7 + k * 31) % 212) as u16;
        (0..count).map(|i| (0..words).map(|k| word(i, k)).collect()).collect()
    };
    TaskWords {
        task: "hand".to_owned(),
        sensors: describe(SENSORS, 4),
        muscles: describe(MUSCLES, 3),
        action_length: MUSCLES,
    }
}

/// Samples per second of the best step.
fn measure(index: usize, threads: usize, budget: Duration) -> f64 {
    let mut random = Random::new([1; 32]);
    let settings = TransformerSettings::published(sizes(index));
    let mut network = Transformer::new(settings, vec![words()], &mut random).unwrap();
    let mut normal =
        |count: usize| -> Vec<f32> { (0..count).map(|_| random.normal() as f32).collect() };
    let rows: Vec<[Vec<f32>; 4]> = (0..BATCH)
        .map(|_| [normal(SENSORS * 6), normal(MUSCLES), normal(MUSCLES), normal(MUSCLES)])
        .collect();
    let samples: Vec<Sample<'_>> = rows
        .iter()
        .enumerate()
        .map(|(i, [observation, action, expert_action, noise])| Sample {
            task: 0,
            observation,
            action,
            old_log_probability: -2.0 * MUSCLES as f32,
            advantage: (i as f32).sin(),
            value_target: (i as f32).cos(),
            expert_action,
            noise,
        })
        .collect();
    let coefficients = Coefficients { imitation: 1.0, ..Coefficients::default() };
    let mut adam = Adam::new(AdamSettings::default(), network.parameters());
    let mut gradient = Vec::new();
    let (mut best, start) = (f64::INFINITY, Instant::now());
    while start.elapsed() < budget || best.is_infinite() {
        let begin = Instant::now();
        network.gradient(&samples, &coefficients, threads, &mut gradient).unwrap();
        adam.step(network.parameters_mut(), &gradient, 1e-4, Some(0.7)).unwrap();
        best = best.min(begin.elapsed().as_secs_f64());
    }
    BATCH as f64 / best
}

/// What PyTorch does, if `python` has it.
fn peer(python: &str, threads: usize, budget: Duration) -> Option<Value> {
    let networks: Vec<Value> = NETWORKS
        .iter()
        .map(|(name, width, heads, feed_forward, layers)| {
            json!({
                "name": name, "width": width, "heads": heads, "feed_forward": feed_forward,
                "layers": layers, "lags": 6, "vocabulary": 214,
            })
        })
        .collect();
    let words = words();
    let question = json!({
        "networks": networks,
        "body": {"sensors": words.sensors, "muscles": words.muscles},
        "batch": BATCH, "threads": threads, "seconds": budget.as_secs_f64(),
    });
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/peers/training.py");
    let output = Command::new(python).arg(script).arg(question.to_string()).output().unwrap();
    let answer = serde_json::from_slice(&output.stdout).ok();
    if answer.is_none() {
        println!("no answer from PyTorch: {}", String::from_utf8_lossy(&output.stderr));
    }
    answer
}

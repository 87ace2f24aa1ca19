//! A walking expert of full size, with invented weights, plays the walking task from its file to the recording: 309
//! numbers in, wished lengths of 80 muscles out, inverted by the muscles of the body itself.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures", feature = "hdf5"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::Path;

use arnold_analyze::record::{names, read_recording};
use common::bench::{Bench, files_below};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use safetensors::tensor::{Dtype, TensorView};

const OBSERVATIONS: usize = 309;
const MUSCLES: usize = 80;

/// Bare weights of a walking expert, small and different in every muscle.
fn expert() -> Vec<u8> {
    let mut noise = ChaCha8Rng::seed_from_u64(3);
    let mut between = |count: usize, low: f32, high: f32| -> Vec<u8> {
        let uniform = |bits: u32| low + (high - low) * (bits as f32 / u32::MAX as f32);
        (0..count).flat_map(|_| uniform(noise.next_u32()).to_le_bytes()).collect()
    };
    let hidden = 16;
    let arrays = [
        ("norm.n", vec![1], 1000.0_f32.to_le_bytes().to_vec()),
        ("norm.mean", vec![OBSERVATIONS], between(OBSERVATIONS, -0.1, 0.1)),
        ("norm.std", vec![OBSERVATIONS], between(OBSERVATIONS, 0.5, 2.0)),
        (
            "net.affine_layers.0.weight",
            vec![hidden, OBSERVATIONS],
            between(hidden * OBSERVATIONS, -0.1, 0.1),
        ),
        ("net.affine_layers.0.bias", vec![hidden], between(hidden, -0.1, 0.1)),
        ("action_mean.weight", vec![MUSCLES, hidden], between(MUSCLES * hidden, -0.2, 0.2)),
        ("action_mean.bias", vec![MUSCLES], between(MUSCLES, -0.3, 0.9)),
    ];
    let views = arrays.iter().map(|(name, shape, bytes)| {
        (*name, TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap())
    });
    safetensors::tensor::serialize(views, None).unwrap()
}

/// The folder with the walking body, if it is here.
fn walking_body() -> Option<String> {
    let data = common::data_folder();
    if data.join("kinesis/xml/myolegs_onlylegs.xml").is_file() {
        return Some(data.display().to_string());
    }
    eprintln!("skipped: no walking body in `{}`", data.display());
    None
}

#[test]
fn a_walking_expert_plays_from_its_file_to_the_recording() {
    let Some(data) = walking_body() else { return };
    let bench = Bench::new();
    let expert = bench.write("expert.safetensors", &expert()).display().to_string();
    let rolled = |out: &str, batch: &str| {
        let words = [
            "rollout",
            "--policy",
            &expert,
            "--task",
            "kinesis",
            "--episodes",
            "3",
            "--data",
            &data,
            "--batch",
            batch,
            "--out",
            out,
            "--quiet",
        ];
        let ended = bench.run(&words);
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        let mut files = files_below(&bench.path(out));
        files.retain(|name, _| !name.ends_with("manifest.json"));
        files
    };
    let alone = rolled("alone", "1");
    assert!(alone == rolled("together", "3"), "neighbours change an episode");

    let recording = alone.keys().find(|name| name.ends_with("kinesis.parquet")).unwrap();
    let recording = read_recording(&bench.path("alone").join(recording)).unwrap().recording;
    let (mut lowest, mut highest) = (f64::INFINITY, f64::NEG_INFINITY);
    for episode in &recording.episodes {
        let actions = recording.samples(episode, names::ACTION).unwrap();
        assert!(actions.len() > MUSCLES, "only one step");
        for action in actions.values() {
            assert!(action.is_finite());
            (lowest, highest) = (lowest.min(action), highest.max(action));
        }
    }
    assert!(lowest < -0.9 && highest > 0.9, "actions from {lowest} to {highest}");
}

#[test]
fn the_emg_of_an_expert_that_falls_says_that_it_made_no_steps() {
    let Some(data) = walking_body() else { return };
    let bench = Bench::new();
    let expert = bench.write("expert.safetensors", &expert()).display().to_string();
    let people = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/emg").display().to_string();
    let words = [
        "emg",
        "--subjects",
        &people,
        "--policy",
        &expert,
        "--task",
        "kinesis_forward",
        "--episodes",
        "1",
        "--data",
        &data,
        "--quiet",
    ];
    let ended = bench.run(&words);
    assert!(ended.stderr.contains("cycle"), "{}", ended.stderr);
}

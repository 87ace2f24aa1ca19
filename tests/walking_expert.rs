//! A walking expert of full size, with invented weights, plays the walking task from its file to the recording: 309
//! numbers in, wished lengths of 80 muscles out, inverted by the muscles of the body itself.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures", feature = "hdf5"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeMap;
use std::path::Path;

use arnold_analyze::record::{names, read_recording};
use common::bench::{Bench, files_below};
use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};
use safetensors::tensor::{Dtype, TensorView};
use serde_json::Value;

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

/// An expert that falls, but with a step forward on the way: `scripts/make_stumbling_expert.py`.
const STUMBLING: &str =
    concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/walking/stumbling_expert.safetensors");

/// What makes it stumble: ten episodes that differ by noise.
fn stumble(data: &str) -> [&str; 11] {
    [
        "--policy",
        STUMBLING,
        "--task",
        "kinesis_forward",
        "--episodes",
        "10",
        "--action-noise",
        "0.3",
        "--deterministic",
        "--data",
        data,
    ]
}

/// Everything that a run in `folder` of the bench wrote and that does not say how the walk was come by: the manifest does,
/// and so does the head of a Parquet table, beside which the same table lies as text.
fn found(bench: &Bench, folder: &str) -> BTreeMap<String, Vec<u8>> {
    let files = files_below(&bench.path(folder)).into_iter();
    files
        .filter_map(|(path, bytes)| Some((path.split_once('/')?.1.to_owned(), bytes)))
        .filter(|(name, _)| !name.ends_with(".parquet") && name != "manifest.json")
        .collect()
}

#[test]
fn a_walk_that_is_played_gives_what_its_recording_gives() {
    let Some(data) = walking_body() else { return };
    let bench = Bench::new();
    let run = |words: &[&[&str]]| {
        let ended = bench.run(&[&words.concat()[..], &["--quiet"]].concat());
        assert_eq!(ended.code, 0, "{}", ended.stderr);
    };
    let play = stumble(&data);
    run(&[&["rollout", "--out", "rolled"], &play]);
    let rolled = files_below(&bench.path("rolled"));
    let recording = rolled.keys().find(|name| name.ends_with(".parquet")).unwrap();
    let recording = format!("stumbling_expert=rolled/{recording}");
    let recorded = ["--recording", &recording];

    let people = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/emg").display().to_string();
    let emg = ["emg", "--subjects", &people, "--contact-threshold", "1", "--out"];
    run(&[&emg, &["emg_played"], &play]);
    run(&[&emg, &["emg_recorded"], &recorded]);
    let played = found(&bench, "emg_played");
    assert!(played == found(&bench, "emg_recorded"), "playing gives other muscles");
    let cycles = String::from_utf8_lossy(&played["gait_cycles.csv"]);
    assert!(cycles.lines().any(|line| line.contains(",true,")), "{cycles}");

    let factors = ["factors", "--side", "left", "--contact-threshold", "1", "--out"];
    run(&[&factors, &["factors_played"], &play]);
    run(&[&factors, &["factors_recorded"], &recorded]);
    let played = found(&bench, "factors_played");
    assert!(played.contains_key("loadings.csv"));
    assert!(played == found(&bench, "factors_recorded"), "playing gives other factors");
}

#[test]
fn a_policy_without_a_step_is_told_so_and_is_a_result_where_that_is_allowed() {
    let Some(data) = walking_body() else { return };
    let bench = Bench::new();
    let people = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/emg").display().to_string();
    let play = stumble(&data);
    // Nobody is so heavy.
    let emg = ["emg", "--subjects", &people, "--contact-threshold", "100000"];
    let factors = ["factors", "--contact-threshold", "100000"];
    for command in [&emg[..], &factors] {
        let ended = bench.run(&[command, &play].concat());
        assert_eq!((ended.code, ended.stdout.as_str()), (1, ""), "{}", ended.stderr);
        let what = "no gait cycle was kept of 0 detected, in the walk of `stumbling_expert`";
        assert!(ended.stderr.contains(what), "{}", ended.stderr);
        assert!(ended.stderr.contains("hint: a policy that does not walk"), "{}", ended.stderr);
    }
    let ended = bench.run(&[&emg[..], &play, &["--allow-empty", "--json"]].concat());
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    let document: Value = serde_json::from_str(&ended.stdout).unwrap();
    let policy = &document["policies"][0];
    assert_eq!((&policy["policy"], &policy["detected"]), (&"stumbling_expert".into(), &0.into()));
    assert!(policy["correlation"].is_null(), "{policy}");
}

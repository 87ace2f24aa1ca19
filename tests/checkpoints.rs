//! Real checkpoints, read by this crate and by the reference library (PyTorch, NumPy), hold the same numbers.
//!
//! The files are too large for the repository; every test says "skipped" when they are absent. They are looked for in
//! `$ARNOLD_GOLDEN`, else in `../shared/golden`; the checkpoints lie beside that folder.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use arnold_analyze::cli::commands::inspect::inspect;
use arnold_analyze::npz::{self, Array, Arrays};
use arnold_analyze::policy::checkpoint::contents::{Activation, Checkpoint, Format, Normaliser};
use arnold_analyze::policy::checkpoint::{self, Limits};
use common::checkpoints;

/// The folder of reference numbers, if it is here.
fn golden() -> Option<PathBuf> {
    Some(common::golden("policy")?.join(".."))
}

fn open(path: &Path) -> Checkpoint {
    checkpoint::open(path, &Limits::default()).unwrap_or_else(|error| panic!("{error}"))
}

fn open_normaliser(path: &Path) -> Normaliser {
    checkpoint::open_normaliser(path, &Limits::default()).unwrap_or_else(|error| panic!("{error}"))
}

/// One member of an `.npz` file that also holds texts, which the crate's own reader refuses.
fn member(path: &Path, name: &str) -> Vec<u8> {
    let file = std::fs::File::open(path).unwrap();
    let mut archive = zip::ZipArchive::new(file).unwrap();
    let mut content = Vec::new();
    archive.by_name(&format!("{name}.npy")).unwrap().read_to_end(&mut content).unwrap();
    content
}

fn array(path: &Path, name: &str) -> Array {
    npz::parse_npy(name, &member(path, name)).unwrap()
}

/// A one-dimensional array of fixed-width UTF-32 texts (`<U…`).
fn texts(path: &Path, name: &str) -> Vec<String> {
    let content = member(path, name);
    let header = 10 + usize::from(u16::from_le_bytes([content[8], content[9]]));
    let description = String::from_utf8_lossy(&content[10..header]).into_owned();
    let width = description.split("'<U").nth(1).unwrap().split('\'').next().unwrap();
    let width: usize = width.parse().unwrap();
    let character = |bytes: &[u8; 4]| char::from_u32(u32::from_le_bytes(*bytes)).unwrap();
    content[header..]
        .chunks(4 * width)
        .map(|text| text.as_chunks::<4>().0.iter().map(character).filter(|&c| c != '\0').collect())
        .collect()
}

#[test]
fn every_tensor_of_a_transformer_sums_to_what_torch_says() {
    let Some(golden) = golden() else { return };
    for (name, stored, distinct, heads) in
        [("xs", 104_020, 96_916, 2), ("full", 4_450_564, 4_393_732, 4)]
    {
        let policy = open(&golden.join(format!("policy/{name}_model.zip")));
        assert_eq!(policy.format, Format::ArnoldTransformer);
        assert_eq!(policy.scalars.head_count, Some(heads));
        assert_eq!(policy.scalars.activation, Some(Activation::Relu));
        assert_eq!(policy.scalars.library_version.as_deref(), Some("2.2.1"));

        let sums = golden.join(format!("policy/{name}_param_sums.npz"));
        let names = texts(&sums, "names");
        assert_eq!(names.len(), policy.tensors.len());
        let expected =
            ["sums", "abs_sums", "numel"].map(|array_name| array(&sums, array_name).to_f64());
        for (row, tensor_name) in names.iter().enumerate() {
            let tensor = &policy.tensors[tensor_name];
            assert_eq!(tensor.data.len(), expected[2][row] as usize, "{tensor_name}");
            assert_eq!(tensor.shape.iter().product::<usize>(), tensor.data.len(), "{tensor_name}");
            let sum: f64 = tensor.data.iter().map(|&x| f64::from(x)).sum();
            let absolute: f64 = tensor.data.iter().map(|&x| f64::from(x).abs()).sum();
            // Both sides add f32 numbers in f64; only the order of the additions differs.
            let tolerance = 1e-12 * (1.0 + expected[1][row]);
            assert!((sum - expected[0][row]).abs() < tolerance, "{tensor_name}");
            assert!((absolute - expected[1][row]).abs() < tolerance, "{tensor_name}");
        }

        let count = |keep: &dyn Fn(&String) -> bool| -> usize {
            policy.tensors.iter().filter(|(n, _)| keep(n)).map(|(_, t)| t.data.len()).sum()
        };
        assert_eq!(count(&|_| true), stored);
        assert_eq!(count(&|name| !policy.aliases.contains_key(name)), distinct);
        let norm = "mlp_extractor._value_decoder.norm.weight";
        assert_eq!(policy.aliases[norm], "mlp_extractor._action_decoder.norm.weight");
    }
}

#[test]
fn the_normaliser_of_a_transformer_is_what_numpy_says() {
    let Some(golden) = golden() else { return };
    for name in ["xs", "full"] {
        let path = golden.join(format!("policy/{name}_model_vecnormalize.pkl"));
        let Normaliser::PerSignature(read) = open_normaliser(&path) else { panic!("wrong kind") };
        let dump = golden.join(format!("policy/{name}_vecnormalize_dump.npz"));
        let signatures = array(&dump, "signatures");
        let width = signatures.shape[1];
        for (row, expected) in signatures.to_f64().chunks(width).enumerate() {
            let mut expected: Vec<u16> =
                expected.iter().filter(|&&id| id != 0.0).map(|&id| id as u16).collect();
            if expected.is_empty() {
                expected.push(0);
            }
            assert_eq!(read.signatures[row], expected);
        }
        assert_eq!(read.lags, 6);
        assert_eq!(read.mean, array(&dump, "mean").to_f32());
        assert_eq!(read.variance, array(&dump, "var").to_f32());
        assert_eq!(read.count, array(&dump, "count").to_f64());
        assert_eq!(read.epsilon.to_bits(), array(&dump, "epsilon").to_f64()[0].to_bits());
        assert_eq!(read.clip.to_bits(), array(&dump, "clip_obs").to_f64()[0].to_bits());
        assert!(read.enabled);
    }
}

/// Name → (shape, values) of a safetensors file: 8 bytes of header length, a JSON header, the values.
fn safetensors(path: &Path) -> BTreeMap<String, (Vec<usize>, Vec<f32>)> {
    let bytes = std::fs::read(path).unwrap();
    let (length, rest) = bytes.split_first_chunk::<8>().unwrap();
    let (header, data) = rest.split_at(u64::from_le_bytes(*length) as usize);
    let header: serde_json::Map<String, serde_json::Value> =
        serde_json::from_slice(header).unwrap();
    let size = |value: &serde_json::Value| value.as_u64().unwrap() as usize;
    let tensors = header.iter().filter(|(name, _)| *name != "__metadata__");
    tensors
        .map(|(name, entry)| {
            assert_eq!(entry["dtype"], "F32");
            let shape = entry["shape"].as_array().unwrap().iter().map(size).collect();
            let span = size(&entry["data_offsets"][0])..size(&entry["data_offsets"][1]);
            let values = data[span].as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b));
            (name.clone(), (shape, values.collect()))
        })
        .collect()
}

#[test]
fn the_baoding_expert_holds_the_published_weights() {
    let Some(folder) = checkpoints("myochallenge2022_baoding_ppo_lstm") else { return };
    let policy = open(&folder.join("phase1_final.zip"));
    assert_eq!(policy.format, Format::RecurrentPpo);
    assert_eq!(policy.scalars.library_version.as_deref(), Some("1.6.0"));
    assert_eq!(policy.scalars.training_steps, Some(3_360_000));
    let expected = safetensors(&folder.join("../baoding_phase1/phase1_final.safetensors"));
    for (name, tensor) in &policy.tensors {
        let (shape, values) = &expected[name];
        assert_eq!((&tensor.shape, &tensor.data), (shape, values), "{name}");
    }
    assert_eq!(policy.tensors.len(), expected.len());
    for name in ["rsi_static", "final_period4to6"] {
        assert_eq!(open(&folder.join(format!("{name}.zip"))).format, Format::RecurrentPpo);
    }
}

#[test]
fn the_baoding_normaliser_is_what_the_recorded_episodes_used() {
    let Some(folder) = checkpoints("myochallenge2022_baoding_ppo_lstm") else { return };
    let Some(golden) = golden() else { return };
    let path = folder.join("normalized_env_phase1_final.pkl");
    let Normaliser::PerComponent(read) = open_normaliser(&path) else { panic!("wrong kind") };
    let recorded = golden.join("expert/baoding_phase1_cw_phase_half_pi_mj2.3.7_s0.npz");
    let recorded = Arrays::open(&recorded).unwrap();
    let expected = |name: &str| recorded.get(name).unwrap().to_f64();
    assert_eq!(read.mean, expected("norm_mean"));
    assert_eq!(read.variance, expected("norm_var"));
    assert_eq!(read.epsilon.to_bits(), expected("norm_eps")[0].to_bits());
    assert_eq!(read.clip.to_bits(), expected("norm_clip")[0].to_bits());
    assert_eq!(read.mean.len(), 86);
}

#[test]
fn the_normalisers_beside_the_baoding_experts_are_found() {
    let Some(folder) = checkpoints("myochallenge2022_baoding_ppo_lstm") else { return };
    for (policy, normaliser) in [
        ("phase1_final.zip", "normalized_env_phase1_final.pkl"),
        ("rsi_static.zip", "normalized_env_rsi_static.pkl"),
        ("final_period4to6.zip", "env_final_period4to6.pkl"),
    ] {
        let found = checkpoint::normaliser_beside(&folder.join(policy));
        assert_eq!(found, [folder.join(normaliser)]);
    }
}

#[test]
fn natural_gradient_policies_hold_the_published_weights() {
    let Some(folder) = checkpoints("npg") else { return };
    for name in ["ElbowPose1D6MRandom", "HandReachRandom", "HandPenTwirlRandom"] {
        let policy = open(&folder.join(format!("{name}_seed1_best_policy.pickle")));
        assert_eq!(policy.format, Format::NpgMlp);
        assert_eq!(policy.scalars.activation, Some(Activation::Tanh));
        let expected = Arrays::open(&folder.join(format!("{name}_weights.npz"))).unwrap();
        assert!(policy.tensors.keys().eq(expected.0.keys()));
        for (tensor_name, tensor) in &policy.tensors {
            let expected = expected.get(tensor_name).unwrap();
            assert_eq!(tensor.shape, expected.shape, "{tensor_name}");
            assert_eq!(tensor.data, expected.to_f32(), "{tensor_name}");
        }
    }
}

#[test]
fn every_myosuite_baseline_is_read() {
    let Some(folder) = checkpoints("myosuite_npg") else { return };
    let mut count = 0;
    for task in std::fs::read_dir(folder).unwrap().map(|entry| entry.unwrap().path()) {
        let Ok(files) = std::fs::read_dir(task) else { continue };
        for path in files.map(|entry| entry.unwrap().path()) {
            if path.extension().is_some_and(|extension| extension == "pickle") {
                let policy = open(&path);
                assert_eq!((policy.format, policy.tensors.len()), (Format::NpgMlp, 11));
                count += 1;
            }
        }
    }
    assert_eq!(count, 69 - 3);
}

/// These two were written by a newer torch, which names an empty set and the class of its table of functions.
#[test]
fn natural_gradient_policies_of_a_newer_torch_are_read() {
    let Some(folder) = checkpoints("myochallenge2022_npg_test_policies") else { return };
    for (file, observations) in [("die_rotate_policy.pickle", 102), ("bb_test_policy.pickle", 86)] {
        let policy = open(&folder.join(file));
        assert_eq!((policy.format, policy.tensors.len()), (Format::NpgMlp, 11));
        assert_eq!(policy.scalars.activation, Some(Activation::Tanh));
        assert_eq!(policy.tensors["fc_layers.0.weight"].shape, [32, observations]);
        let name = "torch._C._VariableFunctionsClass".to_owned();
        assert!(policy.globals.contains(&name), "{:?}", policy.globals);
    }
}

/// These two-headed networks (muscles, exoskeleton) exist only in their own project.
#[test]
fn an_archive_with_another_network_is_refused_by_the_names_of_its_tensors() {
    let Some(folder) = checkpoints("myoassist_leg22_ppo") else { return };
    let session = folder.join("train_session_20250728-161129_tutorial_partial_obs");
    let refused = checkpoint::open(&session.join("model_19939328.zip"), &Limits::default());
    let message = refused.unwrap_err().to_string();
    assert!(message.contains("`policy_network.exo_policy_net.0.weight`"), "{message}");
}

#[test]
fn a_bare_state_dictionary_is_read() {
    let Some(folder) = checkpoints("myochallengeanalysis_step01_rsi_static") else { return };
    let policy = open(&folder.join("policy.pth"));
    assert_eq!(policy.format, Format::RecurrentPpo);
    assert_eq!(policy.scalars.training_steps, None);
}

#[test]
fn inspect_tells_sizes_parameters_and_normaliser() {
    let Some(golden) = golden() else { return };
    let told = inspect(&golden.join("policy/full_model.zip"), &Limits::default()).unwrap();
    assert_eq!(told["parameters"]["stored"], 4_450_564);
    assert_eq!(told["parameters"]["distinct"], 4_393_732);
    for (size, value) in [
        ("vocabulary", 214),
        ("window", 6),
        ("embedding", 128),
        ("heads", 4),
        ("feed-forward", 512),
        ("encoder layers", 6),
        ("decoder layers", 6),
    ] {
        assert_eq!(told["sizes"][size], value, "{size}");
    }
    assert_eq!(told["tensors"].as_array().unwrap().len(), 310);
    assert_eq!(told["normalisers"][0]["signatures"], 862);
    let told =
        inspect(&golden.join("policy/xs_model_vecnormalize.pkl"), &Limits::default()).unwrap();
    assert_eq!(told["normaliser"]["lags"], 6);
    assert_eq!(told["kind"], "normaliser");

    let Some(folder) = checkpoints("myochallenge2022_baoding_ppo_lstm") else { return };
    let told = inspect(&folder.join("phase1_final.zip"), &Limits::default()).unwrap();
    for (size, value) in [("observations", 86), ("LSTM", 128), ("actions", 39)] {
        assert_eq!(told["sizes"][size], value, "{size}");
    }
    assert_eq!(told["normalisers"][0]["components"], 86);
    let Some(folder) = checkpoints("npg") else { return };
    let path = folder.join("ElbowPose1D6MRandom_seed1_best_policy.pickle");
    let told = inspect(&path, &Limits::default()).unwrap();
    assert_eq!(
        told["sizes"],
        serde_json::json!({"observations": 9, "hidden": [32, 32], "actions": 6})
    );
}

#[test]
fn the_full_model_is_read_without_delay() {
    let Some(golden) = golden() else { return };
    let path = golden.join("policy/full_model.zip");
    open(&path);
    let best = (0..5)
        .map(|_| {
            let start = std::time::Instant::now();
            open(&path);
            start.elapsed()
        })
        .min()
        .unwrap();
    eprintln!("full model read in {best:?}");
    // 13 ms on two shared cores; the bound leaves room for a busy machine.
    assert!(best.as_millis() <= 100, "{best:?}");
}

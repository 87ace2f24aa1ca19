//! Policies by name, sets of experts, and policies converted to safetensors.
//!
//! The published layout is made of the small checkpoints that travel with the source.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::{Path, PathBuf};

use arnold_analyze::files;
use arnold_analyze::policy::expert_table::ExpertTable;
use arnold_analyze::policy::export::{export, export_mean};
use arnold_analyze::policy::shelf::{self, Choice};
use arnold_analyze::policy::vocabulary::Vocabulary;
use arnold_analyze::policy::{self, Loaded, PolicyError, TaskInterface};

fn fixture(variant: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/transformers").join(variant)
}

fn checkpoint(variant: &str) -> PathBuf {
    fixture(variant).join("rl_model_4000_steps.zip")
}

/// The task that the small checkpoints were recorded in.
fn task(name: &str) -> TaskInterface {
    let words = Vocabulary::standard();
    let ids = |phrase: &str| phrase.split(' ').map(|word| words.id_of(word).unwrap()).collect();
    let sensors = [
        "FDS5 activation muscle",
        "FDS5 force muscle",
        "hip_flexion position angular joint",
        "ball id_1 position x",
        "ball id_2 error y target",
    ];
    let muscles =
        ["FDS5 activation muscle", "EIP activation muscle", "soleus left activation muscle"];
    TaskInterface {
        task: name.to_owned(),
        muscle_count: 3,
        muscle_observation_length: 5,
        clean_observation_length: 86,
        observation_words: sensors.map(ids).to_vec(),
        action_words: muscles.map(ids).to_vec(),
        muscle_models: Vec::new(),
    }
}

/// The bits of four actions and their standard deviations.
fn actions(policy: &Loaded, task: &TaskInterface) -> Vec<u32> {
    let mut actor = policy.policy.bind(task, 1).unwrap_or_else(|error| panic!("{error}"));
    let length = match policy.policy.variant_in(&task.task) {
        policy::ObservationVariant::Muscle => task.muscle_observation_length,
        policy::ObservationVariant::Clean | policy::ObservationVariant::CleanAndMuscles => {
            task.clean_observation_length
        }
    };
    let (mut means, mut deviations) = (vec![0.0; task.muscle_count], vec![0.0; task.muscle_count]);
    let mut bits = Vec::new();
    for step in 0..4 {
        let observation: Vec<f32> =
            (0..length).map(|i| ((step * 7 + i) as f32 * 0.37).sin()).collect();
        actor.act(&[0], &observation, &mut means, Some(&mut deviations));
        bits.extend(means.iter().chain(&deviations).map(|x| x.to_bits()));
    }
    bits
}

/// Converts a checkpoint and compares what both files do.
fn converts_unchanged(path: &Path, normaliser: Option<&Path>, task: &TaskInterface) {
    let out = tempfile::tempdir().unwrap();
    let exported = export(path, normaliser, out.path()).unwrap_or_else(|error| panic!("{error}"));
    let original = policy::open(path, normaliser).unwrap();
    let converted = policy::open(&exported.policy, None).unwrap_or_else(|error| panic!("{error}"));
    assert_eq!(original.format, converted.format);
    assert_eq!(actions(&original, task), actions(&converted, task), "{}", path.display());
    // From the folder it lies in, too; and a second time it is the same file.
    let found = shelf::find(out.path(), Path::new("data")).unwrap();
    assert_eq!(found, Choice::File(exported.policy.clone()));
    let first = std::fs::read(&exported.policy).unwrap();
    export(path, normaliser, out.path()).unwrap();
    assert_eq!(first, std::fs::read(&exported.policy).unwrap());
    let description: serde_json::Value =
        serde_json::from_slice(&std::fs::read(&exported.description).unwrap()).unwrap();
    let hash = blake3::hash(&std::fs::read(path).unwrap()).to_hex().to_string();
    assert_eq!(description["provenance"]["checkpoint"]["blake3"], hash);
    // And from that file once more.
    let again = tempfile::tempdir().unwrap();
    let twice = export(&exported.policy, None, again.path()).unwrap();
    let twice = policy::open(&twice.policy, None).unwrap();
    assert_eq!(actions(&original, task), actions(&twice, task));
}

#[test]
fn every_transformer_converts_to_the_same_bits() {
    for variant in [
        "separate",
        "shared_waves_predictive",
        "task_words",
        "atomic",
        "older_vocabulary",
        "temporal",
        "not_normalising",
    ] {
        converts_unchanged(&checkpoint(variant), None, &task("pen"));
    }
}

#[test]
fn the_mean_of_a_network_with_itself_is_that_network() {
    let (path, task) = (checkpoint("separate"), task("pen"));
    let out = tempfile::tempdir().unwrap();
    let mean = export_mean(&[&path, &path, &path], None, out.path()).unwrap();
    let hash = blake3::hash(&std::fs::read(&path).unwrap()).to_hex().to_string();
    assert_eq!(mean.document["provenance"]["mean_of"][2]["blake3"], hash);
    let (original, mean) = (policy::open(&path, None), policy::open(&mean.policy, None));
    assert_eq!(actions(&original.unwrap(), &task), actions(&mean.unwrap(), &task));
}

#[test]
fn networks_that_differ_have_no_mean() {
    let out = tempfile::tempdir().unwrap();
    let paths = [checkpoint("shared_waves_predictive"), checkpoint("separate")];
    let message = export_mean(&paths, None, out.path()).unwrap_err().to_string();
    assert!(message.contains("only checkpoints of one network have a mean"), "{message}");
    assert!(paths.iter().all(|path| message.contains(&path.display().to_string())), "{message}");
    assert!(std::fs::read_dir(out.path()).unwrap().next().is_none());
}

#[test]
fn published_experts_convert_to_the_same_bits() {
    let Some(policy) = common::recurrent_baoding_policy() else { return };
    let baoding = TaskInterface { muscle_count: 39, ..task("baoding_p1_ccw") };
    converts_unchanged(&policy, None, &baoding);
    let Some(folder) = common::checkpoints("myosuite_npg") else { return };
    let pickles: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap()
        .flat_map(|entry| std::fs::read_dir(entry.unwrap().path()).into_iter().flatten())
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|end| end == "pickle"))
        .collect();
    for path in pickles {
        let read = policy::checkpoint::open(&path, &policy::checkpoint::Limits::default()).unwrap();
        let (inputs, outputs) =
            (read.tensors["in_shift"].data.len(), read.tensors["out_shift"].data.len());
        let task = TaskInterface {
            muscle_count: outputs,
            clean_observation_length: inputs,
            ..task("any")
        };
        converts_unchanged(&path, None, &task);
    }
}

#[test]
fn bare_weights_in_safetensors_are_read() {
    let Some(folder) = common::checkpoints("baoding_phase1") else { return };
    let Some(original) = common::recurrent_baoding_policy() else { return };
    let normaliser = original.with_file_name("normalized_env_phase1_final.pkl");
    let bare = policy::open(&folder.join("phase1_final.safetensors"), Some(&normaliser)).unwrap();
    let baoding = TaskInterface { muscle_count: 39, ..task("baoding_p1_ccw") };
    let original = policy::open(&original, None).unwrap();
    assert_eq!(actions(&bare, &baoding), actions(&original, &baoding));
}

#[test]
fn nothing_is_overwritten() {
    let out = tempfile::tempdir().unwrap();
    let taken = out.path().join("rl_model_4000_steps.json");
    files::write_atomic(&taken, b"{}").unwrap();
    let error = export(&checkpoint("separate"), None, out.path()).unwrap_err();
    assert!(matches!(&error, PolicyError::Exists { path } if *path == taken), "{error}");
    assert_eq!(std::fs::read(&taken).unwrap(), b"{}");
}

#[test]
fn a_damaged_safetensors_file_is_refused() {
    let out = tempfile::tempdir().unwrap();
    let exported = export(&checkpoint("separate"), None, out.path()).unwrap();
    let bytes = std::fs::read(&exported.policy).unwrap();
    let path = out.path().join("damaged.safetensors");
    let refusal = |bytes: &[u8]| {
        files::write_atomic(&path, bytes).unwrap();
        let error = policy::open(&path, None).err().unwrap().to_string();
        assert!(error.contains("damaged.safetensors"), "{error}");
        error
    };
    let header = u64::from_le_bytes(*bytes.first_chunk().unwrap()) as usize;
    for length in [8, 9, header, header + 8, bytes.len() - 1] {
        refusal(&bytes[..length]);
    }
    // The header as text with one thing changed in it, at the same length.
    let edited = |from: &str, to: &str| {
        let text = String::from_utf8(bytes[8..8 + header].to_vec()).unwrap();
        assert!(text.contains(from) && from.len() == to.len(), "{from}");
        let mut edited = bytes.clone();
        edited[8..8 + header].copy_from_slice(text.replacen(from, to, 1).as_bytes());
        edited
    };
    assert!(refusal(&edited(r#"\"schema\":1"#, r#"\"schema\":2"#)).contains("schema 2"));
    assert!(refusal(&edited(r#""F32""#, r#""U32""#)).contains("U32"));
    refusal(&edited("ArnoldTransformer", "ArnoldPerceptronX"));
    refusal(&edited(r#"\"family\""#, r#"\"famili\""#));
    // A header that claims to be longer than any.
    let mut endless = bytes.clone();
    endless[..8].copy_from_slice(&(1_u64 << 40).to_le_bytes());
    refusal(&endless);
}

/// A data folder in the published layout.
fn published() -> tempfile::TempDir {
    let data = tempfile::tempdir().unwrap();
    let copy = |from: PathBuf, to: &str| {
        let bytes = std::fs::read(from).unwrap();
        files::write_atomic(&data.path().join(to), &bytes).unwrap();
    };
    for (variant, folder) in [("separate", "my_pen"), ("task_words", "my_baoding")] {
        let folder = format!("expert_policies/{folder}");
        copy(checkpoint(variant), &format!("{folder}/model.zip"));
        let normaliser = "rl_model_vecnormalize_4000_steps.pkl";
        copy(fixture(variant).join(normaliser), &format!("{folder}/env.pkl"));
        copy(fixture(variant).join("args.json"), &format!("{folder}/args.json"));
    }
    let text = r#"{
        "pen": {"expert": "my_pen", "algo": "bc_ppo", "use_arnold": true},
        "baoding_p1_cw": {"expert": "my_baoding", "algo": "bc_ppo", "use_arnold": true},
        "reorient": {"expert": "my_pen", "algo": "recurrent_ppo", "use_arnold": false}
    }"#;
    files::write_atomic(&data.path().join("expert_configs/mine.json"), text.as_bytes()).unwrap();
    data
}

fn table(name: &str, data: &Path) -> ExpertTable {
    match shelf::find(Path::new(name), data).unwrap() {
        Choice::Experts(table) => table,
        Choice::File(path) => panic!("{}", path.display()),
    }
}

#[test]
fn every_task_is_played_by_its_own_expert() {
    let data = published();
    let table = table("expert:mine", data.path());
    let set = policy::open_experts(&table, &["pen", "baoding_p1_cw"], data.path()).unwrap();
    let names: Vec<&str> = set.members.iter().map(|member| member.name.as_str()).collect();
    assert_eq!(names, ["my_pen", "my_baoding"]);
    for (task_name, variant) in [("pen", "separate"), ("baoding_p1_cw", "task_words")] {
        let alone = policy::open(&checkpoint(variant), None).unwrap();
        assert_eq!(actions(&set, &task(task_name)), actions(&alone, &task(task_name)));
    }
    let other = policy::open_experts(&table, &["pen"], data.path()).unwrap();
    assert_ne!(set.checkpoint_hash, other.checkpoint_hash);
}

#[test]
fn a_task_without_its_expert_says_why() {
    let data = published();
    let table = table("expert:mine", data.path());
    let set = policy::open_experts(&table, &["pen", "relocate", "reorient"], data.path()).unwrap();
    let refusal = |name: &str| set.policy.bind(&task(name), 1).err().unwrap().to_string();
    assert!(refusal("relocate").contains("expert_policies/relocate"), "{}", refusal("relocate"));
    // The table says one thing, the folder holds another.
    assert!(refusal("reorient").contains("should be recurrent_ppo"), "{}", refusal("reorient"));
    let none = policy::open_experts(&table, &["relocate", "kinesis"], data.path()).err().unwrap();
    assert!(none.to_string().contains("kinesis: there is no folder"), "{none}");
}

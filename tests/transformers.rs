//! Every variant of the muscle transformer, read from files that torch and Stable-Baselines3 wrote, does what torch did.
//!
//! The files are small and travel with the source; `scripts/make_transformer_fixtures.py` made them.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use arnold_analyze::files;
use arnold_analyze::policy::vocabulary::Vocabulary;
use arnold_analyze::policy::{self, Loaded, TaskInterface};
use serde_json::Value;

/// Single precision, other summation orders.
const TOLERANCE: f64 = 2e-6;

const VARIANTS: [&str; 7] = [
    "separate",
    "shared_waves_predictive",
    "task_words",
    "atomic",
    "older_vocabulary",
    "temporal",
    "not_normalising",
];

fn folder(variant: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/transformers").join(variant)
}

fn checkpoint(variant: &str) -> PathBuf {
    folder(variant).join("rl_model_4000_steps.zip")
}

fn open(path: &Path) -> Loaded {
    policy::open(path, None).unwrap_or_else(|error| panic!("{error}"))
}

fn recorded(variant: &str) -> Value {
    serde_json::from_slice(&std::fs::read(folder(variant).join("recorded.json")).unwrap()).unwrap()
}

fn phrases(list: &Value) -> Vec<Vec<u16>> {
    let words = Vocabulary::standard();
    let id = |word: &Value| words.id_of(word.as_str().unwrap()).unwrap();
    let phrase = |phrase: &Value| phrase.as_array().unwrap().iter().map(id).collect();
    list.as_array().unwrap().iter().map(phrase).collect()
}

fn numbers(list: &Value) -> Vec<f32> {
    list.as_array().unwrap().iter().map(|x| x.as_f64().unwrap() as f32).collect()
}

/// The task of a recording under another name.
fn task(recorded: &Value, name: &str) -> TaskInterface {
    let (observation_words, action_words) =
        (phrases(&recorded["sensors"]), phrases(&recorded["muscles"]));
    TaskInterface {
        task: name.to_owned(),
        muscle_count: action_words.len(),
        muscle_observation_length: observation_words.len(),
        clean_observation_length: 0,
        observation_words,
        action_words,
        muscle_models: Vec::new(),
    }
}

/// Means and standard deviations of an episode, played in slot 1 of 2 after another episode.
fn play(policy: &Loaded, task: &TaskInterface, observations: &Value) -> Vec<Vec<f32>> {
    let mut actor = policy.policy.bind(task, 2).unwrap_or_else(|error| panic!("{error}"));
    let (mut means, mut deviations) = (vec![0.0; task.muscle_count], vec![0.0; task.muscle_count]);
    let elsewhere = vec![0.25; task.muscle_observation_length];
    for slot in [1, 0, 1] {
        actor.act(&[slot], &elsewhere, &mut means, None);
    }
    actor.reset(1);
    let mut rows = Vec::new();
    for observation in observations.as_array().unwrap() {
        actor.act(&[1], &numbers(observation), &mut means, Some(&mut deviations));
        rows.push([means.clone(), deviations.clone()].concat());
    }
    rows
}

#[test]
fn every_variant_acts_as_torch_did() {
    for variant in VARIANTS {
        let (policy, recorded) = (open(&checkpoint(variant)), recorded(variant));
        for episode in recorded["episodes"].as_array().unwrap() {
            let task = task(&recorded, episode["task"].as_str().unwrap());
            let rows = play(&policy, &task, &episode["observations"]);
            assert_eq!(rows.len(), 9);
            for (step, row) in rows.iter().enumerate() {
                let want =
                    [numbers(&episode["means"][step]), numbers(&episode["deviations"][step])];
                for (got, want) in row.iter().zip(want.concat()) {
                    let difference = f64::from(got - want).abs();
                    assert!(
                        difference < TOLERANCE * (1.0 + f64::from(want.abs())),
                        "{variant}, step {step}: {got} instead of {want}"
                    );
                }
            }
        }
    }
}

#[test]
fn words_of_their_own_belong_to_the_task_they_were_trained_for() {
    let recorded = recorded("task_words");
    let policy = open(&checkpoint("task_words"));
    let observations = &recorded["episodes"][0]["observations"];
    let pen = play(&policy, &task(&recorded, "pen"), observations);
    assert_ne!(pen, play(&policy, &task(&recorded, "baoding_p1_cw"), observations));
    let error = policy.policy.bind(&task(&recorded, "relocate"), 1).err().unwrap().to_string();
    assert!(error.contains("baoding_p1_cw, pen; none for task `relocate`"), "{error}");
}

#[test]
fn an_atomic_vocabulary_refuses_a_sensor_it_has_no_row_for() {
    let recorded = recorded("atomic");
    let mut task = task(&recorded, "pen");
    task.observation_words[0].reverse();
    let error = open(&checkpoint("atomic")).policy.bind(&task, 1).err().unwrap().to_string();
    assert!(error.contains("`muscle/activation/FDS5`"), "{error}");
}

#[test]
fn a_vocabulary_in_another_order_is_matched_by_word_and_said() {
    let policy = open(&checkpoint("older_vocabulary"));
    let warning = policy.warnings.iter().find(|text| text.contains("matched by word")).unwrap();
    assert!(warning.contains("211 words") && warning.contains("3 words are new"), "{warning}");
}

#[test]
fn what_no_file_says_is_assumed_aloud() {
    let copy = copied("temporal");
    std::fs::remove_file(copy.path().join("args.json")).unwrap();
    let policy = open(&copy.path().join("rl_model_4000_steps.zip"));
    assert!(
        policy.warnings.iter().any(|text| text.contains("96 moments")),
        "{:?}",
        policy.warnings
    );

    let copy = copied("shared_waves_predictive");
    std::fs::remove_file(copy.path().join("args.json")).unwrap();
    let policy = open(&copy.path().join("rl_model_4000_steps.zip"));
    assert!(
        policy.warnings.iter().any(|text| text.contains("2 are assumed")),
        "{:?}",
        policy.warnings
    );
}

/// A variant's files in a folder that may be changed.
fn copied(variant: &str) -> tempfile::TempDir {
    let copy = tempfile::tempdir().unwrap();
    for entry in std::fs::read_dir(folder(variant)).unwrap() {
        let path = entry.unwrap().path();
        std::fs::copy(&path, copy.path().join(path.file_name().unwrap())).unwrap();
    }
    copy
}

fn edit_arguments(folder: &Path, key: &str, value: Value) {
    let path = folder.join("args.json");
    let mut arguments: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    arguments[key] = value;
    files::write_atomic(&path, arguments.to_string().as_bytes()).unwrap();
}

#[test]
fn other_words_beside_a_checkpoint_make_another_policy() {
    let copy = copied("temporal");
    let open = || open(&copy.path().join("rl_model_4000_steps.zip")).checkpoint_hash;
    let before = open();
    edit_arguments(copy.path(), "seed", 7.into());
    assert_eq!(before, open(), "the seed of training decides nothing here");
    edit_arguments(copy.path(), "k_bilateral", 2.into());
    assert_ne!(before, open());
}

fn refusal(folder: &Path) -> String {
    policy::open(&folder.join("rl_model_4000_steps.zip"), None).err().unwrap().to_string()
}

#[test]
fn arguments_that_contradict_the_checkpoint_are_refused() {
    for (key, value, both) in [
        ("num_heads", 4, ["attention heads: 4", "it is 2"]),
        ("embedding_size", 16, ["embedding size: 16", "it is 8"]),
        ("num_layers", 3, ["encoder layers: 3", "it is 2"]),
        ("num_memory_steps", 3, ["earlier observations per token: 3", "it is 5"]),
    ] {
        let copy = copied("separate");
        edit_arguments(copy.path(), key, value.into());
        let error = refusal(copy.path());
        assert!(both.iter().all(|part| error.contains(part)), "{error}");
        edit_arguments(copy.path(), "load_path", "elsewhere".into());
        let policy = open(&copy.path().join("rl_model_4000_steps.zip"));
        assert!(policy.warnings.iter().any(|text| text.contains("went on")));
    }
    let copy = copied("separate");
    files::write_atomic(&copy.path().join("args.json"), b"{").unwrap();
    assert!(refusal(copy.path()).contains("args.json"), "{}", refusal(copy.path()));
}

#[test]
fn a_normaliser_of_another_run_is_refused() {
    // The other run's words have other numbers, so it has never seen these sensors.
    let copy = copied("separate");
    let name = "rl_model_vecnormalize_4000_steps.pkl";
    std::fs::copy(folder("older_vocabulary").join(name), copy.path().join(name)).unwrap();
    let policy = open(&copy.path().join("rl_model_4000_steps.zip"));
    let recorded = recorded("separate");
    let error = policy.policy.bind(&task(&recorded, "pen"), 1).err().unwrap().to_string();
    assert!(error.contains("belongs to another run"), "{error}");
    // A task that the run never saw may have sensors that are new to it.
    policy.policy.bind(&task(&recorded, "relocate"), 1).unwrap();
    assert_eq!(policy.policy.warnings(&task(&recorded, "relocate")).len(), 5);
}

#[test]
fn a_normaliser_of_another_step_is_mentioned() {
    let copy = copied("separate");
    let name = |steps| copy.path().join(format!("rl_model_vecnormalize_{steps}_steps.pkl"));
    std::fs::copy(name(4000), name(3000)).unwrap();
    let path = copy.path().join("rl_model_4000_steps.zip");
    let policy = policy::open(&path, Some(&name(3000))).unwrap();
    assert!(
        policy.warnings.iter().any(|text| text.contains("of step 3000")),
        "{:?}",
        policy.warnings
    );
}

#[test]
fn a_vocabulary_of_another_length_than_the_embedding_is_refused() {
    let copy = copied("older_vocabulary");
    std::fs::remove_file(copy.path().join("vocabulary.json")).unwrap();
    let error = refusal(copy.path());
    assert!(error.contains("embeds 211 words") && error.contains("214"), "{error}");
}

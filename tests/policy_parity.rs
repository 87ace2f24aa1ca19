//! Policies against outputs recorded from the published implementation: every quantity within 1e-5 + 1e-5 of the
//! recorded number.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::PathBuf;

use arnold_analyze::policy;
use arnold_analyze::policy::verify::{Outcome, verify_folder};
use common::{checkpoints, golden};

/// Compares every recording in `folder`; at least so many quantities.
fn agree(folder: Option<PathBuf>, at_least: usize) {
    let Some(folder) = folder else { return };
    let checks = verify_folder(&folder).unwrap();
    let mut failures = Vec::new();
    for check in &checks {
        eprintln!(
            "{}: {}: {} numbers, largest difference {:.1e} ({:.1e} relative): {:?}",
            check.file,
            check.quantity,
            check.compared,
            check.largest_absolute,
            check.largest_relative,
            check.outcome
        );
        if check.outcome == Outcome::Failed {
            failures.push(format!("{}: {}", check.file, check.quantity));
        }
    }
    assert!(failures.is_empty(), "{failures:#?}");
    let done = checks.iter().filter(|check| check.outcome == Outcome::Passed).count();
    assert!(done >= at_least, "only {done} quantities were compared");
}

#[test]
fn transformers_agree_with_the_published_implementation() {
    // 21 tasks with nine quantities each, and two padded batches with three.
    agree(golden("policy"), 21 * 9 + 2 * 3);
}

#[test]
fn the_recurrent_policy_agrees_along_whole_episodes() {
    agree(golden("expert"), 6 * 9);
}

#[test]
fn natural_policy_gradient_policies_agree_on_recorded_observations() {
    agree(checkpoints("npg"), 6 * 2);
}

#[test]
fn opening_a_checkpoint_finds_its_normaliser_and_says_what_it_read() {
    let Some(folder) = golden("policy") else { return };
    let path = folder.join("xs_model.zip");
    let loaded = policy::open(&path, None).unwrap();
    assert_eq!(loaded.name, "xs_model");
    assert_eq!(loaded.normaliser_path.unwrap(), folder.join("xs_model_vecnormalize.pkl"));
    assert_eq!(loaded.warnings, Vec::<String>::new());
    let hash = blake3::hash(&std::fs::read(&path).unwrap()).to_hex();
    assert_eq!(loaded.checkpoint_hash, hash.as_str());
    assert!(loaded.normaliser_hash.is_some_and(|hash| hash != loaded.checkpoint_hash));

    let Some(experts) = checkpoints("myochallenge2022_baoding_ppo_lstm") else { return };
    let foreign = experts.join("normalized_env_phase1_final.pkl");
    let message = policy::open(&path, Some(&foreign)).err().unwrap().to_string();
    assert!(message.contains("per token signature"), "{message}");
}

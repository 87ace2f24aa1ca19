//! Results are the same bytes whatever the number of threads, the batch size and the day: tables, figures and printed
//! numbers. And all components of a control subspace are the unprojected policy itself.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Condvar, Mutex};
use std::time::Duration;

use arnold_analyze::analysis::subspace::{Covariance, Projection, principal_components};
use arnold_analyze::assets::PhysicsVersion;
use arnold_analyze::experiment::seed;
use arnold_analyze::policy::{self, Actor, ObservationVariant, Policy, PolicyError, TaskInterface};
use arnold_analyze::sim::rollout::{
    ActionMode, Channels, Episode, Machine, RolloutPlan, Subspace, play,
};
use arnold_analyze::sim::tasks::{self, Definition, RewardConfiguration};
use common::bench::{Bench, files_below};
use common::physics::{Physics, elbow_policy};
use common::{golden, recurrent_baoding_policy};
use serde_json::Value;

/// Threads and bodies per thread; the first one twice.
const WAYS: [(&str, &str); 4] = [("1", "1"), ("2", "3"), ("2", "16"), ("1", "1")];

/// Runs `words` in every way, each in a folder of its own, and compares all files but the manifest, which says when and
/// how it ran. The printed document, with the folder's name taken out.
fn same_bytes(words: &[&str]) -> Value {
    let bench = Bench::new();
    let mut first: Option<(BTreeMap<String, Vec<u8>>, Value)> = None;
    for (run, (threads, batch)) in WAYS.into_iter().enumerate() {
        let out = format!("run{run}");
        let way = ["--threads", threads, "--batch", batch, "--out", &out, "--json", "--quiet"];
        let mut document = bench.json(&[words, &way].concat());
        let mut files = files_below(Path::new(document["folder"].as_str().unwrap()));
        assert!(files.remove("manifest.json").is_some());
        assert!(files.keys().any(|name| name.ends_with(".parquet")), "{:?}", files.keys());
        let entries = document.as_object_mut().unwrap();
        entries.remove("folder");
        entries.remove("files");
        match &first {
            None => first = Some((files, document)),
            Some((expected_files, expected_document)) => {
                assert_eq!(document, *expected_document, "{words:?}, {threads} × {batch}");
                assert!(files.keys().eq(expected_files.keys()), "{words:?}: other files");
                for (name, bytes) in &files {
                    let same = *bytes == expected_files[name];
                    assert!(same, "{words:?}, {threads} × {batch}: `{name}` has other bytes");
                }
            }
        }
    }
    first.unwrap().1
}

/// Nineteen bodies for sixteen in a batch: some play a second episode.
const ELBOW: [&str; 6] = ["--task", "elbow_pose", "--episodes", "19", "--action-noise", "0.2"];

#[test]
fn evaluate_gives_the_same_bytes_however_it_runs() {
    same_bytes(&[&["evaluate"], &ELBOW[..]].concat());
}

#[test]
fn rollout_gives_the_same_bytes_however_it_runs() {
    same_bytes(&[&["rollout"], &ELBOW[..], &["--stochastic"]].concat());
}

#[test]
fn csi_gives_the_same_bytes_however_it_runs() {
    same_bytes(&[&["csi"], &ELBOW[..], &["--physics", "3.17.0"]].concat());
}

#[test]
fn csi_with_synergies_gives_the_same_bytes_and_ends_at_the_policy_itself() {
    let synergies = ["csi", "--basis", "nmf", "--n-fits", "3", "--components", "1-2,5-6"];
    let document = same_bytes(&[&synergies, &ELBOW[..]].concat());
    let curve = &document["tasks"]["elbow_pose"];
    assert_eq!(curve["solved_fraction"][3], curve["unprojected"]["mean"]);
    assert_eq!(curve["r_squared"][3], 1.0);
    assert!(curve["r_squared"][2].as_f64() > curve["r_squared"][0].as_f64(), "{curve}");
    assert_ne!(curve["solved_fraction"][0], curve["unprojected"]["mean"]);
}

/// A policy that waits, in its first step, until another thread has come as far.
struct Companionable {
    arrived: (Mutex<usize>, Condvar),
}

struct Waiting<'a>(&'a Companionable, bool);

impl Companionable {
    fn meet(&self) {
        let (arrived, everybody) = &self.arrived;
        let mut arrived = arrived.lock().unwrap();
        *arrived += 1;
        everybody.notify_all();
        let patience = Duration::from_secs(30);
        let waited =
            everybody.wait_timeout_while(arrived, patience, |arrived| *arrived < 2).unwrap();
        assert!(!waited.1.timed_out(), "one thread waits for the other to end");
    }
}

impl Policy for &'static Companionable {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Muscle
    }

    fn bind(&self, _task: &TaskInterface, _slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        Ok(Box::new(Waiting(self, false)))
    }
}

impl Actor for Waiting<'static> {
    fn reset(&mut self, _slot: usize) {}

    fn act(&mut self, _: &[usize], _: &[f32], means: &mut [f32], _: Option<&mut [f32]>) {
        if !std::mem::replace(&mut self.1, true) {
            self.0.meet();
        }
        means.fill(0.0);
    }

    fn clips_actions(&self) -> bool {
        true
    }
}

#[test]
fn two_threads_play_at_the_same_time() {
    let policy: &'static Companionable =
        Box::leak(Box::new(Companionable { arrived: Default::default() }));
    let machine = Machine { threads: 2, ..Physics::of(PhysicsVersion::V2_3_7).machine() };
    let plan = RolloutPlan {
        task: tasks::find("elbow_pose").unwrap(),
        policy: &policy,
        mode: ActionMode::Deterministic,
        action_noise: 0.0,
        projections: &[],
        channels: Channels::Counts,
        rewards: RewardConfiguration::Sparse,
    };
    let specs: Vec<_> = (0..4).map(|i| seed::episode(0, plan.task.name, i, None)).collect();
    assert_eq!(play(&machine, &plan, &specs, &|_| ()).unwrap().len(), 4);
}

#[test]
fn csi_of_a_recurrent_policy_gives_the_same_bytes_and_ends_at_the_policy_itself() {
    let Some(policy) = recurrent_baoding_policy() else { return };
    let policy = policy.display().to_string();
    let task = ["--task", "baoding_p1_ccw", "--episodes", "3", "--components", "1,20,39"];
    let document = same_bytes(&[&["csi", "--policy", &policy, "--no-pooled"], &task[..]].concat());
    let curve = &document["tasks"]["baoding_p1_ccw"];
    assert_eq!(curve["solved_fraction"][2], curve["unprojected"]["mean"]);
}

#[test]
fn evaluate_of_a_transformer_gives_the_same_bytes_however_it_runs() {
    let Some(folder) = golden("policy") else { return };
    let policy = folder.join("xs_model.zip").display().to_string();
    let task = ["--task", "hand_index_reach", "--episodes", "3", "--stochastic"];
    same_bytes(&[&["evaluate", "--policy", &policy], &task[..]].concat());
}

/// Plays three episodes freely, then projected onto all principal components of what they did: the same numbers, step by
/// step. One component fewer is something else, or the comparison would be worth nothing.
fn all_components_are_the_policy_itself(policy: &Path, task: &'static Definition) {
    let machine = Physics::of(PhysicsVersion::V2_3_7).machine();
    let policy = policy::open(policy, None).unwrap().policy;
    let plan = RolloutPlan {
        task,
        policy: policy.as_ref(),
        mode: ActionMode::Stochastic,
        action_noise: 0.1,
        projections: &[],
        channels: Channels::All,
        rewards: RewardConfiguration::Sparse,
    };
    let played = |plan: &RolloutPlan<'_>, arm| -> Vec<Episode> {
        let specs: Vec<_> = (0..3).map(|i| seed::episode(0, task.name, i, arm)).collect();
        play(&machine, plan, &specs, &|_| ()).unwrap()
    };
    let free = played(&plan, None);
    let muscles = free[0].recording.action.len() / free[0].steps;
    let mut covariance = Covariance::new(muscles);
    for episode in &free {
        covariance.push_rows(&episode.recording.action_mean).unwrap();
    }
    let components = principal_components(&covariance).unwrap();
    let projections =
        [muscles, muscles - 1].map(|k| Subspace::Actions(Projection::new(&components, k).unwrap()));
    let projected = RolloutPlan { projections: &projections, ..plan.clone() };
    for (free, all) in free.iter().zip(played(&projected, Some(0))) {
        assert_eq!((free.steps, free.solved_steps), (all.steps, all.solved_steps));
        assert_eq!(free.reward.to_bits(), all.reward.to_bits());
        assert_eq!(free.recording, all.recording);
    }
    let fewer = played(&projected, Some(1));
    assert!(free.iter().zip(&fewer).all(|(free, fewer)| free.recording != fewer.recording));
}

#[test]
fn all_components_of_the_elbow_are_the_policy_itself() {
    all_components_are_the_policy_itself(&elbow_policy(), tasks::find("elbow_pose").unwrap());
}

#[test]
fn all_components_of_a_recurrent_policy_are_the_policy_itself() {
    let Some(policy) = recurrent_baoding_policy() else { return };
    all_components_are_the_policy_itself(&policy, tasks::find("baoding_p1_ccw").unwrap());
}

//! What becomes of every published checkpoint: which family it is, its sizes, and which tasks it plays, or why it plays none.
//!
//! The files lie beside the recordings and are too large for the repository; without them the test says "skipped".

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::{Path, PathBuf};

use arnold_analyze::policy::checkpoint::contents::{Format, Normaliser};
use arnold_analyze::policy::checkpoint::{self, Limits};
use arnold_analyze::policy::{self, TaskInterface};
use common::checkpoints;

/// Task, components of its clean observation, muscles (`spec/tasks.md` §2 and §5.1).
const TASKS: [(&str, usize, usize); 14] = [
    ("elbow_pose", 9, 6),
    ("hand_thumb_reach", 91, 39),
    ("hand_index_reach", 91, 39),
    ("hand_middle_reach", 91, 39),
    ("hand_ring_reach", 91, 39),
    ("hand_little_reach", 91, 39),
    ("baoding_p1_cw", 86, 39),
    ("baoding_p1_ccw", 86, 39),
    ("baoding_p2", 86, 39),
    ("baoding_p2_overlap", 86, 39),
    ("pen", 83, 39),
    ("reorient", 102, 39),
    ("relocate", 156, 63),
    ("kinesis", 309, 80),
];

/// What is expected of a file.
enum Verdict {
    /// A policy: its family, observation components and muscles; and which tasks it fits, as the start of their names.
    Policy(Format, usize, usize, &'static [&'static str]),
    /// A normaliser of so many components.
    Normaliser(usize),
    /// Refused with these words.
    Refused(&'static str),
}

use Verdict::{Normaliser as Statistics, Policy, Refused};

const BAODING: &[&str] = &["baoding_"];
const REACH: &[&str] = &["hand_"];
const NONE: &[&str] = &[];

/// The files whose path starts so.
const EXPECTED: [(&str, Verdict); 37] = [
    ("myoassist_leg22_ppo/", Refused("MyoAssist's 22-muscle legs")),
    ("myochallenge2022_baoding_ppo_lstm/final_period4to6.zip", RECURRENT_BAODING),
    ("myochallenge2022_baoding_ppo_lstm/phase1_final.zip", RECURRENT_BAODING),
    ("myochallenge2022_baoding_ppo_lstm/rsi_static.zip", RECURRENT_BAODING),
    ("myochallenge2022_baoding_ppo_lstm/", Statistics(86)),
    ("myochallenge2022_npg_test_policies/bb_", Policy(Format::NpgMlp, 86, 39, BAODING)),
    ("myochallenge2022_npg_test_policies/die_", Policy(Format::NpgMlp, 102, 39, &["reorient"])),
    ("myochallengeanalysis_step01_rsi_static/policy.pth", RECURRENT_BAODING),
    ("myochallengeanalysis_step01_rsi_static/env.pkl", Statistics(86)),
    ("myochallengeanalysis_step01_rsi_static/pytorch_variables.pth", Refused("no network")),
    ("myosuite_npg/myoElbowPose1D6MFixed-v0/", ELBOW),
    ("myosuite_npg/myoElbowPose1D6MRandom-v0/", ELBOW),
    // An exoskeleton's motor is the seventh actuator.
    ("myosuite_npg/myoElbowPose1D6MExoRandom-v0/", Policy(Format::NpgMlp, 9, 7, NONE)),
    // The body of one finger.
    ("myosuite_npg/myoFingerPoseFixed-v0/", Policy(Format::NpgMlp, 17, 5, NONE)),
    ("myosuite_npg/myoFingerPoseRandom-v0/", Policy(Format::NpgMlp, 17, 5, NONE)),
    ("myosuite_npg/myoFingerReachFixed-v0/", Policy(Format::NpgMlp, 19, 5, NONE)),
    ("myosuite_npg/myoFingerReachRandom-v0/", Policy(Format::NpgMlp, 19, 5, NONE)),
    ("myosuite_npg/myoHandBaodingFixed-v1/", GRADIENT_BAODING),
    ("myosuite_npg/myoHandBaodingFixed4th-v1/", GRADIENT_BAODING),
    ("myosuite_npg/myoHandBaodingFixed8th-v1/", GRADIENT_BAODING),
    ("myosuite_npg/myoHandBaodingRandom-v1/", GRADIENT_BAODING),
    // The hand in environments of MyoSuite that are not among the fourteen tasks.
    ("myosuite_npg/myoHandKeyTurnFixed-v0/", Policy(Format::NpgMlp, 93, 39, NONE)),
    ("myosuite_npg/myoHandKeyTurnRandom-v0/", Policy(Format::NpgMlp, 93, 39, NONE)),
    ("myosuite_npg/myoHandPoseFixed-v0/", Policy(Format::NpgMlp, 108, 39, NONE)),
    ("myosuite_npg/myoHandPoseRandom-v0/", Policy(Format::NpgMlp, 108, 39, NONE)),
    ("myosuite_npg/myoHandReachFixed-v0/", Policy(Format::NpgMlp, 115, 39, NONE)),
    ("myosuite_npg/myoHandReachRandom-v0/", Policy(Format::NpgMlp, 115, 39, NONE)),
    // Held objects happen to be observed by as many numbers as one fingertip: sizes cannot tell them apart.
    ("myosuite_npg/myoHandObjHoldFixed-v0/", Policy(Format::NpgMlp, 91, 39, REACH)),
    ("myosuite_npg/myoHandObjHoldRandom-v0/", Policy(Format::NpgMlp, 91, 39, REACH)),
    ("myosuite_npg/myoHandPenTwirlFixed-v0/", Policy(Format::NpgMlp, 83, 39, &["pen"])),
    ("myosuite_npg/myoHandPenTwirlRandom-v0/", Policy(Format::NpgMlp, 83, 39, &["pen"])),
    ("npg/ElbowPose1D6MRandom", ELBOW),
    ("npg/HandPenTwirlRandom", Policy(Format::NpgMlp, 83, 39, &["pen"])),
    ("npg/HandReachRandom", Policy(Format::NpgMlp, 115, 39, NONE)),
    ("myosuite_sar/locomotion/", Refused("an object of scikit-learn")),
    ("myosuite_sar/manipulation/", Refused("an object of scikit-learn")),
    // The weights of a file above once more, in a format that other programs read.
    ("baoding_phase1/", Refused("neither a zip archive nor a pickle")),
];
const RECURRENT_BAODING: Verdict = Policy(Format::RecurrentPpo, 86, 39, BAODING);
const GRADIENT_BAODING: Verdict = Policy(Format::NpgMlp, 86, 39, BAODING);
const ELBOW: Verdict = Policy(Format::NpgMlp, 9, 6, &["elbow_pose"]);

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| {
            ["zip", "pickle", "pkl", "pth", "pt"].iter().any(|known| extension == *known)
        }) {
            files.push(path);
        }
    }
}

fn task((name, observations, muscles): (&str, usize, usize)) -> TaskInterface {
    TaskInterface {
        task: name.to_owned(),
        muscle_count: muscles,
        muscle_observation_length: 0,
        clean_observation_length: observations,
        observation_words: Vec::new(),
        action_words: Vec::new(),
        muscle_models: Vec::new(),
    }
}

/// What differs from the expectation, if anything.
fn check(path: &Path, expected: &Verdict) -> Result<(), String> {
    let limits = Limits::default();
    match expected {
        Statistics(components) => match checkpoint::open_normaliser(path, &limits) {
            Ok(Normaliser::PerComponent(read)) if read.mean.len() == *components => Ok(()),
            other => Err(format!("{other:?}")),
        },
        Refused(words) => match policy::open(path, None) {
            Err(error) if error.to_string().contains(words) => Ok(()),
            Err(error) => Err(error.to_string()),
            Ok(_) => Err("was read".to_owned()),
        },
        Policy(format, observations, muscles, tasks) => {
            let loaded = policy::open(path, None).map_err(|error| error.to_string())?;
            let read = checkpoint::open(path, &limits).map_err(|error| error.to_string())?;
            let sizes = checkpoint::network_sizes(&read);
            let size =
                |name| sizes.iter().find(|(known, _)| *known == name).map(|(_, size)| size[0]);
            let found = (loaded.format, size("observations"), size("actions"));
            if found != (Some(*format), Some(*observations), Some(*muscles)) {
                return Err(format!("is {found:?}"));
            }
            for entry in TASKS {
                let fits = tasks.iter().any(|start| entry.0.starts_with(start));
                let bound = loaded.policy.bind(&task(entry), 1).map(|_| ());
                match bound {
                    Ok(()) if fits => {}
                    Err(error) if !fits && error.to_string().contains(entry.0) => {}
                    other => return Err(format!("{}: {other:?}", entry.0)),
                }
            }
            Ok(())
        }
    }
}

#[test]
fn every_published_checkpoint_plays_its_tasks_or_says_why_not() {
    let Some(folder) = checkpoints(".") else { return };
    let mut files = Vec::new();
    collect(&folder, &mut files);
    files.sort();
    let mut wrong = Vec::new();
    for path in &files {
        let name = path.strip_prefix(&folder).unwrap().to_string_lossy().replace('\\', "/");
        match EXPECTED.iter().find(|(start, _)| name.starts_with(start)) {
            Some((_, expected)) => {
                wrong.extend(check(path, expected).err().map(|error| format!("{name}: {error}")));
            }
            None => wrong.push(format!("{name}: nothing is expected of it")),
        }
    }
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
    // 66 baselines, 3 of them again, 2 + 4 + 1 recurrent and gradient policies, 4 refused bodies, …
    assert!(files.len() >= 90, "only {} files", files.len());
}

//! Bodies and tasks: recorded episodes of the published environments replay on this machine, a small recording that lies
//! in the repository does so for everybody, and a recording that was tampered with does not.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::fmt::Debug;
use std::io::{Cursor, Read, Write};
use std::path::{Path, PathBuf};
use std::str::FromStr;

use arnold_analyze::assets::PhysicsVersion;
use arnold_analyze::experiment::verify_traces::{TraceFile, find_traces, physics_of};
use arnold_analyze::policy::ObservationVariant;
use arnold_analyze::sim::engine::Names;
use arnold_analyze::sim::environment::Environment;
use arnold_analyze::sim::random::Random;
use arnold_analyze::sim::tasks::{self, Definition};
use common::bench::Bench;
use common::golden;
use common::physics::Physics;
use serde_json::{Value, json};

/// Replays whatever was recorded in `version`.
fn recorded_traces_agree(version: PhysicsVersion) {
    let Some(folder) = golden("env") else { return };
    let installed = Physics::of(version);
    let mut compared = 0;
    let mut failures = Vec::new();
    for trace in find_traces(&folder).unwrap() {
        match physics_of(&trace) {
            None => {
                eprintln!("skipped: no MuJoCo {} for `{}`", trace.physics, trace.path.display());
            }
            Some(physics) if physics != version => {}
            Some(_) => match installed.replay(&trace) {
                None => eprintln!("skipped: no task `{}` yet", trace.task),
                Some(report) => {
                    compared += 1;
                    assert!(report.steps > 0, "{report:?}");
                    if !report.agrees() {
                        failures.push(report);
                    }
                }
            },
        }
    }
    eprintln!("{compared} traces of MuJoCo {version} compared");
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(compared > 0, "no trace of MuJoCo {version} in `{}`", folder.display());
}

#[test]
fn recorded_traces_agree_in_the_published_physics() {
    recorded_traces_agree(PhysicsVersion::V2_3_7);
}

#[test]
fn recorded_traces_agree_in_the_current_physics() {
    recorded_traces_agree(PhysicsVersion::V3_17_0);
}

/// The recording that lies in the repository: made by this program once its traces agreed with the published ones.
const FIXTURE: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/fixtures/episodes.json");
/// What it holds: tasks and their numbers of steps.
const RECORDED: [(&str, usize); 2] = [("elbow_pose", 20), ("hand_index_reach", 5)];
/// Seeds of the recorded resets and actions.
const SEEDS: [[u8; 32]; 2] = [[1; 32], [2; 32]];

/// Numbers as text: decimal digits that give the same bits when read again.
fn text_of<T: ToString>(numbers: &[T]) -> String {
    numbers.iter().map(T::to_string).collect::<Vec<_>>().join(" ")
}

fn numbers_of<T: FromStr<Err: Debug>>(text: &Value) -> Vec<T> {
    text.as_str().unwrap().split(' ').map(|number| number.parse().unwrap()).collect()
}

fn observation(environment: &Environment) -> Vec<f32> {
    let variant = ObservationVariant::Muscle;
    let mut observation = vec![0.0; environment.observation_length(variant)];
    environment.read_observation(variant, &mut observation);
    observation
}

/// Positions and observation, as the fixture holds them.
fn frame(environment: &Environment) -> Value {
    let qpos = text_of(environment.simulation().qpos());
    json!({"qpos": qpos, "observation": text_of(&observation(environment))})
}

fn random_action(random: &mut Random, muscles: usize) -> Vec<f32> {
    (0..muscles).map(|_| random.uniform(-1.0, 1.0) as f32).collect()
}

#[test]
#[ignore = "rewrites the fixture: cargo test --release --test traces -- --ignored record_the_fixture"]
fn record_the_fixture() {
    let mut episodes = Vec::new();
    for physics in PhysicsVersion::ALL {
        let installed = Physics::of(physics);
        for (task, steps) in RECORDED {
            let mut body = installed.body(tasks::find(task).unwrap());
            let mut random = Random::new(SEEDS[1]);
            body.reset(&mut Random::new(SEEDS[0]));
            let start = frame(&body);
            let mut recorded = Vec::new();
            for _ in 0..steps {
                let action = random_action(&mut random, body.muscles().len());
                body.step(&action);
                let mut after = frame(&body);
                after["action"] = json!(text_of(&action));
                recorded.push(after);
            }
            episodes
                .push(json!({"task": task, "physics": physics, "start": start, "steps": recorded}));
        }
    }
    let text = serde_json::to_string_pretty(&json!({ "episodes": episodes })).unwrap() + "\n";
    arnold_analyze::files::write_atomic(Path::new(FIXTURE), text.as_bytes()).unwrap();
}

/// Bit for bit where the recording was made, elsewhere up to the rounding of another mathematical library.
fn same(found: f64, recorded: f64, rounding: f64) -> bool {
    if cfg!(all(target_os = "linux", target_arch = "x86_64")) {
        return found.to_bits() == recorded.to_bits();
    }
    (found - recorded).abs() <= rounding * recorded.abs().max(1.0)
}

fn assert_frame(environment: &Environment, recorded: &Value, what: &str) {
    let qpos = numbers_of::<f64>(&recorded["qpos"]);
    let found = environment.simulation().qpos();
    assert_eq!(found.len(), qpos.len(), "{what}");
    for (&found, recorded) in found.iter().zip(qpos) {
        assert!(same(found, recorded, 1e-12), "{what}: {found}, recorded {recorded}");
    }
    let seen = numbers_of::<f32>(&recorded["observation"]);
    let found = observation(environment);
    assert_eq!(found.len(), seen.len(), "{what}");
    for (element, (found, recorded)) in found.into_iter().zip(seen).enumerate() {
        let agrees = same(found.into(), recorded.into(), 1e-6);
        assert!(agrees, "{what}: observation {element} is {found}, recorded {recorded}");
    }
}

#[test]
fn the_recording_in_the_repository_replays() {
    let document: Value = serde_json::from_slice(&std::fs::read(FIXTURE).unwrap()).unwrap();
    let episodes = document["episodes"].as_array().unwrap();
    assert_eq!(episodes.len(), PhysicsVersion::ALL.len() * RECORDED.len());
    for episode in episodes {
        let physics: PhysicsVersion = episode["physics"].as_str().unwrap().parse().unwrap();
        let task = tasks::find(episode["task"].as_str().unwrap()).unwrap();
        let what = format!("{} in MuJoCo {physics}", task.name);
        let mut body = Physics::of(physics).body(task);
        body.reset(&mut Random::new(SEEDS[0]));
        assert_frame(&body, &episode["start"], &what);
        for (step, recorded) in episode["steps"].as_array().unwrap().iter().enumerate() {
            body.step(&numbers_of::<f32>(&recorded["action"]));
            assert_frame(&body, recorded, &format!("{what}, step {step}"));
        }
    }
}

/// One recorded elbow episode, if it is here.
fn elbow_trace() -> Option<TraceFile> {
    let traces = find_traces(&golden("env")?).unwrap();
    let found = traces.into_iter().find(|t| t.task == "elbow_pose" && t.physics == "2.3.7");
    Some(found.expect("a recorded elbow episode"))
}

/// Copies `trace` into `folder` with the array `name` changed by `edit`, which gets the bytes of its elements.
fn copy_changed(trace: &TraceFile, folder: &Path, name: &str, edit: impl Fn(&mut [u8])) -> PathBuf {
    let copy = folder.join(trace.path.file_name().unwrap());
    let description = std::fs::read(trace.path.with_extension("json")).unwrap();
    arnold_analyze::files::write_atomic(&copy.with_extension("json"), &description).unwrap();
    let mut archive = zip::ZipArchive::new(std::fs::File::open(&trace.path).unwrap()).unwrap();
    let mut writer = zip::ZipWriter::new(Cursor::new(Vec::new()));
    let mut changed = false;
    for index in 0..archive.len() {
        let mut member = archive.by_index(index).unwrap();
        let member_name = member.name().unwrap().into_owned();
        let mut content = Vec::new();
        member.read_to_end(&mut content).unwrap();
        if member_name == format!("{name}.npy") {
            let header = 10 + usize::from(u16::from_le_bytes([content[8], content[9]]));
            edit(&mut content[header..]);
            changed = true;
        }
        writer.start_file(member_name, zip::write::SimpleFileOptions::default()).unwrap();
        writer.write_all(&content).unwrap();
    }
    assert!(changed, "the trace has no array `{name}`");
    let bytes = writer.finish().unwrap().into_inner();
    arnold_analyze::files::write_atomic(&copy, &bytes).unwrap();
    copy
}

/// Adds `difference` to the 64-bit number in the middle of an array.
fn nudge(bytes: &mut [u8], difference: f64) {
    let numbers = bytes.as_chunks_mut::<8>().0;
    let middle = numbers.len() / 2;
    numbers[middle] = (f64::from_le_bytes(numbers[middle]) + difference).to_le_bytes();
}

/// Turns a 64-bit flag in the middle of an array.
fn flip(bytes: &mut [u8]) {
    let numbers = bytes.as_chunks_mut::<8>().0;
    let middle = numbers.len() / 2;
    numbers[middle] = (1.0 - f64::from_le_bytes(numbers[middle])).to_le_bytes();
}

/// What was changed in a recording, the array that holds it, and how.
type Tampering = (&'static str, &'static str, fn(&mut [u8]));

#[test]
fn a_recording_that_was_changed_anywhere_is_refused_by_name() {
    let Some(trace) = elbow_trace() else { return };
    let physics = Physics::of(PhysicsVersion::V2_3_7);
    let bench = Bench::new();
    let tampered: [Tampering; 7] = [
        ("an angle by 1e-9 rad", "qpos", |bytes| nudge(bytes, 1e-9)),
        ("an angle by one unit in its last place", "qpos", |bytes| {
            let middle = bytes.len() / 16 * 8;
            bytes[middle] ^= 1;
        }),
        ("the time by 1e-12 s", "time", |bytes| nudge(bytes, 1e-12)),
        ("an observation by a tenth", "obs", |bytes| {
            let numbers = bytes.as_chunks_mut::<4>().0;
            let middle = numbers.len() / 2;
            let value = f32::from_le_bytes(numbers[middle]);
            numbers[middle] = (value + 0.1).to_le_bytes();
        }),
        ("a solved flag", "rwd_solved", flip),
        ("a reward", "reward", |bytes| nudge(bytes, 1e-3)),
        ("an end of the episode", "terminated", |bytes| bytes[7] ^= 1),
    ];
    for (place, (what, array, edit)) in tampered.into_iter().enumerate() {
        let folder = bench.path(&place.to_string());
        let path = copy_changed(&trace, &folder, array, edit);
        let report = physics.replay(&TraceFile { path, ..trace.clone() });
        assert!(!report.unwrap().agrees(), "{what} went unnoticed");
    }

    let name = trace.path.file_stem().unwrap().to_string_lossy().into_owned();
    let ended = bench.run(&["verify", "traces", "0"]);
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    let line = ended.stdout.lines().find(|line| line.contains(&name)).unwrap();
    assert!(line.ends_with("FAILED"), "{line}");
    assert!(ended.stdout.contains("0 of 1 traces agree"), "{}", ended.stdout);
    assert!(ended.stderr.starts_with("error: ") || ended.stderr.contains("\nerror: "));

    copy_changed(&trace, &bench.path("untouched"), "qpos", |_| ());
    let document = bench.json(&["verify", "traces", "untouched", "--json"]);
    assert_eq!((&document["agree"], &document["differ"]), (&json!(1), &json!(0)));
}

#[test]
fn a_recording_of_an_unknown_task_is_skipped_and_said() {
    let bench = Bench::new();
    bench.write("juggling_mj2.3.7_s0.npz", b"");
    let ended = bench.run(&["verify", "traces", "."]);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("juggling_mj2.3.7_s0: `juggling` is not a task here"));
}

/// Positions of the two Baoding targets in the palm's plane.
fn targets(body: &Environment) -> [[f64; 2]; 2] {
    ["target1_site", "target2_site"].map(|name| {
        let site = body.simulation().find(Names::Site, name).unwrap();
        let position = &body.simulation().model_site_pos()[3 * site..];
        [position[0], position[1]]
    })
}

#[test]
fn the_first_baoding_observation_shows_the_targets_of_the_last_step_before() {
    use std::f64::consts::{FRAC_PI_4, PI, TAU};
    let physics = Physics::of(PhysicsVersion::V2_3_7);
    for (task, sign) in [("baoding_p1_cw", -1.0), ("baoding_p1_ccw", 1.0)] {
        let task = tasks::find(task).unwrap();
        let mut body = physics.body(task);
        body.reset(&mut Random::new(SEEDS[0]));
        // One turn takes 5 s; the targets start at 3π/4 and opposite to it.
        let phase = sign * TAU * 0.025 / 5.0 * (task.horizon - 1) as f64 + 3.0 * FRAC_PI_4;
        let stale = targets(&body);
        for (target, angle) in stale.iter().zip([phase, phase - PI]) {
            let expected = [0.025 * angle.cos() - 0.0125, 0.028 * angle.sin() - 0.07];
            for axis in 0..2 {
                assert!((target[axis] - expected[axis]).abs() < 1e-12, "{target:?} {expected:?}");
            }
        }
        // They are what is observed, in the world.
        let seen = observation(&body);
        for (key, name) in [("target1_pos", "target1_site"), ("target2_pos", "target2_site")] {
            let site = body.simulation().find(Names::Site, name).unwrap();
            let world = &body.simulation().site_positions()[3 * site..][..3];
            let place = body.task().layout().range(key).unwrap();
            let world: Vec<f32> = world.iter().map(|&x| x as f32).collect();
            assert_eq!(&seen[place], world);
        }
        // The first step puts them where the episode starts, the last one where the next reset finds them.
        let rest = vec![0.0; body.muscles().len()];
        body.step(&rest);
        let first = [3.0 * FRAC_PI_4, -FRAC_PI_4];
        for (target, angle) in targets(&body).iter().zip(first) {
            assert!((target[0] - (0.025 * angle.cos() - 0.0125)).abs() < 1e-12, "{target:?}");
        }
        for _ in 1..task.horizon {
            body.step(&rest);
        }
        assert_eq!(targets(&body).map(|t| t.map(f64::to_bits)), stale.map(|t| t.map(f64::to_bits)));
    }
}

/// Every number of an episode's first steps.
fn episode_bits(body: &mut Environment, seed: u8) -> Vec<u64> {
    let mut random = Random::new([seed; 32]);
    body.reset(&mut random);
    let mut bits = Vec::new();
    let mut note = |body: &Environment, reward: f64| {
        bits.extend(observation(body).into_iter().map(|x| u64::from(x.to_bits())));
        bits.extend(body.simulation().qpos().iter().map(|x| x.to_bits()));
        bits.push(reward.to_bits());
    };
    note(body, 0.0);
    for _ in 0..4 {
        let action = random_action(&mut random, body.muscles().len());
        let outcome = body.step(&action);
        note(body, outcome.reward);
    }
    bits
}

#[test]
fn an_episode_does_not_depend_on_what_its_body_played_before() {
    let physics = Physics::of(PhysicsVersion::V2_3_7);
    let differs = |task: &'static Definition| {
        let mut used = physics.body(task);
        let first = episode_bits(&mut used, 1);
        assert_ne!(first, episode_bits(&mut used, 2), "{}", task.name);
        first != episode_bits(&mut used, 1) || first != episode_bits(&mut physics.body(task), 1)
    };
    let failures: Vec<&str> =
        tasks::every().filter(|task| differs(task)).map(|task| task.name).collect();
    assert!(failures.is_empty(), "{failures:?}");
}

//! Training as a process: the same run gives the same bytes on any number of threads and through any kill; what it writes
//! is read back; what makes no sense is refused with the way out.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeMap;
use std::process::Stdio;
use std::time::Duration;

use arnold_analyze::policy;
use arnold_analyze::record::{Values, read_event_run, read_parquet};
use arnold_analyze::sim::tasks;
use common::bench::{Bench, files_below};
use common::physics::elbow_policy;
use serde_json::Value;

/// A run so small that it takes a second: 4 environments, 16 iterations, 8 checkpoints. Episodes last over three rollouts,
/// so that every checkpoint lies within an episode.
const TINY: [&str; 12] = [
    "--task",
    "elbow_pose",
    "--steps",
    "2048",
    "--checkpoint-steps",
    "256",
    "--evaluation-episodes",
    "2",
    "--envs",
    "4",
    "--set",
    "rollout_steps=32",
];

fn words<'a>(regime: &'a [&'a str], threads: &'a str, out: &'a str) -> Vec<&'a str> {
    let place = ["--threads", threads, "--out", out, "--json", "--quiet"];
    [&["train"], regime, &TINY, &["--set", "minibatch=64", "--set", "epochs=2"], &place].concat()
}

/// All files of the run in `out`, without the event file, which holds times.
fn files(bench: &Bench, out: &str) -> BTreeMap<String, Vec<u8>> {
    let mut files = files_below(&bench.path(out));
    files.retain(|name, _| !name.starts_with("events."));
    files
}

fn assert_same(one: &BTreeMap<String, Vec<u8>>, other: &BTreeMap<String, Vec<u8>>, what: &str) {
    assert!(one.keys().eq(other.keys()), "{what}: {:?} and {:?}", one.keys(), other.keys());
    for (name, bytes) in one {
        assert!(*bytes == other[name], "{what}: `{name}` has other bytes");
    }
}

/// A run of two tasks as small: 4 environments, 6 iterations, 3 checkpoints.
const TINY_OF_TWO: [&str; 12] = [
    "--task",
    "elbow_pose,hand_index_reach",
    "--steps",
    "768",
    "--checkpoint-steps",
    "256",
    "--evaluation-episodes",
    "1",
    "--envs",
    "2",
    "--set",
    "rollout_steps=32",
];

/// What `words` is for one task.
fn words_of_two<'a>(regime: &'a [&'a str], threads: &'a str, out: &'a str) -> Vec<&'a str> {
    let place = ["--threads", threads, "--out", out, "--json", "--quiet"];
    [&["train"], regime, &TINY_OF_TWO, &["--set", "minibatch=64"], &place].concat()
}

/// Whatever is trained on one task, after `first` steps.
fn same_bytes(regime: &[&str], first: i64) {
    let expected: Vec<i64> = (1..=16).map(|i| first + 128 * i).collect();
    same_bytes_of(&|threads, out| words(regime, threads, out).join("\n"), &expected);
}

/// The same bytes with one thread and three, and after kills at any moment. `line` gives the command by threads and folder, a
/// word in a line; `expected` are the steps at the end of all iterations.
fn same_bytes_of(line: &dyn Fn(&str, &str) -> String, expected: &[i64]) {
    let bench = Bench::new();
    let json = |threads, out| bench.json(&line(threads, out).lines().collect::<Vec<_>>());
    json("1", "undisturbed");
    let undisturbed = files(&bench, "undisturbed");
    assert!(undisturbed.contains_key("final_model.safetensors"), "{:?}", undisturbed.keys());
    json("3", "threads");
    assert_same(&undisturbed, &files(&bench, "threads"), "three threads");
    let mut wait = 40;
    let killed = loop {
        let line = line("2", "killed");
        let mut command = bench.command(&line.lines().collect::<Vec<_>>());
        let mut child = command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(wait));
        if let Some(status) = child.try_wait().unwrap() {
            assert!(status.success());
            break files(&bench, "killed");
        }
        child.kill().unwrap();
        child.wait().unwrap();
        // Sooner or later it lives long enough to end, wherever it was killed before.
        wait += wait / 4 + 7;
    };
    let killed: BTreeMap<_, _> =
        killed.into_iter().filter(|(name, _)| !name.starts_with(".tmp")).collect();
    assert_same(&undisturbed, &killed, "killed again and again");
    let events = read_event_run(&bench.path("killed")).unwrap();
    assert!(events.damaged.is_empty());
    let steps: Vec<i64> = events.solved().unwrap().points.iter().map(|p| p.step).collect();
    assert_eq!(steps, expected, "every iteration once");
}

#[test]
fn a_perceptron_that_learns_from_rewards_gives_the_same_bytes_however_it_runs() {
    same_bytes(&["ppo"], 0);
}

#[test]
fn a_transformer_that_learns_from_a_teacher_gives_the_same_bytes_however_it_runs() {
    let teacher = elbow_policy().display().to_string();
    let led = ["--set", "teacher_leads=0.5"];
    same_bytes(&[&["obc", "--network", "xs", "--teacher", &teacher][..], &led].concat(), 0);
}

#[test]
fn a_perceptron_of_two_tasks_gives_the_same_bytes_however_it_runs() {
    let regime = ["mt-ppo", "--set", "epochs=2", "--set", "network.perceptron.hidden=[32]"];
    let expected: Vec<i64> = (1..=6).map(|i| 128 * i).collect();
    same_bytes_of(&|threads, out| words_of_two(&regime, threads, out).join("\n"), &expected);
}

/// A soft actor-critic so small that its buffer goes round.
const SOFT: [&str; 11] = [
    "mt-sac",
    "--task-index",
    "--set",
    "start_steps=64",
    "--set",
    "buffer=512",
    "--set",
    "updates=20",
    "--set",
    "network.hidden=[24,24]",
    "--learning-rate=1e-3",
];

#[test]
fn a_soft_actor_critic_gives_the_same_bytes_however_it_runs() {
    // It begins with 64 steps at random.
    let expected: Vec<i64> = (0..=6).map(|i| 64 + 128 * i).collect();
    same_bytes_of(&|threads, out| words_of_two(&SOFT, threads, out).join("\n"), &expected);
}

#[test]
fn a_soft_actor_critic_leaves_a_policy_that_plays_and_only_its_newest_buffer() {
    let bench = Bench::new();
    let document = bench.json(&words_of_two(&SOFT, "2", "run"));
    let policy = document["policy"].as_str().unwrap();
    let play = ["--task", "hand_index_reach", "--episodes", "2", "--quiet", "--json"];
    let evaluated = bench.json(&[&["evaluate", "--policy", policy], &play[..]].concat());
    assert_eq!(evaluated["tasks"]["hand_index_reach"]["solved_fraction"]["n"], 2);
    let buffers: Vec<String> =
        files(&bench, "run").into_keys().filter(|name| name.starts_with("replay_")).collect();
    assert_eq!(buffers, ["replay_832.bin"]);
    assert!(curve(&bench, "run", "train/critic_loss")[1..].iter().all(|loss| *loss > 0.0));
    let temperatures = curve(&bench, "run", "train/ent_coef");
    assert!((temperatures[0] - 1.0).abs() < 1e-12, "nothing is learned at random");
    assert!(temperatures[6] < 1.0, "a new policy is more random than is wanted: {temperatures:?}");

    // A damaged buffer is refused, and the run it belongs to stays as it is.
    let path = bench.path("run/replay_832.bin");
    let mut bytes = std::fs::read(&path).unwrap();
    let middle = bytes.len() / 2;
    bytes[middle] ^= 1;
    bench.write("run/replay_832.bin", &bytes);
    let longer = words_of_two(&SOFT, "2", "run").join("\n").replace("\n768\n", "\n1024\n");
    let refused = bench.run(&longer.lines().collect::<Vec<_>>());
    assert_eq!(refused.code, 1);
    assert!(
        refused.stderr.contains("the stored replay buffer cannot belong"),
        "{}",
        refused.stderr
    );
}

#[test]
fn published_statistics_of_the_soft_actor_critic_are_another_run() {
    let bench = Bench::new();
    let short = |regime: &[&str], out: &str| {
        words_of_two(regime, "2", out).join("\n").replace("\n768\n", "\n320\n")
    };
    bench.json(&short(&SOFT, "own").lines().collect::<Vec<_>>());
    let averaged = [&SOFT[..], &["--set", "averaged_statistics=true"]].concat();
    bench.json(&short(&averaged, "averaged").lines().collect::<Vec<_>>());
    // What is played at random is the same; what is learned from it is not.
    let [own, averaged] = ["own", "averaged"].map(|out| curve(&bench, out, "train/critic_loss")[1]);
    assert!((own / averaged - 1.0).abs() > 1e-3, "{own}, {averaged}");
}

/// A column of the curves of the run in `out`.
fn curve(bench: &Bench, out: &str, name: &str) -> Vec<f64> {
    let (table, _) = read_parquet(&bench.path(out).join("curves.parquet")).unwrap();
    match &table.column(name).unwrap().values {
        Values::Floats(values) => values.clone(),
        other => panic!("`{name}` is {other:?}"),
    }
}

#[test]
fn a_run_that_begins_with_another_gives_the_same_bytes_however_it_runs() {
    let bench = Bench::new();
    let teacher = elbow_policy().display().to_string();
    bench.json(&words(&["obc", "--network", "xs", "--teacher", &teacher], "2", "base"));
    let base = bench.path("base").display().to_string();
    same_bytes(&["fine-tune", "--from", &base], 2048);

    bench.json(&words(&["fine-tune", "--from", &base], "2", "fine"));
    let (deviations, rates) =
        (curve(&bench, "fine", "train/std"), curve(&bench, "fine", "train/learning_rate"));
    assert!((deviations[0] / (-6.9_f64).exp() - 1.0).abs() < 1e-2, "{deviations:?}");
    assert!(rates.iter().all(|rate| (rate - 2e-6).abs() < 1e-12), "{rates:?}");
    let bytes = std::fs::read(bench.path("fine/args.json")).unwrap();
    let arguments: Value = serde_json::from_slice(&bytes).unwrap();
    assert_eq!(arguments["start"]["steps"], 2048);

    // At next to no learning rate, distilling ends with the parameters that it began with.
    let slow = ["distill", "--from", &base, "--teacher", &teacher, "--learning-rate", "1e-12"];
    bench.json(&words(&slow, "2", "distilled"));
    let tensors = |out: &str| {
        let file = bench.path(out).join("final_model.safetensors");
        policy::read_stored(&file).unwrap().checkpoint.tensors
    };
    let (before, after) = (tensors("base"), tensors("distilled"));
    assert!(before.keys().eq(after.keys()));
    for (name, tensor) in before {
        let pairs = tensor.data.iter().zip(&after[&name].data);
        assert!(pairs.clone().all(|(a, b)| (a - b).abs() < 1e-6), "{name}");
    }
}

#[test]
fn a_run_that_begins_with_a_file_alone_starts_its_optimiser_anew_and_says_so() {
    let bench = Bench::new();
    bench.json(&words(&["ppo"], "2", "base"));
    std::fs::copy(bench.path("base/final_model.safetensors"), bench.path("alone.safetensors"))
        .unwrap();
    let alone = bench.path("alone.safetensors").display().to_string();
    let regime = ["ppo", "--from", &alone];
    let mut arguments = words(&regime, "2", "more");
    arguments.retain(|word| *word != "--quiet");
    let ended = bench.run(&arguments);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert!(ended.stderr.contains("the optimiser starts anew"), "{}", ended.stderr);
    let refused = bench.run(&["train", "distill", "--task", "elbow_pose", "--quiet"]);
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("--from"), "{}", refused.stderr);
}

#[test]
fn control_subspaces_leave_curves_that_can_be_drawn_whatever_the_threads() {
    let bench = Bench::new();
    let teacher = elbow_policy().display().to_string();
    for threads in ["1", "2"] {
        let numbers = ["--dimensions", "1,6", "--subspace-episodes", "4"];
        let episodes = ["--result-episodes", "10", "--steps", "256"];
        let regime = [&["csi", "--teacher", &teacher][..], &numbers, &episodes].concat();
        let mut arguments = words(&regime, threads, threads);
        let given = arguments.iter().rposition(|word| *word == "--steps").unwrap();
        arguments.drain(given..given + 2);
        let document = bench.json(&arguments);
        assert_eq!(document["results"].as_array().unwrap().len(), 6);
    }
    let results = |out: &str| {
        let mut files = files(&bench, out);
        files.retain(|name, _| !name.ends_with("/args.json") && !name.contains("events."));
        files
    };
    assert_same(&results("1"), &results("2"), "two threads");
    let benchmarks = bench.path("1/benchmarks").display().to_string();
    let drawn = ["evaluate", "--benchmarks", &benchmarks, "--out", "drawn", "--quiet", "--json"];
    bench.json(&drawn);
    let drawn = files_below(&bench.path("drawn"));
    assert!(drawn.keys().any(|name| name.contains("csi")), "{:?}", drawn.keys());
}

#[test]
fn a_run_leaves_a_policy_that_plays_and_curves_that_can_be_read() {
    let bench = Bench::new();
    let document = bench.json(&words(&["ppo"], "2", "run"));
    assert_eq!(document["steps"], 2048);
    let policy = bench.path(document["policy"].as_str().unwrap());
    let loaded = policy::open(&policy, None).unwrap();
    assert!(loaded.warnings.is_empty(), "{:?}", loaded.warnings);
    let path = policy.display().to_string();
    let play = ["--task", "elbow_pose", "--episodes", "3", "--quiet", "--json"];
    let evaluated = bench.json(&[&["evaluate", "--policy", &path], &play[..]].concat());
    assert_eq!(evaluated["tasks"]["elbow_pose"]["solved_fraction"]["n"], 3);
    let (table, _) = read_parquet(&bench.path("run/curves.parquet")).unwrap();
    assert_eq!(table.row_count(), 16);
    let Values::Floats(solved) = &table.column("elbow_pose/solved").unwrap().values else {
        panic!("solved fractions are numbers")
    };
    assert!(solved.iter().all(|x| (0.0..=1.0).contains(x)));
    let Values::Floats(evaluated) =
        &table.column("evaluation/elbow_pose/solved_fraction").unwrap().values
    else {
        panic!("evaluations are numbers")
    };
    assert_eq!(evaluated.iter().filter(|x| x.is_finite()).count(), 8);
}

#[test]
fn a_finished_run_may_be_made_longer_and_a_folder_with_another_run_is_left_alone() {
    let bench = Bench::new();
    bench.json(&words(&["ppo"], "1", "run"));
    let before = files(&bench, "run");
    let refused = bench.run(&[words(&["ppo"], "1", "run"), vec!["--seed", "7"]].concat());
    assert_eq!(refused.code, 1);
    assert!(refused.stderr.contains("seed is 0, not 7"), "{}", refused.stderr);
    assert_same(&before, &files(&bench, "run"), "a refused run");
    let longer: Vec<&str> = words(&["ppo"], "1", "run")
        .into_iter()
        .map(|word| if word == "2048" { "2304" } else { word })
        .collect();
    let document = bench.json(&longer);
    assert_eq!(document["steps"], 2304);
}

#[test]
fn exploration_that_has_a_schedule_follows_it_and_that_of_a_lattice_has_none() {
    let bench = Bench::new();
    let schedule = ["--set", r#"log_deviation={"linear":{"from":-1.0,"to":-3.0}}"#];
    bench.json(&words(&[&["ppo"][..], &schedule].concat(), "2", "run"));
    let found = curve(&bench, "run", "train/std");
    assert_eq!(found.len(), 16);
    for (iteration, deviation) in found.iter().enumerate() {
        let expected = (-1.0 - 2.0 * iteration as f64 / 16.0).exp();
        assert!((deviation / expected - 1.0).abs() < 1e-6, "{iteration}: {deviation}, {expected}");
    }
    let lattice = ["--set", "network.perceptron.lattice=true", "--task", "elbow_pose"];
    let ended = bench.run(&[&["train", "ppo"][..], &schedule, &lattice].concat());
    assert_eq!(ended.code, 1, "{}", ended.stderr);
    assert!(ended.stderr.contains("a lattice is learned"), "{}", ended.stderr);
}

#[test]
fn what_makes_no_sense_is_refused_with_the_way_out() {
    let bench = Bench::new();
    let elbow = ["--task", "elbow_pose", "--quiet"];
    let teacher = elbow_policy().display().to_string();
    let cases: [(&[&str], &str); 12] = [
        (&["ppo", "--task-index"], "`--task-index` does not belong to `train ppo`"),
        (&["mt-ppo", "--network", "xs"], "trains a perceptron of its own"),
        (&["mt-ppo", "--teacher", &teacher], "asks no teacher"),
        (&["mt-sac", "--from", &teacher], "begins with nothing but its own folder"),
        (&["mt-sac", "--set", "lambda=0.9"], "there is no such constant"),
        (&["mt-sac", "--set", "buffer=many"], "--set buffer=many"),
        (&["ppo", "--set", "discount"], "there is no `=`"),
        (&["ppo", "--set", "discounts=1"], "there is no such constant"),
        (&["ppo", "--set", "discount=much"], "--set discount=much"),
        (&["ppo", "--teacher", &teacher], "asks no teacher"),
        (&["obc"], "no teacher for `elbow_pose`"),
        (&["obc", "--teacher", "hand_pose=x"], "`hand_pose` is not trained on"),
    ];
    for (words, complaint) in cases {
        let ended = bench.run(&[&["train"], words, &elbow].concat());
        assert_eq!(ended.code, 1, "{words:?}: {}", ended.stderr);
        assert!(ended.stderr.contains(complaint), "{words:?}: {}", ended.stderr);
        assert!(ended.stderr.contains("hint:"), "{words:?}: {}", ended.stderr);
    }
    let two = ["train", "ppo", "--task", "elbow_pose,hand_index_reach", "--quiet"];
    let ended = bench.run(&two);
    assert!(ended.stderr.contains("a perceptron learns one task, not 2"), "{}", ended.stderr);
    assert!(tasks::find("elbow_pose").is_ok());
}

#[test]
fn the_arguments_of_a_run_say_everything_that_decides_it() {
    let bench = Bench::new();
    let teacher = elbow_policy().display().to_string();
    bench.json(&words(&["obc", "--teacher", &teacher], "2", "run"));
    let bytes = std::fs::read(bench.path("run/args.json")).unwrap();
    let arguments: Value = serde_json::from_slice(&bytes).unwrap();
    assert_eq!(arguments["tasks"][0], "elbow_pose");
    assert_eq!(arguments["environments"][0], 4);
    assert_eq!(arguments["recipe"]["rollout_steps"], 32);
    assert_eq!(arguments["recipe"]["coefficients"]["imitation"], 1.0);
    assert_eq!(arguments["teachers"][0]["blake3"].as_str().unwrap().len(), 65);
    assert!(arguments.get("threads").is_none());
}

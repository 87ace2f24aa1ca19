//! A sweep that is cut up, killed and damaged gives the same bytes as one that nobody disturbed.
//!
//! On the elbow task, whose episodes last a few milliseconds: what is tested is the bookkeeping, and that is the same for
//! every task.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeMap;
use std::path::Path;
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use arnold_analyze::experiment::ledger::Ledger;
use arnold_analyze::experiment::plan::Plan;
use arnold_analyze::sim::rollout::{Episode, Recording};
use common::bench::{Bench, files_below};
use serde_json::Value;

/// Two stages, two bases of curves, more episodes than bodies.
const CSI: [&str; 8] = [
    "csi",
    "--task",
    "elbow_pose,myosuite_elbow_pose",
    "--episodes",
    "40",
    "--components",
    "1-3,5",
    "--quiet",
];

/// The results in a run folder: every file that its manifest names.
fn results(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let manifest: Value =
        serde_json::from_slice(&std::fs::read(folder.join("manifest.json")).unwrap()).unwrap();
    let names = manifest["files"].as_array().unwrap().iter();
    let names = names.map(|file| file["name"].as_str().unwrap().to_owned());
    names.map(|name| (name.clone(), std::fs::read(folder.join(&name)).unwrap())).collect()
}

/// The results of `words` run in one go.
fn undisturbed(bench: &Bench, words: &[&str]) -> BTreeMap<String, Vec<u8>> {
    let document = bench.json(&[words, &["--out", "undisturbed", "--json"]].concat());
    let folder = document["folder"].as_str().unwrap().to_owned();
    let found = files_below(Path::new(&folder));
    assert!(found.keys().all(|name| !name.contains("ledger")), "{:?}", found.keys());
    results(Path::new(&folder))
}

fn assert_same(found: &BTreeMap<String, Vec<u8>>, expected: &BTreeMap<String, Vec<u8>>, how: &str) {
    assert!(found.keys().eq(expected.keys()), "{how}: {:?}", found.keys());
    for (name, bytes) in found {
        assert!(*bytes == expected[name], "{how}: `{name}` has other bytes");
    }
}

fn plan(bench: &Bench, folder: &str, words: &[&str]) {
    bench.json(&[&["plan", "--json", "--quiet", "--out", folder], words].concat());
}

fn gathered(bench: &Bench, folder: &str) -> BTreeMap<String, Vec<u8>> {
    bench.json(&["gather", folder, "--json", "--quiet"]);
    results(&bench.path(folder))
}

/// Starts a worker that nobody listens to.
fn start(bench: &Bench, words: &[&str]) -> Child {
    let mut command = bench.command(words);
    command.stdin(Stdio::null()).stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
}

/// Bytes of all ledgers so far.
fn written(folder: &Path) -> u64 {
    let entries = std::fs::read_dir(folder.join("ledger")).into_iter().flatten();
    entries.map(|entry| entry.unwrap().metadata().unwrap().len()).sum()
}

/// Waits until the ledgers have grown by `bytes`, or the worker has ended.
fn wait_for_growth(folder: &Path, child: &mut Child, bytes: u64) {
    let (start, before) = (Instant::now(), written(folder));
    while written(folder) < before + bytes && child.try_wait().unwrap().is_none() {
        assert!(start.elapsed() < Duration::from_mins(2), "nothing is being played");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A number that looks random and is the same every time: a linear congruential generator.
fn next(state: &mut u64) -> u64 {
    *state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
    *state >> 33
}

#[test]
fn shards_in_any_order_with_any_threads_and_batch_give_the_same_bytes() {
    let bench = Bench::new();
    let expected = undisturbed(&bench, &CSI);
    for (count, threads, batch, order) in [
        (3, "2", "16", vec![3, 1, 2]),
        (7, "1", "1", vec![2, 7, 4, 1, 6, 3, 5]),
        (1, "1", "16", vec![1]),
    ] {
        let folder = format!("shards{count}");
        plan(&bench, &folder, &CSI);
        for number in order {
            let shard = format!("{number}/{count}");
            let way = ["--shard", &shard, "--threads", threads, "--batch", batch];
            bench.json(&[&["work", &folder, "--json", "--quiet"], &way[..]].concat());
        }
        assert_same(&gathered(&bench, &folder), &expected, &folder);
    }
    let status = bench.json(&["status", "shards7", "--json"]);
    assert_eq!(
        (&status["missing"], &status["twice"], &status["failed"]),
        (&0.into(), &0.into(), &0.into())
    );
}

#[test]
fn shards_share_the_factorisations_they_make() {
    let bench = Bench::new();
    let words = ["csi", "--task", "elbow_pose,myosuite_elbow_pose", "--basis", "nmf"];
    let words = [&words[..], &["--episodes", "20", "--n-fits", "2", "--quiet"]].concat();
    let expected = undisturbed(&bench, &words);
    plan(&bench, "synergies", &words);
    let bases = bench.path("synergies/bases");
    let count = || arnold_analyze::files::list(&bases).unwrap().len();
    bench.json(&["work", "synergies", "--shard", "2/3", "--json", "--quiet"]);
    let some = count();
    for number in ["1/3", "3/3"] {
        bench.json(&["work", "synergies", "--shard", number, "--json", "--quiet"]);
    }
    // Two tasks and their pool, one to five synergies, two fits of each.
    assert_eq!(count(), 3 * 5 * 2);
    assert!(some < count(), "the first shard made them all");
    assert_same(&gathered(&bench, "synergies"), &expected, "three shards");
    assert_eq!(count(), 3 * 5 * 2);
}

#[test]
fn twenty_kills_at_any_moment_change_no_byte() {
    let bench = Bench::new();
    let expected = undisturbed(&bench, &CSI);
    plan(&bench, "killed", &CSI);
    let folder = bench.path("killed");
    let mut random = 1;
    for kill in 0..20 {
        let shard = format!("{}/3", 1 + next(&mut random) % 3);
        let batch = ["1", "16"][next(&mut random) as usize % 2];
        let mut worker = start(&bench, &["work", "killed", "--shard", &shard, "--batch", batch]);
        wait_for_growth(&folder, &mut worker, next(&mut random) % 3000);
        worker.kill().unwrap();
        worker.wait().unwrap();
        if kill % 5 == 4 {
            spoil(&folder.join("ledger"), &mut random);
        }
    }
    bench.json(&["work", "killed", "--json", "--quiet"]);
    assert_same(&gathered(&bench, "killed"), &expected, "after twenty kills");
    let status = bench.json(&["status", "killed", "--json"]);
    assert_eq!((&status["missing"], &status["different"]), (&0.into(), &0.into()));
    assert!(status["failed"].as_u64().unwrap() > 0, "nothing was spoiled: {status}");
}

/// Changes a byte somewhere in the middle of a ledger, and cuts the end off another.
fn spoil(ledgers: &Path, random: &mut u64) {
    let mut logs = arnold_analyze::files::list(ledgers).unwrap();
    logs.retain(|path| path.extension().unwrap() == "log" && path.metadata().unwrap().len() > 100);
    for cut in [false, true] {
        let path = &logs[next(random) as usize % logs.len()];
        let mut bytes = std::fs::read(path).unwrap();
        if cut {
            bytes.truncate(bytes.len() - 7);
        } else {
            let place = next(random) as usize % bytes.len();
            bytes[place] ^= 0x15;
        }
        arnold_analyze::files::write_atomic(path, &bytes).unwrap();
    }
}

#[test]
fn a_killed_command_goes_on_where_it_was_and_leaves_only_its_results() {
    let bench = Bench::new();
    for words in [&CSI[..], &["rollout", "--task", "elbow_pose", "--episodes", "60", "--quiet"]] {
        let expected = undisturbed(&bench, words);
        let again = [words, &["--out", "again", "--json"]].concat();
        let runs = bench.path("again");
        let folder = || {
            let found = arnold_analyze::files::list(&runs).unwrap_or_default();
            found
                .into_iter()
                .find(|path| path.file_name().unwrap().to_str().unwrap().starts_with(words[0]))
        };
        let mut child = start(&bench, &again);
        let patience = Instant::now();
        while folder().is_none_or(|folder| written(&folder) == 0)
            && child.try_wait().unwrap().is_none()
        {
            assert!(patience.elapsed() < Duration::from_mins(2), "nothing is being played");
            std::thread::sleep(Duration::from_millis(1));
        }
        child.kill().unwrap();
        child.wait().unwrap();
        let folder = folder().unwrap();
        assert!(!folder.join("manifest.json").exists(), "killed too late: {words:?}");
        let half = bench.json(&["status", folder.to_str().unwrap(), "--json"]);
        assert!(half["done"].as_u64() > Some(0), "{half}");
        let left: Vec<&str> = again.iter().copied().filter(|word| *word != "--quiet").collect();
        let ended = bench.run(&left);
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        assert!(ended.stderr.contains("episodes are played already"), "{}", ended.stderr);
        assert_same(&results(&folder), &expected, words[0]);
        let names: Vec<String> = files_below(&folder).into_keys().collect();
        assert_eq!(names.len(), expected.len() + 1, "{names:?}");
        let ended = bench.run(&left);
        assert!(ended.stderr.contains("Already done"), "{}", ended.stderr);
    }
}

#[cfg(unix)]
#[test]
fn a_signal_ends_between_two_episodes_and_loses_none() {
    let bench = Bench::new();
    let words = [
        "evaluate",
        "--task",
        "elbow_pose",
        "--episodes",
        "20000",
        "--threads",
        "1",
        "--batch",
        "4",
    ];
    plan(&bench, "stopped", &words);
    let mut worker = start(&bench, &["work", "stopped"]);
    wait_for_growth(&bench.path("stopped"), &mut worker, 2000);
    let kill = ["-TERM", &worker.id().to_string()].map(str::to_owned);
    assert!(std::process::Command::new("kill").args(kill).status().unwrap().success());
    assert_eq!(worker.wait().unwrap().code(), Some(1));
    let status = bench.json(&["status", "stopped", "--json"]);
    assert_eq!((&status["failed"], &status["twice"]), (&0.into(), &0.into()), "{status}");
    let done = status["done"].as_u64().unwrap();
    assert!((4..20_000).contains(&done), "{status}");
    // Whatever was begun was finished: the first episodes of the list, without a gap.
    let log = std::fs::read_to_string(bench.path("stopped/ledger/00001.log")).unwrap();
    assert_eq!(log.lines().count() as u64, done);
    let ended = bench.run(&["gather", "stopped"]);
    assert_eq!(ended.code, 1);
    assert!(ended.stderr.contains("of 20000 episodes are not played yet"), "{}", ended.stderr);
}

#[test]
fn a_full_disk_is_an_error_and_what_was_played_is_kept() {
    let bench = Bench::new();
    plan(&bench, "full", &CSI);
    // A ledger that cannot grow: the limit on file size is what a full disk looks like to a write.
    let worker = ["work", "full", "--quiet"].join(" ");
    let program = env!("CARGO_BIN_EXE_arnold-analyze");
    let script = format!("trap '' XFSZ; ulimit -f 4; exec '{program}' {worker}");
    let output = std::process::Command::new("bash")
        .args(["-c", &script])
        .current_dir(bench.path(""))
        .env_remove("ARNOLD_POLICY")
        .env_remove("ARNOLD_DATA")
        .output()
        .unwrap();
    let stderr = String::from_utf8(output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(1), "{stderr}");
    assert!(stderr.contains("cannot write") && stderr.contains("ledger"), "{stderr}");
    let status = bench.json(&["status", "full", "--json"]);
    assert!(status["done"].as_u64() > Some(0) && status["missing"].as_u64() > Some(0), "{status}");
    bench.json(&["work", "full", "--json", "--quiet"]);
    assert_same(&gathered(&bench, "full"), &undisturbed(&bench, &CSI), "after a full disk");
}

#[test]
fn work_with_another_policy_than_was_planned_is_refused() {
    let bench = Bench::new();
    plan(&bench, "planned", &["evaluate", "--task", "elbow_pose", "--episodes", "3"]);
    let path = bench.path("planned/plan.json");
    let text = std::fs::read_to_string(&path).unwrap();
    let mut document: Value = serde_json::from_str(&text).unwrap();
    document["policies"][0]["checkpoint_blake3"] = "0".into();
    arnold_analyze::files::write_atomic(&path, document.to_string().as_bytes()).unwrap();
    let ended = bench.run(&["work", "planned"]);
    assert_eq!(ended.code, 1);
    assert!(ended.stderr.contains("the policy is another"), "{}", ended.stderr);
}

/// A gigabyte of address space, as `ulimit` takes it.
const GIGABYTE: &str = "1048576";

#[test]
fn a_million_episodes_need_less_than_a_gigabyte() {
    let bench = Bench::new();
    let program = env!("CARGO_BIN_EXE_arnold-analyze");
    let within = |words: &str| -> Value {
        let start = Instant::now();
        let output = std::process::Command::new("bash")
            .args(["-c", &format!("ulimit -v {GIGABYTE}; exec '{program}' --json --quiet {words}")])
            .current_dir(bench.path(""))
            .env_remove("ARNOLD_POLICY")
            .env_remove("ARNOLD_DATA")
            .output()
            .unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
        let seconds = start.elapsed().as_secs_f64();
        eprintln!("`{words}`: {seconds:.2} s");
        serde_json::from_slice(&output.stdout).unwrap()
    };
    let command = "evaluate --task elbow_pose --episodes 1000000";
    assert_eq!(within(&format!("plan --out million {command}"))["episodes"], 1_000_000);
    let folder = bench.path("million");
    let plan = Plan::read(&folder).unwrap();
    let ledger = Ledger::new(&folder).unwrap();
    let key = plan.arm_keys()[0];
    for number in 0..1_000_000 {
        let episode = Episode {
            spec: plan.spec(&plan.arms[0], number, None),
            steps: 100,
            solved_steps: number % 100,
            reward: number as f64,
            terminated: false,
            diverged_steps: 0,
            recording: Recording::default(),
        };
        ledger.enter(key.episode(number), &episode, false).unwrap();
    }
    assert_eq!(within("status million")["done"], 1_000_000);
}

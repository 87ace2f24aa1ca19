//! `smoothness` and `kinematics` on recordings and on a policy that is played, as processes.

#![cfg(all(feature = "play", feature = "parquet", feature = "hdf5"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::Path;

use arnold_analyze::record::{
    About, Channel, Episode, EpisodeFacts, Format, Place, Precision, Recording, Samples, names,
    write_recording,
};
use common::bench::{Bench, files_below};
use serde_json::Value;

/// Three joints and two muscles swing with `frequency` for `steps` steps, differently in every episode and task.
fn swinging(task: &str, frequency: f64, steps: usize, episodes: u64) -> Recording {
    let swing = |step: usize, column: usize, episode: u64| {
        let phase = frequency * step as f64 + column as f64 + 0.3 * episode as f64;
        (phase.sin() + 0.2 * (2.3 * phase).cos()) * (1.0 + 0.1 * task.len() as f64)
    };
    let channel = |columns: usize, episode: u64| {
        let cells = (0..steps).flat_map(move |t| (0..columns).map(move |c| (t, c)));
        Samples::Double(cells.map(|(step, column)| swing(step, column, episode)).collect())
    };
    let episode = |number: u64| Episode {
        facts: EpisodeFacts {
            number,
            length: steps,
            seeds: None,
            terminated: None,
            diverged_steps: None,
        },
        samples: vec![channel(2, number), channel(3, number)],
    };
    Recording {
        about: About { task: task.to_owned(), deterministic: Some(false), ..About::default() },
        channels: vec![
            Channel::new(names::ACTION, "", ["a", "b"], Precision::Double, None),
            Channel::new(names::JOINT, "rad", ["x", "y", "z"], Precision::Double, None),
        ],
        episodes: (0..episodes).map(episode).collect(),
    }
}

/// Writes a recording per task into `folder`.
fn write(bench: &Bench, folder: &str, tasks: &[&str], frequency: f64) {
    for task in tasks {
        let path = bench.path(&format!("{folder}/{task}.parquet"));
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let recording = swinging(task, frequency, 40, 4);
        write_recording(recording, &[(Format::Parquet, path)], Place::New).unwrap();
    }
}

fn names_in(document: &Value) -> Vec<String> {
    files_below(Path::new(document["folder"].as_str().unwrap())).into_keys().collect()
}

fn narrow(text: &str) {
    let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
    assert!(widest <= 80, "a line of {widest} characters in\n{text}");
}

const TASKS: [&str; 3] = ["hand_index_reach", "pen", "baoding_p2_overlap"];

#[test]
fn smoothness_compares_the_policies_of_recordings_and_does_its_work_once() {
    let bench = Bench::new();
    write(&bench, "slow", &TASKS, 0.1);
    write(&bench, "fast", &TASKS, 0.5);
    let words = ["smoothness", "--recording", "Expert=slow", "OBC=fast", "--episodes", "4"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let policies = document["policies"].as_array().unwrap();
    assert_eq!(policies.len(), 2);
    let mean = |policy: usize, metric: &str| policies[policy][metric]["mean"].as_f64().unwrap();
    assert!(mean(0, "mean_abs_diff") < mean(1, "mean_abs_diff"));
    assert!(mean(0, "ldlj_kin") > mean(1, "ldlj_kin"));
    assert!(mean(0, "nvp") < mean(1, "nvp"));
    assert_eq!(policies[0]["nvp"]["n"], 3);
    assert_eq!(policies[0]["per_task"][0]["actions"], "stochastic");
    // Three differences of one sign: 2 of the 8 sign assignments are as extreme.
    let comparison = &document["comparisons"][0];
    assert_eq!((comparison["W"].as_f64(), comparison["p_raw"].as_f64()), (Some(0.0), Some(0.25)));
    assert_eq!(document["input"]["recordings"].as_array().unwrap().len(), 6);

    let mut expected: Vec<String> = vec!["manifest.json".to_owned()];
    for table in ["per_episode", "per_task", "comparisons"] {
        expected.extend(["csv", "parquet"].map(|end| format!("{table}.{end}")));
    }
    expected.extend(["svg", "pdf", "png"].map(|end| format!("smoothness.{end}")));
    expected.sort();
    assert_eq!(names_in(&document), expected);
    let folder = Path::new(document["folder"].as_str().unwrap());
    let header = |name: &str| {
        let text = std::fs::read_to_string(folder.join(name)).unwrap();
        text.lines().next().unwrap().to_owned()
    };
    let upstream = "policy,task,episode,episode_length,mean_abs_diff,sparc,ldlj_kin,nvp";
    assert_eq!(header("per_episode.csv"), upstream);
    let upstream = "policy,task,mean_abs_diff,sparc,ldlj_kin,nvp,episodes";
    assert!(header("per_task.csv").starts_with(upstream));
    assert_eq!(header("comparisons.csv"), "metric,a,b,n_tasks,W,p_raw,p_holm");

    let again = bench.run(&words);
    assert!(again.stderr.contains("Already done"), "{}", again.stderr);
    narrow(&again.stdout);
    for said in ["Input: 6 recordings", "± s.e.m.", "p Holm", "baoding_p2_overlap"] {
        assert!(again.stdout.contains(said), "no `{said}` in\n{}", again.stdout);
    }
    // The same work elsewhere is the same bytes.
    let elsewhere = bench.json(&[&words[..], &["--json", "--out", "elsewhere"]].concat());
    let files = |document: &Value| {
        let mut files = files_below(Path::new(document["folder"].as_str().unwrap()));
        files.remove("manifest.json");
        files
    };
    assert!(files(&document) == files(&elsewhere), "the files change");
}

#[test]
fn smoothness_refuses_what_would_be_a_mean_of_something_else() {
    let bench = Bench::new();
    write(&bench, "slow", &TASKS, 0.1);
    write(&bench, "fast", &TASKS[..1], 0.5);
    let short = swinging("pen", 0.1, 3, 4);
    let path = bench.path("short.parquet");
    write_recording(short, &[(Format::Parquet, path)], Place::New).unwrap();
    let cases: [(&[&str], &str, &str); 7] = [
        (&["a=slow"], "expected 100", "--episodes"),
        (&["a=slow", "b=fast", "--episodes", "4"], "`b` has no mean", "--task"),
        (&["a=short.parquet", "--episodes", "4"], "undefined for `a`", "--skip-undefined"),
        (&["a=slow", "a=fast", "--episodes", "4"], "two recordings of `a`", "another name"),
        (&["a=fast", "--task", "pen"], "no recording of pen", "--task"),
        (&["a=nowhere"], "nowhere", "recordings"),
        (
            &["a=.", "--task", "pen", "--sparc-fs", "task", "--episodes", "3"],
            "has 4 episodes",
            "--episodes",
        ),
    ];
    for (words, message, hint) in cases {
        let ended = bench.run(&[&["smoothness", "--recording"], words].concat());
        assert_eq!(ended.code, 1, "{words:?}: {}", ended.stdout);
        let (error, remedy) = ended.stderr.split_once("hint: ").expect(&ended.stderr);
        assert!(error.contains(message), "{words:?}: {error}");
        assert!(remedy.contains(hint), "{words:?}: {remedy}");
    }
    let skipped =
        ["smoothness", "--recording", "a=short.parquet", "--episodes", "4", "--skip-undefined"];
    let document = bench.json(&[&skipped[..], &["--json"]].concat());
    assert!(document["policies"][0]["sparc"]["mean"].is_null());
}

#[test]
fn smoothness_plays_a_policy_where_no_recording_is_named() {
    let bench = Bench::new();
    let words = ["smoothness", "--task", "elbow_pose", "--episodes", "2"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let row = &document["policies"][0]["per_task"][0];
    assert_eq!((&row["task"], row["episodes"].as_u64()), (&"elbow_pose".into(), Some(2)));
    for metric in ["mean_abs_diff", "sparc", "ldlj_kin", "nvp"] {
        assert!(row[metric].as_f64().unwrap().is_finite(), "{metric}");
    }
    assert!(!names_in(&document).iter().any(|name| name.starts_with("comparisons")));
    // A recording of the same episodes has the same smoothness.
    let rollout = bench.json(&["rollout", "--task", "elbow_pose", "--episodes", "2", "--json"]);
    let file = format!("elbow={}", rollout["files"][0].as_str().unwrap());
    let words = ["smoothness", "--recording", &file, "--episodes", "2", "--json"];
    let recorded = bench.json(&words);
    let recorded = &recorded["policies"][0]["per_task"][0];
    for metric in ["mean_abs_diff", "sparc", "ldlj_kin", "nvp"] {
        assert_eq!(recorded[metric], row[metric], "{metric}");
    }
}

#[test]
fn smoothness_of_upstreams_recording_is_what_upstream_says() {
    let Some(folder) = common::golden("analysis/upstream_formats") else { return };
    let text = std::fs::read_to_string(folder.join("expected.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let bench = Bench::new();
    let file = format!("arnold={}", folder.join("signals/arnold/seed_0/pen.h5").display());
    let words = ["smoothness", "--recording", &file, "--episodes", "3", "--json"];
    let document = bench.json(&words);
    let row = &document["policies"][0]["per_task"][0];
    let episodes = &expected["files"]["signals/arnold/seed_0/pen.h5"]["episodes"];
    for (ours, theirs) in
        [("mean_abs_diff", "mean_abs_da"), ("sparc", "sparc"), ("ldlj_kin", "ldlj"), ("nvp", "nvp")]
    {
        let of = |number: &str| episodes[number]["smoothness"][theirs].as_f64().unwrap();
        let want = ["2", "9", "10"].map(of).iter().sum::<f64>() / 3.0;
        let found = row[ours].as_f64().unwrap();
        assert!((found - want).abs() < 1e-7 * want.abs(), "{ours}: {found} {want}");
    }
}

#[test]
fn upstreams_selection_names_the_recordings_of_an_analysis() {
    let bench = Bench::new();
    for policy in ["expert", "arnold/seed_0", "other"] {
        let path = bench.path(&format!("signals/{policy}/baoding_p1_ccw.h5"));
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        let frequency = if policy == "other" { 0.7 } else { 0.2 };
        let recording = swinging("baoding_p1_ccw", frequency, 40, 4);
        write_recording(recording, &[(Format::Hdf5, path)], Place::New).unwrap();
    }
    let file = r#"{"tasks": ["pen"], "episodes": 4, "baoding_pca": {"tasks": ["baoding_p1_ccw"],
        "policies": ["expert", "arnold/seed_0"], "overrides": {"expert": {"baoding_p1_ccw": "other"}}}}"#;
    bench.write("signals.json", file.as_bytes());
    let words = ["kinematics", "--selection", "signals.json", "--signals", "signals", "--json"];
    let document = bench.json(&words);
    let read: Vec<(&str, &str)> = document["input"]["recordings"]
        .as_array()
        .unwrap()
        .iter()
        .map(|file| (file["policy"].as_str().unwrap(), file["file"].as_str().unwrap()))
        .collect();
    let want = [
        ("expert", "signals/other/baoding_p1_ccw.h5"),
        ("arnold/seed_0", "signals/arnold/seed_0/baoding_p1_ccw.h5"),
    ];
    assert_eq!(read, want);
    for (words, said) in [
        (&["smoothness", "--selection", "signals.json"][..], "analysis `smoothness`"),
        (&["kinematics", "--selection", "signals.json"], "is not there"),
    ] {
        let ended = bench.run(words);
        assert_eq!(ended.code, 1, "{}", ended.stderr);
        assert!(
            ended.stderr.contains(said) && ended.stderr.contains("hint: `--"),
            "{}",
            ended.stderr
        );
    }
}

#[test]
fn kinematics_counts_dimensions_beside_the_human_hand() {
    let bench = Bench::new();
    write(&bench, "slow", &["pen", "baoding_p1_ccw"], 0.1);
    write(&bench, "fast", &["baoding_p1_ccw"], 0.5);
    let words = ["kinematics", "--recording", "Expert=slow", "OBC=fast", "--episodes", "4"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let rows = document["dimensionality"].as_array().unwrap();
    assert_eq!(rows.len(), 6, "two policies, two tasks of one of them, two quantities");
    for row in rows {
        let (low, high) = (row["dim_85"].as_u64().unwrap(), row["dim_95"].as_u64().unwrap());
        assert!((1..=high).contains(&low) && high <= 3, "{row}");
        assert_eq!(row["avg_dim"], (low + high) as f64 / 2.0);
        // Four episodes of forty steps; velocities have one row fewer in each.
        let want = if row["quantity"] == "position" { 160 } else { 156 };
        assert_eq!((row["n_timesteps"].as_u64(), row["n_joints"].as_u64()), (Some(want), Some(3)));
    }
    assert_eq!(document["human"][1]["avg_dim"], 6.0);
    let folder = Path::new(document["folder"].as_str().unwrap());
    let lines = |name: &str| -> Vec<String> {
        let text = std::fs::read_to_string(folder.join(name)).unwrap();
        text.lines().map(str::to_owned).collect()
    };
    let upstream = "policy,task,quantity,dim_85,dim_95,avg_dim,n_episodes,n_timesteps,n_joints";
    assert_eq!(lines("dimensionality.csv")[0], upstream);
    let cumulative = lines("cumulative_variance.csv");
    assert_eq!(cumulative[0], "policy,task,quantity,component,cumulative_variance");
    assert_eq!(cumulative.len(), 1 + 6 * 3);
    assert_eq!(lines("human_comparison.csv").len(), 1 + 4, "only of the task with balls");
    for figure in ["pen.svg", "baoding_p1_ccw.svg", "baoding_p1_ccw.png"] {
        assert!(folder.join(figure).is_file(), "{figure}");
    }
    let again = bench.run(&words);
    assert!(again.stderr.contains("Already done"), "{}", again.stderr);
    narrow(&again.stdout);
    let few = bench.run(&["kinematics", "--recording", "Expert=slow"]);
    assert_eq!(few.code, 1);
    assert!(few.stderr.contains("expected 100") && few.stderr.contains("--episodes"));
}

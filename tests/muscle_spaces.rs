//! `synergies` and `subspaces` on recordings and on a policy that is played, as processes.

#![cfg(all(feature = "play", feature = "parquet", feature = "hdf5"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;
#[path = "muscle_spaces/parity.rs"]
mod parity;

use std::path::Path;

use arnold_analyze::record::{
    About, Channel, Episode, EpisodeFacts, Format, Place, Precision, Recording, Samples, names,
    write_recording,
};
use common::bench::{Bench, files_below};
use serde_json::Value;

/// One channel with the same number of columns in every episode, row-major.
type Values = Vec<Vec<f64>>;

/// A recording of `muscles` muscles with these channels; every episode solves its last step if `solves` says so.
fn recording(
    task: &str,
    muscles: usize,
    channels: &[(&str, Values)],
    solves: &[bool],
) -> Recording {
    let columns = (0..muscles).map(|muscle| format!("m{muscle}"));
    let describe = |name: &str| Channel::new(name, "", columns.clone(), Precision::Double, None);
    let mut described: Vec<Channel> = channels.iter().map(|(name, _)| describe(name)).collect();
    described.push(Channel::scalar(names::SOLVED, Precision::Flag, None));
    let episode = |(number, &solves): (usize, &bool)| {
        let length = channels[0].1[number].len() / muscles;
        let mut samples: Vec<Samples> =
            channels.iter().map(|(_, values)| Samples::Double(values[number].clone())).collect();
        samples.push(Samples::Flag((1..=length).map(|step| solves && step == length).collect()));
        let facts = EpisodeFacts {
            number: number as u64,
            length,
            seeds: None,
            terminated: None,
            diverged_steps: None,
        };
        Episode { facts, samples }
    };
    Recording {
        about: About {
            task: task.to_owned(),
            policy: "its own name".to_owned(),
            deterministic: Some(false),
            ..About::default()
        },
        channels: described,
        episodes: solves.iter().enumerate().map(episode).collect(),
    }
}

fn save(bench: &Bench, file: &str, recording: Recording) {
    let path = bench.path(&format!("{file}.parquet"));
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    write_recording(recording, &[(Format::Parquet, path)], Place::New).unwrap();
}

/// Six muscles driven by three rhythms, in another mixture for every task and policy.
fn rhythms(task: &str, policy: f64, muscles: usize, steps: usize) -> Recording {
    let mixture = task.len() as f64;
    let value = |episode: usize, step: usize, muscle: usize| {
        let time = 0.17 * step as f64 + episode as f64;
        let rhythm = |k: f64| (time * (1.0 + k) + k * mixture).sin() / (1.0 + k);
        let weight = |k: f64| (k + 1.3 * muscle as f64 + 0.2 * mixture + policy).cos();
        [0.0, 1.0, 2.0].map(|k| rhythm(k) * weight(k)).iter().sum::<f64>()
    };
    let values = |noise: f64| -> Values {
        let cell = |episode: usize, at: usize| {
            let jitter = ((at * 7919 + episode * 104_729) % 1000) as f64 / 1000.0 - 0.5;
            value(episode, at / muscles, at % muscles) + noise * jitter
        };
        (0..4).map(|episode| (0..steps * muscles).map(|at| cell(episode, at)).collect()).collect()
    };
    let channels = [(names::ACTION_MEAN, values(0.0)), (names::ACTION, values(0.1))];
    recording(task, muscles, &channels, &[true, false, true, true])
}

const TASKS: [&str; 3] = ["hand_index_reach", "pen", "baoding_p2_overlap"];

/// A recording per task in `folder`.
fn write(bench: &Bench, folder: &str, tasks: &[&str], policy: f64) {
    for task in tasks {
        save(bench, &format!("{folder}/{task}"), rhythms(task, policy, 6, 40));
    }
}

fn folder(document: &Value) -> &Path {
    Path::new(document["folder"].as_str().unwrap())
}

fn lines(document: &Value, name: &str) -> Vec<String> {
    let text = std::fs::read_to_string(folder(document).join(name)).unwrap();
    text.lines().map(str::to_owned).collect()
}

/// The files of a run, without what says where and when it was.
fn files(document: &Value) -> std::collections::BTreeMap<String, Vec<u8>> {
    let mut files = files_below(folder(document));
    files.remove("manifest.json");
    files
}

fn names_in(document: &Value) -> Vec<String> {
    files(document).into_keys().collect()
}

fn expected(tables: &[&str], figures: &[&str]) -> Vec<String> {
    let mut names = Vec::new();
    for table in tables {
        names.extend(["csv", "parquet"].map(|end| format!("{table}.{end}")));
    }
    for figure in figures {
        names.extend(["svg", "pdf", "png"].map(|end| format!("{figure}.{end}")));
    }
    names.sort();
    names
}

fn narrow(text: &str) {
    let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
    assert!(widest <= 80, "a line of {widest} characters in\n{text}");
}

/// Runs what must fail and checks what is said.
fn fails(bench: &Bench, words: &[&str], message: &str, hint: &str) {
    let ended = bench.run(words);
    assert_eq!(ended.code, 1, "{words:?}: {}", ended.stdout);
    let (error, remedy) = ended.stderr.split_once("hint: ").expect(&ended.stderr);
    assert!(error.contains(message), "{words:?}: {error}");
    assert!(remedy.contains(hint), "{words:?}: {remedy}");
}

#[test]
fn subspaces_compares_tasks_and_policies_and_does_its_work_once() {
    let bench = Bench::new();
    write(&bench, "a", &TASKS, 0.0);
    write(&bench, "b", &TASKS, 0.05);
    let words = ["subspaces", "--recording", "Arnold=a", "OBC=b", "--episodes", "4"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let groups: Vec<(&str, &str, u64)> = document["groups"]
        .as_array()
        .unwrap()
        .iter()
        .map(|group| {
            let text = |key: &str| group[key].as_str().unwrap();
            (text("comparison"), text("group"), group["pairs"].as_u64().unwrap())
        })
        .collect();
    let want = [
        ("across_tasks", "Arnold", 3),
        ("across_policies", "Arnold / OBC", 3),
        ("across_tasks", "OBC", 3),
    ];
    assert_eq!(groups, want);
    // The policies mix almost alike, the tasks do not; all six components are the whole space.
    let mean = |group: usize, measure: &str, n: usize| {
        document["groups"][group][measure]["mean"][n - 1].as_f64().unwrap()
    };
    for measure in ["pvd", "pad"] {
        assert!(mean(1, measure, 2) < 0.5 * mean(0, measure, 2), "{measure}");
        assert!(mean(0, measure, 6).abs() < 1e-12);
    }
    assert_eq!(document["groups"][0]["pvd"]["count"][0], 3);
    // Tasks are alphabetical inside a policy, so that the direction is upstream's.
    let pairs = lines(&document, "pairs.csv");
    let upstream = "comparison,policy_a,task_a,policy_b,task_b,dimension,pvd,pad,n_a,n_b,group";
    assert!(pairs[0].starts_with(upstream), "{}", pairs[0]);
    let first = "across_tasks,Arnold,baoding_p2_overlap,Arnold,hand_index_reach,1,";
    assert!(pairs[1].starts_with(first) && pairs[1].contains(",160,160,Arnold,"), "{}", pairs[1]);
    assert_eq!(pairs.len(), 1 + 9 * 6);
    let upstream =
        "comparison,group,dimension,pvd_mean,pvd_std,pvd_count,pad_mean,pad_std,pad_count";
    assert_eq!(lines(&document, "summary.csv")[0], upstream);
    let want = expected(&["pairs", "summary"], &["across_tasks", "across_policies"]);
    assert_eq!(names_in(&document), want);
    // Rates of tasks differ by nature; only one task at two rates would be odd.
    assert_eq!(document["warnings"], serde_json::json!([]));

    let again = bench.run(&words);
    assert!(again.stderr.contains("Already done"), "{}", again.stderr);
    narrow(&again.stdout);
    for said in ["Arnold / OBC", "PVD 1", "Input: 6 recordings", "directed"] {
        assert!(again.stdout.contains(said), "no `{said}` in\n{}", again.stdout);
    }
    let elsewhere = ["--json", "--out", "elsewhere", "--threads", "1"];
    let elsewhere = bench.json(&[&words[..], &elsewhere].concat());
    assert!(files(&document) == files(&elsewhere), "the files change");
}

#[test]
fn subspaces_takes_successful_episodes_and_names_of_recordings() {
    let bench = Bench::new();
    write(&bench, "a", &TASKS[..2], 0.0);
    let words = ["subspaces", "--recording", "a", "--successful", "3", "--json"];
    let document = bench.json(&words);
    let cells = document["cells"].as_array().unwrap();
    assert!(cells.iter().all(|cell| cell["episodes"] == 3 && cell["policy"] == "its own name"));
    let words = ["subspaces", "--recording", "a", "--successful", "4"];
    fails(&bench, &words, "in 3 episodes, expected 4", "--successful");
    // What the other definitions change, and what not.
    let run = |options: &[&str]| {
        let words = ["subspaces", "--recording", "a", "--episodes", "4", "--json"];
        bench.json(&[&words[..], options].concat())["groups"][0].clone()
    };
    let (directed, largest) = (run(&[]), run(&["--pad", "max"]));
    assert_eq!(directed["pvd"], largest["pvd"]);
    let angle = |group: &Value| group["pad"]["mean"][1].as_f64().unwrap();
    assert!(angle(&largest) > angle(&directed));
    assert_ne!(run(&["--pvd", "symmetric"])["pvd"], directed["pvd"]);
}

#[test]
fn subspaces_names_what_cannot_be_compared_and_what_is_odd() {
    let bench = Bench::new();
    write(&bench, "a", &TASKS, 0.0);
    write(&bench, "b", &TASKS[..1], 0.1);
    save(&bench, "seven/pen", rhythms("pen", 0.0, 7, 40));
    let mut renamed = rhythms("pen", 0.0, 6, 40);
    for channel in &mut renamed.channels {
        if let Some(third) = channel.elements.get_mut(2) {
            third.name = "other".to_owned();
        }
    }
    save(&bench, "renamed/pen", renamed);
    let mut holed = rhythms("pen", 0.0, 6, 40);
    let Samples::Double(values) = &mut holed.episodes[2].samples[1] else { unreachable!() };
    values[6 * 11 + 4] = f64::NAN;
    save(&bench, "holed/pen", holed);
    let still = vec![vec![0.25; 6 * 9]; 4];
    let still = recording("pen", 6, &[(names::ACTION, still)], &[true; 4]);
    save(&bench, "still/pen", still);
    let mut without = rhythms("pen", 0.0, 6, 40);
    without.retain_channels(|channel| channel.name != names::ACTION);
    save(&bench, "without/pen", without);
    let pen = ["--task", "pen", "--episodes", "4"];
    let cases: [(&[&str], &str, &str); 8] = [
        (&["x=a"], "expected 100", "--episodes"),
        (&["x=a", "--task", "pen", "--episodes", "4"], "alone cannot be compared", "--recording"),
        (&["x=a", "y=b", "--episodes", "4"], "nothing of `y`", "--task"),
        (&["x=a", "y=seven"], "has 7 muscles, but `x` in `pen` has 6", "same muscles"),
        (&["x=a", "y=renamed"], "muscle 3 of `y` in `pen` is `other`", "same muscles"),
        (&["x=a", "y=holed"], "`action` of episode 2 of `y` in `pen`", "inspect"),
        (&["x=a", "y=still"], "the actions of `y` in `pen` span no subspace", "inspect"),
        (&["x=a", "y=without"], "has no channel `action`", "`actions`"),
    ];
    for (words, message, hint) in cases {
        let all = if words.contains(&"--episodes") || words == ["x=a"] { &[][..] } else { &pen };
        let words = [&["subspaces", "--recording"], words, all].concat();
        fails(&bench, &words, message, hint);
    }
    // Three steps for six muscles, one muscle that never moves, and half the rate are compared, and said.
    let mut short = rhythms("pen", 0.3, 6, 3);
    short.episodes.truncate(1);
    let Samples::Double(values) = &mut short.episodes[0].samples[1] else { unreachable!() };
    values.iter_mut().step_by(6).for_each(|value| *value = 0.5);
    let (mut slow, mut fast) = (rhythms("chess", 0.1, 6, 3), short);
    slow.episodes.truncate(1);
    (slow.about.control_interval, fast.about.control_interval) = (Some(0.02), Some(0.01));
    fast.about.task = "chess".to_owned();
    save(&bench, "slow/chess", slow);
    save(&bench, "fast/chess", fast);
    let words = ["subspaces", "--recording", "x=slow", "y=fast", "--episodes", "1"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let warnings = document["warnings"].as_array().unwrap();
    let warned = |text: &str| warnings.iter().any(|w| w.as_str().unwrap().contains(text));
    for text in [
        "`y` in `chess`: 3 steps for 6 muscles",
        "`y` in `chess`: constant actions of m0",
        "1 of 1 pairs have directions without variance; kept",
        "`chess`: control rates differ (50, 100 Hz)",
    ] {
        assert!(warned(text), "no `{text}` in {warnings:?}");
    }
    assert!(lines(&document, "pairs.csv")[3].ends_with(",true"), "beyond the rank of two");
    assert!(bench.run(&words).stdout.contains("warning: `y` in `chess`"));
    let dropped = bench.json(&[&words[..], &["--drop-beyond-rank", "--json"]].concat());
    let pad = &dropped["groups"][0]["pad"];
    assert!(pad["mean"][1].is_f64() && pad["mean"][2].is_null() && pad["count"][2] == 0);
}

#[test]
fn synergies_takes_every_task_and_all_together_apart() {
    let bench = Bench::new();
    write(&bench, "a", &TASKS, 0.0);
    let words = ["synergies", "--recording", "Arnold=a", "--episodes", "4", "--n-fits", "2"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let tasks = document["tasks"].as_array().unwrap();
    assert_eq!(tasks.len(), 3);
    for task in tasks {
        // Three rhythms are three components of the task; pooled, they are shared out over more.
        let values = |key: &str, scope: &str| -> Vec<f64> {
            let values = task[key][scope]["values"].as_array().unwrap();
            values.iter().map(|value| value.as_f64().unwrap()).collect()
        };
        let (own, pooled) =
            (values("explained_variance", "task"), values("explained_variance", "global"));
        assert!(own[2] > 1.0 - 1e-9 && own.is_sorted() && pooled.is_sorted());
        assert!(own.iter().zip(&pooled).all(|(own, pooled)| own + 1e-12 >= *pooled));
        let (r2, vaf) = (values("reconstruction", "task"), values("vaf", "task"));
        assert_eq!(r2.len(), 5, "one to one less than there are muscles");
        assert!(r2.iter().zip(&vaf).all(|(r2, vaf)| r2 <= vaf));
        assert!(r2[4] > r2[0]);
        assert_eq!((task["steps"].as_u64(), task["muscles"].as_u64()), (Some(160), Some(6)));
    }
    assert_eq!(document["means"][0]["tasks"], 3);
    assert_eq!(
        lines(&document, "variance.csv")[0],
        "policy,task,scope,dimension,explained_variance"
    );
    assert_eq!(lines(&document, "variance.csv").len(), 1 + 2 * 3 * 6);
    assert_eq!(lines(&document, "components.csv").len(), 1 + 4 * 36);
    let reconstruction = lines(&document, "reconstruction.csv");
    let columns = "policy,task,scope,dimension,reconstruction,vaf,r2_uniform,n_fits,n_converged";
    assert!(reconstruction[0].starts_with(columns));
    assert_eq!(reconstruction.len(), 1 + 2 * 3 * 5);
    assert_eq!(lines(&document, "synergies.csv").len(), 1 + 4 * (1 + 2 + 3 + 4 + 5) * 6);
    let tables = ["variance", "components", "reconstruction", "synergies"];
    assert_eq!(names_in(&document), expected(&tables, &["variance", "reconstruction"]));
    let rates = &document["warnings"][0];
    assert!(rates.as_str().unwrap().contains("control rates differ (40, 50, 100 Hz)"), "{rates}");

    let again = bench.run(&words);
    assert!(again.stderr.contains("Already done"), "{}", again.stderr);
    narrow(&again.stdout);
    for said in ["pooled 0.85", "principal components of the action means", "mean of 2 fits"] {
        assert!(again.stdout.contains(said), "no `{said}` in\n{}", again.stdout);
    }
    for threads in ["1", "3"] {
        let elsewhere = ["--json", "--out", threads, "--threads", threads];
        let elsewhere = bench.json(&[&words[..], &elsewhere].concat());
        assert!(files(&document) == files(&elsewhere), "the files change with {threads} threads");
    }
}

#[test]
fn synergies_of_controls_are_those_of_the_actions_behind_their_sigmoid() {
    let bench = Bench::new();
    write(&bench, "a", &["pen"], 0.0);
    let mut controls = rhythms("pen", 0.0, 6, 40);
    controls.channels[1].name = names::EXCITATION.to_owned();
    for episode in &mut controls.episodes {
        let Samples::Double(values) = &mut episode.samples[1] else { unreachable!() };
        values.iter_mut().for_each(|a| *a = 1.0 / (1.0 + (-5.0 * (*a - 0.5)).exp()));
    }
    save(&bench, "controls/pen", controls);
    let run = |folder: &str, options: &[&str]| {
        let words = [
            "synergies",
            "--recording",
            folder,
            "--episodes",
            "4",
            "--synergies",
            "2",
            "--n-fits",
            "1",
        ];
        let words = [&words[..], &["--method", "nmf", "--json"], options].concat();
        bench.json(&words)["tasks"][0]["reconstruction"]["task"].clone()
    };
    let (found, want) = (run("x=a", &[]), run("x=controls", &[]));
    let value = |curve: &Value| curve["values"][0].as_f64().unwrap();
    assert!((value(&found) - value(&want)).abs() < 1e-9);
    assert!((value(&run("x=a", &["--nmf-domain", "shift"])) - value(&found)).abs() > 1e-6);
    // A list with holes cannot tell the fewest.
    assert_eq!(
        want["reaching"][0]["is_fewest"],
        if want["reaching"][0]["dimension"].is_null() { Value::Null } else { Value::Bool(false) }
    );
}

#[test]
fn synergies_names_what_it_cannot_do_and_what_is_odd() {
    let bench = Bench::new();
    write(&bench, "a", &["pen"], 0.0);
    let mut bare = rhythms("pen", 0.0, 6, 40);
    bare.retain_channels(|channel| channel.name == names::ACTION_MEAN);
    save(&bench, "bare/pen", bare);
    let low = recording(
        "pen",
        3,
        &[(names::ACTION, vec![vec![-2.0; 12]]), (names::ACTION_MEAN, vec![vec![-2.0; 12]])],
        &[true],
    );
    save(&bench, "low/pen", low);
    let four = ["--episodes", "4"];
    let cases: [(&[&str], &[&str], &str, &str); 5] = [
        (&["x=a"], &[], "expected 100", "--episodes"),
        (&["x=bare"], &four, "has no channel `excitation`", "`muscle_controls`"),
        (&["x=a", "--synergies", "50"], &four, "there are 1 to 6", "--synergies 1-6"),
        (&["x=a", "--nmf-init", "nndsvda", "--n-fits", "3"], &four, "all 3 fits", "--n-fits"),
        (
            &["x=low", "--nmf-domain", "shift"],
            &["--episodes", "1"],
            "rows are zero",
            "--method pca",
        ),
    ];
    for (words, more, message, hint) in cases {
        let words = [&["synergies", "--recording"], words, more].concat();
        fails(&bench, &words, message, hint);
    }
    // A task whose actions never change has no components of its own, and none of its variance in the pool's. Three
    // steps have three synergies. Other muscles are pooled apart.
    let constant = vec![vec![0.3; 6 * 20]; 4];
    let channels = [(names::ACTION_MEAN, constant.clone()), (names::ACTION, constant)];
    save(&bench, "odd/reorient", recording("reorient", 6, &channels, &[true; 4]));
    let mut short = rhythms("hand_ring_reach", 0.2, 6, 3);
    short.episodes.iter_mut().skip(1).for_each(|episode| {
        episode.facts.length = 0;
        episode.samples = vec![
            Samples::Double(Vec::new()),
            Samples::Double(Vec::new()),
            Samples::Flag(Vec::new()),
        ];
    });
    save(&bench, "odd/hand_ring_reach", short);
    write(&bench, "odd", &["pen"], 0.0);
    save(&bench, "odd/elbow_pose", rhythms("elbow_pose", 0.0, 4, 40));
    let words = ["synergies", "--recording", "x=odd", "--episodes", "4", "--n-fits", "1"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let warnings = document["warnings"].as_array().unwrap();
    for text in [
        "`x` in `reorient`: constant activity of all muscles",
        "`x` in `reorient` has no components: all 80 rows are equal",
        "`x` in `hand_ring_reach`: 3 steps for 6 muscles",
        "`x` in `hand_ring_reach`: no more than 3 synergies",
        "pooled apart",
    ] {
        let warned = warnings.iter().any(|warning| warning.as_str().unwrap().contains(text));
        assert!(warned, "no `{text}` in {warnings:?}");
    }
    let of = |name: &str| {
        let tasks = document["tasks"].as_array().unwrap();
        tasks.iter().find(|task| task["task"] == name).unwrap()
    };
    let still = &of("reorient")["explained_variance"];
    assert!(still["task"]["values"][0].is_null() && still["global"]["values"][5] == 0.0);
    assert_eq!(
        of("hand_ring_reach")["reconstruction"]["task"]["dimensions"],
        serde_json::json!([1, 2, 3])
    );
    assert!(of("elbow_pose")["explained_variance"]["global"].is_null());
    assert!(!lines(&document, "variance.csv").iter().any(|line| line.contains("NaN")));
}

#[test]
fn synergies_of_a_played_policy_are_those_of_its_recording() {
    let bench = Bench::new();
    let options = ["--task", "elbow_pose", "--episodes", "2"];
    let words = [&["synergies", "--json", "--n-fits", "1"], &options[..]].concat();
    let played = bench.json(&words);
    assert!(played["input"]["played"].is_object());
    let rollout = bench.json(&[&["rollout", "--json"], &options[..]].concat());
    let file = format!("elbow={}", rollout["files"][0].as_str().unwrap());
    let words = ["synergies", "--recording", &file, "--episodes", "2", "--n-fits", "1", "--json"];
    let recorded = bench.json(&words);
    for key in ["explained_variance", "reconstruction", "vaf"] {
        assert!(played["tasks"][0][key]["task"].is_object());
        assert_eq!(played["tasks"][0][key], recorded["tasks"][0][key], "{key}");
    }
    let words = [&["subspaces"], &options[..]].concat();
    fails(&bench, &words, "alone cannot be compared", "--recording");
}

#[test]
fn published_curves_stand_beside_ours_or_alone() {
    let bench = Bench::new();
    write(&bench, "a", &["pen"], 0.0);
    let head =
        "method,scope,basis_policy,task,dimension,reconstruction,solved_fraction,n_episodes,n_fits";
    let rows = "pca,task,arnold,pen,1,0.5,0,20,1\npca,task,arnold,pen,2,0.9,0,20,1\npca,global,arnold,pen,1,0.2,0,20,1";
    bench.write("curves.csv", format!("{head}\n{rows}\n").as_bytes());
    let alone = bench.json(&["synergies", "--published", "curves.csv", "--json"]);
    assert_eq!(alone["published"][0]["reaching"][0]["dimension"], 2);
    assert_eq!(alone["input"]["published"][0], "curves.csv");
    assert_eq!(names_in(&alone), expected(&["published"], &["variance"]));
    let beside = |published: &[&str]| {
        let words = [
            "synergies",
            "--recording",
            "Arnold=a",
            "--episodes",
            "4",
            "--method",
            "pca",
            "--json",
        ];
        let document = bench.json(&[&words[..], published].concat());
        let drawing = std::fs::read_to_string(folder(&document).join("variance.svg")).unwrap();
        drawing.matches("<circle").count()
    };
    // Two rings of the task's own curve and the one in the legend, of two circles each; the pool does not exist here.
    assert_eq!(beside(&["--published", "curves.csv"]) - beside(&[]), 6);
    let ended = bench.run(&["synergies", "--published", "curves.csv"]);
    assert!(ended.stdout.contains("Input: published curves"), "{}", ended.stdout);
    narrow(&ended.stdout);
    bench.write("wrong.csv", b"method\npca\n");
    fails(&bench, &["synergies", "--published", "wrong.csv"], "column `scope`", "columns");
}

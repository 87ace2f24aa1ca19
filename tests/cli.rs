//! The program as a process: help, exit codes, what goes to stdout and what to stderr, pipes, documents and files.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Stdio;

use arnold_analyze::record::{Table, Values, read_parquet};
use arnold_analyze::sim::tasks;
use common::bench::{Bench, files_below};
use serde_json::{Value, json};

#[test]
fn help_of_every_command_names_its_options_within_100_columns() {
    let playing: &[&str] = &[
        "--policy <FILE|NAME>",
        "--normaliser <FILE>",
        "--task <NAME>...",
        "--episodes <N>",
        "--deterministic",
        "--stochastic",
        "--action-noise <SD>",
        "--seed <N>",
        "--physics <VERSION>",
        "--threads <N>",
        "--batch <N>",
        "--out <DIR>",
    ];
    let commands: &[(&str, &[&str])] = &[
        ("setup", &["--check", "--from <DIR>"]),
        ("doctor", &["what is missing"]),
        ("inspect", &["<FILE>", "without running anything"]),
        (
            "convert",
            &["<FILE>...", "--to <FORMAT>", "--mean", "--out <PATH>", "--signals <NAME>..."],
        ),
        ("tasks", &["[TASK]"]),
        ("rollout", &[playing, &["--format <FORMAT>..."]].concat()),
        ("evaluate", &[playing, &["--benchmarks <[NAME=]PATH>...", "--experts <DIR>"]].concat()),
        ("curves", &["[TABLE]...", "--run <METHOD:TASK=PATH[,PATH]>", "--recipe <RECIPE>"]),
        ("figures", &["[NAME]...", "--runs <DIR>"]),
        ("stats", &["<FILE>", "--unit <COLUMN>...", "--alternative <ALTERNATIVE>"]),
        (
            "csi",
            &[
                playing,
                &["--components <LIST>", "--no-pooled", "--basis <BASIS>", "--n-fits <N>"],
                &["--components-of <FILE|NAME>", "--relative-to <FILE>", "--budget <BUDGET>"],
            ]
            .concat(),
        ),
        ("plan", &["<COMMAND|FILE>...", "--out <DIR>", "--emit <SCHEDULER>", "--array-limit <N>"]),
        ("work", &["<DIR>", "--shard <I/N>", "--threads <N>"]),
        ("status", &["<DIR>", "--watch"]),
        ("gather", &["<DIR>"]),
        (
            "emg",
            &[playing, &["--subjects <DIR>", "--recording <[LABEL=]FILE>...", "--bf <BF>"]]
                .concat(),
        ),
        ("factors", &[playing, &["--recording <[LABEL=]FILE>", "--profiles <FILE>"]].concat()),
        ("smoothness", &[playing, &["--recording <[NAME=]PATH>...", "--skip-undefined"]].concat()),
        ("kinematics", &[playing, &["--recording <[NAME=]PATH>..."]].concat()),
        (
            "train",
            &["<REGIME>", "--task <NAME>...", "--network <NAME>", "--teacher <[TASK=]POLICY>..."],
        ),
        ("verify", &["traces", "policy"]),
        ("bench", &["policy", "loop", "--quick"]),
    ];
    let bench = Bench::new();
    let overview = bench.run(&["--help"]);
    assert_eq!((overview.code, overview.stderr.as_str()), (0, ""));
    for (command, words) in commands {
        assert!(overview.stdout.contains(&format!("\n  {command} ")), "{}", overview.stdout);
        let help = bench.run(&[command, "--help"]);
        assert_eq!((help.code, help.stderr.as_str()), (0, ""), "{command}");
        for word in words.iter().chain(&["Usage: arnold-analyze", "--json", "--quiet"]) {
            assert!(help.stdout.contains(word), "{command}: no `{word}` in\n{}", help.stdout);
        }
        let widest = help.stdout.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 100, "{command}: a line of {widest} characters");
    }
    let version = bench.run(&["--version"]);
    assert_eq!(version.stdout, concat!("arnold-analyze ", env!("CARGO_PKG_VERSION"), "\n"));
}

#[test]
fn exit_codes_are_0_done_1_failed_2_bad_arguments_3_something_skipped() {
    let bench = Bench::new();
    bench.write("juggling_mj2.3.7_s0.npz", b"");
    let cases: [(i32, &[&str]); 10] = [
        (0, &["tasks"]),
        (1, &["tasks", "elbow_poze"]),
        (1, &["inspect", "nothing.zip"]),
        (2, &[]),
        (2, &["juggle"]),
        (2, &["evaluate", "--deterministic", "--stochastic"]),
        (2, &["plan", "--out", "sweep", "evaluate", "--deterministic", "--stochastic"]),
        (1, &["plan", "--out", "sweep", "tasks"]),
        (1, &["work", "sweep"]),
        (3, &["verify", "traces", "."]),
    ];
    for (code, words) in cases {
        let ended = bench.run(words);
        assert_eq!(ended.code, code, "{words:?}: {}", ended.stderr);
        let empty = |text: &str| text.trim().is_empty();
        assert_eq!(empty(&ended.stdout), code == 1 || code == 2, "{words:?}: {}", ended.stdout);
        assert_eq!(empty(&ended.stderr), code == 0, "{words:?}: {}", ended.stderr);
    }
}

#[test]
fn a_reader_that_goes_away_is_no_error() {
    let bench = Bench::new();
    for words in [&["--help"][..], &["tasks"], &["tasks", "--json"], &["tasks", "elbow_pose"]] {
        let mut command = bench.command(words);
        let mut child = command.stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap();
        drop(child.stdout.take());
        let output = child.wait_with_output().unwrap();
        let stderr = String::from_utf8(output.stderr).unwrap();
        assert_eq!((output.status.code(), stderr.as_str()), (Some(0), ""), "{words:?}");
    }
}

#[test]
fn tasks_lists_what_there_is_and_shows_one() {
    let bench = Bench::new();
    let table = bench.run(&["tasks"]);
    let document = bench.json(&["tasks", "--json"]);
    let listed = document["tasks"].as_array().unwrap();
    assert_eq!(listed.len(), tasks::ALL.len());
    let extra = document["extra"].as_array().unwrap();
    assert_eq!(extra.len(), tasks::EXTRA.len());
    for (task, entry) in tasks::every().zip(listed.iter().chain(extra)) {
        assert_eq!(entry["name"], task.name);
        assert!(table.stdout.contains(task.name) && table.stdout.contains(task.paper_name));
    }

    let elbow = bench.json(&["tasks", "elbow_pose", "--json"]);
    assert_eq!(elbow["horizon"], 100);
    assert_eq!(elbow["muscles"].as_array().unwrap().len(), 6);
    let observation = elbow["observation"].as_array().unwrap();
    assert_eq!(observation.len(), 28);
    for (index, element) in observation.iter().enumerate() {
        assert_eq!(element["index"], index);
        assert!(element["words"].as_array().unwrap().len() >= 2, "{element}");
        assert!(!element["unit"].as_str().unwrap().is_empty(), "{element}");
    }
    assert_eq!(observation[0]["words"], json!(["r_elbow_flex", "position", "angular", "joint"]));
    assert_eq!(elbow["reward_weights"]["sparse"], json!({"solved": 5.0}));
    let solved = json!({
        "event": "solved", "quantity": "angle to target", "when": "below", "value": 0.175, "unit": "rad"
    });
    assert_eq!(elbow["thresholds"][0], solved);
    let drawn = json!({
        "quantity": "target of r_elbow_flex", "unit": "rad", "uniform": {"low": [0.0], "high": [2.27]}
    });
    assert_eq!(elbow["start"][0], drawn);
    let clean: u64 = elbow["clean_observation"]
        .as_array()
        .unwrap()
        .iter()
        .map(|block| block["length"].as_u64().unwrap())
        .sum();
    assert_eq!(clean, 9);
    assert_eq!(elbow["actuators"][5]["words"], json!(["BRA", "activation", "muscle"]));
    let text = bench.run(&["tasks", "elbow_pose"]).stdout;
    assert!(text.contains("TRIlong") && text.contains("muscle_len"), "{text}");
}

#[test]
fn a_task_fits_a_terminal_of_80_columns() {
    let bench = Bench::new();
    let narrow = |words: &[&str]| {
        let text = bench.run(words).stdout;
        let widest = text.lines().map(|line| line.chars().count()).max().unwrap();
        assert!(widest <= 80, "{words:?}: a line of {widest} characters");
        text
    };
    narrow(&["tasks"]);
    let model = common::data_folder();
    for task in tasks::every() {
        if task.body == "legs" && !model.join(task.model).is_file() {
            eprintln!("skipped: there is no leg model in `{}`", model.display());
            continue;
        }
        let text = narrow(&["tasks", task.name, "--data", model.to_str().unwrap()]);
        for section in ["Solved while", "Ends when", "Start of an episode", "Reward", "Observation"]
        {
            assert!(text.contains(section), "{}: {text}", task.name);
        }
    }
}

#[test]
fn a_model_that_is_not_the_walking_body_is_refused() {
    let bench = Bench::new();
    let model = "data/kinesis/xml/myolegs_onlylegs.xml";
    let free = "<mujoco><worldbody><body name='root'><freejoint/><geom size='0.1'/></body></worldbody></mujoco>";
    bench.write(model, free.as_bytes());
    for task in ["kinesis", "kinesis_forward"] {
        let ended = bench.run(&["tasks", task]);
        assert_eq!(ended.code, 1, "{}", ended.stdout);
        let expected = "error: the model does not fit the task: a walking body needs a free root and 28 joints of one axis \
                        each, the model has 7 coordinates and 0 other joints";
        assert!(ended.stderr.starts_with(expected), "{}", ended.stderr);
    }
    // As many joints as needed, but nothing that touches or measures.
    let mut jointed =
        "<mujoco><worldbody><body name='root'><freejoint/><geom size='0.1'/>".to_owned();
    (0..28).for_each(|_| jointed += "<body><joint axis='0 0 1'/><geom size='0.1'/>");
    jointed += &("</body>".repeat(29) + "</worldbody></mujoco>");
    bench.write(model, jointed.as_bytes());
    let ended = bench.run(&["tasks", "kinesis"]);
    assert_eq!(ended.code, 1, "{}", ended.stdout);
    assert!(ended.stderr.contains("hint: ") && ended.stderr.contains(model), "{}", ended.stderr);
    // Two velocities of 29 bodies, and touch.
    assert!(
        ended.stderr.contains("178 sensor values") && ended.stderr.contains("there are 0"),
        "{}",
        ended.stderr
    );
}

#[test]
fn random_actions_need_no_file_and_play_what_is_beside_the_paper() {
    let bench = Bench::new();
    let words = ["evaluate", "--policy", "random", "--episodes", "2", "--json", "--task"];
    let document = bench.json(&[&words[..], &["elbow_pose", "hand_reach:ring+thumb"]].concat());
    assert_eq!(keys(&document["tasks"]), ["elbow_pose", "hand_thumb_ring_reach"]);
    let plan = &document["plan"];
    assert_eq!(
        (&plan["policy"]["name"], &plan["actions"]),
        (&json!("random"), &json!("stochastic"))
    );
    for entry in document["tasks"].as_object().unwrap().values() {
        assert_eq!(entry["diverged_steps"], 0);
    }
    let other = bench.json(&[&words[..], &["elbow_pose", "--seed", "1"]].concat());
    let reward = |document: &Value| document["tasks"]["elbow_pose"]["reward"]["mean"].clone();
    let again = bench.json(&[&words[..], &["elbow_pose", "--out", "again"]].concat());
    assert_eq!(reward(&again), reward(&document), "another list of tasks, other actions");
    assert_ne!(again["plan"]["seed"], other["plan"]["seed"]);
}

#[test]
fn the_doctor_finds_what_setup_installed() {
    let document = Bench::new().json(&["doctor", "--json"]);
    let findings = document["findings"].as_array().unwrap();
    let state =
        |what: &str| &findings.iter().find(|f| f["what"] == what).expect("a finding")["state"];
    for part in ["MuJoCo 2.3.7", "MuJoCo 3.17.0", "MyoSuite 2.2.0"] {
        assert_eq!(
            state(part),
            "verified",
            "{part}: `make test` runs `arnold-analyze setup` first"
        );
    }
    assert_eq!(state("default policy"), "found");
}

fn keys(value: &Value) -> Vec<&str> {
    value.as_object().unwrap().keys().map(String::as_str).collect()
}

/// The files a document names, which must be all that is in the run's folder besides the manifest.
fn files_of(document: &Value) -> Vec<PathBuf> {
    let folder = Path::new(document["folder"].as_str().unwrap());
    let named: Vec<PathBuf> = document["files"]
        .as_array()
        .unwrap()
        .iter()
        .map(|path| path.as_str().unwrap().into())
        .collect();
    let found: BTreeSet<PathBuf> =
        files_below(folder).into_keys().map(|name| folder.join(name)).collect();
    let mut expected: BTreeSet<PathBuf> = named.iter().cloned().collect();
    assert!(expected.insert(folder.join("manifest.json")));
    assert_eq!(found, expected);
    named
}

/// Runs `words` twice: the second run says that all is done, prints the same document and touches nothing.
fn run_twice(bench: &Bench, words: &[&str]) -> Value {
    let first = bench.run(words);
    assert_eq!(first.code, 0, "{}", first.stderr);
    // Stdout is the document and nothing else; the talk is on stderr.
    let document: Value = serde_json::from_str(&first.stdout).unwrap();
    assert!(first.stderr.contains("Policy: ") && !first.stderr.contains("Already done"));
    let folder = Path::new(document["folder"].as_str().unwrap());
    let modified = || std::fs::metadata(folder.join("manifest.json")).unwrap().modified().unwrap();
    let before = (files_below(folder), modified());
    let second = bench.run(words);
    assert_eq!((second.code, &second.stdout), (0, &first.stdout));
    assert!(second.stderr.contains("Already done"), "{}", second.stderr);
    assert_eq!((files_below(folder), modified()), before);
    document
}

#[test]
fn evaluate_prints_means_errors_and_counts_and_does_its_work_once() {
    let bench = Bench::new();
    let words = ["evaluate", "--task", "elbow_pose", "--episodes", "3", "--json"];
    let document = run_twice(&bench, &words);
    assert_eq!(keys(&document["tasks"]), ["elbow_pose"]);
    let task = &document["tasks"]["elbow_pose"];
    for quantity in ["solved_fraction", "episode_length", "reward"] {
        for number in ["mean", "sem"] {
            assert!(task[quantity][number].is_f64(), "{quantity}: {}", task[quantity]);
        }
        assert_eq!(task[quantity]["n"], 3);
    }
    assert_eq!(task["episode_length"]["mean"], 100.0);
    let solved = task["solved_fraction"]["mean"].as_f64().unwrap();
    assert!((0.8..=1.0).contains(&solved), "{solved}");
    // The benchmark's reward is 5 for every solved step.
    let reward = task["reward"]["mean"].as_f64().unwrap();
    assert!((reward - 500.0 * solved).abs() < 1e-9, "{reward}");

    let files = files_of(&document);
    let table = read_parquet(files.iter().find(|f| f.ends_with("episodes.parquet")).unwrap());
    assert_eq!(table.unwrap().0.row_count(), 3);
    for (ending, start) in [("svg", &b"<svg"[..]), ("pdf", b"%PDF"), ("png", b"\x89PNG")] {
        let figure = files.iter().find(|f| f.extension().is_some_and(|e| e == ending)).unwrap();
        let bytes = std::fs::read(figure).unwrap();
        assert!(bytes.windows(start.len()).take(200).any(|w| w == start), "{}", figure.display());
    }

    // Quiet: the same document and nothing else.
    let quiet = bench.run(&[&words[..], &["--quiet"]].concat());
    assert_eq!(quiet.stderr, "");
    assert_eq!(serde_json::from_str::<Value>(&quiet.stdout).unwrap(), document);

    // Without `--json`, a table for people.
    let text = bench.run(&words[..5]).stdout;
    assert!(text.contains("solved fraction") && text.contains("episodes.parquet"), "{text}");
}

#[test]
fn csi_prints_curves_and_does_its_work_once() {
    let bench = Bench::new();
    let document = run_twice(
        &bench,
        &["csi", "--task", "elbow_pose", "--episodes", "2", "--components", "1,3,6", "--json"],
    );
    for scope in ["tasks", "pooled"] {
        assert_eq!(keys(&document[scope]), ["elbow_pose"]);
        let curve = &document[scope]["elbow_pose"];
        assert_eq!(curve["components"], json!([1, 3, 6]));
        for name in ["solved_fraction", "explained_variance"] {
            let values: Vec<f64> =
                curve[name].as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
            assert_eq!(values.len(), 3, "{name}");
            assert!(values.iter().all(|x| (0.0..1.0 + 1e-9).contains(x)), "{name}: {values:?}");
        }
        let explained = curve["explained_variance"].as_array().unwrap();
        assert!(explained[0].as_f64() < explained[1].as_f64());
        assert!((explained[2].as_f64().unwrap() - 1.0).abs() < 1e-9);
        assert_eq!(curve["solved_fraction"][2], curve["unprojected"]["mean"]);
    }
    let names: Vec<String> = files_of(&document)
        .iter()
        .map(|path| path.file_name().unwrap().to_string_lossy().into_owned())
        .collect();
    let expected =
        ["curves.parquet", "episodes.parquet", "bases.parquet", "csi.svg", "csi.pdf", "csi.png"];
    assert_eq!(names, expected);
    for name in &expected[..3] {
        let path = Path::new(document["folder"].as_str().unwrap()).join(name);
        assert!(read_parquet(&path).unwrap().0.row_count() > 0, "{name}");
    }
}

fn floats<'a>(table: &'a Table, name: &str) -> &'a [f64] {
    match &table.column(name).unwrap_or_else(|| panic!("no column `{name}`")).values {
        Values::Floats(values) => values,
        other => panic!("`{name}` is {other:?}"),
    }
}

#[test]
fn rollout_records_every_channel_of_every_step() {
    let bench = Bench::new();
    let document = run_twice(
        &bench,
        &["rollout", "--task", "elbow_pose", "--episodes", "2", "--json", "--action-noise", "0.1"],
    );
    let (table, metadata) = read_parquet(&files_of(&document)[0]).unwrap();
    assert_eq!(table.row_count(), 200);
    assert!(metadata.iter().any(|(key, value)| key == "plan" && value.contains("elbow_pose")));
    let muscles = ["TRIlong", "TRIlat", "TRImed", "BIClong", "BICshort", "BRA"];
    for muscle in muscles {
        let channel = |kind: &str| floats(&table, &format!("{kind}.{muscle}"));
        assert!(channel("action_mean").iter().all(|x| x.is_finite()));
        assert_ne!(channel("action_mean"), channel("action"), "noise was added");
        // The muscle's sigmoid (`spec/tasks.md` §1.4), in single precision as the environment computes it.
        for (action, excitation) in channel("action").iter().zip(channel("excitation")) {
            let expected = 1.0 / (1.0 + (-5.0 * (action - 0.5)).exp());
            assert!((excitation - expected).abs() < 1e-6, "{excitation} {expected}");
        }
        assert!(channel("activation").iter().all(|x| (0.0..=1.0).contains(x)));
    }
    let joint = table.column("joint.r_elbow_flex").unwrap();
    assert_eq!(joint.unit, "rad");
    let time = floats(&table, "time");
    assert!((time[0] - 0.02).abs() < 1e-12 && (time[99] - 2.0).abs() < 1e-12, "{time:?}");
    let Values::Integers(episode) = &table.column("episode").unwrap().values else { panic!() };
    assert_eq!((episode[0], episode[99], episode[100], episode[199]), (0, 0, 1, 1));
    let Values::Flags(solved) = &table.column("solved").unwrap().values else { panic!() };
    let share = solved.iter().filter(|&&solved| solved).count() as f64 / 200.0;
    assert_eq!(document["tasks"]["elbow_pose"]["solved_fraction"], share);
}

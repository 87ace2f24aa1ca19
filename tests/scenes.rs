//! Scenes for the viewer: the entities that must be there, the same messages twice, and what the viewer itself says of a file.

#![cfg(feature = "view")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::io::Cursor;
use std::path::{Path, PathBuf};
use std::process::Command;

use common::bench::Bench;
use re_sdk::StoreKind;
use re_sdk::external::re_log_encoding::Decoder;
use re_sdk::log::{Chunk, LogMsg};

/// Rows of every entity of every recording in a scene, by recording and path; blueprints only by their count.
fn contents(scene: &Path) -> (BTreeMap<String, BTreeMap<String, usize>>, usize) {
    let bytes = Cursor::new(std::fs::read(scene).unwrap());
    let (mut recordings, mut blueprints): (BTreeMap<_, BTreeMap<_, _>>, _) = Default::default();
    for message in Decoder::<LogMsg>::decode_eager(bytes).unwrap() {
        match message.unwrap() {
            LogMsg::BlueprintActivationCommand(_) => blueprints += 1,
            LogMsg::ArrowMsg(store, message) if store.kind() == StoreKind::Recording => {
                let chunk = Chunk::from_arrow_msg(&message).unwrap();
                let rows = recordings.entry(store.recording_id().to_string()).or_default();
                *rows.entry(chunk.entity_path().to_string()).or_default() += chunk.num_rows();
            }
            _ => {}
        }
    }
    (recordings, blueprints)
}

/// Every message of a scene: where it belongs and the names of its columns, and the columns. The index behind them is not
/// among them.
fn messages(scene: &Path) -> Vec<(String, impl PartialEq + std::fmt::Debug + use<>)> {
    let bytes = Cursor::new(std::fs::read(scene).unwrap());
    let all = Decoder::<LogMsg>::decode_eager(bytes).unwrap();
    all.map(|message| match message.unwrap() {
        LogMsg::ArrowMsg(store, message) => {
            let chunk = Chunk::from_arrow_msg(&message).unwrap();
            let schema = message.batch.schema();
            let names: Vec<&String> = schema.fields().iter().map(|field| field.name()).collect();
            let (id, path, rows) = (chunk.id(), chunk.entity_path(), chunk.row_ids_slice());
            let place = format!("{store} {path} {id} {rows:?} {names:?}");
            (place, message.batch.columns().to_vec())
        }
        other => (format!("{:?}", other.store_id()), Vec::new()),
    })
    .collect()
}

/// The viewer, if it is installed in the version that reads these files.
fn viewer() -> Option<PathBuf> {
    let program = std::env::var_os("RERUN").unwrap_or_else(|| "rerun".into());
    let version = Command::new(&program).arg("--version").output();
    let version = version.map(|output| String::from_utf8_lossy(&output.stdout).into_owned());
    if version.is_ok_and(|version| version.contains(" 0.36.3 ")) {
        return Some(program.into());
    }
    eprintln!("skipped: there is no Rerun 0.36.3 (`pip install rerun-sdk==0.36.3`, or `$RERUN`)");
    None
}

fn verify(scene: &Path) {
    let Some(viewer) = viewer() else { return };
    let output = Command::new(viewer).args(["rrd", "verify"]).arg(scene).output().unwrap();
    let said = String::from_utf8_lossy(&output.stderr) + String::from_utf8_lossy(&output.stdout);
    assert!(output.status.success(), "{said}");
}

const ROLLOUT: [&str; 9] = [
    "rollout",
    "--task",
    "elbow_pose",
    "--episodes",
    "2",
    "--action-noise",
    "0.1",
    "--format",
    "parquet,mcap",
];

#[test]
fn a_recorded_episode_becomes_a_scene_with_body_tendons_and_signals() {
    let bench = Bench::new();
    let scene = bench.path("elbow.rrd");
    let save = ["--save", "elbow.rrd", "--quiet"];
    assert_eq!(bench.run(&[&ROLLOUT[..], &save].concat()).code, 0);
    let (recordings, blueprints) = contents(&scene);
    assert_eq!((recordings.len(), blueprints), (2, 1));
    for rows in recordings.values() {
        let take: BTreeSet<&str> = rows.keys().filter_map(|path| path.split('/').nth(1)).collect();
        let take = take.into_iter().find(|first| first.contains("mini")).unwrap();
        let of = |path: &str| rows.get(&format!("/{take}/{path}")).copied().unwrap_or(0);
        let frames = of("tendons");
        assert!(frames > 10, "{rows:?}");
        // Frame 0 is the start; a signal has one row per step. The line of a map is there at every frame.
        assert_eq!(of("contacts"), frames);
        assert_eq!(of("muscles_by_time/now"), frames);
        assert_eq!(of("muscles_by_time"), 1);
        for signal in ["activation", "action_mean", "action", "joint", "reward_component", "solved"]
        {
            // What the lines are called stands in a row of its own.
            assert_eq!(of(&format!("signals/{signal}")), frames, "{signal}");
        }
        // The pose to be reached stands beside the body.
        let ghost = rows.keys().filter(|path| path.starts_with(&format!("/{take}/ghost/")));
        assert!(ghost.count() > 0, "{rows:?}");
        assert_eq!(of("muscles_by_time/names"), 1);
        let bodies: Vec<&String> =
            rows.keys().filter(|path| path.starts_with(&format!("/{take}/body/"))).collect();
        assert!(bodies.iter().any(|path| path.ends_with("/surface")), "{bodies:?}");
        let moving = bodies.iter().filter(|path| path.split('/').count() == 4);
        assert!(moving.clone().count() > 2 && moving.clone().all(|path| rows[*path] == frames));
    }
    verify(&scene);
}

#[test]
fn the_same_recording_gives_the_same_messages_from_every_format_and_two_stand_side_by_side() {
    let bench = Bench::new();
    let out = [&ROLLOUT[..], &["--json", "--out", "runs"]].concat();
    let folder = bench.json(&out)["folder"].as_str().unwrap().to_owned();
    let file = |extension: &str| format!("{folder}/elbow_pose.{extension}");
    let view = |name: &str, recordings: &[&str]| {
        let words = [&["view"], recordings, &["--episode", "1", "--save", name]].concat();
        let ended = bench.run(&words);
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        messages(&bench.path(name))
    };
    let parquet = view("a.rrd", &[&file("parquet")]);
    assert!(parquet.iter().any(|(place, _)| place.contains("/tendons")), "{parquet:?}");
    assert_eq!(parquet, view("b.rrd", &[&file("parquet")]));
    view("c.rrd", &[&file("mcap")]);
    let (of_mcap, _) = contents(&bench.path("c.rrd"));
    let (of_parquet, _) = contents(&bench.path("a.rrd"));
    assert_eq!(
        of_mcap.values().collect::<Vec<_>>(),
        of_parquet.values().collect::<Vec<_>>(),
        "the notes name another file, so the recordings have other names"
    );
    let both = [format!("first={}", file("parquet")), format!("second={}", file("mcap"))];
    view("both.rrd", &[&both[0], &both[1]]);
    let (recordings, _) = contents(&bench.path("both.rrd"));
    let rows = recordings.values().next().unwrap();
    assert_eq!(recordings.len(), 1);
    assert_eq!(rows["/first/tendons"], rows["/second/tendons"]);
    verify(&bench.path("both.rrd"));
}

#[test]
fn a_run_that_was_finished_before_is_shown_all_the_same() {
    let bench = Bench::new();
    for scene in ["first.rrd", "again.rrd"] {
        let words = [&ROLLOUT[..], &["--quiet", "--save", scene]].concat();
        assert_eq!(bench.run(&words).code, 0);
    }
    assert_eq!(messages(&bench.path("first.rrd")), messages(&bench.path("again.rrd")));
    let csi =
        ["csi", "--task", "elbow_pose", "--episodes", "2", "--components", "1,3,6", "--no-pooled"];
    for basis in ["pca", "nmf"] {
        let fits = if basis == "nmf" { &["--n-fits", "1"][..] } else { &[] };
        let first = format!("{basis}.rrd");
        let again = format!("{basis} again.rrd");
        for scene in [&first, &again] {
            let words = [&csi[..], fits, &["--basis", basis, "--save", scene]].concat();
            let ended = bench.run(&words);
            assert_eq!(ended.code, 0, "{}", ended.stderr);
        }
        assert_eq!(messages(&bench.path(&first)), messages(&bench.path(&again)), "{basis}");
        let (recordings, _) = contents(&bench.path(&again));
        let rows = recordings.values().next().unwrap();
        assert_eq!(recordings.len(), 1, "the first episode of the task");
        for take in ["free", "1\\ component", "3\\ components"] {
            assert!(rows.contains_key(&format!("/{take}/tendons")), "{basis}, {take}: {rows:?}");
        }
    }
}

#[test]
fn what_cannot_be_shown_says_why() {
    let bench = Bench::new();
    let out = [&ROLLOUT[..], &["--json", "--out", "runs"]].concat();
    let folder = bench.json(&out)["folder"].as_str().unwrap().to_owned();
    let recording = format!("{folder}/elbow_pose.mcap");
    let cases = [
        (vec!["view", &recording, "--episode", "7", "--save", "a.rrd"], "no episode 7"),
        (vec!["view", &recording, "--task", "pen", "--save", "a.rrd"], "no recording of pen"),
        (vec!["view", "nothing.mcap", "--save", "a.rrd"], "nothing.mcap"),
        (vec!["view", &recording, "--connect", "nowhere"], "`nowhere` is no address"),
    ];
    for (words, want) in cases {
        let ended = bench.run(&words);
        assert_eq!(ended.code, 1, "{words:?}");
        assert!(ended.stderr.contains(want) && ended.stderr.contains("hint:"), "{}", ended.stderr);
        assert!(!bench.path("a.rrd").exists());
    }
}

//! Recordings in the formats of this program and of upstream: read, converted, looked at, and refused where damaged.

#![cfg(all(feature = "parquet", feature = "mcap", feature = "hdf5"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::process::Command;

use arnold_analyze::files::write_atomic;
use arnold_analyze::record::hdf5::axes::Axes;
use arnold_analyze::record::hdf5::{ExportOptions, export};
use arnold_analyze::record::profiles::{HumanProfiles, SimulationProfiles};
use arnold_analyze::record::{
    Format, Opened, Place, Precision, Recording, Timing, names, read_recording, write_recording,
};
use common::bench::Bench;
use serde_json::Value;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/recordings").join(name)
}

/// The numbers of `make.py` beside the fixtures.
fn value(episode: usize, step: usize, column: usize) -> f64 {
    ((episode * 31 + step * 7 + column * 3) % 64) as f64 / 64.0 - 0.25
}

fn assert_formula(recording: &Recording, channel: &str) {
    for episode in &recording.episodes {
        let samples = recording.samples(episode, channel).unwrap();
        let width = recording.channel(channel).unwrap().width();
        for (place, found) in samples.values().enumerate() {
            let want = value(episode.facts.number as usize, place / width, place % width);
            assert_eq!(found.to_bits(), want.to_bits(), "{channel} {place}");
        }
    }
}

fn elements(recording: &Recording, channel: &str) -> Vec<String> {
    let channel = recording.channel(channel).unwrap();
    channel.elements.iter().map(|element| element.name.clone()).collect()
}

fn numbers_and_lengths(recording: &Recording) -> Vec<(u64, usize)> {
    recording.episodes.iter().map(|e| (e.facts.number, e.facts.length)).collect()
}

fn export_options(task: &str, episodes: Result<Vec<u64>, usize>) -> ExportOptions {
    ExportOptions {
        task: task.to_owned(),
        policy: "285_64670238".to_owned(),
        episodes,
        axes: Axes::hand(),
        horizon: 150,
        control_interval: Some(0.01),
        actions_clipped: Some(false),
        means_clipped: None,
    }
}

#[test]
fn the_compact_layout_is_read_with_gaps_extras_and_padding() {
    let Opened { recording, left_out } = read_recording(&fixture("compact.h5")).unwrap();
    assert_eq!(left_out, ["extra"]);
    assert_eq!(numbers_and_lengths(&recording), [(2, 3), (10, 4)]);
    let about = &recording.about;
    assert_eq!((about.task.as_str(), about.policy.as_str()), ("pen", "arnold/seed_0"));
    assert_eq!((about.control_interval, about.horizon), (Some(0.01), Some(100)));
    assert_eq!((about.seed, about.deterministic), (Some(3), Some(false)));
    assert_eq!(
        (about.metadata["success_only"].as_str(), about.metadata["lab"].as_str()),
        ("true", "somewhere")
    );
    for channel in [names::ACTION, names::JOINT, names::REWARD] {
        assert_formula(&recording, channel);
    }
    assert_eq!(elements(&recording, names::JOINT), ["a", "b"]);
    assert_eq!(elements(&recording, names::ACTION), ["x", "y", "z"]);
    assert_eq!(recording.channel(names::JOINT).unwrap().units(), ["rad"]);
    assert_eq!(recording.channel(names::JOINT).unwrap().precision, Precision::Single);
    assert_eq!(recording.channel(names::SOLVED).unwrap().precision, Precision::Flag);
    assert_eq!(recording.channel(names::REWARD).unwrap().timing, Some(Timing::AfterStep));
}

#[test]
fn episodes_of_the_first_release_are_exported_with_the_newest_frame() {
    let opened = export(&fixture("episodes"), &export_options("pen", Err(100))).unwrap();
    assert_eq!(opened.left_out, ["decoder_output"]);
    let recording = opened.recording;
    assert_eq!(numbers_and_lengths(&recording), [(2, 2), (11, 3)]);
    for channel in [names::ACTION, names::ACTION_MEAN, names::JOINT] {
        assert_formula(&recording, channel);
    }
    assert_eq!(recording.channel(names::JOINT).unwrap().width(), 23);
    assert_eq!(elements(&recording, names::JOINT)[22], "md5_flexion");
    assert_eq!(elements(&recording, names::ACTION)[38], "UI_UB5");
    let plain = read_recording(&fixture("plain/pen_episode_0.h5")).unwrap().recording;
    for channel in [names::ACTION, names::JOINT, names::EXCITATION] {
        assert_formula(&plain, channel);
    }
    let one = export(&fixture("episodes"), &export_options("pen", Ok(vec![11]))).unwrap();
    assert_eq!(numbers_and_lengths(&one.recording), [(11, 3)]);
    let error = export(&fixture("episodes"), &export_options("pen", Ok(vec![3]))).unwrap_err();
    assert!(error.to_string().contains("`pen_episode_3.h5`"), "{error}");
    let error = export(&fixture("episodes"), &export_options("reorient", Err(1))).unwrap_err();
    assert!(error.to_string().contains("`reorient_episode_*.h5`"), "{error}");
}

#[test]
fn gait_is_read_and_written_and_other_channels_are_named() {
    let folder = tempfile::tempdir().unwrap();
    let gait = read_recording(&fixture("gait.h5")).unwrap().recording;
    for channel in [names::ACTIVATION, names::FOOT_CONTACT, names::ROOT_VELOCITY] {
        assert_formula(&gait, channel);
        assert_eq!(gait.channel(channel).unwrap().timing, Some(Timing::BeforeStep));
    }
    assert_eq!(gait.about.control_interval, Some(1.0 / 30.0));
    assert_eq!(gait.about.metadata["moving_goal"], "true");
    let again = folder.path().join("gait.h5");
    let files = [(Format::Gait, again.clone())];
    assert_eq!(write_recording(gait.clone(), &files, Place::New).unwrap(), []);
    assert_eq!(read_recording(&again).unwrap().recording, gait);
    let pen = read_recording(&fixture("compact.h5")).unwrap().recording;
    let files = [(Format::Gait, folder.path().join("pen.h5"))];
    let error = write_recording(pen, &files, Place::New).unwrap_err().to_string();
    assert!(error.contains("without `activation`"), "{error}");
}

#[test]
fn every_upstream_recording_survives_every_format() {
    let folder = tempfile::tempdir().unwrap();
    for name in ["compact.h5", "gait.h5", "plain/pen_episode_0.h5"] {
        let want = read_recording(&fixture(name)).unwrap().recording;
        for format in [Format::Parquet, Format::Mcap, Format::Hdf5] {
            let path = folder.path().join(format!("{}-{}", name.replace('/', "-"), format.word()));
            let files = [(format, path.clone())];
            write_recording(want.clone(), &files, Place::New).unwrap();
            let found = read_recording(&path).unwrap();
            assert_eq!(found.left_out, [""; 0]);
            assert_eq!(found.recording, want, "{name} as {}", format.word());
        }
    }
}

#[test]
fn profiles_of_people_are_read() {
    let human = HumanProfiles::open(&fixture("human.npz")).unwrap();
    assert_eq!((human.subjects.as_slice(), human.points), ([4, 12].as_slice(), 3));
    assert_eq!(human.muscles, ["Soleus", "Tibialis Anterior"]);
    assert_eq!(human.profiles[3].to_bits(), value(0, 1, 1).to_bits());
}

#[test]
fn the_published_layouts_give_the_recorded_numbers() {
    let Some(folder) = common::golden("analysis") else { return };
    let folder = folder.join("upstream_formats");
    let text = std::fs::read_to_string(folder.join("expected.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let number = |value: &Value| value.as_f64().unwrap();
    let close = |found: f64, want: &Value, what: &str| {
        let (absolute, relative) =
            (number(&expected["tolerance"]["abs"]), number(&expected["tolerance"]["rel"]));
        let want = number(want);
        assert!((found - want).abs() <= absolute + relative * want.abs(), "{what}: {found} {want}");
    };
    let open = |name: &str| match name {
        "activations/285_64670238/reorient" | "activations/mlp/pen" => {
            let (within, task) = name.rsplit_once('/').unwrap();
            export(&folder.join(within), &export_options(task, Err(100))).unwrap().recording
        }
        file => read_recording(&folder.join(file)).unwrap().recording,
    };
    let mut checked = 0;
    for (name, wanted) in expected["files"].as_object().unwrap() {
        let Some(order) = wanted["episodes_in_order"].as_array() else { continue };
        let recording = open(name);
        let found: Vec<u64> = recording.episodes.iter().map(|e| e.facts.number).collect();
        let order: Vec<u64> = order.iter().map(|n| n.as_u64().unwrap()).collect();
        assert_eq!(found, order, "{name}");
        if let Some(names) = wanted["muscle_names"].as_array() {
            assert_eq!(elements(&recording, names::ACTION), *names);
            assert_eq!(
                elements(&recording, names::JOINT),
                *wanted["joint_names"].as_array().unwrap()
            );
            assert_eq!(Axes::hand().muscle_names, *names);
            assert_eq!(recording.step_count() as u64, wanted["rows_total"].as_u64().unwrap());
        }
        for episode in &recording.episodes {
            let wanted = &wanted["episodes"][episode.facts.number.to_string()];
            assert_eq!(episode.facts.length as u64, wanted["length"].as_u64().unwrap());
            for (key, channel) in [
                ("solved_steps", names::SOLVED),
                ("reward_sum", names::REWARD),
                ("action_sum", names::ACTION),
                ("mean_sum", names::ACTION_MEAN),
                ("control_sum", names::EXCITATION),
            ] {
                if !wanted[key].is_null() {
                    close(recording.total(episode, channel).unwrap(), &wanted[key], key);
                    checked += 1;
                }
            }
            let joints = recording.samples(episode, names::JOINT).unwrap();
            let last = 23 * (episode.facts.length - 1);
            for (joint, want) in wanted["last_joint_row"].as_array().unwrap().iter().enumerate() {
                close(joints.value(last + joint), want, "last joint row");
                checked += 1;
            }
        }
    }
    assert!(checked >= 47, "only {checked} numbers were compared");
    for policy in ["arnold", "obc", "kinesis"] {
        let gait = open(&format!("emg/rollouts/{policy}.h5"));
        assert_eq!((gait.about.seed, gait.about.deterministic), (Some(42), Some(true)));
        assert_eq!(gait.channel(names::ACTIVATION).unwrap().width(), 80);
        assert_eq!(elements(&gait, names::FOOT_CONTACT), names::FEET);
    }
    let human = HumanProfiles::open(&folder.join("emg/human.npz")).unwrap();
    assert_eq!((human.subjects.len(), human.points, human.muscles.len()), (9, 100, 9));
    let simulation = SimulationProfiles::open(&folder.join("emg/simulation.npz")).unwrap();
    for (name, rows) in expected["files"]["emg"]["profiles_every_50th_point"].as_object().unwrap() {
        let profile = &simulation.profiles[name];
        for (muscle, row) in rows.as_array().unwrap().iter().enumerate() {
            for (place, want) in row.as_array().unwrap().iter().enumerate() {
                close(profile.values[muscle * profile.points + 50 * place], want, name);
            }
        }
    }
}

/// Muscles and joints of `spec/analysis.md` §0.1.
#[cfg(all(feature = "sim", feature = "figures"))]
#[test]
fn every_task_records_the_muscles_and_joints_of_its_body() {
    use arnold_analyze::assets::PhysicsVersion;
    use arnold_analyze::sim::{rollout::channel_names, tasks};
    let machine = common::physics::Physics::of(PhysicsVersion::V2_3_7).machine();
    for task in tasks::ALL {
        let names = match channel_names(&machine, task) {
            Ok(names) => names,
            Err(error) => {
                eprintln!("skipped: {error}");
                continue;
            }
        };
        let expected = match task.name {
            "elbow_pose" => (6, 1),
            "relocate" => (63, 38),
            "kinesis" => (80, 28),
            _ => (39, 23),
        };
        assert_eq!((names.muscles.len(), names.joints.len()), expected, "{}", task.name);
        assert_eq!(names.walking, task.name == "kinesis");
        assert_eq!(names.joints.iter().any(|joint| joint.slides), names.walking, "{}", task.name);
        assert!(!names.reward_components.is_empty());
    }
}

#[test]
fn damaged_hdf5_is_an_error_and_never_a_panic() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("damaged.h5");
    for name in ["compact.h5", "gait.h5", "plain/pen_episode_0.h5"] {
        let bytes = std::fs::read(fixture(name)).unwrap();
        let try_reading = |bytes: &[u8]| {
            arnold_analyze::files::write_atomic(&path, bytes).unwrap();
            // Some bytes do not matter; what matters is that there is an answer, soon.
            let start = std::time::Instant::now();
            let found = read_recording(&path);
            assert!(start.elapsed().as_secs() < 10, "{name} took {:?}", start.elapsed());
            found.is_ok()
        };
        let step = bytes.len() / 60;
        for length in (0..bytes.len() - 1).step_by(step) {
            assert!(!try_reading(&bytes[..length]), "{length} bytes of {name} were read");
        }
        // A fixed sequence of places and values (Lehmer's generator), so that a failure can be repeated.
        let mut state = 20_261_122_u64;
        let mut next = || {
            state = state * 48_271 % 0x7fff_ffff;
            state as usize
        };
        let mut refused = 0;
        for _ in 0..1500 {
            let mut changed = bytes.clone();
            for _ in 0..=next() % 3 {
                let place = next() % changed.len();
                changed[place] = [0, 0xff, 0x80, next() as u8][next() % 4];
            }
            refused += usize::from(!try_reading(&changed));
        }
        assert!(refused > 100, "only {refused} changes of {name} were noticed");
    }
}

#[test]
fn what_is_missing_in_a_file_is_named() {
    let folder = tempfile::tempdir().unwrap();
    for (name, bytes, complaint) in [
        ("nothing.h5", b"".as_slice(), "no format of a recording"),
        ("magic.h5", b"\x89HDF\r\n\x1a\n and then nothing".as_slice(), "not a readable HDF5"),
        ("magic.mcap", b"\x89MCAP0\r\n".as_slice(), "not a readable MCAP"),
        ("magic.parquet", b"PAR1PAR1".as_slice(), "Parquet"),
    ] {
        let path = folder.path().join(name);
        write_atomic(&path, bytes).unwrap();
        let error = read_recording(&path).unwrap_err().to_string();
        assert!(error.contains(complaint) && error.contains(name), "{error}");
    }
    let error = read_recording(folder.path()).unwrap_err().to_string();
    assert!(error.contains("it is a folder"), "{error}");
}

#[test]
fn convert_says_what_it_dropped_and_does_not_overwrite() {
    let bench = Bench::new();
    let folder = tempfile::tempdir().unwrap();
    let out = |name: &str| folder.path().join(name).display().to_string();
    let compact = fixture("compact.h5").display().to_string();
    let dropped = bench.run(&["convert", &compact, "--to", "mcap", "--out", &out("pen.mcap")]);
    assert_eq!(dropped.code, 3, "{}", dropped.stderr);
    assert!(dropped.stderr.contains("warning: `extra`"), "{}", dropped.stderr);
    assert!(dropped.stdout.contains("2 episodes, 7 steps"), "{}", dropped.stdout);
    let again = bench.run(&["convert", &compact, "--to", "mcap", "--out", &out("pen.mcap")]);
    assert_eq!(again.code, 1);
    assert!(
        again.stderr.contains("exists already") && again.stderr.contains("hint: "),
        "{}",
        again.stderr
    );
    let table = bench.run(&[
        "convert",
        &out("pen.mcap"),
        "--to",
        "parquet",
        "--out",
        &out("new/"),
        "--json",
    ]);
    assert_eq!((table.code, table.stderr.as_str()), (0, ""));
    let document: Value = serde_json::from_str(&table.stdout).unwrap();
    assert_eq!(document["files"][0]["out"], out("new/pen.parquet"));
    let some = bench.run(&[
        "convert",
        &compact,
        "--to",
        "hdf5",
        "--out",
        &out("some.h5"),
        "--signals",
        "actions",
    ]);
    assert_eq!((some.code, some.stderr.as_str()), (0, ""));
    let kept = read_recording(Path::new(&out("some.h5"))).unwrap().recording;
    let kept: Vec<&str> = kept.channels.iter().map(|channel| channel.name.as_str()).collect();
    assert_eq!(kept, [names::ACTION, names::REWARD, names::SOLVED]);
    let unknown = bench.run(&[
        "convert",
        &compact,
        "--to",
        "hdf5",
        "--out",
        &out("x.h5"),
        "--signals",
        "torque",
    ]);
    assert_eq!(unknown.code, 1);
    assert!(unknown.stderr.contains("no channel `torque`"), "{}", unknown.stderr);
    let episodes = fixture("episodes").display().to_string();
    let bare = bench.run(&["convert", &episodes, "--to", "hdf5", "--out", &out("e.h5")]);
    assert!(
        bare.code == 1 && bare.stderr.contains("hint: give it with `--task NAME`"),
        "{}",
        bare.stderr
    );
    let exported = bench.run(&[
        "convert",
        &episodes,
        "--to",
        "hdf5",
        "--out",
        &out("e.h5"),
        "--task",
        "pen",
        "--horizon",
        "100",
        "--policy-id",
        "arnold/seed_0",
        "--means-clipped",
        "false",
    ]);
    assert_eq!(exported.code, 3, "{}", exported.stderr);
    assert!(exported.stderr.contains("`decoder_output`"), "{}", exported.stderr);
    let inspected = bench.run(&["inspect", &out("e.h5")]);
    assert_eq!((inspected.code, inspected.stderr.as_str()), (0, ""));
    for line in ["HDF5, compact", "arnold/seed_0", "joint              23  rad   before the step"] {
        assert!(inspected.stdout.contains(line), "no `{line}` in\n{}", inspected.stdout);
    }
}

#[test]
fn other_programs_read_what_is_written() {
    let python = std::env::var("ARNOLD_PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let has = Command::new(&python).args(["-c", "import h5py, mcap, polars, zstandard"]).output();
    if !has.is_ok_and(|output| output.status.success()) {
        eprintln!("skipped: `{python}` (`$ARNOLD_PYTHON`) has no h5py, mcap, polars, zstandard");
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let recording = read_recording(&fixture("compact.h5")).unwrap().recording;
    let want =
        format!("7 {:?}\n", recording.stacked(names::ACTION).unwrap().values.iter().sum::<f64>());
    let files = [Format::Parquet, Format::Mcap, Format::Hdf5]
        .map(|format| (format, folder.path().join(format!("pen.{}", format.extension()))));
    write_recording(recording, &files, Place::New).unwrap();
    let output = Command::new(&python)
        .arg(fixture("read.py"))
        .args(files.iter().map(|(_, path)| path))
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr);
    assert_eq!(String::from_utf8_lossy(&output.stdout), want.repeat(3), "{errors}");
}

/// Topic and fields of a path as Foxglove reads it: `/activation.value."ECRL"`. Names in quotes may hold anything.
fn topic_and_fields(path: &str) -> (String, Vec<String>) {
    let (topic, mut rest) = path.split_once('.').unwrap();
    let mut fields = Vec::new();
    loop {
        let (field, after) = match rest.strip_prefix('"') {
            Some(quoted) => quoted.split_once('"').unwrap(),
            None => rest.split_at(rest.find('.').unwrap_or(rest.len())),
        };
        fields.push(field.to_owned());
        match after.strip_prefix('.') {
            Some(more) => rest = more,
            None => break,
        }
    }
    (topic.to_owned(), fields)
}

/// The type that a schema gives to a field. Foxglove takes single types only, and lists what an object has.
fn type_of_field<'a>(schema: &'a Value, fields: &[String]) -> &'a str {
    let schema = fields.iter().fold(schema, |schema, field| {
        assert_eq!(schema["type"], "object");
        &schema["properties"][field.as_str()]
    });
    schema["type"].as_str().unwrap_or("nothing")
}

#[test]
fn every_path_of_a_foxglove_layout_finds_a_number_in_a_recording_of_its_body() {
    let bench = Bench::new();
    let data = common::data_folder();
    let walks = data.join("kinesis/xml/myolegs_onlylegs.xml").is_file();
    let data = data.display().to_string();
    let bodies = [
        ("hand", "baoding_p1_ccw"),
        ("arm", "relocate"),
        ("elbow", "elbow_pose"),
        ("legs", "kinesis_forward"),
    ];
    for (body, task) in bodies {
        if body == "legs" && !walks {
            eprintln!("skipped: no walking body in `{data}`");
            continue;
        }
        let rollout = ["rollout", "--policy", "random", "--task", task, "--episodes", "1"];
        let to = ["--format", "mcap", "--json", "--data", &data];
        let document = bench.json(&[&rollout[..], &to].concat());
        let folder = Path::new(document["folder"].as_str().unwrap());
        let bytes = std::fs::read(folder.join(format!("{task}.mcap"))).unwrap();
        let summary = mcap::Summary::read(&bytes).unwrap().unwrap();
        let schemas: BTreeMap<String, Value> = summary
            .channels
            .values()
            .map(|channel| {
                let schema = channel.schema.as_ref().unwrap();
                assert_eq!((&*schema.encoding, &*channel.message_encoding), ("jsonschema", "json"));
                (channel.topic.clone(), serde_json::from_slice(&schema.data).unwrap())
            })
            .collect();
        let mut messages: BTreeMap<String, Value> = BTreeMap::new();
        for message in mcap::MessageStream::new(&bytes).unwrap() {
            let message = message.unwrap();
            let read = || serde_json::from_slice(&message.data).unwrap();
            messages.entry(message.channel.topic.clone()).or_insert_with(read);
        }
        let layout = format!("{}/data/foxglove/{body}.json", env!("CARGO_MANIFEST_DIR"));
        let layout: Value = serde_json::from_slice(&std::fs::read(layout).unwrap()).unwrap();
        let panels = layout["configById"].as_object().unwrap();
        let lines = panels.values().flat_map(|panel| panel["paths"].as_array().unwrap());
        let mut count = 0;
        for line in lines {
            let path = line["value"].as_str().unwrap();
            let (topic, fields) = topic_and_fields(path);
            let schema = schemas.get(&topic).unwrap_or_else(|| panic!("no topic for `{path}`"));
            let known = type_of_field(schema, &fields);
            let value =
                fields.iter().fold(&messages[&topic], |value, field| &value[field.as_str()]);
            let fits = match known {
                "number" => value.is_number(),
                "boolean" => value.is_boolean(),
                _ => false,
            };
            assert!(fits, "{body}, `{path}`: `{known}` and {value}");
            count += 1;
        }
        assert!(count > 20, "{body}: {count}");
    }
}

#[test]
fn every_line_of_a_foxglove_layout_is_a_quantity_that_rollout_records() {
    use arnold_analyze::assets::PhysicsVersion;
    use arnold_analyze::sim::{rollout::channel_names, tasks};
    let machine = common::physics::Physics::of(PhysicsVersion::V2_3_7).machine();
    for (body, task) in [("hand", "baoding_p1_ccw"), ("arm", "relocate"), ("elbow", "elbow_pose")] {
        let path = Path::new(env!("CARGO_MANIFEST_DIR")).join(format!("data/foxglove/{body}.json"));
        let layout: Value = serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap();
        let names = channel_names(&machine, tasks::find(task).unwrap()).unwrap();
        let panels = layout["configById"].as_object().unwrap();
        let lines = |panel: &str| -> Vec<String> {
            let paths = panels[panel]["paths"].as_array().unwrap();
            paths.iter().map(|line| line["value"].as_str().unwrap().to_owned()).collect()
        };
        let of = |channel: &str, names: Vec<&String>| -> Vec<String> {
            names.iter().map(|name| format!("/{channel}.value.\"{name}\"")).collect()
        };
        let muscles: Vec<&String> = names.muscles.iter().collect();
        assert_eq!(lines("Plot!activation"), of("activation", muscles.clone()), "{body}");
        assert_eq!(lines("Plot!action"), of("action", muscles), "{body}");
        let joints = names.joints.iter().map(|joint| &joint.name).collect();
        assert_eq!(lines("Plot!joint"), of("joint", joints), "{body}");
        assert_eq!(lines("Plot!reward"), ["/reward.value"], "{body}");
        let arranged = layout["layout"].to_string();
        assert!(panels.keys().all(|panel| arranged.contains(&format!("\"{panel}\""))), "{body}");
    }
}

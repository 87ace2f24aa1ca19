//! `emg` and `factors` as a process: on the invented people of this repository, and on the published people and the
//! published KINESIS recording where they are present.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures", feature = "hdf5"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::{Path, PathBuf};

use arnold_analyze::analysis::emg::{BicepsFemoris, HUMAN_CHANNELS, Side, model_muscles};
use arnold_analyze::analysis::factor::{FACTOR_MUSCLES, compartments};
use arnold_analyze::analysis::signal::resample;
use arnold_analyze::analysis::stats::pearson;
use arnold_analyze::experiment::emg_subjects::{WalkingSpeed, read_subjects};
use arnold_analyze::record::profiles::{Profile, SimulationProfiles};
use arnold_analyze::record::{
    About, Channel, Episode, EpisodeFacts, Format, Place, Precision, Recording, Samples, Timing,
    names, write_recording,
};
use common::bench::{Bench, files_below};
use serde_json::Value;

fn invented() -> String {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/emg").display().to_string()
}

/// The published people and recording, if they are here.
fn published() -> Option<PathBuf> {
    Some(common::published("emg_wang2023_kinesis_assets")?.join("emg_assets"))
}

fn text(path: &Path) -> String {
    path.display().to_string()
}

/// A run folder of this bench with everything but the manifest, which says when and where.
fn results(bench: &Bench) -> std::collections::BTreeMap<String, Vec<u8>> {
    let mut files = files_below(&bench.path("runs"));
    files.retain(|name, _| !name.ends_with("manifest.json"));
    files
}

fn assert_near(found: &Value, want: f64) {
    let found = found.as_f64().unwrap();
    assert!((found - want).abs() < 5e-5, "{found}, not {want}");
}

#[test]
fn a_fresh_clone_compares_invented_people_and_says_so_everywhere() {
    let bench = Bench::new();
    let people = invented();
    let ended = bench.run(&["emg", "--subjects", &people]);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    assert!(ended.stderr.contains("ARE INVENTED"), "{}", ended.stderr);
    assert!(ended.stdout.contains("THE PEOPLE ARE INVENTED"), "{}", ended.stdout);
    let widest = ended.stdout.lines().map(|line| line.chars().count()).max().unwrap();
    assert!(widest <= 80, "a line of {widest} characters");
    let files = results(&bench);
    let svg = files.iter().find(|(name, _)| name.ends_with("/correlations.svg")).unwrap();
    assert!(String::from_utf8_lossy(svg.1).contains("PEOPLE ARE INVENTED"));
    let document = bench.json(&["emg", "--subjects", &people, "--json"]);
    assert_eq!(document["people"]["synthetic"], true);
    assert_near(&document["people"]["leave_one_out"]["mean"], 0.9777);

    let again = Bench::new();
    again.run(&["emg", "--subjects", &people, "--quiet"]);
    assert!(results(&again) == files, "the same people give other bytes");
}

#[test]
fn people_who_cannot_be_compared_are_errors_with_a_remedy() {
    let bench = Bench::new();
    let synthetic = Path::new(env!("CARGO_MANIFEST_DIR")).join("data/emg/synthetic");
    let bytes = |name: &str| std::fs::read(synthetic.join(name)).unwrap();
    let person = bytes("EMG_subject_04_walk_45_avg.npy");
    let labels = bytes("EMG_labels.npy");
    let mut nan = person.clone();
    let last = nan.len() - 8;
    nan[last..].copy_from_slice(&f64::NAN.to_le_bytes());
    // `Soleus` begins the second label.
    let place = labels.windows(4).position(|letter| letter == b"S\0\0\0").unwrap();
    let mut renamed = labels.clone();
    renamed[place] = b'T';
    let cases = [
        ("alone", &labels, vec![&person], "expected at least 2 subjects, found 1"),
        ("renamed", &renamed, vec![&person, &person], "is `Toleus`, expected `Soleus`"),
        ("undefined", &labels, vec![&person, &nan], "NaN"),
        ("nobody", &labels, vec![], "nobody was recorded at 4.5 km/h"),
    ];
    for (folder, labels, people, message) in cases {
        bench.write(&format!("{folder}/EMG_labels.npy"), labels);
        for (number, person) in people.iter().enumerate() {
            bench.write(&format!("{folder}/EMG_subject_{number:02}_walk_45_avg.npy"), person);
        }
        let ended = bench.run(&["emg", "--subjects", folder]);
        assert_eq!((ended.code, ended.stdout.as_str()), (1, ""), "{folder}: {}", ended.stderr);
        assert!(ended.stderr.contains(message), "{folder}: {}", ended.stderr);
    }
    let ended = bench.run(&["emg"]);
    assert!(ended.code == 1 && ended.stderr.contains("setup --emg"), "{}", ended.stderr);
}

/// A walk of ten even strides with the muscles of both commands: the left heel is on the ground in the first half of
/// each stride, the right one in the second, if the body walks at all.
fn write_walk(bench: &Bench, name: &str, walks: bool, shift: usize) {
    const STRIDE: usize = 30;
    const STEPS: usize = 10 * STRIDE;
    let left = model_muscles(Side::Left, BicepsFemoris::LongHead);
    let muscles: Vec<String> = left.into_iter().chain(compartments(Side::Right)).collect();
    let channel = |name, unit, elements: Vec<String>| {
        Channel::new(name, unit, elements, Precision::Double, Some(Timing::BeforeStep))
    };
    let owned = |names: &[&str]| names.iter().map(|name| (*name).to_owned()).collect();
    let on_ground = |step: usize, half: usize| {
        let down = walks && (step % STRIDE) / (STRIDE / 2) == half;
        if down { 600.0 } else { 0.0 }
    };
    let activity = |step: usize, muscle: usize| {
        let phase = std::f64::consts::TAU * (step + shift) as f64 / STRIDE as f64;
        0.4 + 0.2 * (phase + 0.4 * muscle as f64).sin()
            + 0.1 * (phase * (2 + muscle % 4) as f64).cos()
    };
    let steps = 0..STEPS;
    let contacts = steps.clone().flat_map(|s| [on_ground(s, 1), 0.0, on_ground(s, 0), 0.0]);
    let activations =
        steps.clone().flat_map(|step| (0..muscles.len()).map(move |m| activity(step, m)));
    let samples = vec![
        Samples::Double(activations.collect()),
        Samples::Double(contacts.collect()),
        Samples::Double(steps.flat_map(|_| [1.2, 0.0, 0.0]).collect()),
    ];
    let facts = EpisodeFacts {
        number: 3,
        length: STEPS,
        seeds: None,
        terminated: None,
        diverged_steps: None,
    };
    let recording = Recording {
        about: About {
            task: "kinesis_moving_goal".to_owned(),
            control_interval: Some(1.0 / 30.0),
            ..About::default()
        },
        channels: vec![
            channel(names::ACTIVATION, "", muscles.clone()),
            channel(names::FOOT_CONTACT, "N", owned(&names::FEET)),
            channel(names::ROOT_VELOCITY, "m/s", owned(&names::HEADING_AXES)),
        ],
        episodes: vec![Episode { facts, samples }],
    };
    let files = [(Format::Parquet, bench.path(name))];
    write_recording(recording, &files, Place::Replace).unwrap();
}

#[test]
fn two_recorded_walks_are_cut_compared_and_factored() {
    let bench = Bench::new();
    write_walk(&bench, "one.parquet", true, 0);
    write_walk(&bench, "two.parquet", true, 7);
    let people = invented();
    let words = ["emg", "--subjects", &people, "--recording", "one.parquet", "b=two.parquet"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    for (policy, name) in ["one", "b"].iter().enumerate() {
        let policy = &document["policies"][policy];
        assert_eq!(policy["policy"], *name);
        assert_eq!(policy["detected"], policy["retained"]);
        assert!(policy["retained"].as_u64().unwrap() >= 8, "{policy}");
    }
    assert_eq!(document["comparisons"].as_array().unwrap().len(), 1);
    let files = results(&bench);
    let content = |name: &str| {
        let found = files.iter().find(|(known, _)| known.ends_with(&format!("/{name}"))).unwrap();
        String::from_utf8_lossy(found.1).into_owned()
    };
    assert!(content("comparisons.csv").starts_with("a,b,n_subjects,W,p_raw,p_bonferroni"));
    let cycles = content("gait_cycles.csv");
    let mut lines = cycles.lines();
    assert_eq!(lines.next().unwrap(), "policy,episode,start,end,duration_s,mean_v,kept,reason");
    let row: Vec<&str> = lines.next().unwrap().split(',').collect();
    assert_eq!((row[0], row[1], row[4], row[6]), ("one", "3", "1.0", "true"));
    assert_eq!(content("correlations.csv").lines().count(), 1 + 3 * 81);

    let npz = files.keys().find(|name| name.ends_with("/simulation.npz")).unwrap();
    let stored = format!("runs/{npz}");
    let words = ["factors", "--profiles", &stored, "--profile", "one_right", "--json"];
    let (from_profile, from_walk) =
        (bench.json(&words), bench.json(&["factors", "--recording", "one.parquet", "--json"]));
    assert_eq!(from_profile["loadings"], from_walk["loadings"]);
}

#[test]
fn a_recording_that_shows_no_walk_is_an_error_with_a_remedy_or_skipped_if_allowed() {
    let bench = Bench::new();
    let people = invented();
    write_walk(&bench, "still.parquet", false, 0);
    let words = ["emg", "--subjects", &people, "--recording", "still.parquet"];
    let ended = bench.run(&words);
    assert_eq!((ended.code, ended.stdout.as_str()), (1, ""), "{}", ended.stderr);
    assert!(ended.stderr.contains("no gait cycle") && ended.stderr.contains("hint: "));
    let ended = bench.run(&[&words[..], &["--allow-empty"]].concat());
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    let ended = bench.run(&["factors", "--recording", "still.parquet"]);
    assert!(ended.code == 1 && ended.stderr.contains("no gait cycle"), "{}", ended.stderr);

    let gait = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/recordings/gait.h5");
    let gait = text(&gait);
    let ended = bench.run(&["emg", "--subjects", &people, "--recording", &gait]);
    assert!(ended.code == 1 && ended.stderr.contains("no muscle `"), "{}", ended.stderr);
    let ended = bench.run(&["emg", "--subjects", &people, "--recording", &gait, &gait]);
    assert!(ended.code == 1 && ended.stderr.contains("two things are called"), "{}", ended.stderr);
}

#[test]
fn published_people_and_the_published_walk_agree_as_published() {
    let Some(assets) = published() else { return };
    let bench = Bench::new();
    let (people, walk) = (text(&assets), format!("kinesis={}", text(&assets.join("kinesis"))));
    for (head, overall) in [("long", 0.2211), ("short", 0.2889)] {
        let words = ["emg", "--subjects", &people, "--bf", head, "--recording", &walk, "--json"];
        let document = bench.json(&words);
        assert_eq!(document["people"]["synthetic"], false);
        assert_near(&document["people"]["leave_one_out"]["mean"], 0.8212);
        assert_near(&document["people"]["pairwise"]["mean"], 0.7314);
        let kinesis = &document["policies"][0];
        assert_near(&kinesis["correlation"]["mean"], overall);
        assert_eq!((&kinesis["detected"], &kinesis["retained"]), (&24.into(), &20.into()));
        let files = document["files"].as_array().unwrap();
        let npz = files.iter().find(|f| f.as_str().unwrap().ends_with("simulation.npz")).unwrap();
        let simulation = SimulationProfiles::open(Path::new(npz.as_str().unwrap())).unwrap();
        let shape = |name: &str| {
            let profile = &simulation.profiles[name];
            (profile.muscles, profile.points)
        };
        assert_eq!((shape("kinesis_left"), shape("kinesis_right")), ((9, 200), (14, 200)));
    }
    let other = format!("again={}", text(&assets.join("kinesis")));
    let document =
        bench.json(&["emg", "--subjects", &people, "--recording", &walk, &other, "--json"]);
    assert_eq!(document["comparisons"][0]["W"], 0.0);
    assert_eq!(document["comparisons"][0]["p_bonferroni"], 1.0);
}

#[test]
fn the_factors_of_the_published_walk_are_those_recorded() {
    let Some(golden) = common::golden("analysis") else { return };
    let Some(assets) = published() else { return };
    let golden: Value =
        serde_json::from_slice(&std::fs::read(golden.join("emg_real.json")).unwrap()).unwrap();
    let want = &golden["factors"];
    let bench = Bench::new();
    let walk = format!("kinesis={}", text(&assets.join("kinesis")));
    let words = ["factors", "--side", "left", "--rotation", "reference", "--recording", &walk];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let found = &document["statistics"];
    for name in ["n_factors", "n_time", "explained_variance", "bartlett_chi2", "bartlett_df", "kmo"]
    {
        let (found, want) = (found[name].as_f64().unwrap(), want[name].as_f64().unwrap());
        assert!((found - want).abs() <= 1e-8 * (1.0 + want.abs()), "{name}: {found}, not {want}");
    }
    assert_eq!(found["rotation"], "reference");
    let ended = bench.run(&words);
    let widest = ended.stdout.lines().map(|line| line.chars().count()).max().unwrap();
    assert!(ended.code == 0 && widest <= 80, "a line of {widest} characters");
    let files = results(&bench);
    for name in ["loadings.csv", "loadings.npy", "factors.npy", "statistics.json", "factors.svg"] {
        assert!(files.keys().any(|known| known.ends_with(&format!("/{name}"))), "{name}");
    }
    assert!(files.keys().any(|name| name.ends_with("/loadings_varimax.csv")));
}

#[test]
fn factors_come_from_stored_profiles_and_say_which_they_miss() {
    let bench = Bench::new();
    let ended = bench.run(&["factors"]);
    assert!(ended.code == 1 && ended.stderr.contains("0 were given"), "{}", ended.stderr);
    let wave = |muscle: usize, point: usize| {
        let phase = std::f64::consts::TAU * point as f64 / 50.0;
        1.5 + (phase + 0.5 * muscle as f64).sin() + 0.3 * (((2 + muscle) * point) as f64).cos()
    };
    let profile = |muscles: usize| Profile {
        muscles,
        points: 50,
        values: (0..muscles).flat_map(|m| (0..50).map(move |p| wave(m, p))).collect(),
    };
    let mut simulation = SimulationProfiles {
        emg_muscles: (0..9).map(|muscle| format!("muscle_{muscle}")).collect(),
        factor_muscles: FACTOR_MUSCLES.iter().map(|(label, _)| (*label).to_owned()).collect(),
        profiles: [("mine_left".to_owned(), profile(9)), ("mine_right".to_owned(), profile(14))]
            .into(),
    };
    simulation.write(&bench.path("simulation.npz")).unwrap();
    let words = ["factors", "--profiles", "simulation.npz", "--json"];
    let document = bench.json(&words);
    assert_eq!(document["policy"], "mine_right");
    let count = document["statistics"]["n_factors"].as_u64().unwrap() as usize;
    assert_eq!(document["loadings"].as_array().unwrap().len(), 14);
    assert_eq!(document["loadings"][0].as_array().unwrap().len(), count);
    let files = results(&bench);
    let csv = files.iter().find(|(name, _)| name.ends_with("/loadings.csv")).unwrap();
    assert!(csv.1.starts_with(b"muscle,F1,"));

    let ended = bench.run(&["factors", "--profiles", "simulation.npz", "--profile", "mine_left"]);
    assert!(ended.code == 1 && ended.stderr.contains("9 muscles, expected 14"), "{}", ended.stderr);
    simulation.factor_muscles.swap(0, 1);
    simulation.write(&bench.path("swapped.npz")).unwrap();
    let ended = bench.run(&["factors", "--profiles", "swapped.npz"]);
    assert!(ended.code == 1 && ended.stderr.contains("expected TA, LG"), "{}", ended.stderr);
}

#[test]
fn a_fresh_clone_finds_factors_in_an_invented_cycle() {
    let bench = Bench::new();
    let cycle = format!("{}/synthetic/invented_simulation.npz", invented());
    let document = bench.json(&["factors", "--profiles", &cycle, "--json"]);
    assert_eq!(document["policy"], "invented_right");
    assert_eq!(document["statistics"]["n_muscles"], 14);
    assert_eq!(document["statistics"]["converged"], true);
    assert_eq!(document["warnings"], Value::Array(Vec::new()));
}

/// Fifteen people of another laboratory, whose description gives these correlations of their mean profiles with those of
/// the published people, stance taken as 62 % of the cycle.
#[test]
fn a_cohort_of_another_laboratory_is_read_through_its_muscle_map() {
    let (Some(published), Some(other)) =
        (published(), common::published("emg_santuz_musclesynergies"))
    else {
        return;
    };
    let bench = Bench::new();
    for entry in std::fs::read_dir(other.join("subjects")).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if name.ends_with("_V.csv") {
            bench.write(&format!("people/{name}"), &std::fs::read(&path).unwrap());
        }
    }
    let columns = ["SO", "GM", "GL", "TA", "ST", "BF", "VL", "RF", "VM"];
    let entry = |(channel, column)| format!("\"{channel}\" = \"{column}\"");
    let muscles: Vec<String> = HUMAN_CHANNELS.iter().zip(columns).map(entry).collect();
    let muscles = muscles.join("\n");
    let description = format!(
        "files = \"ID{{subject}}_TW_01_V.csv\"\nspeed = 4.5\nstance = {{ rows = 100, share = 0.62 }}\n\n\
         [muscles]\n{muscles}"
    );
    let folder = bench.write("people/cohort.toml", description.as_bytes());
    let speed = WalkingSpeed(45);
    let people = read_subjects(folder.parent().unwrap(), speed).unwrap().people;
    assert_eq!((people.subjects().len(), people.points()), (15, 200));
    let reference = read_subjects(&published, speed).unwrap().people;
    let expected = [0.91, 0.98, 0.98, 0.81, 0.96, 0.92, 0.64, 0.86, 0.96];
    for (channel, expected) in expected.into_iter().enumerate() {
        // The published profiles have a hundred points.
        let ours = resample(&people.mean_profile(channel, None), 100).unwrap();
        let theirs = reference.mean_profile(channel, None);
        let found = pearson(&ours, &theirs).unwrap();
        assert!((found - expected).abs() < 0.01, "{}: {found}", HUMAN_CHANNELS[channel]);
    }
    let ended = bench.run(&["emg", "--subjects", "people"]);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let other_speed = bench.run(&["emg", "--subjects", "people", "--speed", "3.6"]);
    assert!(other_speed.stderr.contains("hint: `--speed 4.5`"), "{}", other_speed.stderr);
}

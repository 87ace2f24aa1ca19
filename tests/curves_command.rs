//! `curves` as a process: learning curves from event files, logs of multi-task runs and portable tables.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::Path;

use arnold_analyze::record::{Table, Values, masked_crc32c, read_csv};
use common::bench::{Bench, files_below};
use serde_json::{Value, json};

/// An event file with one tag.
fn events(tag: &str, points: &[(u32, f32)]) -> Vec<u8> {
    let field = |number: u8, content: &[u8]| -> Vec<u8> {
        [&[number << 3 | 2, content.len() as u8][..], content].concat()
    };
    let varint = |mut value: u32| -> Vec<u8> {
        let mut bytes = Vec::new();
        while value > 127 {
            bytes.push((value & 127) as u8 | 128);
            value >>= 7;
        }
        bytes.push(value as u8);
        bytes
    };
    let mut file = Vec::new();
    for &(step, value) in points {
        let scalar = [field(1, tag.as_bytes()), vec![0x15], value.to_le_bytes().to_vec()].concat();
        let event = [vec![0x10], varint(step), field(5, &field(1, &scalar))].concat();
        let length = (event.len() as u64).to_le_bytes();
        file.extend(length);
        file.extend(masked_crc32c(&length).to_le_bytes());
        file.extend(&event);
        file.extend(masked_crc32c(&event).to_le_bytes());
    }
    file
}

/// A curve that rises to `height` within twenty points.
fn rising(height: f32) -> Vec<(u32, f32)> {
    (0..20).map(|i| (100_000 * i as u32, height * i as f32 / 19.0)).collect()
}

fn experts(bench: &Bench) {
    let record = json!({"avg_solved_step_frac": 0.5, "avg_solved_steps": 50.0, "max_episode_steps": 100,
        "avg_cum_reward": 200.0});
    let all =
        json!({"pen": record, "kinesis": record, "baoding_p1_cw": record, "reorient": record});
    bench.write("experts/expert_all_results.json", all.to_string().as_bytes());
}

fn table(folder: &Path, name: &str) -> Table {
    read_csv(&folder.join(name)).unwrap()
}

fn floats(table: &Table, name: &str) -> Vec<f64> {
    match &table.column(name).unwrap().values {
        Values::Floats(values) => values.clone(),
        Values::Integers(values) => values.iter().map(|&x| x as f64).collect(),
        other => panic!("{name}: {other:?}"),
    }
}

fn folder(document: &Value) -> &Path {
    Path::new(document["folder"].as_str().unwrap())
}

#[test]
fn a_pretrained_run_is_drawn_against_one_from_scratch() {
    let bench = Bench::new();
    experts(&bench);
    bench.write("a/events.out.tfevents.1", &events("pen/solved", &rising(0.5)));
    bench.write("b/tb/events.out.tfevents.1", &events("pen/solved", &rising(0.25)));
    let words = [
        "curves",
        "--recipe",
        "transfer",
        "--experts",
        "experts",
        "--run",
        "pretrained:pen=a",
        "--run",
        "scratch:pen=b",
    ];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let lines = document["lines"].as_array().unwrap();
    assert_eq!(lines.len(), 2);
    // Trailing mean of the last five of twenty points, then percent of 50 of 100 steps.
    let last = |height: f64| 200.0 * height * (15.0 + 16.0 + 17.0 + 18.0 + 19.0) / 5.0 / 19.0;
    assert!((lines[0]["last_value"].as_f64().unwrap() - last(0.5)).abs() < 1e-4);
    assert!((lines[1]["last_value"].as_f64().unwrap() - last(0.25)).abs() < 1e-4);
    let curves = table(folder(&document), "curves.csv");
    let names: Vec<&str> = curves.columns().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(
        names,
        ["panel", "series", "seed", "step", "value_raw", "value_smoothed", "value_relative_pct"]
    );
    // The origin in front, then sixteen windows, of each.
    assert_eq!(curves.row_count(), 2 * 17);
    let (smoothed, relative) =
        (floats(&curves, "value_smoothed"), floats(&curves, "value_relative_pct"));
    assert!(smoothed.iter().zip(&relative).all(|(s, r)| (200.0 * s - r).abs() < 1e-6));
    for extension in ["svg", "pdf", "png"] {
        assert!(folder(&document).join(format!("curves.{extension}")).is_file());
    }
    // What was logged can be given again, and says the same.
    let portable = folder(&document).join("portable.csv");
    let again = bench.json(&[
        "curves",
        portable.to_str().unwrap(),
        "--recipe",
        "transfer",
        "--experts",
        "experts",
        "--json",
    ]);
    assert_eq!(again["lines"], document["lines"]);
}

#[test]
fn a_run_of_several_tasks_that_counts_on_is_read_by_task_and_drawn_from_its_beginning() {
    let bench = Bench::new();
    let late: Vec<(u32, f32)> = rising(0.5).into_iter().map(|(s, v)| (s + 300_000, v)).collect();
    bench.write("a/events.out.tfevents.1", &events("elbow_pose/solved", &rising(0.9)));
    bench.write("a/events.out.tfevents.2", &events("hand_little_reach/solved", &late));
    let curves = |recipe| {
        let words = ["curves", "--recipe", recipe, "--raw", "--json", "--offset", "more=300000"];
        let run = ["--run", "more:hand_little_reach=a"];
        let document = bench.json(&[&words[..], &run].concat());
        let curves = table(folder(&document), "curves.csv");
        (floats(&curves, "step"), floats(&curves, "value_raw"))
    };
    let (steps, values) = curves("transfer");
    assert_eq!((steps[0], steps[steps.len() - 1]), (0.0, 1_900_000.0), "{steps:?}");
    // Nothing was logged at the origin; the other task's values are higher.
    assert!(values[0].is_nan() && values[1..].iter().all(|value| *value <= 0.5), "{values:?}");
    for recipe in ["rl-finetuning", "csi-finetuning"] {
        let (steps, _) = curves(recipe);
        assert_eq!(steps.last(), Some(&1_900_000.0), "{recipe}: {steps:?}");
    }
    let all = ["curves", "--recipe", "multi-task", "--raw", "--json", "--run", "more:all=a"];
    let lines = bench.json(&all)["lines"].as_array().unwrap().clone();
    let panels: Vec<&str> = lines.iter().map(|line| line["panel"].as_str().unwrap()).collect();
    assert_eq!(panels, ["Elbow pose", "Little reach"]);
}

#[test]
fn several_seeds_are_averaged_on_a_grid_with_their_standard_error() {
    let bench = Bench::new();
    experts(&bench);
    let steps = |every: u32| (1..=10).map(move |i| i * every);
    let level =
        |every: u32, value: f32| -> Vec<(u32, f32)> { steps(every).map(|s| (s, value)).collect() };
    bench.write("a/events.out.tfevents.1", &events("pen/solved", &level(1000, 0.25)));
    bench.write("b/events.out.tfevents.1", &events("pen/solved", &level(700, 0.75)));
    let words = ["--recipe", "rl-finetuning", "--run", "obc:pen=a", "--run", "obc:pen=b", "--json"];
    let document = bench.json(&[&["curves"], &words[..]].concat());
    assert_eq!(document["lines"][0]["seeds"], 2);
    let bands = table(folder(&document), "bands.csv");
    assert_eq!(bands.row_count(), 300);
    let (mean, error) = (floats(&bands, "mean"), floats(&bands, "sem"));
    for (place, count) in floats(&bands, "n_seeds").into_iter().enumerate() {
        // Of ¼ and ¾: standard deviation √(1/8), over √2 seeds.
        let both = (mean[place] - 0.5).abs() < 1e-6 && (error[place] - 0.25).abs() < 1e-6;
        assert!(if count > 1.5 { both } else { error[place].is_nan() }, "{place}: {count} seeds");
    }
    let svg = std::fs::read_to_string(folder(&document).join("curves.svg")).unwrap();
    assert!(svg.contains("± s.e.m."));
}

#[test]
fn seeds_of_a_portable_table_are_averaged_over_their_common_steps() {
    let bench = Bench::new();
    experts(&bench);
    let mut text = "panel,method,seed,task,stage,step,value,metric\n".to_owned();
    for (seed, level) in [("0", 0.2), ("1", 0.4)] {
        for step in [1, 2, 3] {
            let line =
                format!("finetuning,obc,{seed},pen,,{},{level},solved_fraction\n", step * 1000);
            text.push_str(&line);
        }
    }
    text += "finetuning,obc,1,pen,,9000,0.9,solved_fraction\n";
    bench.write("table.csv", text.as_bytes());
    let words = ["curves", "table.csv", "--experts", "experts", "--smoothing", "none", "--json"];
    let document = bench.json(&words);
    let bands = table(folder(&document), "bands.csv");
    assert_eq!(floats(&bands, "step"), [1000.0, 2000.0, 3000.0]);
    assert!(floats(&bands, "mean").iter().all(|x| (x - 60.0).abs() < 1e-9));
    assert!(floats(&bands, "sd").iter().all(|x| (x - 20.0).abs() < 1e-9));
    let raw = bench.json(&["curves", "table.csv", "--raw", "--smoothing", "none", "--json"]);
    let bands = table(folder(&raw), "bands.csv");
    assert!(floats(&bands, "mean").iter().all(|x| (x - 0.3).abs() < 1e-12));
}

#[test]
fn baselines_on_all_tasks_are_found_by_their_environments() {
    let bench = Bench::new();
    experts(&bench);
    let mut text =
        "_step,global_step,MuscleBaodingP1-v1/solved,MusclePenTwirl-v0/solved,Nothing-v0/solved\n"
            .to_owned();
    for i in 0..30 {
        let line = format!("{i},{},0.1,{},\n", 1000 * i, if i % 2 == 0 { "0.2" } else { "" });
        text.push_str(&line);
    }
    bench.write("run.csv", text.as_bytes());
    let document = bench.json(&[
        "curves",
        "--recipe",
        "multi-task",
        "--experts",
        "experts",
        "--json",
        "--run",
        "mt_ppo:all=run.csv",
        "--run",
        "mt_ppo:all=run.csv",
    ]);
    let lines = document["lines"].as_array().unwrap();
    let panels: Vec<&str> = lines.iter().map(|line| line["panel"].as_str().unwrap()).collect();
    assert_eq!(panels, ["Baoding CW", "Pen reorient"]);
    assert!(lines.iter().all(|line| line["seeds"] == 2));
    assert!((lines[0]["last_value"].as_f64().unwrap() - 20.0).abs() < 1e-9);
    assert_eq!(table(folder(&document), "bands.csv").row_count(), 2 * 300);
}

#[test]
fn walking_was_logged_in_percent_and_undefined_values_fall_back_to_the_return() {
    let bench = Bench::new();
    experts(&bench);
    bench.write("w/events.out.tfevents.1", &events("kinesis/solved", &[(1, 25.0), (2, 50.0)]));
    let run = |recipe: &str, path: &str| {
        let run = format!("m:kinesis={path}");
        bench.json(&["curves", "--recipe", recipe, "--experts", "experts", "--json", "--run", &run])
            ["lines"][0]["last_value"]
            .as_f64()
            .unwrap()
    };
    assert!((run("rl-finetuning", "w") - 0.5).abs() < 1e-9);
    assert!((run("transfer", "w") - 100.0).abs() < 1e-9);
    let both = [
        events("kinesis/solved", &[(1, f32::NAN)]),
        events("rollout/ep_rew_mean", &[(1, 100.0), (2, 150.0)]),
    ];
    bench.write("c/events.out.tfevents.1", &both.concat());
    assert!((run("csi-finetuning", "c") - 75.0).abs() < 1e-9);
}

#[test]
fn two_runs_write_the_same_bytes_and_the_table_fits() {
    let bench = Bench::new();
    experts(&bench);
    bench.write("a/events.out.tfevents.1", &events("pen/solved", &rising(0.5)));
    for out in ["one", "two"] {
        let ended =
            bench.run(&["curves", "--experts", "experts", "--run", "obc:pen=a", "--out", out]);
        assert_eq!(ended.code, 0, "{}", ended.stderr);
        assert!(ended.stdout.contains("nothing was played"), "{}", ended.stdout);
        assert!(ended.stdout.lines().all(|line| line.chars().count() <= 80), "{}", ended.stdout);
    }
    assert!(files_below(&bench.path("one")) == files_below(&bench.path("two")), "the bytes differ");
}

#[test]
fn a_damaged_file_counts_up_to_the_damage_and_is_named() {
    let bench = Bench::new();
    experts(&bench);
    let whole = events("pen/solved", &rising(0.5));
    bench.write("a/events.out.tfevents.1", &whole[..whole.len() - 3]);
    let ended = bench.run(&["curves", "--experts", "experts", "--run", "obc:pen=a"]);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stderr.contains("is cut short"), "{}", ended.stderr);
    assert!(ended.stdout.contains("19"), "{}", ended.stdout);
}

#[test]
fn unfit_logs_are_named_with_what_to_do() {
    let bench = Bench::new();
    experts(&bench);
    bench.write("a/events.out.tfevents.1", &events("loss", &[(1, 0.5)]));
    bench.write("s/events.out.tfevents.1", &events("pen/solved", &[(1, 0.5)]));
    bench.write("bytes/events.out.tfevents.1", &[7; 100]);
    bench.write(
        "metric.csv",
        b"panel,method,seed,task,stage,step,value,metric\np,m,0,pen,,1,0.5,joy\n",
    );
    bench.write("columns.csv", b"panel,method\np,m\n");
    bench.write("empty.csv", b"panel,method,seed,task,stage,step,value,metric\n");
    let text =
        "panel,method,seed,task,stage,step,value,metric\np,m,0,pen,,1,0.5,\np,m,1,pen,,2,0.5,\n";
    bench.write("apart.csv", text.as_bytes());
    std::fs::create_dir(bench.path("nothing")).unwrap();
    let cases: [(&[&str], &str, &str); 10] = [
        (&["--run", "m:pen=nothing"], "no file `events.out.tfevents.*`", "folder of event files"),
        (&["--run", "m:pen=a"], "no curve was logged under a tag with `solved`", "--tag"),
        (&["--run", "m:pen=s", "--tag", "x"], "the tag `x`", "--tag"),
        (&["--run", "m:all=a"], "`<environment>/solved`", "--tag"),
        (&["--run", "m:relocate=s"], "no expert of `Object relocation`", "--experts DIR"),
        (&["--run", "m:pen=bytes"], "no curve was logged", "--tag"),
        (&["metric.csv"], "`joy` is neither", "metric"),
        (&["columns.csv"], "no column `seed`", "columns panel, method"),
        (&["empty.csv"], "nothing was logged", "rows"),
        (&["apart.csv", "--smoothing", "none"], "no step in common", "multi-task"),
    ];
    for (words, what, hint) in cases {
        let ended = bench.run(&[&["curves", "--experts", "experts"], words].concat());
        assert_eq!((ended.code, ended.stdout.as_str()), (1, ""), "{words:?}: {}", ended.stderr);
        let (error, advice) =
            ended.stderr.split_once("\n\nhint: ").unwrap_or_else(|| panic!("{}", ended.stderr));
        assert!(error.contains(what), "{words:?}: {error}");
        assert!(advice.contains(hint), "{words:?}: {advice}");
    }
    assert_eq!(bench.run(&["curves"]).code, 2);
    assert_eq!(bench.run(&["curves", "--run", "pen=a"]).code, 2);
}

#[test]
fn the_recorded_event_files_are_joined_and_drawn() {
    let Some(golden) = common::golden("analysis") else { return };
    let bench = Bench::new();
    let run = format!("m:pen={}", golden.join("tb").display());
    let ended = bench.run(&["curves", "--raw", "--json", "--run", &run]);
    // The second file ends in a record cut short, as recorded.
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    let document: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert!(document["lines"][0]["points"].as_u64().unwrap() > 5);
}

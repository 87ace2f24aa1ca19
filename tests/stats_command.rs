//! `stats` as a process: the paper's tests on tidy tables, and every way in which a table can be unfit.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]

mod common;

use std::io::Write;

use arnold_analyze::record::{Column, Table, read_csv, read_parquet, write_parquet};
use common::bench::{Bench, files_below};
use serde_json::Value;

/// Three methods over five tasks with two seeds each. `ours` is better than `theirs` in every task, by 1, 2, 3, 4, 5.
fn seeds() -> Vec<u8> {
    let mut text = "method,task,seed,score,note\n".to_owned();
    for (method, shift) in [("ours", 1.0), ("theirs", 0.0), ("other", 0.5)] {
        for task in 1..=5 {
            for (seed, spread) in [(0, -0.25), (1, 0.25)] {
                let score = 10.0 + shift * f64::from(task) + spread;
                let line = format!("{method},task_{task},{seed},{score},\n");
                text.push_str(&line);
            }
        }
    }
    text.into_bytes()
}

const PAIRED: [&str; 14] = [
    "--test",
    "wilcoxon",
    "--value",
    "score",
    "--group",
    "method",
    "--unit",
    "task",
    "--pair",
    "task",
    "--zeros",
    "drop",
    "--alternative",
    "two-sided",
];

fn stats<'a>(file: &'a str, more: &[&'a str]) -> Vec<&'a str> {
    [&["stats", file], more].concat()
}

#[test]
fn a_signed_rank_test_over_tasks_sees_the_means_of_seeds() {
    let bench = Bench::new();
    bench.write("seeds.csv", &seeds());
    let words = [&stats("seeds.csv", &PAIRED)[..], &["--correction", "holm", "--json"]].concat();
    let document = bench.json(&words);
    let groups = document["groups"].as_array().unwrap();
    assert_eq!((&groups[0]["n_units"], &groups[0]["n_rows"]), (&5.into(), &10.into()));
    let comparisons = document["comparisons"].as_array().unwrap();
    assert_eq!(comparisons.len(), 3);
    let first = &comparisons[0];
    assert_eq!((first["a"].as_str(), first["b"].as_str()), (Some("ours"), Some("theirs")));
    // Five differences of one sign: 2/32 of all sign assignments, three times by Holm.
    assert_eq!((first["statistic"].as_f64(), first["p"].as_f64()), (Some(0.0), Some(0.0625)));
    assert_eq!(first["p_corrected"].as_f64(), Some(0.1875));
    assert_eq!(first["mean_difference"].as_f64(), Some(3.0));
    assert_eq!(
        (first["method"].as_str(), first["rank_biserial"].as_f64()),
        (Some("exact"), Some(1.0))
    );
    let plan = &document["plan"];
    assert_eq!(plan["unit"][0], "task");
    assert_eq!(
        (plan["alternative"].as_str(), plan["zeros"].as_str()),
        (Some("two-sided"), Some("drop"))
    );
}

#[test]
fn the_same_table_as_parquet_and_gzipped_gives_the_same_numbers() {
    let bench = Bench::new();
    let path = bench.write("seeds.csv", &seeds());
    write_parquet(&bench.path("seeds.parquet"), &read_csv(&path).unwrap(), &[]).unwrap();
    let mut gzip = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::fast());
    gzip.write_all(&seeds()).unwrap();
    bench.write("seeds.csv.gz", &gzip.finish().unwrap());
    let of = |file: &str| {
        let words =
            [&stats(file, &PAIRED)[..], &["--compare", "ours", "--correction", "none", "--json"]]
                .concat();
        bench.json(&words)["comparisons"].clone()
    };
    assert_eq!(of("seeds.csv").as_array().unwrap().len(), 2);
    assert_eq!(of("seeds.csv"), of("seeds.parquet"));
    assert_eq!(of("seeds.csv"), of("seeds.csv.gz"));
}

#[test]
fn every_test_of_the_paper_can_be_asked_for() {
    let bench = Bench::new();
    bench.write("seeds.csv", &seeds());
    let run = |words: &[&str]| -> Value {
        let words = [&["stats", "seeds.csv", "--value", "score", "--json"], words].concat();
        bench.json(&words)["comparisons"].clone()
    };
    let found = run(&[
        "--test",
        "mann-whitney",
        "--group",
        "method",
        "--unit",
        "task",
        "--alternative",
        "greater",
        "--compare",
        "ours",
        "--correction",
        "bonferroni",
    ]);
    // Ranks 11, 12, …: of 5 · 5 pairs of task means ours is larger in 25 − 0 − … as counted by hand below.
    let u = |shift: f64| {
        let pairs =
            (1..=5).flat_map(|i| (1..=5).map(move |j| (f64::from(i), shift * f64::from(j))));
        pairs
            .map(|(a, b)| {
                if a > b {
                    1.0
                } else if a < b {
                    0.0
                } else {
                    0.5
                }
            })
            .sum::<f64>()
    };
    assert_eq!(found[0]["statistic"].as_f64(), Some(u(0.0)));
    assert_eq!(found[1]["statistic"].as_f64(), Some(u(0.5)));
    // Complete separation: 1 of 252 deals.
    assert!((found[0]["p"].as_f64().unwrap() - 1.0 / 252.0).abs() < 1e-15);
    assert!((found[0]["p_corrected"].as_f64().unwrap() - 2.0 / 252.0).abs() < 1e-15);

    let found = run(&[
        "--test",
        "t",
        "--group",
        "method",
        "--unit",
        "task",
        "--reference",
        "10",
        "--alternative",
        "greater",
        "--correction",
        "holm",
    ]);
    // 1 … 5: mean 3, s.e.m. √0.5.
    assert!((found[0]["statistic"].as_f64().unwrap() - 3.0 / 0.5_f64.sqrt()).abs() < 1e-12);
    // `theirs` is 10 in every task: t of nothing but zeros is 0, p 1.
    assert_eq!((found[1]["statistic"].as_f64(), found[1]["p"].as_f64()), (Some(0.0), Some(1.0)));

    let found = run(&["--test", "bootstrap", "--group", "method", "--unit", "task"]);
    assert_eq!(found[0]["p"], Value::Null);
    assert!(found[0]["interval"][0].as_f64().unwrap() > 1.0);
}

#[test]
fn families_are_corrected_by_themselves() {
    let bench = Bench::new();
    bench.write("seeds.csv", &seeds());
    let words = [
        &stats("seeds.csv", &PAIRED)[..],
        &["--by", "seed", "--correction", "bonferroni", "--json"],
    ]
    .concat();
    let document = bench.json(&words);
    let comparisons = document["comparisons"].as_array().unwrap();
    assert_eq!(comparisons.len(), 6);
    assert!(comparisons.iter().all(|row| row["p_corrected"].as_f64() == Some(3.0 * 0.0625)));
}

#[test]
fn the_result_is_written_twice_with_the_same_bytes_and_names_its_choices() {
    let bench = Bench::new();
    bench.write("seeds.csv", &seeds());
    let words =
        |out| [&stats("seeds.csv", &PAIRED)[..], &["--correction", "holm", "--out", out]].concat();
    let (one, two) = (bench.run(&words("one")), bench.run(&words("two")));
    assert_eq!((one.code, two.code), (0, 0), "{}", one.stderr);
    let (first, second) = (files_below(&bench.path("one")), files_below(&bench.path("two")));
    assert_eq!(first.len(), 5);
    assert_eq!(first, second);
    let name = first.keys().find(|name| name.ends_with("comparisons.parquet")).unwrap();
    let (table, metadata) = read_parquet(&bench.path("one").join(name)).unwrap();
    assert_eq!(table.row_count(), 3);
    assert!(table.column("p_corrected").is_some() && table.column("unit").is_some());
    assert!(metadata.iter().any(|(key, _)| key == "plan"));
    let widest = one.stdout.lines().map(|line| line.chars().count()).max().unwrap();
    assert!(widest <= 80, "{widest} columns:\n{}", one.stdout);
    for said in ["Unit of replication  task", "two-sided", "zeros dropped", "holm"] {
        assert!(one.stdout.contains(said), "{said}:\n{}", one.stdout);
    }
}

#[test]
fn what_decides_a_conclusion_is_never_chosen_silently() {
    let bench = Bench::new();
    bench.write("seeds.csv", &seeds());
    let without = |option: &str| {
        let place = PAIRED.iter().position(|word| *word == option).unwrap();
        let mut words = stats("seeds.csv", &PAIRED);
        words.drain(place + 2..place + 4);
        bench.run(&words)
    };
    assert_eq!(without("--unit").code, 2);
    for option in ["--alternative", "--zeros", "--pair"] {
        let ended = without(option);
        assert_eq!((ended.code, ended.stdout.as_str()), (1, ""), "{option}");
        assert!(
            ended.stderr.contains(option) && ended.stderr.contains("hint: "),
            "{}",
            ended.stderr
        );
    }
    let ended = bench.run(&stats("seeds.csv", &PAIRED));
    assert!(ended.code == 1 && ended.stderr.contains("3 tests in one family"), "{}", ended.stderr);
    assert!(ended.stderr.contains("--correction holm"), "{}", ended.stderr);
}

#[test]
fn unfit_tables_are_named_with_what_to_do() {
    let bench = Bench::new();
    bench.write("seeds.csv", &seeds());
    bench.write("one.csv", b"method,task,score\na,1,2\na,2,3\n");
    bench.write("hole.csv", b"method,task,score\na,1,2\na,2,\nb,1,1\nb,2,1\n");
    bench.write("alone.csv", b"method,task,score\na,1,2\na,2,3\nb,1,1\n");
    bench.write("label.csv", b"method,task,score\na,1,2\n,2,3\n");
    bench.write("text.csv", b"method,task,score\na,1,much\n");
    bench.write("empty.csv", b"method,task,score\n");
    bench.write("nothing.csv", b"");
    bench.write("ragged.csv", b"method,task,score\na,1\n");
    bench.write("broken.parquet", b"PAR1PAR1");
    bench.write("bomb.csv.gz", b"\x1F\x8B\x08\0\0\0");
    let cases: [(&str, &[&str], &str, &str); 12] = [
        ("seeds.csv", &["--value", "points"], "no column `points` among `method`", "exact name"),
        (
            "seeds.csv",
            &["--value", "note"],
            "values in column `note` are undefined",
            "--skip-undefined",
        ),
        ("one.csv", &[], "only one group, `a`", "--reference"),
        (
            "hole.csv",
            &[],
            "1 of 4 values in column `score` are undefined, the first in row 2",
            "--skip-undefined",
        ),
        (
            "alone.csv",
            &[],
            "`2` of column `task` is in group `a`, but not in `b`",
            "--skip-undefined",
        ),
        ("label.csv", &[], "row 2 of column `method` names nothing", "name"),
        ("text.csv", &[], "column `score` holds texts", "--value"),
        ("empty.csv", &[], "no row", "at least one row"),
        ("nothing.csv", &[], "among no columns", "exact name"),
        ("ragged.csv", &[], "line 2: expected 3 cells, found 2", "tidy table"),
        ("broken.parquet", &[], "broken.parquet", "tidy table"),
        ("bomb.csv.gz", &[], "gzip: it cannot be unpacked", "tidy table"),
    ];
    for (file, more, what, hint) in cases {
        let mut words = stats(file, &PAIRED);
        for option in more.chunks(2) {
            let place = words.iter().position(|word| *word == option[0]).unwrap();
            words[place + 1] = option[1];
        }
        let ended = bench.run(&words);
        assert_eq!((ended.code, ended.stdout.as_str()), (1, ""), "{file}: {}", ended.stderr);
        let (error, advice) = ended.stderr.split_once("\n\nhint: ").unwrap();
        assert!(error.contains(what), "{file}: {error}");
        assert!(advice.contains(hint), "{file}: {advice}");
    }
    // Several seeds of a task are no pair.
    let mut words = [&stats("seeds.csv", &PAIRED)[..], &["--correction", "holm"]].concat();
    let place = words.iter().position(|word| *word == "--unit").unwrap();
    words.insert(place + 2, "seed");
    let ended = bench.run(&words);
    assert!(ended.stderr.contains("is there 2 times in group `ours`"), "{}", ended.stderr);
}

#[test]
fn what_is_left_out_is_counted_and_ends_with_exit_code_3() {
    let bench = Bench::new();
    bench.write("hole.csv", b"method,task,score\na,1,2\na,2,\na,3,5\nb,1,1\nb,2,1\nb,3,1\n");
    let words = [&stats("hole.csv", &PAIRED)[..], &["--skip-undefined"]].concat();
    let ended = bench.run(&words);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(ended.stdout.contains("1 rows without a value"), "{}", ended.stdout);
    assert!(ended.stdout.contains("1 pairs without a partner"), "{}", ended.stdout);
}

#[test]
fn ties_only_and_zeros_only_have_defined_answers() {
    let bench = Bench::new();
    let table = |difference: f64| {
        let rows = || (0..6).flat_map(|task| [("a", task), ("b", task)]);
        Table::new(vec![
            Column::unitless("method", rows().map(|(m, _)| m.to_owned()).collect::<Vec<_>>()),
            Column::unitless("task", rows().map(|(_, task)| i64::from(task)).collect::<Vec<_>>()),
            Column::unitless(
                "score",
                rows().map(|(m, _)| if m == "a" { difference } else { 0.0 }).collect::<Vec<_>>(),
            ),
        ])
        .unwrap()
    };
    for (difference, p, method) in [(1.0, 2.0 / 64.0, "permutation"), (0.0, 1.0, "degenerate")] {
        write_parquet(&bench.path("ties.parquet"), &table(difference), &[]).unwrap();
        let words = [&stats("ties.parquet", &PAIRED)[..], &["--json"]].concat();
        let row = &bench.json(&words)["comparisons"][0];
        assert_eq!((row["p"].as_f64(), row["method"].as_str()), (Some(p), Some(method)));
    }
}

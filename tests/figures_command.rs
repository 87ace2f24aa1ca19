//! `figures` as a process: the paper's figures and tables from published data and finished runs, and what is missing.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeSet;

use arnold_analyze::record::{Values, read_csv};
use common::bench::{Bench, files_below};
use serde_json::{Value, json};

/// A data folder with published curves and experts, as small as they can be.
fn data(bench: &Bench) {
    let record = json!({"avg_solved_step_frac": 0.5, "max_episode_steps": 100, "num_episodes": 4, "std_solved_steps": 1.0});
    let experts = json!({"pen": record, "reorient": record});
    bench.write(
        "data/arnold_published/expert_policies/expert_a_results.json",
        experts.to_string().as_bytes(),
    );
    let mut text =
        "method,scope,basis_policy,task,dimension,reconstruction_4dp,solved_fraction,n_episodes,n_fits\n".to_owned();
    for (method, scope, basis) in [
        ("pca", "task", "arnold"),
        ("pca", "global", "arnold"),
        ("pca", "global", "expert"),
        ("nmf", "task", "arnold"),
    ] {
        for task in ["pen", "reorient"] {
            for dimension in 1..=5 {
                let value = 0.1 * f64::from(dimension);
                let line =
                    format!("{method},{scope},{basis},{task},{dimension},{value},{value},20,1\n");
                text.push_str(&line);
            }
        }
    }
    bench.write("data/arnold_published/upstream/subspaces/curves_pca.csv", text.as_bytes());
}

fn entry<'a>(document: &'a Value, name: &str) -> &'a Value {
    let all = document["figures"].as_array().unwrap();
    all.iter().find(|entry| entry["name"] == name).unwrap()
}

#[test]
fn what_can_be_drawn_is_drawn_and_what_is_missing_names_its_command() {
    let bench = Bench::new();
    data(&bench);
    let ended = bench.run(&["figures", "--json"]);
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    let document: Value = serde_json::from_str(&ended.stdout).unwrap();
    for (name, from) in [
        ("fig3b_radar", "the paper's printed tables"),
        ("fig3c_bars", "the paper's printed tables"),
        ("table1_families", "the paper's printed tables"),
        ("fig6ab_csi", "published curves"),
        ("figs7_csi_tasks", "published curves"),
        ("figs8_csi_tasks_nmf", "published curves"),
        ("figs9_csi_experts", "published curves"),
    ] {
        let entry = entry(&document, name);
        assert_eq!(entry["from"], from, "{name}");
        for file in entry["files"].as_array().unwrap() {
            assert!(bench.path(file.as_str().unwrap()).is_file(), "{file}");
        }
    }
    let smoothness = entry(&document, "fig4a_smoothness");
    assert_eq!(smoothness["from"], Value::Null);
    assert!(smoothness["make"].as_str().unwrap().starts_with("arnold-analyze smoothness"));
    let curves = read_csv(&bench.path("figures/fig6ab_csi.csv")).unwrap();
    let Values::Floats(relative) = &curves.column("relative_performance").unwrap().values else {
        panic!()
    };
    assert!((relative[0] - 20.0).abs() < 1e-9, "{}", relative[0]);
    let ended = bench.run(&["figures"]);
    assert!(
        ended.stdout.contains("Missing") && ended.stdout.contains("setup --arnold"),
        "{}",
        ended.stdout
    );
}

#[test]
fn a_finished_run_comes_before_published_data() {
    let bench = Bench::new();
    data(&bench);
    let record = |x: f64| json!({"avg_solved_step_frac": x, "max_episode_steps": 100, "num_episodes": 4, "std_solved_steps": 1.0});
    for (name, x) in [("arnold", 0.6), ("bc", 0.4)] {
        let records = json!({"pen": record(x), "reorient": record(x)});
        bench.write(&format!("tree/{name}/seed_0/a_results.json"), records.to_string().as_bytes());
    }
    assert_eq!(bench.run(&["evaluate", "--benchmarks", "tree"]).code, 0);
    let document = bench.json(&["figures", "fig3c", "--json"]);
    let bars = entry(&document, "fig3c_bars");
    assert!(bars["from"].as_str().unwrap().starts_with("run evaluate-"), "{bars}");
    let run = bars["from"].as_str().unwrap().trim_start_matches("run ");
    let drawn = std::fs::read(bench.path(&format!("runs/{run}/relative_performance.svg"))).unwrap();
    assert!(drawn == std::fs::read(bench.path("figures/fig3c_bars.svg")).unwrap());
    // A figure that was tampered with is not taken.
    bench.write(&format!("runs/{run}/relative_performance.svg"), b"<svg/>");
    bench.run(&["figures", "fig3c", "--json"]);
    assert!(std::fs::read(bench.path("figures/fig3c_bars.svg")).unwrap() != b"<svg/>");
}

#[test]
fn twice_and_in_another_order_gives_the_same_bytes() {
    let bench = Bench::new();
    data(&bench);
    assert_eq!(bench.run(&["figures", "--out", "one"]).code, 3);
    for name in ["experts", "fig6", "table1", "fig3c", "fig3b", "figs", "tables"] {
        bench.run(&["figures", name, "--out", "two"]);
    }
    let (one, two) = (files_below(&bench.path("one")), files_below(&bench.path("two")));
    assert_eq!(one.keys().collect::<BTreeSet<_>>(), two.keys().collect::<BTreeSet<_>>());
    assert!(one == two, "the bytes differ");
}

#[test]
fn slides_have_the_same_content_in_other_colours_and_leave_the_run_as_it_is() {
    let bench = Bench::new();
    data(&bench);
    bench.json(&["figures", "fig3b", "fig6ab", "--out", "light", "--json"]);
    bench.json(&["figures", "fig3b", "fig6ab", "--out", "dark", "--theme", "dark", "--json"]);
    let (light, dark) = (files_below(&bench.path("light")), files_below(&bench.path("dark")));
    assert_eq!(light.keys().collect::<BTreeSet<_>>(), dark.keys().collect::<BTreeSet<_>>());
    for (name, bytes) in &light {
        let is_table = ["parquet", "csv"].iter().any(|kind| name.rsplit('.').next() == Some(kind));
        assert_eq!(dark[name] == *bytes, is_table, "{name}");
    }
    let run = ["evaluate", "--benchmarks", "data/arnold_published/expert_policies"];
    let first = bench.json(&[&run[..], &["--json"]].concat());
    let folder = std::path::Path::new(first["folder"].as_str().unwrap()).to_owned();
    let before = files_below(&folder);
    let again = bench.json(&[&run[..], &["--theme", "dark", "--json"]].concat());
    assert_eq!(again["folder"], first["folder"]);
    assert_eq!(again["slides"].as_array().unwrap().len(), 3);
    assert!(folder.join("dark/experts.pdf").is_file());
    std::fs::remove_dir_all(folder.join("dark")).unwrap();
    assert!(files_below(&folder) == before, "the run was changed");
}

#[test]
fn a_gallery_shows_every_figure_and_those_of_other_runs() {
    let bench = Bench::new();
    data(&bench);
    let run = ["evaluate", "--benchmarks", "data/arnold_published/expert_policies"];
    bench.json(&[&run[..], &["--json"]].concat());
    let words = ["figures", "fig3", "experts", "--gallery", "--out", "gallery"];
    assert_eq!(bench.run(&words).code, 0);
    let page = std::fs::read_to_string(bench.path("gallery/README.md")).unwrap();
    let pictures: Vec<&str> = page
        .split("](")
        .skip(1)
        .filter_map(|rest| {
            rest.split(')').next().filter(|name| name.split('.').nth(1) == Some("svg"))
        })
        .collect();
    assert_eq!(pictures, ["fig3b_radar.svg", "fig3c_bars.svg", "experts.svg"]);
    for picture in pictures {
        assert!(bench.path(&format!("gallery/{picture}")).is_file(), "{picture}");
    }
    assert!(page.contains("Made by `arnold-analyze figures fig3 experts"), "{page}");
    let before = files_below(&bench.path("gallery"));
    assert_eq!(bench.run(&words).code, 0);
    assert!(files_below(&bench.path("gallery")) == before, "the bytes differ");
}

#[test]
fn unfit_input_is_named() {
    let bench = Bench::new();
    data(&bench);
    let ended = bench.run(&["figures", "fig99"]);
    assert!(ended.code == 1 && ended.stderr.contains("called fig99"), "{}", ended.stderr);
    bench.write("data/arnold_published/upstream/subspaces/curves_nmf.csv", b"method\nnmf\n");
    let ended = bench.run(&["figures"]);
    assert!(ended.code == 1 && ended.stderr.contains("curves_nmf.csv"), "{}", ended.stderr);
    assert!(ended.stderr.contains("hint: "), "{}", ended.stderr);
}

#[test]
fn without_any_data_the_printed_tables_are_still_there() {
    let bench = Bench::new();
    let document = bench.json(&["figures", "table1", "fig3b", "--json"]);
    assert_eq!(document["figures"].as_array().unwrap().len(), 2);
    assert!(bench.path("figures/table1_families.parquet").is_file());
}

//! `evaluate --benchmarks` as a process: the paper's tables from result files, and every way in which they can be unfit.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::BTreeMap;
use std::path::Path;

use arnold_analyze::record::{Table, Values, read_csv};
use common::bench::{Bench, files_below};
use serde_json::{Value, json};

const TASKS: [&str; 3] = ["elbow_pose", "pen", "reorient"];

fn record(fraction: f64) -> Value {
    json!({
        "avg_solved_step_frac": fraction,
        "std_solved_steps": 10.0,
        "max_episode_steps": 100,
        "num_episodes": 4,
        "episode_solve_step_fracs": vec![fraction; 4],
    })
}

fn records(fractions: &[f64]) -> Value {
    TASKS
        .iter()
        .zip(fractions)
        .map(|(task, &x)| ((*task).to_owned(), record(x)))
        .collect::<serde_json::Map<_, _>>()
        .into()
}

/// Experts at 0.5; Arnold at 0.5 and 0.6 in turn, OBC always at 0.4, MT-PPO at 0.1.
fn tree(bench: &Bench) {
    let write = |name: &str, document: Value| bench.write(name, document.to_string().as_bytes());
    write("tree/expert_policies/expert_a_results.json", records(&[0.5, 0.5, 0.5]));
    write("tree/arnold/seed_0/a_results.json", records(&[0.5, 0.6, 0.55]));
    write("tree/arnold/seed_1/a_results.json", records(&[0.6, 0.6, 0.6]));
    write("tree/obc/seed_0/a_results.json", records(&[0.4, 0.4, 0.4]));
    write("tree/obc/seed_1/a_results.json", records(&[0.4, 0.4, 0.2]));
    write("tree/obc_xs/seed_0/a_results.json", records(&[0.1, 0.2, 0.3]));
    write("tree/obc_task_sv/seed_0/a_results.json", records(&[0.2, 0.3, 0.3]));
    write("tree/notes/seed_0/a_results.json", json!({"pen": record(0.5)}));
}

fn floats(table: &Table, name: &str) -> Vec<f64> {
    match &table.column(name).unwrap().values {
        Values::Floats(values) => values.clone(),
        Values::Integers(values) => values.iter().map(|&x| x as f64).collect(),
        other => panic!("{name}: {other:?}"),
    }
}

fn table(folder: &Path, name: &str) -> Table {
    read_csv(&folder.join(name)).unwrap()
}

#[test]
fn a_tree_becomes_the_papers_tables_tests_and_figures_without_playing() {
    let bench = Bench::new();
    tree(&bench);
    let ended = bench.run(&["evaluate", "--benchmarks", "tree", "--json"]);
    // `notes` lacks tasks and is no method of the paper: it is left out, named, and the exit code says so.
    assert_eq!(ended.code, 3, "{}", ended.stderr);
    assert!(
        ended.stderr.contains("Reading, not playing: 4 methods, 6 result files"),
        "{}",
        ended.stderr
    );
    assert!(ended.stderr.contains("Left out `notes`"), "{}", ended.stderr);
    let document: Value = serde_json::from_str(&ended.stdout).unwrap();
    assert_eq!(document["input"]["played"], false);
    let arnold = &document["methods"]["arnold"];
    let near = |value: &Value, want: f64| (value.as_f64().unwrap() - want).abs() < 1e-9;
    // Seeds: 100, 120, 110 and 120, 120, 120 percent; inside seeds first: 110 and 120.
    assert!(near(&arnold["families"]["avg"]["mean"], 115.0));
    assert!(near(&arnold["families"]["avg"]["sem"], 5.0));
    // Student's t with one degree of freedom: tan(0.475 π) = 12.706 s.e.m.
    assert!(near(
        &arnold["families"]["avg"]["interval_95"][1],
        115.0 + 5.0 * (std::f64::consts::PI * 0.475).tan()
    ));
    assert!(near(&arnold["tasks"]["pen"]["mean"], 120.0));
    assert_eq!(arnold["tasks"]["pen"]["published"][0].as_f64(), Some(102.2));
    let folder = Path::new(document["folder"].as_str().unwrap());
    let families = table(folder, "families.csv");
    let names: Vec<&str> = families.columns().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names[..5], ["method", "column", "mean", "sem", "n_seeds"]);
    let tests = table(folder, "significance.csv");
    let names: Vec<&str> = tests.columns().iter().map(|c| c.name.as_str()).collect();
    assert_eq!(names[..7], ["method", "W", "p", "n_tasks", "n_nonzero", "rank_biserial", "p_holm"]);
    // Arnold is better in all three tasks: W 0, p 2/8, Holm over three.
    assert_eq!(floats(&tests, "W")[..3], [0.0; 3]);
    assert_eq!(floats(&tests, "p_holm")[..3], [0.75; 3]);
    let improvement = table(folder, "expert_improvement.csv");
    let names: Vec<&str> = improvement.columns().iter().map(|c| c.name.as_str()).collect();
    let want = [
        "task",
        "expert",
        "arnold",
        "arnold_sem",
        "improvement",
        "sem",
        "t",
        "p",
        "n_seeds",
        "p_holm",
    ];
    assert_eq!(names[..10], want);
    // Elbow: improvements 0 and 20, mean 10, s.e.m. 10, t 1.
    assert!((floats(&improvement, "t")[0] - 1.0).abs() < 1e-9);
    let seeds = table(folder, "seeds.csv");
    assert_eq!(seeds.row_count(), 6 * 3);
    let capacity = table(folder, "capacity.csv");
    assert_eq!(capacity.row_count(), 2 * 3);
    // 10 / 100 / √4 / 0.5.
    assert!(floats(&capacity, "sem").iter().all(|sem| (sem - 10.0).abs() < 1e-9));
    let change = table(folder, "vocabulary.csv");
    let means = floats(&change, "mean");
    // Against the mean of the reference's seeds, 0.4, 0.4 and 0.3: −50, −25 and 0 percent, rising.
    assert!(means.iter().zip([-50.0, -25.0, 0.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{means:?}");
    for figure in
        ["experts", "relative_performance", "radar", "capacity", "capacity_summary", "vocabulary"]
    {
        for extension in ["svg", "pdf", "png"] {
            assert!(folder.join(format!("{figure}.{extension}")).is_file(), "{figure}.{extension}");
        }
    }
    let latex = std::fs::read_to_string(folder.join("families.tex")).unwrap();
    assert!(latex.starts_with("Arnold & "), "{latex}");
}

#[test]
fn the_tables_fit_a_terminal_and_say_what_was_done() {
    let bench = Bench::new();
    tree(&bench);
    let ended = bench.run(&["evaluate", "--benchmarks", "tree", "--method", "arnold", "obc"]);
    assert_eq!(ended.code, 0, "{}", ended.stderr);
    let widest = ended.stdout.lines().map(|line| line.chars().count()).max().unwrap();
    assert!(widest <= 80, "{widest} columns:\n{}", ended.stdout);
    for said in ["nothing was played", "unit of replication: task", "two-sided", "printed", "Holm"]
    {
        assert!(ended.stdout.contains(said), "{said}:\n{}", ended.stdout);
    }
}

#[test]
fn selections_single_files_and_own_runs_are_read_and_give_the_same_numbers() {
    let bench = Bench::new();
    tree(&bench);
    let list = json!({"arnold": ["tree/arnold/seed_0/a_results.json", "tree/arnold/seed_1/a_results.json"]});
    bench.write("reproduction/policies.json", list.to_string().as_bytes());
    bench.write("runs/evaluate-x/results.json", records(&[0.5, 0.6, 0.55]).to_string().as_bytes());
    let experts = ["--experts", "tree/expert_policies"];
    let run = |paths: &[&str]| {
        let words = [&["evaluate", "--json", "--benchmarks"], paths, &experts].concat();
        bench.json(&words)["methods"]["arnold"]["families"]["avg"].clone()
    };
    let want = run(&["reproduction/policies.json"]);
    assert!((want["mean"].as_f64().unwrap() - 115.0).abs() < 1e-9);
    let pieces = ["arnold=tree/arnold/seed_0/a_results.json", "arnold=tree/arnold/seed_1"];
    assert_eq!(run(&pieces), want);
    assert_eq!(run(&["arnold=runs/evaluate-x", "arnold=tree/arnold/seed_1"]), want);
}

#[test]
fn fine_tuning_in_a_subspace_is_found_and_missing_runs_stay_missing() {
    let bench = Bench::new();
    tree(&bench);
    let write = |folder: &str, run: &str, components: usize, fraction: f64| {
        let name = format!("extra/{folder}/{run}_pen_model_5_steps_csi_{components}_results.json");
        bench.write(&name, json!({"pen": record(fraction)}).to_string().as_bytes());
    };
    write("csi_notrain_server/csi1_all", "111_gpu_csi_all_bc_student", 1, 0.1);
    for (run, fraction) in [("333", 0.2), ("444", 0.3)] {
        write("csi_server/csi1_all", run, 1, fraction);
    }
    write("csi_server/csi2_all", "333", 2, 0.5);
    // Of two files of one run, the newer checkpoint counts.
    let older = json!({"pen": record(0.9)});
    let name = "extra/csi_server/csi2_all/333_pen_model_4_steps_csi_2_results.json";
    bench.write(name, older.to_string().as_bytes());
    let document = bench.json(&[
        "evaluate",
        "--json",
        "--benchmarks",
        "extra",
        "--experts",
        "tree/expert_policies",
    ]);
    let folder = Path::new(document["folder"].as_str().unwrap());
    let summary = table(folder, "csi_finetuning.csv");
    // Frozen at 1; PPO at 1 and 2 components; in percent of 0.5.
    let means = floats(&summary, "mean");
    assert!(means.iter().zip([20.0, 50.0, 100.0]).all(|(a, b)| (a - b).abs() < 1e-9), "{means:?}");
    assert!(
        floats(&summary, "n_runs").iter().zip([1.0, 2.0, 1.0]).all(|(a, b)| (a - b).abs() < 0.5)
    );
    let errors = floats(&summary, "sem");
    assert!(errors[0].is_nan() && (errors[1] - 10.0).abs() < 1e-9 && errors[2].is_nan());
    assert!(folder.join("csi_finetuning.pdf").is_file());
}

#[test]
fn what_policies_trained_by_rewards_alone_lose_is_drawn_where_one_of_them_is_there() {
    let bench = Bench::new();
    tree(&bench);
    let run = |words: &[&str]| {
        let document = bench.json(&[&["evaluate", "--json", "--benchmarks"], words].concat());
        Path::new(document["folder"].as_str().unwrap()).to_owned()
    };
    let methods = ["tree", "--method", "arnold", "obc", "obc_task_sv", "ppo_t_sv"];
    let write = |name: &str, x: f64| {
        bench.write(name, records(&[x, x, x]).to_string().as_bytes());
    };
    write("tree/ppo_t_sv/seed_0/a_results.json", 0.2);
    write("tree/ppo_t_sv/seed_1/a_results.json", 0.3);
    assert!(!run(&methods).join("ppo_ablation.svg").exists());
    write("tree/ppo_wo_rew_norm/a_results.json", 0.1);
    let folder = run(&[&methods[..], &["ppo_wo_rew_norm"]].concat());
    let svg = std::fs::read_to_string(folder.join("ppo_ablation.svg")).unwrap();
    for said in ["PPO w/o reward norm.", "n = 1–2 seeds", "s.e.m."] {
        assert!(svg.contains(said), "{said}");
    }
}

#[test]
fn the_radars_first_metric_counts_solved_episodes_in_two_tasks_and_is_named() {
    let bench = Bench::new();
    let with = |fraction: f64, solved: f64| {
        let mut document = records(&[fraction; 3]);
        for task in TASKS {
            document[task]["avg_solved"] = json!(solved);
        }
        document.to_string()
    };
    bench.write("tree/expert_policies/expert_a_results.json", with(0.5, 0.8).as_bytes());
    bench.write("tree/arnold/seed_0/a_results.json", with(0.4, 0.6).as_bytes());
    let words = ["evaluate", "--benchmarks", "tree", "--metric-map", "radar"];
    let document = bench.json(&[&words[..], &["--json"]].concat());
    let mean = |task: &str| document["methods"]["arnold"]["tasks"][task]["mean"].as_f64().unwrap();
    assert!((mean("pen") - 80.0).abs() < 1e-9 && (mean("reorient") - 75.0).abs() < 1e-9);
    assert_eq!(document["metric_map"], "radar");
    assert!(bench.run(&words).stdout.contains("episodes solved at any step"));
    let usual = bench.json(&["evaluate", "--benchmarks", "tree", "--json"]);
    assert_ne!(usual["folder"], document["folder"], "another metric is another run");
}

#[test]
fn policies_with_other_histories_are_read_from_one_file_and_need_no_expert() {
    let bench = Bench::new();
    let of = |reward: f64| json!({"pen": {"avg_cum_reward": reward, "num_episodes": 20}});
    let file = json!({"original-random": of(12.5), "bilateral-random": of(-3.0)});
    bench.write("bilateral.json", file.to_string().as_bytes());
    let document = bench.json(&["evaluate", "--json", "--benchmarks", "bilateral.json"]);
    let folder = Path::new(document["folder"].as_str().unwrap());
    let history = table(folder, "history.csv");
    assert_eq!(floats(&history, "avg_cum_reward"), [-3.0, 12.5]);
    assert_eq!(floats(&history, "n_episodes"), [20.0, 20.0]);
    let svg = std::fs::read_to_string(folder.join("history.svg")).unwrap();
    assert!(svg.contains("bilateral-random") && svg.contains("no interval"));
}

#[test]
fn two_runs_write_the_same_bytes() {
    let bench = Bench::new();
    tree(&bench);
    for out in ["one", "two"] {
        assert_eq!(bench.run(&["evaluate", "--benchmarks", "tree", "--out", out]).code, 3);
    }
    let files = |out| -> BTreeMap<String, Vec<u8>> { files_below(&bench.path(out)) };
    assert!(files("one").len() > 30);
    assert!(files("one") == files("two"), "the bytes differ");
}

#[test]
fn unfit_results_are_named_with_what_to_do() {
    let bench = Bench::new();
    tree(&bench);
    bench.write("bad.json", b"{\"pen\": ");
    bench.write("nan.json", b"{\"pen\": {\"avg_solved_step_frac\": NaN}}");
    bench.write(
        "high.json",
        json!({"elbow_pose": record(1.5), "pen": record(0.5), "reorient": record(0.5)})
            .to_string()
            .as_bytes(),
    );
    bench.write("half.json", json!({"pen": record(0.5)}).to_string().as_bytes());
    bench.write("lonely/seed_0/a_results.json", b"{}");
    bench.write("broken/bc/seed_0/a_results.json", b"{");
    bench.write(
        "zero/expert_a_results.json",
        json!({"pen": {"avg_solved_step_frac": -1.0}}).to_string().as_bytes(),
    );
    let cases: [(&[&str], &str, &str); 9] = [
        (&["bad.json"], "line 1, column", "result file"),
        (&["nan.json"], "line 1, column", "result file"),
        (&["nothing"], "nothing", "tree"),
        (
            &["m=half.json", "tree/expert_policies"],
            "no defined value for task `elbow_pose`",
            "--allow-missing",
        ),
        (&["m=high.json", "tree/expert_policies"], "solved fraction 1.5", "between 0 and 1"),
        (&["m=half.json"], "no results of experts", "--experts DIR"),
        (&["tree", "--method", "ppo"], "no method `ppo`", "--method"),
        (&["broken"], "line 1, column", "tree"),
        (&["m=half.json", "--experts", "zero"], "no share: -1", "between 0 and 1"),
    ];
    for (words, what, hint) in cases {
        let ended = bench.run(&[&["evaluate", "--benchmarks"], words].concat());
        assert_eq!((ended.code, ended.stdout.as_str()), (1, ""), "{words:?}: {}", ended.stderr);
        let (error, advice) =
            ended.stderr.split_once("\n\nhint: ").unwrap_or_else(|| panic!("{}", ended.stderr));
        assert!(error.contains(what), "{words:?}: {error}");
        assert!(advice.contains(hint), "{words:?}: {advice}");
    }
    // Playing and reading at once make no sense.
    assert_eq!(bench.run(&["evaluate", "--benchmarks", "tree", "--policy", "arnold"]).code, 2);
    assert_eq!(bench.run(&["evaluate", "--experts", "tree"]).code, 2);
}

#[test]
fn the_suites_own_tree_gives_the_recorded_tables() {
    let Some(golden) = common::golden("analysis") else { return };
    let bench = Bench::new();
    let tree = golden.join("bench");
    let document = bench.json(&["evaluate", "--json", "--benchmarks", tree.to_str().unwrap()]);
    let cases: Value =
        serde_json::from_slice(&std::fs::read(golden.join("performance.json")).unwrap()).unwrap();
    let case = cases["cases"].as_array().unwrap().iter();
    let case =
        case.clone().find(|case| case["algorithm"] == "relative_performance_tables").unwrap();
    let want = &case["scalars"];
    for (name, method) in document["methods"].as_object().unwrap() {
        for (task, cell) in method["tasks"].as_object().unwrap() {
            let want = want["methods"][name]["per_task"][task]["mean"].as_f64().unwrap();
            assert!((cell["mean"].as_f64().unwrap() - want).abs() < 1e-9, "{name} {task}");
        }
    }
    for row in document["tests"].as_array().unwrap() {
        let want = &want["significance_vs_arnold"][row["method"].as_str().unwrap()];
        assert!((row["p_holm"].as_f64().unwrap() - want["p_holm"].as_f64().unwrap()).abs() < 1e-12);
    }
}

#[test]
fn the_published_experts_are_tabulated_beside_the_printed_table() {
    let Some(data) = common::published("arnold_published") else { return };
    let bench = Bench::new();
    let folder = data.join("expert_policies");
    let document = bench.json(&["evaluate", "--json", "--benchmarks", folder.to_str().unwrap()]);
    let experts = document["experts"].as_array().unwrap();
    assert_eq!(experts.len(), 14);
    for row in experts {
        let difference =
            row["solved_fraction"].as_f64().unwrap() - row["published"].as_f64().unwrap();
        assert!(difference.abs() <= 0.000_5 + 1e-9, "{row}");
    }
}

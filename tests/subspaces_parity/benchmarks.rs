//! Topic `performance`: tables from a tree of result files, fine-tuning, capacity, changes.

use std::collections::BTreeMap;

use arnold_analyze::analysis::performance::{
    FAMILIES, Method, RelativeMatrix, against_experts, against_methods, change_against_reference,
    episode_bar, family_rows, finetuning_curve, improvements, newest_result_file, size_summary,
    task_rows,
};
use arnold_analyze::analysis::stats::{Divisor, Summary, Wilcoxon, standard_deviation};
use arnold_analyze::npz::Array;
use arnold_analyze::record::{SeedResult, read_benchmark_tree};

use crate::common::cases::{Case, Outputs, or_nan, outputs, text};
use crate::{check, common};

#[test]
fn performance_agrees_with_the_suite() {
    check("performance", 7, |case| {
        Some(match case.algorithm() {
            "relative_performance_tables" => tables(case),
            "relative_matrix" => matrix(case),
            "csi_finetune_aggregate" => {
                let runs = rows(case.input("seed_values"));
                let curve = finetuning_curve(&runs, case.number("expert")).unwrap();
                summaries(&curve, ["mean", "sem", "n"])
            }
            "csi_pick_file" => {
                let names = case.parameter("names").as_array().unwrap();
                let names: Vec<&str> = names.iter().map(|name| name.as_str().unwrap()).collect();
                outputs([("chosen", text(newest_result_file(&names).unwrap()))])
            }
            "capacity_summary" => {
                let sizes = rows(case.input("relative"));
                let sizes: Vec<Summary> = sizes.iter().map(|size| size_summary(size)).collect();
                summaries(&sizes, ["mean", "sem", "n"])
            }
            "capacity_bar" => {
                let solved = case.input("solved_steps").to_f64();
                let deviation = standard_deviation(&solved, Divisor::Count).unwrap();
                assert!((deviation - case.number("std_solved_steps")).abs() < 1e-9);
                let (relative, sem) = episode_bar(
                    case.number("expert"),
                    case.number("avg_solved_step_frac"),
                    deviation,
                    u32::try_from(case.count("max_episode_steps")).unwrap(),
                    case.count("num_episodes"),
                )
                .unwrap();
                outputs([("relative", vec![relative]), ("sem", vec![sem])])
            }
            "relative_dotplot" => {
                let change = change_against_reference(
                    &rows(case.input("method")),
                    &rows(case.input("reference")),
                )
                .unwrap();
                outputs([
                    ("change", change.seeds.concat()),
                    ("mean", change.mean),
                    ("sd", change.standard_deviation),
                    ("order", change.order.iter().map(|&task| task as f64).collect()),
                ])
            }
            _ => return None,
        })
    });
}

fn rows(array: &Array) -> Vec<Vec<f64>> {
    array.to_f64().chunks_exact(array.shape[1]).map(<[f64]>::to_vec).collect()
}

fn summaries(found: &[Summary], [mean, sem, count]: [&str; 3]) -> Outputs {
    outputs([
        (mean, found.iter().map(|summary| or_nan(summary.mean)).collect()),
        (sem, found.iter().map(|summary| or_nan(summary.standard_error)).collect()),
        (count, found.iter().map(|summary| summary.count as f64).collect()),
    ])
}

/// Families are means over tasks by name; here tasks are columns in alphabetical order.
fn matrix(case: &Case) -> Outputs {
    let mut tasks: Vec<&str> =
        FAMILIES.iter().flat_map(|(_, tasks)| tasks.iter().copied()).collect();
    tasks.sort_unstable();
    let matrix = RelativeMatrix::from_percent(&rows(case.input("r")), tasks.len()).unwrap();
    let of_tasks: Vec<Summary> = (0..tasks.len()).map(|task| matrix.task_summary(task)).collect();
    let of_families = family_rows("m", &tasks, &matrix);
    let families: Vec<Summary> = of_families
        .iter()
        .map(|row| Summary { mean: row.mean, standard_error: row.sem, count: row.n_seeds })
        .collect();
    let mut found = summaries(&of_tasks, ["task_mean", "task_sem", "task_n"]);
    found.extend(summaries(&families, ["family_mean", "family_sem", "family_n"]));
    found
}

fn tables(case: &Case) -> Outputs {
    let root = common::golden("analysis").unwrap().join("bench");
    let tree = read_benchmark_tree(&root).unwrap();
    let tasks: Vec<&str> = tree.experts.keys().map(String::as_str).collect();
    let experts: Vec<f64> =
        tree.experts.values().map(|entry| entry.avg_solved_step_frac.unwrap()).collect();
    let fraction = |seed: &SeedResult| -> Vec<f64> {
        tasks.iter().map(|task| seed.tasks[*task].avg_solved_step_frac.unwrap()).collect()
    };
    // Both spellings of the list give the mean that stands beside it.
    for entry in tree.methods.values().flatten().flat_map(|seed| seed.tasks.values()) {
        let episodes = entry.episode_solve_step_fracs.as_ref().unwrap();
        assert_eq!(episodes.len(), case.count("n_episodes"));
        let mean = episodes.iter().sum::<f64>() / episodes.len() as f64;
        assert!((mean - entry.avg_solved_step_frac.unwrap()).abs() < 1e-12);
    }
    let methods: BTreeMap<&str, Method> = tree
        .methods
        .iter()
        .map(|(name, seeds)| {
            let seeds = seeds.iter().map(fraction).collect();
            (name.as_str(), Method { name: name.clone(), seeds })
        })
        .collect();
    let mut found = Outputs::new();
    let mut insert = |name: String, value: f64| drop(found.insert(name, vec![value]));
    let mut means = BTreeMap::new();
    for (&name, method) in &methods {
        let relative = method.relative(&tasks, &experts, false).unwrap();
        insert(format!("methods.{name}.n_seeds"), relative.seed_count() as f64);
        for row in task_rows(name, &tasks, &relative) {
            insert(format!("methods.{name}.per_task.{}.mean", row.task), or_nan(row.mean));
            insert(format!("methods.{name}.per_task.{}.sem", row.task), or_nan(row.sem));
        }
        for row in family_rows(name, &tasks, &relative) {
            insert(format!("methods.{name}.families.{}.mean", row.column), or_nan(row.mean));
            insert(format!("methods.{name}.families.{}.sem", row.column), or_nan(row.sem));
        }
        means.insert(name, relative.task_means());
    }
    let ours = means["arnold"].clone();
    let others: Vec<(String, Vec<f64>)> = means
        .iter()
        .filter(|(name, _)| **name != "arnold")
        .map(|(name, means)| ((*name).to_owned(), means.clone()))
        .collect();
    let mut insert_test = |prefix: &str, test: &Wilcoxon| {
        for (field, value) in [
            ("W", test.statistic),
            ("w_plus", test.w_plus),
            ("w_minus", test.w_minus),
            ("n", test.nonzero as f64),
            ("p", test.p),
            ("rank_biserial", test.rank_biserial),
        ] {
            insert(format!("{prefix}.{field}"), value);
        }
    };
    let tests = against_methods(&ours, &others).unwrap();
    for row in &tests {
        insert_test(&format!("significance_vs_arnold.{}", row.method), &row.test.unwrap());
    }
    let overall = against_experts(&ours).unwrap();
    insert_test("arnold_vs_expert_wilcoxon", &overall);
    for row in &tests {
        insert(format!("significance_vs_arnold.{}.p_holm", row.method), row.p_holm);
    }
    let rows = improvements(&tasks, &experts, &methods["arnold"].seeds).unwrap();
    for (place, row) in rows.iter().enumerate() {
        let test = row.test.unwrap();
        for (field, value) in [
            ("mean", test.mean),
            ("sem", test.standard_error),
            ("t", or_nan(test.t)),
            ("df", test.degrees_of_freedom as f64),
            ("p", test.p),
            ("expert", row.expert),
            ("arnold_mean", or_nan(row.solved.mean)),
            ("arnold_sem", or_nan(row.solved.standard_error)),
            ("p_holm", row.p_holm),
        ] {
            insert(format!("arnold_vs_expert_ttests.{place}.{field}"), value);
        }
    }
    for row in &tests {
        let name = format!("significance_vs_arnold.{}.method", row.method);
        found.insert(name, text(&row.test.unwrap().method.to_string()));
    }
    found.insert("arnold_vs_expert_wilcoxon.method".to_owned(), text(&overall.method.to_string()));
    for (place, row) in rows.iter().enumerate() {
        found.insert(format!("arnold_vs_expert_ttests.{place}.task"), text(&row.task));
    }
    for (name, means) in means {
        found.insert(format!("methods.{name}.task_means"), means);
    }
    found
}

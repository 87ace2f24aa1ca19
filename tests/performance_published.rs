//! The printed tables of performance: what the program carries of them is what was published, and what is printed
//! follows from what else is printed.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::PathBuf;

use arnold_analyze::analysis::performance::{
    FAMILIES, METHODS, PUBLISHED_IMPROVEMENTS, PUBLISHED_METHODS, PUBLISHED_OVERALL,
    PublishedMethod, TABLE_TASKS,
};
use arnold_analyze::analysis::stats::{
    Sidedness, Zeros, bonferroni, holm, t_p, wilcoxon, wilcoxon_exact_p,
};
use arnold_analyze::record::read_merged_benchmarks;
use serde_json::Value;

fn published() -> Option<Value> {
    let path: PathBuf = common::golden("analysis")?.join("published.json");
    Some(serde_json::from_slice(&std::fs::read(path).unwrap()).unwrap())
}

/// Whether `value` is printed as `printed`, with so many decimals.
fn prints_as(value: f64, printed: f64, decimals: i32) -> bool {
    (value - printed).abs() <= 0.5 * 10_f64.powi(-decimals) * (1.0 + 1e-9)
}

/// The means of a method in the order of the table.
fn task_means(method: &PublishedMethod) -> Vec<f64> {
    TABLE_TASKS.iter().map(|task| method.task(task).unwrap().0).collect()
}

#[test]
fn the_tables_in_the_program_are_those_that_were_published() {
    let Some(published) = published() else { return };
    let pair = |value: &Value| (value[0].as_f64().unwrap(), value[1].as_f64().unwrap());
    for method in &PUBLISHED_METHODS {
        let tasks = &published["relative_performance_per_task"][method.name];
        assert_eq!(tasks["seeds"].as_u64(), Some(method.seeds as u64));
        for task in TABLE_TASKS {
            assert_eq!(method.task(task), Some(pair(&tasks[task])), "{} {task}", method.name);
        }
        let families = &published["relative_performance_families"][method.name];
        for family in FAMILIES.iter().map(|(name, _)| *name).chain(["avg"]) {
            assert_eq!(method.family(family), Some(pair(&families[family])), "{}", method.name);
        }
        let test = &published["ablation_significance"][method.name];
        let test = test.is_array().then(|| (pair(test).0, pair(test).1, test[2].as_f64().unwrap()));
        assert_eq!(method.test, test, "{}", method.name);
    }
    for row in &PUBLISHED_IMPROVEMENTS {
        let want = &published["arnold_vs_expert"][row.task];
        let cells = [
            (row.expert, "expert"),
            (row.arnold.0, "arnold"),
            (row.arnold.1, "arnold_sem"),
            (row.improvement.0, "improvement_pct"),
            (row.improvement.1, "improvement_sem"),
            (row.t, "t"),
            (row.p_holm, "p_holm"),
        ];
        for (found, name) in cells {
            assert_eq!(Some(found), want[name].as_f64(), "{} {name}", row.task);
        }
        assert_eq!(Some(row.p_is_bound), want["p_is_upper_bound"].as_bool());
    }
    let overall = &published["arnold_vs_expert_overall"];
    let want = (overall["W"].as_f64().unwrap(), overall["p"].as_f64().unwrap());
    assert_eq!(PUBLISHED_OVERALL, want);
}

#[test]
fn all_published_statistics_follow_from_the_published_tables() {
    let Some(published) = published() else { return };
    // Methods: p and r from W, Holm over the nine.
    let compared: Vec<&PublishedMethod> =
        PUBLISHED_METHODS.iter().filter(|method| method.test.is_some()).collect();
    assert_eq!(compared.len(), METHODS.len() - 1);
    let w: Vec<f64> = compared.iter().map(|method| method.test.unwrap().1).collect();
    let p: Vec<f64> = w.iter().map(|&w| wilcoxon_exact_p(14, w as usize).unwrap()).collect();
    for ((method, w), corrected) in compared.iter().zip(&w).zip(holm(&p)) {
        let (r, _, printed) = method.test.unwrap();
        assert!(prints_as(corrected, printed, 4), "{}: {corrected}", method.name);
        assert!(prints_as((105.0 - 2.0 * w) / 105.0, r, 3), "{}", method.name);
        let arnold = PublishedMethod::find("arnold").unwrap();
        let differences = |draw: &mut dyn FnMut() -> f64| -> Vec<f64> {
            let pairs = task_means(arnold).into_iter().zip(task_means(method));
            pairs.map(|(ours, theirs)| ours - theirs + draw() - draw()).collect()
        };
        assert!(is_reachable(differences, *w), "{}: W {w} from the rounded table", method.name);
    }
    // Experts over all tasks.
    let (w, printed) = PUBLISHED_OVERALL;
    assert!(prints_as(wilcoxon_exact_p(14, w as usize).unwrap(), printed, 4));
    let against = |draw: &mut dyn FnMut() -> f64| -> Vec<f64> {
        PUBLISHED_IMPROVEMENTS.iter().map(|row| row.improvement.0 + 0.1 * draw()).collect()
    };
    assert!(is_reachable(against, w), "W {w} from the table of improvements");
    // Experts task by task: p from t, Holm over fourteen; t from mean and s.e.m. as far as they are printed.
    let corrected = |shift: f64| -> Vec<f64> {
        let p = PUBLISHED_IMPROVEMENTS.iter();
        holm(&p.map(|row| t_p(row.t + shift, 4, Sidedness::Greater).unwrap()).collect::<Vec<_>>())
    };
    let bounds = corrected(0.0005).into_iter().zip(corrected(-0.0005));
    for (row, (low, high)) in PUBLISHED_IMPROVEMENTS.iter().zip(bounds) {
        if row.p_is_bound {
            assert!(high < row.p_holm, "{}", row.task);
        } else {
            let between = (low - 0.5e-4..=high + 0.5e-4).contains(&row.p_holm);
            assert!(between, "{}: {low} to {high}, not {}", row.task, row.p_holm);
        }
        let (mean, sem) = row.improvement;
        let ends = |sign: f64| (mean.abs() + sign * 0.005) / (sem - sign * 0.005).max(1e-9);
        let t = row.t.abs();
        assert!(ends(-1.0) <= t && t <= ends(1.0), "{}: {t}", row.task);
    }
    // Smoothness: Holm over the three pairs of each metric.
    for metric in ["mean_abs_da", "sparc", "ldlj", "nvp"] {
        let rows = published["smoothness_significance"][metric].as_array().unwrap();
        let w = |row: &Value| usize::try_from(row[0].as_u64().unwrap()).unwrap();
        let p: Vec<f64> = rows.iter().map(|row| wilcoxon_exact_p(11, w(row)).unwrap()).collect();
        for (row, corrected) in rows.iter().zip(holm(&p)) {
            let printed = row[1].as_f64().unwrap();
            let decimals = if printed < 0.01 { 4 } else { 3 };
            assert!(prints_as(corrected, printed, decimals), "{metric}: {corrected} {printed}");
        }
    }
    // Muscle activity: Bonferroni over three pairs of nine subjects; W is 0 and 1.
    let emg = &published["emg"];
    let p = [0, 1].map(|w| wilcoxon_exact_p(9, w).unwrap());
    let corrected = bonferroni(&[p[0], p[1], 1.0]);
    for (found, name) in
        corrected.iter().zip(["arnold_vs_kinesis_p_bonferroni", "arnold_vs_obc_p_bonferroni"])
    {
        assert!(prints_as(*found, emg[name].as_f64().unwrap(), 3), "{name}: {found}");
    }
}

/// Whether some table that rounds to the printed one has the rank sum `w`. `differences` is given a draw from ±0.05, half
/// a unit of the last printed place.
fn is_reachable(differences: impl Fn(&mut dyn FnMut() -> f64) -> Vec<f64>, w: f64) -> bool {
    let mut state = 1_u64;
    let mut draw = || {
        // Knuth's generator of MMIX; its high bits are good enough to look around.
        state =
            state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 11) as f64 / (1_u64 << 53) as f64 - 0.5) * 0.1
    };
    (0..20_000).any(|_| {
        let test = wilcoxon(&differences(&mut draw), Zeros::Drop, Sidedness::TwoSided).unwrap();
        (test.statistic - w).abs() < 1e-9
    })
}

#[test]
fn a_rank_sum_that_the_table_excludes_is_not_reachable() {
    let all_positive = |draw: &mut dyn FnMut() -> f64| -> Vec<f64> {
        (0..14).map(|place| 5.0 + f64::from(place) + draw()).collect()
    };
    assert!(is_reachable(all_positive, 0.0));
    assert!(!is_reachable(all_positive, 1.0));
}

#[test]
fn the_published_records_of_the_experts_print_as_the_table() {
    let Some(data) = common::published("arnold_published") else { return };
    let experts = read_merged_benchmarks(&data.join("expert_policies")).unwrap();
    for row in &PUBLISHED_IMPROVEMENTS {
        let found = experts[row.task].avg_solved_step_frac.unwrap();
        assert!(prints_as(found, row.expert, 3), "{}: {found}", row.task);
        // Arnold's fraction follows from the expert's and the improvement, up to the rounding of both.
        let arnold = found * (1.0 + row.improvement.0 / 100.0);
        assert!((arnold - row.arnold.0).abs() < 0.5e-3 + 0.005e-2 * found + 1e-9, "{}", row.task);
        let (relative, _) = PublishedMethod::find("arnold").unwrap().task(row.task).unwrap();
        assert!((100.0 + row.improvement.0 - relative).abs() < 0.056, "{}", row.task);
    }
}

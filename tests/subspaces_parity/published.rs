//! Numbers of the published tables that follow from others in them.

use arnold_analyze::analysis::stats::{Sidedness, bonferroni, holm, t_p, wilcoxon_exact_p};
use arnold_analyze::record::{read_merged_benchmarks, read_selection, read_subspace_curves};

use crate::common;

/// Whether `value` is printed as `printed`, with as many decimals.
fn prints_as(value: f64, printed: f64, decimals: i32) -> bool {
    (value - printed).abs() <= 0.5 * 10_f64.powi(-decimals) * (1.0 + 1e-9)
}

#[test]
fn the_ablation_table_follows_from_its_rank_sums() {
    // W of MT-SAC, MT-PPO, PPO+T, PPO+T+SV, BC, OBC+Task-SV, OBC w/o obs norm, OBC-PPO, OBC.
    let w = [0, 0, 0, 0, 1, 0, 0, 1, 11];
    let p: Vec<f64> = w.map(|w| wilcoxon_exact_p(14, w).unwrap()).to_vec();
    for ((w, p), corrected) in w.iter().zip(&p).zip(holm(&p)) {
        assert!(
            prints_as(corrected, if *w == 11 { 0.0067 } else { 0.0011 }, 4),
            "{w} {p} {corrected}"
        );
    }
    assert!(prints_as(wilcoxon_exact_p(14, 15).unwrap(), 0.0166, 4));
    let rank_biserial = |w: f64| (105.0 - 2.0 * w) / 105.0;
    assert!(prints_as(rank_biserial(1.0), 0.981, 3) && prints_as(rank_biserial(11.0), 0.790, 3));
}

#[test]
fn the_smoothness_table_follows_from_its_rank_sums() {
    let metrics = [
        ([19, 0, 0], [0.240, 0.0029, 0.0029]),
        ([31, 20, 11], [0.898, 0.557, 0.161]),
        ([16, 1, 1], [0.147, 0.0059, 0.0059]),
        ([7, 0, 0], [0.019, 0.0029, 0.0029]),
    ];
    for (w, printed) in metrics {
        let p = w.map(|w| wilcoxon_exact_p(11, w).unwrap());
        for (corrected, printed) in holm(&p).into_iter().zip(printed) {
            let decimals = if printed < 0.01 { 4 } else { 3 };
            assert!(prints_as(corrected, printed, decimals), "{w:?} {corrected} {printed}");
        }
    }
}

#[test]
fn the_muscle_activity_tests_follow_from_their_rank_sums() {
    let p = [0, 1].map(|w| wilcoxon_exact_p(9, w).unwrap());
    let corrected = bonferroni(&[p[0], p[1], 1.0]);
    assert!(prints_as(corrected[0], 0.012, 3) && prints_as(corrected[1], 0.023, 3));
}

#[test]
fn the_expert_table_follows_from_its_t_values() {
    let rows = [
        (12.78, 0.0012),
        (-19.803, 1.0),
        (1.129, 0.6816),
        (1.271, 0.6816),
        (8.424, 0.0054),
        (30.907, 0.0001),
        (5.023, 0.0258),
        (-3.263, 1.0),
        (1.941, 0.3727),
        (7.463, 0.0069),
        (7.746, 0.0067),
        (111.254, 0.0001),
        (-0.398, 1.0),
        (15.854, 0.0006),
    ];
    // The t values are printed with three decimals, so a p value follows from them only up to that rounding.
    let corrected = |shift: f64| -> Vec<f64> {
        let p = rows.map(|(t, _)| t_p(t + shift, 4, Sidedness::Greater).unwrap());
        holm(&p)
    };
    let bounds = corrected(0.0005).into_iter().zip(corrected(-0.0005));
    for ((t, printed), (low, high)) in rows.into_iter().zip(bounds) {
        let below = printed < 0.000_15 && high < 0.0001;
        let between = (low - 0.5e-4..=high + 0.5e-4).contains(&printed);
        assert!(below || between, "t {t}: {low} to {high}, not {printed}");
        assert!(high - low < 2e-3, "t {t}");
    }
}

#[test]
fn published_expert_records_curves_and_selection_are_read() {
    let Some(data) = common::published("arnold_published") else { return };
    let experts = read_merged_benchmarks(&data.join("expert_policies")).unwrap();
    assert_eq!(experts.len(), 14);
    let pen = &experts["pen"];
    assert!(prints_as(pen.avg_solved_step_frac.unwrap(), 0.652, 3));
    assert_eq!((pen.max_episode_steps, pen.num_episodes), (Some(100), Some(200)));
    for (task, entry) in &experts {
        let steps = entry.avg_solved_steps.unwrap() / f64::from(entry.max_episode_steps.unwrap());
        assert!((steps - entry.avg_solved_step_frac.unwrap()).abs() < 1e-9, "{task}");
    }
    let folder = data.join("upstream/subspaces");
    for (name, rows, dimensions) in [("curves_pca.csv", 1287, 39), ("curves_nmf.csv", 836, 38)] {
        let points = read_subspace_curves(&folder.join(name)).unwrap();
        assert_eq!(points.len(), rows);
        assert_eq!(points.iter().map(|point| point.dimension).max(), Some(dimensions));
        assert!(points.iter().all(|point| (0.0..=1.0).contains(&point.solved_fraction)));
    }
    // The result files themselves are not beside the selection; the first one missing is named.
    let error = read_selection(&data.join("upstream/reproduction/policies.json"), &data);
    assert!(error.unwrap_err().to_string().contains("_results.json"));
}

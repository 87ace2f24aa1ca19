//! Topic `stats`.

use arnold_analyze::analysis::stats::{
    Sidedness, Zeros, bonferroni, fisher_z, holm, mann_whitney, one_sample_t, pearson,
    rank_biserial, t_p, wilcoxon, wilcoxon_exact_p,
};

use crate::check;
use crate::common::cases::{Case, Outputs, or_nan, outputs, text};

#[test]
fn statistics_agree_with_scipy_and_the_published_tables() {
    // The other six are means and percentiles: `analysis_parity.rs`.
    check("stats", 50, |case| {
        Some(match case.algorithm() {
            "wilcoxon" => signed_rank(case),
            "wilcoxon_exact_table" => exact_table(case),
            "holm" => outputs([("adjusted", holm(&case.input("p").to_f64()))]),
            "bonferroni" => outputs([("adjusted", bonferroni(&case.input("p").to_f64()))]),
            "ttest_1samp_greater" => t_test(case),
            "t_sf_then_holm" => {
                let p: Vec<f64> = case
                    .input("t")
                    .to_f64()
                    .iter()
                    .map(|&t| t_p(t, case.count("df"), Sidedness::Greater).unwrap())
                    .collect();
                outputs([("holm", holm(&p)), ("p", p)])
            }
            "mannwhitney_exact" => {
                let (x, y) = (case.input("x").to_f64(), case.input("y").to_f64());
                let test = mann_whitney(&x, &y, Sidedness::TwoSided).unwrap();
                outputs([("U", vec![test.u]), ("p", vec![test.p])])
            }
            "rank_biserial" => {
                outputs([("r", vec![or_nan(rank_biserial(&case.input("d").to_f64()))])])
            }
            "fisher_z" => {
                let z = case.input("r").to_f64().into_iter().map(fisher_z).collect();
                outputs([("z", z)])
            }
            "pearson" => {
                let (x, y) = (case.input("x").to_f64(), case.input("y").to_f64());
                outputs([("r", vec![or_nan(pearson(&x, &y))])])
            }
            _ => return None,
        })
    });
}

fn signed_rank(case: &Case) -> Outputs {
    let zeros = match case.parameter("zeros").as_str() {
        Some("drop") => Zeros::Drop,
        Some("keep") => Zeros::Keep,
        other => panic!("unknown zeros {other:?}"),
    };
    let sidedness = match case.parameter("alternative").as_str() {
        Some("two-sided") => Sidedness::TwoSided,
        Some("greater") => Sidedness::Greater,
        Some("less") => Sidedness::Less,
        other => panic!("unknown alternative {other:?}"),
    };
    let test = wilcoxon(&case.input("d").to_f64(), zeros, sidedness);
    let number = |field: fn(&arnold_analyze::analysis::stats::Wilcoxon) -> f64| {
        vec![test.as_ref().map_or(f64::NAN, field)]
    };
    outputs([
        ("W", number(|test| test.statistic)),
        ("w_plus", number(|test| test.w_plus)),
        ("w_minus", number(|test| test.w_minus)),
        ("p", number(|test| test.p)),
        ("rank_biserial", number(|test| test.rank_biserial)),
        ("n", vec![test.map_or(0.0, |test| test.nonzero as f64)]),
        ("method", text(&test.map_or("nan".to_owned(), |test| test.method.to_string()))),
    ])
}

fn exact_table(case: &Case) -> Outputs {
    let (pairs, w) = (case.count("n"), case.input("W").to_f64());
    let total = (pairs * (pairs + 1) / 2) as f64;
    let p = w.iter().map(|&w| wilcoxon_exact_p(pairs, w as usize).unwrap()).collect();
    let r = w.iter().map(|w| (total - 2.0 * w) / total).collect();
    outputs([("p", p), ("rank_biserial", r)])
}

fn t_test(case: &Case) -> Outputs {
    let test = one_sample_t(&case.input("x").to_f64(), Sidedness::Greater).unwrap();
    outputs([
        ("mean", vec![test.mean]),
        ("sem", vec![test.standard_error]),
        ("t", vec![or_nan(test.t)]),
        ("df", vec![test.degrees_of_freedom as f64]),
        ("p", vec![test.p]),
    ])
}

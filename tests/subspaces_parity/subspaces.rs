//! Topics `nmf`, `pvd_pad` and the projections of `csi`.

use arnold_analyze::analysis::subspace::{
    AngleSummary, Cell, Covariance, NmfOptions, NmfStart, NonNegativeRows, RidgeProjection,
    SynergyProjection, VarianceDifference, compare_cells, compare_subspaces, exact_synergy_weights,
    nonnegative_factorisation, principal_angles, principal_components, reconstruction,
    summarise_pairs, synergy_weights, variance_difference,
};
use arnold_analyze::npz::Array;

use crate::check;
use crate::common::cases::{Case, Outputs, or_nan, outputs};

#[test]
fn factorisations_agree_with_scikit_learn() {
    check("nmf", 12, |case| {
        Some(match case.algorithm() {
            "nmf" => nmf(case),
            "nmf_r2_curves" => nmf_r2_curves(case),
            "nmf_transform" => nmf_transform(case),
            "r2" => r2(case),
            "nnls_rows" => {
                let (x, h) = (case.input("X"), case.input("H"));
                outputs([("W", exact(&x.to_f64(), &h.to_f64(), h.shape[1]))])
            }
            _ => return None,
        })
    });
}

#[test]
fn subspace_differences_agree_with_the_suite() {
    check("pvd_pad", 8, |case| {
        Some(match case.algorithm() {
            "pvd_pad" => pvd_pad(case),
            "principal_angles" => {
                let (p, q) = (case.input("P"), case.input("Q"));
                let angles = principal_angles(&p.to_f64(), &q.to_f64(), p.shape[1]).unwrap();
                outputs([("angles", angles)])
            }
            "pair_summary" => pair_summary(case),
            _ => return None,
        })
    });
}

#[test]
fn projections_of_learned_and_of_non_negative_subspaces_agree() {
    check("csi", 4, |case| {
        Some(match case.algorithm() {
            "csi_project_ridge" => ridge(case),
            "csi_project_nmf" => shifted_synergies(case),
            _ => return None,
        })
    });
}

fn exact(rows: &[f64], synergies: &[f64], muscles: usize) -> Vec<f64> {
    exact_synergy_weights(rows, synergies, muscles).unwrap()
}

fn product(weights: &[f64], synergies: &[f64], muscles: usize) -> Vec<f64> {
    let rank = synergies.len() / muscles;
    weights
        .chunks_exact(rank)
        .flat_map(|row| {
            (0..muscles).map(move |m| (0..rank).map(|t| row[t] * synergies[t * muscles + m]).sum())
        })
        .collect()
}

fn options(case: &Case, tolerance: f64) -> NmfOptions {
    NmfOptions { start: NmfStart::Mean, maximum_iterations: case.count("max_iter"), tolerance }
}

fn nmf(case: &Case) -> Outputs {
    let x = case.input("X");
    let (values, muscles) = (x.to_f64(), x.shape[1]);
    let data = NonNegativeRows::new(&values, muscles).unwrap();
    let fit = |maximum_iterations| {
        let options = NmfOptions { maximum_iterations, ..options(case, case.number("tol")) };
        nonnegative_factorisation(&data, case.count("k"), &options).unwrap()
    };
    let (start, first, last) = (fit(0), fit(1), fit(case.count("max_iter")));
    let scores = reconstruction(&values, &last.rebuilt(), muscles).unwrap();
    let nnls = product(&exact(&values, &last.synergies, muscles), &last.synergies, muscles);
    let nnls_scores = reconstruction(&values, &nnls, muscles).unwrap();
    let error: f64 = last.rebuilt().iter().zip(&values).map(|(y, x)| (y - x) * (y - x)).sum();
    outputs([
        ("W_init", start.weights),
        ("H_init", start.synergies),
        ("W_after_1", first.weights),
        ("H_after_1", first.synergies),
        ("H", last.synergies),
        ("X_hat_nnls", nnls),
        ("frobenius", vec![error.sqrt()]),
        ("r2_centered", vec![or_nan(scores.centred)]),
        ("r2_uncentered", vec![or_nan(scores.uncentred)]),
        ("r2_uniform", vec![scores.uniform]),
        ("r2_centered_nnls", vec![or_nan(nnls_scores.centred)]),
    ])
}

fn nmf_r2_curves(case: &Case) -> Outputs {
    let shifted = |array: &Array| -> Vec<f64> {
        array.to_f64().iter().map(|a| f64::midpoint(a.clamp(-1.0, 1.0), 1.0)).collect()
    };
    let tasks = [shifted(case.input("a0")), shifted(case.input("a1"))];
    let muscles = case.input("a0").shape[1];
    let pool = NonNegativeRows::new(&tasks.concat(), muscles).unwrap();
    let options = options(case, case.number("tol"));
    let score = |data: &NonNegativeRows, task: &[f64], rank| {
        let fit = nonnegative_factorisation(data, rank, &options).unwrap();
        let weights = exact(task, &fit.synergies, muscles);
        let rebuilt = product(&weights, &fit.synergies, muscles);
        reconstruction(task, &rebuilt, muscles).unwrap().centred.unwrap()
    };
    let (mut own, mut shared) = (Vec::new(), Vec::new());
    for task in &tasks {
        let data = NonNegativeRows::new(task, muscles).unwrap();
        for rank in case.parameter("k").as_array().unwrap() {
            let rank = usize::try_from(rank.as_u64().unwrap()).unwrap();
            own.push(score(&data, task, rank));
            shared.push(score(&pool, task, rank));
        }
    }
    outputs([("own", own), ("shared", shared)])
}

fn nmf_transform(case: &Case) -> Outputs {
    let (x, h) = (case.input("X"), case.input("H"));
    let (values, synergies, muscles) = (x.to_f64(), h.to_f64(), x.shape[1]);
    let options = options(case, case.number("tol"));
    if case.parameter("by_row").as_bool() == Some(true) {
        let projection = SynergyProjection::new(&synergies, muscles, &options).unwrap();
        let mut scratch = vec![0.0; projection.scratch_length()];
        let (mut weights, mut rebuilt) = (Vec::new(), values);
        for row in rebuilt.chunks_exact_mut(muscles) {
            weights.extend_from_slice(projection.apply(row, &mut scratch));
        }
        return outputs([("W", weights), ("Y", rebuilt)]);
    }
    let data = NonNegativeRows::new(&values, muscles).unwrap();
    let found = synergy_weights(&data, &synergies, &options).unwrap();
    let score = reconstruction(&values, &found.rebuilt, muscles).unwrap().centred;
    outputs([("W", found.weights), ("Y", found.rebuilt), ("r2_centered", vec![or_nan(score)])])
}

fn r2(case: &Case) -> Outputs {
    let (x, y) = (case.input("X"), case.input("Y"));
    let scores = reconstruction(&x.to_f64(), &y.to_f64(), x.shape[1]).unwrap();
    outputs([
        ("centered", vec![or_nan(scores.centred)]),
        ("uncentered", vec![or_nan(scores.uncentred)]),
        ("uniform", vec![scores.uniform]),
    ])
}

fn cell(task: &str, actions: &Array) -> Cell {
    let mut covariance = Covariance::new(actions.shape[1]);
    covariance.push_rows(&actions.to_f64()).unwrap();
    let components = principal_components(&covariance).unwrap();
    Cell { policy: "policy".to_owned(), task: task.to_owned(), covariance, components }
}

fn pvd_pad(case: &Case) -> Outputs {
    let (a, b) = (cell("a", case.input("A")), cell("b", case.input("B")));
    let (a, b) = ((&a.covariance, &a.components), (&b.covariance, &b.components));
    let pad = |angle| compare_subspaces(a, b, VarianceDifference::Directed, angle).unwrap().pad;
    outputs([
        ("pvd_ab", variance_difference(a, b.1, VarianceDifference::Directed).unwrap()),
        ("pvd_ba", variance_difference(b, a.1, VarianceDifference::Directed).unwrap()),
        (
            "difference_ab",
            variance_difference(a, b.1, VarianceDifference::ShareDifference).unwrap(),
        ),
        (
            "difference_ba",
            variance_difference(b, a.1, VarianceDifference::ShareDifference).unwrap(),
        ),
        ("pad_mean", pad(AngleSummary::Mean)),
        ("pad_max", pad(AngleSummary::Largest)),
        ("pad_min", pad(AngleSummary::Smallest)),
    ])
}

fn pair_summary(case: &Case) -> Outputs {
    let cells: Vec<Cell> = ["a0", "a1", "a2", "a3"].map(|name| cell(name, case.input(name))).into();
    let compared = compare_cells(&cells, VarianceDifference::Directed, AngleSummary::Mean).unwrap();
    assert_eq!(compared.len(), 6);
    let group = summarise_pairs(&compared, false).remove(0);
    let means = |curve: &[arnold_analyze::analysis::subspace::CurveSummary]| {
        curve.iter().map(|point| or_nan(point.mean)).collect()
    };
    let deviations = |curve: &[arnold_analyze::analysis::subspace::CurveSummary]| {
        curve.iter().map(|point| or_nan(point.standard_deviation)).collect()
    };
    outputs([
        ("pvd_mean", means(&group.pvd)),
        ("pvd_sd", deviations(&group.pvd)),
        ("pad_mean", means(&group.pad)),
        ("pad_sd", deviations(&group.pad)),
    ])
}

fn ridge(case: &Case) -> Outputs {
    let (p, mean, x) = (case.input("P"), case.input("mean").to_f64(), case.input("x"));
    let projection =
        RidgeProjection::new(&p.to_f64(), &mean, p.shape[0], case.number("eps")).unwrap();
    let mut y = x.to_f64();
    y.chunks_exact_mut(mean.len()).for_each(|action| projection.apply(action));
    outputs([("y", y)])
}

fn shifted_synergies(case: &Case) -> Outputs {
    let (h, x) = (case.input("H"), case.input("x").to_f64());
    let (synergies, muscles) = (h.to_f64(), h.shape[1]);
    let shifted: Vec<f64> = x.iter().map(|a| f64::midpoint(a.clamp(-1.0, 1.0), 1.0)).collect();
    let w = exact(&shifted, &synergies, muscles);
    let y = product(&w, &synergies, muscles);
    let y = y.iter().map(|x| (2.0 * x - 1.0).clamp(-1.0, 1.0)).collect();
    outputs([("w", w), ("y", y)])
}

//! Factorisation into synergies and comparison of all pairs of subspaces, beside scikit-learn and NumPy on one core.
//!
//! The other side is `scripts/peers/subspaces.py`. It runs when `$PYTHON` (else `python3`) has the packages; otherwise
//! only our own times are printed. Both sides get the same sizes, the same number of iterations and no early stop.

use std::hint::black_box;
use std::process::Command;

use arnold_analyze::analysis::subspace::{
    AngleSummary, Covariance, NmfOptions, NmfStart, NonNegativeRows, VarianceDifference,
    compare_subspaces, nonnegative_factorisation, principal_components,
};
use serde_json::{Value, json};

const MUSCLES: usize = 39;

/// Prints the times.
pub(crate) fn run(is_quick: bool) {
    let rows = if is_quick { 4_000 } else { 165_000 };
    let ranks: &[usize] = if is_quick { &[8] } else { &[4, 13, 26, 38] };
    let iterations = if is_quick { 3 } else { 10 };
    let (cells, repeats) = if is_quick { (4, 1) } else { (24, 3) };
    let sizes = json!({
        "muscles": MUSCLES, "rows": rows, "ranks": ranks, "iterations": iterations,
        "cells": cells, "repeats": repeats,
    });
    let theirs = python(&sizes);
    let report = |name: &str, what: &str, seconds: f64| {
        let other = theirs[name].as_f64();
        let beside = other.map_or_else(String::new, |other| {
            format!("; Python {:.3} ms, ratio {:.1}", 1e3 * other, other / seconds)
        });
        println!("{what}: {:.3} ms{beside}", 1e3 * seconds);
    };

    let values: Vec<f64> = (0..rows * MUSCLES)
        .map(|i| {
            let (t, m) = ((i / MUSCLES) as f64, (i % MUSCLES) as f64);
            let slow = (0.013 * t * (1.0 + m % 7.0) + m).sin();
            0.5 + 0.25 * slow + 0.25 * (0.0071 * t * (1.0 + m)).sin()
        })
        .collect();
    let options = NmfOptions {
        start: NmfStart::Mean,
        maximum_iterations: iterations,
        tolerance: f64::MIN_POSITIVE,
    };
    for &rank in ranks {
        // Reading the data in is part of a fit here, though all ranks could share it.
        let seconds = fastest(repeats, || {
            let data =
                NonNegativeRows::new(black_box(&values), MUSCLES).expect("they are positive");
            black_box(nonnegative_factorisation(&data, rank, &options).expect("the rank is there"));
        });
        let what =
            format!("{rank} synergies of {MUSCLES} × {rows} controls, {iterations} iterations");
        report(&format!("rank {rank}"), &what, seconds);
    }

    let sets: Vec<_> = (0..cells)
        .map(|cell| {
            let mut covariance = Covariance::new(MUSCLES);
            for t in 0..500 {
                let row: [f64; MUSCLES] = std::array::from_fn(|m| {
                    let phase = f64::from(t) * (0.11 + 0.37 * m as f64) + (cell * m) as f64;
                    phase.sin() / (1.0 + m as f64 / 4.0)
                });
                covariance.push_row(&row).expect("the rows are finite");
            }
            let components = principal_components(&covariance).expect("the rows vary");
            (covariance, components)
        })
        .collect();
    let seconds = fastest(repeats, || {
        for (i, a) in sets.iter().enumerate() {
            for b in &sets[i + 1..] {
                let (a, b) = ((&a.0, &a.1), (&b.0, &b.1));
                let (pvd, pad) = (VarianceDifference::Directed, AngleSummary::Mean);
                black_box(compare_subspaces(a, b, pvd, pad).expect("the bodies are the same"));
            }
        }
    });
    let what = format!("PVD and PAD of {} pairs, all component counts", cells * (cells - 1) / 2);
    report("pairs", &what, seconds);
}

fn fastest(repeats: usize, mut work: impl FnMut()) -> f64 {
    (0..repeats)
        .map(|_| {
            let start = std::time::Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min)
}

/// The seconds that Python takes, by name; null without Python or its packages.
fn python(sizes: &Value) -> Value {
    let interpreter = std::env::var("PYTHON").unwrap_or_else(|_| "python3".to_owned());
    let script = concat!(env!("CARGO_MANIFEST_DIR"), "/scripts/peers/subspaces.py");
    let output = Command::new(interpreter).arg(script).arg(sizes.to_string()).output();
    let seconds = output.ok().filter(|output| output.status.success());
    seconds.and_then(|output| serde_json::from_slice(&output.stdout).ok()).unwrap_or_else(|| {
        println!("no comparison: Python with NumPy and scikit-learn was not found");
        Value::Null
    })
}

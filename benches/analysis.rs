//! How long the analyses take: `cargo bench --no-default-features --bench analysis`. One line each: the fastest of
//! several runs, which is the one the least disturbed by the rest of the machine.
#![expect(clippy::print_stdout, reason = "the times are what this program prints")]

#[path = "analysis/smoothness.rs"]
mod smoothness;
#[path = "analysis/subspaces.rs"]
mod subspaces;

use std::hint::black_box;
use std::time::Instant;

use arnold_analyze::analysis::stats::{BootstrapOptions, bootstrap_mean};
use arnold_analyze::analysis::subspace::{Covariance, Projection, principal_components};

const MUSCLES: usize = 39;
const ROWS: usize = 20_000;

fn main() {
    let rows: Vec<f32> = (0..ROWS * MUSCLES)
        .map(|i| ((i / MUSCLES) as f32 * 0.013 * (1 + i % MUSCLES) as f32).sin())
        .collect();
    let mut covariance = Covariance::new(MUSCLES);
    covariance.push_rows(&rows).expect("the rows are finite");
    let components = principal_components(&covariance).expect("the rows vary");
    let projection = Projection::new(&components, 20).expect("there are 39 components");
    let mut scratch = vec![0.0; projection.scratch_length()];
    let mut action = [0.3_f32; MUSCLES];
    let scores: Vec<f64> = (0..100).map(|i| f64::from(i % 13)).collect();

    report("covariance, one row of 39 muscles", ROWS, || {
        let mut covariance = Covariance::new(MUSCLES);
        covariance.push_rows(black_box(&rows)).expect("the rows are finite");
        black_box(covariance.trace());
    });
    report("principal components of 39 muscles", 1, || {
        black_box(principal_components(black_box(&covariance)).expect("the rows vary"));
    });
    report("projection of one action onto 20 of 39", 10_000, || {
        for _ in 0..10_000 {
            projection.apply(black_box(&mut action), &mut scratch);
        }
    });
    report("bootstrap interval, 100 episodes, 10,000 draws", 1, || {
        black_box(bootstrap_mean(black_box(&scores), &BootstrapOptions::default()));
    });
    let quick = std::env::args().any(|argument| argument == "--quick");
    smoothness::run(quick);
    subspaces::run(quick);
}

/// Prints the time of one of the `count` things that `work` does.
fn report(what: &str, count: usize, mut work: impl FnMut()) {
    let fastest = (0..10)
        .map(|_| {
            let start = Instant::now();
            work();
            start.elapsed().as_secs_f64()
        })
        .fold(f64::INFINITY, f64::min);
    println!("{what}: {:.3} µs", 1e6 * fastest / count as f64);
}

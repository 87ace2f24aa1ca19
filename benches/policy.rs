//! The forward pass of the small and the full transformer against this machine's matrix product; see
//! `arnold_analyze::experiment::throughput::forward`. `cargo bench --bench policy -- --quick` takes seconds;
//! `arnold-analyze bench policy` measures the same with more choice.

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]

use std::time::Duration;

use arnold_analyze::experiment::throughput::forward::{BODIES, Ceiling, NETWORKS, measure};

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let budget = Duration::from_millis(if quick { 100 } else { 2000 });
    let ceiling = Ceiling::measure(budget);
    println!("ceiling: {:.1} GFLOP/s of {:?}", ceiling.best(), ceiling.rates);
    for network in NETWORKS.iter().filter(|network| matches!(network.name, "full" | "xs")) {
        for body in &BODIES {
            for batch in [1, 16] {
                let row = measure(network, body, batch, budget).expect("the weights fit");
                println!(
                    "{:4}  {:4}  batch {batch:2}: {:7.3} ms an observation, {:6.1} GFLOP/s, {:3.0} % of the ceiling",
                    row.network,
                    row.body,
                    row.milliseconds,
                    row.gigaflops,
                    100.0 * row.gigaflops / ceiling.best(),
                );
            }
        }
    }
}

//! Numbers behind the ablation figures.
//!
//! * The vocabulary figure shows, for each task and seed, the change against another method:
//!   `100 · fraction / mean fraction of the reference's seeds − 100`, in percent of the **reference**, not of the expert;
//!   mean ± standard deviation (divisor n − 1) over seeds; tasks by rising mean.
//! * Bars of episodes draw at most [`DOTS`] of their dots, at evenly spaced indices.
//!
//! Degenerate: a reference of zero leaves its task undefined; undefined tasks come last.
//! Oracle: `tests/analysis_parity.rs`, algorithm `relative_dotplot`.

use super::super::stats::{Divisor, mean, standard_deviation};
use super::{PerformanceError, percent_of};

/// Dots drawn over one bar at most.
pub const DOTS: usize = 100;

/// Changes of all tasks.
#[derive(Debug, Clone, PartialEq)]
pub struct Change {
    /// One row per seed, one value per task, in percent.
    pub seeds: Vec<Vec<f64>>,
    /// One value per task; NaN is undefined.
    pub mean: Vec<f64>,
    pub standard_deviation: Vec<f64>,
    /// Tasks by rising mean, equal ones in their own order.
    pub order: Vec<usize>,
}

/// The change of `method` against `reference`, both one row of solved fractions per seed.
pub fn change_against_reference(
    method: &[Vec<f64>],
    reference: &[Vec<f64>],
) -> Result<Change, PerformanceError> {
    let tasks = reference.first().map_or(0, Vec::len);
    if let Some(row) = method.iter().chain(reference).find(|row| row.len() != tasks) {
        return Err(PerformanceError::TaskCount { expected: tasks, found: row.len() });
    }
    let column =
        |rows: &[Vec<f64>], task: usize| -> Vec<f64> { rows.iter().map(|row| row[task]).collect() };
    let references: Vec<f64> =
        (0..tasks).map(|task| mean(&column(reference, task)).unwrap_or(f64::NAN)).collect();
    let seeds: Vec<Vec<f64>> = method
        .iter()
        .map(|row| row.iter().zip(&references).map(|(x, r)| percent_of(*r, *x) - 100.0).collect())
        .collect();
    let over_seeds = |statistic: &dyn Fn(&[f64]) -> Option<f64>| -> Vec<f64> {
        (0..tasks).map(|task| statistic(&column(&seeds, task)).unwrap_or(f64::NAN)).collect()
    };
    let means = over_seeds(&|values| mean(values));
    let deviations = over_seeds(&|values| standard_deviation(values, Divisor::CountMinusOne));
    let mut order: Vec<usize> = (0..tasks).collect();
    // NaN of either sign last.
    order.sort_by(|&a, &b| {
        means[a].is_nan().cmp(&means[b].is_nan()).then(means[a].total_cmp(&means[b]))
    });
    Ok(Change { seeds, mean: means, standard_deviation: deviations, order })
}

/// At most `most` indices below `count`, evenly spaced from the first to the last and rounded down.
#[must_use]
pub fn evenly_spaced(count: usize, most: usize) -> Vec<usize> {
    if count <= most || most < 2 {
        return (0..count.min(most)).collect();
    }
    let step = (count - 1) as f64 / (most - 1) as f64;
    let last = most - 1;
    (0..most).map(|i| if i == last { count - 1 } else { (i as f64 * step) as usize }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dots_run_from_the_first_episode_to_the_last() {
        assert_eq!(evenly_spaced(3, 100), [0, 1, 2]);
        assert_eq!(evenly_spaced(10, 4), [0, 3, 6, 9]);
        assert_eq!(evenly_spaced(200, 100).last(), Some(&199));
        assert_eq!(evenly_spaced(5, 1), [0]);
        assert!(evenly_spaced(5, 0).is_empty() && evenly_spaced(0, 5).is_empty());
    }

    #[test]
    fn a_reference_of_zero_is_undefined_and_last() {
        let change =
            change_against_reference(&[vec![0.3, 0.6]], &[vec![0.0, 0.5], vec![0.0, 0.7]]).unwrap();
        assert_eq!(change.order, [1, 0]);
        assert!(change.mean[0].is_nan() && change.mean[1].abs() < 1e-12);
        assert!(change.standard_deviation[1].is_nan());
        assert!(change_against_reference(&[vec![0.3]], &[vec![0.1, 0.2]]).is_err());
    }
}

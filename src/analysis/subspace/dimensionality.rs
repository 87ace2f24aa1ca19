//! Functional dimensionality: how many components a task needs.
//!
//! The smallest number k of components at which the mean performance reaches a share (0.90, 0.95) of the unprojected
//! policy's: `min { k : p(k) ≥ share · p }`. A count, no unit. Performance is any score that grows with success;
//! solved fractions here.
//!
//! Its interval comes from the bootstrap over episodes. Episode i starts from the same state and sees the same noise
//! for every component count, so one draw takes the same episodes from every row, the unprojected one included.
//!
//! Degenerate: undefined if no count reaches the share, or if the unprojected policy never succeeds.

use super::super::stats::{BootstrapOptions, Interval, bootstrap_interval, mean};

/// A functional dimensionality with its bootstrap interval, both in components.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Dimensionality {
    pub components: Option<usize>,
    /// Over the draws in which the dimensionality is defined.
    pub interval: Option<Interval>,
}

/// The smallest of the component `counts` (rising) at which `performance` reaches `share` of `unprojected`.
#[must_use]
pub fn functional_dimensionality(
    counts: &[usize],
    performance: &[f64],
    unprojected: f64,
    share: f64,
) -> Option<usize> {
    if unprojected.is_nan() || unprojected <= 0.0 {
        return None;
    }
    counts.iter().zip(performance).find(|(_, p)| **p >= share * unprojected).map(|(&k, _)| k)
}

/// The same from episodes, with its interval. `performance` has one row per entry of `counts`; every row, and
/// `unprojected`, has one value per episode, in the same order. `None` if the rows differ in length.
#[must_use]
pub fn functional_dimensionality_of(
    counts: &[usize],
    performance: &[Vec<f64>],
    unprojected: &[f64],
    share: f64,
    options: &BootstrapOptions,
) -> Option<Dimensionality> {
    let episodes = unprojected.len();
    if counts.len() != performance.len() || performance.iter().any(|row| row.len() != episodes) {
        return None;
    }
    let means = performance.iter().map(|row| mean(row)).collect::<Option<Vec<f64>>>()?;
    let components = functional_dimensionality(counts, &means, mean(unprojected)?, share);
    let mut means_of_draw = vec![0.0; counts.len()];
    let interval = bootstrap_interval(episodes, options, |draw| {
        let mean_of = |row: &[f64]| -> f64 {
            draw.iter().map(|&episode| row[episode]).sum::<f64>() / draw.len() as f64
        };
        for (mean, row) in means_of_draw.iter_mut().zip(performance) {
            *mean = mean_of(row);
        }
        functional_dimensionality(counts, &means_of_draw, mean_of(unprojected), share)
            .map(|k| k as f64)
    });
    Some(Dimensionality { components, interval })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_smallest_count_that_reaches_the_share() {
        let counts = [1, 2, 5, 10];
        let performance = [0.1, 0.73, 0.70, 0.8];
        assert_eq!(functional_dimensionality(&counts, &performance, 0.8, 0.90), Some(2));
        assert_eq!(functional_dimensionality(&counts, &performance, 0.8, 0.95), Some(10));
        assert_eq!(functional_dimensionality(&counts, &performance, 0.9, 0.95), None);
        assert_eq!(functional_dimensionality(&counts, &performance, 0.0, 0.95), None);
        assert_eq!(functional_dimensionality(&counts, &performance, f64::NAN, 0.95), None);
    }

    #[test]
    fn the_interval_contains_the_estimate_and_shrinks_without_noise() {
        let options = BootstrapOptions { resamples: 400, ..Default::default() };
        let counts = [1, 2, 3];
        let unprojected: Vec<f64> = (0..20).map(|i| 0.8 + 0.01 * f64::from(i % 5)).collect();
        let scaled = |factor: f64| unprojected.iter().map(|p| factor * p).collect::<Vec<f64>>();
        let paired = [scaled(0.5), scaled(0.93), scaled(1.0)];
        // Every episode scales alike: with paired draws there is nothing uncertain.
        let found = functional_dimensionality_of(&counts, &paired, &unprojected, 0.9, &options);
        let want = Dimensionality {
            components: Some(2),
            interval: Some(Interval { low: 2.0, high: 2.0 }),
        };
        assert_eq!(found, Some(want));
    }

    #[test]
    fn rows_of_different_length_are_refused() {
        let options = BootstrapOptions { resamples: 10, ..Default::default() };
        let ragged = [vec![1.0], vec![1.0, 2.0]];
        assert_eq!(functional_dimensionality_of(&[1, 2], &ragged, &[1.0], 0.9, &options), None);
    }
}

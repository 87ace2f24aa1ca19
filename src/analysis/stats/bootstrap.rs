//! Bootstrap percentile intervals, the same bytes for the same seed.
//!
//! Episodes are drawn with replacement as often as there are episodes, the statistic is computed on the draw, and the
//! interval lies between the (1 − c)/2 and (1 + c)/2 quantiles of the resampled statistics. In the unit of the
//! statistic. Draws come from `ChaCha8` seeded with [`BootstrapOptions::seed`] and nothing else: no clock, no thread.
//!
//! Degenerate: no values, or no resample with a defined statistic, gives no interval. One value gives an interval of
//! width zero, which says nothing; callers show the number of episodes beside it.
//!
//! Reference: Efron & Tibshirani 1993, chapter 13. Resampling whole episodes keeps what belongs together (all component
//! counts of one episode) in one draw.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{Rng, SeedableRng};

use super::percentile::percentile_of_sorted;

/// How to bootstrap.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BootstrapOptions {
    /// Number of resamples.
    pub resamples: usize,
    /// Confidence of the interval, in (0, 1).
    pub confidence: f64,
    /// Seed of the draws.
    pub seed: u64,
}

impl Default for BootstrapOptions {
    fn default() -> Self {
        Self { resamples: 10_000, confidence: 0.95, seed: 0 }
    }
}

/// A confidence interval, in the unit of its statistic.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Interval {
    pub low: f64,
    pub high: f64,
}

/// Interval of the mean of `values`, one value per episode.
#[must_use]
pub fn bootstrap_mean(values: &[f64], options: &BootstrapOptions) -> Option<Interval> {
    bootstrap_interval(values.len(), options, |draw| {
        Some(draw.iter().map(|&episode| values[episode]).sum::<f64>() / draw.len() as f64)
    })
}

/// Interval of mean(`first`) − mean(`second`), both drawn anew and independently in every resample.
#[must_use]
pub fn bootstrap_difference(
    first: &[f64],
    second: &[f64],
    options: &BootstrapOptions,
) -> Option<Interval> {
    if first.is_empty() || second.is_empty() {
        return None;
    }
    let mut generator = ChaCha8Rng::seed_from_u64(options.seed);
    let mut drawn_mean = |values: &[f64]| {
        let drawn = (0..values.len()).map(|_| values[below(&mut generator, values.len())]);
        drawn.sum::<f64>() / values.len() as f64
    };
    let resampled = (0..options.resamples).map(|_| drawn_mean(first) - drawn_mean(second));
    interval_of(resampled.collect(), options.confidence)
}

/// Interval of any `statistic` of `episode_count` episodes. It is given the indices of the drawn episodes and may be
/// undefined on a draw, which is then left out.
#[must_use]
pub fn bootstrap_interval(
    episode_count: usize,
    options: &BootstrapOptions,
    mut statistic: impl FnMut(&[usize]) -> Option<f64>,
) -> Option<Interval> {
    if episode_count == 0 {
        return None;
    }
    let mut generator = ChaCha8Rng::seed_from_u64(options.seed);
    let mut draw = vec![0_usize; episode_count];
    let mut resampled = Vec::with_capacity(options.resamples);
    for _ in 0..options.resamples {
        for episode in &mut draw {
            *episode = below(&mut generator, episode_count);
        }
        resampled.extend(statistic(&draw));
    }
    interval_of(resampled, options.confidence)
}

/// The quantiles of resampled statistics between which the interval lies.
fn interval_of(mut resampled: Vec<f64>, confidence: f64) -> Option<Interval> {
    resampled.sort_by(f64::total_cmp);
    let tail = 50.0 * (1.0 - confidence);
    Some(Interval {
        low: percentile_of_sorted(&resampled, tail)?,
        high: percentile_of_sorted(&resampled, 100.0 - tail)?,
    })
}

/// A number in 0..`bound`, all equally likely: the high half of a 64 × 64 bit product, drawing again in the rare
/// case that would favour some numbers (Lemire 2019).
fn below(generator: &mut ChaCha8Rng, bound: usize) -> usize {
    let bound = bound as u64;
    let unfair = bound.wrapping_neg() % bound;
    loop {
        let product = u128::from(generator.next_u64()) * u128::from(bound);
        if product as u64 >= unfair {
            return (product >> 64) as usize;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_same_seed_gives_the_same_bytes_and_another_seed_others() {
        let values: Vec<f64> = (0..30).map(|i| f64::from(i * i % 17)).collect();
        let options = BootstrapOptions { resamples: 500, ..Default::default() };
        let first = bootstrap_mean(&values, &options).unwrap();
        assert_eq!(first, bootstrap_mean(&values, &options).unwrap());
        let other = BootstrapOptions { seed: 1, ..options };
        assert_ne!(first, bootstrap_mean(&values, &other).unwrap());
    }

    #[test]
    fn the_interval_of_a_normal_looking_mean_is_the_textbook_one() {
        // Uniform on 0..1000: mean 499.5, s.e.m. 288.67/√1000 = 9.13, so ±1.96 s.e.m. = ±17.9.
        let values: Vec<f64> = (0..1000).map(f64::from).collect();
        let options = BootstrapOptions { resamples: 4000, ..Default::default() };
        let Interval { low, high } = bootstrap_mean(&values, &options).unwrap();
        assert!((low - 481.6).abs() < 1.5 && (high - 517.4).abs() < 1.5, "{low} {high}");
    }

    #[test]
    fn the_interval_of_a_difference_of_samples_is_the_textbook_one() {
        // Each mean has the s.e.m. of the test above, 9.13, so their difference √2 of it: ±1.96 · 12.91 = ±25.3.
        let values: Vec<f64> = (0..1000).map(f64::from).collect();
        let higher: Vec<f64> = values.iter().map(|x| x + 100.0).collect();
        let options = BootstrapOptions { resamples: 4000, ..Default::default() };
        let Interval { low, high } = bootstrap_difference(&higher, &values, &options).unwrap();
        assert!((low - 74.7).abs() < 2.0 && (high - 125.3).abs() < 2.0, "{low} {high}");
        assert_eq!(bootstrap_difference(&[], &values, &options), None);
    }

    #[test]
    fn degenerate_samples() {
        let options = BootstrapOptions { resamples: 20, ..Default::default() };
        assert_eq!(bootstrap_mean(&[], &options), None);
        assert_eq!(bootstrap_mean(&[3.0], &options), Some(Interval { low: 3.0, high: 3.0 }));
        assert_eq!(bootstrap_mean(&[1.0, f64::NAN], &options), None);
        assert_eq!(bootstrap_interval(4, &options, |_| None), None);
    }

    #[test]
    fn every_index_is_drawn_about_equally_often() {
        let mut generator = ChaCha8Rng::seed_from_u64(7);
        let mut counts = [0_u32; 6];
        for _ in 0..60_000 {
            counts[below(&mut generator, 6)] += 1;
        }
        // Five standard deviations of a binomial count around 10,000.
        assert!(counts.iter().all(|&c| c.abs_diff(10_000) < 460), "{counts:?}");
    }
}

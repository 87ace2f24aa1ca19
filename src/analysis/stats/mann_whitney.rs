//! Mann & Whitney's test of two independent samples, exact.
//!
//! U = number of pairs (x, y) with x > y, ties counting one half. Its distribution under "both samples come from one
//! population" is counted over all ways to deal the observed average ranks to the two samples, so ties need no
//! correction. No unit. Two-sided p = min(1, 2·min of the tails); effect size: rank-biserial r = 2U/(nm) − 1.
//!
//! Made for a handful of seeds per method: of more than [`LARGEST_SAMPLE`] values in both samples together nothing is
//! counted. [`mann_whitney_normal`] approximates for any number, U by a normal variable with mean nm/2 and variance
//! `nm/12 · (N + 1 − Σ(t³ − t)/(N(N − 1)))`, t the sizes of the groups of ties, with half a unit of continuity correction.
//!
//! Degenerate: an empty sample, NaN, or too many values: undefined. All values equal: p = 1.
//! Oracle: `tests/analysis_parity.rs`, algorithm `mannwhitney_exact`.

use statrs::distribution::{ContinuousCDF, Normal};

use super::Sidedness;
use super::ranks::{average_ranks, tie_correction};

/// Values in both samples together at most.
pub const LARGEST_SAMPLE: usize = 100;

/// Outcome of the test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MannWhitney {
    /// Pairs in which the first sample's value is larger.
    pub u: f64,
    pub p: f64,
    pub rank_biserial: f64,
}

/// Tests whether `first` tends to differ from `second`.
#[must_use]
pub fn mann_whitney(first: &[f64], second: &[f64], sidedness: Sidedness) -> Option<MannWhitney> {
    let (n, m) = (first.len(), second.len());
    let values: Vec<f64> = first.iter().chain(second).copied().collect();
    if n == 0 || m == 0 || n + m > LARGEST_SAMPLE || values.iter().any(|x| x.is_nan()) {
        return None;
    }
    let (ranks, _) = average_ranks(&values);
    // Average ranks are halves; twice them are whole.
    let doubled: Vec<usize> = ranks.iter().map(|rank| (2.0 * rank) as usize).collect();
    let sum: usize = doubled[..n].iter().sum();
    let u = sum as f64 / 2.0 - (n * (n + 1)) as f64 / 2.0;
    Some(MannWhitney {
        u,
        p: sidedness.p(rank_sum_tails(&doubled, n, sum)),
        rank_biserial: 2.0 * u / (n * m) as f64 - 1.0,
    })
}

/// The same by the normal approximation, for samples of any size. All values equal: p = 1.
#[must_use]
pub fn mann_whitney_normal(
    first: &[f64],
    second: &[f64],
    sidedness: Sidedness,
) -> Option<MannWhitney> {
    let values: Vec<f64> = first.iter().chain(second).copied().collect();
    if first.is_empty() || second.is_empty() || values.iter().any(|x| x.is_nan()) {
        return None;
    }
    let (ranks, ties) = average_ranks(&values);
    let (n, m, all) = (first.len() as f64, second.len() as f64, values.len() as f64);
    let u = ranks[..first.len()].iter().sum::<f64>() - n * (n + 1.0) / 2.0;
    let variance = n * m / 12.0 * (all + 1.0 - tie_correction(&ties) / (all * (all - 1.0)));
    let normal = Normal::standard();
    let tail = |above: f64| {
        let score = (above - 0.5) / variance.sqrt();
        // Nothing but ties has no variance: every deal gives the same U.
        if variance > 0.0 { normal.sf(score) } else { 1.0 }
    };
    let above = u - n * m / 2.0;
    Some(MannWhitney {
        u,
        p: sidedness.p((tail(-above), tail(above))),
        rank_biserial: 2.0 * u / (n * m) - 1.0,
    })
}

/// P(S ≤ sum) and P(S ≥ sum), where S adds up `chosen` of the `ranks`, all choices equally likely.
fn rank_sum_tails(ranks: &[usize], chosen: usize, sum: usize) -> (f64, f64) {
    let total: usize = ranks.iter().sum();
    // ways[k][s]: choices of k ranks that add up to s. Up to C(100, 50) ≈ 10²⁹: whole numbers up to 2⁵³ are exact, and
    // beyond that all terms are positive, so the relative error stays that of a sum.
    let mut ways = vec![vec![0.0_f64; total + 1]; chosen + 1];
    ways[0][0] = 1.0;
    for (seen, &rank) in ranks.iter().enumerate() {
        for k in (1..=chosen.min(seen + 1)).rev() {
            let (fewer, more) = ways.split_at_mut(k);
            for (s, count) in more[0].iter_mut().enumerate().skip(rank) {
                *count += fewer[k - 1][s - rank];
            }
        }
    }
    let all: f64 = ways[chosen].iter().sum();
    let lower: f64 = ways[chosen][..=sum].iter().sum();
    let upper: f64 = ways[chosen][sum..].iter().sum();
    (lower / all, upper / all)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn complete_separation_of_five_and_three_is_one_choice_of_fifty_six() {
        let first = [6.0, 7.0, 8.0, 9.0, 10.0];
        let test = mann_whitney(&first, &[1.0, 2.0, 3.0], Sidedness::TwoSided).unwrap();
        assert_eq!((test.u, test.rank_biserial), (15.0, 1.0));
        assert!((test.p - 2.0 / 56.0).abs() < 1e-15);
    }

    #[test]
    fn equal_values_tell_nothing() {
        let test = mann_whitney(&[1.0; 4], &[1.0; 3], Sidedness::TwoSided).unwrap();
        assert_eq!((test.u, test.p, test.rank_biserial), (6.0, 1.0, 0.0));
    }

    #[test]
    fn ties_are_dealt_out_with_their_average_rank() {
        // Ranks 1, 2.5, 2.5, 4; of the six ways to deal two, one sums to 6.5 and none to more.
        let test = mann_whitney(&[2.0, 3.0], &[1.0, 2.0], Sidedness::Greater).unwrap();
        assert!((test.u - 3.5).abs() < 1e-15);
        assert!((test.p - 2.0 / 6.0).abs() < 1e-15);
    }

    #[test]
    fn the_approximation_is_that_of_scipy() {
        // SciPy 1.17.1, mannwhitneyu(x, y, method="asymptotic"), x = 0…11, y as below.
        let first: Vec<f64> = (0..12).map(f64::from).collect();
        let second = [3.5, 4.5, 5.0, 5.0, 5.0, 5.0, 5.0, 8.5, 9.5];
        let p = |sidedness| mann_whitney_normal(&first, &second, sidedness).unwrap().p;
        let test = mann_whitney_normal(&first, &second, Sidedness::TwoSided).unwrap();
        assert!((test.u - SCIPY[0]).abs() < 1e-12, "{}", test.u);
        for (sidedness, want) in
            [Sidedness::TwoSided, Sidedness::Greater, Sidedness::Less].into_iter().zip(&SCIPY[1..])
        {
            assert!((p(sidedness) - want).abs() < 1e-12, "{sidedness}: {}", p(sidedness));
        }
        let equal = mann_whitney_normal(&[1.0; 90], &[1.0; 90], Sidedness::TwoSided).unwrap();
        assert!((equal.p - 1.0).abs() < 1e-15 && equal.rank_biserial.abs() < 1e-15);
    }

    const SCIPY: [f64; 4] =
        [52.5, 0.942_690_629_730_240_9, 0.557_161_729_470_759_1, 0.471_345_314_865_120_43];

    #[test]
    fn what_cannot_be_tested_is_undefined() {
        assert_eq!(mann_whitney(&[], &[1.0], Sidedness::TwoSided), None);
        assert_eq!(mann_whitney(&[f64::NAN], &[1.0], Sidedness::TwoSided), None);
        assert_eq!(mann_whitney(&[0.0; 60], &[1.0; 60], Sidedness::TwoSided), None);
    }
}

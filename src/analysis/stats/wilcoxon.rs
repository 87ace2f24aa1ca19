//! Wilcoxon's signed-rank test of paired differences.
//!
//! Ranks are given to |d|, equal ones sharing their mean; W⁺ and W⁻ are the rank sums of the positive and the negative
//! differences. Two-sided W = min(W⁺, W⁻), one-sided W = W⁺. No unit; p is a probability under "d is symmetric about 0".
//!
//! Zeros are either dropped before ranking (Wilcoxon) or ranked and then left out of both sums (Pratt).
//!
//! 1. No ties, no zeros, at most 50 pairs: the exact distribution, by counting the subsets of each rank sum.
//! 2. Ties or zeros, at most 13 pairs: exact over all sign assignments of the actual average ranks.
//! 3. Else normal, without continuity correction.
//!
//! [`NullDistribution`] takes 1 and 2, or 3, whatever the number of pairs; [`wilcoxon`] chooses as above.
//!
//! Two-sided p = min(1, 2·min(P(S ≤ W⁺), P(S ≥ W⁺))). Effect size: rank-biserial r = (W⁺ − W⁻)/(W⁺ + W⁻).
//!
//! Degenerate: NaN among the differences leaves everything undefined; no non-zero difference, or no difference at all,
//! gives W = 0, p = 1, r = 0.
//!
//! References: Wilcoxon 1945; Pratt 1959; Kerby 2014. Oracle: `tests/analysis_parity.rs`, algorithms `wilcoxon`,
//! `wilcoxon_exact_table`, `rank_biserial` (SciPy's rules of choice and the published tables).

use std::fmt;

use statrs::distribution::{ContinuousCDF, Normal};

use super::Sidedness;
use super::ranks::{average_ranks, tie_correction};

/// Pairs up to which the exact distribution without ties is used.
const EXACT_PAIRS: usize = 50;
/// Pairs up to which all sign assignments are counted when there are ties or zeros.
const PERMUTED_PAIRS: usize = 13;

/// What happens to differences of exactly zero.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Zeros {
    /// They are removed before ranking. The tests of performance and muscle activity.
    Drop,
    /// They are ranked with the rest, then left out of both sums. The tests of smoothness.
    Keep,
}

/// Where the p value is read off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NullDistribution {
    /// By the number of pairs, ties and zeros: the rules at the top of this file.
    Automatic,
    /// Counted, for at most [`MOST_EXACT_PAIRS`] pairs.
    Exact,
    /// The normal approximation.
    Normal,
}

/// Pairs of which the exact distribution is counted at most: its cost grows with their third power.
pub const MOST_EXACT_PAIRS: usize = 500;

/// How a p value came about.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WilcoxonMethod {
    Exact,
    Permutation,
    Normal,
    /// Nothing but zeros.
    Degenerate,
}

impl fmt::Display for WilcoxonMethod {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Exact => "exact",
            Self::Permutation => "permutation",
            Self::Normal => "normal",
            Self::Degenerate => "degenerate",
        })
    }
}

/// Outcome of a signed-rank test.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wilcoxon {
    /// min(W⁺, W⁻) two-sided, W⁺ one-sided.
    pub statistic: f64,
    pub w_plus: f64,
    pub w_minus: f64,
    /// Number of non-zero differences.
    pub nonzero: usize,
    pub p: f64,
    pub rank_biserial: f64,
    pub method: WilcoxonMethod,
}

/// Tests whether `differences` are symmetric about zero; undefined if one of them is NaN.
#[must_use]
pub fn wilcoxon(differences: &[f64], zeros: Zeros, sidedness: Sidedness) -> Option<Wilcoxon> {
    wilcoxon_with(differences, zeros, sidedness, NullDistribution::Automatic)
}

/// The same with a chosen null distribution; undefined too for more pairs than can be counted.
#[must_use]
pub fn wilcoxon_with(
    differences: &[f64],
    zeros: Zeros,
    sidedness: Sidedness,
    distribution: NullDistribution,
) -> Option<Wilcoxon> {
    let too_many = distribution == NullDistribution::Exact && differences.len() > MOST_EXACT_PAIRS;
    if too_many || differences.iter().any(|d| d.is_nan()) {
        return None;
    }
    let ranked: Vec<f64> =
        differences.iter().copied().filter(|d| zeros == Zeros::Keep || *d != 0.0).collect();
    let magnitudes: Vec<f64> = ranked.iter().map(|d| d.abs()).collect();
    let (ranks, mut ties) = average_ranks(&magnitudes);
    let signed = || ranked.iter().zip(&ranks).filter(|(d, _)| **d != 0.0);
    // The sum of nothing would be −0.
    let sum = |positive: bool| -> f64 {
        signed()
            .filter(|(d, _)| (**d > 0.0) == positive)
            .map(|(_, rank)| rank)
            .fold(0.0, |sum, rank| sum + rank)
    };
    let (w_plus, w_minus) = (sum(true), sum(false));
    let nonzero = signed().count();
    if nonzero == 0 {
        return Some(Wilcoxon {
            statistic: 0.0,
            w_plus: 0.0,
            w_minus: 0.0,
            nonzero,
            p: 1.0,
            rank_biserial: 0.0,
            method: WilcoxonMethod::Degenerate,
        });
    }
    let all = differences.len();
    let zero_count = all - nonzero;
    if zeros == Zeros::Keep && zero_count > 1 {
        // The zeros are the smallest group of equal magnitudes; they do not count as a tie.
        ties.remove(0);
    }
    let is_plain = ties.is_empty() && zero_count == 0;
    let counted = |most: usize| match distribution {
        NullDistribution::Automatic => all <= most,
        NullDistribution::Exact => true,
        NullDistribution::Normal => false,
    };
    let (method, tails) = if is_plain && counted(EXACT_PAIRS) {
        let ranks: Vec<usize> = (1..=nonzero).collect();
        (WilcoxonMethod::Exact, subset_tails(&ranks, w_plus as usize))
    } else if counted(PERMUTED_PAIRS) {
        // Average ranks are halves; twice them are whole.
        let doubled: Vec<usize> = signed().map(|(_, rank)| (2.0 * rank) as usize).collect();
        (WilcoxonMethod::Permutation, subset_tails(&doubled, (2.0 * w_plus) as usize))
    } else {
        let ranked_zeros = if zeros == Zeros::Keep { zero_count } else { 0 };
        (WilcoxonMethod::Normal, normal_tails(nonzero + ranked_zeros, ranked_zeros, &ties, w_plus))
    };
    Some(Wilcoxon {
        statistic: if sidedness == Sidedness::TwoSided { w_plus.min(w_minus) } else { w_plus },
        w_plus,
        w_minus,
        nonzero,
        p: sidedness.p(tails),
        // Every non-zero difference has a positive rank.
        rank_biserial: (w_plus - w_minus) / (w_plus + w_minus),
        method,
    })
}

/// Exact two-sided p of the statistic `w` among `pairs` pairs without ties or zeros; undefined beyond 50 pairs or
/// beyond the largest rank sum.
#[must_use]
pub fn wilcoxon_exact_p(pairs: usize, w: usize) -> Option<f64> {
    if pairs > EXACT_PAIRS || w > pairs * (pairs + 1) / 2 {
        return None;
    }
    let ranks: Vec<usize> = (1..=pairs).collect();
    Some(Sidedness::TwoSided.p(subset_tails(&ranks, w)))
}

/// Rank-biserial correlation of `differences`, zeros dropped; 0 without a non-zero one, undefined with NaN.
#[must_use]
pub fn rank_biserial(differences: &[f64]) -> Option<f64> {
    wilcoxon(differences, Zeros::Drop, Sidedness::TwoSided).map(|test| test.rank_biserial)
}

/// P(S ≤ sum) and P(S ≥ sum), where S adds each rank with probability ½.
fn subset_tails(ranks: &[usize], sum: usize) -> (f64, f64) {
    let total: usize = ranks.iter().sum();
    // Probabilities, not counts: 2⁵⁰ subsets of up to 1275 sums stay exact in either form, and these need no division.
    let mut probabilities = vec![0.0; total + 1];
    probabilities[0] = 1.0;
    let mut reached = 0;
    for &rank in ranks {
        reached += rank;
        for s in (0..=reached).rev() {
            let with = if s >= rank { probabilities[s - rank] } else { 0.0 };
            probabilities[s] = f64::midpoint(probabilities[s], with);
        }
    }
    (probabilities[..=sum].iter().sum(), probabilities[sum..].iter().sum())
}

/// The tails by the normal approximation, of `n` ranked differences of which `z` are zero.
fn normal_tails(n: usize, z: usize, ties: &[usize], w_plus: f64) -> (f64, f64) {
    let moment = |n: f64| n * (n + 1.0);
    let (n, z) = (n as f64, z as f64);
    let mean = (moment(n) - moment(z)) / 4.0;
    let variance = (moment(n) * (2.0 * n + 1.0) - moment(z) * (2.0 * z + 1.0)) / 24.0
        - tie_correction(ties) / 48.0;
    let score = (w_plus - mean) / variance.sqrt();
    let normal = Normal::standard();
    (normal.cdf(score), normal.sf(score))
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn five_positive_differences_are_one_sign_assignment_of_thirty_two() {
        let test = wilcoxon(&[1.0, 2.0, 3.0, 4.0, 5.0], Zeros::Drop, Sidedness::Greater).unwrap();
        assert_eq!((test.w_plus, test.p, test.rank_biserial), (15.0, 1.0 / 32.0, 1.0));
    }

    #[test]
    fn nothing_and_zeros_are_degenerate_and_nan_is_undefined() {
        for zeros in [Zeros::Drop, Zeros::Keep] {
            for differences in [&[][..], &[0.0, -0.0, 0.0][..]] {
                let test = wilcoxon(differences, zeros, Sidedness::TwoSided).unwrap();
                assert_eq!((test.statistic, test.p, test.nonzero), (0.0, 1.0, 0));
                assert_eq!(test.method, WilcoxonMethod::Degenerate);
            }
            assert_eq!(wilcoxon(&[1.0, f64::NAN], zeros, Sidedness::TwoSided), None);
        }
    }

    #[test]
    fn all_ties_of_many_pairs_have_a_defined_p() {
        let test = wilcoxon(&[1.0; 30], Zeros::Drop, Sidedness::TwoSided).unwrap();
        assert_eq!(test.method, WilcoxonMethod::Normal);
        assert!(test.p > 0.0 && test.p < 1e-6);
    }

    #[test]
    fn a_chosen_distribution_is_used_and_both_agree_for_many_pairs() {
        let differences: Vec<f64> =
            (1..=60_i32).map(|i| f64::from(if i % 3 == 0 { -i } else { i })).collect();
        let with = |distribution| {
            wilcoxon_with(&differences, Zeros::Drop, Sidedness::TwoSided, distribution).unwrap()
        };
        let (exact, normal) = (with(NullDistribution::Exact), with(NullDistribution::Normal));
        assert_eq!((exact.method, normal.method), (WilcoxonMethod::Exact, WilcoxonMethod::Normal));
        assert_eq!(with(NullDistribution::Automatic).method, WilcoxonMethod::Normal);
        assert!((exact.p - normal.p).abs() < 1e-3, "{} {}", exact.p, normal.p);
        let many = vec![1.0; MOST_EXACT_PAIRS + 1];
        let exact = NullDistribution::Exact;
        assert_eq!(wilcoxon_with(&many, Zeros::Drop, Sidedness::TwoSided, exact), None);
    }

    #[test]
    fn the_exact_table_ends_where_rank_sums_end() {
        assert_eq!(wilcoxon_exact_p(14, 0), Some(2.0 / 16384.0));
        assert_eq!(wilcoxon_exact_p(14, 105), Some(2.0 / 16384.0));
        assert_eq!(wilcoxon_exact_p(14, 106), None);
        assert_eq!(wilcoxon_exact_p(51, 0), None);
    }

    proptest! {
        #[test]
        fn swapping_the_pairs_swaps_the_tails_and_keeps_the_two_sided_p(
            differences in prop::collection::vec(-4..5_i32, 0..20),
            keep in any::<bool>(),
        ) {
            let zeros = if keep { Zeros::Keep } else { Zeros::Drop };
            let there: Vec<f64> = differences.iter().copied().map(f64::from).collect();
            let back: Vec<f64> = there.iter().map(|d| -d).collect();
            let p = |d: &[f64], sidedness| wilcoxon(d, zeros, sidedness).unwrap().p;
            prop_assert!((0.0..=1.0).contains(&p(&there, Sidedness::TwoSided)));
            let close = |a: f64, b: f64| (a - b).abs() < 1e-12;
            prop_assert!(close(p(&there, Sidedness::TwoSided), p(&back, Sidedness::TwoSided)));
            prop_assert!(close(p(&there, Sidedness::Greater), p(&back, Sidedness::Less)));
        }
    }
}

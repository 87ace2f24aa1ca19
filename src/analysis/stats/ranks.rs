//! Average ranks: equal values share the mean of the ranks they cover, ranks start at 1.
//!
//! Equality is exact. Compute differences from unrounded data: a table rounded to one decimal has ties that the data
//! do not have, and ties change p values. Values must not be NaN; callers answer NaN before they rank.

/// Average ranks in the order of `values`, and the sizes of the groups of equal values larger than one.
pub(super) fn average_ranks(values: &[f64]) -> (Vec<f64>, Vec<usize>) {
    let mut order: Vec<usize> = (0..values.len()).collect();
    order.sort_by(|&a, &b| values[a].total_cmp(&values[b]));
    let mut ranks = vec![0.0; values.len()];
    let mut ties = Vec::new();
    let mut start = 0;
    while start < order.len() {
        // Subtraction, not `==`: −0 and 0 are the same value.
        let same = |&&index: &&usize| (values[index] - values[order[start]]).abs() == 0.0;
        let length = order[start..].iter().take_while(same).count().max(1);
        let rank = (2 * start + length + 1) as f64 / 2.0;
        order[start..start + length].iter().for_each(|&index| ranks[index] = rank);
        if length > 1 {
            ties.push(length);
        }
        start += length;
    }
    (ranks, ties)
}

/// Σ(t³ − t) over groups of `ties`, the usual correction of a rank variance.
pub(super) fn tie_correction(ties: &[usize]) -> f64 {
    ties.iter().map(|&t| (t as f64).powi(3) - t as f64).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_values_share_their_mean_rank() {
        let (ranks, ties) = average_ranks(&[3.0, 1.0, 3.0, -2.0, 3.0, 1.0]);
        assert_eq!(ranks, [5.0, 2.5, 5.0, 1.0, 5.0, 2.5]);
        assert_eq!(ties, [2, 3]);
        assert!((tie_correction(&ties) - 30.0).abs() < 1e-12);
        assert_eq!(average_ranks(&[]), (vec![], vec![]));
    }

    #[test]
    fn zeros_of_both_signs_are_equal() {
        assert_eq!(average_ranks(&[0.0, -0.0]), (vec![1.5, 1.5], vec![2]));
    }
}

//! Running mean and variance per token signature and history lag, as training gathers them (`spec/tasks.md` §3.3).
//!
//! A signature is the sorted list of the words that describe a sensor. Sensors with the same signature share one row of
//! statistics, in whatever task they are. Row 0 belongs to padding; every other signature gets the next row when it is
//! first met, worker by worker and sensor by sensor.
//!
//! A row with mean m, variance v and count n takes in a batch of c values with mean m′ and (biased) variance v′, per lag:
//!
//! δ = m′ − m, m ← m + δ c/(n + c), v ← (v n + v′ c + δ² n c/(n + c))/(n + c), n ← n + c.
//!
//! A row starts with mean 0, variance 1 and count 1e-4. Sums are in double precision and in a fixed order; the published
//! code sums squares in single precision, so its variances differ by up to some 1e-5.

use std::collections::BTreeMap;

use super::PolicyError;
use super::checkpoint::contents::SignatureStatistics;
use super::normaliser::{PRIOR_COUNT, check_signature_statistics, signature_of};

/// Added to every variance.
const EPSILON: f64 = 1e-8;
/// Normalised observations lie between plus and minus this.
const CLIP: f64 = 10.0;

/// Statistics that grow.
#[derive(Debug, Clone, PartialEq)]
pub struct RunningStatistics {
    lags: usize,
    rows: BTreeMap<Vec<u16>, usize>,
    /// By row.
    signatures: Vec<Vec<u16>>,
    /// Rows × lags.
    mean: Vec<f64>,
    /// Rows × lags.
    variance: Vec<f64>,
    /// By row.
    count: Vec<f64>,
}

/// What one worker saw: the rows of its sensors, and their windows (sensors × lags, oldest first), unpadded.
#[derive(Debug, Clone, Copy)]
pub struct Seen<'a> {
    /// As [`RunningStatistics::rows_of`] gave them.
    pub rows: &'a [usize],
    /// Raw observations.
    pub windows: &'a [f32],
}

impl RunningStatistics {
    /// Nothing but the row of padding.
    #[must_use]
    pub fn new(lags: usize) -> Self {
        let mut statistics = Self {
            lags,
            rows: BTreeMap::new(),
            signatures: Vec::new(),
            mean: Vec::new(),
            variance: Vec::new(),
            count: Vec::new(),
        };
        statistics.row_of(&[]);
        statistics
    }

    /// The rows of sensors described by `words`; new signatures get new rows.
    pub fn rows_of(&mut self, words: &[Vec<u16>]) -> Vec<usize> {
        words.iter().map(|words| self.row_of(words)).collect()
    }

    fn row_of(&mut self, words: &[u16]) -> usize {
        let signature = signature_of(words);
        if let Some(&row) = self.rows.get(&signature) {
            return row;
        }
        let row = self.signatures.len();
        // The published files name the padding row by the padding word.
        self.signatures.push(if signature.is_empty() { vec![0] } else { signature.clone() });
        self.rows.insert(signature, row);
        self.mean.resize(self.mean.len() + self.lags, 0.0);
        self.variance.resize(self.variance.len() + self.lags, 1.0);
        self.count.push(PRIOR_COUNT);
        row
    }

    /// Takes in what all workers saw in one step, as one batch.
    ///
    /// # Panics
    /// If a worker's windows are not as many as its rows, or a row does not exist.
    pub fn update(&mut self, seen: &[Seen<'_>]) {
        let lags = self.lags;
        let mut count = vec![0.0; self.count.len()];
        let mut mean = vec![0.0; self.mean.len()];
        let mut variance = vec![0.0; self.mean.len()];
        let each = |take: &mut dyn FnMut(usize, &[f32])| {
            for worker in seen {
                assert_eq!(worker.windows.len(), worker.rows.len() * lags, "windows and rows");
                let windows = worker.windows.chunks_exact(lags);
                worker.rows.iter().zip(windows).for_each(|(&row, window)| take(row, window));
            }
        };
        each(&mut |row, window| {
            count[row] += 1.0;
            for (sum, &x) in mean[row * lags..][..lags].iter_mut().zip(window) {
                *sum += f64::from(x);
            }
        });
        for (row, &count) in count.iter().enumerate().filter(|(_, count)| **count > 0.0) {
            mean[row * lags..][..lags].iter_mut().for_each(|sum| *sum /= count);
        }
        // A second pass loses no digits to the difference of two large numbers.
        each(&mut |row, window| {
            for (lag, &x) in window.iter().enumerate() {
                let cell = row * lags + lag;
                variance[cell] += (f64::from(x) - mean[cell]).powi(2);
            }
        });
        for (row, &count) in count.iter().enumerate().filter(|(_, count)| **count > 0.0) {
            let cells = row * lags..(row + 1) * lags;
            variance[cells.clone()].iter_mut().for_each(|sum| *sum /= count);
            self.combine(row, &mean[cells.clone()], &variance[cells], count);
        }
    }

    /// Takes in statistics that were stored with a policy: known signatures as if their values had been one batch, new ones
    /// as they are, behind the others.
    pub fn merge(&mut self, stored: &SignatureStatistics) -> Result<(), PolicyError> {
        check_signature_statistics(stored, self.lags)?;
        for (stored_row, words) in stored.signatures.iter().enumerate() {
            let wide = |numbers: &[f32]| -> Vec<f64> {
                numbers[stored_row * self.lags..][..self.lags].iter().map(|&x| x.into()).collect()
            };
            let (mean, variance) = (wide(&stored.mean), wide(&stored.variance));
            let (known, count) = (self.signatures.len(), stored.count[stored_row]);
            let row = self.row_of(words);
            if row < known {
                self.combine(row, &mean, &variance, count);
            } else {
                self.mean[row * self.lags..].copy_from_slice(&mean);
                self.variance[row * self.lags..].copy_from_slice(&variance);
                self.count[row] = count;
            }
        }
        Ok(())
    }

    /// Takes the statistics that were stored with a policy in the place of its own; other signatures stay as they are.
    pub fn replace(&mut self, stored: &SignatureStatistics) -> Result<(), PolicyError> {
        check_signature_statistics(stored, self.lags)?;
        let lags = self.lags;
        for (stored_row, words) in stored.signatures.iter().enumerate() {
            let cells = self.row_of(words) * lags;
            for lag in 0..lags {
                self.mean[cells + lag] = stored.mean[stored_row * lags + lag].into();
                self.variance[cells + lag] = stored.variance[stored_row * lags + lag].into();
            }
            self.count[cells / lags] = stored.count[stored_row];
        }
        Ok(())
    }

    fn combine(&mut self, row: usize, mean: &[f64], variance: &[f64], count: f64) {
        let before = self.count[row];
        let total = before + count;
        for lag in 0..self.lags {
            let cell = row * self.lags + lag;
            let delta = mean[lag] - self.mean[cell];
            let between = delta * delta * before * count / total;
            self.mean[cell] += delta * count / total;
            self.variance[cell] =
                (self.variance[cell] * before + variance[lag] * count + between) / total;
        }
        self.count[row] = total;
    }

    /// Normalises the windows of sensors whose rows are `rows`, as [`Self::to_stored`] is played.
    pub fn normalise(&self, rows: &[usize], windows: &[f32], normalised: &mut [f32]) {
        let windows = windows.chunks_exact(self.lags).zip(normalised.chunks_exact_mut(self.lags));
        for (&row, (window, targets)) in rows.iter().zip(windows) {
            let cells = row * self.lags..(row + 1) * self.lags;
            let statistics = self.mean[cells.clone()].iter().zip(&self.variance[cells]);
            for ((target, &x), (&mean, &variance)) in targets.iter_mut().zip(window).zip(statistics)
            {
                let deviation = (variance as f32 + EPSILON as f32).sqrt();
                *target = ((x - mean as f32) / deviation).clamp(-CLIP as f32, CLIP as f32);
            }
        }
    }

    /// Means, variances (rows × lags both) and counts.
    #[must_use]
    pub fn numbers(&self) -> [&[f64]; 3] {
        [&self.mean, &self.variance, &self.count]
    }

    /// Goes on from what [`Self::numbers`] gave, for the same signatures.
    pub fn restore(&mut self, [mean, variance, count]: [Vec<f64>; 3]) -> Result<(), PolicyError> {
        let found = [mean.len(), variance.len(), count.len()];
        let expected = [self.mean.len(), self.variance.len(), self.count.len()];
        if let Some((&expected, &found)) = expected.iter().zip(&found).find(|(a, b)| a != b) {
            return Err(PolicyError::NormaliserLength { expected, found });
        }
        let usable = mean.iter().all(|m| m.is_finite())
            && variance.iter().chain(&count).all(|x| x.is_finite() && *x >= 0.0);
        if !usable {
            return Err(PolicyError::NormaliserValues);
        }
        (self.mean, self.variance, self.count) = (mean, variance, count);
        Ok(())
    }

    /// The statistics as a policy stores and plays them, with the published limits of 1e-8 and ±10.
    #[must_use]
    pub fn to_stored(&self) -> SignatureStatistics {
        let single = |numbers: &[f64]| numbers.iter().map(|&x| x as f32).collect();
        SignatureStatistics {
            signatures: self.signatures.clone(),
            mean: single(&self.mean),
            variance: single(&self.variance),
            count: self.count.clone(),
            lags: self.lags,
            epsilon: EPSILON,
            clip: CLIP,
            enabled: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn rows_are_given_in_the_order_signatures_are_met_and_word_order_does_not_matter() {
        let mut statistics = RunningStatistics::new(2);
        assert_eq!(statistics.rows_of(&[vec![5, 3], vec![4], vec![3, 5, 0]]), [1, 2, 1]);
        assert_eq!(statistics.rows_of(&[vec![9], vec![4], vec![0, 0]]), [3, 2, 0]);
        let stored = statistics.to_stored();
        assert_eq!(stored.signatures, [vec![0], vec![3, 5], vec![4], vec![9]]);
        assert_eq!(stored.count, [PRIOR_COUNT; 4]);
    }

    #[test]
    fn two_workers_share_a_row_and_untouched_rows_stay() {
        let mut statistics = RunningStatistics::new(1);
        let first = statistics.rows_of(&[vec![1], vec![2]]);
        let second = statistics.rows_of(&[vec![2]]);
        statistics.rows_of(&[vec![3]]);
        statistics.update(&[
            Seen { rows: &first, windows: &[4.0, 1.0] },
            Seen { rows: &second, windows: &[3.0] },
        ]);
        let stored = statistics.to_stored();
        assert_eq!(stored.count, [1e-4, 1.0001, 2.0001, 1e-4]);
        // By hand: 1 and 3 have mean 2 and variance 1; the prior weighs 1e-4 with mean 0 and variance 1.
        let mean = 2.0 * 2.0 / 2.0001;
        let variance = (1e-4 + 2.0 + 4.0 * 1e-4 * 2.0 / 2.0001) / 2.0001;
        assert!((f64::from(stored.mean[2]) - mean).abs() < 1e-7, "{}", stored.mean[2]);
        assert!((f64::from(stored.variance[2]) - variance).abs() < 1e-7, "{}", stored.variance[2]);
        assert_eq!(
            (stored.mean[3].to_bits(), stored.variance[3].to_bits()),
            (0, 1.0_f32.to_bits())
        );
    }

    #[test]
    fn merged_statistics_keep_unknown_signatures_as_they_are() {
        let mut stored = RunningStatistics::new(1);
        let rows = stored.rows_of(&[vec![7], vec![8]]);
        stored.update(&[Seen { rows: &rows, windows: &[2.0, 6.0] }]);
        let stored = stored.to_stored();
        let mut statistics = RunningStatistics::new(1);
        statistics.rows_of(&[vec![8]]);
        statistics.merge(&stored).unwrap();
        let merged = statistics.to_stored();
        assert_eq!(merged.signatures, [vec![0], vec![8], vec![7]]);
        assert_eq!(merged.mean[2].to_bits(), stored.mean[1].to_bits());
        assert_eq!(merged.count[1..], [1.0001 + 1e-4, 1.0001]);
        assert!(statistics.merge(&SignatureStatistics { lags: 6, ..stored }).is_err());
    }

    proptest! {
        /// However the values come in batches, in the end they have the mean and the variance of all of them, the prior
        /// included.
        #[test]
        fn batches_do_not_matter(
            values in prop::collection::vec(-1e3_f32..1e3, 2..40),
            cut in any::<prop::sample::Index>(),
        ) {
            let feed = |batches: &[&[f32]]| {
                let mut statistics = RunningStatistics::new(1);
                let row = statistics.rows_of(&[vec![1]])[0];
                for batch in batches.iter().filter(|batch| !batch.is_empty()) {
                    let rows = vec![row; batch.len()];
                    statistics.update(&[Seen { rows: &rows, windows: batch }]);
                }
                (statistics.mean[row], statistics.variance[row], statistics.count[row])
            };
            let (early, late) = values.split_at(cut.index(values.len()));
            let (mean, variance, count) = feed(&[early, late]);
            let (once_mean, once_variance, once_count) = feed(&[&values]);
            let n = values.len() as f64 + 1e-4;
            let sum: f64 = values.iter().map(|&x| f64::from(x)).sum();
            let spread: f64 = values.iter().map(|&x| (f64::from(x) - sum / n).powi(2)).sum();
            let expected = (spread + 1e-4 * (1.0 + (sum / n).powi(2))) / n;
            for (got, want) in [
                (mean, sum / n),
                (mean, once_mean),
                (variance, expected),
                (variance, once_variance),
                (count, n),
                (count, once_count),
            ] {
                prop_assert!((got - want).abs() <= 1e-9 * want.abs().max(1.0), "{got} {want}");
            }
        }
    }
}

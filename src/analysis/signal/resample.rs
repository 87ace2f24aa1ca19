//! Linear resampling: the same stretch of time with another number of points.
//!
//! Point k of n lies at sample `k (m − 1)/(n − 1)` of m, so that both ends stay where they are; between two samples it
//! is interpolated. In the unit of the signal.
//!
//! Degenerate: one sample is repeated; one point is the first sample; no sample has no points (`None`).
//!
//! Oracle: `tests/signals_parity.rs`, algorithm `resample_linear` (NumPy).

use super::Rows;

/// `points` points of `signal`.
#[must_use]
pub fn resample(signal: &[f64], points: usize) -> Option<Vec<f64>> {
    let last = signal.len().checked_sub(1)?;
    let at = |k| {
        let (index, fraction) = place(k, points, last);
        between(signal[index], signal[(index + 1).min(last)], fraction)
    };
    Some((0..points).map(at).collect())
}

/// The same for every channel of a table; row by row, `points` × channels.
#[must_use]
pub fn resample_rows(rows: &Rows<'_>, points: usize) -> Option<Vec<f64>> {
    let last = rows.len().checked_sub(1)?;
    let mut resampled = Vec::with_capacity(points * rows.columns());
    for k in 0..points {
        let (index, fraction) = place(k, points, last);
        let (low, high) = (rows.row(index), rows.row((index + 1).min(last)));
        resampled.extend(low.iter().zip(high).map(|(&low, &high)| between(low, high, fraction)));
    }
    Some(resampled)
}

/// Sample at or before point `k` of `points`, and how far the point lies beyond it.
fn place(k: usize, points: usize, last: usize) -> (usize, f64) {
    if points < 2 {
        return (0, 0.0);
    }
    let (product, intervals) = (k * last, points - 1);
    (product / intervals, (product % intervals) as f64 / intervals as f64)
}

fn between(low: f64, high: f64, fraction: f64) -> f64 {
    low + (high - low) * fraction
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "these points are exact in binary")]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn two_samples_make_a_line() {
        assert_eq!(resample(&[0.0, 1.0], 5).unwrap(), [0.0, 0.25, 0.5, 0.75, 1.0]);
    }

    #[test]
    fn degenerate_signals() {
        assert_eq!(resample(&[], 5), None);
        assert_eq!(resample(&[2.0], 3).unwrap(), [2.0; 3]);
        assert_eq!(resample(&[2.0, 4.0], 1).unwrap(), [2.0]);
        assert_eq!(resample(&[2.0, 4.0], 0).unwrap(), [0.0; 0]);
    }

    proptest! {
        #[test]
        fn ends_stay_values_stay_in_range_and_as_many_points_change_nothing(
            signal in prop::collection::vec(-10.0..10.0_f64, 1..60),
            points in 2..120_usize,
        ) {
            let resampled = resample(&signal, points).unwrap();
            prop_assert_eq!(resampled[0], signal[0]);
            prop_assert_eq!(resampled.last(), signal.last());
            let low = signal.iter().copied().fold(f64::INFINITY, f64::min);
            let high = signal.iter().copied().fold(f64::NEG_INFINITY, f64::max);
            prop_assert!(resampled.iter().all(|x| (low - 1e-12..=high + 1e-12).contains(x)));
            prop_assert_eq!(&resample(&signal, signal.len()).unwrap(), &signal);
            let table: Vec<f64> = signal.iter().flat_map(|&x| [x, -x]).collect();
            let both = resample_rows(&Rows::new(&table, 2).unwrap(), points).unwrap();
            prop_assert!(both.chunks_exact(2).zip(&resampled).all(|(row, &x)| row == [x, -x]));
        }
    }
}

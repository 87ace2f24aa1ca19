//! Covariance of muscle commands, one time step at a time.
//!
//! Rows are time steps, columns are muscles. `Σ = Σₜ (aₜ − μ)(aₜ − μ)ᵀ / (n − 1)`, in squared units of the values.
//! Mean and moment are updated with every row (Welford 1962), so nothing but an M × M matrix is kept, and two
//! accumulators merge exactly as if their rows had been stacked, up to rounding (Chan et al. 1979).
//!
//! Rounding depends on the order: the same rows, pushed and merged in the same order, give the same bytes. Sweeps
//! therefore fill one accumulator per episode and merge them in episode order, whatever thread played which.
//!
//! Degenerate: a row of another length or with a value that is not finite is refused and changes nothing; fewer than
//! two rows have no covariance.

use super::SubspaceError;

/// Running mean and covariance of rows.
#[derive(Debug, Clone, PartialEq)]
pub struct Covariance {
    rows: u64,
    mean: Vec<f64>,
    /// Lower triangle, row by row, of Σ (a − μ)(a − μ)ᵀ.
    moment: Vec<f64>,
    /// Deviation of the newest row from the mean before it; scratch memory.
    deviation: Vec<f64>,
}

impl Covariance {
    /// An empty accumulator for rows of `muscle_count` values.
    #[must_use]
    pub fn new(muscle_count: usize) -> Self {
        Self {
            rows: 0,
            mean: vec![0.0; muscle_count],
            moment: vec![0.0; muscle_count * (muscle_count + 1) / 2],
            deviation: vec![0.0; muscle_count],
        }
    }

    /// Number of rows seen.
    #[must_use]
    pub fn rows(&self) -> u64 {
        self.rows
    }

    /// Number of columns.
    #[must_use]
    pub fn muscle_count(&self) -> usize {
        self.mean.len()
    }

    /// Mean of each muscle over the rows; zeros before the first.
    #[must_use]
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    /// Adds one time step. Does not allocate.
    pub fn push_row<T: Copy + Into<f64>>(&mut self, row: &[T]) -> Result<(), SubspaceError> {
        self.check_muscle_count(row.len())?;
        if let Some(muscle) = row.iter().position(|&x| !x.into().is_finite()) {
            return Err(SubspaceError::NotFinite {
                row: self.rows,
                muscle,
                value: row[muscle].into(),
            });
        }
        let count = (self.rows + 1) as f64;
        for ((mean, deviation), &value) in self.mean.iter_mut().zip(&mut self.deviation).zip(row) {
            *deviation = value.into() - *mean;
            *mean += *deviation / count;
        }
        self.rows += 1;
        self.add_outer_product((count - 1.0) / count);
        Ok(())
    }

    /// Adds all rows of a row-major matrix, one time step per row.
    pub fn push_rows<T: Copy + Into<f64>>(&mut self, rows: &[T]) -> Result<(), SubspaceError> {
        let muscle_count = self.muscle_count();
        if muscle_count == 0 || !rows.len().is_multiple_of(muscle_count) {
            let found = if muscle_count == 0 { rows.len() } else { rows.len() % muscle_count };
            return Err(SubspaceError::MuscleCount { expected: muscle_count, found });
        }
        rows.chunks_exact(muscle_count).try_for_each(|row| self.push_row(row))
    }

    /// Adds all rows another accumulator has seen, after those of this one.
    pub fn merge(&mut self, other: &Self) -> Result<(), SubspaceError> {
        self.check_muscle_count(other.muscle_count())?;
        if other.rows == 0 {
            return Ok(());
        }
        let (mine, theirs) = (self.rows as f64, other.rows as f64);
        let total = mine + theirs;
        for ((mean, deviation), other_mean) in
            self.mean.iter_mut().zip(&mut self.deviation).zip(&other.mean)
        {
            *deviation = other_mean - *mean;
            *mean += *deviation * (theirs / total);
        }
        for (moment, other_moment) in self.moment.iter_mut().zip(&other.moment) {
            *moment += other_moment;
        }
        self.rows += other.rows;
        self.add_outer_product(mine * theirs / total);
        Ok(())
    }

    /// Covariance between two muscles (divisor n − 1); undefined for fewer than two rows.
    #[must_use]
    pub fn between(&self, muscle: usize, other: usize) -> Option<f64> {
        let (low, high) = (muscle.min(other), muscle.max(other));
        let divisor = self.divisor()?;
        Some(self.moment.get(triangle(high) + low)? / divisor)
    }

    /// Total variance: the sum of all muscles' variances; undefined for fewer than two rows.
    #[must_use]
    pub fn trace(&self) -> Option<f64> {
        let divisor = self.divisor()?;
        let sum: f64 = (0..self.muscle_count()).map(|i| self.moment[triangle(i) + i]).sum();
        Some(sum / divisor)
    }

    /// Variance along `direction`, i.e. `dᵀ Σ d`; undefined for fewer than two rows.
    pub(super) fn along(&self, direction: &[f64]) -> Option<f64> {
        let divisor = self.divisor()?;
        let mut sum = 0.0;
        for (row, &weight) in direction.iter().enumerate() {
            let start = triangle(row);
            let off_diagonal = dot(&self.moment[start..start + row], &direction[..row]);
            sum += weight * (2.0 * off_diagonal + weight * self.moment[start + row]);
        }
        Some(sum / divisor)
    }

    fn divisor(&self) -> Option<f64> {
        (self.rows >= 2).then(|| (self.rows - 1) as f64)
    }

    /// Adds `factor · d dᵀ` to the moment, where d is the deviation.
    fn add_outer_product(&mut self, factor: f64) {
        for (row, &deviation) in self.deviation.iter().enumerate() {
            let start = triangle(row);
            let scaled = factor * deviation;
            for (moment, &other) in self.moment[start..=start + row].iter_mut().zip(&self.deviation)
            {
                *moment += scaled * other;
            }
        }
    }

    fn check_muscle_count(&self, found: usize) -> Result<(), SubspaceError> {
        let expected = self.muscle_count();
        if found == expected { Ok(()) } else { Err(SubspaceError::MuscleCount { expected, found }) }
    }
}

/// Sum of products, in four partial sums side by side: one alone would wait for each addition.
fn dot(a: &[f64], b: &[f64]) -> f64 {
    const LANES: usize = 4;
    let ((a, a_rest), (b, b_rest)) = (a.as_chunks::<LANES>(), b.as_chunks::<LANES>());
    let mut lanes = [0.0; LANES];
    for (a, b) in a.iter().zip(b) {
        lanes.iter_mut().zip(a).zip(b).for_each(|((lane, a), b)| *lane += a * b);
    }
    let rest: f64 = a_rest.iter().zip(b_rest).map(|(a, b)| a * b).sum();
    (lanes[0] + lanes[1]) + (lanes[2] + lanes[3]) + rest
}

/// Where row `row` of a lower triangle starts.
fn triangle(row: usize) -> usize {
    row * (row + 1) / 2
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn of(rows: &[[f64; 3]]) -> Covariance {
        let mut covariance = Covariance::new(3);
        rows.iter().for_each(|row| covariance.push_row(row).unwrap());
        covariance
    }

    #[test]
    fn covariance_of_three_rows_by_hand() {
        let covariance = of(&[[1.0, 2.0, 0.0], [3.0, 2.0, 1.0], [5.0, 2.0, -1.0]]);
        assert_eq!(covariance.mean(), [3.0, 2.0, 0.0]);
        assert_eq!(covariance.between(0, 0), Some(4.0));
        assert_eq!(covariance.between(0, 2), Some(-1.0));
        assert_eq!(covariance.between(1, 2), Some(0.0));
        assert_eq!(covariance.trace(), Some(5.0));
    }

    #[test]
    fn a_bad_row_is_refused_and_changes_nothing() {
        let mut covariance = of(&[[1.0, 2.0, 3.0]]);
        let before = covariance.clone();
        assert!(matches!(
            covariance.push_row(&[0.0, f64::NAN, 0.0]),
            Err(SubspaceError::NotFinite { row: 1, muscle: 1, .. })
        ));
        assert_eq!(
            covariance.push_row(&[0.0_f32]),
            Err(SubspaceError::MuscleCount { expected: 3, found: 1 })
        );
        assert_eq!(
            covariance.push_rows(&[0.0; 4]),
            Err(SubspaceError::MuscleCount { expected: 3, found: 1 })
        );
        assert_eq!(covariance, before);
        assert_eq!(covariance.trace(), None);
    }

    #[test]
    fn merging_nothing_changes_no_byte() {
        let mut covariance = of(&[[0.1, 0.2, 0.3], [0.7, 0.5, 0.3]]);
        let before = covariance.clone();
        covariance.merge(&Covariance::new(3)).unwrap();
        assert_eq!(covariance, before);
    }

    proptest! {
        #[test]
        fn merging_equals_stacking(
            rows in prop::collection::vec(prop::array::uniform3(-2.0..2.0_f64), 2..40),
            cut in 0.0..1.0_f64,
        ) {
            let (first, second) = rows.split_at((cut * rows.len() as f64) as usize);
            let mut merged = of(first);
            merged.merge(&of(second)).unwrap();
            let stacked = of(&rows);
            prop_assert_eq!(merged.rows(), stacked.rows());
            for i in 0..3 {
                prop_assert!((merged.mean()[i] - stacked.mean()[i]).abs() < 1e-12);
                for j in 0..3 {
                    let difference = merged.between(i, j).unwrap() - stacked.between(i, j).unwrap();
                    prop_assert!(difference.abs() < 1e-12);
                }
            }
        }
    }
}

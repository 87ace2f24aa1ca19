//! Non-negative data laid out for factorisation, and what every rank needs of it.
//!
//! Rows are cut into blocks of [`BLOCK`] time steps; inside a block the values of one muscle lie next to each other, so
//! that one instruction handles several time steps. A block's columns start a few values further apart than they are
//! long: otherwise they would all fall into the same few cache lines. The last block is filled up with zeros, which
//! stay zero in every factor and add nothing to any sum.
//!
//! The singular values and right singular vectors come from the M × M Gram matrix `XᵀX`, once for all ranks. Its
//! rounding hides singular values below 10⁻⁷ of the largest; those are taken as zero.

use faer::{Mat, MatRef};

use super::super::SubspaceError;
use super::super::eigen::falling_eigenpairs;
use super::dot_products::DotProducts;

/// Time steps per block; a multiple of what the sweep handles at once.
pub(super) const BLOCK: usize = 256;
/// Values between the ends of two columns of a block.
const GAP: usize = 8;
/// Singular values below this share of the largest cannot be told from zero.
const SMALLEST_SHARE: f64 = 1e-7;

/// Non-negative rows, ready for factorisation at any rank.
#[derive(Debug, Clone)]
pub struct NonNegativeRows {
    rows: usize,
    muscles: usize,
    blocks: Vec<Mat<f64>>,
    mean: f64,
    /// Falling.
    singular_values: Vec<f64>,
    /// Muscles × muscles, one right singular vector per column.
    right_vectors: Mat<f64>,
}

impl NonNegativeRows {
    /// Takes a row-major matrix with one time step per row and `muscles` columns.
    pub fn new<T: Copy + Into<f64>>(values: &[T], muscles: usize) -> Result<Self, SubspaceError> {
        if muscles == 0 || !values.len().is_multiple_of(muscles) {
            let found = if muscles == 0 { values.len() } else { values.len() % muscles };
            return Err(SubspaceError::MuscleCount { expected: muscles, found });
        }
        let rows = values.len() / muscles;
        if rows == 0 {
            return Err(SubspaceError::TooFewRows { found: 0 });
        }
        let mut sum = 0.0;
        let mut blocks = Vec::with_capacity(rows.div_ceil(BLOCK));
        for (index, chunk) in values.chunks(BLOCK * muscles).enumerate() {
            let mut block = new_block(muscles);
            for (lane, row) in chunk.chunks_exact(muscles).enumerate() {
                for (muscle, &value) in row.iter().enumerate() {
                    let value = value.into();
                    let row = (index * BLOCK + lane) as u64;
                    if !value.is_finite() {
                        return Err(SubspaceError::NotFinite { row, muscle, value });
                    }
                    if value < 0.0 {
                        return Err(SubspaceError::Negative { row, muscle, value });
                    }
                    sum += value;
                    block[(lane, muscle)] = value;
                }
            }
            blocks.push(block);
        }
        if sum <= 0.0 {
            return Err(SubspaceError::AllZero { rows: rows as u64 });
        }
        let (singular_values, right_vectors) = right_singular_vectors(&blocks, muscles)?;
        let mean = sum / values.len() as f64;
        Ok(Self { rows, muscles, blocks, mean, singular_values, right_vectors })
    }

    /// Number of time steps.
    #[must_use]
    pub fn row_count(&self) -> usize {
        self.rows
    }

    /// Number of muscles.
    #[must_use]
    pub fn muscle_count(&self) -> usize {
        self.muscles
    }

    /// The highest rank that can be asked for.
    #[must_use]
    pub fn highest_rank(&self) -> usize {
        self.rows.min(self.muscles)
    }

    /// Mean of all values.
    pub(super) fn mean(&self) -> f64 {
        self.mean
    }

    /// The values in blocks of time steps × muscles.
    pub(super) fn blocks(&self) -> &[Mat<f64>] {
        &self.blocks
    }

    /// Singular values, falling.
    pub(super) fn singular_values(&self) -> &[f64] {
        &self.singular_values
    }

    /// Right singular vectors, one per column.
    pub(super) fn right_vectors(&self) -> MatRef<'_, f64> {
        self.right_vectors.as_ref()
    }

    /// An error unless there can be a factorisation of `rank`.
    pub(super) fn check_rank(&self, rank: usize) -> Result<(), SubspaceError> {
        let available = self.highest_rank();
        if rank == 0 || rank > available {
            return Err(SubspaceError::ComponentCount { asked: rank, available });
        }
        Ok(())
    }

    /// A factor with one block per block of the data, all zero.
    pub(super) fn new_factor(&self, rank: usize) -> Vec<Mat<f64>> {
        self.blocks.iter().map(|_| new_block(rank)).collect()
    }

    /// The values of a factor as a row-major matrix with one time step per row.
    pub(super) fn row_major(&self, factor: &[Mat<f64>]) -> Vec<f64> {
        let rank = factor.first().map_or(0, Mat::ncols);
        let mut values = Vec::with_capacity(self.rows * rank);
        for (index, block) in factor.iter().enumerate() {
            for lane in 0..BLOCK.min(self.rows - index * BLOCK) {
                values.extend((0..rank).map(|column| block[(lane, column)]));
            }
        }
        values
    }
}

/// An all-zero block with `columns` columns.
pub(super) fn new_block(columns: usize) -> Mat<f64> {
    Mat::zeros(BLOCK + GAP, columns)
}

/// Singular values (falling) and right singular vectors of the blocks on top of each other.
fn right_singular_vectors(
    blocks: &[Mat<f64>],
    muscles: usize,
) -> Result<(Vec<f64>, Mat<f64>), SubspaceError> {
    let mut sums = DotProducts::new(muscles, muscles);
    blocks.iter().for_each(|block| sums.add(block, block, BLOCK));
    let mut gram = Mat::<f64>::zeros(muscles, muscles);
    sums.fold_into(&mut gram);
    if !gram.col_iter().all(|column| column.iter().all(|x| x.is_finite())) {
        return Err(SubspaceError::Overflow);
    }
    let (squares, vectors) = falling_eigenpairs(gram.as_ref())?;
    let mut values: Vec<f64> = squares.into_iter().map(f64::sqrt).collect();
    let smallest = SMALLEST_SHARE * values[0];
    values.iter_mut().filter(|value| **value < smallest).for_each(|value| *value = 0.0);
    Ok((values, vectors))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bad_values_are_refused_with_their_place() {
        let new = |values: &[f64]| NonNegativeRows::new(values, 2).unwrap_err();
        assert_eq!(new(&[]), SubspaceError::TooFewRows { found: 0 });
        assert_eq!(new(&[1.0; 3]), SubspaceError::MuscleCount { expected: 2, found: 1 });
        assert_eq!(new(&[0.0; 8]), SubspaceError::AllZero { rows: 4 });
        assert_eq!(new(&[1e200; 4]), SubspaceError::Overflow);
        let place = SubspaceError::Negative { row: 1, muscle: 0, value: -0.1 };
        assert_eq!(new(&[1.0, 1.0, -0.1, 1.0]), place);
        assert!(matches!(
            new(&[1.0, 1.0, 0.1, f64::NAN]),
            SubspaceError::NotFinite { row: 1, muscle: 1, .. }
        ));
        assert!(NonNegativeRows::new(&[1.0_f32], 0).is_err());
    }

    #[test]
    fn singular_values_of_a_diagonal_matrix_are_its_entries_in_falling_order() {
        let rows = NonNegativeRows::new(&[1.0, 0.0, 0.0, 0.0, 3.0, 0.0, 0.0, 0.0, 2.0], 3).unwrap();
        for (found, want) in rows.singular_values().iter().zip([3.0, 2.0, 1.0]) {
            assert!((found - want).abs() < 1e-14);
        }
    }

    #[test]
    fn a_factor_longer_than_one_block_reads_back_row_by_row() {
        let values: Vec<f64> = (0..2 * (BLOCK + 3)).map(|i| i as f64).collect();
        let rows = NonNegativeRows::new(&values, 2).unwrap();
        assert_eq!(rows.row_major(&rows.blocks), values);
    }
}

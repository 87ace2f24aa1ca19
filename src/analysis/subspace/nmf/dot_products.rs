//! Sums over time of products of columns, `[X W]ᵀ W` for instance, gathered block by block.
//!
//! Sixteen sums of four columns with four others are held in registers, each as a whole vector of partial sums; between
//! blocks the vectors wait in memory and are folded once at the end. So no block pays for preparations or for sums across
//! a vector.

#![expect(clippy::inline_always, reason = "only what is inlined is compiled for wide vectors")]

use faer::Mat;
use faer::traits::pulp::{self, Simd, WithSimd};

/// Columns on either side of a tile.
const TILE: usize = 4;
/// Numbers of the widest vector.
const WIDEST: usize = 8;

/// Products of some columns on the left with some on the right, summed so far.
#[derive(Debug, Clone)]
pub(super) struct DotProducts {
    left: usize,
    right: usize,
    /// Tile after tile, left ones running fastest; the sixteen sums of each, the widest vector for each.
    partial: Vec<f64>,
}

impl DotProducts {
    pub(super) fn new(left: usize, right: usize) -> Self {
        let tiles = left.div_ceil(TILE) * right.div_ceil(TILE);
        Self { left, right, partial: vec![0.0; tiles * TILE * TILE * WIDEST] }
    }

    pub(super) fn clear(&mut self) {
        self.partial.fill(0.0);
    }

    /// Adds the products of all columns of `left` with all columns of `right`, over their first `rows` rows.
    pub(super) fn add(&mut self, left: &Mat<f64>, right: &Mat<f64>, rows: usize) {
        debug_assert!(rows.is_multiple_of(WIDEST), "rows come in whole vectors");
        debug_assert_eq!((left.ncols(), right.ncols()), (self.left, self.right));
        pulp::Arch::new().dispatch(Add { left, right, rows, partial: &mut self.partial });
    }

    /// Writes the sums into the first rows of `into`, one row per column on the left.
    pub(super) fn fold_into(&self, into: &mut Mat<f64>) {
        let mut tiles = self.partial.chunks_exact(TILE * TILE * WIDEST);
        for first_right in (0..self.right).step_by(TILE) {
            for (first_left, tile) in (0..self.left).step_by(TILE).zip(&mut tiles) {
                for (index, lanes) in tile.as_chunks::<WIDEST>().0.iter().enumerate() {
                    let (left, right) = (first_left + index / TILE, first_right + index % TILE);
                    if left < self.left && right < self.right {
                        let [a, b, c, d, e, f, g, h] = *lanes;
                        into[(left, right)] = ((a + b) + (c + d)) + ((e + f) + (g + h));
                    }
                }
            }
        }
    }
}

struct Add<'a> {
    left: &'a Mat<f64>,
    right: &'a Mat<f64>,
    rows: usize,
    partial: &'a mut [f64],
}

impl WithSimd for Add<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { left, right, rows, partial } = self;
        let mut tiles = partial.chunks_exact_mut(TILE * TILE * WIDEST);
        for first_right in (0..right.ncols()).step_by(TILE) {
            let right = columns::<S>(right, first_right, rows);
            for (first_left, tile) in (0..left.ncols()).step_by(TILE).zip(&mut tiles) {
                add_tile(simd, columns::<S>(left, first_left, rows), right, tile);
            }
        }
    }
}

/// Four columns from `first` on as vectors; beyond the last one, that one again: its sums are not read.
#[inline(always)]
fn columns<S: Simd>(matrix: &Mat<f64>, first: usize, rows: usize) -> [&[S::f64s]; TILE] {
    std::array::from_fn(|index| {
        let column = (first + index).min(matrix.ncols() - 1);
        S::as_simd_f64s(&matrix.col_as_slice(column)[..rows]).0
    })
}

#[inline(always)]
fn add_tile<S: Simd>(
    simd: S,
    left: [&[S::f64s]; TILE],
    right: [&[S::f64s]; TILE],
    tile: &mut [f64],
) {
    let count = left[0].len();
    let (left, right) = (left.map(|column| &column[..count]), right.map(|column| &column[..count]));
    let mut sums = [[simd.splat_f64s(0.0); TILE]; TILE];
    for index in 0..count {
        let right = right.map(|column| column[index]);
        for (sums, left) in sums.iter_mut().zip(left) {
            for (sum, right) in sums.iter_mut().zip(right) {
                *sum = simd.mul_add_e_f64s(left[index], right, *sum);
            }
        }
    }
    for (lanes, sum) in tile.chunks_exact_mut(WIDEST).zip(sums.into_iter().flatten()) {
        if let Some(lanes) = S::as_mut_simd_f64s(lanes).0.first_mut() {
            *lanes = simd.add_f64s(*lanes, sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_add_up_to_the_product_of_the_whole() {
        let left = Mat::from_fn(32, 7, |i, j| ((i * 5 + j * 3) % 11) as f64 - 4.0);
        let right = Mat::from_fn(32, 6, |i, j| ((i * 2 + j * 7) % 13) as f64);
        let mut sums = DotProducts::new(7, 6);
        sums.add(&left, &right, 32);
        sums.clear();
        sums.add(&left, &right, 32);
        sums.add(&left, &right, 8);
        let mut found = Mat::zeros(9, 6);
        sums.fold_into(&mut found);
        let part = |matrix: &Mat<f64>| matrix.subrows(0, 8).to_owned();
        let want = left.transpose() * &right + part(&left).transpose() * part(&right);
        assert_eq!(found.subrows(0, 7), want);
        assert!(found.subrows(7, 2).col_iter().all(|c| c.iter().all(|&x| x == 0.0)));
    }
}

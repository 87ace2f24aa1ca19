//! The matrix product that everything else is made of: `C = A B`, one tile of C at a time in registers.
//!
//! Rows of A are walked along, number by number; rows of B and C are vectors. An element of C is a chain of fused
//! multiplications and additions over the depth in order, so it does not depend on the tile it falls into. Nothing is packed:
//! the matrices of one sample lie in the cache already, and for thin ones packing costs more than the product.

#![expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
#![expect(clippy::needless_range_loop, reason = "indices name rows and vectors of a tile")]

use std::array;

use pulp::{Arch, Simd, WithSimd};

/// What a sum begins with.
#[derive(Debug, Clone, Copy)]
pub enum Start<'a> {
    Zero,
    /// One number for each row of C.
    Bias(&'a [f32]),
    /// What is there.
    Keep,
    /// Both.
    KeepAndBias(&'a [f32]),
}

/// One product: `rows` × `depth` times `depth` × `columns`.
#[derive(Debug)]
pub struct Product<'a> {
    pub rows: usize,
    pub depth: usize,
    pub columns: usize,
    /// Rows begin every `a_stride` numbers.
    pub a: &'a [f32],
    pub a_stride: usize,
    /// Rows begin every `b_stride` numbers, a whole number of [`super::LANES`] no smaller than `columns`.
    pub b: &'a [f32],
    pub b_stride: usize,
    pub start: Start<'a>,
    /// Whether negative results become zero; a NaN stays a NaN.
    pub rectify: bool,
    pub c: &'a mut [f32],
    pub c_stride: usize,
}

impl Product<'_> {
    /// Computes it, with the widest vector instructions that this machine has.
    ///
    /// # Panics
    ///
    /// If a matrix is shorter than its sizes say.
    pub fn compute(self) {
        assert!(self.b.len() >= self.depth * self.b_stride, "B has fewer rows than A has columns");
        Arch::new().dispatch(self);
    }

    /// Panels of `V` vectors, then of one, then what is left of a vector.
    #[inline(always)]
    fn walk<S: Simd, const R: usize, const V: usize>(mut self, simd: S) {
        let lanes = S::F32_LANES;
        let mut column = 0;
        while column + V * lanes <= self.columns {
            self.panel::<S, R, V, true>(simd, column);
            column += V * lanes;
        }
        while column + lanes <= self.columns {
            self.panel::<S, R, 1, true>(simd, column);
            column += lanes;
        }
        if column < self.columns {
            self.panel::<S, R, 1, false>(simd, column);
        }
    }

    /// All rows of one panel: `R` at a time, then four, then two, then one. The last vector of C is `WHOLE`, or ends where C
    /// does.
    #[inline(always)]
    fn panel<S: Simd, const R: usize, const V: usize, const WHOLE: bool>(
        &mut self,
        simd: S,
        column: usize,
    ) {
        let mut row = 0;
        while row + R <= self.rows {
            self.tile::<S, R, V, WHOLE>(simd, row, column);
            row += R;
        }
        while row + 4 <= self.rows {
            self.tile::<S, 4, V, WHOLE>(simd, row, column);
            row += 4;
        }
        if row + 2 <= self.rows {
            self.tile::<S, 2, V, WHOLE>(simd, row, column);
            row += 2;
        }
        if row < self.rows {
            self.tile::<S, 1, V, WHOLE>(simd, row, column);
        }
    }

    #[inline(always)]
    fn tile<S: Simd, const R: usize, const V: usize, const WHOLE: bool>(
        &mut self,
        simd: S,
        row: usize,
        column: usize,
    ) {
        let depth = self.depth;
        let width = if WHOLE { V * S::F32_LANES } else { self.columns - column };
        let a: [&[f32]; R] = array::from_fn(|r| &self.a[(row + r) * self.a_stride..][..depth]);
        let mut sums = [[simd.splat_f32s(0.0); V]; R];
        for r in 0..R {
            if let Start::Keep | Start::KeepAndBias(_) = self.start {
                let c = &self.c[(row + r) * self.c_stride + column..][..width];
                sums[r] = if WHOLE {
                    let c = S::as_simd_f32s(c).0;
                    array::from_fn(|v| c[v])
                } else {
                    [simd.partial_load_f32s(c); V]
                };
            }
            if let Start::Bias(bias) | Start::KeepAndBias(bias) = self.start {
                let bias = simd.splat_f32s(bias[row + r]);
                sums[r] = sums[r].map(|sum| simd.add_f32s(sum, bias));
            }
        }
        // Written so that the compiler sees that nothing is out of bounds.
        for (k, b) in (0..depth).zip(self.b.chunks_exact(self.b_stride)) {
            let b = S::as_simd_f32s(&b[column..][..V * S::F32_LANES]).0;
            let b: [S::f32s; V] = array::from_fn(|v| b[v]);
            for r in 0..R {
                let a = simd.splat_f32s(a[r][k]);
                for v in 0..V {
                    sums[r][v] = simd.mul_add_e_f32s(a, b[v], sums[r][v]);
                }
            }
        }
        for r in 0..R {
            let c = &mut self.c[(row + r) * self.c_stride + column..][..width];
            if WHOLE {
                let c = S::as_mut_simd_f32s(c).0;
                for v in 0..V {
                    c[v] = finish(simd, sums[r][v], self.rectify);
                }
            } else {
                simd.partial_store_f32s(c, finish(simd, sums[r][0], self.rectify));
            }
        }
    }
}

#[inline(always)]
fn finish<S: Simd>(simd: S, sum: S::f32s, rectify: bool) -> S::f32s {
    if rectify {
        let zero = simd.splat_f32s(0.0);
        simd.select_f32s(simd.less_than_or_equal_f32s(sum, zero), zero, sum)
    } else {
        sum
    }
}

impl WithSimd for Product<'_> {
    type Output = ();

    /// A tile's sums, a row of its panel and one number of A fill the registers.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES {
            16 => self.walk::<S, 8, 2>(simd),
            // Eight rows, those of a narrow head, are twice four.
            8 if self.rows <= 8 => self.walk::<S, 4, 2>(simd),
            8 => self.walk::<S, 6, 2>(simd),
            _ => self.walk::<S, 4, 4>(simd),
        }
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "small whole numbers are exact")]
mod tests {
    use super::*;

    #[test]
    fn every_tile_start_and_finish_agrees_with_the_definition() {
        let whole = |count: usize, modulus: usize| -> Vec<f32> {
            (0..count).map(|i| ((i * 7 + i / 5) % modulus) as f32 - 4.0).collect()
        };
        for (rows, depth, columns) in [
            (1_usize, 1_usize, 1_usize),
            (13, 5, 16),
            (8, 3, 32),
            (9, 7, 54),
            (29, 11, 112),
            (3, 0, 16),
        ] {
            let (a_stride, b_stride, c_stride) =
                (depth + 2, columns.next_multiple_of(16), columns + 3);
            let (a, b) = (whole(rows * a_stride, 11), whole(depth * b_stride, 13));
            let (c, bias) = (whole(rows * c_stride, 17), whole(rows, 9));
            for rectify in [false, true] {
                let starts =
                    [Start::Zero, Start::Bias(&bias), Start::Keep, Start::KeepAndBias(&bias)];
                for start in starts {
                    let mut found = c.clone();
                    Product {
                        rows,
                        depth,
                        columns,
                        a: &a,
                        a_stride,
                        b: &b,
                        b_stride,
                        start,
                        rectify,
                        c: &mut found,
                        c_stride,
                    }
                    .compute();
                    for (index, (&found, &before)) in found.iter().zip(&c).enumerate() {
                        let (row, column) = (index / c_stride, index % c_stride);
                        if column >= columns {
                            assert_eq!(found, before, "a number beside the matrix");
                            continue;
                        }
                        let terms =
                            (0..depth).map(|k| a[row * a_stride + k] * b[k * b_stride + column]);
                        let begin = match start {
                            Start::Zero => 0.0,
                            Start::Bias(bias) => bias[row],
                            Start::Keep => before,
                            Start::KeepAndBias(bias) => before + bias[row],
                        };
                        let sum = begin + terms.sum::<f32>();
                        let want = if rectify { sum.max(0.0) } else { sum };
                        assert_eq!(found, want, "{rows}×{depth}×{columns}, {row}, {column}");
                    }
                }
            }
        }
    }
}

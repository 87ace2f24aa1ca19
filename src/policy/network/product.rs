//! The single-precision matrix product that every layer is made of: `y = x W`, with `W` packed once.
//!
//! `W` (depth × columns) lies in *panels* of sixteen columns, each depth × 16, row by row. A tile of six rows and as many
//! panels as the registers hold is summed over the whole depth without leaving the registers, and bias, rectifier or residual
//! are applied on the way to memory.
//!
//! An element of `y` is the sum over the depth in order, each term by one fused multiplication and addition. So it depends on
//! its own row and column alone: not on the number of rows, on the tile it falls into or on the width of the vectors.
//!
//! Compared with a general product this saves the packing of `W` in every call, which small batches of rows never
//! earn back, and the passes over `y` before and after.

#![expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
#![expect(clippy::needless_range_loop, reason = "indices name rows, panels and vectors of a tile")]

use std::ops::Range;

use pulp::{Arch, Simd, WithSimd};

/// Columns of a panel; a multiple of every vector width in use.
pub(in crate::policy) const PANEL: usize = 16;

/// Rows of a tile.
const ROWS: usize = 6;

/// Numbers of `x` that meet all panels before the next ones come: half of the first-level cache.
const BLOCK: usize = 4096;

/// What becomes of a sum `x W`. Slices hold one number per column.
#[derive(Debug, Clone, Copy)]
pub(in crate::policy) enum Finish<'a> {
    /// `y = x W`.
    Replace,
    /// `y = x W + b`.
    AddBias(&'a [f32]),
    /// `y = max(x W + b, 0)`; a NaN stays a NaN.
    Rectify(&'a [f32]),
    /// `y = y + x W + b`.
    Accumulate(&'a [f32]),
}

impl Finish<'_> {
    /// The same for one number: what becomes of `sum` in `column`, where `y` was.
    pub(in crate::policy) fn of(self, sum: f32, column: usize, y: f32) -> f32 {
        match self {
            Finish::Replace => sum,
            Finish::AddBias(bias) => sum + bias[column],
            Finish::Rectify(bias) => {
                let shifted = sum + bias[column];
                if shifted <= 0.0 { 0.0 } else { shifted }
            }
            Finish::Accumulate(bias) => y + (sum + bias[column]),
        }
    }
}

/// Rows that begin every `stride` numbers.
#[derive(Debug, Clone, Copy)]
pub(in crate::policy) struct Rows<'a> {
    numbers: &'a [f32],
    /// Where the first row begins.
    start: usize,
    stride: usize,
    count: usize,
}

impl<'a> Rows<'a> {
    /// Rows of `width` numbers, one after the other.
    pub(in crate::policy) fn new(numbers: &'a [f32], width: usize) -> Self {
        Self { numbers, start: 0, stride: width, count: numbers.len() / width.max(1) }
    }

    pub(in crate::policy) fn count(self) -> usize {
        self.count
    }

    /// `count` rows from the one numbered `first` on.
    pub(in crate::policy) fn part(self, first: usize, count: usize) -> Self {
        Self { start: self.start + first * self.stride, count, ..self }
    }

    /// The same rows from `column` on.
    pub(in crate::policy) fn columns_on(self, column: usize) -> Self {
        Self { start: self.start + column, ..self }
    }

    /// The first `width` numbers of the row numbered `index`.
    #[inline(always)]
    pub(in crate::policy) fn row(self, index: usize, width: usize) -> &'a [f32] {
        &self.numbers[self.start + index * self.stride..][..width]
    }
}

/// One product; `y` has as many rows as `x`.
#[derive(Debug)]
pub(in crate::policy) struct Product<'a> {
    /// The first `depth` numbers of each row count.
    pub(in crate::policy) x: Rows<'a>,
    pub(in crate::policy) depth: usize,
    /// Whole panels.
    pub(in crate::policy) panels: &'a [f32],
    pub(in crate::policy) finish: Finish<'a>,
    pub(in crate::policy) y: &'a mut [f32],
    /// Distance of the rows of `y`; the first sixteen numbers per panel of each are written.
    pub(in crate::policy) y_stride: usize,
}

impl Product<'_> {
    /// Computes it, with the widest vector instructions that this machine has.
    pub(in crate::policy) fn compute(self) {
        Arch::new().dispatch(self);
    }

    /// Tiles of `P` panels of `V` vectors each; the panels left over one by one.
    #[inline(always)]
    fn walk<S: Simd, const P: usize, const V: usize>(mut self, simd: S) {
        let panel = (self.depth * PANEL).max(1);
        let count = self.panels.len() / panel;
        let block = (BLOCK / self.depth.max(1)).max(2 * ROWS) / ROWS * ROWS;
        for first in (0..self.x.count).step_by(block) {
            let rows = first..self.x.count.min(first + block);
            for left in (0..count).step_by(P) {
                let panels = &self.panels[left * panel..];
                if count - left >= P {
                    self.walk_down::<S, P, V>(simd, rows.clone(), left * PANEL, panels);
                } else {
                    for (p, panels) in panels.chunks_exact(panel).enumerate() {
                        self.walk_down::<S, 1, V>(simd, rows.clone(), (left + p) * PANEL, panels);
                    }
                }
            }
        }
    }

    /// Some rows of the `P` panels that make the columns from `column` on.
    #[inline(always)]
    fn walk_down<S: Simd, const P: usize, const V: usize>(
        &mut self,
        simd: S,
        rows: Range<usize>,
        column: usize,
        panels: &[f32],
    ) {
        for row in rows.clone().step_by(ROWS) {
            match rows.end - row {
                1 => self.tile::<S, 1, P, V>(simd, row, column, panels),
                2 => self.tile::<S, 2, P, V>(simd, row, column, panels),
                3 => self.tile::<S, 3, P, V>(simd, row, column, panels),
                4 => self.tile::<S, 4, P, V>(simd, row, column, panels),
                5 => self.tile::<S, 5, P, V>(simd, row, column, panels),
                _ => self.tile::<S, ROWS, P, V>(simd, row, column, panels),
            }
        }
    }

    /// `R` rows from `row` on times `P` panels that make the columns from `column` on.
    #[inline(always)]
    fn tile<S: Simd, const R: usize, const P: usize, const V: usize>(
        &mut self,
        simd: S,
        row: usize,
        column: usize,
        panels: &[f32],
    ) {
        let depth = self.depth;
        let mut x: [&[f32]; R] = [&[]; R];
        for r in 0..R {
            x[r] = self.x.row(row + r, depth);
        }
        let mut w: [&[[S::f32s; V]]; P] = [&[]; P];
        for p in 0..P {
            w[p] = &as_vectors::<S, V>(&panels[p * depth * PANEL..])[..depth];
        }
        let mut sums = [[[simd.splat_f32s(0.0); V]; P]; R];
        for k in 0..depth {
            for r in 0..R {
                let x = simd.splat_f32s(x[r][k]);
                for p in 0..P {
                    for v in 0..V {
                        sums[r][p][v] = simd.mul_add_e_f32s(x, w[p][k][v], sums[r][p][v]);
                    }
                }
            }
        }
        let y = &mut self.y[row * self.y_stride + column..];
        let stride = self.y_stride;
        match self.finish {
            Finish::Replace => {
                store::<S, R, P, V>(
                    y,
                    stride,
                    sums,
                    [[simd.splat_f32s(0.0); V]; P],
                    |_, sum, _| sum,
                );
            }
            Finish::AddBias(bias) => {
                let bias = load::<S, P, V>(&bias[column..]);
                store::<S, R, P, V>(y, stride, sums, bias, |_, sum, b| simd.add_f32s(sum, b));
            }
            Finish::Rectify(bias) => {
                let (zero, bias) = (simd.splat_f32s(0.0), load::<S, P, V>(&bias[column..]));
                store::<S, R, P, V>(y, stride, sums, bias, |_, sum, b| {
                    let shifted = simd.add_f32s(sum, b);
                    simd.select_f32s(simd.less_than_or_equal_f32s(shifted, zero), zero, shifted)
                });
            }
            Finish::Accumulate(bias) => {
                let bias = load::<S, P, V>(&bias[column..]);
                store::<S, R, P, V>(y, stride, sums, bias, |y, sum, b| {
                    simd.add_f32s(y, simd.add_f32s(sum, b))
                });
            }
        }
    }
}

/// The first `P` panels' worth of `numbers`.
#[inline(always)]
fn load<S: Simd, const P: usize, const V: usize>(numbers: &[f32]) -> [[S::f32s; V]; P] {
    let (panels, _) = as_vectors::<S, V>(numbers).as_chunks::<P>();
    panels[0]
}

/// Writes a tile to `y`: what `finish` makes of the number there, the sum and the bias.
#[inline(always)]
fn store<S: Simd, const R: usize, const P: usize, const V: usize>(
    y: &mut [f32],
    stride: usize,
    sums: [[[S::f32s; V]; P]; R],
    bias: [[S::f32s; V]; P],
    finish: impl Fn(S::f32s, S::f32s, S::f32s) -> S::f32s,
) {
    for r in 0..R {
        let (y, _) = S::as_mut_simd_f32s(&mut y[r * stride..][..P * PANEL]);
        let (y, _) = y.as_chunks_mut::<V>();
        for p in 0..P {
            for v in 0..V {
                y[p][v] = finish(y[p][v], sums[r][p][v], bias[p][v]);
            }
        }
    }
}

impl WithSimd for Product<'_> {
    type Output = ();

    /// A tile's sums, one row of its panels and one element of `x` fill the registers.
    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        match S::F32_LANES {
            16 => self.walk::<S, 4, 1>(simd),
            // One row alone needs more sums, or each waits for the one before.
            8 if self.x.count == 1 => self.walk::<S, 4, 2>(simd),
            8 => self.walk::<S, 1, 2>(simd),
            4 => self.walk::<S, 1, 4>(simd),
            _ => self.walk::<S, 1, PANEL>(simd),
        }
    }
}

/// Packs `Wᵀ`, whose rows are the columns of `W`. What is left of the last panel stays as it is.
pub(in crate::policy) fn pack_columns(columns: Rows<'_>, depth: usize, panels: &mut [f32]) {
    /// Columns that are turned over together.
    const TURNED: usize = 4;
    let whole = columns.count / TURNED * TURNED;
    for first in (0..whole).step_by(TURNED) {
        let panel = &mut panels[first / PANEL * PANEL * depth..][..PANEL * depth];
        let column = [0, 1, 2, 3].map(|c| columns.row(first + c, depth));
        let (rows, _) = panel.as_chunks_mut::<PANEL>();
        for (k, row) in rows.iter_mut().enumerate() {
            row[first % PANEL..][..TURNED].copy_from_slice(&column.map(|column| column[k]));
        }
    }
    for last in whole..columns.count {
        let panel = &mut panels[last / PANEL * PANEL * depth..][..PANEL * depth];
        for (row, &w) in panel.chunks_exact_mut(PANEL).zip(columns.row(last, depth)) {
            row[last % PANEL] = w;
        }
    }
}

/// Packs the first `width` numbers of the rows of `W`. What is left of the last panel stays as it is.
pub(in crate::policy) fn pack_rows(rows: Rows<'_>, width: usize, panels: &mut [f32]) {
    let depth = rows.count;
    for k in 0..depth {
        let (whole, rest) = rows.row(k, width).as_chunks::<PANEL>();
        let mut panels = panels.chunks_exact_mut(PANEL).skip(k).step_by(depth);
        for (part, packed) in whole.iter().zip(panels.by_ref()) {
            packed.copy_from_slice(part);
        }
        if let Some(packed) = panels.next() {
            packed[..rest.len()].copy_from_slice(rest);
        }
    }
}

/// Rows of one panel as `V` vectors each.
#[inline(always)]
fn as_vectors<S: Simd, const V: usize>(numbers: &[f32]) -> &[[S::f32s; V]] {
    let (vectors, _) = S::as_simd_f32s(numbers);
    let (rows, _) = vectors.as_chunks::<V>();
    rows
}

#[cfg(test)]
mod tests {
    use super::*;

    fn wave(count: usize, frequency: f32) -> Vec<f32> {
        (0..count).map(|i| (i as f32 * frequency).sin()).collect()
    }

    /// `x W + b` with made-up `W` and `b`.
    fn product(x: &[f32], depth: usize, columns: usize, arch: Arch) -> Vec<f32> {
        let (w, bias) = (wave(depth * columns, 0.71), wave(columns, 0.23));
        let mut panels = vec![0.0; depth * columns];
        pack_rows(Rows::new(&w, columns), columns, &mut panels);
        let mut y = vec![f32::NAN; x.len() / depth * columns];
        arch.dispatch(Product {
            x: Rows::new(x, depth),
            depth,
            panels: &panels,
            finish: Finish::AddBias(&bias),
            y: &mut y,
            y_stride: columns,
        });
        y
    }

    #[test]
    fn a_row_does_not_depend_on_its_neighbours() {
        // Depths on both sides of where a block of rows ends; one to six panels, so that some fill no tile.
        for (depth, columns) in [(3, PANEL), (128, 3 * PANEL), (600, 6 * PANEL)] {
            let x = wave(41 * depth, 0.37);
            let together = product(&x, depth, columns, Arch::new());
            for count in 1..=13 {
                for first in [0, 5, 41 - count] {
                    let some = &x[first * depth..(first + count) * depth];
                    let got = product(some, depth, columns, Arch::new());
                    let want = &together[first * columns..(first + count) * columns];
                    let bits = |row: &[f32]| row.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
                    assert_eq!(bits(&got), bits(want), "{count} rows from {first} on");
                }
            }
        }
    }

    #[test]
    fn all_instruction_sets_agree_with_the_definition() {
        let (rows, depth, columns) = (23, 37, 5 * PANEL);
        let x = wave(rows * depth, 0.37);
        let (w, bias) = (wave(depth * columns, 0.71), wave(columns, 0.23));
        let widest = product(&x, depth, columns, Arch::new());
        let portable = product(&x, depth, columns, Arch::Scalar);
        for (i, got) in widest.into_iter().zip(portable).enumerate() {
            let (row, column) = (i / columns, i % columns);
            let terms = (0..depth)
                .map(|k| f64::from(x[row * depth + k]) * f64::from(w[k * columns + column]));
            let want = terms.sum::<f64>() + f64::from(bias[column]);
            for got in [got.0, got.1].map(f64::from) {
                assert!((got - want).abs() < 1e-5, "row {row}, column {column}: {got}, {want}");
            }
        }
    }

    #[test]
    fn rows_and_columns_are_packed_alike_and_what_is_left_over_stays() {
        for (depth, columns) in [(3, 1), (2, 8), (5, PANEL), (4, PANEL + 7), (1, 3 * PANEL)] {
            let w: Vec<f32> = (0..depth * columns).map(|i| i as f32).collect();
            let transposed: Vec<f32> =
                (0..w.len()).map(|i| w[i % depth * columns + i / depth]).collect();
            let room = vec![-1.0; depth * columns.next_multiple_of(PANEL)];
            let (mut by_rows, mut by_columns) = (room.clone(), room.clone());
            pack_rows(Rows::new(&w, columns), columns, &mut by_rows);
            pack_columns(Rows::new(&transposed, depth), depth, &mut by_columns);
            assert_eq!(by_rows, by_columns);
            for (i, packed) in by_rows.into_iter().enumerate() {
                let (panel, k, lane) = (i / (PANEL * depth), i / PANEL % depth, i % PANEL);
                let column = panel * PANEL + lane;
                let want = if column < columns { w[k * columns + column] } else { -1.0 };
                assert_eq!(packed.to_bits(), want.to_bits(), "column {column}, row {k}");
            }
        }
    }
}

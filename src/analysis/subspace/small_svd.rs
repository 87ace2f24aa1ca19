//! Singular values of small matrices, as many side by side as a vector holds numbers.
//!
//! Reflections make each matrix bidiagonal (Golub & Kahan 1965); [`super::quotients`] finds the squares of its singular
//! values. Values only, off by a few ε of the largest.
//!
//! For a handful of columns a general decomposition spends most of its time on preparations, and one matrix alone waits
//! for every sum and every quotient. So each number of a vector belongs to another matrix: nothing is ever added up
//! across a vector, and as many results as it holds are waited for together. No matrix feels its neighbours: its values
//! do not depend on what lies beside it. Smaller ones are filled up with zeros, which stay zero, so neighbours should be
//! of similar size.
//!
//! Entries should be of magnitude one, as those of a product of two orthonormal bases are: their squares must not
//! overflow, and columns whose square sum is below 10⁻²⁸⁰ count as zero. Oracle: the general decomposition of faer, below.

#![expect(clippy::inline_always, reason = "only what is inlined is compiled for wide vectors")]

use faer::MatRef;
use faer::traits::pulp::{self, Simd, WithSimd, bytemuck};

use super::quotients::Quotients;

/// Rows handled together, so that a sum need not wait for its own last addition.
const GROUP: usize = 4;
/// Sums of squares below this count as zero.
const NOTHING: f64 = 1e-280;

/// The singular values of each of `matrices`, falling; `None` if some did not converge, as with entries that are not
/// finite.
pub(super) fn singular_values(matrices: &[MatRef<'_, f64>]) -> Option<Vec<Vec<f64>>> {
    pulp::Arch::new().dispatch(SingularValues { matrices })
}

struct SingularValues<'a> {
    matrices: &'a [MatRef<'a, f64>],
}

impl WithSimd for SingularValues<'_> {
    type Output = Option<Vec<Vec<f64>>>;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> Self::Output {
        let mut found = Vec::with_capacity(self.matrices.len());
        for matrices in self.matrices.chunks(S::F64_LANES) {
            let mut bidiagonal = Columns::new(simd, matrices).bidiagonalise(simd);
            let counts: Vec<usize> = matrices.iter().map(smaller_side).collect();
            let largest = bidiagonal.scale_and_square(simd)?;
            let Bidiagonal { diagonal, above } = &mut bidiagonal;
            if !Quotients::new(simd, diagonal, above, &counts).solve(simd) {
                return None;
            }
            for entry in diagonal.iter_mut() {
                *entry = simd.mul_f64s(largest, simd.sqrt_f64s(*entry));
            }
            let diagonal = bytemuck::cast_slice::<S::f64s, f64>(diagonal);
            for (lane, &count) in counts.iter().enumerate() {
                let mut values: Vec<f64> =
                    diagonal.iter().skip(lane).step_by(S::F64_LANES).take(count).copied().collect();
                values.sort_unstable_by(|a, b| b.total_cmp(a));
                found.push(values);
            }
        }
        Some(found)
    }
}

fn smaller_side(matrix: &MatRef<'_, f64>) -> usize {
    matrix.nrows().min(matrix.ncols())
}

/// Some matrices, none wider than it is high: column after column, in groups of rows.
struct Columns<S: Simd> {
    groups: Vec<[S::f64s; GROUP]>,
    count: usize,
    /// Groups of a column.
    stride: usize,
}

/// What is left of them: their diagonals, and the entries right of these.
struct Bidiagonal<S: Simd> {
    diagonal: Vec<S::f64s>,
    /// As long as the diagonal; the last one is zero.
    above: Vec<S::f64s>,
}

impl<S: Simd> Columns<S> {
    #[inline(always)]
    fn new(simd: S, matrices: &[MatRef<'_, f64>]) -> Self {
        let count = matrices.iter().map(smaller_side).max().unwrap_or(0);
        let rows = matrices.iter().map(|matrix| matrix.nrows().max(matrix.ncols())).max();
        let stride = rows.unwrap_or(0).div_ceil(GROUP);
        let mut groups = vec![[simd.splat_f64s(0.0); GROUP]; count * stride];
        let entries = bytemuck::cast_slice_mut::<S::f64s, f64>(groups.as_flattened_mut());
        for (lane, matrix) in matrices.iter().enumerate() {
            let tall = if matrix.nrows() < matrix.ncols() { matrix.transpose() } else { *matrix };
            let length = stride * GROUP * S::F64_LANES;
            for (to, from) in entries.chunks_exact_mut(length).zip(tall.col_iter()) {
                let to = to.iter_mut().skip(lane).step_by(S::F64_LANES);
                to.zip(from.iter()).for_each(|(to, from)| *to = *from);
            }
        }
        Self { groups, count, stride }
    }

    /// Reflects from the left and from the right in turn. What is above the diagonal of the columns is used up and then
    /// holds nothing of meaning; so groups can be handled as a whole that begin above it.
    #[inline(always)]
    fn bidiagonalise(mut self, simd: S) -> Bidiagonal<S> {
        let Self { count, stride, .. } = self;
        let zero = simd.splat_f64s(0.0);
        let (mut diagonal, mut above) = (vec![zero; count], vec![zero; count]);
        let mut weights = vec![zero; count];
        for step in 0..count {
            let (group, row) = (step / GROUP, step % GROUP);
            let (done, rest) = self.groups.split_at_mut((step + 1) * stride);
            let reflector = &mut done[step * stride + group..];
            // Rows above this one take no part.
            reflector[0][..row].fill(zero);
            let first = reflector[0][row];
            let (image, scale) = reflect(simd, dot(simd, reflector, reflector), first);
            diagonal[step] = image;
            reflector[0][row] = simd.sub_f64s(first, image);
            for column in rest.chunks_exact_mut(stride) {
                let column = &mut column[group..];
                let share = simd.mul_f64s(scale, dot(simd, reflector, column));
                for (to, from) in column.iter_mut().zip(&*reflector) {
                    for (to, from) in to.iter_mut().zip(from) {
                        *to = simd.mul_add_e_f64s(share, *from, *to);
                    }
                }
            }
            if step + 1 == count {
                break;
            }
            let weights = &mut weights[step + 1..];
            let mut square = zero;
            for (weight, column) in weights.iter_mut().zip(rest.chunks_exact(stride)) {
                *weight = column[group][row];
                square = simd.mul_add_e_f64s(*weight, *weight, square);
            }
            let first = weights[0];
            let (image, scale) = reflect(simd, square, first);
            above[step] = image;
            weights[0] = simd.sub_f64s(first, image);
            for group in (step + 1) / GROUP..stride {
                let mut sums = [zero; GROUP];
                for (&weight, column) in weights.iter().zip(rest.chunks_exact(stride)) {
                    for (sum, value) in sums.iter_mut().zip(column[group]) {
                        *sum = simd.mul_add_e_f64s(weight, value, *sum);
                    }
                }
                for sum in &mut sums {
                    *sum = simd.mul_f64s(scale, *sum);
                }
                for (&weight, column) in weights.iter().zip(rest.chunks_exact_mut(stride)) {
                    for (value, sum) in column[group].iter_mut().zip(sums) {
                        *value = simd.mul_add_e_f64s(weight, sum, *value);
                    }
                }
            }
        }
        Bidiagonal { diagonal, above }
    }
}

impl<S: Simd> Bidiagonal<S> {
    /// Divides every matrix by its largest entry and squares; these largest entries, `None` if one is not finite.
    #[inline(always)]
    fn scale_and_square(&mut self, simd: S) -> Option<S::f64s> {
        let zero = simd.splat_f64s(0.0);
        let (mut largest, mut odd) = (zero, zero);
        for &entry in self.diagonal.iter().chain(&self.above) {
            largest = simd.max_f64s(simd.abs_f64s(entry), largest);
            // Zero, or not a number.
            odd = simd.mul_add_e_f64s(entry, zero, odd);
        }
        if !bytemuck::cast_slice(&[odd]).iter().all(|&odd: &f64| odd == 0.0) {
            return None;
        }
        let is_something = simd.greater_than_f64s(largest, zero);
        for entry in self.diagonal.iter_mut().chain(&mut self.above) {
            let share = simd.div_f64s(*entry, largest);
            *entry = simd.select_f64s(is_something, simd.mul_f64s(share, share), zero);
        }
        Some(largest)
    }
}

/// What the first entry of a vector becomes when all others are reflected away, given the sum of all squares. With it
/// `-1 / (norm · (norm + |first|))`, which scales the reflection.
#[inline(always)]
fn reflect<S: Simd>(simd: S, square: S::f64s, first: S::f64s) -> (S::f64s, S::f64s) {
    let (zero, nothing) = (simd.splat_f64s(0.0), simd.splat_f64s(NOTHING));
    // Not so what is not a number.
    let is_nothing = simd.less_than_or_equal_f64s(square, nothing);
    let norm = simd.select_f64s(is_nothing, zero, simd.sqrt_f64s(square));
    let minus = simd.neg_f64s(norm);
    let image = simd.select_f64s(simd.less_than_f64s(first, zero), norm, minus);
    let length = simd.mul_f64s(norm, simd.add_f64s(norm, simd.abs_f64s(first)));
    let scale = simd.div_f64s(simd.splat_f64s(-1.0), length);
    (image, simd.select_f64s(is_nothing, zero, scale))
}

/// Sums of products, each matrix for itself.
#[inline(always)]
fn dot<S: Simd>(simd: S, a: &[[S::f64s; GROUP]], b: &[[S::f64s; GROUP]]) -> S::f64s {
    let mut sums = [simd.splat_f64s(0.0); GROUP];
    for (a, b) in a.iter().zip(b) {
        for ((sum, &a), &b) in sums.iter_mut().zip(a).zip(b) {
            *sum = simd.mul_add_e_f64s(a, b, *sum);
        }
    }
    let [a, b, c, d] = sums;
    simd.add_f64s(simd.add_f64s(a, b), simd.add_f64s(c, d))
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use proptest::prelude::*;

    use super::*;

    fn assert_agrees(matrix: &Mat<f64>) {
        let found = singular_values(&[matrix.as_ref()]).unwrap().remove(0);
        let want = matrix.singular_values().unwrap();
        assert_eq!(found.len(), want.len());
        let largest = want.first().copied().unwrap_or(0.0);
        for (found, want) in found.iter().zip(&want) {
            assert!((found - want).abs() <= 1e-14 * largest.max(1e-300), "{found} {want}");
        }
    }

    #[test]
    fn singular_and_graded_matrices_are_no_trouble() {
        assert_agrees(&Mat::zeros(4, 3));
        assert_agrees(&Mat::identity(5, 5));
        assert_agrees(&Mat::from_fn(6, 6, |i, j| if i + 1 == j { 1.0 } else { 0.0 }));
        assert_agrees(&Mat::from_fn(
            9,
            9,
            |i, j| if j >= i { 10_f64.powi(-(i as i32)) } else { 0.0 },
        ));
        assert_agrees(&Mat::from_fn(
            9,
            9,
            |i, j| if j >= i { 10_f64.powi(j as i32 - 9) } else { 0.0 },
        ));
        assert_agrees(&Mat::from_fn(12, 12, |i, j| f64::from(u8::from(i != j && i % 3 == j % 3))));
        assert_agrees(&Mat::from_fn(20, 1, |i, _| i as f64));
        assert_agrees(&Mat::from_fn(1, 1, |_, _| -2.0));
    }

    #[test]
    fn what_is_not_finite_is_refused() {
        for odd in [f64::NAN, f64::INFINITY, 1e200] {
            let matrix = Mat::from_fn(3, 3, |i, j| if i == j { odd } else { 1.0 });
            assert!(singular_values(&[matrix.as_ref()]).is_none(), "{odd}");
        }
        let three = Mat::from_fn(1, 1, |_, _| 3.0);
        assert_eq!(singular_values(&[three.as_ref()]), Some(vec![vec![3.0]]));
        assert_eq!(singular_values(&[]), Some(vec![]));
    }

    proptest! {
        #[test]
        fn values_are_those_of_the_general_decomposition(
            rows in 1..40_usize,
            columns in 1..40_usize,
            rank in 1..40_usize,
            values in prop::collection::vec(-1.0..1.0_f64, 80 * 40),
        ) {
            let left = Mat::from_fn(rows, rank, |i, j| values[i * 40 + j]);
            let right = Mat::from_fn(rank, columns, |i, j| values[(i + 40) * 40 + j]);
            assert_agrees(&(&left * &right));
        }

        #[test]
        fn no_matrix_feels_what_lies_beside_it(
            sizes in prop::collection::vec((0..12_usize, 1..12_usize), 1..20),
            values in prop::collection::vec(-1.0..1.0_f64, 31 * 31),
        ) {
            let matrices: Vec<Mat<f64>> = sizes
                .iter()
                .enumerate()
                .map(|(index, &(rows, columns))| {
                    Mat::from_fn(rows, columns, |i, j| values[index + 31 * i + 11 * j])
                })
                .collect();
            let beside: Vec<_> = matrices.iter().map(Mat::as_ref).collect();
            let beside = singular_values(&beside).unwrap();
            for (found, matrix) in beside.iter().zip(&matrices) {
                let alone = singular_values(&[matrix.as_ref()]).unwrap();
                prop_assert_eq!(found, &alone[0]);
            }
        }
    }
}

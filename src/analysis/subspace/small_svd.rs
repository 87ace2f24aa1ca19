//! Singular values of small matrices, many of them one after the other.
//!
//! Reflections make the matrix bidiagonal (Golub & Kahan 1965); differential quotient-difference steps with shifts, one
//! division per row, find the squares of its singular values (Fernando & Parlett 1994). A shift that is too large shows
//! itself by a negative square, and the step is taken again with a smaller one. Values only, off by a few ε of the largest.
//!
//! For a handful of columns a general decomposition spends most of its time on preparations. Here the memory is kept
//! from one matrix to the next, columns are padded to whole vectors, and the loops are compiled for the widest vector
//! instructions of the machine. Sums keep eight partial sums and fold them in one order.
//!
//! Entries should be of magnitude one, as those of a product of two orthonormal bases are: their squares must not
//! overflow. Oracle: the general decomposition of faer, below.

#![expect(clippy::inline_always, reason = "only what is inlined is compiled for wide vectors")]

use faer::MatRef;
use faer::traits::pulp::{self, Simd, WithSimd};

/// Partial sums side by side.
const LANES: usize = 8;
/// Steps per singular value; three or four are usual.
const MOST_STEPS: usize = 60;
/// Square of an entry beside the diagonal, of the largest, that changes no value by more than a few ε.
const NEGLIGIBLE: f64 = 4.0 * f64::EPSILON * f64::EPSILON;

/// Memory for one decomposition after the other.
#[derive(Debug, Default)]
pub(super) struct SmallSvd {
    /// Column after column, each padded with zeros to whole lanes.
    columns: Vec<f64>,
    reflector: Vec<f64>,
    weights: Vec<f64>,
    sums: Vec<f64>,
    diagonal: Vec<f64>,
    above: Vec<f64>,
    next_diagonal: Vec<f64>,
    next_above: Vec<f64>,
}

impl SmallSvd {
    /// The singular values of `matrix`, falling; `None` if they did not converge, as with entries that are not finite.
    pub(super) fn values(&mut self, matrix: MatRef<'_, f64>) -> Option<&[f64]> {
        let tall = if matrix.nrows() < matrix.ncols() { matrix.transpose() } else { matrix };
        let (rows, count) = tall.shape();
        let stride = rows.next_multiple_of(LANES);
        self.columns.clear();
        for column in tall.col_iter() {
            self.columns.extend(column.iter());
            self.columns.resize(self.columns.len() + stride - rows, 0.0);
        }
        for (memory, length) in [
            (&mut self.reflector, stride),
            (&mut self.sums, stride),
            (&mut self.weights, count),
            (&mut self.diagonal, count),
            (&mut self.above, count),
            (&mut self.next_diagonal, count),
            (&mut self.next_above, count),
        ] {
            memory.clear();
            memory.resize(length, 0.0);
        }
        pulp::Arch::new().dispatch(Bidiagonalise { svd: self, rows, stride });
        self.diagonalise().then_some(self.diagonal.as_slice())
    }

    /// From the bidiagonal to the singular values, falling, in `diagonal`. Whether that succeeded.
    fn diagonalise(&mut self) -> bool {
        let Self { diagonal, above, next_diagonal, next_above, .. } = self;
        let entries = || diagonal.iter().chain(&*above).map(|x| x.abs());
        if !entries().all(f64::is_finite) {
            return false;
        }
        let largest = entries().fold(0.0, f64::max);
        if largest > 0.0 {
            for entry in diagonal.iter_mut().chain(above.iter_mut()) {
                *entry = (*entry / largest) * (*entry / largest);
            }
            let mut quotients =
                Quotients { q: diagonal, e: above, next_q: next_diagonal, next_e: next_above };
            if !quotients.solve() {
                return false;
            }
            diagonal.iter_mut().for_each(|square| *square = largest * square.sqrt());
        }
        diagonal.sort_unstable_by(|a, b| b.total_cmp(a));
        true
    }

    /// Leaves the bidiagonal in `diagonal` and `above`, the entry right of each. What is above the diagonal of `columns`
    /// is used up and then holds nothing of meaning.
    #[inline(always)]
    fn bidiagonalise(&mut self, rows: usize, stride: usize) {
        let Self { columns, reflector, weights, sums, diagonal, above, .. } = self;
        let count = diagonal.len();
        for step in 0..count {
            // Whole lanes from the first that holds something.
            let start = step / LANES * LANES;
            let (done, rest) = columns.split_at_mut((step + 1) * stride);
            let column = &mut done[step * stride..];
            column[start..step].fill(0.0);
            let reflector = &mut reflector[start..stride];
            reflector.copy_from_slice(&column[start..]);
            if rows > step + 1 {
                let norm = dot(reflector, reflector).sqrt();
                let first = column[step];
                diagonal[step] = -norm.copysign(first);
                if norm > 0.0 {
                    reflector[step - start] = first - diagonal[step];
                    let scale = 1.0 / (norm * (norm + first.abs()));
                    for column in rest.chunks_exact_mut(stride) {
                        let column = &mut column[start..];
                        add(column, -scale * dot(reflector, column), reflector);
                    }
                }
            } else {
                diagonal[step] = column[step];
            }
            if step + 2 >= count {
                if step + 1 < count {
                    above[step] = rest[step];
                }
                continue;
            }
            let weights = &mut weights[step + 1..];
            let mut square = 0.0;
            for (weight, column) in weights.iter_mut().zip(rest.chunks_exact(stride)) {
                *weight = column[step];
                square += *weight * *weight;
            }
            let (norm, first) = (square.sqrt(), weights[0]);
            above[step] = -norm.copysign(first);
            if norm > 0.0 {
                weights[0] = first - above[step];
                let scale = 1.0 / (norm * (norm + first.abs()));
                let sums = &mut sums[start..stride];
                sums.fill(0.0);
                for (&weight, column) in weights.iter().zip(rest.chunks_exact(stride)) {
                    add(sums, weight, &column[start..]);
                }
                for (&weight, column) in weights.iter().zip(rest.chunks_exact_mut(stride)) {
                    add(&mut column[start..], -scale * weight, sums);
                }
            }
        }
    }
}

/// The loops of [`SmallSvd::bidiagonalise`], to be compiled for the widest vectors.
struct Bidiagonalise<'a> {
    svd: &'a mut SmallSvd,
    rows: usize,
    stride: usize,
}

impl WithSimd for Bidiagonalise<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) {
        self.svd.bidiagonalise(self.rows, self.stride);
    }
}

/// Sum of products; both come in whole lanes.
#[inline(always)]
fn dot(a: &[f64], b: &[f64]) -> f64 {
    let mut lanes = [0.0; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        for ((lane, a), b) in lanes.iter_mut().zip(a).zip(b) {
            *lane += a * b;
        }
    }
    let [a, b, c, d, e, f, g, h] = lanes;
    ((a + b) + (c + d)) + ((e + f) + (g + h))
}

/// Adds `scale` times `other`.
#[inline(always)]
fn add(to: &mut [f64], scale: f64, other: &[f64]) {
    for (to, other) in to.as_chunks_mut::<LANES>().0.iter_mut().zip(other.as_chunks::<LANES>().0) {
        for (to, other) in to.iter_mut().zip(other) {
            *to += scale * other;
        }
    }
}

/// Squares of singular values, from the squares of a bidiagonal matrix by differential quotient-difference steps.
struct Quotients<'a> {
    /// Squares of the diagonal.
    q: &'a mut [f64],
    /// Squares of the entries right of it.
    e: &'a mut [f64],
    /// The same after a step that may still be rejected.
    next_q: &'a mut [f64],
    next_e: &'a mut [f64],
}

/// Rows that do not depend on others any more, and what was subtracted from their squares.
struct Block {
    first: usize,
    last: usize,
    shift: f64,
}

/// How a step went.
enum Step {
    /// With an upper bound for what the smallest square still is.
    Accepted {
        bound: f64,
    },
    /// The shift was a little too large; this one is not.
    JustMissed {
        shift: f64,
    },
    Rejected,
}

impl Quotients<'_> {
    /// Replaces `q` by the squares, in no order. Whether that succeeded. The largest entry must be 1.
    fn solve(&mut self) -> bool {
        let Some(last) = self.q.len().checked_sub(1) else { return true };
        let mut steps = MOST_STEPS * self.q.len();
        let mut blocks = vec![Block { first: 0, last, shift: 0.0 }];
        while let Some(mut block) = blocks.pop() {
            let mut bound = f64::INFINITY;
            // Small squares are found fastest at the end.
            if 1.5 * self.q[block.first] < self.q[block.last] {
                self.q[block.first..=block.last].reverse();
                self.e[block.first..block.last].reverse();
            }
            loop {
                let Block { first, last, shift } = block;
                if let Some(at) = (first..last).rev().find(|&at| self.e[at] <= NEGLIGIBLE) {
                    blocks.push(Block { first, last: at, shift });
                    block.first = at + 1;
                }
                if block.first == block.last {
                    self.q[block.last] += block.shift;
                    break;
                }
                if steps == 0 {
                    return false;
                }
                steps -= 1;
                let mut tried = self.smaller_of_last_two(&block).min(bound);
                let mut failures = 0;
                bound = loop {
                    match self.step(&block, tried) {
                        Step::Accepted { bound } => break bound,
                        // Without a shift nothing can fail but arithmetic.
                        _ if tried <= 0.0 => return false,
                        Step::JustMissed { shift } if failures < 2 => tried = shift,
                        _ if failures < 2 => tried *= 0.25,
                        _ => tried = 0.0,
                    }
                    failures += 1;
                };
                block.shift += tried;
            }
        }
        true
    }

    /// The smaller square of the last two rows of a block alone: not below that of the block.
    fn smaller_of_last_two(&self, block: &Block) -> f64 {
        let (q, above, last) = (self.q[block.last - 1], self.e[block.last - 1], self.q[block.last]);
        let (trace, product) = (q + above + last, q * last);
        let root = (trace * trace - 4.0 * product).max(0.0).sqrt();
        2.0 * product / (trace + root)
    }

    /// One step; what it made is kept if no square turned negative.
    fn step(&mut self, block: &Block, shift: f64) -> Step {
        let Block { first, last, .. } = *block;
        let (q, e) = (&self.q[first..=last], &self.e[first..last]);
        let (next_q, next_e) = (&mut self.next_q[first..=last], &mut self.next_e[first..last]);
        let mut rest = q[0] - shift;
        let mut smallest = f64::INFINITY;
        let pairs = next_q.iter_mut().zip(next_e.iter_mut());
        for (((next_q, next_e), &e), &q) in pairs.zip(e).zip(&q[1..]) {
            smallest = smallest.min(rest);
            *next_q = rest + e;
            let ratio = q / *next_q;
            *next_e = e * ratio;
            rest = rest * ratio - shift;
        }
        if smallest >= 0.0 && rest >= 0.0 {
            next_q[last - first] = rest;
            self.q[first..=last].copy_from_slice(next_q);
            self.e[first..last].copy_from_slice(next_e);
            return Step::Accepted { bound: smallest.min(rest) };
        }
        if smallest > 0.0 && rest < 0.0 {
            // Rutishauser 1960: then this is below the smallest square, and very near it.
            let shift = (shift + rest) * (1.0 - 2.0 * f64::EPSILON);
            return Step::JustMissed { shift: shift.max(0.0) };
        }
        Step::Rejected
    }
}

#[cfg(test)]
mod tests {
    use faer::Mat;
    use proptest::prelude::*;

    use super::*;

    fn assert_agrees(matrix: &Mat<f64>) {
        let mut svd = SmallSvd::default();
        let found = svd.values(matrix.as_ref()).unwrap().to_vec();
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
        let mut svd = SmallSvd::default();
        for odd in [f64::NAN, f64::INFINITY, 1e200] {
            let matrix = Mat::from_fn(3, 3, |i, j| if i == j { odd } else { 1.0 });
            assert!(svd.values(matrix.as_ref()).is_none(), "{odd}");
        }
        assert_eq!(svd.values(Mat::from_fn(1, 1, |_, _| 3.0).as_ref()), Some([3.0].as_slice()));
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
    }
}

//! Squares of the singular values of bidiagonal matrices, as many side by side as a vector holds numbers.
//!
//! Differential quotient-difference steps with shifts, one division per row (Fernando & Parlett 1994). With q the squares
//! of the diagonal and e those of the entries right of it, a step with shift s is, from `d = q₀ − s` on,
//!
//! `q'ₖ = d + eₖ`, `e'ₖ = eₖ qₖ₊₁ / q'ₖ`, `d ← d qₖ₊₁ / q'ₖ − s`,
//!
//! and the last d is the last q'. All squares have become smaller by s. A shift that is too large shows itself by a
//! negative d, and the step is taken again with a smaller one. Where an e has vanished, the matrix falls apart; the lower
//! part is finished first.
//!
//! A step is one chain of divisions, each waiting for the one before. So every number of a vector belongs to another
//! matrix. They all step together, but each has its own rows, its own shift and its own verdict, so that none feels its
//! neighbours.

#![expect(clippy::inline_always, reason = "only what is inlined is compiled for wide vectors")]

use std::ops::RangeInclusive;

use faer::traits::pulp::{Simd, bytemuck};

/// Numbers of the widest vector.
const WIDEST: usize = 8;
/// Steps per row of the largest matrix before it is given up.
const MOST_STEPS: usize = 60;
/// Steps that may fail before the next one goes without a shift.
const MOST_FAILURES: f64 = 2.0;
/// Square of an entry beside the diagonal, of the largest, that changes no value by more than a few ε.
const NEGLIGIBLE: f64 = 4.0 * f64::EPSILON * f64::EPSILON;
/// In place of an e that has vanished, once it is known what had been subtracted then.
const PARTED: f64 = -1.0;
/// A little less than one: a bound that is multiplied with it stays one in spite of rounding.
const JUST_BELOW: f64 = 1.0 - 2.0 * f64::EPSILON;

/// One number for each matrix.
type Each = [f64; WIDEST];

/// Squares of bidiagonal matrices, on their way to squares of singular values.
pub(super) struct Quotients<'a, S: Simd> {
    /// Squares of the diagonal.
    q: &'a mut [S::f64s],
    /// Squares of the entries right of it.
    e: &'a mut [S::f64s],
    /// The same after a step that may still be rejected.
    next_q: Vec<S::f64s>,
    next_e: Vec<S::f64s>,
    /// What had been subtracted from the squares of a part when it was left, at its last row.
    left: Vec<Each>,
    /// Rows the step works on, both included; −1 when all is done.
    first: Each,
    last: Each,
    /// What was subtracted from the squares of these rows.
    shift: Each,
    /// The smallest square of these rows is not above this.
    bound: Each,
}

/// How a step went, for each matrix.
struct Step<V> {
    /// The last d.
    rest: V,
    /// The smallest of the others.
    smallest: V,
    /// The last row whose e has vanished, −1 if there is none.
    parted: V,
}

impl<'a, S: Simd> Quotients<'a, S> {
    /// The first `counts` rows of each matrix. The largest entry of each must be 1, unless all are 0; both slices are of
    /// equal length, and what is below a matrix's own rows must be 0.
    #[inline(always)]
    pub(super) fn new(
        simd: S,
        q: &'a mut [S::f64s],
        e: &'a mut [S::f64s],
        counts: &[usize],
    ) -> Self {
        let nothing = vec![simd.splat_f64s(0.0); q.len()];
        let mut quotients = Self {
            next_q: nothing.clone(),
            next_e: nothing,
            left: vec![[0.0; WIDEST]; q.len()],
            q,
            e,
            first: [-1.0; WIDEST],
            last: [-1.0; WIDEST],
            shift: [0.0; WIDEST],
            bound: [f64::INFINITY; WIDEST],
        };
        for (lane, &count) in counts.iter().enumerate() {
            quotients.begin(lane, count);
        }
        quotients
    }

    /// Replaces q by the squares, in no order. Whether that succeeded.
    #[inline(always)]
    pub(super) fn solve(mut self, simd: S) -> bool {
        let (zero, one) = (simd.splat_f64s(0.0), simd.splat_f64s(1.0));
        let (mut tried, mut failures) = (self.shifts(simd), zero);
        for _ in 0..MOST_STEPS * self.q.len() {
            let Some(rows) = self.rows() else { return true };
            let step = self.step(simd, rows.clone(), tried);
            let Step { rest, smallest, .. } = step;
            let is_accepted = simd.and_m64s(
                simd.greater_than_or_equal_f64s(smallest, zero),
                simd.greater_than_or_equal_f64s(rest, zero),
            );
            // Without a shift nothing can fail but arithmetic.
            let is_hopeless = simd.less_than_or_equal_f64s(tried, zero);
            let hopeless = simd.select_f64s(is_hopeless, one, zero);
            let hopeless = simd.select_f64s(is_accepted, zero, hopeless);
            if simd.reduce_sum_f64s(hopeless) > 0.0 {
                return false;
            }
            self.keep(simd, rows, &step, (tried, is_accepted));

            let is_just_missed = simd.greater_than_f64s(smallest, zero);
            // Rutishauser 1960: with only the last d negative, this is below the smallest square, and very near it.
            let near = simd.mul_f64s(simd.add_f64s(tried, rest), simd.splat_f64s(JUST_BELOW));
            let near = simd.max_f64s(near, zero);
            let quarter = simd.mul_f64s(tried, simd.splat_f64s(0.25));
            let smaller = simd.select_f64s(is_just_missed, near, quarter);
            let is_early = simd.less_than_f64s(failures, simd.splat_f64s(MOST_FAILURES));
            let smaller = simd.select_f64s(is_early, smaller, zero);
            tried = simd.select_f64s(is_accepted, self.shifts(simd), smaller);
            failures = simd.select_f64s(is_accepted, zero, simd.add_f64s(failures, one));
        }
        self.rows().is_none()
    }

    /// All rows that a step works on, the last one included; `None` when all is done.
    #[inline(always)]
    fn rows(&self) -> Option<RangeInclusive<usize>> {
        let last = self.last.iter().copied().fold(-1.0, f64::max);
        let at_work = self.first.iter().copied().filter(|&first| first >= 0.0);
        (last >= 0.0).then(|| at_work.fold(last, f64::min) as usize..=last as usize)
    }

    /// Takes a step into `next_q` and `next_e`. Rows on which a matrix does not work stay as they are.
    #[inline(always)]
    fn step(&mut self, simd: S, rows: RangeInclusive<usize>, shift: S::f64s) -> Step<S::f64s> {
        let (first, last) = (load::<S>(&self.first), load::<S>(&self.last));
        let (negligible, minus_shift) = (simd.splat_f64s(NEGLIGIBLE), simd.neg_f64s(shift));
        let mut step = Step {
            rest: simd.splat_f64s(0.0),
            smallest: simd.splat_f64s(f64::INFINITY),
            parted: simd.splat_f64s(-1.0),
        };
        let end = *rows.end();
        let pairs = self.next_q[rows.clone()].iter_mut().zip(&mut self.next_e[rows.clone()]);
        let old = self.q[rows.clone()].iter().zip(&self.e[rows.clone()]);
        let below = self.q[*rows.start() + 1..=end].iter();
        for ((row, (next_q, next_e)), ((&q, &e), &below)) in rows.zip(pairs).zip(old.zip(below)) {
            let here = simd.splat_f64s(row as f64);
            let is_inside = simd.and_m64s(
                simd.less_than_or_equal_f64s(first, here),
                simd.less_than_f64s(here, last),
            );
            let begun = simd.sub_f64s(q, shift);
            let d = simd.select_f64s(simd.equal_f64s(here, first), begun, step.rest);
            let smallest = simd.min_f64s(d, step.smallest);
            step.smallest = simd.select_f64s(is_inside, smallest, step.smallest);
            let sum = simd.add_f64s(d, e);
            let ratio = simd.div_f64s(below, sum);
            let product = simd.mul_f64s(e, ratio);
            *next_q = simd.select_f64s(is_inside, sum, q);
            *next_e = simd.select_f64s(is_inside, product, e);
            let is_parted = simd.less_than_or_equal_f64s(product, negligible);
            let is_parted = simd.and_m64s(is_inside, is_parted);
            step.parted = simd.select_f64s(is_parted, here, step.parted);
            let d = simd.mul_add_e_f64s(d, ratio, minus_shift);
            step.rest = simd.select_f64s(is_inside, d, step.rest);
        }
        self.next_q[end] = self.q[end];
        self.next_e[end] = self.e[end];
        step
    }

    /// Keeps what the accepted steps with the shifts `tried` made, and goes on to other rows where a matrix fell apart.
    #[inline(always)]
    fn keep(
        &mut self,
        simd: S,
        rows: RangeInclusive<usize>,
        step: &Step<S::f64s>,
        (tried, is_accepted): (S::f64s, S::m64s),
    ) {
        let last = load::<S>(&self.last);
        for row in rows {
            let is_last = simd.equal_f64s(simd.splat_f64s(row as f64), last);
            let q = simd.select_f64s(is_last, step.rest, self.next_q[row]);
            self.q[row] = simd.select_f64s(is_accepted, q, self.q[row]);
            self.e[row] = simd.select_f64s(is_accepted, self.next_e[row], self.e[row]);
        }
        let shift = load::<S>(&self.shift);
        let shifted = simd.select_f64s(is_accepted, simd.add_f64s(shift, tried), shift);
        store::<S>(&mut self.shift, shifted);
        let bound = simd.min_f64s(step.smallest, step.rest);
        let bound = simd.select_f64s(is_accepted, bound, load::<S>(&self.bound));
        store::<S>(&mut self.bound, bound);
        let none = simd.splat_f64s(-1.0);
        let mut parted = [-1.0; WIDEST];
        store::<S>(&mut parted, simd.select_f64s(is_accepted, step.parted, none));
        for (lane, &row) in parted.iter().enumerate().filter(|(_, row)| **row >= 0.0) {
            entries::<S>(self.e)[row as usize * S::F64_LANES + lane] = PARTED;
            self.left[row as usize][lane] = self.shift[lane];
            self.first[lane] = row + 1.0;
            if self.first[lane] >= self.last[lane] {
                let last = self.last[lane] as usize;
                entries::<S>(self.q)[last * S::F64_LANES + lane] += self.shift[lane];
                self.begin(lane, last);
            }
        }
    }

    /// Turns to the part that ends before row `end`.
    #[inline(always)]
    fn begin(&mut self, lane: usize, mut end: usize) {
        let (q, e) = (entries::<S>(self.q), entries::<S>(self.e));
        let at = |row: usize| row * S::F64_LANES + lane;
        while let Some(last) = end.checked_sub(1) {
            let shift = self.left[last][lane];
            let parted = (0..last).rev().find(|&row| e[at(row)] <= NEGLIGIBLE);
            let first = parted.map_or(0, |row| row + 1);
            if let Some(row) = parted.filter(|&row| e[at(row)] >= 0.0) {
                e[at(row)] = PARTED;
                self.left[row][lane] = shift;
            }
            if first < last {
                // Small squares are found fastest at the end.
                if 1.5 * q[at(first)] < q[at(last)] {
                    let mirrored = |row: usize| first + last - row;
                    for row in first..=(first + last - 1) / 2 {
                        q.swap(at(row), at(mirrored(row)));
                        e.swap(at(row), at(mirrored(row) - 1));
                    }
                }
                (self.first[lane], self.last[lane]) = (first as f64, last as f64);
                (self.shift[lane], self.bound[lane]) = (shift, f64::INFINITY);
                return;
            }
            q[at(last)] += shift;
            end = last;
        }
        (self.first[lane], self.last[lane]) = (-1.0, -1.0);
    }

    /// Shifts for the next step: the smaller square of the last two rows alone, which is not below the smallest of all,
    /// and no more than the bound.
    #[inline(always)]
    fn shifts(&mut self, simd: S) -> S::f64s {
        let (q, e) = (entries::<S>(self.q), entries::<S>(self.e));
        let (mut before, mut above, mut ends) = ([1.0; WIDEST], [0.0; WIDEST], [1.0; WIDEST]);
        for lane in 0..S::F64_LANES {
            if self.last[lane] >= 1.0 {
                let at = self.last[lane] as usize * S::F64_LANES + lane;
                (before[lane], above[lane]) = (q[at - S::F64_LANES], e[at - S::F64_LANES]);
                ends[lane] = q[at];
            }
        }
        let (before, above, ends) = (load::<S>(&before), load::<S>(&above), load::<S>(&ends));
        let trace = simd.add_f64s(simd.add_f64s(before, above), ends);
        let product = simd.mul_f64s(before, ends);
        let four = simd.splat_f64s(4.0);
        let square = simd.sub_f64s(simd.mul_f64s(trace, trace), simd.mul_f64s(four, product));
        let root = simd.sqrt_f64s(simd.max_f64s(square, simd.splat_f64s(0.0)));
        let twice = simd.add_f64s(product, product);
        let smaller = simd.div_f64s(twice, simd.add_f64s(trace, root));
        simd.min_f64s(smaller, load::<S>(&self.bound))
    }
}

/// One number for each matrix as a vector.
#[inline(always)]
fn load<S: Simd>(each: &Each) -> S::f64s {
    S::as_simd_f64s(each).0[0]
}

#[inline(always)]
fn store<S: Simd>(each: &mut Each, vector: S::f64s) {
    S::as_mut_simd_f64s(each).0[0] = vector;
}

/// The numbers of all vectors: those of one vector are one for each matrix.
#[inline(always)]
fn entries<S: Simd>(vectors: &mut [S::f64s]) -> &mut [f64] {
    bytemuck::cast_slice_mut(vectors)
}

//! One coordinate-descent sweep over a non-negative factor.
//!
//! For `min ‖X − F G‖²` over F ≥ 0 with G fixed, component after component:
//! `f ← max(0, f − ((F · GGᵀ)ₜ − (X Gᵀ)ₜ) / (GGᵀ)ₜₜ)`. Returned is how far the factor was from optimal: the sum of
//! |projected gradient| before each update, where at a zero only the part pointing into the allowed region counts.
//!
//! Rows of F do not depend on each other, so a few rows run through all components while they are in the cache. Four
//! components share one pass over the columns of X and F: their gradients are those of the factor before any of the
//! four moved, and each is corrected for the moves of the ones before it. So a value that is loaded serves four sums.

#![expect(clippy::inline_always, reason = "only what is inlined is compiled for wide vectors")]

use std::ops::Range;

use faer::traits::pulp::{self, Simd, WithSimd};
use faer::{Mat, MatRef};

/// Vector registers of rows handled side by side.
const REGISTERS: usize = 4;
/// Components that share a pass.
const GROUP: usize = 4;
/// Rows must come in multiples of this: four registers of the widest vectors.
pub(super) const LANES: usize = 32;

/// Coefficients of some columns in sums over them, for four sums at a time: group after group, column after column.
#[derive(Debug, Clone, Default)]
pub(super) struct Coefficients {
    groups: Vec<f64>,
    columns: usize,
}

impl Coefficients {
    /// `matrix` has one row per column that is summed over, and one column per sum.
    pub(super) fn set(&mut self, matrix: MatRef<'_, f64>, scale: f64) {
        self.columns = matrix.nrows();
        self.groups.clear();
        for first in (0..matrix.ncols()).step_by(GROUP) {
            for row in 0..matrix.nrows() {
                self.groups.extend((first..first + GROUP).map(|sum| {
                    if sum < matrix.ncols() { scale * matrix[(row, sum)] } else { 0.0 }
                }));
            }
        }
    }

    /// Those of the four sums from `first` on.
    #[inline(always)]
    fn group(&self, first: usize) -> &[[f64; GROUP]] {
        let length = self.columns * GROUP;
        self.groups[first / GROUP * length..][..length].as_chunks().0
    }
}

/// Where the part `X Gᵀ` of the gradient comes from.
#[derive(Debug, Clone, Copy)]
pub(super) enum Target<'a> {
    /// From X itself, and −Gᵀ.
    Product { values: &'a Mat<f64>, negative: &'a Coefficients },
    /// It is here already.
    Known(&'a Mat<f64>),
}

/// Sweeps over the first `lanes` rows of `factor` (rows × components), with `gram` = G Gᵀ and the same as coefficients.
pub(super) fn sweep(
    (gram, coefficients): (MatRef<'_, f64>, &Coefficients),
    target: Target<'_>,
    factor: &mut Mat<f64>,
    lanes: usize,
) -> f64 {
    debug_assert!(lanes.is_multiple_of(LANES), "rows come in whole vectors");
    pulp::Arch::new().dispatch(Sweep { gram, coefficients, target, factor, lanes })
}

/// `values` times the matrix that `coefficients` were set to, into the first `lanes` rows of `into`.
pub(super) fn product(
    values: &Mat<f64>,
    coefficients: &Coefficients,
    into: &mut Mat<f64>,
    lanes: usize,
) {
    debug_assert!(lanes.is_multiple_of(LANES), "rows come in whole vectors");
    pulp::Arch::new().dispatch(Product { values, coefficients, into, lanes });
}

/// Four sums for as many rows as the registers hold.
type Sums<V> = [[V; REGISTERS]; GROUP];

/// Adds the columns of `values` in the rows `here`, each times its coefficient. Sums come and go by value: behind a
/// reference they would not stay in registers.
#[inline(always)]
fn add_columns<S: Simd>(
    simd: S,
    mut sums: Sums<S::f64s>,
    values: &Mat<f64>,
    here: &Range<usize>,
    coefficients: &[[f64; GROUP]],
) -> Sums<S::f64s> {
    for (column, coefficients) in coefficients.iter().enumerate() {
        let values = S::as_simd_f64s(&values.col_as_slice(column)[here.clone()]).0;
        let Some(values) = values.first_chunk::<REGISTERS>() else { break };
        for (sums, &coefficient) in sums.iter_mut().zip(coefficients) {
            let coefficient = simd.splat_f64s(coefficient);
            for (sum, &value) in sums.iter_mut().zip(values) {
                *sum = simd.mul_add_e_f64s(coefficient, value, *sum);
            }
        }
    }
    sums
}

struct Product<'a> {
    values: &'a Mat<f64>,
    coefficients: &'a Coefficients,
    into: &'a mut Mat<f64>,
    lanes: usize,
}

impl WithSimd for Product<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Self { values, coefficients, into, lanes } = self;
        let width = REGISTERS * S::F64_LANES;
        let count = into.ncols();
        for start in (0..lanes).step_by(width) {
            let here = start..start + width;
            for first in (0..count).step_by(GROUP) {
                let none = [[simd.splat_f64s(0.0); REGISTERS]; GROUP];
                let sums = add_columns(simd, none, values, &here, coefficients.group(first));
                for (column, sums) in (first..count).zip(sums) {
                    let column = &mut into.col_as_slice_mut(column)[here.clone()];
                    S::as_mut_simd_f64s(column).0.copy_from_slice(&sums);
                }
            }
        }
    }
}

struct Sweep<'a> {
    gram: MatRef<'a, f64>,
    coefficients: &'a Coefficients,
    target: Target<'a>,
    factor: &'a mut Mat<f64>,
    lanes: usize,
}

impl WithSimd for Sweep<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { gram, coefficients, target, factor, lanes } = self;
        let width = REGISTERS * S::F64_LANES;
        let components = factor.ncols();
        let zero = simd.splat_f64s(0.0);
        let mut violation = [zero; REGISTERS];
        for start in (0..lanes).step_by(width) {
            let here = start..start + width;
            for first in (0..components).step_by(GROUP) {
                let group = first..components.min(first + GROUP);
                let mut gradients = [[zero; REGISTERS]; GROUP];
                match target {
                    Target::Product { values, negative } => {
                        let negative = negative.group(first);
                        gradients = add_columns(simd, gradients, values, &here, negative);
                    }
                    Target::Known(wanted) => {
                        for (gradient, component) in gradients.iter_mut().zip(group.clone()) {
                            let wanted = &wanted.col_as_slice(component)[here.clone()];
                            for (gradient, &wanted) in
                                gradient.iter_mut().zip(S::as_simd_f64s(wanted).0)
                            {
                                *gradient = simd.neg_f64s(wanted);
                            }
                        }
                    }
                }
                let coefficients = coefficients.group(first);
                let mut gradients = add_columns(simd, gradients, factor, &here, coefficients);
                for component in group.clone() {
                    let gradient = gradients[component - first];
                    let curvature = gram[(component, component)];
                    // A component that is zero everywhere has no gradient either; it stays where it is.
                    let inverse =
                        simd.splat_f64s(if curvature > 0.0 { curvature.recip() } else { 0.0 });
                    let column = &mut factor.col_as_slice_mut(component)[here.clone()];
                    let values = S::as_mut_simd_f64s(column).0;
                    let mut moves = [zero; REGISTERS];
                    for (index, value) in values.iter_mut().enumerate() {
                        let gradient = gradient[index];
                        let is_zero = simd.equal_f64s(*value, zero);
                        let inward = simd.min_f64s(gradient, zero);
                        let projected = simd.select_f64s(is_zero, inward, gradient);
                        violation[index] =
                            simd.add_f64s(violation[index], simd.abs_f64s(projected));
                        let moved = simd.sub_f64s(*value, simd.mul_f64s(gradient, inverse));
                        let moved = simd.max_f64s(moved, zero);
                        moves[index] = simd.sub_f64s(moved, *value);
                        *value = moved;
                    }
                    for later in component + 1..group.end {
                        let share = simd.splat_f64s(gram[(component, later)]);
                        for (gradient, moved) in gradients[later - first].iter_mut().zip(moves) {
                            *gradient = simd.mul_add_e_f64s(share, moved, *gradient);
                        }
                    }
                }
            }
        }
        violation.iter().map(|&sum| simd.reduce_sum_f64s(sum)).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sweep_equals_its_formula_row_by_row_whoever_knows_the_target() {
        // A group and a part of one.
        let (components, muscles) = (6, 5);
        let synergies = Mat::from_fn(muscles, components, |m, t| ((3 * m + 5 * t) % 7) as f64);
        let gram = synergies.transpose() * &synergies;
        let values = Mat::from_fn(LANES, muscles, |i, m| ((i * 7 + m * 3) % 11) as f64);
        let target = &values * &synergies;
        let start = Mat::from_fn(LANES, components, |i, j| ((i + j) % 3) as f64);

        let mut want = start.clone();
        let mut want_violation = 0.0;
        for row in 0..LANES {
            for t in 0..components {
                let gradient: f64 =
                    (0..components).map(|r| gram[(t, r)] * want[(row, r)]).sum::<f64>()
                        - target[(row, t)];
                let f = &mut want[(row, t)];
                want_violation += if *f > 0.0 { gradient.abs() } else { gradient.min(0.0).abs() };
                *f = (*f - gradient / gram[(t, t)]).max(0.0);
            }
        }

        let (mut coefficients, mut negative) = (Coefficients::default(), Coefficients::default());
        coefficients.set(gram.as_ref(), 1.0);
        negative.set(synergies.as_ref(), -1.0);
        for target in
            [Target::Known(&target), Target::Product { values: &values, negative: &negative }]
        {
            let mut factor = start.clone();
            let violation = sweep((gram.as_ref(), &coefficients), target, &mut factor, LANES);
            assert!((violation - want_violation).abs() < 1e-12 * want_violation);
            for (t, row) in (0..components).flat_map(|t| (0..LANES).map(move |row| (t, row))) {
                let (found, want) = (factor[(row, t)], want[(row, t)]);
                assert!((found - want).abs() < 1e-13, "row {row}, component {t}: {found} {want}");
            }
        }
    }

    #[test]
    fn a_product_is_that_of_the_general_routine() {
        let values = Mat::from_fn(LANES, 3, |i, m| ((i * 7 + m * 3) % 11) as f64);
        let matrix = Mat::from_fn(3, 5, |m, t| ((3 * m + 5 * t) % 7) as f64);
        let mut coefficients = Coefficients::default();
        coefficients.set(matrix.as_ref(), 2.0);
        let mut found = Mat::zeros(LANES, 5);
        product(&values, &coefficients, &mut found, LANES);
        assert_eq!(found, faer::Scale(2.0) * (&values * &matrix));
    }
}

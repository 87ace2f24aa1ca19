//! One coordinate-descent sweep over a non-negative factor.
//!
//! For `min ‖X − F G‖²` over F ≥ 0 with G fixed, component after component:
//! `f ← max(0, f − ((F · GGᵀ)ₜ − (X Gᵀ)ₜ) / (GGᵀ)ₜₜ)`. Returned is how far the factor was from optimal: the sum of
//! |projected gradient| before each update, where at a zero only the part pointing into the allowed region counts.
//!
//! Rows of F do not depend on each other, so a block of rows runs through all components while it is in the cache, and
//! eight vector registers of rows go side by side.

#![expect(clippy::inline_always, reason = "only what is inlined is compiled for wide vectors")]

use faer::traits::pulp::{self, Simd, WithSimd};
use faer::{Mat, MatRef};

/// Vector registers of rows handled side by side.
const REGISTERS: usize = 8;
/// Rows must come in multiples of this: eight registers of the widest vectors.
pub(super) const LANES: usize = 64;

/// Sweeps over the first `lanes` rows of `factor` (rows × components), with `gram` = G Gᵀ and `target` = X Gᵀ.
pub(super) fn sweep(
    gram: MatRef<'_, f64>,
    target: &Mat<f64>,
    factor: &mut Mat<f64>,
    lanes: usize,
) -> f64 {
    debug_assert!(lanes.is_multiple_of(LANES), "rows come in whole vectors");
    pulp::Arch::new().dispatch(Sweep { gram, target, factor, lanes })
}

struct Sweep<'a> {
    gram: MatRef<'a, f64>,
    target: &'a Mat<f64>,
    factor: &'a mut Mat<f64>,
    lanes: usize,
}

impl WithSimd for Sweep<'_> {
    type Output = f64;

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) -> f64 {
        let Self { gram, target, factor, lanes } = self;
        let width = REGISTERS * S::F64_LANES;
        let components = factor.ncols();
        let zero = simd.splat_f64s(0.0);
        let mut violation = zero;
        for start in (0..lanes).step_by(width) {
            let here = start..start + width;
            for component in 0..components {
                let mut gradient = [zero; REGISTERS];
                let wanted = S::as_simd_f64s(&target.col_as_slice(component)[here.clone()]).0;
                for (gradient, &wanted) in gradient.iter_mut().zip(wanted) {
                    *gradient = simd.neg_f64s(wanted);
                }
                for other in 0..components {
                    let share = simd.splat_f64s(gram[(other, component)]);
                    let values = S::as_simd_f64s(&factor.col_as_slice(other)[here.clone()]).0;
                    for (gradient, &value) in gradient.iter_mut().zip(values) {
                        *gradient = simd.mul_add_e_f64s(share, value, *gradient);
                    }
                }
                let curvature = gram[(component, component)];
                // A component that is zero everywhere has no gradient either; it stays where it is.
                let inverse =
                    simd.splat_f64s(if curvature > 0.0 { curvature.recip() } else { 0.0 });
                let column = &mut factor.col_as_slice_mut(component)[here.clone()];
                let values = S::as_mut_simd_f64s(column).0;
                for (value, gradient) in values.iter_mut().zip(gradient) {
                    let is_zero = simd.equal_f64s(*value, zero);
                    let inward = simd.min_f64s(gradient, zero);
                    let projected = simd.select_f64s(is_zero, inward, gradient);
                    violation = simd.add_f64s(violation, simd.abs_f64s(projected));
                    let moved = simd.sub_f64s(*value, simd.mul_f64s(gradient, inverse));
                    *value = simd.max_f64s(moved, zero);
                }
            }
        }
        simd.reduce_sum_f64s(violation)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_sweep_equals_its_formula_row_by_row() {
        let components = 3;
        let gram = Mat::from_fn(components, components, |i, j| if i == j { 2.0 } else { 0.5 });
        let target =
            Mat::from_fn(LANES, components, |i, j| ((i * 7 + j * 3) % 11) as f64 / 4.0 - 0.5);
        let start = Mat::from_fn(LANES, components, |i, j| ((i + j) % 3) as f64);
        let mut factor = start.clone();
        let violation = sweep(gram.as_ref(), &target, &mut factor, LANES);

        let mut want_violation = 0.0;
        for row in 0..LANES {
            let mut f: Vec<f64> = (0..components).map(|t| start[(row, t)]).collect();
            for t in 0..components {
                let gradient: f64 =
                    (0..components).map(|r| gram[(t, r)] * f[r]).sum::<f64>() - target[(row, t)];
                want_violation += if f[t] > 0.0 { gradient.abs() } else { gradient.min(0.0).abs() };
                f[t] = (f[t] - gradient / gram[(t, t)]).max(0.0);
            }
            for t in 0..components {
                assert!((factor[(row, t)] - f[t]).abs() < 1e-14, "row {row}, component {t}");
            }
        }
        assert!((violation - want_violation).abs() < 1e-11);
    }
}

//! Loops over whole rows that surround the matrix products: exponential and sums.
//!
//! They are plain loops over lanes of sixteen, compiled for the widest vector instructions the machine has and chosen
//! at run time by [`vectorised`]. Sums keep sixteen partial sums and fold them in one fixed order, so a row's result
//! depends on the row alone: not on its address, its neighbours or the thread.

#![expect(clippy::inline_always, reason = "`vectorised` compiles only what is inlined into it")]

/// Partial results kept side by side; a multiple of every vector width in use.
const LANES: usize = 16;

/// Runs `work`, compiled for the widest vector instructions this machine has.
#[inline]
pub(super) fn vectorised<R>(work: impl FnOnce() -> R) -> R {
    pulp::Arch::new().dispatch(work)
}

/// Sum of `term(x)` over a row.
#[inline(always)]
pub(super) fn sum_of(row: &[f32], term: impl Fn(f32) -> f32) -> f32 {
    let (chunks, rest) = row.as_chunks::<LANES>();
    let mut lanes = [0.0_f32; LANES];
    for chunk in chunks {
        for (lane, &x) in lanes.iter_mut().zip(chunk) {
            *lane += term(x);
        }
    }
    for (lane, &x) in lanes.iter_mut().zip(rest) {
        *lane += term(x);
    }
    fold(lanes, |a, b| a + b)
}

/// Scalar product of two rows of equal length.
pub(super) fn dot(left: &[f32], right: &[f32]) -> f32 {
    vectorised(
        #[inline(always)]
        || {
            let (left_chunks, left_rest) = left.as_chunks::<LANES>();
            let (right_chunks, right_rest) = right.as_chunks::<LANES>();
            let mut lanes = [0.0_f32; LANES];
            for (a, b) in left_chunks.iter().zip(right_chunks) {
                for ((lane, &x), &y) in lanes.iter_mut().zip(a).zip(b) {
                    *lane = x.mul_add(y, *lane);
                }
            }
            for ((lane, &x), &y) in lanes.iter_mut().zip(left_rest).zip(right_rest) {
                *lane = x.mul_add(y, *lane);
            }
            fold(lanes, |a, b| a + b)
        },
    )
}

/// Replaces a row of scores, in units of ln 2, by `2^(score − largest)` and returns the sum: the softmax before its
/// division.
#[inline(always)]
pub(crate) fn exponentiate(row: &mut [f32]) -> f32 {
    let (chunks, rest) = row.as_chunks::<LANES>();
    let mut largest = [f32::NEG_INFINITY; LANES];
    for chunk in chunks {
        for (lane, &x) in largest.iter_mut().zip(chunk) {
            *lane = larger(*lane, x);
        }
    }
    for (lane, &x) in largest.iter_mut().zip(rest) {
        *lane = larger(*lane, x);
    }
    let largest = fold(largest, larger);

    let (chunks, rest) = row.as_chunks_mut::<LANES>();
    let mut sums = [0.0_f32; LANES];
    for chunk in chunks {
        for (sum, x) in sums.iter_mut().zip(chunk) {
            *x = power_of_two(*x - largest);
            *sum += *x;
        }
    }
    for (sum, x) in sums.iter_mut().zip(rest) {
        *x = power_of_two(*x - largest);
        *sum += *x;
    }
    fold(sums, |a, b| a + b)
}

#[inline(always)]
fn larger(a: f32, b: f32) -> f32 {
    if a > b { a } else { b }
}

#[inline(always)]
fn fold(lanes: [f32; LANES], combine: impl Fn(f32, f32) -> f32) -> f32 {
    let mut lanes = lanes;
    let mut width = LANES / 2;
    while width > 0 {
        for i in 0..width {
            lanes[i] = combine(lanes[i], lanes[i + width]);
        }
        width /= 2;
    }
    lanes[0]
}

/// `2^x` for `x ≤ 0`, within 2e-7 of the value; below −126 it stops at `2^-126`.
///
/// `x = n + r` with `n` whole and `|r| ≤ ½`; `2^r` is a polynomial (interpolation at the seven Chebyshev points) and
/// `2^n` is written into the exponent's bits.
#[inline(always)]
fn power_of_two(x: f32) -> f32 {
    // Adding 1.5 · 2²³ leaves no room for a fraction: the sum is rounded to a whole number.
    const ROUND: f32 = 12_582_912.0;
    let x = if x > -126.0 { x } else { -126.0 };
    let rounded = x + ROUND;
    let r = x - (rounded - ROUND);
    let fraction = POLYNOMIAL.iter().rev().skip(1).fold(POLYNOMIAL[6], |sum, &c| sum.mul_add(r, c));
    fraction * f32::from_bits((rounded.to_bits() << 23).wrapping_add(0x3f80_0000))
}

const POLYNOMIAL: [f32; 7] = [
    1.0,
    std::f32::consts::LN_2,
    0.240_226_5,
    0.055_503_27,
    0.009_618_057,
    0.001_340_042_8,
    0.000_154_614_45,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn power_of_two_is_within_two_units_in_the_last_place() {
        let mut worst = 0.0_f64;
        for step in 0..200_000 {
            let x = -(f64::from(step) * 6.2e-4) as f32;
            let exact = f64::from(x).exp2();
            worst = worst.max((f64::from(power_of_two(x)) - exact).abs() / exact);
        }
        assert!(worst < 2e-7, "{worst}");
        assert!(power_of_two(-1e30) < 2e-38);
        assert_eq!(power_of_two(0.0).to_bits(), 1.0_f32.to_bits());
    }

    #[test]
    fn exponentiate_gives_the_softmax_of_a_hand_computed_row() {
        // Scores 0, 1, 2 in units of ln 2: weights 1/4, 1/2, 1 of the largest; longer than the lanes with padding.
        let mut row = vec![0.0, 1.0, 2.0];
        let sum = exponentiate(&mut row);
        assert_eq!((row, sum.to_bits()), (vec![0.25, 0.5, 1.0], 1.75_f32.to_bits()));
    }

    #[test]
    fn sums_and_products_do_not_depend_on_the_address() {
        let numbers: Vec<f32> = (0..71).map(|i| (i as f32 * 0.37).sin()).collect();
        let reference = (dot(&numbers, &numbers), sum_of(&numbers, |x| x));
        for offset in 0..20 {
            let mut shifted = vec![0.0; offset];
            shifted.extend(&numbers);
            let row = &shifted[offset..];
            assert_eq!(dot(row, row).to_bits(), reference.0.to_bits());
            assert_eq!(sum_of(row, |x| x).to_bits(), reference.1.to_bits());
        }
    }
}

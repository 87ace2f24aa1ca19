//! Principal angles between two subspaces: how far apart their best-aligned directions are.
//!
//! With orthonormal rows P and Q, `cos θᵢ = σᵢ(P Qᵀ)`; rising, in radians, in [0, π/2]. The arc cosine is off by ε / sin θ
//! and loses half of the digits of small angles, so there the sine is used: `sin θᵢ = σᵢ(P − P QᵀQ)` (Björck & Golub 1973;
//! Knyazev & Argentati 2002). [`principal_angles`] uses it below 45°.
//!
//! For the leading n directions of two complete bases, all n at once, [`leading_subspace_angles`] needs one product
//! `C = A Bᵀ`. C is orthogonal, so by the cosine–sine decomposition its leading n × n block has, apart from 2n − M ones,
//! the singular values of the trailing (M − n) × (M − n) block, and the off-diagonal block holds the sines. So no block
//! larger than M/2 is ever decomposed, and sines only where some angle is below a thousandth: the arc cosine of all others
//! is right to 10⁻¹² radians.
//!
//! Degenerate: an empty subspace, or bodies of different size, are errors. Directions beyond the rank of the data are
//! arbitrary, and so are their angles. Oracle: `tests/analysis_parity.rs`, algorithms `principal_angles`, `pvd_pad`.

use std::cmp::Reverse;

use faer::linalg::matmul::matmul;
use faer::{Accum, Mat, MatRef, Par};

use super::small_svd::singular_values;
use super::{PrincipalComponents, SubspaceError};

/// Squared cosine above which an angle is below 45°.
const BELOW_HALF_RIGHT: f64 = 0.5;
/// Squared cosine above which an angle is below a thousandth.
const BELOW_A_THOUSANDTH: f64 = 1.0 - 1e-6;

/// Angles between the spans of the rows of `first` and of `second`, rising, in radians; as many as the smaller of the
/// two has rows. Both are row-major with `muscles` columns and orthonormal rows.
pub fn principal_angles(
    first: &[f64],
    second: &[f64],
    muscles: usize,
) -> Result<Vec<f64>, SubspaceError> {
    for directions in [first, second] {
        if muscles == 0 || !directions.len().is_multiple_of(muscles) {
            let found = directions.len() % muscles.max(1);
            return Err(SubspaceError::MuscleCount { expected: muscles, found });
        }
        if let Some(at) = directions.iter().position(|x| !x.is_finite()) {
            let (row, muscle, value) = ((at / muscles) as u64, at % muscles, directions[at]);
            return Err(SubspaceError::NotFinite { row, muscle, value });
        }
    }
    let (p, q) = (first.len() / muscles, second.len() / muscles);
    if p == 0 || q == 0 {
        return Err(SubspaceError::DirectionCount { first: p, second: q });
    }
    // Angles do not depend on the order of the two; the smaller one is taken apart.
    let (small, large) = if p <= q { (first, second) } else { (second, first) };
    let rows = |values| MatRef::from_row_major_slice(values, values_rows(values, muscles), muscles);
    let (small, large) = (rows(small), rows(large));
    let mut cosines = Mat::<f64>::zeros(small.nrows(), large.nrows());
    matmul(cosines.as_mut(), Accum::Replace, small, large.transpose(), 1.0, Par::Seq);
    let mut rest = small.to_owned();
    matmul(rest.as_mut(), Accum::Add, cosines.as_ref(), large, -1.0, Par::Seq);
    let found = angles_of(&[(cosines.as_ref(), rest.as_ref())], BELOW_HALF_RIGHT)?;
    Ok(found.into_iter().flatten().collect())
}

fn values_rows(values: &[f64], muscles: usize) -> usize {
    values.len() / muscles
}

/// Angles between the spans of the first n components of two bases, for n = 1 … M: entry n − 1 has n angles, rising, in
/// radians.
pub fn leading_subspace_angles(
    first: &PrincipalComponents,
    second: &PrincipalComponents,
) -> Result<Vec<Vec<f64>>, SubspaceError> {
    let muscles = first.muscle_count();
    if second.muscle_count() != muscles {
        let found = second.muscle_count();
        return Err(SubspaceError::MuscleCount { expected: muscles, found });
    }
    let rows = |basis| MatRef::from_row_major_slice(basis, muscles, muscles);
    let mut products = Mat::<f64>::zeros(muscles, muscles);
    let (first, second) = (rows(&first.components), rows(&second.components));
    matmul(products.as_mut(), Accum::Replace, first, second.transpose(), 1.0, Par::Seq);
    let products = products.as_ref();
    // Blocks of equal size next to each other; there are no angles but zero between all components and all.
    let mut counts: Vec<usize> = (1..muscles).collect();
    counts.sort_by_key(|&count| Reverse(count.min(muscles - count)));
    let blocks: Vec<_> = counts
        .iter()
        .map(|&count| {
            let rest = muscles - count;
            let block = |row, column, rows, columns| products.submatrix(row, column, rows, columns);
            if count <= rest {
                (block(0, 0, count, count), block(count, 0, rest, count))
            } else {
                (block(count, count, rest, rest), block(0, count, count, rest))
            }
        })
        .collect();
    let mut angles: Vec<Vec<f64>> = (1..=muscles).map(|count| vec![0.0; count]).collect();
    for (count, found) in counts.into_iter().zip(angles_of(&blocks, BELOW_A_THOUSANDTH)?) {
        angles[count - 1][count - found.len()..].copy_from_slice(&found);
    }
    Ok(angles)
}

/// Rising angles from pairs of matrices whose singular values are their cosines and sines. Sines count for angles whose
/// squared cosine is above `near`.
fn angles_of(
    pairs: &[(MatRef<'_, f64>, MatRef<'_, f64>)],
    near: f64,
) -> Result<Vec<Vec<f64>>, SubspaceError> {
    let values = |matrices: &[MatRef<'_, f64>]| {
        let muscles = matrices.iter().map(|matrix| matrix.nrows().max(matrix.ncols())).max();
        let failed = SubspaceError::NoConvergence { muscles: muscles.unwrap_or(0) };
        singular_values(matrices).ok_or(failed)
    };
    let (cosines, sines): (Vec<_>, Vec<_>) = pairs.iter().copied().unzip();
    // Cosines fall while angles rise.
    let mut angles = values(&cosines)?;
    let small: Vec<usize> = angles
        .iter()
        .map(|cosines| cosines.iter().take_while(|&&cosine| cosine * cosine > near).count())
        .collect();
    for cosine in angles.iter_mut().flatten() {
        *cosine = cosine.min(1.0).acos();
    }
    let close: Vec<usize> = (0..small.len()).filter(|&index| small[index] > 0).collect();
    let sines: Vec<_> = close.iter().map(|&index| sines[index]).collect();
    for (index, sines) in close.into_iter().zip(values(&sines)?) {
        // Sines fall while angles fall.
        for (angle, sine) in angles[index][..small[index]].iter_mut().zip(sines.iter().rev()) {
            *angle = sine.min(1.0).asin();
        }
    }
    Ok(angles)
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{Covariance, principal_components};
    use super::*;

    const MUSCLES: usize = 7;

    fn basis(rows: &[[f64; MUSCLES]]) -> PrincipalComponents {
        let mut covariance = Covariance::new(MUSCLES);
        rows.iter().for_each(|row| covariance.push_row(row).unwrap());
        principal_components(&covariance).unwrap()
    }

    #[test]
    fn a_plane_turned_about_one_axis_has_that_angle_however_small() {
        for angle in [1e-9_f64, 0.3, 1.2] {
            let first = [1.0, 0.0, 0.0, 0.0, 1.0, 0.0];
            let second = [1.0, 0.0, 0.0, 0.0, angle.cos(), angle.sin()];
            let found = principal_angles(&first, &second, 3).unwrap();
            assert!(found[0].abs() < 1e-15);
            assert!((found[1] - angle).abs() < 1e-15, "{} {angle}", found[1]);
        }
    }

    #[test]
    fn a_line_against_a_plane_has_one_angle() {
        let found = principal_angles(&[0.0, 0.6, 0.8], &[1.0, 0.0, 0.0, 0.0, 1.0, 0.0], 3).unwrap();
        assert_eq!(found.len(), 1);
        assert!((found[0] - 0.6_f64.acos()).abs() < 1e-15);
    }

    #[test]
    fn nothing_and_nan_are_refused() {
        let empty = SubspaceError::DirectionCount { first: 0, second: 1 };
        assert_eq!(principal_angles(&[], &[1.0, 0.0], 2), Err(empty));
        assert!(principal_angles(&[1.0, 0.0, 0.0], &[1.0, 0.0], 2).is_err());
        assert!(principal_angles(&[f64::NAN, 0.0], &[1.0, 0.0], 2).is_err());
        assert!(principal_angles(&[], &[], 0).is_err());
    }

    proptest! {
        #[test]
        fn the_angles_of_every_leading_subspace_are_those_of_its_directions(
            first in prop::collection::vec(prop::array::uniform7(-1.0..1.0_f64), 12..30),
            second in prop::collection::vec(prop::array::uniform7(-1.0..1.0_f64), 12..30),
        ) {
            let (first, second) = (basis(&first), basis(&second));
            let all = leading_subspace_angles(&first, &second).unwrap();
            for (index, angles) in all.iter().enumerate() {
                let length = (index + 1) * MUSCLES;
                let want = principal_angles(
                    &first.components[..length],
                    &second.components[..length],
                    MUSCLES,
                )
                .unwrap();
                prop_assert_eq!(angles.len(), want.len());
                prop_assert!(angles.is_sorted());
                for (found, want) in angles.iter().zip(&want) {
                    prop_assert!((found - want).abs() < 1e-9, "{found} {want}");
                }
            }
        }
    }
}

//! Principal angles between two subspaces: how far apart their best-aligned directions are.
//!
//! With orthonormal rows P and Q, `cos θᵢ = σᵢ(P Qᵀ)`; rising, in radians, in [0, π/2]. The arc cosine loses half of the
//! digits of small angles, so below 45° the sine is used: `sin θᵢ = σᵢ(P − P QᵀQ)` (Björck & Golub 1973; Knyazev &
//! Argentati 2002).
//!
//! For the leading n directions of two complete bases, all n at once, [`leading_subspace_angles`] needs one product
//! `C = A Bᵀ`. C is orthogonal, so by the cosine–sine decomposition its leading n × n block has, apart from 2n − M ones,
//! the singular values of the trailing (M − n) × (M − n) block, and the off-diagonal block holds the sines. So no block
//! larger than M/2 is ever decomposed.
//!
//! Degenerate: an empty subspace, or bodies of different size, are errors. Directions beyond the rank of the data are
//! arbitrary, and so are their angles. Oracle: `tests/analysis_parity.rs`, algorithms `principal_angles`, `pvd_pad`.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::matmul::matmul;
use faer::linalg::svd::{ComputeSvdVectors, svd, svd_scratch};
use faer::{Accum, Mat, MatRef, Par};

use super::{PrincipalComponents, SubspaceError};

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
    angles_of(cosines.as_ref(), rest.as_ref())
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
    (1..=muscles)
        .map(|count| {
            let rest = muscles - count;
            if count <= rest {
                let cosines = products.submatrix(0, 0, count, count);
                return angles_of(cosines, products.submatrix(count, 0, rest, count));
            }
            let mut angles = vec![0.0; count - rest];
            if rest > 0 {
                let cosines = products.submatrix(count, count, rest, rest);
                angles.extend(angles_of(cosines, products.submatrix(0, count, count, rest))?);
            }
            Ok(angles)
        })
        .collect()
}

/// Rising angles from matrices whose singular values are their cosines and sines.
fn angles_of(cosines: MatRef<'_, f64>, sines: MatRef<'_, f64>) -> Result<Vec<f64>, SubspaceError> {
    let cosines = singular_values(cosines)?;
    let is_small = |cosine: f64| cosine * cosine > 0.5;
    if !cosines.first().is_some_and(|&largest| is_small(largest)) {
        return Ok(cosines.iter().map(|cosine| cosine.clamp(0.0, 1.0).acos()).collect());
    }
    let sines = singular_values(sines)?;
    // Cosines fall while angles rise; sines fall while angles fall.
    let pairs = cosines.iter().zip(sines.iter().rev());
    let angle = |(&cosine, &sine): (&f64, &f64)| {
        let angle: f64 =
            if is_small(cosine) { sine.clamp(0.0, 1.0).asin() } else { cosine.min(1.0).acos() };
        angle
    };
    Ok(pairs.map(angle).collect())
}

/// Singular values, falling.
fn singular_values(matrix: MatRef<'_, f64>) -> Result<Vec<f64>, SubspaceError> {
    let (rows, columns) = matrix.shape();
    let mut values = Diag::<f64>::zeros(rows.min(columns));
    let none = ComputeSvdVectors::No;
    let scratch = svd_scratch::<f64>(rows, columns, none, none, Par::Seq, Default::default());
    svd(
        matrix,
        values.as_mut(),
        None,
        None,
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    )
    .map_err(|_| SubspaceError::NoConvergence { muscles: rows.max(columns) })?;
    Ok(values.column_vector().iter().copied().collect())
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

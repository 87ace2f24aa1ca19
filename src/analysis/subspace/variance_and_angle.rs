//! How different two sets of actions are: percent of variance differing (PVD) and principal angle difference (PAD).
//!
//! For the first n components of A and of B, with Σ the covariance of A:
//!
//! * `PVD(n) = 1 − tr(Bₙ Σ Bₙᵀ) / tr(Aₙ Σ Aₙᵀ)`, directed from A to B: the share of what A's own n components explain
//!   that B's components miss. In [0, 1], 0 for all components, 0 without own variance. Not symmetric;
//!   [`VarianceDifference`] names the alternatives.
//! * `PAD(n)` = mean of the n principal angles between the spans, in **degrees**, in [0, 90]; 0 for all components.
//!
//! Entry n − 1 belongs to n components. Components beyond the rank ([`PrincipalComponents::rank`]) point anywhere:
//! [`PairCurves::is_beyond_rank`].
//!
//! Degenerate: bodies of different size are an error; data without variance have no components already.
//! Oracle: `tests/analysis_parity.rs`, algorithm `pvd_pad`.

use super::{Covariance, PrincipalComponents, SubspaceError, leading_subspace_angles};

/// What "variance differing" means.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum VarianceDifference {
    /// From the first to the second, relative to what the first's own components explain.
    #[default]
    Directed,
    /// The mean of both directions.
    Symmetric,
    /// The earlier definition: own share of the total variance minus the share in the other's components.
    ShareDifference,
}

/// Which of the principal angles counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum AngleSummary {
    #[default]
    Mean,
    Largest,
    Smallest,
}

/// The two measures for every number of components.
#[derive(Debug, Clone, PartialEq)]
pub struct PairCurves {
    /// Percent of variance differing, as a share.
    pub pvd: Vec<f64>,
    /// Principal angle difference in degrees.
    pub pad: Vec<f64>,
    /// Components that have variance in both sets.
    pub common_rank: usize,
}

impl PairCurves {
    /// Whether the values for `components` components rest on directions without variance.
    #[must_use]
    pub fn is_beyond_rank(&self, components: usize) -> bool {
        components > self.common_rank
    }
}

/// One set of actions: its covariance and the components of it.
type Set<'a> = (&'a Covariance, &'a PrincipalComponents);

/// Compares the first set with the second.
pub fn compare_subspaces(
    first: Set<'_>,
    second: Set<'_>,
    difference: VarianceDifference,
    angle: AngleSummary,
) -> Result<PairCurves, SubspaceError> {
    let pvd = match difference {
        VarianceDifference::Symmetric => {
            let there = variance_difference(first, second.1, VarianceDifference::Directed)?;
            let back = variance_difference(second, first.1, VarianceDifference::Directed)?;
            there.iter().zip(&back).map(|(x, y)| f64::midpoint(*x, *y)).collect()
        }
        _ => variance_difference(first, second.1, difference)?,
    };
    let angles = leading_subspace_angles(first.1, second.1)?;
    let pad = angles.iter().map(|angles| average_angle(angles, angle)).collect();
    let common_rank = first.1.rank().min(second.1.rank());
    Ok(PairCurves { pvd, pad, common_rank })
}

/// Variance of `own` that the first n components of `other` miss, for n = 1 … M. The symmetric form needs the other
/// set's covariance and is taken as directed here.
pub fn variance_difference(
    own: Set<'_>,
    other: &PrincipalComponents,
    difference: VarianceDifference,
) -> Result<Vec<f64>, SubspaceError> {
    let (covariance, components) = own;
    let muscles = components.muscle_count();
    for found in [covariance.muscle_count(), other.muscle_count()] {
        if found != muscles {
            return Err(SubspaceError::MuscleCount { expected: muscles, found });
        }
    }
    let total: f64 = components.variances.iter().sum();
    let (mut explained, mut caught) = (0.0, 0.0);
    (0..muscles)
        .map(|index| {
            let too_few = SubspaceError::TooFewRows { found: covariance.rows() };
            explained += components.variances[index];
            caught += covariance.along(other.component(index)).ok_or(too_few)?.max(0.0);
            let scale =
                if difference == VarianceDifference::ShareDifference { total } else { explained };
            // All components explain everything; rounding may say otherwise.
            let missed = if index + 1 == muscles { 0.0 } else { explained - caught };
            Ok(if scale > 0.0 { (missed / scale).clamp(0.0, 1.0) } else { 0.0 })
        })
        .collect()
}

/// One number for several `angles` in radians, in degrees; 0 for none.
#[must_use]
pub fn average_angle(angles: &[f64], summary: AngleSummary) -> f64 {
    let angle = match summary {
        AngleSummary::Mean => angles.iter().sum::<f64>() / angles.len().max(1) as f64,
        AngleSummary::Largest => angles.iter().copied().fold(0.0, f64::max),
        AngleSummary::Smallest => angles.iter().copied().reduce(f64::min).unwrap_or(0.0),
    };
    angle.to_degrees()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::principal_components;
    use super::*;

    fn set(rows: &[[f64; 4]]) -> (Covariance, PrincipalComponents) {
        let mut covariance = Covariance::new(4);
        rows.iter().for_each(|row| covariance.push_row(row).unwrap());
        let components = principal_components(&covariance).unwrap();
        (covariance, components)
    }

    #[test]
    fn orthogonal_lines_share_nothing_until_both_directions_are_in() {
        let first = set(&[[1.0, 0.0, 0.0, 0.0], [-1.0, 0.0, 0.0, 0.0]]);
        let second = set(&[[0.0, 0.0, 3.0, 0.0], [0.0, 0.0, -3.0, 0.0]]);
        let found = compare_subspaces(
            (&first.0, &first.1),
            (&second.0, &second.1),
            VarianceDifference::Directed,
            AngleSummary::Mean,
        )
        .unwrap();
        assert!((found.pvd[0] - 1.0).abs() < 1e-15 && (found.pad[0] - 90.0).abs() < 1e-12);
        assert_eq!((found.pvd[3], found.pad[3]), (0.0, 0.0));
        assert!(!found.is_beyond_rank(1) && found.is_beyond_rank(2));
    }

    #[test]
    fn other_bodies_are_refused() {
        let first = set(&[[1.0, 0.0, 0.0, 0.0], [-1.0, 2.0, 0.0, 0.0]]);
        let mut other = Covariance::new(2);
        other.push_rows(&[1.0, 2.0, 3.0, 5.0]).unwrap();
        let components = principal_components(&other).unwrap();
        let directed = VarianceDifference::Directed;
        assert_eq!(
            variance_difference((&first.0, &first.1), &components, directed),
            Err(SubspaceError::MuscleCount { expected: 4, found: 2 })
        );
    }

    proptest! {
        #[test]
        fn a_set_differs_from_itself_by_nothing_and_from_others_by_a_share(
            first in prop::collection::vec(prop::array::uniform4(-1.0..1.0_f64), 6..30),
            second in prop::collection::vec(prop::array::uniform4(-1.0..1.0_f64), 6..30),
        ) {
            let (first, second) = (set(&first), set(&second));
            let (first, second) = ((&first.0, &first.1), (&second.0, &second.1));
            let compare = |a, b, difference| {
                compare_subspaces(a, b, difference, AngleSummary::Mean).unwrap()
            };
            let own = compare(first, first, VarianceDifference::Directed);
            prop_assert!(own.pvd.iter().all(|&x| x < 1e-12));
            prop_assert!(own.pad.iter().all(|&x| x < 1e-6));
            let there = compare(first, second, VarianceDifference::Directed);
            prop_assert!(there.pvd.iter().all(|x| (0.0..=1.0).contains(x)));
            prop_assert!(there.pad.iter().all(|x| (0.0..=90.0).contains(x)));
            let back = compare(second, first, VarianceDifference::Directed);
            for (x, y) in there.pad.iter().zip(&back.pad) {
                prop_assert!((x - y).abs() < 1e-6);
            }
            let symmetric = compare(first, second, VarianceDifference::Symmetric).pvd;
            prop_assert_eq!(symmetric, compare(second, first, VarianceDifference::Symmetric).pvd);
        }
    }
}

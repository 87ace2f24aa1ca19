//! How much of a task's variance the first components hold.
//!
//! * **Task-specific** curve, of the task's own components: `cumsum(λ) / Σλ`.
//! * **Pooled** curve of a task, of components computed from several tasks stacked: `cumsum(diag(C Σ Cᵀ)) / tr Σ`,
//!   with Σ the task's covariance about its own mean.
//!
//! No unit; entry k − 1 belongs to k components; never falls; the last entry is 1 up to rounding.
//!
//! Degenerate: a task without variance has no curve of its own (its components are an error already) and an all-zero
//! pooled curve. Oracle: `tests/analysis_parity.rs`, algorithms `cumulative_ev`, `cumulative_ev_degenerate`.

use super::{Covariance, PrincipalComponents, SubspaceError};

/// The curve of components in the data they were computed from.
#[must_use]
pub fn own_curve(components: &PrincipalComponents) -> Vec<f64> {
    shares(&components.variances, components.variances.iter().sum())
}

/// The curve of pooled `components` in the data of one task.
pub fn pooled_curve(
    components: &PrincipalComponents,
    task: &Covariance,
) -> Result<Vec<f64>, SubspaceError> {
    let muscles = components.muscle_count();
    if task.muscle_count() != muscles {
        return Err(SubspaceError::MuscleCount { expected: muscles, found: task.muscle_count() });
    }
    let too_few = SubspaceError::TooFewRows { found: task.rows() };
    let total = task.trace().ok_or(too_few.clone())?;
    let variances = (0..muscles)
        // Rounding can take a variance of zero below it, and the curve must not fall.
        .map(|index| task.along(components.component(index)).map(|variance| variance.max(0.0)))
        .collect::<Option<Vec<f64>>>()
        .ok_or(too_few)?;
    Ok(shares(&variances, total))
}

/// Mean of several tasks' curves, all tasks with equal weight; empty if there is no curve. Curves of different length
/// (another body) are averaged where all of them exist.
#[must_use]
pub fn mean_curve(curves: &[Vec<f64>]) -> Vec<f64> {
    let length = curves.iter().map(Vec::len).min().unwrap_or(0);
    (0..length)
        .map(|index| curves.iter().map(|curve| curve[index]).sum::<f64>() / curves.len() as f64)
        .collect()
}

/// The smallest number of components whose curve reaches `share`.
#[must_use]
pub fn components_reaching(curve: &[f64], share: f64) -> Option<usize> {
    curve.iter().position(|&explained| explained >= share).map(|index| index + 1)
}

fn shares(variances: &[f64], total: f64) -> Vec<f64> {
    let mut sum = 0.0;
    variances
        .iter()
        .map(|variance| {
            sum += variance;
            // The sum may exceed the trace by rounding; a share may not exceed 1.
            if total > 0.0 { (sum / total).min(1.0) } else { 0.0 }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::principal_components;
    use super::*;

    fn covariance(rows: &[[f64; 4]]) -> Covariance {
        let mut covariance = Covariance::new(4);
        rows.iter().for_each(|row| covariance.push_row(row).unwrap());
        covariance
    }

    #[test]
    fn a_task_without_variance_has_an_all_zero_pooled_curve() {
        let pooled = principal_components(&covariance(&[[1.0; 4], [2.0; 4], [0.0; 4]])).unwrap();
        let curve = pooled_curve(&pooled, &covariance(&[[5.0; 4]; 3])).unwrap();
        assert_eq!(curve, [0.0; 4]);
        assert_eq!(components_reaching(&curve, 0.5), None);
    }

    #[test]
    fn another_body_is_refused() {
        let pooled = principal_components(&covariance(&[[1.0; 4], [2.0; 4]])).unwrap();
        assert_eq!(
            pooled_curve(&pooled, &Covariance::new(6)),
            Err(SubspaceError::MuscleCount { expected: 4, found: 6 })
        );
    }

    #[test]
    fn a_curve_that_ends_at_one_reaches_every_share() {
        assert_eq!(components_reaching(&[0.5, 0.9, 1.0], 0.9), Some(2));
        assert_eq!(components_reaching(&[0.5, 0.9, 1.0], 0.91), Some(3));
    }

    proptest! {
        #[test]
        fn curves_rise_to_one_and_no_basis_beats_the_own_one(
            task in prop::collection::vec(prop::array::uniform4(-1.0..1.0_f64), 3..30),
            other in prop::collection::vec(prop::array::uniform4(-1.0..1.0_f64), 3..30),
        ) {
            let task = covariance(&task);
            let mut stacked = task.clone();
            stacked.merge(&covariance(&other)).unwrap();
            let own = own_curve(&principal_components(&task).unwrap());
            let pooled = pooled_curve(&principal_components(&stacked).unwrap(), &task).unwrap();
            for curve in [&own, &pooled] {
                prop_assert!(curve.is_sorted());
                prop_assert!((curve[3] - 1.0).abs() < 1e-12);
            }
            for (own, pooled) in own.iter().zip(&pooled) {
                prop_assert!(own + 1e-12 >= *pooled);
            }
        }
    }
}

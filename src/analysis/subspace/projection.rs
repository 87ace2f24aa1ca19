//! Control-subspace inactivation: an action squeezed into the space of the first components.
//!
//! `a' = μ + Cᵀ C (a − μ)`, with C the first `count` components (rows) and μ the mean of the data they came from.
//! Nothing is clipped. Arithmetic is in `f64`, in a fixed order: the same action gives the same bytes.
//!
//! **All components are the identity**, and here exactly so: C is then orthogonal, `CᵀC = 1`, and running the products
//! would only add rounding. The action comes back byte for byte, so the last point of a curve *is* the unprojected
//! policy and not a chaotic body's answer to its own noise of 10⁻¹⁶.
//!
//! Degenerate: no or too many components are an error when the projection is made. NaN in, NaN out.
//! Oracle: `tests/analysis_parity.rs`, algorithm `csi_project_pca`.

use super::{PrincipalComponents, SubspaceError};

/// The projection onto the first components.
#[derive(Debug, Clone, PartialEq)]
pub struct Projection {
    mean: Vec<f64>,
    /// Row-major count × muscles.
    components: Vec<f64>,
    count: usize,
}

impl Projection {
    /// Onto the first `count` of `components`, 1 to as many as there are muscles.
    pub fn new(components: &PrincipalComponents, count: usize) -> Result<Self, SubspaceError> {
        let available = components.muscle_count();
        if count == 0 || count > available {
            return Err(SubspaceError::ComponentCount { asked: count, available });
        }
        Ok(Self {
            mean: components.mean.clone(),
            components: components.components[..count * available].to_vec(),
            count,
        })
    }

    /// Number of components kept.
    #[must_use]
    pub fn count(&self) -> usize {
        self.count
    }

    /// Number of muscles, i.e. the length of an action.
    #[must_use]
    pub fn muscle_count(&self) -> usize {
        self.mean.len()
    }

    /// Length of the scratch memory that [`Self::apply`] needs.
    #[must_use]
    pub fn scratch_length(&self) -> usize {
        2 * self.muscle_count()
    }

    /// Projects `action` in place. Does not allocate.
    ///
    /// # Panics
    /// If `action` has another length than [`Self::muscle_count`] or `scratch` is shorter than
    /// [`Self::scratch_length`].
    pub fn apply(&self, action: &mut [f32], scratch: &mut [f64]) {
        if let Some(projected) = self.project(action, scratch) {
            for (value, projected) in action.iter_mut().zip(projected) {
                *value = *projected as f32;
            }
        }
    }

    /// [`Self::apply`] for actions in `f64`.
    ///
    /// # Panics
    /// As [`Self::apply`].
    pub fn apply_f64(&self, action: &mut [f64], scratch: &mut [f64]) {
        if let Some(projected) = self.project(action, scratch) {
            action.copy_from_slice(projected);
        }
    }

    /// The projected action, in a part of `scratch`; `None` if it is the action itself.
    fn project<'a, T: Copy + Into<f64>>(
        &self,
        action: &[T],
        scratch: &'a mut [f64],
    ) -> Option<&'a [f64]> {
        let muscles = self.muscle_count();
        assert_eq!(action.len(), muscles, "an action has one value per muscle");
        if self.count == muscles {
            return None;
        }
        let (deviation, rest) = scratch.split_at_mut(muscles);
        let projected = &mut rest[..muscles];
        for ((deviation, &value), mean) in deviation.iter_mut().zip(action).zip(&self.mean) {
            *deviation = value.into() - mean;
        }
        projected.copy_from_slice(&self.mean);
        for component in self.components.chunks_exact(muscles) {
            let score: f64 = component.iter().zip(&*deviation).map(|(c, d)| c * d).sum();
            for (value, weight) in projected.iter_mut().zip(component) {
                *value += score * weight;
            }
        }
        Some(projected)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::super::{Covariance, principal_components};
    use super::*;

    const MUSCLES: usize = 6;

    fn basis() -> PrincipalComponents {
        let mut covariance = Covariance::new(MUSCLES);
        for t in 0..50 {
            let row: [f64; MUSCLES] = std::array::from_fn(|m| {
                (f64::from(t) * 0.37 * (m as f64 + 1.0)).sin() / (m as f64 + 1.0)
            });
            covariance.push_row(&row).unwrap();
        }
        principal_components(&covariance).unwrap()
    }

    #[test]
    fn all_components_return_the_input_bytes() {
        let projection = Projection::new(&basis(), MUSCLES).unwrap();
        let action = [0.1_f32, -0.7, f32::MIN_POSITIVE, 1e30, -0.0, 0.3];
        let mut projected = action;
        projection.apply(&mut projected, &mut vec![0.0; projection.scratch_length()]);
        assert_eq!(projected.map(f32::to_bits), action.map(f32::to_bits));
    }

    #[test]
    fn zero_and_too_many_components_are_refused() {
        for asked in [0, MUSCLES + 1] {
            assert_eq!(
                Projection::new(&basis(), asked),
                Err(SubspaceError::ComponentCount { asked, available: MUSCLES })
            );
        }
    }

    #[test]
    fn the_mean_is_where_it_was() {
        let basis = basis();
        let projection = Projection::new(&basis, 1).unwrap();
        let mut action = basis.mean.clone();
        projection.apply_f64(&mut action, &mut vec![0.0; projection.scratch_length()]);
        assert_eq!(action, basis.mean);
    }

    proptest! {
        #[test]
        fn projecting_twice_is_projecting_once_and_never_moves_away_from_the_mean(
            action in prop::array::uniform6(-3.0..3.0_f64),
            count in 1..=MUSCLES,
        ) {
            let basis = basis();
            let projection = Projection::new(&basis, count).unwrap();
            let mut scratch = vec![0.0; projection.scratch_length()];
            let mut once = action;
            projection.apply_f64(&mut once, &mut scratch);
            let mut twice = once;
            projection.apply_f64(&mut twice, &mut scratch);
            let distance = |a: &[f64], b: &[f64]| -> f64 {
                a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum::<f64>().sqrt()
            };
            prop_assert!(distance(&once, &twice) < 1e-12);
            prop_assert!(
                distance(&once, &basis.mean) <= distance(&action, &basis.mean) + 1e-12
            );
        }
    }
}

//! Kinematic dimensionality: in how many directions joint angles and their velocities vary.
//!
//! Angles of all episodes are stacked; velocities are the differences between two steps of one episode, so each episode
//! has one row fewer. The principal components of the covariance (centred, not scaled) hold shares λᵢ / Σλ of the
//! variance. N(θ) is the smallest number of components whose shares sum to at least θ; the apparent dimensionality is
//! `(N(0.85) + N(0.95)) / 2`. A count of directions; angles in rad, velocities in rad per step.
//!
//! Beside it stand the values of human hands rotating two balls, from 20 joint angles; a policy of the same hand has 23,
//! so the numbers are near, not equal, in kind.
//!
//! Degenerate: no variance, fewer than two rows, overflow, and episodes with other numbers of joints are errors. An
//! episode of one step has no velocity.
//!
//! Reference: Todorov & Ghahramani 2004, Tables 1 and 2, rows *Ball*, scaling by angle. Oracle:
//! `tests/signals_parity.rs`, algorithms `kinematic_dimensionality`, `count_above`.

use serde::Serialize;

use super::signal::Rows;
use super::subspace::{
    Covariance, SubspaceError, components_reaching, own_curve, principal_components,
};

/// Shares of the variance whose component counts are averaged.
pub const SHARES: [f64; 2] = [0.85, 0.95];

/// What is looked at.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Quantity {
    Position,
    Velocity,
}

/// Human values: number of joints, N(0.85), N(0.95).
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct HumanDimensionality {
    pub quantity: Quantity,
    pub n_joints: usize,
    pub dim_85: usize,
    pub dim_95: usize,
}

impl HumanDimensionality {
    /// The apparent dimensionality.
    #[must_use]
    pub fn average(&self) -> f64 {
        average(self.dim_85, self.dim_95)
    }
}

/// Todorov & Ghahramani 2004, Tables 1 and 2, rows *Ball*.
pub const HUMAN: [HumanDimensionality; 2] = [
    HumanDimensionality { quantity: Quantity::Position, n_joints: 20, dim_85: 3, dim_95: 7 },
    HumanDimensionality { quantity: Quantity::Velocity, n_joints: 20, dim_85: 4, dim_95: 8 },
];

/// The dimensionality of positions or velocities.
#[derive(Debug, Clone, PartialEq)]
pub struct KinematicDimensionality {
    pub quantity: Quantity,
    /// Cumulative share of the first 1, 2, … components.
    pub cumulative: Vec<f64>,
    pub dim_85: usize,
    pub dim_95: usize,
    pub episodes: usize,
    /// Number of stacked rows.
    pub rows: u64,
}

impl KinematicDimensionality {
    /// The apparent dimensionality.
    #[must_use]
    pub fn average(&self) -> f64 {
        average(self.dim_85, self.dim_95)
    }
}

fn average(dim_85: usize, dim_95: usize) -> f64 {
    (dim_85 + dim_95) as f64 / 2.0
}

/// The dimensionality of `quantity` over `episodes` of joint angles in rad (steps × joints).
pub fn kinematic_dimensionality(
    episodes: &[Rows<'_>],
    quantity: Quantity,
) -> Result<KinematicDimensionality, SubspaceError> {
    let joints = episodes.first().map_or(0, Rows::columns);
    let mut covariance = Covariance::new(joints);
    let mut velocity = vec![0.0; joints];
    for episode in episodes {
        if episode.columns() != joints {
            let (expected, found) = (joints, episode.columns());
            return Err(SubspaceError::MuscleCount { expected, found });
        }
        match quantity {
            Quantity::Position => covariance.push_rows(episode.values())?,
            Quantity::Velocity => {
                for (earlier, later) in episode.iter().zip(episode.iter().skip(1)) {
                    let pairs = velocity.iter_mut().zip(earlier.iter().zip(later));
                    pairs.for_each(|(velocity, (earlier, later))| *velocity = later - earlier);
                    covariance.push_row(&velocity)?;
                }
            }
        }
    }
    let components = principal_components(&covariance)?;
    let cumulative = own_curve(&components);
    let reaching = |share| components_reaching(&cumulative, share).unwrap_or(joints);
    Ok(KinematicDimensionality {
        quantity,
        dim_85: reaching(SHARES[0]),
        dim_95: reaching(SHARES[1]),
        cumulative,
        episodes: episodes.len(),
        rows: covariance.rows(),
    })
}

/// A row of `dimensionality.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct DimensionalityRow {
    pub policy: String,
    pub task: String,
    pub quantity: Quantity,
    pub dim_85: usize,
    pub dim_95: usize,
    pub avg_dim: f64,
    pub n_episodes: usize,
    pub n_timesteps: u64,
    pub n_joints: usize,
}

/// A row of `cumulative_variance.csv`.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct CumulativeVarianceRow {
    pub policy: String,
    pub task: String,
    pub quantity: Quantity,
    /// 1 for the first.
    pub component: usize,
    pub cumulative_variance: f64,
}

impl KinematicDimensionality {
    /// The row of `dimensionality.csv`.
    #[must_use]
    pub fn row(&self, policy: &str, task: &str) -> DimensionalityRow {
        DimensionalityRow {
            policy: policy.to_owned(),
            task: task.to_owned(),
            quantity: self.quantity,
            dim_85: self.dim_85,
            dim_95: self.dim_95,
            avg_dim: self.average(),
            n_episodes: self.episodes,
            n_timesteps: self.rows,
            n_joints: self.cumulative.len(),
        }
    }

    /// The rows of `cumulative_variance.csv`.
    #[must_use]
    pub fn cumulative_rows(&self, policy: &str, task: &str) -> Vec<CumulativeVarianceRow> {
        let row = |(index, &cumulative_variance): (usize, &f64)| CumulativeVarianceRow {
            policy: policy.to_owned(),
            task: task.to_owned(),
            quantity: self.quantity,
            component: index + 1,
            cumulative_variance,
        };
        self.cumulative.iter().enumerate().map(row).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two episodes in which joint 0 moves and joint 1 jumps only from one episode to the other.
    const EPISODES: [[f64; 6]; 2] =
        [[0.0, 0.0, 1.0, 0.0, 2.0, 0.0], [0.0, 9.0, 1.5, 9.0, 2.0, 9.0]];

    fn of(quantity: Quantity) -> KinematicDimensionality {
        let episodes = EPISODES.each_ref().map(|values| Rows::new(values, 2).unwrap());
        kinematic_dimensionality(&episodes, quantity).unwrap()
    }

    #[test]
    fn a_jump_between_episodes_is_no_velocity() {
        let (positions, velocities) = (of(Quantity::Position), of(Quantity::Velocity));
        assert_eq!((positions.rows, velocities.rows), (6, 4));
        assert!(positions.cumulative[0] < 1.0 - 1e-3);
        assert_eq!((velocities.dim_85, velocities.dim_95), (1, 1));
        assert_eq!(velocities.cumulative_rows("a", "b").len(), 2);
        assert!((velocities.row("a", "b").avg_dim - 1.0).abs() < 1e-15);
    }

    #[test]
    fn human_hands_have_five_and_six_dimensions() {
        let found = HUMAN.map(|human| human.average());
        assert!((found[0] - 5.0).abs() < 1e-15 && (found[1] - 6.0).abs() < 1e-15);
    }

    #[test]
    fn joints_that_never_move_and_other_hands_are_typed_errors() {
        let still = [Rows::new(&[0.5; 12], 3).unwrap()];
        for quantity in [Quantity::Position, Quantity::Velocity] {
            let found = kinematic_dimensionality(&still, quantity).unwrap_err();
            assert!(matches!(found, SubspaceError::NoVariance { .. }));
        }
        assert_eq!(
            kinematic_dimensionality(&[], Quantity::Position),
            Err(SubspaceError::TooFewRows { found: 0 })
        );
        let mixed = [Rows::new(&[0.5; 12], 3).unwrap(), Rows::new(&[0.5; 12], 2).unwrap()];
        assert_eq!(
            kinematic_dimensionality(&mixed, Quantity::Position),
            Err(SubspaceError::MuscleCount { expected: 3, found: 2 })
        );
        let one_step = [Rows::new(&[0.5; 3], 3).unwrap()];
        assert_eq!(
            kinematic_dimensionality(&one_step, Quantity::Velocity),
            Err(SubspaceError::TooFewRows { found: 0 })
        );
    }
}

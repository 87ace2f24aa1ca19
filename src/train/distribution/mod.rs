//! Distributions of actions around a mean, and the derivatives of what a loss asks of them.
//!
//! A loss asks three things: the logarithm of an action's density, the entropy, and an action drawn by given normal
//! numbers. Each has a `pull`: given the loss's derivative by its result, it adds the derivatives by the mean and by the
//! distribution's own numbers (`own`), whose meaning and number the distribution says. Sums are in double precision.

mod gaussian;
mod lattice;

pub use gaussian::Gaussian;
pub use lattice::{Lattice, LatticeShape};

/// `ln √(2π)`.
pub(super) const HALF_LOG_TAU: f64 = 0.918_938_533_204_672_7;

/// A distribution whose spread is known and whose mean is given with every question.
pub trait Distribution {
    /// Logarithm of the density at `action`.
    fn log_probability(&self, mean: &[f32], action: &[f32]) -> f64;

    /// The distribution's entropy.
    fn entropy(&self) -> f64;

    /// Writes the action that the normal numbers in `noise` draw.
    fn draw(&self, mean: &[f32], noise: &[f32], action: &mut [f32]);

    /// `slope` is the loss's derivative by the log-probability of `action`.
    fn pull_log_probability(
        &self,
        mean: &[f32],
        action: &[f32],
        slope: f64,
        mean_gradient: &mut [f32],
        own: &mut [f32],
    );

    /// `slope` is the loss's derivative by the entropy.
    fn pull_entropy(&self, slope: f64, own: &mut [f32]);

    /// `slopes` are the loss's derivatives by the action that `noise` draws.
    fn pull_draw(&self, noise: &[f32], slopes: &[f32], mean_gradient: &mut [f32], own: &mut [f32]);
}

//! Noise on the latent vector as well as on the muscles, the same in every state (`spec/policy.md` §4.3).
//!
//! With φ the latent vector before the last layer, W that layer's weight, s and t fixed scales per muscle and per latent
//! component: action `W(φ + t ξ') + b + s ξ`, a normal distribution with covariance `Σ = W diag(t²) Wᵀ + diag(s²)`.
//! Σ is the same for a whole minibatch. So it is factored once; samples only add up the derivative by Σ, and
//! [`Lattice::finish`] turns that into the derivatives by W, s and t.

use super::{Distribution, HALF_LOG_TAU};

/// Sizes of the problem.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct LatticeShape {
    pub muscles: usize,
    pub latents: usize,
}

impl LatticeShape {
    /// How many numbers of its own a lattice has while samples are summed: muscles × muscles of the derivative by Σ, one
    /// that counts how much of Σ⁻¹ is to be added to it, then the derivatives by `ln s`, `ln t` and W through draws.
    #[must_use]
    pub fn own_length(self) -> usize {
        let Self { muscles, latents } = self;
        muscles * muscles + 1 + muscles + latents + muscles * latents
    }

    /// Positions of those five parts.
    fn parts(self, own: &mut [f32]) -> [&mut [f32]; 5] {
        let Self { muscles, latents } = self;
        let (covariance, rest) = own.split_at_mut(muscles * muscles);
        let (inverse, rest) = rest.split_at_mut(1);
        let (muscle, rest) = rest.split_at_mut(muscles);
        let (latent, weight) = rest.split_at_mut(latents);
        [covariance, inverse, muscle, latent, weight]
    }
}

/// The distribution for one set of parameters.
#[derive(Debug, Clone)]
pub struct Lattice {
    shape: LatticeShape,
    muscle_deviations: Vec<f64>,
    latent_deviations: Vec<f64>,
    /// Muscles × latents.
    weight: Vec<f64>,
    /// `Σ⁻¹`, muscles × muscles.
    inverse: Vec<f64>,
    log_determinant: f64,
}

impl Lattice {
    /// `log_deviations` holds the logarithms of s, then of t; `weight` is the last layer's, muscles × latents.
    #[must_use]
    pub fn new(muscles: usize, weight: &[f32], log_deviations: &[f32], log_scale: f64) -> Self {
        let shape = LatticeShape { muscles, latents: log_deviations.len() - muscles };
        let mut muscle_deviations: Vec<f64> =
            log_deviations.iter().map(|&log| (f64::from(log) + log_scale).exp()).collect();
        let latent_deviations = muscle_deviations.split_off(muscles);
        let weight: Vec<f64> = weight.iter().map(|&w| f64::from(w)).collect();
        let mut covariance = vec![0.0; muscles * muscles];
        for (i, a) in weight.chunks_exact(shape.latents.max(1)).enumerate() {
            for (j, b) in weight.chunks_exact(shape.latents.max(1)).enumerate().take(i + 1) {
                let terms =
                    a.iter().zip(b).zip(&latent_deviations).map(|((a, b), t)| a * b * t * t);
                let sum: f64 = terms.sum();
                covariance[i * muscles + j] = sum;
                covariance[j * muscles + i] = sum;
            }
        }
        for (i, s) in muscle_deviations.iter().enumerate() {
            covariance[i * muscles + i] += s * s;
        }
        let (inverse, log_determinant) = invert(covariance, muscles);
        Self { shape, muscle_deviations, latent_deviations, weight, inverse, log_determinant }
    }

    #[must_use]
    pub fn shape(&self) -> LatticeShape {
        self.shape
    }

    /// Turns what samples have summed in `own` into derivatives, added to those by the last layer's weight and by the
    /// logarithms of s and t.
    pub fn finish(&self, own: &mut [f32], weight_gradient: &mut [f32], log_gradient: &mut [f32]) {
        let LatticeShape { muscles, latents } = self.shape;
        let [covariance, inverse, muscle, latent, weight] = self.shape.parts(own);
        let share = f64::from(inverse[0]);
        let by_covariance: Vec<f64> = covariance
            .iter()
            .zip(&self.inverse)
            .map(|(&sum, inverse)| f64::from(sum) + share * inverse)
            .collect();
        for (i, s) in self.muscle_deviations.iter().enumerate() {
            let slope = 2.0 * s * s * by_covariance[i * muscles + i];
            log_gradient[i] += slope as f32 + muscle[i];
        }
        // The derivative by Σ times W: muscles × latents.
        let mut product = vec![0.0; muscles * latents];
        for (row, derivatives) in
            product.chunks_exact_mut(latents.max(1)).zip(by_covariance.chunks_exact(muscles))
        {
            for (derivative, weights) in
                derivatives.iter().zip(self.weight.chunks_exact(latents.max(1)))
            {
                row.iter_mut().zip(weights).for_each(|(p, w)| *p += derivative * w);
            }
        }
        for (k, t) in self.latent_deviations.iter().enumerate() {
            let column = |matrix: &[f64], row: usize| matrix[row * latents + k];
            let along: f64 =
                (0..muscles).map(|i| column(&self.weight, i) * column(&product, i)).sum();
            log_gradient[muscles + k] += (2.0 * t * t * along) as f32 + latent[k];
            for i in 0..muscles {
                let slope = 2.0 * t * t * column(&product, i);
                weight_gradient[i * latents + k] += slope as f32 + weight[i * latents + k];
            }
        }
    }

    /// `Σ⁻¹ (a − μ)`.
    fn solved(&self, mean: &[f32], action: &[f32]) -> (Vec<f64>, Vec<f64>) {
        let difference: Vec<f64> =
            action.iter().zip(mean).map(|(&a, &m)| f64::from(a) - f64::from(m)).collect();
        let rows = self.inverse.chunks_exact(self.shape.muscles);
        let solved =
            rows.map(|row| row.iter().zip(&difference).map(|(a, b)| a * b).sum()).collect();
        (difference, solved)
    }
}

impl Distribution for Lattice {
    fn log_probability(&self, mean: &[f32], action: &[f32]) -> f64 {
        let (difference, solved) = self.solved(mean, action);
        let square: f64 = difference.iter().zip(&solved).map(|(a, b)| a * b).sum();
        -0.5 * (square + self.log_determinant) - HALF_LOG_TAU * mean.len() as f64
    }

    fn entropy(&self) -> f64 {
        0.5 * self.log_determinant + (0.5 + HALF_LOG_TAU) * self.shape.muscles as f64
    }

    /// `noise` holds one number for each muscle, then one for each latent component.
    fn draw(&self, mean: &[f32], noise: &[f32], action: &mut [f32]) {
        let (muscles, latents) = noise.split_at(self.shape.muscles);
        let rows = self.weight.chunks_exact(self.shape.latents.max(1));
        for ((((action, &mean), s), &xi), row) in
            action.iter_mut().zip(mean).zip(&self.muscle_deviations).zip(muscles).zip(rows)
        {
            let terms = row.iter().zip(&self.latent_deviations).zip(latents);
            let correlated: f64 = terms.map(|((w, t), &xi)| w * t * f64::from(xi)).sum();
            *action = mean + (s * f64::from(xi) + correlated) as f32;
        }
    }

    fn pull_log_probability(
        &self,
        mean: &[f32],
        action: &[f32],
        slope: f64,
        mean_gradient: &mut [f32],
        own: &mut [f32],
    ) {
        let (_, solved) = self.solved(mean, action);
        let [covariance, inverse, ..] = self.shape.parts(own);
        inverse[0] -= (0.5 * slope) as f32;
        for (m, y) in mean_gradient.iter_mut().zip(&solved) {
            *m += (slope * y) as f32;
        }
        for (row, y) in covariance.chunks_exact_mut(self.shape.muscles).zip(&solved) {
            row.iter_mut().zip(&solved).for_each(|(c, x)| *c += (0.5 * slope * x * y) as f32);
        }
    }

    fn pull_entropy(&self, slope: f64, own: &mut [f32]) {
        self.shape.parts(own)[1][0] += (0.5 * slope) as f32;
    }

    fn pull_draw(&self, noise: &[f32], slopes: &[f32], mean_gradient: &mut [f32], own: &mut [f32]) {
        let latents = self.shape.latents;
        let [_, _, muscle, latent, weight] = self.shape.parts(own);
        let (muscle_noise, latent_noise) = noise.split_at(self.shape.muscles);
        for (i, &slope) in slopes.iter().enumerate() {
            mean_gradient[i] += slope;
            muscle[i] += slope * self.muscle_deviations[i] as f32 * muscle_noise[i];
            for (k, &xi) in latent_noise.iter().enumerate() {
                let drawn = slope * self.latent_deviations[k] as f32 * xi;
                latent[k] += drawn * self.weight[i * latents + k] as f32;
                weight[i * latents + k] += drawn;
            }
        }
    }
}

/// Inverse and logarithm of the determinant of a positive definite matrix, by its Cholesky factor.
fn invert(mut matrix: Vec<f64>, size: usize) -> (Vec<f64>, f64) {
    // The factor, in the lower triangle.
    for i in 0..size {
        for j in 0..=i {
            let known: f64 = (0..j).map(|k| matrix[i * size + k] * matrix[j * size + k]).sum();
            let rest = matrix[i * size + j] - known;
            matrix[i * size + j] = if i == j { rest.sqrt() } else { rest / matrix[j * size + j] };
        }
    }
    let log_determinant = 2.0 * (0..size).map(|i| matrix[i * size + i].ln()).sum::<f64>();
    let mut inverse = vec![0.0; size * size];
    for column in 0..size {
        let mut x = vec![0.0; size];
        for i in column..size {
            let known: f64 = (column..i).map(|k| matrix[i * size + k] * x[k]).sum();
            let one = if i == column { 1.0 } else { 0.0 };
            x[i] = (one - known) / matrix[i * size + i];
        }
        for i in (0..size).rev() {
            let known: f64 = (i + 1..size).map(|k| matrix[k * size + i] * x[k]).sum();
            x[i] = (x[i] - known) / matrix[i * size + i];
        }
        for (i, x) in x.into_iter().enumerate() {
            inverse[i * size + column] = x;
        }
    }
    (inverse, log_determinant)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::train::distribution::Gaussian;

    #[test]
    fn without_latent_noise_it_is_a_gaussian() {
        let logs = [0.2, -0.4, -80.0, -80.0, -80.0];
        let lattice = Lattice::new(2, &[1.0, 2.0, 3.0, 4.0, 5.0, 6.0], &logs, 0.0);
        let gaussian = Gaussian { log_deviations: &logs[..2] };
        let (mean, action) = ([0.1, 0.2], [0.9, -0.4]);
        let difference =
            lattice.log_probability(&mean, &action) - gaussian.log_probability(&mean, &action);
        assert!(difference.abs() < 1e-9);
        assert!((lattice.entropy() - gaussian.entropy()).abs() < 1e-9);
    }

    #[test]
    fn one_muscle_by_hand() {
        // Σ = 3²·½² + 2² = 6.25, so the deviation is 2.5.
        let logs = [2.0_f32.ln(), 0.5_f32.ln()];
        let lattice = Lattice::new(1, &[3.0], &logs, 0.0);
        let gaussian = Gaussian { log_deviations: &[2.5_f32.ln()] };
        let (mean, action) = ([1.0], [-0.5]);
        let difference =
            lattice.log_probability(&mean, &action) - gaussian.log_probability(&mean, &action);
        assert!(difference.abs() < 1e-6);
        let mut drawn = [0.0];
        lattice.draw(&mean, &[0.5, -1.0], &mut drawn);
        assert!((drawn[0] - (1.0 + 1.0 - 1.5)).abs() < 1e-6);
    }
}

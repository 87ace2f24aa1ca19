//! Independent normal distributions, one for each muscle (`spec/policy.md` §1.9).
//!
//! `ln p(a) = Σ −(a − μ)²/(2σ²) − ln σ − ½ ln 2π`, entropy `Σ ½ + ½ ln 2π + ln σ`, action `μ + σ ξ`. Its own numbers are
//! the `ln σ`.

use super::{Distribution, HALF_LOG_TAU};

/// Independent normal distributions with these logarithms of their standard deviations.
#[derive(Debug, Clone, Copy)]
pub struct Gaussian<'a> {
    pub log_deviations: &'a [f32],
}

impl Gaussian<'_> {
    /// `(a − μ)/σ` and σ of every muscle.
    fn scaled<'b>(
        &'b self,
        mean: &'b [f32],
        action: &'b [f32],
    ) -> impl Iterator<Item = (f64, f64)> + 'b {
        let differences = action.iter().zip(mean).map(|(&a, &m)| f64::from(a) - f64::from(m));
        differences.zip(self.log_deviations).map(|(difference, &log)| {
            let deviation = f64::from(log).exp();
            (difference / deviation, deviation)
        })
    }

    fn sum_of_logarithms(&self) -> f64 {
        self.log_deviations.iter().map(|&log| f64::from(log)).sum()
    }
}

impl Distribution for Gaussian<'_> {
    fn log_probability(&self, mean: &[f32], action: &[f32]) -> f64 {
        let squares: f64 = self.scaled(mean, action).map(|(z, _)| z * z).sum();
        -0.5 * squares - self.sum_of_logarithms() - HALF_LOG_TAU * mean.len() as f64
    }

    fn entropy(&self) -> f64 {
        self.sum_of_logarithms() + (0.5 + HALF_LOG_TAU) * self.log_deviations.len() as f64
    }

    fn draw(&self, mean: &[f32], noise: &[f32], action: &mut [f32]) {
        let deviations = self.log_deviations.iter().map(|log| log.exp());
        for (((action, &mean), deviation), &xi) in
            action.iter_mut().zip(mean).zip(deviations).zip(noise)
        {
            *action = mean + deviation * xi;
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
        for (((z, deviation), m), o) in self.scaled(mean, action).zip(mean_gradient).zip(own) {
            *m += (slope * z / deviation) as f32;
            *o += (slope * (z * z - 1.0)) as f32;
        }
    }

    fn pull_entropy(&self, slope: f64, own: &mut [f32]) {
        own.iter_mut().for_each(|o| *o += slope as f32);
    }

    fn pull_draw(&self, noise: &[f32], slopes: &[f32], mean_gradient: &mut [f32], own: &mut [f32]) {
        let deviations = self.log_deviations.iter().map(|log| log.exp());
        for ((((&slope, m), o), deviation), &xi) in
            slopes.iter().zip(mean_gradient).zip(own).zip(deviations).zip(noise)
        {
            *m += slope;
            *o += slope * deviation * xi;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_standard_normal_has_its_textbook_density_and_entropy() {
        let gaussian = Gaussian { log_deviations: &[0.0, 2.0_f32.ln()] };
        let density = gaussian.log_probability(&[0.0, 1.0], &[1.0, 1.0]);
        let tau = std::f64::consts::TAU;
        assert!((density - (-0.5 - 2.0_f64.ln() - tau.ln())).abs() < 1e-6);
        let entropy = 1.0 + tau.ln() + 2.0_f64.ln();
        assert!((gaussian.entropy() - entropy).abs() < 1e-6);
    }

    #[test]
    fn a_draw_of_nothing_is_the_mean() {
        let mut action = [0.0; 2];
        let gaussian = Gaussian { log_deviations: &[0.5, -1.0] };
        gaussian.draw(&[0.25, -0.5], &[0.0, 0.0], &mut action);
        assert_eq!(action.map(f32::to_bits), [0.25_f32, -0.5].map(f32::to_bits));
    }
}

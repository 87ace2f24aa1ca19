//! Scaling of rewards by the spread of discounted returns (`spec/training.md` §5.4).
//!
//! Every environment keeps `R ← γ R + r` of its raw rewards. Environments with the same identifier form a group; a group's
//! mean and variance of R grow by the parallel formula from mean 0, variance 1, count 1e-4. A reward becomes
//! `clip(r/√(variance + 1e-8), ±10)`: no mean is taken away. R is set to 0 where an episode ended.

use super::TrainError;

/// Weight of the prior.
const PRIOR_COUNT: f64 = 1e-4;
/// Added to a variance.
const EPSILON: f64 = 1e-8;
/// Scaled rewards lie between plus and minus this.
const CLIP: f64 = 10.0;

/// Statistics of the returns of one group.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Returns {
    pub mean: f64,
    pub variance: f64,
    pub count: f64,
}

/// The returns of all environments and their groups.
#[derive(Debug, Clone, PartialEq)]
pub struct RewardNormaliser {
    discount: f64,
    /// Group of every environment.
    groups: Vec<usize>,
    /// Identifier of every group.
    identifiers: Vec<String>,
    statistics: Vec<Returns>,
    /// R of every environment.
    returns: Vec<f64>,
}

impl RewardNormaliser {
    /// For environments with these identifiers.
    #[must_use]
    pub fn new(discount: f64, identifiers: &[&str]) -> Self {
        let mut known: Vec<&str> = Vec::new();
        let groups = identifiers
            .iter()
            .map(|identifier| {
                known.iter().position(|k| k == identifier).unwrap_or_else(|| {
                    known.push(identifier);
                    known.len() - 1
                })
            })
            .collect();
        let prior = Returns { mean: 0.0, variance: 1.0, count: PRIOR_COUNT };
        Self {
            discount,
            groups,
            statistics: vec![prior; known.len()],
            identifiers: known.into_iter().map(str::to_owned).collect(),
            returns: vec![0.0; identifiers.len()],
        }
    }

    /// Gives the group with this identifier, if it is there, the statistics of a run before.
    pub fn set(&mut self, identifier: &str, returns: Returns) {
        if let Some(group) = self.identifiers.iter().position(|known| known == identifier) {
            self.statistics[group] = returns;
        }
    }

    /// Statistics by group, in the order in which identifiers are first met.
    #[must_use]
    pub fn statistics(&self) -> &[Returns] {
        &self.statistics
    }

    /// R of every environment.
    #[must_use]
    pub fn returns(&self) -> &[f64] {
        &self.returns
    }

    /// Goes on from what [`Self::statistics`] and [`Self::returns`] gave.
    pub fn restore(
        &mut self,
        statistics: Vec<Returns>,
        returns: Vec<f64>,
    ) -> Result<(), TrainError> {
        let numbers = statistics.iter().flat_map(|s| [s.mean, s.variance, s.count]);
        let usable = numbers.chain(returns.iter().copied()).all(f64::is_finite)
            && statistics.iter().all(|s| s.variance >= 0.0 && s.count > 0.0);
        if !usable
            || statistics.len() != self.statistics.len()
            || returns.len() != self.returns.len()
        {
            return Err(TrainError::State { what: "statistics of rewards".to_owned() });
        }
        (self.statistics, self.returns) = (statistics, returns);
        Ok(())
    }

    /// Takes in one step of all environments. From then on [`Self::scale`] knows of it.
    pub fn update(&mut self, rewards: &[f64]) {
        for (r, reward) in self.returns.iter_mut().zip(rewards) {
            *r = *r * self.discount + reward;
        }
        for (group, statistics) in self.statistics.iter_mut().enumerate() {
            let members = || {
                self.groups.iter().zip(&self.returns).filter(|(g, _)| **g == group).map(|(_, r)| *r)
            };
            let count = members().count() as f64;
            let mean = members().sum::<f64>() / count;
            let squares: f64 = members().map(|r| (r - mean).powi(2)).sum();
            let Returns { mean: before, variance, count: known } = *statistics;
            let (delta, total) = (mean - before, known + count);
            *statistics = Returns {
                mean: before + delta * count / total,
                variance: (variance * known + squares + delta * delta * known * count / total)
                    / total,
                count: total,
            };
        }
    }

    /// The scaled reward of one environment.
    #[must_use]
    pub fn scale(&self, environment: usize, reward: f64) -> f64 {
        let variance = self.statistics[self.groups[environment]].variance;
        (reward / (variance + EPSILON).sqrt()).clamp(-CLIP, CLIP)
    }

    /// The reward scaled by the mean of all groups' variances, whatever environment it is of.
    #[must_use]
    pub fn scale_by_mean(&self, reward: f64) -> f64 {
        let sum: f64 = self.statistics.iter().map(|group| group.variance).sum();
        let variance = sum / self.statistics.len() as f64;
        (reward / (variance + EPSILON).sqrt()).clamp(-CLIP, CLIP)
    }

    /// An episode of this environment is over.
    pub fn end_episode(&mut self, environment: usize) {
        self.returns[environment] = 0.0;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn two_steps_of_two_environments_by_hand() {
        let mut normaliser = RewardNormaliser::new(0.5, &["a", "a"]);
        normaliser.update(&[1.0, 3.0]);
        // Returns 1 and 3: mean 2, squares 2; the prior weighs 1e-4.
        let total = 2.0001;
        let mean = 4.0 / total;
        let variance = (1e-4 + 2.0 + 4.0 * 1e-4 * 2.0 / total) / total;
        let got = normaliser.statistics()[0];
        assert!((got.mean - mean).abs() < 1e-12 && (got.variance - variance).abs() < 1e-12);
        assert!((normaliser.scale(0, 1.0) - 1.0 / (variance + 1e-8).sqrt()).abs() < 1e-12);
        normaliser.end_episode(1);
        normaliser.update(&[2.0, 4.0]);
        assert_eq!(normaliser.returns(), [2.5, 4.0]);
        // All four returns and the prior: 1, 3, 2.5, 4.
        let total = 4.0001;
        let mean = 10.5 / total;
        let squares = 1e-4 + 1.0 + 9.0 + 6.25 + 16.0;
        let got = normaliser.statistics()[0];
        assert!((got.mean - mean).abs() < 1e-12);
        assert!((got.variance - (squares / total - mean * mean)).abs() < 1e-12);
    }

    #[test]
    fn groups_are_scaled_on_their_own_and_large_rewards_are_clipped() {
        let mut normaliser = RewardNormaliser::new(0.9, &["a", "b", "a"]);
        for _ in 0..50 {
            normaliser.update(&[1.0, 100.0, -1.0]);
        }
        assert_eq!(normaliser.statistics().len(), 2);
        assert!(normaliser.scale(1, 1.0) < 0.1 * normaliser.scale(0, 1.0));
        assert!((normaliser.scale(0, 1e9) - 10.0).abs() < 1e-12);
        assert!((normaliser.scale(0, -1e9) + 10.0).abs() < 1e-12);
        let [first, second] = [0, 1].map(|group| normaliser.statistics()[group].variance);
        let expected = 0.5 / (f64::midpoint(first, second) + 1e-8).sqrt();
        assert!((normaliser.scale_by_mean(0.5) - expected).abs() < 1e-12);
    }

    #[test]
    fn a_restored_normaliser_goes_on_bit_by_bit_and_a_broken_one_is_refused() {
        let mut one = RewardNormaliser::new(0.9, &["a", "b"]);
        one.update(&[0.3, -0.2]);
        let mut other = RewardNormaliser::new(0.9, &["a", "b"]);
        other.restore(one.statistics().to_vec(), one.returns().to_vec()).unwrap();
        assert_eq!(one, other);
        assert!(other.restore(one.statistics().to_vec(), vec![0.0]).is_err());
        assert!(other.restore(one.statistics().to_vec(), vec![0.0, f64::NAN]).is_err());
    }
}

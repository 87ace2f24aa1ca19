//! Running mean and variance of every component of an observation, as training gathers them (`spec/training.md` §5.4, the
//! perceptrons' normaliser).
//!
//! All statistics start with mean 0, variance 1 and count 1e-4 and take in the observations of all bodies of one step as one
//! batch, by the parallel formula that `running_statistics.rs` states. What they normalise is, bit for bit, what a policy
//! normalises that is played with [`RunningComponents::to_stored`].

use super::PolicyError;
use super::checkpoint::contents::ComponentStatistics;
use super::normaliser::PRIOR_COUNT;

/// Added to every variance.
const EPSILON: f64 = 1e-8;
/// Normalised observations lie between plus and minus this.
const CLIP: f64 = 10.0;

/// Statistics that grow.
#[derive(Debug, Clone, PartialEq)]
pub struct RunningComponents {
    mean: Vec<f64>,
    variance: Vec<f64>,
    count: f64,
}

impl RunningComponents {
    /// Of so many components, before the first observation.
    #[must_use]
    pub fn new(components: usize) -> Self {
        Self { mean: vec![0.0; components], variance: vec![1.0; components], count: PRIOR_COUNT }
    }

    /// The statistics that [`Self::mean`], [`Self::variance`] and [`Self::count`] gave.
    pub fn restore(mean: Vec<f64>, variance: Vec<f64>, count: f64) -> Result<Self, PolicyError> {
        if variance.len() != mean.len() {
            let (expected, found) = (mean.len(), variance.len());
            return Err(PolicyError::NormaliserLength { expected, found });
        }
        let usable = mean.iter().all(|m| m.is_finite())
            && variance.iter().all(|v| v.is_finite() && *v >= 0.0)
            && count.is_finite()
            && count > 0.0;
        if usable { Ok(Self { mean, variance, count }) } else { Err(PolicyError::NormaliserValues) }
    }

    #[must_use]
    pub fn mean(&self) -> &[f64] {
        &self.mean
    }

    #[must_use]
    pub fn variance(&self) -> &[f64] {
        &self.variance
    }

    /// Observations taken in, the prior included.
    #[must_use]
    pub fn count(&self) -> f64 {
        self.count
    }

    /// Takes in what all bodies saw in one step.
    ///
    /// # Panics
    /// If an observation has another length.
    pub fn update<'a>(&mut self, batch: impl Iterator<Item = &'a [f32]> + Clone) {
        let count = batch.clone().count() as f64;
        if count == 0.0 {
            return;
        }
        let length = self.mean.len();
        let (mut mean, mut variance) = (vec![0.0; length], vec![0.0; length]);
        for observation in batch.clone() {
            assert_eq!(observation.len(), length, "components of an observation");
            mean.iter_mut().zip(observation).for_each(|(sum, &x)| *sum += f64::from(x));
        }
        mean.iter_mut().for_each(|sum| *sum /= count);
        for observation in batch {
            for ((sum, &x), mean) in variance.iter_mut().zip(observation).zip(&mean) {
                *sum += (f64::from(x) - mean).powi(2);
            }
        }
        let total = self.count + count;
        for (((m, v), batch_mean), batch_sum) in
            self.mean.iter_mut().zip(&mut self.variance).zip(&mean).zip(&variance)
        {
            let delta = batch_mean - *m;
            let between = delta * delta * self.count * count / total;
            *m += delta * count / total;
            *v = (*v * self.count + batch_sum + between) / total;
        }
        self.count = total;
    }

    /// Normalises one observation.
    pub fn normalise(&self, raw: &[f32], normalised: &mut [f32]) {
        let statistics = self.mean.iter().zip(&self.variance);
        for ((target, &x), (mean, variance)) in normalised.iter_mut().zip(raw).zip(statistics) {
            let deviation = (variance + EPSILON).sqrt();
            *target = ((f64::from(x) - mean) / deviation).clamp(-CLIP, CLIP) as f32;
        }
    }

    /// The statistics as a policy stores and plays them.
    #[must_use]
    pub fn to_stored(&self) -> ComponentStatistics {
        ComponentStatistics {
            mean: self.mean.clone(),
            variance: self.variance.clone(),
            epsilon: EPSILON,
            clip: CLIP,
            enabled: true,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::normaliser::ComponentNormaliser;

    #[test]
    fn two_batches_have_the_moments_of_all_values_and_the_prior() {
        let mut statistics = RunningComponents::new(1);
        let batches: [&[[f32; 1]]; 2] = [&[[1.0], [5.0]], &[[-2.0]]];
        for batch in batches {
            statistics.update(batch.iter().map(|x| &x[..]));
        }
        let n = 3.0001;
        let mean = 4.0 / n;
        let variance = (1e-4 + 1.0 + 25.0 + 4.0) / n - mean * mean;
        assert!((statistics.mean()[0] - mean).abs() < 1e-12);
        assert!((statistics.variance()[0] - variance).abs() < 1e-12);
        assert!((statistics.count() - n).abs() < 1e-12);
    }

    #[test]
    fn what_is_stored_normalises_to_the_same_bits() {
        let mut statistics = RunningComponents::new(3);
        let observations: Vec<[f32; 3]> =
            (0..7).map(|i| [i as f32 * 0.31, 1e-3 - i as f32, 1e4]).collect();
        statistics.update(observations.iter().map(|x| &x[..]));
        let player = ComponentNormaliser::new(&statistics.to_stored(), 3).unwrap();
        for raw in observations.iter().chain(&[[-99.0, 0.1, 0.0]]) {
            let (mut trained, mut played) = ([0.0; 3], [0.0; 3]);
            statistics.normalise(raw, &mut trained);
            player.apply(raw, &mut played);
            assert_eq!(trained.map(f32::to_bits), played.map(f32::to_bits));
        }
    }

    #[test]
    fn impossible_statistics_are_not_restored() {
        let restore = |mean: f64, variance: f64, count: f64| {
            RunningComponents::restore(vec![mean], vec![variance], count)
        };
        assert!(restore(0.5, 2.0, 3.0).is_ok());
        assert!(restore(f64::NAN, 2.0, 3.0).is_err());
        assert!(restore(0.5, -2.0, 3.0).is_err());
        assert!(restore(0.5, 2.0, 0.0).is_err());
        assert!(RunningComponents::restore(vec![0.0; 2], vec![1.0], 1.0).is_err());
    }
}

//! Observation normalisers: `x̂ = clip((x − mean)/√(variance + ε), ±clip)` with the statistics seen in training.
//!
//! Two kinds (`spec/policy.md` §3.6 and §3.7): one mean and variance per component of the vector, computed in double
//! precision; or one per token *signature* (the set of words that describes it) and history lag, in single precision.

use std::collections::BTreeMap;

use super::PolicyError;
use super::checkpoint::contents::{ComponentStatistics, SignatureStatistics};

/// Weight of the prior (mean 0, variance 1) that the reference merges into every row when it loads statistics.
pub(super) const PRIOR_COUNT: f64 = 1e-4;

/// Normaliser of a plain vector, one pair of statistics per component.
#[derive(Debug, Clone)]
pub(super) struct ComponentNormaliser {
    mean: Vec<f64>,
    deviation: Vec<f64>,
    clip: f64,
    enabled: bool,
}

impl ComponentNormaliser {
    /// Refuses statistics of another length than `expected`, or that no variance can have.
    pub(super) fn new(
        statistics: &ComponentStatistics,
        expected: usize,
    ) -> Result<Self, PolicyError> {
        if !statistics.enabled {
            let (mean, deviation, clip) = (Vec::new(), Vec::new(), f64::INFINITY);
            return Ok(Self { mean, deviation, clip, enabled: false });
        }
        let found = statistics.mean.len();
        if found != expected || statistics.variance.len() != expected {
            return Err(PolicyError::NormaliserLength { expected, found });
        }
        let deviation: Vec<f64> =
            statistics.variance.iter().map(|v| (v + statistics.epsilon).sqrt()).collect();
        let usable = deviation.iter().all(|d| d.is_finite() && *d > 0.0)
            && statistics.mean.iter().all(|m| m.is_finite())
            && statistics.clip > 0.0;
        if !usable {
            return Err(PolicyError::NormaliserValues);
        }
        Ok(Self { mean: statistics.mean.clone(), deviation, clip: statistics.clip, enabled: true })
    }

    /// Normalises one vector.
    pub(super) fn apply(&self, raw: &[f32], normalised: &mut [f32]) {
        if !self.enabled {
            normalised.copy_from_slice(raw);
            return;
        }
        let statistics = self.mean.iter().zip(&self.deviation);
        for ((target, &x), (mean, deviation)) in normalised.iter_mut().zip(raw).zip(statistics) {
            *target = ((f64::from(x) - mean) / deviation).clamp(-self.clip, self.clip) as f32;
        }
    }
}

/// Normaliser of the history windows of one task.
#[derive(Debug, Clone)]
pub(super) struct SignatureNormaliser {
    /// Tokens × lags.
    mean: Vec<f32>,
    /// Tokens × lags.
    deviation: Vec<f32>,
    clip: f32,
    enabled: bool,
}

impl SignatureNormaliser {
    /// Looks up the statistics of every token described by `words`. Tokens that were never seen in training keep mean
    /// 0 and variance 1; see [`unknown_signatures`].
    pub(super) fn for_task(statistics: &SignatureStatistics, words: &[Vec<u16>]) -> Self {
        let lags = statistics.lags;
        let rows = rows_by_signature(statistics);
        let mut mean = vec![0.0; words.len() * lags];
        let mut variance = vec![1.0; words.len() * lags];
        for (token, words) in words.iter().enumerate() {
            let Some(&row) = rows.get(&signature_of(words)) else { continue };
            for lag in 0..lags {
                let stored = row * lags + lag;
                (mean[token * lags + lag], variance[token * lags + lag]) = merge_with_prior(
                    statistics.mean[stored],
                    statistics.variance[stored],
                    statistics.count[row],
                );
            }
        }
        let epsilon = statistics.epsilon as f32;
        let deviation = variance.iter().map(|v| (v + epsilon).sqrt()).collect();
        Self { mean, deviation, clip: statistics.clip as f32, enabled: statistics.enabled }
    }

    /// Normalises one set of windows, tokens × lags.
    pub(super) fn apply(&self, raw: &[f32], normalised: &mut [f32]) {
        if !self.enabled {
            normalised.copy_from_slice(raw);
            return;
        }
        let statistics = self.mean.iter().zip(&self.deviation);
        for ((target, &x), (mean, deviation)) in normalised.iter_mut().zip(raw).zip(statistics) {
            *target = ((x - mean) / deviation).clamp(-self.clip, self.clip);
        }
    }
}

/// Refuses statistics whose tables do not fit each other or `lags`, or that no variance can have.
pub(super) fn check_signature_statistics(
    statistics: &SignatureStatistics,
    lags: usize,
) -> Result<(), PolicyError> {
    if !statistics.enabled {
        return Ok(());
    }
    if statistics.lags != lags {
        return Err(PolicyError::NormaliserLength { expected: lags, found: statistics.lags });
    }
    let rows = statistics.signatures.len();
    let cells = rows.checked_mul(lags);
    for (found, expected) in [
        (statistics.mean.len(), cells),
        (statistics.variance.len(), cells),
        (statistics.count.len(), Some(rows)),
    ] {
        if Some(found) != expected {
            let expected = expected.unwrap_or(usize::MAX);
            return Err(PolicyError::NormaliserLength { expected, found });
        }
    }
    let usable = statistics.mean.iter().all(|m| m.is_finite())
        && statistics.variance.iter().all(|v| v.is_finite() && *v >= 0.0)
        && statistics.count.iter().all(|n| n.is_finite() && *n >= 0.0)
        && statistics.epsilon > 0.0
        && statistics.epsilon.is_finite()
        && statistics.clip > 0.0;
    if usable { Ok(()) } else { Err(PolicyError::NormaliserValues) }
}

/// Signatures among `words` that the statistics do not know, each once, in the order they come.
pub(super) fn unknown_signatures(
    statistics: &SignatureStatistics,
    words: &[Vec<u16>],
) -> Vec<Vec<u16>> {
    if !statistics.enabled {
        return Vec::new();
    }
    let rows = rows_by_signature(statistics);
    let mut unknown: Vec<Vec<u16>> = Vec::new();
    for words in words {
        let signature = signature_of(words);
        if !rows.contains_key(&signature) && !unknown.contains(&signature) {
            unknown.push(signature);
        }
    }
    unknown
}

/// The sorted words of a token, without padding.
pub(super) fn signature_of(words: &[u16]) -> Vec<u16> {
    let mut signature: Vec<u16> = words.iter().copied().filter(|&word| word != 0).collect();
    signature.sort_unstable();
    signature
}

fn rows_by_signature(statistics: &SignatureStatistics) -> BTreeMap<Vec<u16>, usize> {
    let signatures = statistics.signatures.iter().enumerate();
    signatures.map(|(row, signature)| (signature_of(signature), row)).collect()
}

/// Mean and variance of a stored row together with the prior's, as two samples of one population.
fn merge_with_prior(mean: f32, variance: f32, count: f64) -> (f32, f32) {
    let (mean, variance) = (f64::from(mean), f64::from(variance));
    let total = count + PRIOR_COUNT;
    let spread = mean * mean * count * PRIOR_COUNT / total;
    let merged = (variance * count + PRIOR_COUNT + spread) / total;
    ((mean * count / total) as f32, merged as f32)
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "small whole numbers are exact")]
mod tests {
    use super::*;

    fn statistics() -> SignatureStatistics {
        SignatureStatistics {
            signatures: vec![vec![0], vec![3, 7]],
            mean: vec![0.0, 0.0, 1.0, 2.0],
            variance: vec![1.0, 1.0, 4.0, 16.0],
            count: vec![1e-4, 1e9],
            lags: 2,
            epsilon: 1e-8,
            clip: 10.0,
            enabled: true,
        }
    }

    #[test]
    fn tokens_find_their_row_whatever_the_order_of_their_words() {
        let words = [vec![7, 3], vec![5]];
        let normaliser = SignatureNormaliser::for_task(&statistics(), &words);
        let mut normalised = [0.0; 4];
        normaliser.apply(&[3.0, -2.0, 0.5, 99.0], &mut normalised);
        assert_eq!(normalised, [1.0, -1.0, 0.5, 10.0]);
        assert_eq!(unknown_signatures(&statistics(), &words), [vec![5]]);
    }

    #[test]
    fn a_row_seen_as_often_as_the_prior_meets_it_half_way() {
        let (mean, variance) = merge_with_prior(2.0, 3.0, PRIOR_COUNT);
        // Two equal halves with means 0 and 2: variance (1 + 3)/2 within and 1 between.
        assert_eq!((mean, variance), (1.0, 3.0));
    }

    #[test]
    fn components_are_scaled_and_clipped() {
        let statistics = ComponentStatistics {
            mean: vec![1.0, 0.0],
            variance: vec![4.0, 1.0],
            epsilon: 0.0,
            clip: 5.0,
            enabled: true,
        };
        let mut normalised = [0.0; 2];
        let normaliser = ComponentNormaliser::new(&statistics, 2).unwrap();
        normaliser.apply(&[2.0, -7.0], &mut normalised);
        assert_eq!(normalised, [0.5, -5.0]);
        let raw = ComponentStatistics { enabled: false, ..statistics.clone() };
        ComponentNormaliser::new(&raw, 2).unwrap().apply(&[2.0, -7.0], &mut normalised);
        assert_eq!(normalised, [2.0, -7.0]);
        let error = ComponentNormaliser::new(&statistics, 3).unwrap_err().to_string();
        assert!(error.contains('3') && error.contains('2'), "{error}");
    }

    #[test]
    fn statistics_that_do_not_fit_are_refused() {
        check_signature_statistics(&statistics(), 2).unwrap();
        assert!(check_signature_statistics(&statistics(), 6).is_err());
        let short = SignatureStatistics { mean: vec![0.0; 3], ..statistics() };
        assert!(check_signature_statistics(&short, 2).is_err());
        let negative = SignatureStatistics { variance: vec![1.0, 1.0, -4.0, 1.0], ..statistics() };
        assert!(check_signature_statistics(&negative, 2).is_err());
    }
}

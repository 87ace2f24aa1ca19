//! What the statistics of every normaliser must satisfy, whatever file they came from: as many of each as the others
//! say, finite, variances and counts not negative, ε and the clipping bound positive, words of a signature sorted.

use super::CheckpointError;
use super::contents::{ComponentStatistics, Normaliser, SignatureStatistics};

/// The normaliser, if training can have produced it.
pub(super) fn checked(normaliser: Normaliser) -> Result<Normaliser, CheckpointError> {
    match &normaliser {
        Normaliser::PerComponent(read) => components(read)?,
        Normaliser::PerSignature(read) => signatures(read)?,
    }
    Ok(normaliser)
}

fn components(read: &ComponentStatistics) -> Result<(), CheckpointError> {
    settings(read.epsilon, read.clip)?;
    same_length("variance", read.mean.len(), read.variance.len())?;
    finite("mean", read.mean.iter().copied(), f64::NEG_INFINITY)?;
    finite("variance", read.variance.iter().copied(), 0.0)
}

fn signatures(read: &SignatureStatistics) -> Result<(), CheckpointError> {
    settings(read.epsilon, read.clip)?;
    let rows = read.signatures.len();
    let numbers = rows.saturating_mul(read.lags);
    same_length("mean", numbers, read.mean.len())?;
    same_length("variance", numbers, read.variance.len())?;
    same_length("count", rows, read.count.len())?;
    let wide = |values: &[f32]| values.iter().copied().map(f64::from).collect::<Vec<_>>();
    finite("mean", wide(&read.mean), f64::NEG_INFINITY)?;
    finite("variance", wide(&read.variance), 0.0)?;
    finite("count", read.count.iter().copied(), 0.0)?;
    let usable = |words: &Vec<u16>| !words.is_empty() && words.is_sorted();
    match read.signatures.iter().position(|words| !usable(words)) {
        Some(row) => Err(CheckpointError::UnsortedSignature { row }),
        None if rows > 0 && read.signatures[0] != [0] => Err(CheckpointError::NoPaddingSignature),
        None => Ok(()),
    }
}

fn settings(epsilon: f64, clip: f64) -> Result<(), CheckpointError> {
    for (name, value) in [("epsilon", epsilon), ("clip_obs", clip)] {
        if !(value.is_finite() && value > 0.0) {
            let name = name.to_owned();
            return Err(CheckpointError::ImpossibleStatistic { name, value, index: 0 });
        }
    }
    Ok(())
}

fn same_length(name: &'static str, expected: usize, found: usize) -> Result<(), CheckpointError> {
    if expected == found {
        return Ok(());
    }
    Err(CheckpointError::StatisticLength { name, expected, found })
}

fn finite(
    name: &str,
    values: impl IntoIterator<Item = f64>,
    lowest: f64,
) -> Result<(), CheckpointError> {
    let mut numbered = values.into_iter().enumerate();
    match numbered.find(|(_, value)| !value.is_finite() || *value < lowest) {
        None => Ok(()),
        Some((index, value)) => {
            Err(CheckpointError::ImpossibleStatistic { name: name.to_owned(), value, index })
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn good() -> SignatureStatistics {
        SignatureStatistics {
            signatures: vec![vec![0], vec![2, 5]],
            mean: vec![0.0; 4],
            variance: vec![1.0; 4],
            count: vec![1e-4, 10.0],
            lags: 2,
            epsilon: 1e-8,
            clip: 10.0,
            enabled: true,
        }
    }

    fn refusal(change: impl FnOnce(&mut SignatureStatistics)) -> String {
        let mut changed = good();
        change(&mut changed);
        checked(Normaliser::PerSignature(changed)).unwrap_err().to_string()
    }

    #[test]
    fn what_no_training_produces_is_refused_by_name() {
        assert!(checked(Normaliser::PerSignature(good())).is_ok());
        assert!(refusal(|read| read.mean[3] = f32::NAN).contains("`mean` is NaN at index 3"));
        assert!(refusal(|read| read.variance[1] = -1.0).contains("`variance` is -1 at index 1"));
        assert!(refusal(|read| read.count[1] = -2.0).contains("`count`"));
        assert!(refusal(|read| read.epsilon = 0.0).contains("`epsilon`"));
        assert!(refusal(|read| read.clip = f64::INFINITY).contains("`clip_obs`"));
        assert!(refusal(|read| _ = read.count.pop()).contains("`count` has 1"));
        assert!(refusal(|read| read.signatures[1] = vec![5, 2]).contains("row 1"));
        assert!(refusal(|read| read.signatures[0] = vec![1]).contains("padding"));
    }
}

//! What a mean does with values that are undefined: a joint that never moved, a channel without variance.
//!
//! The authors' suite lets one undefined value make the whole mean undefined, so that nothing is averaged over fewer
//! values than its table says. Leaving it out is an option, and the number of values used then stands beside the mean.

/// The two ways.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Undefined {
    /// One undefined value makes the mean undefined.
    #[default]
    Propagate,
    /// The mean of the values that are defined.
    Skip,
}

impl Undefined {
    /// Mean of `values`; an average of nothing is undefined.
    #[must_use]
    pub fn mean(self, values: impl IntoIterator<Item = Option<f64>>) -> Option<f64> {
        let (mut sum, mut count) = (0.0, 0_usize);
        for value in values {
            match (value, self) {
                (Some(value), _) => (sum, count) = (sum + value, count + 1),
                (None, Self::Propagate) => return None,
                (None, Self::Skip) => {}
            }
        }
        (count > 0).then(|| sum / count as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_undefined_value_spreads_unless_it_is_skipped() {
        let values = [Some(1.0), None, Some(4.0)];
        assert_eq!(Undefined::Propagate.mean(values), None);
        assert_eq!(Undefined::Skip.mean(values), Some(2.5));
        assert_eq!(Undefined::Propagate.mean([Some(1.0), Some(4.0)]), Some(2.5));
        assert_eq!(Undefined::Skip.mean([None, None]), None);
        assert_eq!(Undefined::Propagate.mean([]), None);
    }
}

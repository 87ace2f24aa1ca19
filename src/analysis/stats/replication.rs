//! The unit of replication: what counts as one independent observation.
//!
//! A hundred episodes of one trained policy are not a hundred policies. Tests and intervals over seeds, subjects or
//! tasks first average everything measured on one unit and then see one value per unit. In the unit of the values.
//!
//! Degenerate: labels and values of different number are an error, no value gives no unit, NaN makes its unit's mean
//! NaN.

use super::{BootstrapOptions, Interval, bootstrap_mean};

/// Why values cannot be gathered into units.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ReplicationError {
    #[error("{values} values have {labels} labels of their unit")]
    LabelCount { values: usize, labels: usize },
}

/// The units in order of appearance, each with the mean of its values and their number.
pub fn unit_means<'a>(
    units: &[&'a str],
    values: &[f64],
) -> Result<Vec<(&'a str, f64, usize)>, ReplicationError> {
    if units.len() != values.len() {
        return Err(ReplicationError::LabelCount { values: values.len(), labels: units.len() });
    }
    let mut places = std::collections::BTreeMap::<&str, usize>::new();
    let mut gathered: Vec<(&str, f64, usize)> = Vec::new();
    for (&unit, &value) in units.iter().zip(values) {
        let place = *places.entry(unit).or_insert(gathered.len());
        if place == gathered.len() {
            gathered.push((unit, 0.0, 0));
        }
        gathered[place].1 += value;
        gathered[place].2 += 1;
    }
    gathered.iter_mut().for_each(|(_, sum, count)| *sum /= *count as f64);
    Ok(gathered)
}

/// Bootstrap interval of the mean over units: whole units are drawn, never single values of one.
pub fn bootstrap_units(
    units: &[&str],
    values: &[f64],
    options: &BootstrapOptions,
) -> Result<Option<Interval>, ReplicationError> {
    let means: Vec<f64> = unit_means(units, values)?.into_iter().map(|(_, mean, _)| mean).collect();
    Ok(bootstrap_mean(&means, options))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn values_of_a_unit_become_their_mean() {
        let found = unit_means(&["b", "a", "b"], &[1.0, 7.0, 3.0]).unwrap();
        assert_eq!(found, [("b", 2.0, 2), ("a", 7.0, 1)]);
        assert_eq!(unit_means(&[], &[]), Ok(Vec::new()));
        let error = ReplicationError::LabelCount { values: 0, labels: 1 };
        assert_eq!(unit_means(&["a"], &[]), Err(error));
    }

    #[test]
    fn more_episodes_of_the_same_units_do_not_narrow_the_interval() {
        let options = BootstrapOptions { resamples: 500, ..Default::default() };
        let of = |copies: usize| {
            let units = ["a", "b", "c", "d"].repeat(copies);
            let values = [0.1, 0.5, 0.7, 0.2].repeat(copies);
            bootstrap_units(&units, &values, &options).unwrap().unwrap()
        };
        let (few, many) = (of(1), of(50));
        assert!((few.low - many.low).abs() < 1e-12 && (few.high - many.high).abs() < 1e-12);
    }
}

//! Factors before rotation: the principal components of the muscles' correlations.
//!
//! Each muscle is divided by its maximum and its standard deviation (divisor n − 1), so that all count alike; the
//! covariance is then the correlation matrix R. Its eigenvalues λ sum to the number of muscles p. The first factors, at
//! most ten, with λ ≥ 0.5 are kept; their loadings are `L = V √λ`, the correlation of each muscle with each factor.
//! `explained variance = Σ kept λ / Σ all λ`.
//!
//! Inputs: activations over the averaged cycle; rows are time steps, columns are muscles, any unit.
//!
//! Degenerate: a constant muscle has no correlation and is dropped, which is said. Fewer than two muscles that vary, and
//! no eigenvalue large enough, are errors.
//!
//! Reference: Ivanenko, Poppele & Lacquaniti 2004, *J. Physiol.* 556:267. Oracle: `tests/signals_parity.rs`, algorithms
//! `factor_analysis`, `factor_analysis_exact`.

use super::{Bartlett, FactorError, SamplingAdequacy, bartlett, sampling_adequacy};
use crate::analysis::signal::Rows;
use crate::analysis::stats::{Divisor, mean, standard_deviation};
use crate::analysis::subspace::{Covariance, PrincipalComponents, principal_components};

/// Maxima and deviations below this are those of a muscle that does nothing.
const NEGLIGIBLE: f64 = 1e-12;

/// Which factors are kept.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ExtractionOptions {
    /// Least eigenvalue of a kept factor.
    pub least_eigenvalue: f64,
    pub most_factors: usize,
}

impl Default for ExtractionOptions {
    fn default() -> Self {
        Self { least_eigenvalue: 0.5, most_factors: 10 }
    }
}

/// The kept factors, unrotated, and what is known of the correlations.
#[derive(Debug, Clone, PartialEq)]
pub struct Extraction {
    /// Columns that vary, rising; everything else has one entry per muscle in here.
    pub muscles: Vec<usize>,
    /// Columns that were dropped.
    pub dropped: Vec<usize>,
    pub time_steps: usize,
    /// Muscles × muscles, row by row.
    pub correlations: Vec<f64>,
    /// One per muscle, falling.
    pub eigenvalues: Vec<f64>,
    pub factor_count: usize,
    /// Muscles × factors, row by row.
    pub loadings: Vec<f64>,
    pub explained_variance: f64,
    pub bartlett: Option<Bartlett>,
    pub sampling_adequacy: Option<SamplingAdequacy>,
    /// Time steps × factors, row by row; unit variance with divisor n − 1.
    pub(super) scores: Vec<f64>,
}

/// Finds the factors of `activations`.
pub fn extract(
    activations: &Rows<'_>,
    options: &ExtractionOptions,
) -> Result<Extraction, FactorError> {
    let ExtractionOptions { least_eigenvalue, most_factors } = *options;
    if !(least_eigenvalue > 0.0 && least_eigenvalue.is_finite()) {
        let (name, expected) = ("least eigenvalue", "a positive number");
        return Err(FactorError::Option { name, value: least_eigenvalue, expected });
    }
    let (muscles, standardised) = standardise(activations);
    let (found, recorded) = (muscles.len(), activations.columns());
    if found < 2 {
        return Err(FactorError::TooFewMuscles { found, recorded });
    }
    let mut covariance = Covariance::new(found);
    covariance.push_rows(&standardised)?;
    let spectrum = principal_components(&covariance)?;
    let eigenvalues = &spectrum.variances;
    let factor_count =
        eigenvalues.iter().take(most_factors).filter(|&&value| value >= least_eigenvalue).count();
    if factor_count == 0 {
        let (least, largest) = (least_eigenvalue, eigenvalues[0]);
        return Err(FactorError::NoFactor { least, largest });
    }
    let entries = |rows: usize, columns: usize| {
        (0..rows).flat_map(move |i| (0..columns).map(move |j| (i, j)))
    };
    let correlations: Vec<f64> = entries(found, found)
        .map(|(i, j)| if i == j { 1.0 } else { covariance.between(i, j).unwrap_or(f64::NAN) })
        .collect();
    let loading = |(i, j): (usize, usize)| spectrum.component(j)[i] * eigenvalues[j].sqrt();
    Ok(Extraction {
        dropped: (0..recorded).filter(|column| !muscles.contains(column)).collect(),
        muscles,
        time_steps: activations.len(),
        factor_count,
        loadings: entries(found, factor_count).map(loading).collect(),
        explained_variance: eigenvalues[..factor_count].iter().sum::<f64>()
            / eigenvalues.iter().sum::<f64>(),
        bartlett: bartlett(&spectrum),
        sampling_adequacy: sampling_adequacy(&correlations, &spectrum),
        correlations,
        scores: scores(&standardised, &spectrum, factor_count),
        eigenvalues: spectrum.variances,
    })
}

/// The columns that vary, and their z-scores (divisor n − 1) row by row.
fn standardise(activations: &Rows<'_>) -> (Vec<usize>, Vec<f64>) {
    let columns: Vec<(usize, Vec<f64>)> = (0..activations.columns())
        .filter_map(|index| Some((index, z_scores(activations.column(index).collect())?)))
        .collect();
    let rows = 0..activations.len();
    let standardised =
        rows.flat_map(|i| columns.iter().map(move |(_, column)| column[i])).collect();
    (columns.iter().map(|(index, _)| *index).collect(), standardised)
}

/// `None` if the values do not vary.
fn z_scores(mut values: Vec<f64>) -> Option<Vec<f64>> {
    let maximum = values.iter().copied().fold(f64::NEG_INFINITY, f64::max);
    let divisor = if maximum < NEGLIGIBLE { 1.0 } else { maximum };
    values.iter_mut().for_each(|value| *value /= divisor);
    let centre = mean(&values)?;
    let deviation = standard_deviation(&values, Divisor::CountMinusOne)?;
    let varies = deviation >= NEGLIGIBLE && deviation.is_finite();
    varies.then(|| values.into_iter().map(|value| (value - centre) / deviation).collect())
}

fn scores(standardised: &[f64], spectrum: &PrincipalComponents, factor_count: usize) -> Vec<f64> {
    let rows = standardised.chunks_exact(spectrum.muscle_count());
    let score = |row: &[f64], factor: usize| {
        let along: f64 = row.iter().zip(spectrum.component(factor)).map(|(z, v)| z * v).sum();
        along / spectrum.variances[factor].sqrt()
    };
    rows.flat_map(|row| (0..factor_count).map(move |factor| score(row, factor))).collect()
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    fn of(values: &[f64], columns: usize) -> Result<Extraction, FactorError> {
        extract(&Rows::new(values, columns).unwrap(), &ExtractionOptions::default())
    }

    #[test]
    fn two_muscles_that_are_one_have_one_factor() {
        let values: Vec<f64> =
            (0..50).flat_map(|i| [f64::from(i % 7), 3.0 * f64::from(i % 7)]).collect();
        let found = of(&values, 2).unwrap();
        assert_eq!((found.factor_count, found.bartlett), (1, None));
        assert!(found.loadings.iter().all(|loading| (loading - 1.0).abs() < 1e-12));
        assert!((found.explained_variance - 1.0).abs() < 1e-12);
    }

    #[test]
    fn a_constant_muscle_is_dropped_and_named() {
        let values: Vec<f64> =
            (0..50).flat_map(|i| [f64::from(i % 7), 0.4, f64::from(i % 5)]).collect();
        let found = of(&values, 3).unwrap();
        assert_eq!((found.muscles, found.dropped), (vec![0, 2], vec![1]));
    }

    #[test]
    fn too_little_to_factor_is_a_typed_error() {
        assert_eq!(of(&[], 3), Err(FactorError::TooFewMuscles { found: 0, recorded: 3 }));
        assert_eq!(of(&[0.5; 30], 3), Err(FactorError::TooFewMuscles { found: 0, recorded: 3 }));
        let values = [0.0, 1.0, 1.0, 0.0, 1.0, 1.0];
        let options = ExtractionOptions { least_eigenvalue: 5.0, ..Default::default() };
        assert!(matches!(
            extract(&Rows::new(&values, 2).unwrap(), &options),
            Err(FactorError::NoFactor { .. })
        ));
        let options = ExtractionOptions { least_eigenvalue: 0.0, ..Default::default() };
        assert!(matches!(
            extract(&Rows::new(&values, 2).unwrap(), &options),
            Err(FactorError::Option { .. })
        ));
    }

    proptest! {
        #[test]
        fn any_finite_table_has_factors_or_a_typed_error(
            values in prop::collection::vec(prop::array::uniform4(any::<f64>()), 0..20),
        ) {
            let values: Vec<f64> = values.into_iter().flatten().collect();
            if let Ok(found) = of(&values, 4) {
                prop_assert!(found.loadings.iter().all(|x| x.abs() <= 1.0 + 1e-9));
                prop_assert!((0.0..=1.0 + 1e-12).contains(&found.explained_variance));
            }
        }

        #[test]
        fn scale_and_offset_of_a_muscle_do_not_matter(
            values in prop::collection::vec(prop::array::uniform4(0.0..1.0_f64), 12..40),
            scale in 0.1..10.0_f64,
            offset in 0.0..3.0_f64,
        ) {
            let plain: Vec<f64> = values.iter().flatten().copied().collect();
            let moved: Vec<f64> =
                values.iter().flat_map(|[a, b, c, d]| [scale * a + offset, *b, *c, *d]).collect();
            let (plain, moved) = (of(&plain, 4).unwrap(), of(&moved, 4).unwrap());
            for (a, b) in plain.eigenvalues.iter().zip(&moved.eigenvalues) {
                prop_assert!((a - b).abs() < 1e-9);
            }
        }
    }
}

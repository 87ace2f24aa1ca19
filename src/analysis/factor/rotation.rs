//! Factors after rotation: loadings, waveforms over the cycle, and how far they can be trusted.
//!
//! Waveforms are `F = Z V diag(1/√λ) T`: uncorrelated, mean zero, unit variance. Explained share of a factor:
//! `Σᵢ Lᵢ²/p`. The largest loading of each factor (by magnitude) is positive; the waveform flips with it.
//!
//! | rotation | order of the factors | divisor of the waveforms' variance |
//! | --- | --- | --- |
//! | [`Rotation::Varimax`], the default | falling share | n |
//! | [`Rotation::Reference`], the suite's | as before rotation | n − 1 |
//!
//! The suite's rotation does not settle ([`super::reference_rotation()`]). [`Factors::shift`] is the largest change of a
//! loading over four repetitions with unrotated loadings changed by 10⁻¹²; above 10⁻⁷ the factors are not reproducible.
//! Number of factors, explained variance and suitability do not depend on the rotation.
//!
//! Oracle: `tests/signals_parity.rs`, algorithms `factor_analysis`, `factor_analysis_exact`, and `emg_real`.

use serde::Serialize;

use super::{
    Extraction, FactorError, ReferenceRotationOptions, Rotated, VarimaxOptions, reference_rotation,
    varimax,
};

/// Relative change of the loadings whose effect is measured.
const DISTURBANCE: f64 = 1e-12;
/// A larger effect means that the rotated factors are not reproducible.
const LARGEST_STEADY_SHIFT: f64 = 1e-7;

/// How factors are rotated.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Rotation {
    Varimax(VarimaxOptions),
    /// That of the authors' suite.
    Reference(ReferenceRotationOptions),
}

impl Default for Rotation {
    fn default() -> Self {
        Self::Varimax(VarimaxOptions::default())
    }
}

impl Rotation {
    /// The word on the command line and in outputs.
    #[must_use]
    pub fn name(&self) -> &'static str {
        match self {
            Self::Varimax(_) => "varimax",
            Self::Reference(_) => "reference",
        }
    }
}

/// Rotated factors.
#[derive(Debug, Clone, PartialEq)]
pub struct Factors {
    pub rotation: Rotation,
    /// Muscles × factors, row by row.
    pub loadings: Vec<f64>,
    /// Time steps × factors, row by row.
    pub waveforms: Vec<f64>,
    /// Share of the total variance each factor explains.
    pub shares: Vec<f64>,
    /// Steps or passes taken (`sweeps` in outputs).
    pub iterations: usize,
    pub converged: bool,
    /// How far loadings move when the input does; only for the suite's rotation.
    pub shift: Option<f64>,
}

impl Factors {
    /// Whether the rotated factors are the same on another machine.
    #[must_use]
    pub fn is_reproducible(&self) -> bool {
        self.shift.is_none_or(|shift| shift <= LARGEST_STEADY_SHIFT)
    }
}

/// Rotates the factors of `extraction`.
pub fn rotate(extraction: &Extraction, rotation: Rotation) -> Result<Factors, FactorError> {
    let factors = extraction.factor_count;
    let muscles = extraction.muscles.len() as f64;
    let (rotated, shift) = match &rotation {
        Rotation::Varimax(options) => (varimax(&extraction.loadings, factors, options)?, None),
        Rotation::Reference(options) => {
            let rotated = reference_rotation(&extraction.loadings, factors, options);
            let shift = shift(&extraction.loadings, factors, options, &rotated);
            (rotated, Some(shift))
        }
    };
    let share = |factor: &usize| -> f64 {
        column(&rotated.loadings, factors, *factor).map(|x| x * x).sum::<f64>() / muscles
    };
    let mut order: Vec<usize> = (0..factors).collect();
    let mut scale = 1.0;
    if matches!(rotation, Rotation::Varimax(_)) {
        order.sort_by(|a, b| share(b).total_cmp(&share(a)));
        // From unit variance with divisor n − 1 to divisor n.
        let count = extraction.time_steps as f64;
        scale = (count / (count - 1.0)).sqrt();
    }
    let sign = |factor: usize| sign_of_largest(column(&rotated.loadings, factors, factor));
    let signs: Vec<f64> = order.iter().map(|&factor| sign(factor)).collect();
    let arrange = |values: &[f64], scale: f64| -> Vec<f64> {
        let rows = values.chunks_exact(factors);
        let places = || order.iter().zip(&signs);
        rows.flat_map(|row| places().map(move |(&at, sign)| scale * sign * row[at])).collect()
    };
    let waveforms = product(&extraction.scores, &rotated.rotation, factors);
    Ok(Factors {
        rotation,
        loadings: arrange(&rotated.loadings, 1.0),
        waveforms: arrange(&waveforms, scale),
        shares: order.iter().map(share).collect(),
        iterations: rotated.iterations,
        converged: rotated.converged,
        shift,
    })
}

/// Largest change of a loading over four repetitions with disturbed input.
fn shift(
    loadings: &[f64],
    factors: usize,
    options: &ReferenceRotationOptions,
    undisturbed: &Rotated,
) -> f64 {
    /// Fractional part of the golden ratio: its multiples spread evenly, and are the same every time.
    const GOLDEN: f64 = 0.618_033_988_749_894_9;
    let disturb = |(at, loading): (usize, &f64), repetition: usize| {
        let place = (repetition * loadings.len() + at + 1) as f64;
        loading * (1.0 + DISTURBANCE * (2.0 * (GOLDEN * place).fract() - 1.0))
    };
    let change = |repetition: usize| {
        let disturbed: Vec<f64> =
            loadings.iter().enumerate().map(|one| disturb(one, repetition)).collect();
        let rotated = reference_rotation(&disturbed, factors, options);
        let pairs = rotated.loadings.iter().zip(&undisturbed.loadings);
        pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    };
    (0..4).map(change).fold(0.0, f64::max)
}

fn column(matrix: &[f64], columns: usize, index: usize) -> impl Iterator<Item = f64> {
    matrix.iter().skip(index).step_by(columns).copied()
}

/// −1 if the first entry of largest magnitude is negative, else 1.
fn sign_of_largest(entries: impl Iterator<Item = f64>) -> f64 {
    let largest =
        entries.fold(0.0_f64, |largest, x| if x.abs() > largest.abs() { x } else { largest });
    if largest < 0.0 { -1.0 } else { 1.0 }
}

/// Rows × square matrix, both row by row.
fn product(rows: &[f64], square: &[f64], size: usize) -> Vec<f64> {
    let entry = |row: &[f64], j: usize| -> f64 {
        row.iter().zip(column(square, size, j)).map(|(x, t)| x * t).sum()
    };
    rows.chunks_exact(size).flat_map(|row| (0..size).map(move |j| entry(row, j))).collect()
}

/// A row of `loadings.csv`: a muscle and its loading on F1 … Fk.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct LoadingRow {
    pub muscle: String,
    pub loadings: Vec<f64>,
}

/// The rows of `loadings.csv`; `labels` name the columns the factors were extracted from.
#[must_use]
pub fn loading_rows(
    extraction: &Extraction,
    factors: &Factors,
    labels: &[&str],
) -> Vec<LoadingRow> {
    let rows = factors.loadings.chunks_exact(extraction.factor_count);
    let label = |column: usize| labels.get(column).map_or_else(String::new, |&l| l.to_owned());
    let muscles = extraction.muscles.iter().zip(rows);
    muscles.map(|(&at, row)| LoadingRow { muscle: label(at), loadings: row.to_vec() }).collect()
}

/// The content of `statistics.json`; `null` where undefined.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct StatisticsRow {
    pub n_factors: usize,
    pub n_muscles: usize,
    pub n_time: usize,
    pub bartlett_chi2: Option<f64>,
    pub bartlett_df: Option<usize>,
    pub bartlett_p: Option<f64>,
    pub kmo: Option<f64>,
    pub explained_variance: f64,
    pub rotation: &'static str,
    pub sweeps: usize,
    pub converged: bool,
    pub rotation_shift: Option<f64>,
}

impl StatisticsRow {
    /// What is said about an extraction and its rotation.
    #[must_use]
    pub fn of(extraction: &Extraction, factors: &Factors) -> Self {
        let bartlett = extraction.bartlett.as_ref();
        Self {
            n_factors: extraction.factor_count,
            n_muscles: extraction.muscles.len(),
            n_time: extraction.time_steps,
            bartlett_chi2: bartlett.map(|test| test.chi_squared),
            bartlett_df: bartlett.map(|test| test.degrees_of_freedom),
            bartlett_p: bartlett.map(|test| test.p_value),
            kmo: extraction.sampling_adequacy.as_ref().map(|measure| measure.overall),
            explained_variance: extraction.explained_variance,
            rotation: factors.rotation.name(),
            sweeps: factors.iterations,
            converged: factors.converged,
            rotation_shift: factors.shift,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::analysis::factor::{ExtractionOptions, extract};
    use crate::analysis::signal::Rows;

    const MUSCLES: usize = 6;
    const STEPS: usize = 60;

    fn extraction() -> Extraction {
        let activation = |step: usize, muscle: usize| {
            let phase = 0.1 * step as f64;
            let wave = [phase.sin(), (2.0 * phase).cos()][muscle % 2];
            wave + 0.3 * (phase * (3 + muscle) as f64).sin()
        };
        let values: Vec<f64> =
            (0..STEPS).flat_map(|t| (0..MUSCLES).map(move |m| activation(t, m))).collect();
        extract(&Rows::new(&values, MUSCLES).unwrap(), &ExtractionOptions::default()).unwrap()
    }

    #[test]
    fn waveforms_are_uncorrelated_with_unit_variance_and_shares_sum_to_the_explained() {
        let extraction = extraction();
        let count = extraction.factor_count;
        assert!(count > 1);
        for rotation in [Rotation::default(), Rotation::Reference(Default::default())] {
            let found = rotate(&extraction, rotation).unwrap();
            let divisor = if rotation.name() == "varimax" { STEPS } else { STEPS - 1 } as f64;
            for i in 0..count {
                for j in 0..count {
                    let pairs =
                        column(&found.waveforms, count, i).zip(column(&found.waveforms, count, j));
                    let covariance: f64 = pairs.map(|(x, y)| x * y).sum::<f64>() / divisor;
                    let want = f64::from(u8::from(i == j));
                    assert!((covariance - want).abs() < 1e-9, "{rotation:?} {i} {j}");
                }
                let loadings = column(&found.loadings, count, i);
                assert!(sign_of_largest(loadings) > 0.0);
            }
            assert!(
                (found.shares.iter().sum::<f64>() - extraction.explained_variance).abs() < 1e-12
            );
        }
        let shares = rotate(&extraction, Rotation::default()).unwrap().shares;
        assert!(shares.is_sorted_by(|a, b| a >= b));
    }

    #[test]
    fn varimax_is_reproducible_and_the_suites_rotation_says_how_far_it_moves() {
        let extraction = extraction();
        let varimax = rotate(&extraction, Rotation::default()).unwrap();
        assert!(varimax.converged && varimax.shift.is_none() && varimax.is_reproducible());
        let options = ReferenceRotationOptions::default();
        let mut reference = rotate(&extraction, Rotation::Reference(options)).unwrap();
        assert!(reference.shift.is_some());
        reference.shift = Some(0.3);
        assert!(!reference.is_reproducible());
        let row = StatisticsRow::of(&extraction, &reference);
        assert_eq!((row.rotation, row.rotation_shift), ("reference", Some(0.3)));
        assert_eq!((row.sweeps, row.converged), (reference.iterations, reference.converged));
    }
}

//! Factors of the leg muscles over the averaged gait cycle (`spec/analysis.md` §4).

use crate::analysis::emg::Side;
use crate::analysis::factor::{
    self, Extraction, ExtractionOptions, FACTOR_MUSCLES, FactorError, Factors,
    ReferenceRotationOptions, Rotation, StatisticsRow,
};
use crate::analysis::signal::Rows;
use crate::figure::{FactorFigure, FactorPanel};
use crate::npz::{Array, Elements, Member};
use crate::record::profiles::Profile;
use crate::record::{Column, RecordError, Table};

use super::walking::{Walk, WalkError, WalkOptions};

/// Why there are no factors.
#[derive(Debug, thiserror::Error)]
pub enum FactorsError {
    #[error(transparent)]
    Walk(#[from] WalkError),
    #[error("{fault}, in the profile of `{policy}`")]
    Factor { fault: FactorError, policy: String },
    #[error("the profile of `{policy}` has {found} muscles, expected {expected}")]
    MuscleCount { policy: String, expected: usize, found: usize },
}

/// The averaged cycle that factors are found in: points × fourteen muscles.
#[derive(Debug, Clone, PartialEq)]
pub struct Activations {
    pub policy: String,
    pub values: Vec<f64>,
    /// Detected and averaged cycles, where known.
    pub cycles: Option<[usize; 2]>,
}

impl Activations {
    /// The averaged cycle of `walk` that begins with a strike of the foot of `side`, muscles of the same leg.
    pub fn of_walk(walk: &Walk, side: Side, options: &WalkOptions) -> Result<Self, FactorsError> {
        let policy = walk.policy.clone();
        let cycles = walk.segment(side, &options.gait)?;
        let profile = walk.profile(&cycles, &factor::compartments(side), options)?;
        let fault = |fault: FactorError| FactorsError::Factor { fault, policy: policy.clone() };
        let rows = Rows::new(&profile.mean, profile.muscle_count).map_err(|e| fault(e.into()))?;
        let values = factor::sum_compartments(&rows).map_err(fault)?;
        Ok(Self { policy, values, cycles: Some([profile.detected, profile.retained]) })
    }

    /// A profile of `simulation.npz`, which has a row per muscle.
    pub fn of_profile(name: &str, profile: &Profile) -> Result<Self, FactorsError> {
        let (policy, expected) = (name.to_owned(), FACTOR_MUSCLES.len());
        let Profile { muscles, points, values } = profile;
        if *muscles != expected {
            return Err(FactorsError::MuscleCount { policy, expected, found: *muscles });
        }
        let at = |point: usize| (0..expected).map(move |muscle| values[muscle * points + point]);
        Ok(Self { policy, values: (0..*points).flat_map(at).collect(), cycles: None })
    }
}

/// Factors by both rotations, if both are asked for.
#[derive(Debug, Clone)]
pub struct FactorsResult {
    pub activations: Activations,
    pub extraction: Extraction,
    pub varimax: Factors,
    /// By the rotation of the authors' suite.
    pub reference: Option<Factors>,
}

impl FactorsResult {
    /// The factors of `activations`.
    pub fn of(activations: Activations, reference: bool) -> Result<Self, FactorsError> {
        let policy = activations.policy.clone();
        let fault = |fault: FactorError| FactorsError::Factor { fault, policy: policy.clone() };
        let rows = Rows::new(&activations.values, FACTOR_MUSCLES.len());
        let rows = rows.map_err(|error| fault(error.into()))?;
        let extraction = factor::extract(&rows, &ExtractionOptions::default()).map_err(fault)?;
        let varimax = factor::rotate(&extraction, Rotation::default()).map_err(fault)?;
        let rotation = Rotation::Reference(ReferenceRotationOptions::default());
        let reference =
            reference.then(|| factor::rotate(&extraction, rotation)).transpose().map_err(fault)?;
        Ok(Self { activations, extraction, varimax, reference })
    }

    /// The factors by the rotation that was asked for.
    #[must_use]
    pub fn asked(&self) -> &Factors {
        self.reference.as_ref().unwrap_or(&self.varimax)
    }

    /// What is said of [`Self::asked`].
    #[must_use]
    pub fn statistics(&self) -> StatisticsRow {
        StatisticsRow::of(&self.extraction, self.asked())
    }

    /// What a person should know before believing the factors.
    #[must_use]
    pub fn warnings(&self) -> Vec<String> {
        let mut warnings: Vec<String> = self
            .extraction
            .dropped
            .iter()
            .map(|&at| format!("{} is constant and was left out", FACTOR_MUSCLES[at].0))
            .collect();
        let asked = self.asked();
        if !asked.is_reproducible() {
            warnings.push(format!(
                "the rotated factors are not reproducible: a change of the input by 1e-12 moves loadings by {:.1e}",
                asked.shift.unwrap_or(f64::NAN)
            ));
        } else if !asked.converged {
            warnings.push("the rotation did not converge".to_owned());
        }
        warnings
    }

    /// `loadings`: muscle, F1 … Fk.
    pub fn loading_table(&self, factors: &Factors) -> Result<Table, RecordError> {
        let labels = FACTOR_MUSCLES.map(|(label, _)| label);
        let rows = factor::loading_rows(&self.extraction, factors, &labels);
        let muscles: Vec<String> = rows.iter().map(|row| row.muscle.clone()).collect();
        let column = |factor: usize| {
            let loadings: Vec<f64> = rows.iter().map(|row| row.loadings[factor]).collect();
            Column::unitless(format!("F{}", factor + 1), loadings)
        };
        let columns = (0..self.extraction.factor_count).map(column);
        Table::new([Column::unitless("muscle", muscles)].into_iter().chain(columns).collect())
    }

    /// Muscles × factors.
    #[must_use]
    pub fn loading_array(&self, factors: &Factors) -> Member {
        let shape = vec![self.extraction.muscles.len(), self.extraction.factor_count];
        Member::Numbers(Array { shape, elements: Elements::F64(factors.loadings.clone()) })
    }

    /// Factors × points of the cycle.
    #[must_use]
    pub fn waveform_array(&self, factors: &Factors) -> Member {
        let count = self.extraction.factor_count;
        let values = (0..count).flat_map(|factor| waveform(factors, factor, count)).collect();
        let shape = vec![count, self.extraction.time_steps];
        Member::Numbers(Array { shape, elements: Elements::F64(values) })
    }

    /// Waveforms and loadings.
    #[must_use]
    pub fn figure(&self) -> FactorFigure {
        let (asked, count) = (self.asked(), self.extraction.factor_count);
        let panel = |factor: usize| FactorPanel {
            share: asked.shares[factor],
            waveform: waveform(asked, factor, count).collect(),
            loadings: asked.loadings.iter().skip(factor).step_by(count).copied().collect(),
        };
        let muscles = self.extraction.muscles.iter().map(|&at| FACTOR_MUSCLES[at].0.to_owned());
        let averaged = match self.activations.cycles {
            Some([_, retained]) => format!("Mean of {retained} gait cycles. "),
            None => String::new(),
        };
        FactorFigure {
            muscles: muscles.collect(),
            factors: (0..count).map(panel).collect(),
            footer: format!(
                "{averaged}Policy: {}. Rotation: {}. Explained variance: {:.1} %.",
                self.activations.policy,
                asked.rotation.name(),
                100.0 * self.extraction.explained_variance
            ),
        }
    }
}

fn waveform(factors: &Factors, factor: usize, count: usize) -> impl Iterator<Item = f64> {
    factors.waveforms.iter().skip(factor).step_by(count).copied()
}

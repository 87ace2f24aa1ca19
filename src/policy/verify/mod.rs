//! Checks policies against recorded outputs of the published implementation.
//!
//! [`verify_folder`] looks for three kinds of recordings by name: `<name>_model.zip` with `<name>_<task>.npz` (the
//! transformer), `baoding_phase1_<case>_s<seed>.npz` (the published recurrent policy along an episode) and
//! `<env>_seed1_best_policy.pickle` with `<env>_rollout_<physics>.npz` (natural policy gradient). Every recorded
//! quantity is compared; a number agrees if `|got − want| ≤ absolute + relative · |want|`.

mod experts;
mod transformer;

use std::path::{Path, PathBuf};

use super::PolicyError;
use super::checkpoint::CheckpointError;
use crate::npz::ArrayError;

/// Why a folder could not be checked.
#[derive(Debug, thiserror::Error)]
pub enum VerifyError {
    #[error("cannot list folder `{path}`: {source}")]
    Folder { path: PathBuf, source: std::io::Error },
    #[error("there are no recorded policy outputs in `{path}`")]
    Nothing { path: PathBuf },
    #[error("{source}, in `{path}`")]
    Array { source: ArrayError, path: PathBuf },
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error("{source}, in `{path}`")]
    Policy { source: PolicyError, path: PathBuf },
}

/// How far a number may be from the recorded one.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Tolerance {
    pub absolute: f64,
    pub relative: f64,
}

impl Tolerance {
    /// What single precision leaves of agreement after some hundred operations.
    pub const SINGLE: Self = Self { absolute: 1e-5, relative: 1e-5 };
}

/// What became of a check.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Outcome {
    Passed,
    Failed,
    /// Not done, and why.
    Skipped(String),
}

/// One quantity of one recording, compared.
#[derive(Debug, Clone, PartialEq)]
pub struct PolicyCheck {
    /// The recording's file name.
    pub file: String,
    pub quantity: &'static str,
    /// How many numbers were compared.
    pub compared: usize,
    pub largest_absolute: f64,
    /// Largest `|got − want|/|want|` where `want` is not zero.
    pub largest_relative: f64,
    pub tolerance: Tolerance,
    pub outcome: Outcome,
}

impl PolicyCheck {
    fn skipped(file: &str, why: &str) -> Self {
        Self {
            file: file.to_owned(),
            quantity: "all",
            compared: 0,
            largest_absolute: 0.0,
            largest_relative: 0.0,
            tolerance: Tolerance::SINGLE,
            outcome: Outcome::Skipped(why.to_owned()),
        }
    }
}

/// Compares whatever recordings lie in `folder`.
pub fn verify_folder(folder: &Path) -> Result<Vec<PolicyCheck>, VerifyError> {
    let fail = |source| VerifyError::Folder { path: folder.to_path_buf(), source };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        if let Ok(name) = entry.map_err(fail)?.file_name().into_string() {
            names.push(name);
        }
    }
    names.sort_unstable();

    let mut checks = Vec::new();
    for name in &names {
        if let Some(policy) = name.strip_suffix("_model.zip") {
            checks.extend(transformer::verify(folder, policy, &names)?);
        } else if let Some(environment) = name.strip_suffix("_seed1_best_policy.pickle") {
            checks.extend(experts::verify_natural_policy_gradient(folder, environment, &names)?);
        }
    }
    checks.extend(experts::verify_recurrent(folder, &names)?);
    if checks.is_empty() {
        return Err(VerifyError::Nothing { path: folder.to_path_buf() });
    }
    Ok(checks)
}

/// Gathers the differences of one quantity.
struct Comparison {
    quantity: &'static str,
    tolerance: Tolerance,
    compared: usize,
    largest_absolute: f64,
    largest_relative: f64,
    agrees: bool,
}

impl Comparison {
    fn new(quantity: &'static str) -> Self {
        Self {
            quantity,
            tolerance: Tolerance::SINGLE,
            compared: 0,
            largest_absolute: 0.0,
            largest_relative: 0.0,
            agrees: true,
        }
    }

    /// Compares the elements of two rows of equal length; rows of different length disagree.
    fn add(&mut self, got: &[f32], want: &[f32]) {
        self.agrees &= got.len() == want.len();
        for (&got, &want) in got.iter().zip(want) {
            self.add_one(f64::from(got), f64::from(want));
        }
    }

    fn add_one(&mut self, got: f64, want: f64) {
        let difference = (got - want).abs();
        let Tolerance { absolute, relative } = self.tolerance;
        // Written so that a NaN on either side disagrees.
        self.agrees &= difference <= absolute + relative * want.abs();
        self.compared += 1;
        let difference = if difference.is_nan() { f64::INFINITY } else { difference };
        self.largest_absolute = self.largest_absolute.max(difference);
        if want != 0.0 {
            self.largest_relative = self.largest_relative.max(difference / want.abs());
        }
    }

    fn finish(self, file: &str) -> PolicyCheck {
        let outcome =
            if self.agrees && self.compared > 0 { Outcome::Passed } else { Outcome::Failed };
        PolicyCheck {
            file: file.to_owned(),
            quantity: self.quantity,
            compared: self.compared,
            largest_absolute: self.largest_absolute,
            largest_relative: self.largest_relative,
            tolerance: self.tolerance,
            outcome,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_comparison_fails_on_a_nan_a_missing_row_and_a_difference() {
        let outcome = |got: &[f32], want: &[f32]| {
            let mut comparison = Comparison::new("x");
            comparison.add(got, want);
            comparison.finish("file").outcome
        };
        assert_eq!(outcome(&[1.0, 2.0], &[1.0, 2.000_01]), Outcome::Passed);
        assert_eq!(outcome(&[1.0, 2.0], &[1.0, 2.001]), Outcome::Failed);
        assert_eq!(outcome(&[f32::NAN], &[1.0]), Outcome::Failed);
        assert_eq!(outcome(&[1.0], &[1.0, 1.0]), Outcome::Failed);
        assert_eq!(outcome(&[], &[]), Outcome::Failed);
    }
}

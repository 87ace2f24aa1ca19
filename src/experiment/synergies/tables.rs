//! Tables of components and synergies. Columns are upstream's where it has them.

use crate::analysis::subspace::PrincipalComponents;
use crate::experiment::ExperimentError;
use crate::record::{Column, Table};

use super::factorise::SynergyScores;
use super::{Basis, Synergies};

impl Synergies {
    /// `variance`: upstream's columns.
    pub fn variance_table(&self) -> Result<Table, ExperimentError> {
        let rows: Vec<(&Basis, usize, usize, f64)> = self
            .variance
            .iter()
            .flat_map(|curve| {
                let basis = &self.bases[curve.basis];
                (1..).zip(&curve.values).map(move |(n, &value)| (basis, curve.task, n, value))
            })
            .collect();
        let text = |value: &dyn Fn(&Basis, usize) -> String| -> Vec<String> {
            rows.iter().map(|(basis, task, ..)| value(basis, *task)).collect()
        };
        Ok(Table::new(vec![
            Column::unitless("policy", text(&|basis, _| basis.policy.clone())),
            Column::unitless("task", text(&|_, task| self.tasks[task].task.clone())),
            Column::unitless("scope", text(&|basis, _| basis.scope.word().to_owned())),
            Column::unitless("dimension", rows.iter().map(|row| row.2 as i64).collect::<Vec<_>>()),
            Column::unitless(
                "explained_variance",
                rows.iter().map(|row| row.3).collect::<Vec<_>>(),
            ),
        ])?)
    }

    /// `components`: one row per component and muscle.
    pub fn component_table(&self) -> Result<Table, ExperimentError> {
        let rows: Vec<(&Basis, usize, usize)> = self
            .bases
            .iter()
            .flat_map(|basis| {
                let count = basis.components.as_ref().map_or(0, PrincipalComponents::muscle_count);
                (0..count).flat_map(move |n| (0..count).map(move |muscle| (basis, n, muscle)))
            })
            .collect();
        let text = |value: &dyn Fn(&Basis, usize) -> String| -> Vec<String> {
            rows.iter().map(|(basis, _, muscle)| value(basis, *muscle)).collect()
        };
        let number = |value: &dyn Fn(&Basis, usize, usize) -> Option<f64>| -> Vec<f64> {
            rows.iter().map(|(b, n, m)| value(b, *n, *m).unwrap_or(f64::NAN)).collect()
        };
        let muscles = |basis: &Basis| &self.tasks[basis.members[0]].muscles;
        Ok(Table::new(vec![
            Column::unitless("policy", text(&|basis, _| basis.policy.clone())),
            Column::unitless("task", text(&|basis, _| basis.name.clone())),
            Column::unitless("scope", text(&|basis, _| basis.scope.word().to_owned())),
            Column::unitless("component", rows.iter().map(|r| r.1 as i64 + 1).collect::<Vec<_>>()),
            Column::unitless(
                "variance",
                number(&|b, n, _| Some(b.components.as_ref()?.variances[n])),
            ),
            Column::unitless("muscle", text(&|basis, muscle| muscles(basis)[muscle].clone())),
            Column::unitless(
                "weight",
                number(&|b, n, m| Some(b.components.as_ref()?.component(n)[m])),
            ),
            Column::unitless("mean", number(&|b, _, m| Some(b.components.as_ref()?.mean[m]))),
        ])?)
    }

    /// `reconstruction`: how well synergies rebuild the controls.
    pub fn reconstruction_table(&self) -> Result<Table, ExperimentError> {
        let Some(fits) = &self.fits else { return Ok(Table::default()) };
        let rows = &fits.scores;
        let text = |value: &dyn Fn(&SynergyScores) -> String| -> Vec<String> {
            rows.iter().map(value).collect()
        };
        let number = |value: fn(&SynergyScores) -> Option<f64>| -> Vec<f64> {
            rows.iter().map(|row| value(row).unwrap_or(f64::NAN)).collect()
        };
        let fits_of = |row: &SynergyScores| {
            fits.ranks.iter().find(|r| r.basis == row.basis && r.rank == row.rank)
        };
        let count = |value: &dyn Fn(&SynergyScores) -> usize| -> Vec<i64> {
            rows.iter().map(|row| value(row) as i64).collect()
        };
        Ok(Table::new(vec![
            Column::unitless("policy", text(&|row| self.basis_of(row).policy.clone())),
            Column::unitless("task", text(&|row| self.tasks[row.task].task.clone())),
            Column::unitless("scope", text(&|row| self.basis_of(row).scope.word().to_owned())),
            Column::unitless("dimension", count(&|row| row.rank)),
            Column::unitless("reconstruction", number(|row| row.r2)),
            Column::unitless("vaf", number(|row| row.vaf)),
            Column::unitless("r2_uniform", number(|row| Some(row.uniform))),
            Column::unitless("n_fits", count(&|row| fits_of(row).map_or(0, |r| r.fits))),
            Column::unitless("n_converged", count(&|row| fits_of(row).map_or(0, |r| r.converged))),
            Column::unitless("n_timesteps", count(&|row| self.tasks[row.task].steps)),
        ])?)
    }

    /// `synergies`: those of the first fit, one row per synergy and muscle.
    pub fn synergy_table(&self) -> Result<Table, ExperimentError> {
        let Some(fits) = &self.fits else { return Ok(Table::default()) };
        let rows: Vec<(&Basis, usize, usize, usize, f64)> = fits
            .ranks
            .iter()
            .flat_map(|rank| {
                let basis = &self.bases[rank.basis];
                let muscles = rank.synergies.len() / rank.rank.max(1);
                rank.synergies.iter().enumerate().map(move |(at, &weight)| {
                    (basis, rank.rank, at / muscles, at % muscles, weight)
                })
            })
            .collect();
        let text = |value: &dyn Fn(&Basis, usize) -> String| -> Vec<String> {
            rows.iter().map(|(basis, _, _, muscle, _)| value(basis, *muscle)).collect()
        };
        let muscles = |basis: &Basis| &self.tasks[basis.members[0]].muscles;
        Ok(Table::new(vec![
            Column::unitless("policy", text(&|basis, _| basis.policy.clone())),
            Column::unitless("task", text(&|basis, _| basis.name.clone())),
            Column::unitless("scope", text(&|basis, _| basis.scope.word().to_owned())),
            Column::unitless("dimension", rows.iter().map(|r| r.1 as i64).collect::<Vec<_>>()),
            Column::unitless("synergy", rows.iter().map(|r| r.2 as i64 + 1).collect::<Vec<_>>()),
            Column::unitless("muscle", text(&|basis, muscle| muscles(basis)[muscle].clone())),
            Column::unitless("weight", rows.iter().map(|r| r.4).collect::<Vec<_>>()),
        ])?)
    }
}

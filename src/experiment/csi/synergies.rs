//! Synergies as components: non-negative factors of the excitations (`spec/analysis.md` §6.2, §7).
//!
//! A factorisation of every rank, several for each because the published start is drawn at random; each serves its share
//! of a point's episodes. Its score is the R² of a task's excitations rebuilt from it (`variance weighted`), and that of a
//! point the mean over its factorisations.
//!
//! They take long, and every worker needs some. So each is written into the folder of the sweep as it is made, and read by
//! whoever needs it next. Two workers that make the same one write the same bytes.

use std::collections::BTreeMap;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::analysis::subspace::{
    NmfOptions, NmfStart, NonNegativeRows, SynergyProjection, nonnegative_factorisation,
    reconstruction, synergy_weights,
};
use crate::files;

use super::super::ExperimentError;
use super::super::gather::{BASES, Played};
use super::super::parallel;
use super::Scope;
use super::bases::{CsiScene, failed, pool_failed};
use super::design::Point;

/// A factorisation of 1000 muscles into as many synergies has less.
const LARGEST_FIT: u64 = 64 << 20;

/// How excitations are factorised. The default is the published choice.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct SynergyOptions {
    /// Factorisations of every rank; each serves its share of the episodes.
    pub fits: usize,
    /// Whether the zeros of the start are filled with noise, from another seed for every fit, or with the mean.
    pub noise: bool,
}

/// A fit with its scope and the tasks it is of.
pub type ListedFit = (Scope, Vec<&'static str>, SynergyFit);

impl Default for SynergyOptions {
    fn default() -> Self {
        Self { fits: 10, noise: true }
    }
}

impl SynergyOptions {
    pub(super) fn of_fit(&self, fit: usize) -> NmfOptions {
        let start = if self.noise { NmfStart::Noise { seed: fit as u64 } } else { NmfStart::Mean };
        NmfOptions { start, ..NmfOptions::default() }
    }

    /// What decides about one factorisation.
    pub(super) fn document(&self, fit: usize) -> Value {
        let options = self.of_fit(fit);
        let (start, seed) = match options.start {
            NmfStart::Noise { seed } => ("nndsvdar", Some(seed)),
            NmfStart::Mean => ("nndsvda", None),
        };
        json!({
            "start": start,
            "seed": seed,
            "maximum_iterations": options.maximum_iterations,
            "tolerance": options.tolerance,
        })
    }
}

/// A factorisation.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SynergyFit {
    pub components: usize,
    pub fit: usize,
    /// Row-major: one synergy per row, one muscle per column.
    pub synergies: Vec<f64>,
    /// Of each task it was made from: R² of the acting policy's excitations.
    pub scores: Vec<Option<f64>>,
    pub iterations: usize,
    pub has_converged: bool,
}

/// A group of tasks that share a factorisation, a rank, and a number.
type Address = (Vec<usize>, usize, usize);

/// The factorisations of a sweep.
pub(super) struct Fits<'a> {
    pub(super) scene: &'a CsiScene<'a>,
    pub(super) played: &'a Played,
    pub(super) options: &'a SynergyOptions,
}

/// What the factorisations of a group of tasks are made from.
struct Data {
    rows: NonNegativeRows,
    /// Of each task, what the acting policy did.
    measured: Vec<(Vec<f64>, NonNegativeRows)>,
    muscles: usize,
}

impl Fits<'_> {
    /// The projections of `points`.
    pub(super) fn projections(
        &self,
        points: &[Point],
    ) -> Result<Vec<SynergyProjection>, ExperimentError> {
        let fits = self.all(points)?;
        let projection = |point: &Point| {
            let muscles = self.scene.design.tasks[point.task].muscles.len();
            let synergies = &fits[&self.address(point)].synergies;
            SynergyProjection::new(synergies, muscles, &self.options.of_fit(point.fit))
                .map_err(failed(self.scene.design, point.task))
        };
        points.iter().map(projection).collect()
    }

    /// R² of `task` for each number of components; all of them rebuild everything.
    pub(super) fn scores(
        &self,
        task: usize,
        scope: Scope,
        components: &[usize],
    ) -> Result<Vec<f64>, ExperimentError> {
        let muscles = self.scene.design.tasks[task].muscles.len();
        let point = |components, fit| Point { task, scope, components, fit };
        let asked = components.iter().filter(|&&k| k < muscles);
        let points: Vec<Point> =
            asked.flat_map(|&k| (0..self.options.fits).map(move |fit| point(k, fit))).collect();
        let fits = self.all(&points)?;
        let (places, _) = self.scene.design.sources(task, scope);
        let place = places.iter().position(|&place| place == task).unwrap_or_default();
        let score = |&k: &usize| {
            if k == muscles {
                return 1.0;
            }
            let of_fit = |fit| {
                let fit = &fits[&self.address(&point(k, fit))];
                fit.scores.get(place).copied().flatten().unwrap_or(f64::NAN)
            };
            (0..self.options.fits).map(of_fit).sum::<f64>() / self.options.fits as f64
        };
        Ok(components.iter().map(score).collect())
    }

    /// Every factorisation of the sweep once, for its table.
    pub(super) fn listed(&self) -> Result<Vec<ListedFit>, ExperimentError> {
        let mut points = self.scene.design.points();
        let mut seen = std::collections::BTreeSet::new();
        points.retain(|point| seen.insert(self.address(point)));
        points.sort_by_key(|point| point.scope == Scope::Pooled);
        let mut fits = self.all(&points)?;
        let listed = points.iter().filter_map(|point| {
            let (_, names) = self.scene.design.sources(point.task, point.scope);
            Some((point.scope, names, fits.remove(&self.address(point))?))
        });
        Ok(listed.collect())
    }

    fn address(&self, point: &Point) -> Address {
        (self.scene.design.sources(point.task, point.scope).0, point.components, point.fit)
    }

    /// The factorisations of `points`: those that are there are read, the others made.
    fn all(&self, points: &[Point]) -> Result<BTreeMap<Address, SynergyFit>, ExperimentError> {
        let mut fits = BTreeMap::new();
        let mut lacking: BTreeMap<Vec<usize>, Vec<Point>> = BTreeMap::new();
        let mut met = std::collections::BTreeSet::new();
        for point in points {
            let address = self.address(point);
            if !met.insert(address.clone()) {
                continue;
            }
            match self.read(point) {
                Some(fit) => {
                    fits.insert(address, fit);
                }
                None => lacking.entry(address.0).or_default().push(*point),
            }
        }
        let total: usize = lacking.values().map(Vec::len).sum();
        if total > 0 {
            let tick = (self.scene.on_fits)(total);
            for (places, points) in lacking {
                let data = self.data(&places)?;
                for (point, fit) in points.iter().zip(self.make(&data, &points, &*tick)?) {
                    fits.insert(self.address(point), fit);
                }
            }
        }
        Ok(fits)
    }

    /// Makes and keeps the factorisations of `points`, all of the same data.
    fn make(
        &self,
        data: &Data,
        points: &[Point],
        tick: &(dyn Fn() + Sync),
    ) -> Result<Vec<SynergyFit>, ExperimentError> {
        let goes_on = self.scene.goes_on;
        let paths: Vec<PathBuf> = points.iter().map(|point| self.path(point)).collect();
        let (options, design) = (self.options, self.scene.design);
        parallel::in_order(self.scene.threads, points.len(), &|place| {
            if !goes_on() {
                return Err(ExperimentError::Stopped);
            }
            let point = &points[place];
            let fit = factorise(data, point, options).map_err(|source| match point.scope {
                Scope::Task => failed(design, point.task)(source),
                Scope::Pooled => pool_failed(source),
            })?;
            let text = serde_json::to_string(&fit).unwrap_or_default();
            files::write_atomic(&paths[place], text.as_bytes())?;
            tick();
            Ok(fit)
        })
    }

    fn data(&self, places: &[usize]) -> Result<Data, ExperimentError> {
        let design = self.scene.design;
        let muscles = design.tasks[places[0]].muscles.len();
        let of_arm = |arm: usize| -> Result<Vec<f64>, ExperimentError> {
            let episodes = self.played.episodes(arm)?;
            Ok(episodes.into_iter().flat_map(|episode| episode.recording.excitation).collect())
        };
        let rows = |values: &[f64], task: usize| {
            NonNegativeRows::new(values, muscles).map_err(failed(design, task))
        };
        let mut measured = Vec::new();
        let mut together = Vec::new();
        for &place in places {
            let values = of_arm(place)?;
            match design.components_of {
                None => together.extend_from_slice(&values),
                Some(_) => together.extend(of_arm(design.source_arm(place))?),
            }
            let rows = rows(&values, place)?;
            measured.push((values, rows));
        }
        Ok(Data { rows: rows(&together, places[0])?, measured, muscles })
    }

    fn path(&self, point: &Point) -> PathBuf {
        let content = json!([self.played.plan.key, self.scene.design.condition(*point)]);
        let hash = blake3::hash(content.to_string().as_bytes());
        self.scene.folder.join(BASES).join(format!("{}.json", &hash.to_hex()[..24]))
    }

    /// The factorisation of `point`, if somebody made it.
    fn read(&self, point: &Point) -> Option<SynergyFit> {
        let bytes = files::read_bounded(&self.path(point), LARGEST_FIT).ok()?;
        let fit: SynergyFit = serde_json::from_slice(&bytes).ok()?;
        let muscles = self.scene.design.tasks[point.task].muscles.len();
        let fits = (fit.components, fit.fit) == (point.components, point.fit)
            && fit.synergies.len() == point.components * muscles;
        fits.then_some(fit)
    }
}

fn factorise(
    data: &Data,
    point: &Point,
    options: &SynergyOptions,
) -> Result<SynergyFit, crate::analysis::subspace::SubspaceError> {
    let options = options.of_fit(point.fit);
    let made = nonnegative_factorisation(&data.rows, point.components, &options)?;
    let mut scores = Vec::with_capacity(data.measured.len());
    for (measured, rows) in &data.measured {
        let rebuilt = synergy_weights(rows, &made.synergies, &options)?.rebuilt;
        scores.push(reconstruction(measured, &rebuilt, data.muscles)?.centred);
    }
    Ok(SynergyFit {
        components: point.components,
        fit: point.fit,
        synergies: made.synergies,
        scores,
        iterations: made.iterations,
        has_converged: made.has_converged,
    })
}

/// The curve through `values` at `components` (rising) for every number from 1 to the last, as a line would be drawn;
/// undefined before the first.
pub(super) fn interpolated(components: &[usize], values: &[f64]) -> Vec<f64> {
    let Some(&last) = components.last() else { return Vec::new() };
    let mut drawn = vec![f64::NAN; last];
    for place in 0..components.len() {
        drawn[components[place] - 1] = values[place];
        if place > 0 {
            let (from, to) = (components[place - 1], components[place]);
            for between in from + 1..to {
                let share = (between - from) as f64 / (to - from) as f64;
                drawn[between - 1] =
                    values[place - 1] + share * (values[place] - values[place - 1]);
            }
        }
    }
    drawn
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_curve_with_gaps_is_drawn_as_a_line() {
        let drawn = interpolated(&[2, 3, 6], &[0.5, 0.6, 0.9]);
        assert!(drawn[0].is_nan());
        let want = [0.5, 0.6, 0.7, 0.8, 0.9];
        assert!(drawn[1..].iter().zip(want).all(|(x, y)| (x - y).abs() < 1e-12), "{drawn:?}");
        assert!(interpolated(&[], &[]).is_empty());
    }
}

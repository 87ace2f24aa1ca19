//! All fits of all numbers of synergies, on several threads: each is independent of the others.

use crate::analysis::subspace::{
    Factorisation, NonNegativeRows, SubspaceError, exact_synergy_weights,
    nonnegative_factorisation, reconstruction, synergy_weights,
};
use crate::experiment::ExperimentError;
use crate::experiment::parallel::in_order;

use super::{Basis, NmfPlan, TaskActivity, bases};

/// How well a number of synergies of a basis rebuilds the controls of a task; mean over the fits.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct SynergyScores {
    pub(super) basis: usize,
    pub(super) task: usize,
    pub(super) rank: usize,
    /// R² over all columns about their means; undefined without variance.
    pub(super) r2: Option<f64>,
    /// The same about zero: variance accounted for.
    pub(super) vaf: Option<f64>,
    /// Mean over columns of each column's R².
    pub(super) uniform: f64,
}

/// The fits of one basis and number of synergies.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct RankFits {
    pub(super) basis: usize,
    pub(super) rank: usize,
    pub(super) fits: usize,
    /// Fits that reached the tolerance.
    pub(super) converged: usize,
    /// Row-major rank × muscles, of the first fit.
    pub(super) synergies: Vec<f64>,
}

/// What came of all fits.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Fits {
    pub(super) ranks: Vec<RankFits>,
    pub(super) scores: Vec<SynergyScores>,
}

/// Number of fits that [`all`] will make.
#[must_use]
pub fn fit_count(activities: &[TaskActivity], plan: &NmfPlan) -> usize {
    let ranks = |basis: &Basis| ranks_of(activities, basis, plan).len();
    plan.fits * bases(activities).iter().map(ranks).sum::<usize>()
}

/// The numbers of synergies asked for that exist: not more than muscles or steps.
fn ranks_of(activities: &[TaskActivity], basis: &Basis, plan: &NmfPlan) -> Vec<usize> {
    let (steps, muscles) = size(activities, basis);
    let mut ranks = asked(plan, muscles);
    ranks.retain(|&rank| rank <= muscles.min(steps));
    ranks
}

fn asked(plan: &NmfPlan, muscles: usize) -> Vec<usize> {
    plan.ranks.clone().unwrap_or_else(|| (1..=muscles.saturating_sub(1).max(1)).collect())
}

fn size(activities: &[TaskActivity], basis: &Basis) -> (usize, usize) {
    let steps = basis.members.iter().map(|&at| activities[at].take.steps).sum();
    (steps, activities[basis.members[0]].take.muscles.len())
}

/// One factorisation, and its scores in each task of the basis.
struct Fit {
    synergies: Vec<f64>,
    has_converged: bool,
    /// `centred`, `uncentred`, `uniform`.
    scores: Vec<(Option<f64>, Option<f64>, f64)>,
}

/// Makes all fits.
pub(super) fn all(
    activities: &[TaskActivity],
    bases: &[Basis],
    plan: &NmfPlan,
    threads: usize,
    warnings: &mut Vec<String>,
    on_fit: &(dyn Fn() + Sync),
) -> Result<Fits, ExperimentError> {
    let mut data = Vec::with_capacity(bases.len());
    let mut wanted = Vec::new();
    for (place, basis) in bases.iter().enumerate() {
        let (steps, muscles) = size(activities, basis);
        let ranks = ranks_of(activities, basis, plan);
        let most = asked(plan, muscles).into_iter().max().unwrap_or(0);
        if most > muscles.min(steps) {
            warnings.push(format!(
                "`{}` in `{}`: no more than {} synergies, of {steps} steps and {muscles} muscles",
                basis.policy,
                basis.name,
                muscles.min(steps)
            ));
        }
        wanted.extend(ranks.into_iter().map(|rank| (place, rank)));
        let failed = |source| failure(basis, source);
        data.push(match basis.members.as_slice() {
            [one] => NonNegativeRows::new(&activities[*one].controls, muscles).map_err(failed)?,
            many => {
                let stacked: Vec<&[f64]> =
                    many.iter().map(|&at| activities[at].controls.as_slice()).collect();
                NonNegativeRows::new(&stacked.concat(), muscles).map_err(failed)?
            }
        });
    }
    if wanted.is_empty() {
        let Some(basis) = bases.first() else { return Ok(Fits::default()) };
        let (steps, muscles) = size(activities, basis);
        let asked = asked(plan, muscles).into_iter().min().unwrap_or(0);
        let available = muscles.min(steps);
        return Err(failure(basis, SubspaceError::ComponentCount { asked, available }));
    }
    let fits = in_order(threads, wanted.len() * plan.fits, &|job| {
        let (place, rank) = wanted[job / plan.fits];
        let made = fit(activities, &bases[place], &data, (place, rank), job % plan.fits, plan)
            .map_err(|source| failure(&bases[place], source));
        on_fit();
        made
    })?;
    let mut found = Fits::default();
    for (&(place, rank), fits) in wanted.iter().zip(fits.chunks(plan.fits)) {
        let mean = |score: &dyn Fn(&Fit) -> Option<f64>| -> Option<f64> {
            let sum = fits.iter().map(score).sum::<Option<f64>>()?;
            Some(sum / fits.len() as f64)
        };
        for (member, &task) in bases[place].members.iter().enumerate() {
            found.scores.push(SynergyScores {
                basis: place,
                task,
                rank,
                r2: mean(&|fit| fit.scores[member].0),
                vaf: mean(&|fit| fit.scores[member].1),
                uniform: mean(&|fit| Some(fit.scores[member].2)).unwrap_or(f64::NAN),
            });
        }
        let converged = fits.iter().filter(|fit| fit.has_converged).count();
        let synergies = fits.first().map(|fit| fit.synergies.clone()).unwrap_or_default();
        found.ranks.push(RankFits { basis: place, rank, fits: fits.len(), converged, synergies });
    }
    let total: usize = found.ranks.iter().map(|rank| rank.fits).sum();
    let converged: usize = found.ranks.iter().map(|rank| rank.converged).sum();
    if converged < total {
        warnings.push(format!(
            "{} of {total} fits did not reach the tolerance in {} iterations",
            total - converged,
            plan.maximum_iterations
        ));
    }
    Ok(found)
}

fn failure(basis: &Basis, source: SubspaceError) -> ExperimentError {
    let (policy, task) = (basis.policy.clone(), basis.name.clone());
    ExperimentError::Controls { policy, task, source }
}

/// One fit. Data of basis `i` stand at `data[i]`; those of tasks come first, in the order of `activities`.
fn fit(
    activities: &[TaskActivity],
    basis: &Basis,
    data: &[NonNegativeRows],
    (place, rank): (usize, usize),
    number: usize,
    plan: &NmfPlan,
) -> Result<Fit, SubspaceError> {
    let options = plan.options(number);
    let found = nonnegative_factorisation(&data[place], rank, &options)?;
    let mut scores = Vec::with_capacity(basis.members.len());
    for &task in &basis.members {
        let controls = &activities[task].controls;
        let rebuilt = if plan.exact_weights {
            let weights = exact_synergy_weights(controls, &found.synergies, found.muscles)?;
            Factorisation { weights, ..found.clone() }.rebuilt()
        } else {
            synergy_weights(&data[task], &found.synergies, &options)?.rebuilt
        };
        let score = reconstruction(controls, &rebuilt, found.muscles)?;
        scores.push((score.centred, score.uncentred, score.uniform));
    }
    Ok(Fit { synergies: found.synergies, has_converged: found.has_converged, scores })
}

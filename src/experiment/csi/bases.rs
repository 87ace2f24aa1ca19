//! Principal components, who is projected onto what, and the sweep put together.

use std::path::PathBuf;

use crate::analysis::subspace::{self, Covariance, PrincipalComponents, Projection, SubspaceError};
use crate::sim::rollout::{Episode, RolloutPlan, Subspace};

use super::super::ExperimentError;
use super::super::gather::Played;
use super::super::plan::Arm;
use super::super::worker::Scene;
use super::design::{Design, Point};
use super::synergies::{self, Fits};
use super::{Bases, Csi, Curve, Method, Scope, TaskCsi};

/// A design with the policies to play it.
pub struct CsiScene<'a> {
    pub design: &'a Design,
    /// Knows the policies of the arms.
    pub players: &'a dyn Scene,
    /// Where fits are kept while the sweep goes on.
    pub folder: PathBuf,
    /// Fits made at once.
    pub threads: usize,
    /// Whether the work goes on.
    pub goes_on: &'a (dyn Fn() -> bool + Sync),
    /// Told how many fits are to be made; what it gives back is called after each.
    pub on_fits: &'a dyn Fn(usize) -> Box<dyn Fn() + Sync>,
}

impl Scene for CsiScene<'_> {
    fn rollout(&self, arm: &Arm) -> RolloutPlan<'_> {
        self.players.rollout(arm)
    }

    fn projections(
        &self,
        arms: &[usize],
        played: &Played,
    ) -> Result<Vec<Option<Subspace>>, ExperimentError> {
        let (points, free_arms) = (self.design.points(), self.design.free_arms());
        let point = |&arm: &usize| Some(points[arm.checked_sub(free_arms)?]);
        let points: Vec<Point> = arms.iter().filter_map(point).collect();
        if points.is_empty() {
            return Ok(vec![None; arms.len()]);
        }
        let made = match &self.design.options.method {
            Method::PrincipalComponents => {
                let bases = PrincipalBases::of(self.design, played)?;
                let projection = |point: &Point| {
                    let basis = bases.basis(self.design, point.task, point.scope);
                    Projection::new(basis, point.components)
                        .map(Subspace::Actions)
                        .map_err(failed(self.design, point.task))
                };
                points.iter().map(projection).collect::<Result<Vec<_>, _>>()?
            }
            Method::Synergies(options) => {
                let fits = Fits { scene: self, played, options };
                fits.projections(&points)?.into_iter().map(Subspace::Excitations).collect()
            }
        };
        // Stages do not mix: either all arms are projected or none is.
        Ok(made.into_iter().map(Some).collect())
    }
}

/// The whole sweep, once all its episodes are played.
pub fn assemble(scene: &CsiScene<'_>, played: &Played) -> Result<Csi, ExperimentError> {
    let design = scene.design;
    let task = |place: usize| -> Result<(Vec<Episode>, Vec<Curve>), ExperimentError> {
        let mut free = played.episodes(place)?;
        free.iter_mut().for_each(|episode| episode.recording = Default::default());
        let curves = curves_without_reconstruction(design, played, place, &free)?;
        Ok((free, curves))
    };
    let mut tasks = Vec::new();
    for (place, sweeper) in design.tasks.iter().enumerate() {
        let (free, curves) = task(place)?;
        let muscles = sweeper.muscles.clone();
        tasks.push(TaskCsi { task: sweeper.task, muscles, free, curves });
    }
    let bases = match &design.options.method {
        Method::PrincipalComponents => {
            let bases = PrincipalBases::of(design, played)?;
            for (place, task) in tasks.iter_mut().enumerate() {
                for curve in &mut task.curves {
                    let basis = bases.basis(design, place, curve.scope);
                    let explained = subspace::pooled_curve(basis, &bases.acting[place])
                        .map_err(failed(design, place))?;
                    curve.reconstruction =
                        curve.components.iter().map(|&k| explained[k - 1]).collect();
                    curve.drawn_reconstruction = explained;
                }
            }
            bases.listed(design)
        }
        Method::Synergies(options) => {
            let fits = Fits { scene, played, options };
            for (place, task) in tasks.iter_mut().enumerate() {
                for curve in &mut task.curves {
                    curve.reconstruction = fits.scores(place, curve.scope, &curve.components)?;
                    curve.drawn_reconstruction =
                        synergies::interpolated(&curve.components, &curve.reconstruction);
                }
            }
            Bases::Synergies(fits.listed()?)
        }
    };
    // A curve of a body's only task is its own; it stands in both places.
    let shared_with: Vec<_> =
        (0..tasks.len()).map(|place| design.sources(place, Scope::Pooled).1).collect();
    for (task, shared) in tasks.iter_mut().zip(&shared_with) {
        if design.options.pooled && shared.len() == 1 {
            task.curves.push(Curve { scope: Scope::Pooled, ..task.curves[0].clone() });
        }
    }
    Ok(Csi {
        method: design.options.method.clone(),
        tasks,
        bases,
        shared_with,
        foreign: design.components_of.is_some(),
        experts: None,
    })
}

/// The episodes of every point of one task.
fn curves_without_reconstruction(
    design: &Design,
    played: &Played,
    task: usize,
    free: &[Episode],
) -> Result<Vec<Curve>, ExperimentError> {
    let muscles = design.tasks[task].muscles.len();
    let points = design.points();
    let mut scopes: Vec<Scope> =
        points.iter().filter(|point| point.task == task).map(|point| point.scope).collect();
    scopes.dedup();
    if scopes.is_empty() {
        // Nothing but all components was asked for.
        scopes.push(Scope::Task);
    }
    let mut curves = Vec::new();
    for scope in scopes {
        let components = design.asked(task);
        let mut episodes = Vec::with_capacity(components.len());
        for &count in &components {
            if count == muscles {
                episodes.push(free.to_vec());
                continue;
            }
            let mut of_point = Vec::with_capacity(free.len());
            for (place, point) in points.iter().enumerate() {
                if (point.task, point.scope, point.components) == (task, scope, count) {
                    of_point.extend(played.episodes(design.free_arms() + place)?);
                }
            }
            episodes.push(of_point);
        }
        let (reconstruction, drawn_reconstruction) = (Vec::new(), Vec::new());
        curves.push(Curve { scope, components, reconstruction, drawn_reconstruction, episodes });
    }
    Ok(curves)
}

/// Principal components of every task, and of all tasks of a body.
struct PrincipalBases {
    /// Of the actions of the policy that acts, by task.
    acting: Vec<Covariance>,
    /// By task.
    own: Vec<PrincipalComponents>,
    /// By the places of the tasks that share it; none unless asked for.
    pooled: Vec<(Vec<usize>, PrincipalComponents)>,
}

impl PrincipalBases {
    fn of(design: &Design, played: &Played) -> Result<Self, ExperimentError> {
        let covariance = |arm: usize, task: usize| -> Result<Covariance, ExperimentError> {
            let mut covariance = Covariance::new(design.tasks[task].muscles.len());
            for episode in played.episodes(arm)? {
                covariance
                    .push_rows(&episode.recording.action_mean)
                    .map_err(failed(design, task))?;
            }
            Ok(covariance)
        };
        let (mut acting, mut source) = (Vec::new(), Vec::new());
        for task in 0..design.tasks.len() {
            acting.push(covariance(task, task)?);
            if design.components_of.is_some() {
                source.push(covariance(design.source_arm(task), task)?);
            }
        }
        let source = if source.is_empty() { &acting } else { &source };
        let own = source
            .iter()
            .enumerate()
            .map(|(task, covariance)| {
                subspace::principal_components(covariance).map_err(failed(design, task))
            })
            .collect::<Result<Vec<_>, _>>()?;
        let mut pooled: Vec<(Vec<usize>, PrincipalComponents)> = Vec::new();
        for task in 0..design.tasks.len() {
            let (places, _) = design.sources(task, Scope::Pooled);
            if !design.options.pooled || places[0] != task {
                continue;
            }
            let mut together = source[task].clone();
            for &other in &places[1..] {
                together.merge(&source[other]).map_err(pool_failed)?;
            }
            let basis = subspace::principal_components(&together).map_err(pool_failed)?;
            pooled.push((places, basis));
        }
        Ok(Self { acting, own, pooled })
    }

    fn basis(&self, design: &Design, task: usize, scope: Scope) -> &PrincipalComponents {
        let (places, _) = design.sources(task, scope);
        let pooled = self.pooled.iter().find(|(tasks, _)| places.len() > 1 && *tasks == places);
        pooled.map_or(&self.own[task], |(_, basis)| basis)
    }

    fn listed(self, design: &Design) -> Bases {
        let name = |place: usize| design.tasks[place].task.name;
        let own = self.own.into_iter().enumerate();
        let own = own.map(|(place, basis)| (Scope::Task, vec![name(place)], basis));
        let pooled = self
            .pooled
            .into_iter()
            .map(|(places, basis)| (Scope::Pooled, places.into_iter().map(name).collect(), basis));
        Bases::PrincipalComponents(own.chain(pooled).collect())
    }
}

/// Actions of one task without a subspace.
pub(super) fn failed(
    design: &Design,
    task: usize,
) -> impl Fn(SubspaceError) -> ExperimentError + 'static {
    let task = design.tasks[task].task.name;
    move |source| ExperimentError::Subspace { task: task.to_owned(), source }
}

/// The same for all of a body.
pub(super) fn pool_failed(source: SubspaceError) -> ExperimentError {
    ExperimentError::Subspace { task: "pooled".to_owned(), source }
}

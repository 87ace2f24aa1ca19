//! Control-subspace inactivation: how many components of its own muscle space does a policy need? (`spec/analysis.md`
//! §6, §7)
//!
//! Per task: episodes of the free policy give a basis, principal components of its action means or synergies of its
//! excitations. The same episodes are then played again with only k of them left, for k = 1 … M. All components are the
//! identity, so the last point is the free policy itself and is not played twice. The *pooled* basis is that of all tasks
//! of one body stacked without weights; for a body with one task it is the task's own, and the curve is not played twice
//! either.
//!
//! * `design`: which episodes that takes, in two stages.
//! * `bases`: principal components, and who is projected onto what.
//! * `synergies`: the same with non-negative factors.
//! * `report`: tables, document, figure.
//! * `stored`: the projections of a finished sweep, from its tables.

mod bases;
mod design;
mod report;
mod stored;
mod synergies;

pub use super::synergies::Scope;
pub use bases::{CsiScene, assemble};
pub use design::{Design, Sweeper};
pub use report::{basis_table, curve_table, document, episode_table, figure};
pub use stored::stored_projection;
pub use synergies::{ListedFit, SynergyFit, SynergyOptions};

use crate::analysis::stats::{BootstrapOptions, Divisor, Interval, Summary, bootstrap_mean};
use crate::analysis::subspace::{self, Dimensionality, PrincipalComponents};
use crate::sim::rollout::Episode;
use crate::sim::tasks::Definition;

/// What to sweep.
#[derive(Debug, Clone, PartialEq)]
pub struct CsiOptions {
    /// Episodes per point.
    pub episodes: usize,
    /// Numbers of components to play; those beyond the muscle count are left out. `None`: all.
    pub components: Option<Vec<usize>>,
    /// Whether the pooled basis is played as well.
    pub pooled: bool,
    pub method: Method,
}

/// What the components are.
#[derive(Debug, Clone, PartialEq)]
pub enum Method {
    /// Principal components of the action means; actions are projected.
    PrincipalComponents,
    /// Non-negative factors of the excitations; excitations are rebuilt from them.
    Synergies(SynergyOptions),
}

impl Method {
    /// The word in tables, as published.
    #[must_use]
    pub fn word(&self) -> &'static str {
        match self {
            Self::PrincipalComponents => "pca",
            Self::Synergies(_) => "nmf",
        }
    }

    /// What [`Curve::reconstruction`] is called.
    fn reconstruction_word(&self) -> &'static str {
        match self {
            Self::PrincipalComponents => "explained_variance",
            Self::Synergies(_) => "r_squared",
        }
    }

    /// Factorisations behind every point.
    fn fits(&self) -> usize {
        match self {
            Self::PrincipalComponents => 1,
            Self::Synergies(options) => options.fits,
        }
    }
}

/// Performance and reconstruction against the number of components.
#[derive(Debug, Clone)]
pub struct Curve {
    /// Where the basis comes from.
    pub scope: Scope,
    /// Numbers of components, rising.
    pub components: Vec<usize>,
    /// Share of the task's actions that the components hold, one per entry of `components`: explained variance, or R² of
    /// the excitations.
    pub reconstruction: Vec<f64>,
    /// The same for every number of components from 1 on, for drawing.
    pub drawn_reconstruction: Vec<f64>,
    /// Episodes of each point.
    pub episodes: Vec<Vec<Episode>>,
}

/// One task's sweep.
#[derive(Debug, Clone)]
pub struct TaskCsi {
    /// The task.
    pub task: &'static Definition,
    /// Names of its muscles.
    pub muscles: Vec<String>,
    /// Episodes of the free policy.
    pub free: Vec<Episode>,
    /// Its curves: the task's own, then the pooled one if asked for.
    pub curves: Vec<Curve>,
}

/// The bases of a sweep.
#[derive(Debug, Clone)]
pub enum Bases {
    /// By the tasks whose actions made it: those of one task in the order of the tasks, then pooled ones.
    PrincipalComponents(Vec<(Scope, Vec<&'static str>, PrincipalComponents)>),
    /// The same, for every number of synergies.
    Synergies(Vec<ListedFit>),
}

/// A whole sweep.
#[derive(Debug, Clone)]
pub struct Csi {
    pub method: Method,
    /// Tasks in the order asked for.
    pub tasks: Vec<TaskCsi>,
    pub bases: Bases,
    /// Of each task, those that share its pooled basis.
    pub shared_with: Vec<Vec<&'static str>>,
    /// Whether the components are another policy's.
    pub foreign: bool,
    /// The experts' solved fractions, by task, if performance is to be put in percent of them.
    pub experts: Option<Vec<Option<f64>>>,
}

/// One point of a curve.
struct Point {
    components: usize,
    reconstruction: f64,
    solved: Summary,
    interval: Option<Interval>,
}

impl TaskCsi {
    fn fractions(&self, episodes: &[Episode]) -> Vec<f64> {
        episodes.iter().map(|e| e.solved_steps as f64 / self.task.horizon as f64).collect()
    }

    /// Solved fraction of the free policy.
    #[must_use]
    pub fn unprojected(&self) -> Summary {
        Summary::of(&self.fractions(&self.free), Divisor::Count)
    }

    fn points<'a>(&'a self, curve: &'a Curve) -> impl Iterator<Item = Point> + 'a {
        (0..curve.components.len()).map(move |place| {
            let fractions = self.fractions(&curve.episodes[place]);
            Point {
                components: curve.components[place],
                reconstruction: curve.reconstruction[place],
                solved: Summary::of(&fractions, Divisor::Count),
                interval: bootstrap_mean(&fractions, &BootstrapOptions::default()),
            }
        })
    }

    /// Functional dimensionality of a curve at a share of the free policy's performance. Undefined if the curve leaves
    /// out a smaller number of components: the fewest cannot be known then.
    #[must_use]
    pub fn dimensionality(&self, curve: &Curve, share: f64) -> Option<Dimensionality> {
        let unbroken = curve.components.iter().zip(1..).take_while(|&(&k, i)| k == i).count();
        self.dimensionality_of(curve, unbroken, share)
    }

    /// The same among the numbers of components that were played: of all, the fewest are at most so many.
    #[must_use]
    pub fn dimensionality_at_most(&self, curve: &Curve, share: f64) -> Option<Dimensionality> {
        self.dimensionality_of(curve, curve.components.len(), share)
    }

    fn dimensionality_of(&self, curve: &Curve, first: usize, share: f64) -> Option<Dimensionality> {
        let performance: Vec<Vec<f64>> =
            curve.episodes[..first].iter().map(|episodes| self.fractions(episodes)).collect();
        subspace::functional_dimensionality_of(
            &curve.components[..first],
            &performance,
            &self.fractions(&self.free),
            share,
            &BootstrapOptions::default(),
        )
    }
}

//! What was played, put together in the order of the plan: the same whoever played which part, when and where.

use std::ops::Range;
use std::path::{Path, PathBuf};

use crate::sim::rollout::Episode;

use super::ExperimentError;
use super::book::{Book, Depth};
use super::ledger::LEDGERS;
use super::plan::{PLAN, Plan, PlanError};
use crate::files::{self, FileError};

/// Folder in that of a sweep of what later stages are played with.
pub const BASES: &str = "bases";

/// Why a sweep cannot be put together.
#[derive(Debug, thiserror::Error)]
pub enum SweepError {
    #[error(transparent)]
    Plan(#[from] PlanError),
    #[error("{missing} of {planned} episodes are not played yet, in `{folder}`")]
    Missing { missing: usize, planned: usize, folder: PathBuf },
}

/// The episodes of a sweep, as far as they are played.
#[derive(Debug)]
pub struct Played {
    pub plan: Plan,
    pub book: Book,
    /// Folder of the sweep.
    pub folder: PathBuf,
    places: Vec<Range<usize>>,
}

impl Played {
    /// Reads what there is.
    pub fn read(plan: &Plan, folder: &Path, depth: Depth) -> Result<Self, FileError> {
        let book = Book::read(plan, folder, depth)?;
        let places = plan.places();
        Ok(Self { plan: plan.clone(), book, folder: folder.to_path_buf(), places })
    }

    /// Reads everything, or says what is missing.
    pub fn complete(plan: &Plan, folder: &Path) -> Result<Self, ExperimentError> {
        let played = Self::read(plan, folder, Depth::Steps)?;
        let planned = plan.episode_count();
        let missing = planned - played.book.done_in(0..planned);
        if missing > 0 {
            let folder = folder.to_path_buf();
            return Err(SweepError::Missing { missing, planned, folder }.into());
        }
        Ok(played)
    }

    /// The episodes of the arm at `place`, in order, with what was kept of their steps.
    pub fn episodes(&self, place: usize) -> Result<Vec<Episode>, ExperimentError> {
        let arm = &self.plan.arms[place];
        let places = self.places[place].clone();
        let planned = places.len();
        let mut episodes = Vec::with_capacity(planned);
        for (number, place) in (arm.first..).zip(places) {
            if let Some((outcome, recording)) = self.book.episode(place)? {
                episodes.push(Episode {
                    spec: self.plan.spec(arm, number, None),
                    steps: outcome.steps as usize,
                    solved_steps: outcome.solved_steps as usize,
                    reward: outcome.reward,
                    terminated: outcome.terminated,
                    diverged_steps: outcome.diverged_steps as usize,
                    recording,
                });
            }
        }
        if episodes.len() < planned {
            let (missing, folder) = (planned - episodes.len(), self.folder.clone());
            return Err(SweepError::Missing { missing, planned, folder }.into());
        }
        Ok(episodes)
    }
}

/// Takes away plan, ledgers and bases, once the results they led to are written.
pub fn tidy(folder: &Path) -> Result<(), FileError> {
    files::remove(&folder.join(PLAN))?;
    files::remove_folder(&folder.join(LEDGERS))?;
    files::remove_folder(&folder.join(BASES))
}

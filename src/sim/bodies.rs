//! The bodies of one physics: each model file is compiled once and copied from then on.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};

use super::engine::{EngineError, Library, Simulation};
use super::tasks::Source;

/// Compiles and copies models.
#[derive(Debug)]
pub struct Bodies {
    library: Arc<Library>,
    myosuite: PathBuf,
    data: PathBuf,
    compiled: Mutex<BTreeMap<(Source, &'static str), Simulation>>,
}

impl Bodies {
    /// Bodies in `library` from the package folder `myosuite` and the data folder `data`.
    #[must_use]
    pub fn new(library: Arc<Library>, myosuite: &Path, data: &Path) -> Self {
        Self {
            library,
            myosuite: myosuite.to_path_buf(),
            data: data.to_path_buf(),
            compiled: Mutex::new(BTreeMap::new()),
        }
    }

    /// A body of its own of the model file `model` from `source`, as compiled.
    pub fn body(&self, source: Source, model: &'static str) -> Result<Simulation, EngineError> {
        let mut compiled = self.compiled.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(simulation) = compiled.get(&(source, model)) {
            return simulation.duplicate();
        }
        let folder = match source {
            Source::MyoSuite => &self.myosuite,
            Source::Data => &self.data,
        };
        let path = folder.join(model);
        if !path.is_file() {
            return Err(EngineError::NoModel { path });
        }
        let simulation = Simulation::load(&self.library, &path)?;
        let body = simulation.duplicate();
        compiled.insert((source, model), simulation);
        body
    }
}

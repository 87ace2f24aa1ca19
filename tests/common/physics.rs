//! Installed physics and models. Every test that moves a body needs them; without, it fails and says how to get them.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::PathBuf;
use std::sync::Arc;

use arnold_analyze::assets::{AssetError, Cache, PhysicsVersion};
use arnold_analyze::experiment::verify_traces::{self, TraceError, TraceFile, TraceReport};
use arnold_analyze::sim::bodies::Bodies;
use arnold_analyze::sim::engine::{EngineError, Library};
use arnold_analyze::sim::environment::Environment;
use arnold_analyze::sim::rollout::Machine;
use arnold_analyze::sim::tasks::{Definition, RewardConfiguration};

fn installed(found: Result<PathBuf, AssetError>) -> PathBuf {
    found.unwrap_or_else(|error| panic!("{error}\n\nhint: {}; `make test` does", error.hint()))
}

/// Installed physics of one version, and the models.
pub(crate) struct Physics {
    bodies: Arc<Bodies>,
}

impl Physics {
    pub(crate) fn of(version: PhysicsVersion) -> Self {
        let cache = Cache::locate();
        let library = installed(cache.physics_library(version));
        let library = Library::open(version, &library).unwrap();
        let models = installed(cache.myosuite());
        Self { bodies: Arc::new(Bodies::new(library, &models, &super::data_folder())) }
    }

    /// A body for `task`.
    pub(crate) fn body(&self, task: &'static Definition) -> Environment {
        Environment::new(task, &self.bodies, RewardConfiguration::Sparse).unwrap()
    }

    /// What replaying `trace` shows; nothing if there is no such task yet.
    pub(crate) fn replay(&self, trace: &TraceFile) -> Option<TraceReport> {
        match verify_traces::replay(trace, &self.bodies) {
            Err(TraceError::Engine(error @ EngineError::NoModel { .. })) => {
                eprintln!("skipped: {error}");
                None
            }
            other => other.unwrap(),
        }
    }

    /// One thread with two bodies.
    pub(crate) fn machine(&self) -> Machine {
        Machine { bodies: self.bodies.clone(), threads: 1, batch: 2 }
    }
}

/// The elbow policy that comes with the models.
pub(crate) fn elbow_policy() -> PathBuf {
    installed(Cache::locate().npg_elbow_policy())
}

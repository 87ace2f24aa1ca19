//! For `inspect`: whether a policy can be played as it lies there, which observation it wants, and which tasks it fits.
//!
//! Asks the tasks themselves, so it needs physics and models; it fetches nothing.

use std::path::Path;
use std::sync::Arc;

use serde_json::{Value, json};

use crate::assets::{Cache, PhysicsVersion};
use crate::cli::context::Context;
use crate::policy::{self, ObservationVariant};
use crate::sim::bodies::Bodies;
use crate::sim::engine::Library;
use crate::sim::environment::Environment;
use crate::sim::tasks::{self, RewardConfiguration};

/// What the person may expect of `--policy FILE`.
pub(super) fn fit(context: &Context, file: &Path) -> Value {
    let loaded = match policy::open(file, None) {
        Ok(loaded) => loaded,
        Err(error) => return json!({"refused": error.to_string()}),
    };
    let policy = loaded.policy.as_ref();
    let observation = match policy.variant() {
        ObservationVariant::Muscle => "what every muscle and joint feels, one token per sensor",
        ObservationVariant::Clean => "what the original single-task environment shows",
        ObservationVariant::CleanAndMuscles => {
            "what the original single-task environment shows, and length and velocity of every muscle"
        }
    };
    let mut document = json!({"observation": observation, "warnings": loaded.warnings});
    let Some(bodies) = bodies(context) else {
        document["tasks"] = json!("unknown until `arnold-analyze setup` has fetched the models");
        return document;
    };
    let (mut fitting, mut absent) = (Vec::new(), Vec::new());
    for task in tasks::ALL {
        match Environment::new(task, &bodies, RewardConfiguration::Sparse) {
            Ok(environment) if policy.bind(&environment.interface(), 1).is_ok() => {
                fitting.push(task.name);
            }
            Ok(_) => {}
            Err(_) => absent.push(task.name),
        }
    }
    document["tasks"] = json!(fitting);
    if !absent.is_empty() {
        let text = format!("{} could not be asked: their model is not here", absent.join(", "));
        if let Some(warnings) = document["warnings"].as_array_mut() {
            warnings.push(json!(text));
        }
    }
    document
}

/// The bodies of all tasks, if everything they need is installed.
fn bodies(context: &Context) -> Option<Bodies> {
    let cache = Cache::locate();
    let version = PhysicsVersion::default();
    let library = Library::open(version, &cache.physics_library(version).ok()?).ok()?;
    let models = cache.myosuite().ok()?;
    Some(Bodies::new(Arc::clone(&library), &models, &context.data))
}

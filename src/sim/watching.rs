//! Looking on while episodes are played.
//!
//! A [`Watcher`] is called from the worker threads, so it must be quick and may not wait; it is only shown things, so what is
//! played does not depend on it.

use super::environment::{Environment, StepOutcome};
use super::rollout::EpisodeSpec;

/// What happened in a step, beside what the body shows.
#[derive(Debug, Clone, Copy)]
pub struct Stepped<'a> {
    /// Steps so far, this one included.
    pub step: usize,
    /// The action that was chosen, with noise, before any projection.
    pub chosen: &'a [f32],
    /// The action after it.
    pub action: &'a [f32],
    pub outcome: &'a StepOutcome,
}

/// Somebody who looks on. `job` and `index` say which episode of which list it is.
pub trait Watcher: Sync {
    /// An episode begins, in the state that `environment` shows; it is confined to so many `components`, if to any.
    fn begins(
        &self,
        job: usize,
        index: usize,
        spec: &EpisodeSpec,
        components: Option<usize>,
        environment: &Environment,
    );

    /// A step was made.
    fn stepped(&self, job: usize, index: usize, environment: &Environment, stepped: &Stepped<'_>);
}

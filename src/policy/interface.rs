//! What a policy and a task must know of each other, and nothing more.
//!
//! A task offers two observation vectors: the *muscle* vector, one token per sensor, which the transformer sees, and
//! the *clean* vector, which the single-task experts were trained on (`spec/tasks.md` §2). A policy says which of them
//! it wants (the walking expert: and the muscles' lengths and velocities) and is then bound to the task: everything that is constant for the task is computed once.

use super::PolicyError;
use super::policies::muscle_model::MuscleModel;

/// Which of a task's two observation vectors a policy was trained on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ObservationVariant {
    /// Every sensor of the muscle-driven body, as the transformer sees it.
    Muscle,
    /// The shorter vector of the original single-task environment.
    Clean,
    /// That vector, then the length (m) and the lengthening velocity (m/s) of every muscle.
    CleanAndMuscles,
}

/// How an action is drawn around its mean.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Sampling {
    /// By [`Actor::sample`], from normal numbers.
    Gaussian,
    /// Uniformly, up to this far on either side.
    Uniform {
        /// Half of the range.
        half_width: f32,
    },
}

/// What a policy needs to know about a task before it can play it.
#[derive(Debug, Clone)]
pub struct TaskInterface {
    /// Code name, e.g. `baoding_p1_ccw`.
    pub task: String,
    /// Number of muscles, i.e. the length of an action.
    pub muscle_count: usize,
    /// Length of the muscle observation.
    pub muscle_observation_length: usize,
    /// Length of the clean observation.
    pub clean_observation_length: usize,
    /// Vocabulary ids describing each element of the muscle observation, without padding.
    pub observation_words: Vec<Vec<u16>>,
    /// Vocabulary ids describing each muscle as an action, without padding.
    pub action_words: Vec<Vec<u16>>,
    /// How each muscle pulls, for policies that ask for lengths rather than excitations. Empty where there is no body.
    pub muscle_models: Vec<MuscleModel>,
}

/// A policy that was read from a file and can be bound to tasks. Shared between threads.
pub trait Policy: Send + Sync {
    /// Which observation it wants.
    fn variant(&self) -> ObservationVariant;

    /// Which observation it wants in `task`: the same everywhere, except for a set of experts.
    fn variant_in(&self, _task: &str) -> ObservationVariant {
        self.variant()
    }

    /// Prepares it for `task` with room for `slots` bodies that are played at the same time. Fails, naming both
    /// numbers, if the task does not fit.
    fn bind(&self, task: &TaskInterface, slots: usize) -> Result<Box<dyn Actor>, PolicyError>;

    /// Whether its standard deviations are known. Some exploration schemes depend on settings that the file does not
    /// hold (`spec/policy.md` §4.3): such a policy can only be played by its means, and answers with NaN otherwise.
    fn is_stochastic(&self) -> bool {
        true
    }

    /// What somebody who binds it to `task` should be told, e.g. sensors that the normaliser has never seen.
    fn warnings(&self, _task: &TaskInterface) -> Vec<String> {
        Vec::new()
    }

    /// Tasks it was trained on; empty if no file says.
    fn trained_tasks(&self) -> &[String] {
        &[]
    }
}

/// A policy bound to a task, playing up to `slots` bodies. It owns whatever changes from step to step: recurrent
/// state, history window, scratch memory. Belongs to one thread.
pub trait Actor: Send {
    /// Forgets everything about the episode in `slot`; called at every reset.
    fn reset(&mut self, slot: usize);

    /// One action for each body named in `slots`. All slices are row-major with one row per entry of `slots`, in that
    /// order. `observations` holds the newest raw observation (slots × length); `action_means` (slots × muscles)
    /// receives the mean of the action distribution before any clipping; `standard_deviations` (same shape), when
    /// wanted, its standard deviation.
    ///
    /// A row's bytes depend only on that slot's own history: never on the batch, the order or the thread.
    /// Does not allocate.
    fn act(
        &mut self,
        slots: &[usize],
        observations: &[f32],
        action_means: &mut [f32],
        standard_deviations: Option<&mut [f32]>,
    );

    /// Turns the mean in `action` into a sample, right after [`Self::act`] gave it and `standard_deviations` for the body
    /// in `slot`. `normal` draws standard normal numbers. Muscles are independent unless a family says otherwise.
    fn sample(
        &mut self,
        _slot: usize,
        standard_deviations: &[f32],
        action: &mut [f32],
        normal: &mut dyn FnMut() -> f64,
    ) {
        for (action, deviation) in action.iter_mut().zip(standard_deviations) {
            *action += deviation * normal() as f32;
        }
    }

    /// Whether this family's own `predict` clips what it sends to the body to [-1, 1] (`spec/policy.md` §1.10).
    fn clips_actions(&self) -> bool;

    /// How actions are drawn around their means.
    fn sampling(&self) -> Sampling {
        Sampling::Gaussian
    }
}

//! Scenes for the viewer Rerun: bodies, tendons, contacts and every signal of an episode, as a file or live.
//!
//! An [`Act`] is one episode on a stage: one or several [`Take`]s of it (two policies, two numbers of components) stand side
//! by side on one timeline. Each act is a recording of its own in the viewer, so that episodes can be stepped through. A
//! [`Blueprint`](blueprint) arranges the views.
//!
//! The timelines are `time`, in seconds, and `step`. Frame 0 is the start of the episode, frame *i* the state after *i*
//! steps; a signal taken before a step stands at the frame before it.
//!
//! The messages of the same episode are the same bytes: chunks and rows are numbered from one instead of by the clock
//! ([`store`]). Only the index at the end of a file differs from run to run ([`file`]).

mod blueprint;
mod file;
mod heat;
mod live;
mod palette;
mod script;
mod signals;
mod solid;
mod stage;
mod store;

use crate::units::Seconds;

pub use file::write_scene;
pub use heat::rows_in_words;
pub use live::{Broadcast, Connection, Viewer};
pub use script::{Act, Take};
pub use signals::{Scale, Signal};
pub use solid::{Solid, capsule, cuboid, cylinder, ellipsoid};
pub use store::SceneError;

/// A position (m) and an orientation (x, y, z, w).
pub type Pose = ([f32; 3], [f32; 4]);

/// What stands on a stage and does not change: bodies with their surfaces, muscles, what is to be reached.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Stage {
    pub bodies: Vec<StageBody>,
    /// Where some of the bodies should be.
    pub ghost: Vec<(usize, Pose)>,
    pub muscles: Vec<String>,
    /// Force that draws each muscle at its full thickness, N.
    pub strongest: Vec<f32>,
    /// What is to be reached counts as reached within these distances, m.
    pub targets: Vec<f32>,
    /// Whether one sees the floor, at height 0.
    pub floor: bool,
    /// Thickness of a tendon that does not pull, m.
    pub thread: f32,
    /// Where to look from, and at what, m.
    pub eye: [f32; 3],
    pub look_at: [f32; 3],
    /// The body that the eye goes along with, for those that walk away.
    pub follow: Option<usize>,
}

/// A body of a stage.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct StageBody {
    pub name: String,
    /// Its surface, in its own frame.
    pub solid: Solid,
    /// What of it one can look through.
    pub glass: Solid,
}

/// Where everything is after a number of steps.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Frame {
    pub step: usize,
    pub bodies: Vec<Pose>,
    /// The path of each muscle; empty where none is known.
    pub paths: Vec<Vec<[f32; 3]>>,
    /// Activation of each muscle, 0..1.
    pub activation: Vec<f32>,
    /// Pull of each muscle, N.
    pub force: Vec<f32>,
    /// Where the targets are, m.
    pub targets: Vec<[f32; 3]>,
    /// Positions (m) and forces (N) of the contacts.
    pub contacts: Vec<([f32; 3], f32)>,
    pub solved: bool,
}

/// The times of frames.
fn seconds(step: usize, interval: Seconds) -> Seconds {
    step as f64 * interval
}

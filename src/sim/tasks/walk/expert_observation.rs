//! What the single-task walking expert sees: 15 N + 69 numbers for a body of N parts (`spec/tasks.md` §2.7).
//!
//! In this order: height of the root; cosine and sine of two lean angles; positions of all parts but the root's, relative to
//! the root; the images of the x and of the z axis of every part; linear and angular velocities of all parts; touch; 42
//! zeros; and for seven tracked parts their position relative to the root, where the goal stands in for the root's own.
//! All vectors are along heading axes (see [`Heading`]).
//!
//! Oddities of the published environment that are kept: the lean angles come from the stored quaternion read in another
//! order than it is stored; the zeros are differences between an intended motion and the same motion; velocities and touch
//! are sensor values, one physics step older than the positions beside them.

use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Fill, Unworded};

use super::super::{BuildResult, difference, norm, row3};
use super::heading::Heading;

/// Touch sensors: right foot, right toes, left foot, left toes; the last of all sensors.
pub(super) const TOUCH_SENSORS: usize = 4;
/// Parts whose positions are given as part of the goal, in this order.
const TRACKED: [&str; 7] = ["root", "tibia_l", "tibia_r", "talus_l", "talus_r", "toes_l", "toes_r"];
/// Differences between intended and intended: position and velocity of the tracked parts.
const ZEROS: usize = 2 * 3 * TRACKED.len();

/// The blocks of the observation, in its order.
pub(super) const KEYS: &[&str] = &[
    "root_height",
    "root_lean",
    "local_body_pos",
    "local_body_rot",
    "local_body_vel",
    "local_body_ang_vel",
    "feet_contact_force",
    "zeros",
    "local_ref_body_pos",
];

/// Where the parts of the body are in the model.
pub(super) struct ExpertObservation {
    root: usize,
    /// Number of parts, the world not counted. The first is the root, number 1 in the model.
    parts: usize,
    tracked: [usize; TRACKED.len()],
}

impl ExpertObservation {
    /// Fails if the model's parts or sensors are not those the published environment requires.
    pub(super) fn new(simulation: &Simulation, root: usize) -> BuildResult<Self> {
        let parts = simulation.names_of(Names::Body).len() - 1;
        let (found, expected) = (simulation.sensors().len(), 6 * parts + TOUCH_SENSORS);
        if root != 1 || found != expected {
            let what = format!(
                "a walking body needs `root` as its first body (it is number {root}) and {expected} sensor values, two \
                 velocities per body and {TOUCH_SENSORS} of touch (there are {found})"
            );
            return Err(simulation.unfit(what));
        }
        let mut tracked = [0; TRACKED.len()];
        for (body, name) in tracked.iter_mut().zip(TRACKED) {
            *body = simulation.find(Names::Body, name)?;
        }
        Ok(Self { root, parts, tracked })
    }

    /// What of it is not in the muscle observation, in the order in which [`ExpertObservation::put`] writes it.
    pub(super) fn blocks(&self) -> Vec<Unworded> {
        let n = self.parts;
        [
            ("root_height", "m", 1),
            ("root_lean", "", 4),
            ("local_body_pos", "m", 3 * (n - 1)),
            ("local_body_rot", "", 6 * n),
            ("local_body_vel", "m/s", 3 * n),
            ("local_body_ang_vel", "rad/s", 3 * n),
            ("zeros", "", ZEROS),
            ("local_ref_body_pos", "m", 3 * TRACKED.len()),
        ]
        .map(|(key, unit, length)| Unworded { key, unit, length })
        .to_vec()
    }

    /// Appends these blocks about the current state.
    pub(super) fn put(&self, simulation: &Simulation, goal: &[f64; 3], fill: &mut Fill<'_>) {
        let heading = Heading::of(simulation, self.root);
        let position = |body: usize| row3(simulation.body_positions(), body);
        let root = position(self.root);
        let parts = self.root..self.root + self.parts;
        fill.put(&[root[2]]);
        let [first, second] = lean(simulation);
        fill.put(&[first.cos(), first.sin(), second.cos(), second.sin()]);
        for body in parts.clone().skip(1) {
            fill.put(&heading.localise(difference(position(body), root)));
        }
        for body in parts {
            let matrix = &simulation.body_matrices()[9 * body..][..9];
            for axis in [0, 2] {
                let image = [matrix[axis], matrix[3 + axis], matrix[6 + axis]];
                fill.put(&heading.localise(image));
            }
        }
        // Linear velocities of all parts, then angular ones.
        for velocity in simulation.sensors().as_chunks::<3>().0.iter().take(2 * self.parts) {
            fill.put(&heading.localise(*velocity));
        }
        fill.put(&[0.0; ZEROS]);
        for &body in &self.tracked {
            let place = if body == self.root { &goal[..] } else { position(body) };
            fill.put(&heading.localise(difference(place, root)));
        }
    }
}

/// The two lean angles, rad: second and third of the extrinsic x-y-z angles of the root's quaternion, which is stored as
/// (w, x, y, z) and read as (x, y, z, w).
pub(super) fn lean(simulation: &Simulation) -> [f64; 2] {
    let stored = &simulation.qpos()[3..7];
    let length = norm(stored);
    let [x, y, z, w] = [stored[0], stored[1], stored[2], stored[3]].map(|q| q / length);
    // Rounding must not carry the sine beyond 1.
    let pitch = (-2.0 * (x * z - y * w)).clamp(-1.0, 1.0).asin();
    let yaw = (2.0 * (x * y + z * w)).atan2(1.0 - 2.0 * (y * y + z * z));
    [pitch, yaw]
}

//! Die reorient: turn a die in the hand to the orientation of a second die (`spec/tasks.md` §2.5).
//!
//! Solved while the Euler angles of the two differ by less than 0.262 rad in norm; the episode ends when the die is more
//! than 0.2 m from its place.
//!
//! Oddities of the published environment that are kept: the error is the plain difference of Euler angles, without
//! wrapping; the position never decides whether it is solved; a reset gives the die the compiled orientation of the target
//! (0.001 rad about each axis).

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Fill, Layout, Unworded, per_axis, per_joint, per_muscle};
use crate::sim::random::Random;
use crate::sim::rotation::{euler_of_matrix, quaternion_of_euler};

use super::{
    BuildResult, RecordedStart, RewardConfiguration, Start, Task, Threshold, Verdict,
    activation_cost, difference, indicator, norm, row3, start_from,
};

/// Norm of the Euler error below which the die is turned right, rad.
const TURNED: f64 = 0.262;
/// Distance from its place at which the die counts as dropped, m.
const DROPPED: f64 = 0.2;
/// The goal turns by up to this about each axis, rad.
const LARGEST_TURN: f64 = 0.785;
/// Where the compiled model puts the goal, m.
const GOAL_POSITION: [f64; 3] = [-0.34, -0.535, 1.46];
/// From the die's place to the goal's, m.
const GOAL_OFFSET: [f64; 3] = [-0.1, 0.0, 0.0];
/// Mass of the die, kg.
const MASS: f64 = 0.108;
const HAND_JOINTS: usize = 23;
/// Initial forearm rotation, rad: palm up.
const PALM_UP: f64 = -1.5;

pub(super) struct DieReorient {
    layout: Layout,
    control_interval: f64,
    die: usize,
    target: usize,
    die_site: usize,
    target_site: usize,
    /// Orientation of the target as compiled.
    compiled_orientation: [f64; 4],
    start: Vec<f64>,
    /// Distance and angle of the step before.
    previous: (f64, f64),
}

/// Where the die and its goal are.
struct Pose {
    position_error: [f64; 3],
    rotation: [f64; 3],
    goal_rotation: [f64; 3],
    rotation_error: [f64; 3],
}

impl DieReorient {
    pub(super) fn new(simulation: &Simulation, control_interval: f64) -> BuildResult<Self> {
        let mut joints = simulation.names_of(Names::Joint);
        joints.truncate(HAND_JOINTS);
        let target = simulation.find(Names::Body, "target")?;
        let mut compiled_orientation = [0.0; 4];
        compiled_orientation.copy_from_slice(&simulation.model_body_quat()[4 * target..][..4]);
        let mut start = simulation.reference_qpos().to_vec();
        start.fill(0.0);
        start[0] = PALM_UP;
        Ok(Self {
            layout: layout(&joints, &simulation.names_of(Names::Actuator)),
            control_interval,
            die: simulation.find(Names::Body, "Object")?,
            target,
            die_site: simulation.find(Names::Site, "object_o")?,
            target_site: simulation.find(Names::Site, "target_o")?,
            compiled_orientation,
            start,
            previous: (0.0, 0.0),
        })
    }

    fn pose(&self, simulation: &Simulation) -> Pose {
        let die = row3(simulation.site_positions(), self.die_site);
        let goal = row3(simulation.site_positions(), self.target_site);
        let euler = |site: usize| euler_of_matrix(&simulation.site_matrices()[9 * site..][..9]);
        let (rotation, goal_rotation) = (euler(self.die_site), euler(self.target_site));
        Pose {
            position_error: difference(&difference(goal, die), &GOAL_OFFSET),
            rotation,
            goal_rotation,
            rotation_error: difference(&goal_rotation, &rotation),
        }
    }

    fn errors(&self, simulation: &Simulation) -> (f64, f64) {
        let pose = self.pose(simulation);
        (norm(&pose.position_error), norm(&pose.rotation_error))
    }
}

fn layout(joints: &[String], muscles: &[String]) -> Layout {
    let axis = |key, unit, whose: &'static str, tail: &[&'static str]| {
        per_axis(key, unit, &[&[whose, "die", "id_1"][..], tail].concat(), &[])
    };
    Layout::new(vec![
        per_joint("hand_qpos", "rad", joints, &["position", "angular"]),
        per_joint("hand_qvel", "rad per step", joints, &["velocity", "angular"]),
        axis("obj_pos", "m", "object", &["position", "linear"]),
        axis("goal_pos", "m", "target", &["position", "linear"]),
        axis("pos_err", "m", "target", &["position", "error", "linear"]),
        axis("obj_rot", "rad", "object", &["position", "angular"]),
        axis("goal_rot", "rad", "target", &["position", "angular"]),
        axis("rot_err", "rad", "target", &["position", "error", "angular"]),
        axis("obj_velp", "m/s", "object", &["velocity", "linear"]),
        axis("obj_velr", "rad/s", "object", &["velocity", "angular"]),
        per_muscle("muscle_len", "m", muscles, "position"),
        per_muscle("muscle_vel", "m/s", muscles, "velocity"),
        per_muscle("muscle_force", "N", muscles, "force"),
        per_muscle("act", "0..1", muscles, "activation"),
    ])
    .with_clean_only(vec![Unworded {
        key: "hand_qpos_noMD5",
        unit: "rad",
        length: HAND_JOINTS - 1,
    }])
}

impl Task for DieReorient {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn clean_keys(&self) -> &'static [&'static str] {
        &[
            "hand_qpos_noMD5",
            "hand_qvel",
            "obj_pos",
            "goal_pos",
            "pos_err",
            "obj_rot",
            "goal_rot",
            "rot_err",
            "act",
        ]
    }

    fn components(&self) -> &'static [&'static str] {
        &[
            "pos_dist",
            "rot_dist",
            "pos_dist_diff",
            "rot_dist_diff",
            "alive",
            "act_reg",
            "solved",
            "done",
            "sparse",
        ]
    }

    fn weights(&self, configuration: RewardConfiguration) -> &'static [(&'static str, f64)] {
        match configuration {
            RewardConfiguration::Sparse => &[
                ("pos_dist", 2.0),
                ("rot_dist", 0.2),
                ("pos_dist_diff", 100.0),
                ("rot_dist_diff", 10.0),
                ("alive", 1.0),
                ("solved", 4.0),
            ],
            RewardConfiguration::Dense => &[
                ("pos_dist", 2.0),
                ("rot_dist", 0.2),
                ("pos_dist_diff", 100.0),
                ("rot_dist_diff", 10.0),
                ("alive", 1.0),
                ("solved", 2.0),
            ],
        }
    }

    fn thresholds(&self) -> Vec<Threshold> {
        vec![
            Threshold::solved_below("norm of the Euler angles to the goal", TURNED, "rad"),
            Threshold::solved_below("die to its place", DROPPED, "m"),
            Threshold::ends_above("die to its place", DROPPED, "m"),
        ]
    }

    fn starts(&self) -> Vec<Start> {
        let turn = [LARGEST_TURN; 3];
        vec![
            Start::uniform("goal, Euler angles", &turn.map(|x| -x), &turn, "rad"),
            Start::fixed("mass of the die", &[MASS], "kg"),
            Start::fixed("pro_sup", &[PALM_UP], "rad"),
            Start::fixed("other joints", &[0.0], "rad"),
        ]
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        let turn = std::array::from_fn(|_| random.uniform(-LARGEST_TURN, LARGEST_TURN));
        let place = difference(&GOAL_POSITION, &GOAL_OFFSET);
        let positions = simulation.model_body_pos_mut();
        positions[3 * self.die..][..3].copy_from_slice(&place);
        positions[3 * self.target..][..3].copy_from_slice(&GOAL_POSITION);
        let orientations = simulation.model_body_quat_mut();
        orientations[4 * self.die..][..4].copy_from_slice(&self.compiled_orientation);
        orientations[4 * self.target..][..4].copy_from_slice(&quaternion_of_euler(turn));
        simulation.model_body_mass_mut()[self.die] = MASS;
        start_from(simulation, &self.start);
    }

    fn adopt(&mut self, _start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        // The goal is the pose of a body, which is part of the recorded model.
        Ok(())
    }

    fn begin(&mut self, simulation: &Simulation) {
        self.previous = self.errors(simulation);
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let (qpos, qvel) = (simulation.qpos(), simulation.qvel());
        let pose = self.pose(simulation);
        let velocity = simulation.body_velocity(self.die);
        let mut fill = Fill::new(observation);
        fill.put(&qpos[..HAND_JOINTS]);
        fill.put_scaled(&qvel[..HAND_JOINTS], self.control_interval);
        fill.put(row3(simulation.site_positions(), self.die_site));
        fill.put(row3(simulation.site_positions(), self.target_site));
        fill.put(&pose.position_error);
        fill.put(&pose.rotation);
        fill.put(&pose.goal_rotation);
        fill.put(&pose.rotation_error);
        fill.put(&velocity[3..]);
        fill.put(&velocity[..3]);
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
        fill.put(simulation.activation());
        fill.put(&qpos[..HAND_JOINTS - 1]);
    }

    fn judge(&mut self, simulation: &Simulation, components: &mut [f64]) -> Verdict {
        let (distance, angle) = self.errors(simulation);
        let (previous_distance, previous_angle) = self.previous;
        self.previous = (distance, angle);
        let dropped = distance > DROPPED;
        let solved = angle < TURNED && !dropped;
        components.copy_from_slice(&[
            -distance,
            -angle,
            previous_distance - distance,
            previous_angle - angle,
            indicator(!dropped),
            activation_cost(simulation),
            indicator(solved),
            indicator(dropped),
            -angle - 10.0 * distance,
        ]);
        Verdict { solved, done: dropped }
    }
}

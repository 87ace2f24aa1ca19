//! Object relocation: pick an object of random shape up and carry it into a box (`spec/tasks.md` §2.6). The arm, 63 muscles.
//!
//! Solved while the object is within 0.1 m of the goal and the hand within 0.5 m of the object.
//!
//! Oddities of the published environment that are kept: the episode ends by its own clock (time above 1.5 s, which falls on
//! step 150), so it is always *terminated*, never truncated; rotation never decides; the "noise" on the initial joint angles
//! is a constant 1 % of each joint's range; bounding sizes are set, inertia stays as compiled; the expert does not see the
//! last joint.

use std::f64::consts::FRAC_PI_2;

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Fill, Layout, Unworded, per_axis, per_joint, per_muscle};
use crate::sim::random::Random;
use crate::sim::rotation::{euler_of_matrix, quaternion_of_euler};

use super::{
    BuildResult, Place, RecordedStart, RewardConfiguration, Start, Target, Task, Threshold,
    Verdict, activation_cost, difference, indicator, norm, row3, start_from,
};

/// Distance of the object from the goal below which it has arrived, m.
const ARRIVED: f64 = 0.1;
/// Distance of the hand from the object above which it has let go, m.
const LET_GO: f64 = 0.5;
/// Simulated time after which the episode ends, s.
const TIME_LIMIT: f64 = 1.5;
/// Joints of arm and hand; the object's six follow.
const ARM_JOINTS: usize = 38;
/// The keyframe that an episode starts from.
const KEYFRAME: usize = 1;
/// Share of each joint's range that is added to it.
const OFFSET_SHARE: f64 = 0.01;
/// Corners of the box the goal is drawn from, m.
const GOAL_BOX: ([f64; 3], [f64; 3]) = ([0.0, -0.45, 0.9], [0.3, -0.1, 1.05]);
/// The goal turns by up to this about each axis, rad.
const GOAL_TURN: f64 = 0.2;
/// Corners of the box the object is drawn from, m.
const OBJECT_BOX: ([f64; 3], [f64; 3]) = ([-0.1, -0.35, 1.0], [0.1, -0.15, 1.0]);
/// Sphere, capsule, ellipsoid, cylinder, box: numbers 2 to 6 in both physics versions.
const SHAPES: (i32, u32) = (2, 5);
const SHAPE_NAMES: &[&str] = &["sphere", "capsule", "ellipsoid", "cylinder", "box"];
/// Size of a shape, m.
const SIZE: (f64, f64) = (0.015, 0.025);
/// Sliding, torsional and rolling friction.
const FRICTION: ([f64; 3], [f64; 3]) = ([0.8, 0.004, 0.00008], [1.2, 0.006, 0.00012]);
/// Mass of the object, kg.
const MASS: (f64, f64) = (0.05, 0.2);
/// Height the object must gain to count as lifted, m.
const LIFTED: f64 = 0.02;
/// A start in contact is drawn again; published experience is that this never happens.
const MOST_DRAWS: usize = 100;

pub(super) struct Relocate {
    layout: Layout,
    control_interval: f64,
    object: usize,
    target: usize,
    shapes: Vec<usize>,
    object_site: usize,
    target_site: usize,
    palm_site: usize,
    tip_sites: [usize; 5],
    start: Vec<f64>,
    /// Where the object was at the reset, m.
    object_start: [f64; 3],
}

impl Relocate {
    pub(super) fn new(simulation: &Simulation, control_interval: f64) -> BuildResult<Self> {
        let mut joints = simulation.names_of(Names::Joint);
        joints.truncate(ARM_JOINTS);
        let site = |name| simulation.find(Names::Site, name);
        let object = simulation.find(Names::Body, "Object")?;
        let mut start = simulation.reference_qpos().to_vec();
        let length = start.len();
        start.copy_from_slice(&simulation.keyframes()[KEYFRAME * length..][..length]);
        for (joint, range) in
            simulation.joint_range().as_chunks::<2>().0[..ARM_JOINTS].iter().enumerate()
        {
            start[joint] += OFFSET_SHARE * (range[1] - range[0]);
        }
        Ok(Self {
            layout: layout(&joints, &simulation.names_of(Names::Actuator)),
            control_interval,
            object,
            target: simulation.find(Names::Body, "target")?,
            shapes: simulation.geoms_of(object),
            object_site: site("object_o")?,
            target_site: site("target_o")?,
            palm_site: site("S_grasp")?,
            tip_sites: [
                site("THtip")?,
                site("IFtip")?,
                site("MFtip")?,
                site("RFtip")?,
                site("LFtip")?,
            ],
            start,
            object_start: [0.0; 3],
        })
    }

    fn draw(&self, simulation: &mut Simulation, random: &mut Random) {
        let mut between = |(low, high): ([f64; 3], [f64; 3])| -> [f64; 3] {
            std::array::from_fn(|axis| random.uniform(low[axis], high[axis]))
        };
        let turned = |turn: f64| ([-turn; 3], [turn; 3]);
        let goal = between(GOAL_BOX);
        let goal_turn = between(turned(GOAL_TURN));
        let object = between(OBJECT_BOX);
        let positions = simulation.model_body_pos_mut();
        positions[3 * self.target..][..3].copy_from_slice(&goal);
        positions[3 * self.object..][..3].copy_from_slice(&object);
        simulation.model_body_quat_mut()[4 * self.target..][..4]
            .copy_from_slice(&quaternion_of_euler(goal_turn));
        for &shape in &self.shapes {
            let mut between = |(low, high): ([f64; 3], [f64; 3])| -> [f64; 3] {
                std::array::from_fn(|axis| random.uniform(low[axis], high[axis]))
            };
            let size = between(([SIZE.0; 3], [SIZE.1; 3]));
            let position = between((size.map(|s| -s), size));
            let turn = between(turned(FRAC_PI_2));
            let friction = between(FRICTION);
            let kind = SHAPES.0 + random.index(SHAPES.1) as i32;
            simulation.model_geom_type_mut()[shape] = kind;
            simulation.model_geom_size_mut()[3 * shape..][..3].copy_from_slice(&size);
            simulation.model_geom_aabb_mut()[6 * shape + 3..][..3].fill(SIZE.1);
            simulation.model_geom_rbound_mut()[shape] = 2.0 * SIZE.1;
            simulation.model_geom_pos_mut()[3 * shape..][..3].copy_from_slice(&position);
            simulation.model_geom_quat_mut()[4 * shape..][..4]
                .copy_from_slice(&quaternion_of_euler(turn));
            simulation.model_geom_friction_mut()[3 * shape..][..3].copy_from_slice(&friction);
        }
        simulation.model_body_mass_mut()[self.object] = random.uniform(MASS.0, MASS.1);
    }
}

fn euler(simulation: &Simulation, site: usize) -> [f64; 3] {
    euler_of_matrix(&simulation.site_matrices()[9 * site..][..9])
}

fn layout(joints: &[String], muscles: &[String]) -> Layout {
    Layout::new(vec![
        per_joint("hand_qpos_corrected", "rad", joints, &["position", "angular"]),
        per_joint("hand_qvel", "rad per step", joints, &["velocity", "angular"]),
        per_axis("obj_pos", "m", &["object", "id_1", "position", "linear"], &[]),
        per_axis("goal_pos", "m", &["target", "object", "id_1", "position", "linear"], &[]),
        per_axis("pos_err", "m", &["target", "object", "id_1", "position", "error", "linear"], &[]),
        per_axis("obj_rot", "rad", &["object", "id_1", "position", "angular"], &[]),
        per_muscle("muscle_len", "m", muscles, "position"),
        per_muscle("muscle_vel", "m/s", muscles, "velocity"),
        per_muscle("muscle_force", "N", muscles, "force"),
        per_muscle("act", "0..1", muscles, "activation"),
    ])
    .with_clean_only(vec![
        Unworded { key: "hand_qpos", unit: "rad", length: ARM_JOINTS - 1 },
        Unworded { key: "goal_rot", unit: "rad", length: 3 },
        Unworded { key: "rot_err", unit: "rad", length: 3 },
    ])
}

impl Task for Relocate {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn clean_keys(&self) -> &'static [&'static str] {
        &[
            "hand_qpos",
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
            "palm_dist",
            "tip_dist",
            "pos_dist_z",
            "rot_dist",
            "reach_dist",
            "reach_dist_xy",
            "reach_dist_z",
            "alive",
            "lift_bonus",
            "max_app",
            "min_app",
            "contact_hand_obj",
            "rot_palm_obj",
            "close_bonus",
            "obj_shift",
            "open_hand",
            "act_reg",
            "sparse",
            "solved",
            "done",
        ]
    }

    fn weights(&self, configuration: RewardConfiguration) -> &'static [(&'static str, f64)] {
        match configuration {
            RewardConfiguration::Sparse => &[("solved", 1.0)],
            RewardConfiguration::Dense => {
                &[("solved", 20.0), ("pos_dist", 10.0), ("palm_dist", 1.0), ("tip_dist", 0.1)]
            }
        }
    }

    fn thresholds(&self) -> Vec<Threshold> {
        vec![
            Threshold::solved_below("object to goal", ARRIVED, "m"),
            Threshold::solved_below("hand to object", LET_GO, "m"),
            Threshold::ends_above("time", TIME_LIMIT, "s"),
        ]
    }

    fn starts(&self) -> Vec<Start> {
        let even = |quantity: &str, x: f64| Start::uniform(quantity, &[-x; 3], &[x; 3], "rad");
        let first = &self.start[ARM_JOINTS..][..3];
        // The object's own joints move it from where its body stands.
        let (low, high) = (OBJECT_BOX.0, OBJECT_BOX.1);
        let moved =
            |corner: [f64; 3]| [corner[0] + first[0], corner[1] + first[1], corner[2] + first[2]];
        vec![
            Start::uniform("goal", &GOAL_BOX.0, &GOAL_BOX.1, "m"),
            even("goal, Euler angles", GOAL_TURN),
            Start::uniform("object", &moved(low), &moved(high), "m"),
            Start::one_of("each of three shapes", SHAPE_NAMES),
            Start::uniform("its size", &[SIZE.0; 3], &[SIZE.1; 3], "m"),
            Start::rule("its place", "uniform within its size around the object's origin"),
            even("its Euler angles", FRAC_PI_2),
            Start::uniform(
                "its friction, sliding, torsional, rolling",
                &FRICTION.0,
                &FRICTION.1,
                "",
            ),
            Start::uniform("mass of the object", &[MASS.0], &[MASS.1], "kg"),
            Start::rule("joints", "keyframe 1 of the model plus 1 % of each joint's range"),
        ]
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        for _ in 0..MOST_DRAWS {
            self.draw(simulation, random);
            start_from(simulation, &self.start);
            if simulation.contact_count() == 0 {
                return;
            }
        }
    }

    fn adopt(&mut self, _start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        // Goal and object are poses and shapes of the recorded model.
        Ok(())
    }

    fn begin(&mut self, simulation: &Simulation) {
        self.object_start.copy_from_slice(row3(simulation.site_positions(), self.object_site));
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let (qpos, qvel) = (simulation.qpos(), simulation.qvel());
        let object = row3(simulation.site_positions(), self.object_site);
        let goal = row3(simulation.site_positions(), self.target_site);
        let rotation = euler(simulation, self.object_site);
        let goal_rotation = euler(simulation, self.target_site);
        let mut fill = Fill::new(observation);
        fill.put(&qpos[..ARM_JOINTS]);
        fill.put_scaled(&qvel[..ARM_JOINTS], self.control_interval);
        fill.put(object);
        fill.put(goal);
        fill.put_difference(goal, object);
        fill.put(&rotation);
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
        fill.put(simulation.activation());
        fill.put(&qpos[..ARM_JOINTS - 1]);
        fill.put(&goal_rotation);
        fill.put_difference(&goal_rotation, &rotation);
    }

    fn targets(&self) -> Vec<Target> {
        vec![Target { place: Place::Site(self.target_site), radius: ARRIVED }]
    }

    fn judge(&mut self, simulation: &Simulation, components: &mut [f64]) -> Verdict {
        let site = |index| row3(simulation.site_positions(), index);
        let (object, palm) = (site(self.object_site), site(self.palm_site));
        let apart = |a: &[f64], b: &[f64]| norm(&difference(a, b));
        let to_goal = apart(site(self.target_site), object);
        let reach = difference(palm, object);
        let to_object = norm(&reach);
        let rotation = euler(simulation, self.object_site);
        let turn = apart(&euler(simulation, self.target_site), &rotation);
        let tips_to_object: f64 = self.tip_sites.iter().map(|&tip| apart(site(tip), object)).sum();
        let tips_to_palm: f64 = self.tip_sites.iter().map(|&tip| apart(site(tip), palm)).sum();
        let let_go = to_object > LET_GO;
        let solved = to_goal < ARRIVED && !let_go;
        let done = simulation.time() > TIME_LIMIT;
        let logarithm = (to_object + 1e-8).ln();
        components.copy_from_slice(&[
            (-5.0 * to_goal).exp(),
            (-5.0 * to_object).exp(),
            (-tips_to_object).exp(),
            (-5.0 * object[2].abs()).exp(),
            -(turn + (turn + 1e-8).ln()),
            -(to_object + logarithm),
            -(norm(&reach[..2]) + logarithm),
            -(reach[2].abs() + logarithm),
            indicator(!let_go),
            indicator(object[2] > self.object_start[2] + LIFTED),
            tips_to_palm,
            -tips_to_object,
            indicator(to_object < 0.005),
            -apart(&euler(simulation, self.palm_site), &rotation),
            0.0,
            (-5.0 * apart(object, &self.object_start)).exp(),
            -(-5.0 * tips_to_palm).exp(),
            activation_cost(simulation),
            -turn - 10.0 * to_goal,
            indicator(solved),
            indicator(done),
        ]);
        Verdict { solved, done }
    }
}

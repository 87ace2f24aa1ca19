//! Pen reorient: turn a pen in the hand until it points where a second pen does (`spec/tasks.md` §2.4).
//!
//! Solved while the cosine of the angle between the two pens is above 0.95; the episode ends when the pen is more than
//! 75 mm from its place. The orientation in the observation is the pen's direction, not Euler angles. Its velocity is that
//! of its centre of mass, its position that of the body's origin.

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Fill, Layout, Unworded, per_axis, per_joint, per_muscle};
use crate::sim::random::Random;
use crate::sim::rotation::quaternion_of_euler;

use super::{
    BuildResult, RecordedStart, RewardConfiguration, Rules, Start, Task, Threshold, Verdict,
    activation_cost, cosine, difference, indicator, norm, row3, start_from,
};

/// Distance from its place at which the pen counts as dropped, m.
const DROPPED: f64 = 0.075;
/// Cosine above which the pen points the right way.
const ALIGNED: f64 = 0.95;
/// Distance between the two sites at a pen's ends, m.
const PEN_LENGTH: f64 = 0.13;
/// The target's direction turns by up to this about x and y, rad.
const LARGEST_TURN: f64 = 1.0;
const HAND_JOINTS: usize = 23;
/// Initial forearm rotation, rad: palm up.
const PALM_UP: f64 = -1.5;

pub(super) struct PenReorient {
    layout: Layout,
    control_interval: f64,
    pen: usize,
    target: usize,
    /// Sites at the top and the bottom of the pen and of the target.
    pen_ends: [usize; 2],
    target_ends: [usize; 2],
    /// Site where the pen should be.
    place: usize,
    start: Vec<f64>,
    rules: Rules,
    /// Distance and cosine of the step before.
    previous: (f64, f64),
}

impl PenReorient {
    pub(super) fn new(
        simulation: &Simulation,
        control_interval: f64,
        rules: Rules,
    ) -> BuildResult<Self> {
        let mut joints = simulation.names_of(Names::Joint);
        joints.truncate(HAND_JOINTS);
        let site = |name| simulation.find(Names::Site, name);
        let mut start = simulation.reference_qpos().to_vec();
        start.fill(0.0);
        start[0] = PALM_UP;
        Ok(Self {
            layout: layout(&joints, &simulation.names_of(Names::Actuator)),
            control_interval,
            pen: simulation.find(Names::Body, "Object")?,
            target: simulation.find(Names::Body, "target")?,
            pen_ends: [site("object_top")?, site("object_bottom")?],
            target_ends: [site("target_top")?, site("target_bottom")?],
            place: site("eps_ball")?,
            start,
            rules,
            previous: (0.0, 0.0),
        })
    }

    /// How far the pen is from its place, m, and the cosine between the two pens.
    fn errors(&self, simulation: &Simulation) -> (f64, f64) {
        let offset = difference(
            row3(simulation.body_positions(), self.pen),
            row3(simulation.site_positions(), self.place),
        );
        let pen = direction(simulation, self.pen_ends);
        let target = direction(simulation, self.target_ends);
        (norm(&offset), cosine(&pen, &target))
    }
}

/// From the bottom of a pen to its top, divided by its length.
fn direction(simulation: &Simulation, [top, bottom]: [usize; 2]) -> [f64; 3] {
    let sites = simulation.site_positions();
    difference(row3(sites, top), row3(sites, bottom)).map(|x| x / PEN_LENGTH)
}

fn layout(joints: &[String], muscles: &[String]) -> Layout {
    let axis = |key, unit, whose: &'static str, tail: &[&'static str]| {
        per_axis(key, unit, &[&[whose, "pen", "id_1"][..], tail].concat(), &[])
    };
    Layout::new(vec![
        per_joint("hand_jnt", "rad", joints, &["position", "angular"]),
        per_joint("hand_jnt_vel", "rad per step", joints, &["velocity", "angular"]),
        axis("obj_pos", "m", "object", &["position", "linear"]),
        axis("obj_vel_lin", "m/s", "object", &["velocity", "linear"]),
        axis("obj_rot", "", "object", &["position", "angular"]),
        axis("obj_velr", "rad/s", "object", &["velocity", "angular"]),
        axis("obj_des_pos", "m", "target", &["position", "linear"]),
        axis("obj_des_rot", "", "target", &["position", "angular"]),
        axis("obj_err_pos", "m", "target", &["position", "error", "linear"]),
        axis("obj_err_rot", "", "target", &["position", "error", "angular"]),
        per_muscle("muscle_len", "m", muscles, "position"),
        per_muscle("muscle_vel", "m/s", muscles, "velocity"),
        per_muscle("muscle_force", "N", muscles, "force"),
        per_muscle("act", "0..1", muscles, "activation"),
    ])
    .with_clean_only(vec![Unworded { key: "obj_vel", unit: "per step", length: 6 }])
}

impl Task for PenReorient {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn clean_keys(&self) -> &'static [&'static str] {
        &[
            "hand_jnt",
            "obj_pos",
            "obj_vel",
            "obj_rot",
            "obj_des_rot",
            "obj_err_pos",
            "obj_err_rot",
            "act",
        ]
    }

    fn components(&self) -> &'static [&'static str] {
        &[
            "pos_align",
            "rot_align",
            "pos_align_diff",
            "rot_align_diff",
            "alive",
            "act_reg",
            "drop",
            "bonus",
            "solved",
            "done",
            "sparse",
        ]
    }

    fn weights(&self, configuration: RewardConfiguration) -> &'static [(&'static str, f64)] {
        match (self.rules, configuration) {
            (Rules::MyoSuite, _) => &[
                ("pos_align", 1.0),
                ("rot_align", 1.0),
                ("act_reg", 5.0),
                ("drop", 5.0),
                ("bonus", 10.0),
            ],
            (Rules::Arnold, RewardConfiguration::Sparse) => &[
                ("pos_align_diff", 100.0),
                ("rot_align_diff", 100.0),
                ("alive", 1.0),
                ("solved", 4.0),
            ],
            (Rules::Arnold, RewardConfiguration::Dense) => &[
                ("pos_align_diff", 100.0),
                ("rot_align_diff", 100.0),
                ("alive", 1.0),
                ("solved", 1.0),
            ],
        }
    }

    fn thresholds(&self) -> Vec<Threshold> {
        vec![
            Threshold::solved_above("cosine between pen and target", ALIGNED, ""),
            Threshold::solved_below("pen to its place", DROPPED, "m"),
            Threshold::ends_above("pen to its place", DROPPED, "m"),
        ]
    }

    fn starts(&self) -> Vec<Start> {
        let turn = [LARGEST_TURN; 2];
        vec![
            Start::uniform("target, Euler angles x, y", &turn.map(|x| -x), &turn, "rad"),
            Start::fixed("pro_sup", &[PALM_UP], "rad"),
            Start::fixed("other joints", &[0.0], "rad"),
        ]
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        let x = random.uniform(-LARGEST_TURN, LARGEST_TURN);
        let y = random.uniform(-LARGEST_TURN, LARGEST_TURN);
        simulation.model_body_quat_mut()[4 * self.target..][..4]
            .copy_from_slice(&quaternion_of_euler([x, y, 0.0]));
        start_from(simulation, &self.start);
    }

    fn adopt(&mut self, _start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        // The target is the orientation of a body, which is part of the recorded model.
        Ok(())
    }

    fn begin(&mut self, simulation: &Simulation) {
        self.previous = self.errors(simulation);
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let (qpos, qvel) = (simulation.qpos(), simulation.qvel());
        let position = row3(simulation.body_positions(), self.pen);
        let place = row3(simulation.site_positions(), self.place);
        let pen = direction(simulation, self.pen_ends);
        let target = direction(simulation, self.target_ends);
        let velocity = simulation.body_velocity(self.pen);
        let mut fill = Fill::new(observation);
        fill.put(&qpos[..HAND_JOINTS]);
        fill.put_scaled(&qvel[..HAND_JOINTS], self.control_interval);
        fill.put(position);
        fill.put(&velocity[3..]);
        fill.put(&pen);
        fill.put(&velocity[..3]);
        fill.put(place);
        fill.put(&target);
        fill.put_difference(position, place);
        fill.put_difference(&pen, &target);
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
        fill.put(simulation.activation());
        fill.put_scaled(&qvel[HAND_JOINTS..], self.control_interval);
    }

    fn judge(&mut self, simulation: &Simulation, components: &mut [f64]) -> Verdict {
        let (distance, alignment) = self.errors(simulation);
        let (previous_distance, previous_alignment) = self.previous;
        self.previous = (distance, alignment);
        let dropped = distance > DROPPED;
        let in_place = indicator(distance < DROPPED);
        let solved = alignment > ALIGNED && !dropped;
        components.copy_from_slice(&[
            -distance,
            alignment,
            previous_distance - distance,
            alignment - previous_alignment,
            indicator(!dropped),
            activation_cost(simulation),
            -indicator(dropped),
            in_place * (indicator(alignment > 0.9) + 5.0 * indicator(alignment > ALIGNED)),
            indicator(solved),
            indicator(dropped),
            alignment - distance,
        ]);
        Verdict { solved, done: dropped }
    }
}

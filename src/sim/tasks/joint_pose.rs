//! Joint pose: bring all joints to random angles and hold them there (`spec/tasks.md` §2.1). The elbow has one joint and six
//! muscles, the hand 23 and 39.
//!
//! The distance is the norm of all angle errors. Solved while it is below 0.175 rad for the elbow, 0.7 rad for the hand;
//! the episode ends when it is above 2π, which is out of the elbow's reach.
//!
//! The hand's targets are drawn from boxes that hold the hand shapes of the ten digits of American Sign Language, as in
//! `MyoSuite`.

use std::f64::consts::TAU;

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Fill, Layout, per_joint, per_muscle};
use crate::sim::random::Random;

use super::{
    BuildResult, RecordedStart, RewardConfiguration, Rules, Start, Task, Threshold, Verdict,
    activation_cost, indicator, length, start_from,
};

/// Norm of the errors above which the episode ends, rad.
const FAR: f64 = TAU;

/// Which joints are to be brought where.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Pose {
    /// Range of the target angle of every joint, rad.
    targets: &'static [(f64, f64)],
    /// Norm of the errors below which the pose counts as held, rad.
    held: f64,
}

impl Pose {
    /// The elbow. The range's upper end is slightly above the joint's own limit.
    pub(super) const ELBOW: Self = Self { targets: &[(0.0, 2.27)], held: 0.175 };
    /// The hand: forearm and wrist straight, then thumb and fingers.
    pub(super) const HAND: Self = Self { targets: &HAND_TARGETS, held: 0.7 };
}

/// For each joint of the hand the smallest and the largest angle among the ten hand shapes, rad.
#[expect(clippy::approx_constant, reason = "quoted digit by digit")]
const HAND_TARGETS: [(f64, f64); 23] = [
    // pro_sup, deviation, flexion
    (0.0, 0.0),
    (0.0, 0.0),
    (0.0, 0.0),
    // cmc_abduction, cmc_flexion, mp_flexion, ip_flexion
    (0.0248, 0.6392),
    (-0.147_495, 0.28272),
    (-0.7854, 0.01569),
    (-1.309, -0.026_204_5),
    // mcp2_flexion, mcp2_abduction, pm2_flexion, md2_flexion
    (0.366_605, 1.30045),
    (-0.006_982, 0.010_473),
    (0.128_305, 1.45492),
    (0.111_722, 0.998_897),
    // mcp3_flexion, mcp3_abduction, pm3_flexion, md3_flexion
    (0.39275, 1.48459),
    (0.0, 0.0),
    (0.18852, 1.45318),
    (0.117_825, 1.44532),
    // mcp4_flexion, mcp4_abduction, pm4_flexion, md4_flexion
    (0.306_345, 1.571),
    (-0.204_204, -0.010_472),
    (0.0, 1.52387),
    (0.06284, 1.45318),
    // mcp5_flexion, mcp5_abduction, pm5_flexion, md5_flexion
    (0.21994, 1.48459),
    (-0.2618, -0.068_068),
    (0.18852, 1.571),
    (0.01571, 1.571),
];

pub(super) struct JointPose {
    layout: Layout,
    control_interval: f64,
    joints: Vec<String>,
    /// Ranges of the joints, rad: where an episode may start.
    joint_ranges: Vec<[f64; 2]>,
    pose: Pose,
    rules: Rules,
    target: Vec<f64>,
    /// Memory for the initial angles of an episode.
    start: Vec<f64>,
}

impl JointPose {
    pub(super) fn new(
        simulation: &Simulation,
        control_interval: f64,
        pose: Pose,
        rules: Rules,
    ) -> BuildResult<Self> {
        let joints = simulation.names_of(Names::Joint);
        let muscles = simulation.names_of(Names::Actuator);
        if joints.len() != pose.targets.len() || joints.len() != simulation.qpos().len() {
            let what = format!(
                "the pose is one of {} joints, the model has {}",
                pose.targets.len(),
                joints.len()
            );
            return Err(simulation.unfit(what));
        }
        let layout = Layout::new(vec![
            per_joint("qpos", "rad", &joints, &["position", "angular"]),
            per_joint("qvel", "rad per step", &joints, &["velocity", "angular"]),
            per_muscle("act", "0..1", &muscles, "activation"),
            per_joint("pose_err", "rad", &joints, &["position", "angular", "error"]),
            per_joint("pose_target", "rad", &joints, &["position", "angular", "target"]),
            per_muscle("muscle_len", "m", &muscles, "position"),
            per_muscle("muscle_vel", "m/s", &muscles, "velocity"),
            per_muscle("muscle_force", "N", &muscles, "force"),
        ]);
        Ok(Self {
            layout,
            control_interval,
            joint_ranges: simulation.joint_range().as_chunks::<2>().0.to_vec(),
            pose,
            rules,
            target: vec![0.0; joints.len()],
            start: vec![0.0; joints.len()],
            joints,
        })
    }
}

impl Task for JointPose {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn clean_keys(&self) -> &'static [&'static str] {
        &["qpos", "qvel", "pose_err", "act"]
    }

    fn components(&self) -> &'static [&'static str] {
        &["pose", "bonus", "penalty", "act_reg", "sparse", "solved", "done"]
    }

    fn weights(&self, configuration: RewardConfiguration) -> &'static [(&'static str, f64)] {
        match (self.rules, configuration) {
            (Rules::MyoSuite, _) => {
                &[("pose", 1.0), ("bonus", 4.0), ("act_reg", 1.0), ("penalty", 50.0)]
            }
            (Rules::Arnold, RewardConfiguration::Sparse) => &[("solved", 5.0)],
            (Rules::Arnold, RewardConfiguration::Dense) => {
                &[("pose", 1.0), ("act_reg", 1.0), ("solved", 1.0)]
            }
        }
    }

    fn thresholds(&self) -> Vec<Threshold> {
        let quantity = if self.joints.len() == 1 {
            "angle to target"
        } else {
            "angles to targets (all together)"
        };
        vec![
            Threshold::solved_below(quantity, self.pose.held, "rad"),
            Threshold::ends_above(quantity, FAR, "rad"),
        ]
    }

    fn starts(&self) -> Vec<Start> {
        let joints = self.joints.iter();
        let target = |(joint, &(low, high)): (&String, &(f64, f64))| {
            Start::uniform(format!("target of {joint}"), &[low], &[high], "rad")
        };
        let start = |(joint, &[low, high]): (&String, &[f64; 2])| {
            Start::uniform(format!("start of {joint}"), &[low], &[high], "rad")
        };
        let targets = joints.clone().zip(self.pose.targets).map(target);
        targets.chain(joints.zip(&self.joint_ranges).map(start)).collect()
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        for (target, &(low, high)) in self.target.iter_mut().zip(self.pose.targets) {
            *target = random.uniform(low, high);
        }
        for (start, &[low, high]) in self.start.iter_mut().zip(&self.joint_ranges) {
            *start = random.uniform(low, high);
        }
        start_from(simulation, &self.start);
    }

    fn adopt(&mut self, start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        for (joint, target) in self.target.iter_mut().enumerate() {
            *target = start.number(&format!("/target_jnt_value/{joint}"))?;
        }
        Ok(())
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let mut fill = Fill::new(observation);
        fill.put(simulation.qpos());
        fill.put_scaled(simulation.qvel(), self.control_interval);
        fill.put(simulation.activation());
        fill.put_difference(&self.target, simulation.qpos());
        fill.put(&self.target);
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
    }

    fn target_pose(&self) -> Option<&[f64]> {
        Some(&self.target)
    }

    fn judge(&mut self, simulation: &Simulation, components: &mut [f64]) -> Verdict {
        let errors =
            self.target.iter().zip(simulation.qpos()).map(|(target, angle)| target - angle);
        let distance = length(errors);
        let solved = distance < self.pose.held;
        let done = distance > FAR;
        components.copy_from_slice(&[
            -distance,
            indicator(solved) + indicator(distance < 1.5 * self.pose.held),
            -indicator(done),
            activation_cost(simulation),
            -distance,
            indicator(solved),
            indicator(done),
        ]);
        Verdict { solved, done }
    }
}

//! Elbow pose: hold the elbow at a random angle (`spec/tasks.md` §2.1). One joint, six muscles.
//!
//! Solved while the angle is within 0.175 rad of the target. An episode never ends early: the published limit of 2π is
//! out of the joint's reach.

use std::f64::consts::TAU;

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Fill, Layout, per_joint, per_muscle};
use crate::sim::random::Random;

use super::{
    RecordedStart, RewardConfiguration, Task, Verdict, activation_cost, indicator, start_from,
};

/// Angle error below which the pose counts as held, rad.
const SOLVED_THRESHOLD: f64 = 0.175;
/// Range of target angles, rad. Its upper end is slightly above the joint's own limit.
const TARGET_RANGE: (f64, f64) = (0.0, 2.27);

pub(super) struct ElbowPose {
    layout: Layout,
    control_interval: f64,
    /// Range of the joint, rad: where an episode may start.
    joint_range: (f64, f64),
    target: f64,
}

impl ElbowPose {
    pub(super) fn new(simulation: &Simulation, control_interval: f64) -> Self {
        let joints = simulation.names_of(Names::Joint);
        let muscles = simulation.names_of(Names::Actuator);
        let range = simulation.joint_range();
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
        Self { layout, control_interval, joint_range: (range[0], range[1]), target: 0.0 }
    }
}

impl Task for ElbowPose {
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
        match configuration {
            RewardConfiguration::Sparse => &[("solved", 5.0)],
            RewardConfiguration::Dense => &[("pose", 1.0), ("act_reg", 1.0), ("solved", 1.0)],
        }
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        self.target = random.uniform(TARGET_RANGE.0, TARGET_RANGE.1);
        let start = random.uniform(self.joint_range.0, self.joint_range.1);
        start_from(simulation, &[start]);
    }

    fn adopt(&mut self, start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        self.target = start.number("/target_jnt_value/0")?;
        Ok(())
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let mut fill = Fill::new(observation);
        fill.put(simulation.qpos());
        fill.put_scaled(simulation.qvel(), self.control_interval);
        fill.put(simulation.activation());
        fill.put_difference(&[self.target], simulation.qpos());
        fill.put(&[self.target]);
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
    }

    fn judge(
        &mut self,
        simulation: &Simulation,
        _observation: &[f64],
        components: &mut [f64],
    ) -> Verdict {
        let distance = (self.target - simulation.qpos()[0]).abs();
        let solved = distance < SOLVED_THRESHOLD;
        let done = distance > TAU;
        components.copy_from_slice(&[
            -distance,
            indicator(solved) + indicator(distance < 1.5 * SOLVED_THRESHOLD),
            -indicator(done),
            activation_cost(simulation),
            -distance,
            indicator(solved),
            indicator(done),
        ]);
        Verdict { solved, done }
    }
}

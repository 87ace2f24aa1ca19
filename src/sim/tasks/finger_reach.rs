//! Finger reach: bring a fingertip to a point and keep it there (`spec/tasks.md` §2.2).
//!
//! Solved while the tip is within 12.5 mm of the target. The episode ends when the tip is more than 35 cm away, a check
//! that is switched on once the simulated time exceeds two control steps; because time is summed in floating point, that
//! is from the second step on.

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Fill, Layout, per_axis, per_joint, per_muscle};
use crate::sim::random::Random;

use super::{
    BuildResult, RecordedStart, RewardConfiguration, Task, Verdict, activation_cost, indicator,
    norm, row3, start_from,
};

/// Distance below which a fingertip has reached its target, m.
const NEAR: f64 = 0.0125;
/// Distance above which the episode ends, m.
const FAR: f64 = 0.35;

/// A finger and the box its targets are drawn from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Finger {
    /// Site at its tip; the target site is `<tip>_target`.
    pub tip: &'static str,
    /// Corner of the target box with the smallest coordinates, m.
    pub low: [f64; 3],
    /// Corner with the largest coordinates, m.
    pub high: [f64; 3],
}

impl Finger {
    pub(super) const THUMB: Self =
        Self { tip: "THtip", low: [-0.185, -0.577, 1.455], high: [-0.125, -0.517, 1.535] };
    pub(super) const INDEX: Self =
        Self { tip: "IFtip", low: [-0.191, -0.567, 1.445], high: [-0.111, -0.527, 1.465] };
    pub(super) const MIDDLE: Self =
        Self { tip: "MFtip", low: [-0.186, -0.567, 1.437], high: [-0.106, -0.527, 1.457] };
    pub(super) const RING: Self =
        Self { tip: "RFtip", low: [-0.188, -0.563, 1.435], high: [-0.108, -0.523, 1.455] };
    pub(super) const LITTLE: Self =
        Self { tip: "LFtip", low: [-0.188, -0.548, 1.424], high: [-0.108, -0.508, 1.444] };
}

pub(super) struct FingerReach {
    layout: Layout,
    control_interval: f64,
    finger: Finger,
    tip: usize,
    target: usize,
    start: Vec<f64>,
}

impl FingerReach {
    pub(super) fn new(
        simulation: &Simulation,
        control_interval: f64,
        finger: Finger,
    ) -> BuildResult<Self> {
        let joints = simulation.names_of(Names::Joint);
        let muscles = simulation.names_of(Names::Actuator);
        let tip = finger.tip;
        let layout = Layout::new(vec![
            per_joint("qpos", "rad", &joints, &["position", "angular"]),
            per_joint("qvel", "rad per step", &joints, &["velocity", "angular"]),
            per_axis("tip_pos", "m", &[tip, "position", "linear"], &["tip"]),
            per_axis("target_pos", "m", &[tip, "position", "target", "linear"], &["tip"]),
            per_axis("reach_err", "m", &[tip, "position", "error", "linear"], &["tip"]),
            per_muscle("muscle_len", "m", &muscles, "position"),
            per_muscle("muscle_vel", "m/s", &muscles, "velocity"),
            per_muscle("muscle_force", "N", &muscles, "force"),
            per_muscle("act", "0..1", &muscles, "activation"),
        ]);
        Ok(Self {
            layout,
            control_interval,
            finger,
            tip: simulation.find(Names::Site, tip)?,
            target: simulation.find(Names::Site, &format!("{tip}_target"))?,
            start: vec![0.0; simulation.qpos().len()],
        })
    }
}

impl Task for FingerReach {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn clean_keys(&self) -> &'static [&'static str] {
        &["qpos", "qvel", "tip_pos", "reach_err", "act"]
    }

    fn components(&self) -> &'static [&'static str] {
        &["reach", "bonus", "act_reg", "penalty", "sparse", "solved", "done"]
    }

    fn weights(&self, configuration: RewardConfiguration) -> &'static [(&'static str, f64)] {
        match configuration {
            RewardConfiguration::Sparse => &[("solved", 5.0)],
            RewardConfiguration::Dense => &[("reach", 1.0), ("act_reg", 1.0), ("solved", 1.0)],
        }
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        for axis in 0..3 {
            simulation.model_site_pos_mut()[3 * self.target + axis] =
                random.uniform(self.finger.low[axis], self.finger.high[axis]);
        }
        start_from(simulation, &self.start);
    }

    fn adopt(&mut self, _start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        // The target is the position of a site, which is part of the recorded model.
        Ok(())
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let tip = row3(simulation.site_positions(), self.tip);
        let target = row3(simulation.site_positions(), self.target);
        let mut fill = Fill::new(observation);
        fill.put(simulation.qpos());
        fill.put_scaled(simulation.qvel(), self.control_interval);
        fill.put(tip);
        fill.put(target);
        fill.put_difference(target, tip);
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
        fill.put(simulation.activation());
    }

    fn judge(
        &mut self,
        simulation: &Simulation,
        _observation: &[f64],
        components: &mut [f64],
    ) -> Verdict {
        let tip = row3(simulation.site_positions(), self.tip);
        let target = row3(simulation.site_positions(), self.target);
        let error = [target[0] - tip[0], target[1] - tip[1], target[2] - tip[2]];
        let distance = norm(&error);
        let checked = simulation.time() > 2.0 * self.control_interval;
        let done = checked && distance > FAR;
        let solved = distance < NEAR;
        components.copy_from_slice(&[
            -distance,
            indicator(distance < 2.0 * NEAR) + indicator(solved),
            activation_cost(simulation),
            -indicator(done),
            -distance,
            indicator(solved),
            indicator(done),
        ]);
        Verdict { solved, done }
    }
}

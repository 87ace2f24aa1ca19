//! Finger reach: bring fingertips to points and keep them there (`spec/tasks.md` §2.2). One finger in the paper's five
//! tasks, any of the 31 choices of fingers otherwise.
//!
//! The distance is that of all tips together: the norm of their errors, one after the other. Solved while it is below
//! 12.5 mm per finger. The episode ends when it is above a limit per finger (35 cm in the paper's tasks, 34 mm in
//! `MyoSuite`'s own), a check that is switched on once the simulated time exceeds two control steps; because time is summed
//! in floating point, that is from the second step on.

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Block, Fill, Layout, per_axis, per_joint, per_muscle};
use crate::sim::random::Random;

use super::{
    BuildResult, Place, RecordedStart, RewardConfiguration, Rules, Start, Target, Task, Threshold,
    Verdict, activation_cost, difference, indicator, length, row3, start_from,
};

/// Distance per finger below which the tips have reached their targets, m.
pub(super) const NEAR: f64 = 0.0125;

/// Distance per finger above which the episode ends, m.
const fn far(rules: Rules) -> f64 {
    match rules {
        Rules::Arnold => 0.35,
        Rules::MyoSuite => 0.034,
    }
}

/// A finger and the box its targets are drawn from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Finger {
    /// What people call it.
    pub name: &'static str,
    /// Site at its tip; the target site is `<tip>_target`.
    tip: &'static str,
    /// Corner of the target box with the smallest coordinates, m.
    low: [f64; 3],
    /// Corner with the largest coordinates, m.
    high: [f64; 3],
}

/// The fingers, in the order in which several of them are observed.
pub(super) const FINGERS: [Finger; 5] = [
    Finger {
        name: "thumb",
        tip: "THtip",
        low: [-0.185, -0.577, 1.455],
        high: [-0.125, -0.517, 1.535],
    },
    Finger {
        name: "index",
        tip: "IFtip",
        low: [-0.191, -0.567, 1.445],
        high: [-0.111, -0.527, 1.465],
    },
    Finger {
        name: "middle",
        tip: "MFtip",
        low: [-0.186, -0.567, 1.437],
        high: [-0.106, -0.527, 1.457],
    },
    Finger {
        name: "ring",
        tip: "RFtip",
        low: [-0.188, -0.563, 1.435],
        high: [-0.108, -0.523, 1.455],
    },
    Finger {
        name: "little",
        tip: "LFtip",
        low: [-0.188, -0.548, 1.424],
        high: [-0.108, -0.508, 1.444],
    },
];

/// Some of the five fingers: bit *i* is finger *i*.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Fingers(pub u8);

impl Fingers {
    pub(super) const THUMB: Self = Self(1);
    pub(super) const INDEX: Self = Self(1 << 1);
    pub(super) const MIDDLE: Self = Self(1 << 2);
    pub(super) const RING: Self = Self(1 << 3);
    pub(super) const LITTLE: Self = Self(1 << 4);
    pub(super) const ALL: Self = Self(0b1_1111);

    /// The fingers themselves, in their order.
    pub(super) fn each(self) -> impl Iterator<Item = &'static Finger> {
        let chosen = move |(place, _): &(usize, &Finger)| self.0 & (1 << *place) != 0;
        FINGERS.iter().enumerate().filter(chosen).map(|(_, finger)| finger)
    }

    /// How many they are.
    pub(super) fn count(self) -> usize {
        self.0.count_ones() as usize
    }
}

/// A finger's two sites.
struct Sites {
    finger: &'static Finger,
    tip: usize,
    target: usize,
}

pub(super) struct FingerReach {
    layout: Layout,
    control_interval: f64,
    sites: Vec<Sites>,
    rules: Rules,
    /// Distance below which the targets are reached, and above which the episode ends, m.
    near: f64,
    far: f64,
    start: Vec<f64>,
}

impl FingerReach {
    pub(super) fn new(
        simulation: &Simulation,
        control_interval: f64,
        fingers: Fingers,
        rules: Rules,
    ) -> BuildResult<Self> {
        let mut sites = Vec::new();
        for finger in fingers.each() {
            sites.push(Sites {
                finger,
                tip: simulation.find(Names::Site, finger.tip)?,
                target: simulation.find(Names::Site, &format!("{}_target", finger.tip))?,
            });
        }
        Ok(Self {
            layout: layout(simulation, fingers),
            control_interval,
            sites,
            rules,
            near: NEAR * fingers.count() as f64,
            far: far(rules) * fingers.count() as f64,
            start: vec![0.0; simulation.qpos().len()],
        })
    }

    /// From each tip to its target, m.
    fn errors(&self, simulation: &Simulation) -> impl Iterator<Item = [f64; 3]> {
        let site = |index| row3(simulation.site_positions(), index);
        self.sites.iter().map(move |sites| difference(site(sites.target), site(sites.tip)))
    }
}

fn layout(simulation: &Simulation, fingers: Fingers) -> Layout {
    let joints = simulation.names_of(Names::Joint);
    let muscles = simulation.names_of(Names::Actuator);
    let per_tip = |key, words: &[&str]| {
        let of_finger = |finger: &'static Finger| {
            per_axis(key, "m", &[&[finger.tip], words].concat(), &["tip"]).phrases
        };
        Block { key, unit: "m", phrases: fingers.each().flat_map(of_finger).collect() }
    };
    Layout::new(vec![
        per_joint("qpos", "rad", &joints, &["position", "angular"]),
        per_joint("qvel", "rad per step", &joints, &["velocity", "angular"]),
        per_tip("tip_pos", &["position", "linear"]),
        per_tip("target_pos", &["position", "target", "linear"]),
        per_tip("reach_err", &["position", "error", "linear"]),
        per_muscle("muscle_len", "m", &muscles, "position"),
        per_muscle("muscle_vel", "m/s", &muscles, "velocity"),
        per_muscle("muscle_force", "N", &muscles, "force"),
        per_muscle("act", "0..1", &muscles, "activation"),
    ])
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
        match (self.rules, configuration) {
            (Rules::MyoSuite, _) => &[("reach", 1.0), ("bonus", 4.0), ("penalty", 50.0)],
            (Rules::Arnold, RewardConfiguration::Sparse) => &[("solved", 5.0)],
            (Rules::Arnold, RewardConfiguration::Dense) => {
                &[("reach", 1.0), ("act_reg", 1.0), ("solved", 1.0)]
            }
        }
    }

    fn thresholds(&self) -> Vec<Threshold> {
        vec![
            Threshold::solved_below("tips to targets (all together)", self.near, "m"),
            Threshold::ends_above("the same (from step 2)", self.far, "m"),
        ]
    }

    fn starts(&self) -> Vec<Start> {
        let target = |sites: &Sites| {
            let finger = sites.finger;
            Start::uniform(format!("target, {}", finger.name), &finger.low, &finger.high, "m")
        };
        let mut starts: Vec<Start> = self.sites.iter().map(target).collect();
        starts.push(Start::fixed("joints", &[0.0], "rad"));
        starts
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        for Sites { finger, target, .. } in &self.sites {
            for axis in 0..3 {
                simulation.model_site_pos_mut()[3 * target + axis] =
                    random.uniform(finger.low[axis], finger.high[axis]);
            }
        }
        start_from(simulation, &self.start);
    }

    fn adopt(&mut self, _start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        // The target is the position of a site, which is part of the recorded model.
        Ok(())
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let site = |index| row3(simulation.site_positions(), index);
        let mut fill = Fill::new(observation);
        fill.put(simulation.qpos());
        fill.put_scaled(simulation.qvel(), self.control_interval);
        self.sites.iter().for_each(|sites| fill.put(site(sites.tip)));
        self.sites.iter().for_each(|sites| fill.put(site(sites.target)));
        self.errors(simulation).for_each(|error| fill.put(&error));
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
        fill.put(simulation.activation());
    }

    fn targets(&self) -> Vec<Target> {
        let target = |sites: &Sites| Target { place: Place::Site(sites.target), radius: NEAR };
        self.sites.iter().map(target).collect()
    }

    fn judge(&mut self, simulation: &Simulation, components: &mut [f64]) -> Verdict {
        let distance = length(self.errors(simulation).flatten());
        let checked = simulation.time() > 2.0 * self.control_interval;
        let done = checked && distance > self.far;
        let solved = distance < self.near;
        components.copy_from_slice(&[
            -distance,
            indicator(distance < 2.0 * self.near) + indicator(solved),
            activation_cost(simulation),
            -indicator(done),
            -distance,
            indicator(solved),
            indicator(done),
        ]);
        Verdict { solved, done }
    }
}

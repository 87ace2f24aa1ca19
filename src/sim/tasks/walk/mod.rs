//! Walk to a point: 80 leg muscles carry the body to a goal on the ground and keep it there (`spec/tasks.md` §2.7).
//!
//! Solved while the root is within 0.1 m of the goal in the plane, which does not end the episode. It ends when the root is
//! below 0.7 m, or after 150 steps; both count as *terminated*.
//!
//! Oddities of the published environment that are kept:
//!
//! * After a step only positions are refreshed. Muscle lengths, velocities, forces and all sensors are therefore one physics
//!   step (1/150 s) older than the joint angles beside them.
//! * Positions are refreshed twice a step, which normalises the root's quaternion twice and can move its last bit.
//! * The upright reward reads the root's quaternion in another order than it is stored, and applies sine and cosine twice.
//! * The energy reward uses excitations, not actions.
//! * The error to the goal is along world axes, the root's velocity along its heading.
//!
//! One is not: the published environment carries activations and warm start over from the episode before. Here every episode
//! starts as its first one does, at rest, so that episodes do not depend on each other. Recorded episodes that started from
//! carried-over muscles replay exactly all the same, because their start is part of the recording.
//!
//! For comparing gait with people (`spec/analysis.md` §3.1) the goal may also stand ahead of the body, at the start or at
//! every step; see [`Goal`]. Nothing is drawn then: episodes of a policy's mean actions are all the same one.

mod expert_observation;
mod heading;

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{AXES, Block, Fill, Layout, per_axis};
use crate::sim::random::Random;
use crate::sim::rotation::euler_of_matrix;

use expert_observation::{ExpertObservation, TOUCH_SENSORS, lean};
use heading::Heading;

use super::{
    BuildResult, Place, RecordedStart, RewardConfiguration, Start, Target, Task, Threshold,
    Verdict, indicator, norm, row3,
};

/// Distance in the plane below which the goal is reached, m.
const ARRIVED: f64 = 0.1;
/// Height of the root below which the body has fallen, m.
const FALLEN: f64 = 0.7;
/// The goal is drawn within this of the origin along both axes, m.
const GOAL_RANGE: f64 = 2.0;
/// Height of the goal, m.
const GOAL_HEIGHT: f64 = 0.94;
/// How far ahead of the body the goal stands where it does, m.
const AHEAD: f64 = 2.0;
/// Coordinates of the root in positions and in velocities.
const ROOT: (usize, usize) = (7, 6);
/// The published initial pose, single-precision numbers: root position, root quaternion, 14 joints right, 14 left.
#[expect(clippy::unreadable_literal, reason = "quoted digit by digit")]
const START: [f64; 35] = [
    0.7073183655738831,
    0.6811050772666931,
    0.9361767768859863,
    -0.029129609970030505,
    -0.03280220982610866,
    -0.007069453719489139,
    -0.9990122640276374,
    0.05718978866934776,
    -0.08046305924654007,
    -0.3613775372505188,
    0.006139980163425207,
    0.001562759978696704,
    0.3457704186439514,
    0.03181016817688942,
    0.15059691667556763,
    0.2333894520998001,
    0.22419987618923187,
    0.03759185969829559,
    -0.017720049247145653,
    0.019231349229812622,
    -0.11780726164579391,
    0.0773492231965065,
    -0.03445803001523018,
    -0.33847641944885254,
    -0.006393060088157654,
    0.001549990032799542,
    0.35934484004974365,
    0.0327627994120121,
    -0.16855010390281677,
    0.20909413695335388,
    0.25398579239845276,
    0.03759526088833809,
    -0.01772008091211319,
    0.01923106051981449,
    -0.11780738830566406,
];

/// Where the goal is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Goal {
    /// Drawn around the origin: the published task.
    Random,
    /// Ahead of the body as it starts, along its heading.
    AheadOfStart,
    /// Ahead of the body wherever it is, put there again after every step. A step is rewarded by the goal it had.
    KeptAhead,
}

pub(super) struct Walk {
    layout: Layout,
    expert: ExpertObservation,
    control_interval: f64,
    horizon: usize,
    root: usize,
    rule: Goal,
    goal: [f64; 3],
    /// Distance from the goal after the step before, m.
    previous_distance: f64,
    step: usize,
}

impl Walk {
    pub(super) fn new(
        simulation: &Simulation,
        control_interval: f64,
        horizon: usize,
        rule: Goal,
    ) -> BuildResult<Self> {
        // The first joint is the root's.
        let joints: Vec<String> = simulation.names_of(Names::Joint).into_iter().skip(1).collect();
        let (coordinates, expected) = (simulation.qpos().len(), ROOT.0 + joints.len());
        if coordinates != expected || coordinates != START.len() {
            let what = format!(
                "a walking body needs a free root and {} joints of one axis each, the model has {coordinates} coordinates \
                 and {} other joints",
                START.len() - ROOT.0,
                joints.len()
            );
            return Err(simulation.unfit(what));
        }
        let root = simulation.find(Names::Body, "root")?;
        let expert = ExpertObservation::new(simulation, root)?;
        Ok(Self {
            layout: layout(&joints, &simulation.names_of(Names::Actuator))
                .with_clean_only(expert.blocks()),
            expert,
            control_interval,
            horizon,
            root,
            rule,
            goal: [0.0, 0.0, GOAL_HEIGHT],
            previous_distance: 0.0,
            step: 0,
        })
    }

    /// Distance of the root from the goal in the plane, m.
    fn distance(&self, simulation: &Simulation) -> f64 {
        let root = row3(simulation.body_positions(), self.root);
        norm(&[root[0] - self.goal[0], root[1] - self.goal[1]])
    }

    /// Puts the goal ahead of the body as it stands now.
    fn put_goal_ahead(&mut self, simulation: &Simulation) {
        let root = row3(simulation.body_positions(), self.root);
        let [x, y] = Heading::of(simulation, self.root).ahead();
        self.goal = [root[0] + AHEAD * x, root[1] + AHEAD * y, GOAL_HEIGHT];
    }
}

/// A model name such as `knee_angle_r_translation2` as words: the name without its side, then the side.
fn words_of(name: &str) -> [String; 2] {
    let side = |letter: &str| match letter {
        "r" => Some("right"),
        "l" => Some("left"),
        _ => None,
    };
    let found = name.split('_').find_map(side).unwrap_or_default();
    let rest: Vec<&str> = name.split('_').filter(|part| side(part).is_none()).collect();
    [rest.join("_"), found.to_owned()]
}

/// A block with one element per name, described by the name, its side and `words`.
fn per_sided(key: &'static str, unit: &'static str, names: &[String], words: &[&str]) -> Block {
    let phrase = |name: &String| {
        words_of(name).into_iter().chain(words.iter().map(|word| (*word).to_owned())).collect()
    };
    Block { key, unit, phrases: names.iter().map(phrase).collect() }
}

fn layout(joints: &[String], muscles: &[String]) -> Layout {
    let owned = |words: &[&str]| -> Vec<String> { words.iter().map(|w| (*w).to_owned()).collect() };
    let touch = [["right", "foot"], ["right", "toes"], ["left", "foot"], ["left", "toes"]]
        .map(|[side, part]| owned(&[side, part, "contact", "force"]));
    let tilt = [AXES[0], AXES[1]].map(|axis| owned(&["root", axis, "angular", "position"]));
    let muscle = |key, unit, quantity| per_sided(key, unit, muscles, &[quantity, "muscle"]);
    Layout::new(vec![
        per_sided("qpos", "rad or m", joints, &["position", "angular", "joint"]),
        per_sided("qvel", "per step", joints, &["velocity", "angular", "joint"]),
        Block { key: "feet_contact_force", unit: "N", phrases: touch.to_vec() },
        Block { key: "root_tilt", unit: "rad", phrases: tilt.to_vec() },
        muscle("muscle_length", "m", "position"),
        muscle("muscle_velocity", "m/s", "velocity"),
        muscle("muscle_force", "N", "force"),
        muscle("act", "0..1", "activation"),
        per_axis("root_vel", "m/s", &["root"], &["linear", "velocity"]),
        per_axis("target_error", "m", &["root"], &["position", "linear", "error"]),
    ])
}

/// Forward and sideways lean as the published reward computes them, in 0..1.
fn uprightness(simulation: &Simulation) -> f64 {
    let twice = |angle: f64| angle.sin().sin().atan2(angle.cos().cos());
    let [pitch, yaw] = lean(simulation).map(twice);
    (-3.0 * (pitch.powi(2) + yaw.powi(2))).exp()
}

/// Sum of all excitations plus their Euclidean norm. The published code adds up single-precision numbers, eight running
/// sums at a time; rounding as it does keeps the reward within single rounding of the recorded one.
fn effort(excitation: &[f64]) -> f64 {
    let total = |term: &dyn Fn(f32) -> f32| -> f32 {
        let mut sums = [0.0_f32; 8];
        for (place, &u) in excitation.iter().enumerate() {
            sums[place % 8] += term(u as f32);
        }
        let [a, b, c, d, e, f, g, h] = sums;
        ((a + b) + (c + d)) + ((e + f) + (g + h))
    };
    f64::from(total(&f32::abs) + total(&|u| u * u).sqrt())
}

impl Task for Walk {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn clean_keys(&self) -> &'static [&'static str] {
        expert_observation::KEYS
    }

    fn action_phrases(&self, muscles: &[String]) -> Vec<Vec<String>> {
        per_sided("action", "", muscles, &["activation", "muscle"]).phrases
    }

    fn joint_word(&self, name: &str) -> String {
        let [word, _] = words_of(name);
        word
    }

    fn heading(&self, simulation: &Simulation) -> Option<f64> {
        Some(Heading::of(simulation, self.root).angle())
    }

    fn components(&self) -> &'static [&'static str] {
        &["tracking_reward", "upright_reward", "energy_reward", "solved", "alive"]
    }

    fn weights(&self, _configuration: RewardConfiguration) -> &'static [(&'static str, f64)] {
        &[
            ("tracking_reward", 0.8),
            ("energy_reward", 0.1),
            ("upright_reward", 0.1),
            ("solved", 1.0),
        ]
    }

    fn thresholds(&self) -> Vec<Threshold> {
        vec![
            Threshold::solved_below("root to goal (in the plane)", ARRIVED, "m"),
            Threshold::ends_below("height of the root", FALLEN, "m"),
        ]
    }

    fn starts(&self) -> Vec<Start> {
        let corner = [GOAL_RANGE, GOAL_RANGE];
        let goal = match self.rule {
            Goal::Random => Start::uniform("goal x, y", &corner.map(|x| -x), &corner, "m"),
            Goal::AheadOfStart => Start::fixed("goal ahead of the start", &[AHEAD], "m"),
            Goal::KeptAhead => Start::fixed("goal ahead of the body, always", &[AHEAD], "m"),
        };
        let place = [START[0], START[1], START[2]];
        vec![
            goal,
            Start::fixed("height of the goal", &[GOAL_HEIGHT], "m"),
            Start::fixed("root", &place, "m"),
            Start::rule("pose", "a published standing pose, at rest"),
        ]
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        simulation.reset();
        simulation.qpos_mut().copy_from_slice(&START);
        simulation.forward();
        match self.rule {
            Goal::Random => {
                let [x, y] = std::array::from_fn(|_| random.uniform(-GOAL_RANGE, GOAL_RANGE));
                self.goal = [x, y, GOAL_HEIGHT];
            }
            Goal::AheadOfStart | Goal::KeptAhead => self.put_goal_ahead(simulation),
        }
    }

    fn adopt(&mut self, start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        for (axis, coordinate) in self.goal.iter_mut().enumerate() {
            *coordinate = start.number(&format!("/goal_pos/{axis}"))?;
        }
        Ok(())
    }

    fn begin(&mut self, simulation: &Simulation) {
        self.step = 0;
        self.previous_distance = self.distance(simulation);
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let sensors = simulation.sensors();
        let matrix = &simulation.body_matrices()[9 * self.root..][..9];
        let heading = Heading::of(simulation, self.root);
        let velocity = heading.localise([sensors[0], sensors[1], sensors[2]]);
        let mut fill = Fill::new(observation);
        fill.put(&simulation.qpos()[ROOT.0..]);
        fill.put_scaled(&simulation.qvel()[ROOT.1..], self.control_interval);
        fill.put(&sensors[sensors.len() - TOUCH_SENSORS..]);
        fill.put(&euler_of_matrix(matrix)[..2]);
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
        fill.put(simulation.activation());
        fill.put(&velocity);
        fill.put_difference(&self.goal, &simulation.qpos()[..3]);
        self.expert.put(simulation, &self.goal, &mut fill);
    }

    fn targets(&self) -> Vec<Target> {
        // Only the plane counts, so it is marked where one would stand on it.
        let [x, y, _] = self.goal;
        vec![Target { place: Place::Point([x, y, 0.0]), radius: ARRIVED }]
    }

    fn judge(&mut self, simulation: &Simulation, components: &mut [f64]) -> Verdict {
        self.step += 1;
        let distance = self.distance(simulation);
        let progress = self.previous_distance - distance;
        let effort = effort(simulation.excitation());
        let fallen = row3(simulation.body_positions(), self.root)[2] < FALLEN;
        let (solved, done) = (distance < ARRIVED, fallen || self.step >= self.horizon);
        components.copy_from_slice(&[
            20.0 * progress,
            uprightness(simulation),
            (-0.05 * effort).exp(),
            indicator(solved),
            indicator(!done),
        ]);
        if self.rule == Goal::KeptAhead {
            self.put_goal_ahead(simulation);
        }
        self.previous_distance = self.distance(simulation);
        Verdict { solved, done }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_side_is_taken_out_of_a_name() {
        for (name, word, side) in [
            ("knee_angle_r_translation2", "knee_angle_translation2", "right"),
            ("hip_flexion_l", "hip_flexion", "left"),
            ("knee_angle_r_beta_rotation1", "knee_angle_beta_rotation1", "right"),
            ("glmax1_l", "glmax1", "left"),
        ] {
            assert_eq!(words_of(name), [word, side]);
        }
    }
}

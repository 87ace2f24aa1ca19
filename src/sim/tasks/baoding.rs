//! Baoding: roll two balls around each other in the palm, each following a moving target (`spec/tasks.md` §2.3).
//!
//! The targets run on an ellipse in the palm, half a turn apart. Solved while both balls are within 15 mm of their
//! targets; the episode ends when a ball drops below 1.25 m.
//!
//! Oddities of the published environment that are kept:
//!
//! * A reset does not move the targets: the first observation shows them where the *previous* episode left them. Here
//!   every episode is drawn as if a full-length episode of the same task had come before it (its parameters come from
//!   the episode's own random stream), so that an episode does not depend on which one this body played before.
//! * The target of step *k* is that of phase *k* − 1.
//! * The hand's joint velocities are not multiplied by the control interval, the balls' velocities are.
//! * The drawn ball radius is written to all three size entries; bounding radius and inertia stay as compiled.
//! * P1 has no randomness beyond the policy's.

use std::f64::consts::{FRAC_PI_2, FRAC_PI_4, PI, TAU};

use crate::npz::ArrayError;
use crate::sim::engine::{Names, Simulation};
use crate::sim::layout::{Fill, Layout, per_axis, per_joint, per_muscle};
use crate::sim::random::Random;
use crate::sim::rotation::euler_of_matrix;

use super::{
    BuildResult, Place, RecordedStart, RewardConfiguration, Start, Target, Task, Threshold,
    Verdict, activation_cost, indicator, norm, row3, start_from,
};

/// Distance below which a ball is on its target, m.
const NEAR: f64 = 0.015;
/// Height below which a ball has been dropped, m.
const DROP_HEIGHT: f64 = 1.25;
/// Centre of the targets' ellipse in the palm, m.
const CENTRE: [f64; 2] = [-0.0125, -0.07];
/// Number of hand joints; the balls' free joints follow.
const HAND_JOINTS: usize = 23;
/// Initial forearm rotation, rad: palm up.
const PALM_UP: f64 = -1.57;
/// Initial positions of the balls, m.
const BALL_STARTS: [[f64; 3]; 2] = [[-0.227, -0.511, 1.452], [-0.256, -0.552, 1.442]];

/// Which way the targets turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Direction {
    /// They stand still.
    Hold,
    /// Clockwise.
    Clockwise,
    /// Counter-clockwise.
    CounterClockwise,
}

impl Direction {
    /// In the order of the published random choice.
    const ALL: [Self; 3] = [Self::Hold, Self::Clockwise, Self::CounterClockwise];

    /// What the targets do, in the same order.
    const PHRASES: &[&str] = &["stand still", "turn clockwise", "turn counter-clockwise"];

    fn phrase(self) -> &'static str {
        Self::PHRASES[self as usize]
    }

    fn sign(self) -> f64 {
        match self {
            Self::Hold => 0.0,
            Self::Clockwise => -1.0,
            Self::CounterClockwise => 1.0,
        }
    }
}

/// What distinguishes the four Baoding tasks. Ranges are (low, high).
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Variant {
    /// Fixed, or drawn anew each episode.
    pub(super) direction: Option<Direction>,
    /// Time of one turn, s.
    pub(super) period: (f64, f64),
    /// Half axes of the ellipse, m.
    pub(super) x_radius: (f64, f64),
    pub(super) y_radius: (f64, f64),
    /// Where the first target starts, rad, before the offset of π/4.
    pub(super) initial_phase: f64,
    /// Half width of a random addition to it, rad.
    pub(super) phase_limit: f64,
    /// Radius of the balls, m.
    pub(super) ball_size: (f64, f64),
    /// Mass of a ball, kg.
    pub(super) ball_mass: (f64, f64),
    /// Sliding, torsional and rolling friction.
    pub(super) friction: [(f64, f64); 3],
}

impl Variant {
    /// P1, turning in `direction`: nothing is random.
    pub(super) const fn p1(direction: Direction) -> Self {
        Self {
            direction: Some(direction),
            period: (5.0, 5.0),
            x_radius: (0.025, 0.025),
            y_radius: (0.028, 0.028),
            initial_phase: FRAC_PI_2,
            phase_limit: 0.0,
            ball_size: (0.022, 0.022),
            ball_mass: (0.043, 0.043),
            friction: [(1.0, 1.0), (0.005, 0.005), (0.0001, 0.0001)],
        }
    }

    /// P2: everything is random; the targets start anywhere, or with `overlap` at the balls.
    pub(super) const fn p2(overlap: bool) -> Self {
        Self {
            direction: None,
            period: (4.0, 6.0),
            x_radius: (0.020, 0.030),
            y_radius: (0.022, 0.032),
            initial_phase: if overlap { FRAC_PI_2 } else { 0.0 },
            phase_limit: if overlap { 0.0 } else { PI },
            ball_size: (0.018, 0.024),
            ball_mass: (0.030, 0.300),
            friction: [(0.8, 1.2), (0.004, 0.006), (0.00008, 0.00012)],
        }
    }
}

/// How the targets move in one episode.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Goal {
    /// Phase per control step, rad.
    phase_per_step: f64,
    x_radius: f64,
    y_radius: f64,
    /// Angles at which the two targets start, rad.
    start: [f64; 2],
}

impl Goal {
    /// Position of target `index` at control step `step`, in the palm, m.
    fn position(&self, index: usize, step: usize) -> [f64; 2] {
        let angle = self.phase_per_step * step as f64 + self.start[index];
        [self.x_radius * angle.cos() + CENTRE[0], self.y_radius * angle.sin() + CENTRE[1]]
    }
}

pub(super) struct Baoding {
    layout: Layout,
    variant: Variant,
    control_interval: f64,
    horizon: usize,
    ball_bodies: [usize; 2],
    ball_geoms: [usize; 2],
    ball_sites: [usize; 2],
    target_sites: [usize; 2],
    start: Vec<f64>,
    goal: Goal,
    /// Control steps since the reset.
    step: usize,
}

impl Baoding {
    pub(super) fn new(
        simulation: &Simulation,
        control_interval: f64,
        horizon: usize,
        variant: Variant,
    ) -> BuildResult<Self> {
        let find = |kind, names: [&str; 2]| -> BuildResult<[usize; 2]> {
            Ok([simulation.find(kind, names[0])?, simulation.find(kind, names[1])?])
        };
        let mut joints = simulation.names_of(Names::Joint);
        joints.truncate(HAND_JOINTS);
        let mut start = simulation.reference_qpos().to_vec();
        start[..HAND_JOINTS].fill(0.0);
        start[0] = PALM_UP;
        for (ball, position) in BALL_STARTS.iter().enumerate() {
            start[HAND_JOINTS + 7 * ball..][..3].copy_from_slice(position);
        }
        let goal = Goal { phase_per_step: 0.0, x_radius: 0.0, y_radius: 0.0, start: [0.0; 2] };
        Ok(Self {
            layout: layout(&joints, &simulation.names_of(Names::Actuator)),
            variant,
            control_interval,
            horizon,
            ball_bodies: find(Names::Body, ["ball1", "ball2"])?,
            ball_geoms: find(Names::Geom, ["ball1", "ball2"])?,
            ball_sites: find(Names::Site, ["ball1_site", "ball2_site"])?,
            target_sites: find(Names::Site, ["target1_site", "target2_site"])?,
            start,
            goal,
            step: 0,
        })
    }

    fn draw_direction(&self, random: &mut Random) -> Direction {
        self.variant.direction.unwrap_or_else(|| Direction::ALL[random.index(3) as usize])
    }

    fn goal_of(&self, direction: Direction, [x, y, period, r]: [f64; 4]) -> Goal {
        let first = FRAC_PI_4 + self.variant.initial_phase + r;
        Goal {
            phase_per_step: direction.sign() * TAU * self.control_interval / period,
            x_radius: x,
            y_radius: y,
            start: [first, first - PI],
        }
    }

    fn place_targets(&self, simulation: &mut Simulation, goal: &Goal, step: usize) {
        for (index, &site) in self.target_sites.iter().enumerate() {
            let [x, y] = goal.position(index, step);
            let position = &mut simulation.model_site_pos_mut()[3 * site..];
            position[0] = x;
            position[1] = y;
        }
    }
}

fn layout(joints: &[String], muscles: &[String]) -> Layout {
    let ball = |id| ["object", "ball", id];
    let target = |id| ["target", "ball", id];
    let with = |words: [&'static str; 3], tail: &[&'static str]| [&words[..], tail].concat();
    let object = |id, tail| with(ball(id), tail);
    let goal = |id, tail| with(target(id), tail);
    Layout::new(vec![
        per_joint("hand_pos", "rad", joints, &["position", "angular"]),
        per_joint("hand_vel", "rad/s", joints, &["velocity", "angular"]),
        per_axis("object1_pos", "m", &object("id_1", &["position", "linear"]), &[]),
        per_axis("object1_velp", "m per step", &object("id_1", &["velocity", "linear"]), &[]),
        per_axis("object2_pos", "m", &object("id_2", &["position", "linear"]), &[]),
        per_axis("object2_velp", "m per step", &object("id_2", &["velocity", "linear"]), &[]),
        per_axis("target1_pos", "m", &goal("id_1", &["position", "linear"]), &[]),
        per_axis("target2_pos", "m", &goal("id_2", &["position", "linear"]), &[]),
        per_axis("target1_err", "m", &goal("id_1", &["position", "error", "linear"]), &[]),
        per_axis("target2_err", "m", &goal("id_2", &["position", "error", "linear"]), &[]),
        per_muscle("muscle_len", "m", muscles, "position"),
        per_muscle("muscle_vel", "m/s", muscles, "velocity"),
        per_muscle("muscle_force", "N", muscles, "force"),
        per_axis("object1_rot", "rad", &object("id_1", &["position", "angular"]), &[]),
        per_axis("object2_rot", "rad", &object("id_2", &["position", "angular"]), &[]),
        per_axis("object1_velr", "rad/s", &object("id_1", &["velocity", "angular"]), &[]),
        per_axis("object2_velr", "rad/s", &object("id_2", &["velocity", "angular"]), &[]),
        per_muscle("act", "0..1", muscles, "activation"),
    ])
}

impl Task for Baoding {
    fn layout(&self) -> &Layout {
        &self.layout
    }

    fn clean_keys(&self) -> &'static [&'static str] {
        &[
            "hand_pos",
            "object1_pos",
            "object1_velp",
            "object2_pos",
            "object2_velp",
            "target1_pos",
            "target2_pos",
            "target1_err",
            "target2_err",
            "act",
        ]
    }

    fn components(&self) -> &'static [&'static str] {
        &["pos_dist_1", "pos_dist_2", "act_reg", "alive", "sparse", "solved", "done"]
    }

    fn weights(&self, configuration: RewardConfiguration) -> &'static [(&'static str, f64)] {
        match configuration {
            RewardConfiguration::Sparse => &[("solved", 5.0)],
            RewardConfiguration::Dense => {
                &[("pos_dist_1", 1.0), ("pos_dist_2", 1.0), ("alive", 1.0), ("solved", 5.0)]
            }
        }
    }

    fn thresholds(&self) -> Vec<Threshold> {
        vec![
            Threshold::solved_below("each ball to its target", NEAR, "m"),
            Threshold::solved_above("height of each ball", DROP_HEIGHT, "m"),
            Threshold::ends_below("height of a ball", DROP_HEIGHT, "m"),
        ]
    }

    fn starts(&self) -> Vec<Start> {
        let v = self.variant;
        let range = |quantity, (low, high): (f64, f64), unit| {
            Start::uniform(quantity, &[low], &[high], unit)
        };
        let turns = match v.direction {
            Some(direction) => Start::rule("targets", direction.phrase()),
            None => Start::one_of("targets", Direction::PHRASES),
        };
        let first = FRAC_PI_4 + v.initial_phase;
        let (low, high) = (v.friction.map(|f| f.0), v.friction.map(|f| f.1));
        vec![
            turns,
            range("time of a turn", v.period, "s"),
            range("half axis x of the ellipse", v.x_radius, "m"),
            range("half axis y of the ellipse", v.y_radius, "m"),
            range(
                "angle of the first target",
                (first - v.phase_limit, first + v.phase_limit),
                "rad",
            ),
            range("radius of a ball", v.ball_size, "m"),
            range("mass of a ball", v.ball_mass, "kg"),
            Start::uniform("friction, sliding, torsional, rolling", &low, &high, ""),
            Start::fixed("ball 1", &BALL_STARTS[0], "m"),
            Start::fixed("ball 2", &BALL_STARTS[1], "m"),
            Start::fixed("pro_sup", &[PALM_UP], "rad"),
            Start::fixed("other joints", &[0.0], "rad"),
        ]
    }

    fn reset(&mut self, simulation: &mut Simulation, random: &mut Random) {
        let v = self.variant;
        let mut draw = |(low, high)| random.uniform(low, high);
        // The published draw order, with the direction drawn after it so that its rejection loop cannot shift the rest.
        let radii_and_period = [draw(v.x_radius), draw(v.y_radius), draw(v.period)];
        let mass = draw(v.ball_mass);
        let friction = v.friction.map(&mut draw);
        let size = draw(v.ball_size);
        let r = draw((-v.phase_limit, v.phase_limit));
        let previous = [
            draw(v.x_radius),
            draw(v.y_radius),
            draw(v.period),
            draw((-v.phase_limit, v.phase_limit)),
        ];
        let [x, y, period] = radii_and_period;
        let direction = self.draw_direction(random);
        self.goal = self.goal_of(direction, [x, y, period, r]);
        let direction = self.draw_direction(random);
        let previous = self.goal_of(direction, previous);
        for (&body, &geom) in self.ball_bodies.iter().zip(&self.ball_geoms) {
            simulation.model_body_mass_mut()[body] = mass;
            simulation.model_geom_friction_mut()[3 * geom..][..3].copy_from_slice(&friction);
            simulation.model_geom_size_mut()[3 * geom..][..3].fill(size);
        }
        self.place_targets(simulation, &previous, self.horizon - 1);
        self.step = 0;
        start_from(simulation, &self.start);
    }

    fn adopt(&mut self, start: &RecordedStart<'_>) -> Result<(), ArrayError> {
        let phases = start.arrays.get("goal_angles")?.to_f64();
        if phases.len() < 4 {
            return Err(ArrayError::Array {
                array: "goal_angles".to_owned(),
                what: "has fewer than two rows".to_owned(),
            });
        }
        self.goal = Goal {
            phase_per_step: phases[2] - phases[0],
            x_radius: start.number("/x_radius")?,
            y_radius: start.number("/y_radius")?,
            start: [
                start.number("/ball_1_starting_angle")?,
                start.number("/ball_2_starting_angle")?,
            ],
        };
        self.step = 0;
        Ok(())
    }

    fn before_step(&mut self, simulation: &mut Simulation) {
        let goal = self.goal;
        self.place_targets(simulation, &goal, self.step);
        self.step += 1;
    }

    fn observe(&self, simulation: &Simulation, observation: &mut [f64]) {
        let dt = self.control_interval;
        let (qpos, qvel) = (simulation.qpos(), simulation.qvel());
        let site = |index| row3(simulation.site_positions(), index);
        let [ball1, ball2] = self.ball_sites.map(site);
        let [target1, target2] = self.target_sites.map(site);
        let mut fill = Fill::new(observation);
        fill.put(&qpos[..HAND_JOINTS]);
        fill.put(&qvel[..HAND_JOINTS]);
        fill.put(ball1);
        fill.put_scaled(&qvel[HAND_JOINTS..][..3], dt);
        fill.put(ball2);
        fill.put_scaled(&qvel[HAND_JOINTS + 6..][..3], dt);
        fill.put(target1);
        fill.put(target2);
        fill.put_difference(target1, ball1);
        fill.put_difference(target2, ball2);
        fill.put_cleaned(simulation.muscle_length());
        fill.put_cleaned(simulation.muscle_velocity());
        fill.put_cleaned(simulation.muscle_force());
        for &ball in &self.ball_sites {
            fill.put(&euler_of_matrix(&simulation.site_matrices()[9 * ball..][..9]));
        }
        for &ball in &self.ball_bodies {
            fill.put(&simulation.body_velocity(ball)[..3]);
        }
        fill.put(simulation.activation());
    }

    fn targets(&self) -> Vec<Target> {
        self.target_sites.map(|site| Target { place: Place::Site(site), radius: NEAR }).to_vec()
    }

    fn judge(&mut self, simulation: &Simulation, components: &mut [f64]) -> Verdict {
        let distance = |index: usize| {
            let ball = row3(simulation.site_positions(), self.ball_sites[index]);
            let target = row3(simulation.site_positions(), self.target_sites[index]);
            norm(&[target[0] - ball[0], target[1] - ball[1], target[2] - ball[2]])
        };
        let (first, second) = (distance(0), distance(1));
        let height = |ball: usize| row3(simulation.site_positions(), ball)[2];
        let fallen = self.ball_sites.iter().any(|&ball| height(ball) < DROP_HEIGHT);
        let solved = first < NEAR && second < NEAR && !fallen;
        components.copy_from_slice(&[
            -first,
            -second,
            activation_cost(simulation),
            indicator(!fallen),
            -(first + second),
            indicator(solved),
            indicator(fallen),
        ]);
        Verdict { solved, done: fallen }
    }
}

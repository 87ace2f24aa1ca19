//! What is kept of every step of an episode (`spec/analysis.md` §0.3), and where it is read from.
//!
//! As in the published recordings, joints are read before the physics of a step, beside the observation that the action was
//! chosen from. So are, for walking, muscle activations, touch forces and the root's velocity: those of its observation. The
//! other tasks' activations, and all rewards, are read after the step.
//!
//! Memory for a whole episode is taken when it starts; a step allocates nothing.

use serde::{Deserialize, Serialize};

use super::engine::Names;
use super::environment::{Environment, StepOutcome};

/// Which per-step channels are kept.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Channels {
    /// None: only what is counted.
    Counts,
    /// The mean of the action distribution, for subspaces.
    ActionMeans,
    /// Muscle excitation, for synergies.
    Excitations,
    /// All.
    All,
}

impl Channels {
    fn keep_means(self) -> bool {
        matches!(self, Self::ActionMeans | Self::All)
    }

    fn keep_excitations(self) -> bool {
        matches!(self, Self::Excitations | Self::All)
    }
}

/// What a body was sent in a step.
pub(super) struct Sent<'a> {
    pub(super) action: &'a [f32],
    pub(super) excitation: &'a [f64],
}

/// Per-step channels of one episode, row-major with one row per step. Empty where not asked for.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Recording {
    /// Mean of the action distribution, before sampling and clipping.
    pub action_mean: Vec<f32>,
    /// What was sent to the body.
    pub action: Vec<f32>,
    /// Muscle excitation, 0..1.
    pub excitation: Vec<f64>,
    /// Muscle activation, 0..1: before the step when walking, else after it.
    pub activation: Vec<f64>,
    /// Joint positions before the step, rad; m where a joint slides.
    pub joints: Vec<f64>,
    /// Joint velocities before the step, rad/s; m/s where a joint slides.
    pub joint_velocities: Vec<f64>,
    /// Whether the step counts as solved.
    pub solved: Vec<bool>,
    /// Reward of the step.
    pub reward: Vec<f64>,
    /// What the reward is a weighted sum of.
    pub reward_components: Vec<f64>,
    /// Touch forces before the step, N: right foot, right toes, left foot, left toes. Walking only.
    pub foot_contacts: Vec<f64>,
    /// Velocity of the root before the step, m/s: along its heading, across, up. Walking only.
    pub root_velocity: Vec<f64>,
    /// Heading of the root before the step, rad. Walking only.
    pub root_yaw: Vec<f64>,
}

/// A joint of the body itself, not of an object.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct JointName {
    pub name: String,
    /// Whether it moves along an axis, in m, not about one, in rad.
    pub slides: bool,
}

/// Names of what a recording's columns mean.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ChannelNames {
    /// Muscles, in the order of actions.
    pub muscles: Vec<String>,
    /// Joints of the body, in the order of [`Recording::joints`].
    pub joints: Vec<JointName>,
    /// Reward components.
    pub reward_components: Vec<String>,
    /// Whether feet and root are recorded, and activations before the step.
    pub walking: bool,
}

/// Where the channels of a task are read from.
#[derive(Debug, Clone)]
pub(super) struct Recorder {
    channels: Channels,
    horizon: usize,
    muscles: usize,
    joint_positions: Vec<usize>,
    joint_velocities: Vec<usize>,
    reward_components: usize,
    /// Places in the observation; none unless walking.
    foot_contacts: Vec<usize>,
    root_velocity: Vec<usize>,
}

impl Recorder {
    pub(super) fn new(environment: &Environment, channels: Channels) -> Self {
        let simulation = environment.simulation();
        let joints = own_joints(environment);
        let layout = environment.task().layout();
        Self {
            channels,
            horizon: environment.definition().horizon,
            muscles: simulation.excitation().len(),
            joint_positions: joints.iter().map(|&j| simulation.joint_qpos_address(j)).collect(),
            joint_velocities: joints.iter().map(|&j| simulation.joint_qvel_address(j)).collect(),
            reward_components: environment.task().components().len(),
            foot_contacts: layout.indices(&["feet_contact_force"]),
            root_velocity: layout.indices(&["root_vel"]),
        }
    }

    fn is_walking(&self) -> bool {
        !self.foot_contacts.is_empty()
    }

    /// An empty recording with memory for a whole episode.
    pub(super) fn begin(&self) -> Recording {
        let steps = |keep: bool, width: usize| if keep { self.horizon * width } else { 0 };
        let all = self.channels == Channels::All;
        let doubles = |width: usize| Vec::with_capacity(steps(all, width));
        let (means, excitations) = (self.channels.keep_means(), self.channels.keep_excitations());
        Recording {
            action_mean: Vec::with_capacity(steps(means, self.muscles)),
            action: Vec::with_capacity(steps(all, self.muscles)),
            excitation: Vec::with_capacity(steps(excitations, self.muscles)),
            activation: doubles(self.muscles),
            joints: doubles(self.joint_positions.len()),
            joint_velocities: doubles(self.joint_velocities.len()),
            solved: Vec::with_capacity(steps(all, 1)),
            reward: doubles(1),
            reward_components: doubles(self.reward_components),
            foot_contacts: doubles(self.foot_contacts.len()),
            root_velocity: doubles(self.root_velocity.len()),
            root_yaw: doubles(usize::from(self.is_walking())),
        }
    }

    /// Keeps what is read before a step, for which the policy gave `means`.
    pub(super) fn before_step(
        &self,
        environment: &Environment,
        means: &[f32],
        recording: &mut Recording,
    ) {
        if self.channels.keep_means() {
            recording.action_mean.extend_from_slice(means);
        }
        if self.channels != Channels::All {
            return;
        }
        let simulation = environment.simulation();
        let (qpos, qvel) = (simulation.qpos(), simulation.qvel());
        recording.joints.extend(self.joint_positions.iter().map(|&at| qpos[at]));
        recording.joint_velocities.extend(self.joint_velocities.iter().map(|&at| qvel[at]));
        if self.is_walking() {
            let observation = environment.observation();
            recording.activation.extend_from_slice(simulation.activation());
            recording.foot_contacts.extend(self.foot_contacts.iter().map(|&at| observation[at]));
            recording.root_velocity.extend(self.root_velocity.iter().map(|&at| observation[at]));
            recording.root_yaw.push(environment.task().heading(simulation).unwrap_or(f64::NAN));
        }
    }

    /// Keeps what is read after a step in which the body was `sent` something.
    pub(super) fn after_step(
        &self,
        environment: &Environment,
        sent: &Sent<'_>,
        outcome: &StepOutcome,
        recording: &mut Recording,
    ) {
        if self.channels.keep_excitations() {
            recording.excitation.extend_from_slice(sent.excitation);
        }
        if self.channels != Channels::All {
            return;
        }
        recording.action.extend_from_slice(sent.action);
        if !self.is_walking() {
            recording.activation.extend_from_slice(environment.simulation().activation());
        }
        recording.solved.push(outcome.solved);
        recording.reward.push(outcome.reward);
        recording.reward_components.extend_from_slice(environment.components());
    }
}

/// What the columns of recordings of `environment`'s task mean.
#[must_use]
pub fn names_of(environment: &Environment) -> ChannelNames {
    let simulation = environment.simulation();
    let names = simulation.names_of(Names::Joint);
    let joint = |joint: usize| JointName {
        name: names[joint].clone(),
        slides: simulation.joint_slides(joint),
    };
    let components = environment.task().components();
    ChannelNames {
        muscles: environment.muscles(),
        joints: own_joints(environment).into_iter().map(joint).collect(),
        reward_components: components.iter().map(|&name| name.to_owned()).collect(),
        walking: Recorder::new(environment, Channels::All).is_walking(),
    }
}

/// The body's own joints, not those of objects nor a free root: those with a position among the observed joints.
fn own_joints(environment: &Environment) -> Vec<usize> {
    let task = environment.task();
    let observed: std::collections::BTreeSet<&str> = task
        .layout()
        .phrases()
        .filter(|phrase| phrase.last().is_some_and(|word| word == "joint"))
        .map(|phrase| phrase[0].as_str())
        .collect();
    let names = environment.simulation().names_of(Names::Joint);
    let is_own = |name: &String| observed.contains(task.joint_word(name).as_str());
    names.iter().enumerate().filter(|(_, name)| is_own(name)).map(|(joint, _)| joint).collect()
}

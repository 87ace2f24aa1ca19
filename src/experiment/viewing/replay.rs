//! A recorded episode, played again to see the body.
//!
//! A recording holds joints and controls, not where bones and objects were. With the seed of the start and the recorded
//! excitations physics goes through the same states again, which the recorded joints confirm at every step. A recording
//! without seeds (upstream's) is posed by its joints instead: then objects stay where the model has them.

use crate::record::scene::{Frame, Stage};
use crate::record::{Episode, Recording, Samples, names};
use crate::sim::bodies::Bodies;
use crate::sim::engine::{EngineError, Names, Simulation};
use crate::sim::environment::Environment;
use crate::sim::puppet::{Puppet, Snapshot};
use crate::sim::random::Random;
use crate::sim::tasks::{self, RewardConfiguration};

use super::staging::{Aim, Staging};

/// Joints may differ by this much from the recorded ones: rounding of another machine, rad or m.
const TOLERANCE: f64 = 1e-6;

/// Why a recorded episode cannot be shown.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    #[error(transparent)]
    Engine(#[from] EngineError),
    #[error("`{task}` is no task of this program, so there is no body to show")]
    UnknownTask { task: String },
    #[error("the recording of `{task}` has no channel `{channel}`, which showing needs")]
    NoChannel { task: String, channel: &'static str },
    #[error("`{channel}` of the recording of `{task}` has {found} elements, its body {expected}")]
    Width { task: String, channel: &'static str, found: usize, expected: usize },
    #[error("the recording of `{task}` moves a joint `{joint}` that its body does not have")]
    UnknownJoint { task: String, joint: String },
    #[error("the seed of episode {episode} of `{task}` is no seed: `{seed}`")]
    Seed { task: String, episode: u64, seed: String },
    #[error(
        "episode {episode} of `{task}` does not play as recorded: after {step} steps `{joint}` is {found}, expected {expected}"
    )]
    Departed { task: String, episode: u64, step: usize, joint: String, found: f64, expected: f64 },
}

/// How an episode was brought back.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Means {
    /// Played again from its seed.
    Played,
    /// Posed by its joints; objects do not move.
    Posed,
}

/// The stage of `episode` and its frames.
pub fn replay(
    bodies: &Bodies,
    recording: &Recording,
    episode: &Episode,
) -> Result<(Stage, Vec<Frame>, Means), ReplayError> {
    let task = &recording.about.task;
    let unknown = || ReplayError::UnknownTask { task: task.clone() };
    let definition = tasks::every().find(|known| known.name == task).ok_or_else(unknown)?;
    let environment = Environment::new(definition, bodies, RewardConfiguration::Sparse)?;
    let replay = Replay { recording, episode, joints: joints(recording, &environment)? };
    match &episode.facts.seeds {
        Some(seeds) => replay.play(environment, &seeds.start),
        None => replay.pose(&environment),
    }
}

struct Replay<'a> {
    recording: &'a Recording,
    episode: &'a Episode,
    /// Places of the recorded joints among the body's positions.
    joints: Vec<usize>,
}

impl Replay<'_> {
    fn task(&self) -> String {
        self.recording.about.task.clone()
    }

    /// A channel with `expected` elements.
    fn channel(&self, channel: &'static str, expected: usize) -> Result<&Samples, ReplayError> {
        let samples = self.recording.samples(self.episode, channel);
        let samples =
            samples.ok_or_else(|| ReplayError::NoChannel { task: self.task(), channel })?;
        let found = self.recording.channel(channel).map_or(0, crate::record::Channel::width);
        if found != expected {
            return Err(ReplayError::Width { task: self.task(), channel, found, expected });
        }
        Ok(samples)
    }

    fn solved(&self, step: usize) -> bool {
        let samples = self.recording.samples(self.episode, names::SOLVED);
        step > 0 && samples.is_some_and(|samples| samples.value(step - 1) > 0.5)
    }

    fn play(
        self,
        mut environment: Environment,
        seed: &str,
    ) -> Result<(Stage, Vec<Frame>, Means), ReplayError> {
        let muscles = environment.simulation().excitation().len();
        let excitations = self.channel(names::EXCITATION, muscles)?;
        let bytes = blake3::Hash::from_hex(seed).map_err(|_| ReplayError::Seed {
            task: self.task(),
            episode: self.episode.facts.number,
            seed: seed.to_owned(),
        })?;
        environment.reset(&mut Random::new(*bytes.as_bytes()));
        let mut puppet = Puppet::new(environment.simulation())?;
        let mut snapshot = Snapshot::of(environment.simulation());
        puppet.pose(&snapshot);
        let aim = Aim::of(&environment);
        let (mut staging, stage) = Staging::new(puppet, &aim);
        let mut frames = vec![staging.frame(0, false, &aim.targets)];
        let mut excitation = vec![0.0; muscles];
        for step in 0..self.episode.facts.length {
            self.check(environment.simulation(), step)?;
            for (muscle, into) in excitation.iter_mut().enumerate() {
                *into = excitations.value(step * muscles + muscle);
            }
            environment.step_with(&excitation);
            snapshot.take(environment.simulation());
            staging.puppet_mut().pose(&snapshot);
            let targets = environment.task().targets();
            frames.push(staging.frame(step + 1, self.solved(step + 1), &targets));
        }
        Ok((stage, frames, Means::Played))
    }

    /// Compares the body with the joints recorded before `step`.
    fn check(&self, body: &Simulation, step: usize) -> Result<(), ReplayError> {
        let width = self.joints.len();
        let recorded = self.channel(names::JOINT, width)?;
        for (joint, &place) in self.joints.iter().enumerate() {
            let (found, expected) = (body.qpos()[place], recorded.value(step * width + joint));
            if (found - expected).abs() > TOLERANCE {
                let channel = self.recording.channel(names::JOINT);
                return Err(ReplayError::Departed {
                    task: self.task(),
                    episode: self.episode.facts.number,
                    step,
                    joint: channel.map_or_else(String::new, |c| c.elements[joint].name.clone()),
                    found,
                    expected,
                });
            }
        }
        Ok(())
    }

    /// Poses a puppet by the recorded joints and, where they are there, activations.
    fn pose(self, environment: &Environment) -> Result<(Stage, Vec<Frame>, Means), ReplayError> {
        let body = environment.simulation();
        let (muscles, width) = (body.excitation().len(), self.joints.len());
        let joints = self.channel(names::JOINT, width)?;
        let activations = self.channel(names::ACTIVATION, muscles).ok();
        let mut puppet = Puppet::new(body)?;
        puppet.pose(&Snapshot::of(body));
        // What was to be reached is not recorded.
        let (mut staging, stage) = Staging::new(puppet, &Aim::default());
        let mut frames = Vec::with_capacity(self.episode.facts.length);
        for step in 0..self.episode.facts.length {
            let puppet = staging.puppet_mut();
            puppet.bend(|qpos, activation| {
                for (joint, &place) in self.joints.iter().enumerate() {
                    qpos[place] = joints.value(step * width + joint);
                }
                for (muscle, into) in activation.iter_mut().enumerate() {
                    *into = activations.map_or(0.0, |a| a.value(step * muscles + muscle));
                }
            });
            frames.push(staging.frame(step, self.solved(step), &[]));
        }
        Ok((stage, frames, Means::Posed))
    }
}

/// Where the recorded joints stand among the body's positions.
fn joints(recording: &Recording, environment: &Environment) -> Result<Vec<usize>, ReplayError> {
    let task = || recording.about.task.clone();
    let body = environment.simulation();
    let channel = recording
        .channel(names::JOINT)
        .ok_or_else(|| ReplayError::NoChannel { task: task(), channel: names::JOINT })?;
    let place = |name: &String| {
        body.find(Names::Joint, name)
            .map(|joint| body.joint_qpos_address(joint))
            .map_err(|_| ReplayError::UnknownJoint { task: task(), joint: name.clone() })
    };
    channel.elements.iter().map(|element| place(&element.name)).collect()
}

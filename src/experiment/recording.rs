//! From played episodes to a recording: names, units and timing for the channels of `spec/analysis.md` §0.3. Nothing is
//! copied.

use std::collections::BTreeMap;

use crate::record::{
    About, Channel, Element, Episode, EpisodeFacts, Precision, Recording, Samples, Seeds, Timing,
    names,
};
use crate::sim::rollout::{ActionMode, ChannelNames, Episode as Played};
use crate::sim::tasks::Definition;

/// What was played, and with what.
#[derive(Debug, Clone)]
pub struct Source<'a> {
    pub task: &'a Definition,
    pub policy: &'a str,
    pub mode: ActionMode,
    pub seed: u64,
    /// Provenance.
    pub metadata: BTreeMap<String, String>,
}

/// The recording of `episodes`, which were played with all channels kept.
#[must_use]
pub fn recording(source: Source<'_>, columns: &ChannelNames, episodes: Vec<Played>) -> Recording {
    let Source { task, policy, mode, seed, metadata } = source;
    Recording {
        about: About {
            task: task.name.to_owned(),
            policy: policy.to_owned(),
            body: Some(task.body.to_owned()),
            control_interval: Some(task.control_interval()),
            horizon: Some(task.horizon),
            seed: i64::try_from(seed).ok(),
            deterministic: Some(mode == ActionMode::Deterministic),
            metadata,
        },
        channels: channels(columns),
        episodes: episodes.into_iter().map(|played| episode(played, columns.walking)).collect(),
    }
}

/// The channels, in the order of [`episode`]'s arrays.
fn channels(columns: &ChannelNames) -> Vec<Channel> {
    use Precision::{Double, Flag, Single};
    let (before, after) = (Some(Timing::BeforeStep), Some(Timing::AfterStep));
    let per_muscle = |name, precision, timing| {
        Channel::new(name, "", columns.muscles.iter().cloned(), precision, timing)
    };
    let per_joint = |name: &str, [slides, turns]: [&str; 2]| Channel {
        name: name.to_owned(),
        timing: before,
        precision: Double,
        elements: columns
            .joints
            .iter()
            .map(|joint| Element {
                name: joint.name.clone(),
                unit: if joint.slides { slides } else { turns }.to_owned(),
            })
            .collect(),
    };
    let components = columns.reward_components.iter().cloned();
    let mut channels = vec![
        Channel::scalar(names::SOLVED, Flag, after),
        Channel::scalar(names::REWARD, Double, after),
        per_muscle(names::ACTION_MEAN, Single, before),
        per_muscle(names::ACTION, Single, before),
        per_muscle(names::EXCITATION, Double, after),
        per_muscle(names::ACTIVATION, Double, if columns.walking { before } else { after }),
        per_joint(names::JOINT, ["m", "rad"]),
        per_joint(names::JOINT_VELOCITY, ["m/s", "rad/s"]),
        Channel::new(names::REWARD_COMPONENT, "", components, Double, after),
    ];
    if columns.walking {
        channels.extend([
            Channel::new(names::FOOT_CONTACT, "N", names::FEET, Double, before),
            Channel::new(names::ROOT_VELOCITY, "m/s", names::HEADING_AXES, Double, before),
            Channel::new(names::ROOT_YAW, "rad", [""], Double, before),
        ]);
    }
    channels
}

fn episode(played: Played, walking: bool) -> Episode {
    let kept = played.recording;
    let mut samples = vec![
        Samples::Flag(kept.solved),
        Samples::Double(kept.reward),
        Samples::Single(kept.action_mean),
        Samples::Single(kept.action),
        Samples::Double(kept.excitation),
        Samples::Double(kept.activation),
        Samples::Double(kept.joints),
        Samples::Double(kept.joint_velocities),
        Samples::Double(kept.reward_components),
    ];
    if walking {
        let feet_and_root = [kept.foot_contacts, kept.root_velocity, kept.root_yaw];
        samples.extend(feet_and_root.map(Samples::Double));
    }
    let hexadecimal = |seed: [u8; 32]| blake3::Hash::from_bytes(seed).to_hex().to_string();
    Episode {
        facts: EpisodeFacts {
            number: played.spec.episode as u64,
            length: played.steps,
            seeds: Some(Seeds {
                start: hexadecimal(played.spec.reset_seed),
                actions: hexadecimal(played.spec.action_seed),
            }),
            terminated: Some(played.terminated),
            diverged_steps: Some(played.diverged_steps),
        },
        samples,
    }
}

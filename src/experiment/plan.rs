//! The plan of a sweep: the exact list of its episodes, before any is played.
//!
//! Episodes that differ in nothing but their number are one [`Arm`]: a task, a policy, a condition. A million episodes are
//! then some thousand lines, and the list itself is computed: episode *n* of an arm has the seeds of [`seed::episode`] and
//! a **content key**, a hash of everything that decides what happens in it. A result is filed under that key, so it is
//! the same result in whatever plan it is met.
//!
//! Arms stand in the order of their stages. What an arm of a later stage is played with is computed from the episodes of
//! the stages before it.
//!
//! A sweep may be cut into shards. Pieces of ten episodes go round, so that every shard gets its share of every arm, of
//! long tasks and of short ones.
//!
//! A plan that comes from a file is hostile until [`Plan::check`] has seen it.

use std::ops::Range;
use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};
use serde_json::Value;

use crate::files::{self, FileError};
use crate::sim::rollout::{Channels, EpisodeSpec};

use super::seed;

/// Name of the plan in the folder of its sweep.
pub const PLAN: &str = "plan.json";
/// A plan of ten thousand arms has a few megabytes.
const LARGEST_PLAN: u64 = 64 << 20;
/// More than anybody plays; the ledger of so many would have a dozen gigabytes.
const MOST_EPISODES: usize = 100_000_000;
/// Episodes that are dealt out together.
const PIECE: usize = 10;
/// Context string of the content keys; a new one makes all results strangers.
const CONTEXT: &str = "arnold-analyze episode content, first version";

/// Why a plan cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum PlanError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error("{what}, in the plan `{path}`")]
    Unreadable { what: String, path: PathBuf },
    #[error("a plan of {found} episodes is larger than the limit of {limit}")]
    TooManyEpisodes { found: usize, limit: usize },
}

/// Episodes that differ in nothing but their number.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Arm {
    /// Stages are played one after the other, from 0 on.
    pub stage: usize,
    pub task: String,
    /// Place in [`Plan::policies`].
    pub policy: usize,
    /// What decides the episodes beside task, policy and [`Plan::shared`].
    pub condition: Value,
    /// Number of the first episode.
    pub first: usize,
    pub episodes: usize,
    /// What is kept of every step.
    pub channels: Channels,
}

/// What was typed, and where.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Typed {
    /// The command and its options.
    pub words: Vec<String>,
    /// The folder that relative paths start from.
    pub folder: PathBuf,
    /// The folder of published data.
    pub data: PathBuf,
}

/// A whole sweep.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Plan {
    /// Program and version; another one may give other results.
    pub program: String,
    /// Key of the run folder.
    pub key: String,
    pub typed: Typed,
    /// What all episodes have in common: physics, how actions are chosen, noise, seed.
    pub shared: Value,
    /// Seed of all random numbers.
    pub seed: u64,
    /// What decides about each policy: hashes of its files.
    pub policies: Vec<Value>,
    pub arms: Vec<Arm>,
}

/// One of several parts of a sweep.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// From 1 on.
    number: usize,
    count: usize,
}

impl Shard {
    /// The whole sweep.
    pub const ALL: Self = Self { number: 1, count: 1 };

    /// Shard `number` (from 1 on) of `count`, if there is one.
    #[must_use]
    pub fn new(number: usize, count: usize) -> Option<Self> {
        (1..=count).contains(&number).then_some(Self { number, count })
    }

    /// Number of this shard, from 1 on.
    #[must_use]
    pub fn number(self) -> usize {
        self.number
    }

    /// Number of all shards.
    #[must_use]
    pub fn count(self) -> usize {
        self.count
    }
}

/// A planned episode.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Planned {
    /// Place of its arm.
    pub arm: usize,
    /// Number of the episode.
    pub number: usize,
    /// Which tenth of the arm, counted over all arms.
    piece: usize,
}

impl Planned {
    /// Whether it belongs to `shard`.
    #[must_use]
    pub fn is_in(self, shard: Shard) -> bool {
        self.shard_of(shard.count) == Some(shard.number - 1)
    }

    /// Place of its shard among `count`, if there are any.
    #[must_use]
    pub fn shard_of(self, count: usize) -> Option<usize> {
        self.piece.checked_rem(count)
    }
}

impl Plan {
    /// Reads the plan of the sweep in `folder`.
    pub fn read(folder: &Path) -> Result<Self, PlanError> {
        let path = folder.join(PLAN);
        let bytes = files::read_bounded(&path, LARGEST_PLAN)?;
        let unreadable = |what: String| PlanError::Unreadable { what, path: path.clone() };
        let plan: Self =
            serde_json::from_slice(&bytes).map_err(|error| unreadable(error.to_string()))?;
        plan.check().map_err(|error| unreadable(error.to_string()))?;
        Ok(plan)
    }

    /// Writes it.
    pub fn write(&self, folder: &Path) -> Result<(), PlanError> {
        let path = folder.join(PLAN);
        let mut text = serde_json::to_string_pretty(self).map_err(|error| {
            PlanError::Unreadable { what: error.to_string(), path: path.clone() }
        })?;
        text.push('\n');
        Ok(files::write_atomic(&path, text.as_bytes())?)
    }

    /// Whether it can be played: stages rise by one, policies exist, and nobody asks for the impossible.
    pub fn check(&self) -> Result<(), PlanError> {
        let wrong = |what: String| PlanError::Unreadable { what, path: PLAN.into() };
        let mut stage = 0;
        let mut episodes = 0_usize;
        for (place, arm) in self.arms.iter().enumerate() {
            if arm.stage != stage && !(place > 0 && arm.stage == stage + 1) {
                return Err(wrong(format!("arm {place} is of stage {} after {stage}", arm.stage)));
            }
            stage = arm.stage;
            if arm.policy >= self.policies.len() {
                let known = self.policies.len();
                return Err(wrong(format!("arm {place} is of policy {} of {known}", arm.policy)));
            }
            let end = arm.first.checked_add(arm.episodes);
            episodes = episodes.saturating_add(arm.episodes);
            if end.is_none() || episodes > MOST_EPISODES {
                let (found, limit) = (episodes, MOST_EPISODES);
                return Err(PlanError::TooManyEpisodes { found, limit });
            }
        }
        Ok(())
    }

    /// Number of all episodes.
    #[must_use]
    pub fn episode_count(&self) -> usize {
        self.arms.iter().map(|arm| arm.episodes).sum()
    }

    /// Number of stages.
    #[must_use]
    pub fn stage_count(&self) -> usize {
        self.arms.last().map_or(0, |arm| arm.stage + 1)
    }

    /// The places in [`Self::episodes`] of the episodes of each arm.
    #[must_use]
    pub fn places(&self) -> Vec<Range<usize>> {
        let mut next = 0;
        let range = |arm: &Arm| {
            let start = next;
            next += arm.episodes;
            start..next
        };
        self.arms.iter().map(range).collect()
    }

    /// All episodes, in the order of the arms.
    pub fn episodes(&self) -> impl Iterator<Item = Planned> + '_ {
        let mut pieces = 0;
        self.arms.iter().enumerate().flat_map(move |(arm, planned)| {
            let first_piece = pieces;
            pieces += planned.episodes.div_ceil(PIECE);
            let first = planned.first;
            (0..planned.episodes).map(move |offset| Planned {
                arm,
                number: first + offset,
                piece: first_piece + offset / PIECE,
            })
        })
    }

    /// What the content keys of each arm's episodes start from.
    #[must_use]
    pub fn arm_keys(&self) -> Vec<ArmKey> {
        let key = |arm: &Arm| {
            let content = serde_json::json!({
                "program": self.program,
                "shared": self.shared,
                "policy": self.policies[arm.policy],
                "task": arm.task,
                "condition": arm.condition,
                "channels": arm.channels,
            });
            ArmKey(blake3::derive_key(CONTEXT, content.to_string().as_bytes()))
        };
        self.arms.iter().map(key).collect()
    }

    /// What episode `number` of an arm is played from, in the projection at `projection`.
    #[must_use]
    pub fn spec(&self, arm: &Arm, number: usize, projection: Option<usize>) -> EpisodeSpec {
        seed::episode(self.seed, &arm.task, number, projection)
    }
}

/// Everything that decides the episodes of an arm, but for their number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ArmKey([u8; 32]);

impl ArmKey {
    /// The content key of one episode.
    #[must_use]
    pub fn episode(&self, number: usize) -> u128 {
        let hash = blake3::keyed_hash(&self.0, &(number as u64).to_le_bytes());
        let mut key = [0; 16];
        key.copy_from_slice(&hash.as_bytes()[..16]);
        u128::from_be_bytes(key)
    }
}

#[cfg(test)]
pub(super) mod tests {
    use std::collections::BTreeSet;

    use serde_json::json;

    use super::*;

    /// A plan of two stages: `first` episodes, then `arms` arms of `episodes` each.
    pub(crate) fn plan(first: usize, arms: usize, episodes: usize) -> Plan {
        let arm = |stage: usize, condition: Value, episodes: usize| Arm {
            stage,
            task: "elbow_pose".to_owned(),
            policy: 0,
            condition,
            first: 0,
            episodes,
            channels: Channels::Counts,
        };
        let later = (1..=arms).map(|k| arm(1, json!({ "components": k }), episodes));
        Plan {
            program: "arnold-analyze".to_owned(),
            key: "abc".to_owned(),
            typed: Typed { words: Vec::new(), folder: "/".into(), data: "data".into() },
            shared: json!({"physics": "2.3.7"}),
            seed: 0,
            policies: vec![json!({"checkpoint_blake3": "1"})],
            arms: std::iter::once(arm(0, Value::Null, first)).chain(later).collect(),
        }
    }

    #[test]
    fn shards_divide_the_episodes_and_each_has_its_share_of_every_arm() {
        let plan = plan(40, 3, 100);
        for count in [1, 3, 7] {
            let mut seen = vec![0; plan.episode_count()];
            for number in 1..=count {
                let shard = Shard::new(number, count).unwrap();
                let mut arms = BTreeSet::new();
                for (place, planned) in plan.episodes().enumerate() {
                    if planned.is_in(shard) {
                        seen[place] += 1;
                        arms.insert(planned.arm);
                    }
                }
                assert!(arms.is_superset(&[1, 2, 3].into()), "shard {number} of {count}: {arms:?}");
            }
            assert!(seen.iter().all(|&times| times == 1), "{count} shards");
        }
        assert!(Shard::new(0, 3).is_none() && Shard::new(4, 3).is_none());
    }

    #[test]
    fn a_content_key_tells_what_decides_and_nothing_else() {
        let one = plan(4, 2, 4);
        let keys = |plan: &Plan| -> BTreeSet<u128> {
            let arms = plan.arm_keys();
            plan.episodes().map(|planned| arms[planned.arm].episode(planned.number)).collect()
        };
        assert_eq!(keys(&one).len(), one.episode_count());
        // More episodes and more arms: those that were there before keep their keys.
        assert!(keys(&plan(8, 3, 9)).is_superset(&keys(&one)));
        let mut other = one.clone();
        other.policies = vec![json!({"checkpoint_blake3": "2"})];
        assert!(keys(&other).is_disjoint(&keys(&one)));
    }

    #[test]
    fn a_plan_survives_its_file_and_a_wrong_one_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let plan = plan(4, 2, 4);
        plan.write(folder.path()).unwrap();
        assert_eq!(Plan::read(folder.path()).unwrap(), plan);
        let wrong: [&dyn Fn(&mut Plan); 4] = [
            &|plan| plan.arms[1].stage = 2,
            &|plan| plan.arms[2].stage = 0,
            &|plan| plan.arms[1].policy = 1,
            &|plan| plan.arms[1].episodes = usize::MAX,
        ];
        for spoil in wrong {
            let mut plan = plan.clone();
            spoil(&mut plan);
            plan.write(folder.path()).unwrap();
            assert!(Plan::read(folder.path()).is_err());
        }
    }
}

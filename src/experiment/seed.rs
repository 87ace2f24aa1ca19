//! Where randomness comes from: a plan's seed, a task, an episode number and a purpose give a stream of their own.
//!
//! Nothing else enters, so episode *i* of a task starts from the same state and sees the same noise for every policy and
//! every number of components (common random numbers), on any thread, in any order.

use crate::sim::rollout::EpisodeSpec;

/// Context string of the key derivation; a new one would be a new set of random numbers.
const CONTEXT: &str = "arnold-analyze episode seeds, first version";

/// The specification of episode `episode` of `task`.
#[must_use]
pub fn episode(
    plan_seed: u64,
    task: &str,
    episode: usize,
    projection: Option<usize>,
) -> EpisodeSpec {
    let stream = |purpose: &str| {
        let mut hasher = blake3::Hasher::new_derive_key(CONTEXT);
        hasher.update(&plan_seed.to_le_bytes());
        hasher.update(&(episode as u64).to_le_bytes());
        for text in [task, purpose] {
            hasher.update(&(text.len() as u64).to_le_bytes());
            hasher.update(text.as_bytes());
        }
        *hasher.finalize().as_bytes()
    };
    EpisodeSpec { episode, reset_seed: stream("reset"), action_seed: stream("action"), projection }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_part_of_the_address_gives_another_stream_and_the_projection_does_not() {
        let base = episode(0, "elbow_pose", 3, None);
        assert_ne!(base.reset_seed, base.action_seed);
        for other in [
            episode(1, "elbow_pose", 3, None),
            episode(0, "elbow_pos", 3, None),
            episode(0, "elbow_pose", 4, None),
        ] {
            assert_ne!(base.reset_seed, other.reset_seed);
            assert_ne!(base.action_seed, other.action_seed);
        }
        let projected = episode(0, "elbow_pose", 3, Some(1));
        assert_eq!(
            (base.reset_seed, base.action_seed),
            (projected.reset_seed, projected.action_seed)
        );
    }
}

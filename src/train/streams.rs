//! Where the random numbers of a training run come from: the run's seed, a purpose and a few numbers give a stream of their
//! own (BLAKE3 as a key derivation, then `ChaCha8`).
//!
//! So nothing depends on threads, and a run that goes on after a kill needs no generator's state: episode *i* of
//! environment *e* starts from the stream `(episode, e, i)` in whatever life of the program it is played.

use crate::random::Random;

/// Context string of the key derivation; a new one would be a new set of random numbers.
const CONTEXT: &str = "arnold-analyze training streams, first version";

/// What a stream is for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Purpose {
    /// The parameters at the start.
    Initialisation,
    /// Goal and initial state of an episode: environment, episode.
    Episode,
    /// Exploration: environment, iteration.
    Exploration,
    /// The order of samples, and the actions that are compared with the expert's: iteration.
    Update,
    /// Goal and initial state of an episode of evaluation: task, episode.
    Evaluation,
    /// Sampled actions in evaluation: task, episode.
    EvaluationActions,
    /// How long the teacher leads an episode: environment, episode.
    Lead,
}

/// All streams of one run.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Streams {
    pub seed: u64,
}

impl Streams {
    /// The seed of one stream.
    #[must_use]
    pub fn seed_of(&self, purpose: Purpose, numbers: [usize; 2]) -> [u8; 32] {
        let mut hasher = blake3::Hasher::new_derive_key(CONTEXT);
        hasher.update(&self.seed.to_le_bytes());
        hasher.update(&[purpose as u8]);
        for number in numbers {
            hasher.update(&(number as u64).to_le_bytes());
        }
        *hasher.finalize().as_bytes()
    }

    /// One stream.
    #[must_use]
    pub fn of(&self, purpose: Purpose, numbers: [usize; 2]) -> Random {
        Random::new(self.seed_of(purpose, numbers))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seed_purpose_and_numbers_each_make_another_stream() {
        let base = Streams { seed: 1 }.seed_of(Purpose::Episode, [2, 3]);
        assert_eq!(base, Streams { seed: 1 }.seed_of(Purpose::Episode, [2, 3]));
        for other in [
            Streams { seed: 2 }.seed_of(Purpose::Episode, [2, 3]),
            Streams { seed: 1 }.seed_of(Purpose::Exploration, [2, 3]),
            Streams { seed: 1 }.seed_of(Purpose::Episode, [3, 2]),
            Streams { seed: 1 }.seed_of(Purpose::Episode, [2, 4]),
        ] {
            assert_ne!(base, other);
        }
    }
}

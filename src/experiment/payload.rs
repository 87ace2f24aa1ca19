//! What a ledger keeps of an episode's steps: the channels of a [`Recording`], as bytes.
//!
//! Twelve lengths (`u32`, little-endian, in values), then the values of the channels one after the other, little-endian,
//! with the bits they had; a flag is one byte. Bytes that do not fit this to the last are no recording.

use crate::sim::rollout::Recording;

/// Number of channels.
const CHANNELS: usize = 12;
/// Bytes of the lengths.
const HEADER: usize = 4 * CHANNELS;

/// The bytes of `recording`.
#[must_use]
pub fn encode(recording: &Recording) -> Vec<u8> {
    let singles = [&recording.action_mean, &recording.action];
    let doubles = doubles(recording);
    let lengths = singles.iter().map(|values| values.len());
    let lengths = lengths.chain([recording.solved.len()]).chain(doubles.iter().map(|d| d.len()));
    let mut bytes = Vec::new();
    lengths.for_each(|length| bytes.extend((length as u32).to_le_bytes()));
    singles.iter().for_each(|values| values.iter().for_each(|x| bytes.extend(x.to_le_bytes())));
    bytes.extend(recording.solved.iter().map(|&solved| u8::from(solved)));
    doubles.iter().for_each(|values| values.iter().for_each(|x| bytes.extend(x.to_le_bytes())));
    bytes
}

fn doubles(recording: &Recording) -> [&Vec<f64>; CHANNELS - 3] {
    [
        &recording.excitation,
        &recording.activation,
        &recording.joints,
        &recording.joint_velocities,
        &recording.reward,
        &recording.reward_components,
        &recording.foot_contacts,
        &recording.root_velocity,
        &recording.root_yaw,
    ]
}

/// The recording in `bytes`.
#[must_use]
pub fn decode(bytes: &[u8]) -> Option<Recording> {
    let (header, mut rest) = bytes.split_at_checked(HEADER)?;
    let mut lengths =
        header.as_chunks::<4>().0.iter().map(|&four| u32::from_le_bytes(four) as usize);
    let mut take = |width: usize| {
        let (taken, left) = rest.split_at_checked(lengths.next()?.checked_mul(width)?)?;
        rest = left;
        Some(taken)
    };
    let mut singles = || -> Option<Vec<f32>> {
        Some(take(4)?.as_chunks().0.iter().map(|&x| f32::from_le_bytes(x)).collect())
    };
    let (action_mean, action) = (singles()?, singles()?);
    let solved = take(1)?.iter().map(|&byte| byte != 0).collect();
    let mut doubles = || -> Option<Vec<f64>> {
        Some(take(8)?.as_chunks().0.iter().map(|&x| f64::from_le_bytes(x)).collect())
    };
    let recording = Recording {
        action_mean,
        action,
        solved,
        excitation: doubles()?,
        activation: doubles()?,
        joints: doubles()?,
        joint_velocities: doubles()?,
        reward: doubles()?,
        reward_components: doubles()?,
        foot_contacts: doubles()?,
        root_velocity: doubles()?,
        root_yaw: doubles()?,
    };
    rest.is_empty().then_some(recording)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn recording() -> Recording {
        Recording {
            action_mean: vec![0.1, -0.0],
            solved: vec![true, false],
            excitation: vec![f64::MIN_POSITIVE],
            root_yaw: vec![1.0, -1.0, 1e300],
            ..Recording::default()
        }
    }

    #[test]
    fn a_recording_comes_back_bit_for_bit() {
        for recording in [Recording::default(), recording()] {
            let back = decode(&encode(&recording)).unwrap();
            assert_eq!(back, recording);
            assert_eq!(encode(&back), encode(&recording));
        }
    }

    #[test]
    fn bytes_that_do_not_fit_are_no_recording() {
        let bytes = encode(&recording());
        for cut in 0..bytes.len() {
            assert!(decode(&bytes[..cut]).is_none(), "{cut}");
        }
        assert!(decode(&[&bytes[..], &[0]].concat()).is_none());
        assert!(decode(&[0xFF; HEADER + 8]).is_none());
    }
}

//! The public recording of the KINESIS policy: 33 s of walking as three arrays.
//!
//! | file | content |
//! | --- | --- |
//! | `gait.npy` | one code per step at 30 Hz: −1 no foot on the ground, 0 left, 1 right, 2 both |
//! | `muscle_controls.npy` | steps × 80, in 0..1 |
//! | `muscle_names.npy` | 80 texts; beside the others or in `../misc/` |
//!
//! The first row of both holds no numbers and is left out. Contact is not a force here: a foot on the ground counts as
//! twice the threshold of a heel strike. There is no velocity, and the controls stand for any muscle signal.
//!
//! Part of the Hugging Face data set `amathislab/kinesis-assets`, folder `emg_assets`. Oracle: `tests/walking.rs`.

use std::path::{Path, PathBuf};

use super::walking::{Walk, WalkEpisode, WalkError};
use crate::files;
use crate::npz::{Member, parse_member, parse_npy};
use crate::units::Hertz;

const GAIT: &str = "gait.npy";
const CONTROLS: &str = "muscle_controls.npy";
const NAMES: &str = "muscle_names.npy";
const SAMPLE_RATE: Hertz = 30.0;
/// What a foot on the ground is set to, twice the threshold.
const CONTACT: f64 = 600.0;
/// The published controls have 641 kB.
const LARGEST_FILE: u64 = 64 << 20;

/// Reads the recording in `folder`.
pub(super) fn read(folder: &Path, policy: &str) -> Result<(Walk, String), WalkError> {
    let mut hasher = blake3::Hasher::new();
    let mut bytes_of = |path: &Path| -> Result<Vec<u8>, WalkError> {
        let bytes = files::read_bounded(path, LARGEST_FILE)?;
        hasher.update(&(bytes.len() as u64).to_le_bytes());
        hasher.update(&bytes);
        Ok(bytes)
    };
    let wrong = |what: String, path: &Path| WalkError::Kinesis { what, path: path.to_path_buf() };
    let [gait, controls] = [GAIT, CONTROLS].map(|name| folder.join(name));
    if !gait.is_file() {
        return Err(wrong(format!("a folder is read for its `{GAIT}`, which is missing"), folder));
    }
    let beside = folder.join(NAMES);
    let names: PathBuf = if beside.is_file() { beside } else { folder.join("../misc").join(NAMES) };
    let codes = parse_npy(GAIT, &bytes_of(&gait)?)?.to_f64();
    let array = parse_npy(CONTROLS, &bytes_of(&controls)?)?;
    let muscles = match parse_member(NAMES, &bytes_of(&names)?)? {
        Member::Texts(texts) => texts.values,
        Member::Numbers(_) => return Err(wrong("expected texts, found numbers".into(), &names)),
    };
    if array.shape != [codes.len(), muscles.len()] || codes.is_empty() {
        let (steps, count) = (codes.len(), muscles.len());
        let found = &array.shape;
        let what = format!("expected {steps} steps × {count} muscles, found the shape {found:?}");
        return Err(wrong(what, &controls));
    }
    let mut contacts = Vec::with_capacity(4 * codes.len());
    for (step, &code) in codes.iter().enumerate().skip(1) {
        let [right, left] = match code {
            -1.0 => [0.0, 0.0],
            0.0 => [0.0, CONTACT],
            1.0 => [CONTACT, 0.0],
            2.0 => [CONTACT, CONTACT],
            _ => return Err(wrong(format!("step {step} has the unknown code {code}"), &gait)),
        };
        contacts.extend([right, 0.0, left, 0.0]);
    }
    let controls = array.to_f64()[muscles.len()..].to_vec();
    let episode = WalkEpisode { number: 0, contacts, velocity: None, muscles: controls };
    let walk = Walk {
        policy: policy.to_owned(),
        muscles,
        sample_rate: SAMPLE_RATE,
        episodes: vec![episode],
    };
    Ok((walk, hasher.finalize().to_hex().to_string()))
}

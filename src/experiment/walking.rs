//! A recorded walk: what gait cycles and muscle profiles are made of.
//!
//! Taken from a recording that has foot contacts, root velocity and a muscle signal. A walk without velocity (the public
//! KINESIS recording) cannot be too slow: its cycles are judged by their duration alone, and have no mean speed.

use std::path::Path;

use crate::analysis::emg::{
    self, CycleProfile, CycleRow, EmgError, GaitEpisode, GaitOptions, Segmentation, Side,
    columns_named, cycle_profile,
};
use crate::analysis::signal::{LowPass, LowPassOptions, Rows, SignalError};
use crate::files::{self, FileError};
use crate::npz::ArrayError;
use crate::record::{RecordError, Recording, names, read_recording};
use crate::units::Hertz;

use super::kinesis_walk;

/// Right foot, right toes, left foot, left toes.
const CONTACTS: usize = names::FEET.len();

/// Why a recording cannot be cut into gait cycles.
#[derive(Debug, thiserror::Error)]
pub enum WalkError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Record(#[from] RecordError),
    #[error(transparent)]
    Array(#[from] ArrayError),
    #[error("{fault}, in the walk of `{policy}`")]
    Emg { fault: EmgError, policy: String },
    #[error("episode {episode}, `{channel}`: {fault}, in the walk of `{policy}`")]
    Samples { episode: u64, channel: String, fault: SignalError, policy: String },
    #[error("the recording of `{policy}` has no channel `{channel}`; it has {found}")]
    NoChannel { channel: String, found: String, policy: String },
    #[error("the recording of `{policy}` does not say how long a step is")]
    NoRate { policy: String },
    #[error("{what}, in `{path}`")]
    Kinesis { what: String, path: std::path::PathBuf },
}

/// How a walk becomes profiles.
#[derive(Debug, Clone, PartialEq)]
pub struct WalkOptions {
    /// Channel of the muscle signal.
    pub signal: &'static str,
    pub gait: GaitOptions,
    /// Points of the averaged cycle.
    pub points: usize,
    /// Filter of the muscle signal; the paper has none.
    pub muscle_low_pass: Option<LowPassOptions>,
}

impl Default for WalkOptions {
    fn default() -> Self {
        Self {
            signal: names::ACTIVATION,
            gait: GaitOptions::default(),
            points: 200,
            muscle_low_pass: None,
        }
    }
}

/// One episode, row by row.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct WalkEpisode {
    pub(super) number: u64,
    pub(super) contacts: Vec<f64>,
    /// Velocity of the root in its heading frame, if it was recorded.
    pub(super) velocity: Option<(Vec<f64>, usize)>,
    pub(super) muscles: Vec<f64>,
}

/// The walk of one policy.
#[derive(Debug, Clone, PartialEq)]
pub struct Walk {
    pub policy: String,
    pub(super) muscles: Vec<String>,
    pub(super) sample_rate: Hertz,
    pub(super) episodes: Vec<WalkEpisode>,
}

/// Reads the walk in `path`: a recording in any format, or the folder of the public KINESIS recording. Also the BLAKE3
/// of what was read.
pub fn read_walk(
    path: &Path,
    policy: &str,
    options: &WalkOptions,
) -> Result<(Walk, String), WalkError> {
    if path.is_dir() {
        return kinesis_walk::read(path, policy);
    }
    let mut hasher = blake3::Hasher::new();
    files::for_each_piece(path, |piece| {
        hasher.update(piece);
    })?;
    let recording = read_recording(path)?.recording;
    Ok((Walk::of(&recording, policy, options)?, hasher.finalize().to_hex().to_string()))
}

impl Walk {
    /// The walk in `recording`.
    pub fn of(
        recording: &Recording,
        policy: &str,
        options: &WalkOptions,
    ) -> Result<Self, WalkError> {
        let place = |name: &str| {
            recording.place(name).ok_or_else(|| WalkError::NoChannel {
                channel: name.to_owned(),
                found: recording
                    .channels
                    .iter()
                    .map(|channel| channel.name.as_str())
                    .collect::<Vec<_>>()
                    .join(", "),
                policy: policy.to_owned(),
            })
        };
        let (muscles, contacts) = (place(options.signal)?, place(names::FOOT_CONTACT)?);
        let velocity = place(names::ROOT_VELOCITY)?;
        let interval = recording.about.control_interval.filter(|&seconds| seconds > 0.0);
        let interval = interval.ok_or_else(|| WalkError::NoRate { policy: policy.to_owned() })?;
        let width = recording.channels[velocity].width();
        let episodes = recording.episodes.iter().map(|episode| WalkEpisode {
            number: episode.facts.number,
            contacts: episode.samples[contacts].values().collect(),
            velocity: Some((episode.samples[velocity].values().collect(), width)),
            muscles: episode.samples[muscles].values().collect(),
        });
        Ok(Self {
            policy: policy.to_owned(),
            muscles: recording.channels[muscles].elements.iter().map(|e| e.name.clone()).collect(),
            // The interval is a decimal or 1/rate; the rate is whole in all known recordings.
            sample_rate: nearest_whole(1.0 / interval),
            episodes: episodes.collect(),
        })
    }

    /// Number of episodes.
    #[must_use]
    pub fn episode_count(&self) -> usize {
        self.episodes.len()
    }

    /// Whether there are several episodes and all are alike: then they are one.
    #[must_use]
    pub fn repeats_itself(&self) -> bool {
        let alike = |pair: &[WalkEpisode]| {
            pair[0].muscles == pair[1].muscles && pair[0].contacts == pair[1].contacts
        };
        self.episodes.len() > 1 && self.episodes.windows(2).all(alike)
    }

    /// The cycles that begin with a strike of the `leading` foot.
    pub fn segment(&self, leading: Side, gait: &GaitOptions) -> Result<Segmentation, WalkError> {
        // Without velocity nothing is slow.
        let pace: Vec<Vec<f64>> = self
            .episodes
            .iter()
            .map(|e| vec![gait.least_speed; e.contacts.len() / CONTACTS])
            .collect();
        let mut episodes = Vec::with_capacity(self.episodes.len());
        for (episode, pace) in self.episodes.iter().zip(&pace) {
            let velocity = match &episode.velocity {
                Some((values, columns)) => {
                    self.rows(episode, names::ROOT_VELOCITY, values, *columns)?
                }
                None => self.rows(episode, names::ROOT_VELOCITY, pace, 1)?,
            };
            episodes.push(GaitEpisode {
                contacts: self.rows(episode, names::FOOT_CONTACT, &episode.contacts, CONTACTS)?,
                root_velocity: velocity,
                sample_rate: self.sample_rate,
            });
        }
        let mut gait = *gait;
        if self.episodes.iter().all(|episode| episode.velocity.is_none()) {
            // Filtering a constant may move its last bit.
            gait.least_speed = f64::MIN;
        }
        emg::segment(&episodes, leading, &gait).map_err(|fault| self.fault(fault))
    }

    /// Mean activity of `muscles` over the kept cycles.
    pub fn profile(
        &self,
        cycles: &Segmentation,
        muscles: &[String],
        options: &WalkOptions,
    ) -> Result<CycleProfile, WalkError> {
        let columns = columns_named(&self.muscles, muscles).map_err(|fault| self.fault(fault))?;
        let signals = self
            .episodes
            .iter()
            .map(|e| self.rows(e, options.signal, &e.muscles, self.muscles.len()))
            .collect::<Result<Vec<_>, _>>()?;
        let filter = options
            .muscle_low_pass
            .map(|filter| LowPass::design(&filter, self.sample_rate))
            .transpose()
            .map_err(|fault| self.fault(fault.into()))?;
        cycle_profile(cycles, &signals, &columns, options.points, filter.as_ref())
            .map_err(|fault| self.fault(fault))
    }

    /// A row per detected cycle, with the episodes' own numbers.
    #[must_use]
    pub fn cycle_rows(&self, cycles: &Segmentation) -> Vec<CycleRow> {
        let mut rows = emg::cycle_rows(&self.policy, cycles, self.sample_rate);
        for row in &mut rows {
            let episode = &self.episodes[row.episode];
            if episode.velocity.is_none() {
                row.mean_v = f64::NAN;
            }
            row.episode = usize::try_from(episode.number).unwrap_or(row.episode);
        }
        rows
    }

    fn rows<'a>(
        &self,
        episode: &WalkEpisode,
        channel: &str,
        values: &'a [f64],
        columns: usize,
    ) -> Result<Rows<'a>, WalkError> {
        Rows::new(values, columns).map_err(|fault| WalkError::Samples {
            episode: episode.number,
            channel: channel.to_owned(),
            fault,
            policy: self.policy.clone(),
        })
    }

    fn fault(&self, fault: EmgError) -> WalkError {
        WalkError::Emg { fault, policy: self.policy.clone() }
    }
}

/// The whole number that `rate` is meant to be, or `rate` itself.
fn nearest_whole(rate: Hertz) -> Hertz {
    let whole = rate.round();
    if (rate - whole).abs() < 1e-9 * whole { whole } else { rate }
}

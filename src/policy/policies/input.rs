//! What a perceptron sees of an observation: the clean vector, normalised one way or the other, or the padded matrix of the
//! multi-task policies.
//!
//! That matrix has one row per sensor of the largest task and one column per lag (`spec/policy.md` §2.5). A smaller task
//! fills its first rows; the others stay zero, whose mean is 0 and variance 1. It is read row by row. Policies trained here may
//! see one number more for every task they know: 1 for the one that is played, 0 for the others.

use crate::files::printable;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::{Normaliser, SignatureStatistics};
use crate::policy::history::History;
use crate::policy::interface::{ObservationVariant, TaskInterface};
use crate::policy::normaliser::{
    ComponentNormaliser, SignatureNormaliser, check_signature_statistics,
};

use super::{check_at_most, check_sizes};

/// Added to mjrl's input scale before the division.
const SCALE_EPSILON: f32 = 1e-8;

/// What happens to an observation before the first layer.
#[derive(Debug, Clone)]
pub(super) enum Input {
    Normalised(ComponentNormaliser),
    Shifted {
        shift: Vec<f32>,
        scale: Vec<f32>,
    },
    Windows {
        statistics: SignatureStatistics,
        sensors: usize,
        /// Tasks whose place is seen behind the windows.
        index: Vec<String>,
    },
}

impl Input {
    /// By the statistics of a normaliser, for a first layer of `width` inputs, of which the last say which task of `index` it
    /// is.
    pub(super) fn normalised(
        normaliser: &Normaliser,
        width: usize,
        index: &[String],
    ) -> Result<Self, PolicyError> {
        match normaliser {
            Normaliser::PerComponent(_) if !index.is_empty() => {
                let what = "a task index behind anything but padded windows".to_owned();
                Err(PolicyError::Unsupported { what })
            }
            Normaliser::PerComponent(statistics) => {
                Ok(Self::Normalised(ComponentNormaliser::new(statistics, width)?))
            }
            Normaliser::PerSignature(statistics) => {
                let lags = statistics.lags;
                check_signature_statistics(statistics, lags)?;
                if lags == 0 {
                    return Err(PolicyError::Missing { what: "the length of its history" });
                }
                let windows = width.checked_sub(index.len()).filter(|n| n.is_multiple_of(lags));
                let Some(windows) = windows else {
                    let expected = width;
                    return Err(PolicyError::NormaliserLength { expected, found: lags });
                };
                let (statistics, sensors, index) =
                    (statistics.clone(), windows / lags, index.to_vec());
                Ok(Self::Windows { statistics, sensors, index })
            }
        }
    }

    /// By mjrl's own shift and scale.
    pub(super) fn shifted(shift: &[f32], scale: &[f32]) -> Self {
        let scale = scale.iter().map(|scale| scale + SCALE_EPSILON).collect();
        Self::Shifted { shift: shift.to_vec(), scale }
    }

    pub(super) fn variant(&self) -> ObservationVariant {
        match self {
            Self::Normalised(_) | Self::Shifted { .. } => ObservationVariant::Clean,
            Self::Windows { .. } => ObservationVariant::Muscle,
        }
    }

    /// Prepares it for `task`; `width` and `muscles` are the network's.
    pub(super) fn bind(
        &self,
        task: &TaskInterface,
        slots: usize,
        width: usize,
        muscles: usize,
    ) -> Result<BoundInput, PolicyError> {
        let mut scaled = vec![0.0; width];
        let Self::Windows { statistics, sensors, index } = self else {
            check_sizes(task, width, muscles)?;
            return Ok(BoundInput { observation_length: width, scaled, windows: None });
        };
        let observation_length = task.muscle_observation_length;
        check_at_most(task, "described tokens", *sensors, task.observation_words.len())?;
        check_at_most(task, "muscles", muscles, task.muscle_count)?;
        if task.observation_words.len() != observation_length {
            let (what, task_name) = ("described tokens", task.task.clone());
            let (expected, found) = (task.observation_words.len(), observation_length);
            return Err(PolicyError::DoesNotFit { what, expected, found, task: task_name });
        }
        if !index.is_empty() {
            let Some(place) = index.iter().position(|name| *name == task.task) else {
                let (task, trained) = (task.task.clone(), printable(&index.join(", ")));
                return Err(PolicyError::NotInIndex { task, trained });
            };
            scaled[sensors * statistics.lags + place] = 1.0;
        }
        let windows = Windows {
            history: History::new(slots, observation_length, statistics.lags),
            normaliser: SignatureNormaliser::for_task(statistics, &task.observation_words),
        };
        Ok(BoundInput { observation_length, scaled, windows: Some(windows) })
    }
}

/// An input bound to a task.
pub(super) struct BoundInput {
    observation_length: usize,
    /// What the first layer sees, of the body that acts.
    scaled: Vec<f32>,
    windows: Option<Windows>,
}

struct Windows {
    history: History,
    normaliser: SignatureNormaliser,
}

impl BoundInput {
    /// Length of one observation.
    pub(super) fn observation_length(&self) -> usize {
        self.observation_length
    }

    /// Forgets what the body in `slot` has seen.
    pub(super) fn reset(&mut self, slot: usize) {
        if let Some(windows) = &mut self.windows {
            windows.history.clear(slot);
        }
    }

    /// What the first layer sees of the newest observation of `slot`.
    pub(super) fn scale(&mut self, input: &Input, slot: usize, raw: &[f32]) -> &[f32] {
        match (input, &mut self.windows) {
            (_, Some(Windows { history, normaliser })) => {
                let windows = history.push(slot, raw);
                normaliser.apply(windows, &mut self.scaled[..windows.len()]);
            }
            (Input::Normalised(normaliser), None) => normaliser.apply(raw, &mut self.scaled),
            (Input::Shifted { shift, scale }, None) => {
                let constants = shift.iter().zip(scale);
                for ((x, raw), (shift, scale)) in self.scaled.iter_mut().zip(raw).zip(constants) {
                    *x = (raw - shift) / scale;
                }
            }
            (Input::Windows { .. }, None) => {}
        }
        &self.scaled
    }
}

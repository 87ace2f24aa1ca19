//! The profile of a muscle over the gait cycle: the mean of all kept cycles, each stretched to the same 200 points.
//!
//! Both ends of a cycle are mapped to the first and last sample; between samples the activation is interpolated
//! linearly. The activations are taken raw: filtering them is an option, and at the control rate of 30 Hz a cut-off of
//! 15 Hz is no filter at all.
//!
//! In units of activation. Rows of a profile are points of the cycle, columns are muscles. Standard deviations are
//! those over cycles, divisor n.
//!
//! Degenerate: without a kept cycle there is no profile, which is an error. Oracle: `tests/signals_parity.rs`,
//! algorithm `gait_segmentation`.

use super::{EmgError, Segmentation};
use crate::analysis::signal::{LowPass, Rows, resample_rows};

/// Mean activation over the cycle.
#[derive(Debug, Clone, PartialEq)]
pub struct CycleProfile {
    /// Points × muscles, row by row.
    pub mean: Vec<f64>,
    /// Over cycles, divisor n; points × muscles.
    pub standard_deviation: Vec<f64>,
    pub muscle_count: usize,
    /// Number of cycles found and averaged.
    pub detected: usize,
    pub retained: usize,
}

impl CycleProfile {
    /// The mean as a table.
    pub fn rows(&self) -> Result<Rows<'_>, EmgError> {
        Ok(Rows::new(&self.mean, self.muscle_count)?)
    }
}

/// Averages the kept cycles of the muscles in `columns` to `points` points. `activations` has one table per episode of
/// the segmentation, samples × muscles; `filter`, if any, is applied to every episode first.
pub fn cycle_profile(
    segmentation: &Segmentation,
    activations: &[Rows<'_>],
    columns: &[usize],
    points: usize,
    filter: Option<&LowPass>,
) -> Result<CycleProfile, EmgError> {
    if activations.len() != segmentation.strikes.len() {
        let (expected, found) = (segmentation.strikes.len(), activations.len());
        return Err(EmgError::EpisodeCount { expected, found });
    }
    let muscle_count = columns.len();
    let mut profile = CycleProfile {
        mean: vec![0.0; points * muscle_count],
        standard_deviation: vec![0.0; points * muscle_count],
        muscle_count,
        detected: segmentation.detected(),
        retained: 0,
    };
    let mut chosen: Option<(usize, Vec<f64>)> = None;
    for cycle in segmentation.kept() {
        let episode = &activations[cycle.episode];
        if cycle.end > episode.len() {
            return Err(EmgError::RowCount {
                episode: cycle.episode,
                what: "activations",
                expected: cycle.end,
                found: episode.len(),
            });
        }
        if chosen.as_ref().is_none_or(|(of, _)| *of != cycle.episode) {
            chosen = Some((cycle.episode, choose(episode, columns, filter)?));
        }
        let Some((_, values)) = &chosen else { continue };
        let samples = Rows::new(values, muscle_count)?.slice(cycle.start..cycle.end);
        if let Some(stretched) = resample_rows(&samples, points) {
            profile.add(&stretched);
        }
    }
    profile.finish()
}

impl CycleProfile {
    /// Adds one cycle to mean and sum of squared deviations (Welford 1962).
    fn add(&mut self, cycle: &[f64]) {
        self.retained += 1;
        let count = self.retained as f64;
        let moments = self.mean.iter_mut().zip(&mut self.standard_deviation);
        for ((mean, squares), &value) in moments.zip(cycle) {
            let deviation = value - *mean;
            *mean += deviation / count;
            *squares += deviation * (value - *mean);
        }
    }

    fn finish(mut self) -> Result<Self, EmgError> {
        if self.retained == 0 {
            return Err(EmgError::NoCycle { detected: self.detected });
        }
        let count = self.retained as f64;
        for squares in &mut self.standard_deviation {
            *squares = (*squares / count).max(0.0).sqrt();
        }
        Ok(self)
    }
}

/// The wanted columns of an episode side by side, filtered.
fn choose(
    episode: &Rows<'_>,
    columns: &[usize],
    filter: Option<&LowPass>,
) -> Result<Vec<f64>, EmgError> {
    if let Some(&column) = columns.iter().find(|&&column| column >= episode.columns()) {
        let name = format!("column {column}");
        return Err(EmgError::MissingMuscle { name, available: episode.columns() });
    }
    let mut chosen = vec![0.0; episode.len() * columns.len()];
    for (place, &column) in columns.iter().enumerate() {
        let mut signal: Vec<f64> = episode.column(column).collect();
        if let Some(filter) = filter {
            signal = filter.zero_phase(&signal);
        }
        for (target, value) in chosen.iter_mut().skip(place).step_by(columns.len()).zip(signal) {
            *target = value;
        }
    }
    Ok(chosen)
}

#[cfg(test)]
mod tests {
    use super::super::{Cycle, EpisodeStrikes, Verdict};
    use super::*;

    fn segmentation(cycles: &[(usize, usize, Verdict)]) -> Segmentation {
        let cycle = |&(start, end, verdict): &(usize, usize, Verdict)| Cycle {
            episode: 0,
            start,
            end,
            mean_speed: 1.0,
            verdict,
        };
        Segmentation {
            cycles: cycles.iter().map(cycle).collect(),
            strikes: vec![EpisodeStrikes::default()],
            skipped: Vec::new(),
            unfiltered: false,
        }
    }

    #[test]
    fn kept_cycles_are_stretched_and_averaged() {
        let found =
            segmentation(&[(0, 2, Verdict::Kept), (2, 4, Verdict::TooLong), (4, 6, Verdict::Kept)]);
        let values = [9.0, 0.0, 9.0, 2.0, 9.0, 50.0, 9.0, 50.0, 9.0, 2.0, 9.0, 4.0];
        let activations = [Rows::new(&values, 2).unwrap()];
        let profile = cycle_profile(&found, &activations, &[1], 3, None).unwrap();
        assert_eq!(profile.mean, [1.0, 2.0, 3.0]);
        assert_eq!(profile.standard_deviation, [1.0; 3]);
        assert_eq!((profile.detected, profile.retained), (3, 2));
    }

    #[test]
    fn no_cycle_a_missing_column_and_a_short_table_are_typed_errors() {
        let values = [0.0; 8];
        let activations = [Rows::new(&values, 2).unwrap()];
        let of = |cycles: &[_], columns: &[usize]| {
            cycle_profile(&segmentation(cycles), &activations, columns, 5, None).unwrap_err()
        };
        let slow = [(0, 2, Verdict::TooSlow)];
        assert_eq!(of(&slow, &[0]), EmgError::NoCycle { detected: 1 });
        let kept = [(0, 2, Verdict::Kept)];
        assert!(matches!(of(&kept, &[2]), EmgError::MissingMuscle { available: 2, .. }));
        assert!(matches!(of(&kept, &[]), EmgError::Signal(_)));
        let late = [(2, 9, Verdict::Kept)];
        assert!(matches!(of(&late, &[0]), EmgError::RowCount { expected: 9, found: 4, .. }));
        let none = cycle_profile(&segmentation(&kept), &[], &[0], 5, None);
        assert_eq!(none, Err(EmgError::EpisodeCount { expected: 1, found: 0 }));
    }
}

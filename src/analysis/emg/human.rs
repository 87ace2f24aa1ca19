//! The human reference: mean envelopes of nine leg muscles over the gait cycle, one table per person.
//!
//! A table has a row per point of the cycle and ten columns: the time, which is ignored, and the nine channels of
//! [`HUMAN_CHANNELS`] in that order, in whatever unit the envelopes were normalised to; correlations do not depend on
//! it. The labels must say exactly that.
//!
//! Degenerate: labels that differ, tables of different length, too few columns, people who appear twice, and nobody at
//! all are errors that name the place. One person is a valid reference, but has nobody to be compared with.

use super::{EmgError, HUMAN_CHANNELS};
use crate::analysis::signal::Rows;

/// Label of the first column.
const TIME: &str = "Time";

/// One person's table: points × (time and nine channels).
#[derive(Debug, Clone, Copy)]
pub struct SubjectTable<'a> {
    pub subject: u32,
    pub rows: Rows<'a>,
}

/// The profiles of all people, channel by channel.
#[derive(Debug, Clone, PartialEq)]
pub struct HumanProfiles {
    subjects: Vec<u32>,
    points: usize,
    /// Subject by subject, in each channel by channel, in each point by point.
    values: Vec<f64>,
}

impl HumanProfiles {
    /// The people in `tables`, whose columns are called `labels`.
    pub fn new(labels: &[String], tables: &[SubjectTable<'_>]) -> Result<Self, EmgError> {
        let expected: Vec<&str> = [TIME].into_iter().chain(HUMAN_CHANNELS).collect();
        for column in 0..expected.len().max(labels.len()) {
            let expected = expected.get(column).copied().unwrap_or_default();
            let found = labels.get(column).map(String::as_str).unwrap_or_default();
            if expected != found {
                let (expected, found) = (expected.to_owned(), found.to_owned());
                return Err(EmgError::Label { column, expected, found });
            }
        }
        let first = tables.first().ok_or(EmgError::TooFewSubjects { needed: 1, found: 0 })?;
        let points = first.rows.len();
        let mut profiles =
            Self { subjects: Vec::with_capacity(tables.len()), points, values: Vec::new() };
        for &SubjectTable { subject, rows } in tables {
            if rows.columns() != expected.len() {
                let (expected, found) = (expected.len(), rows.columns());
                return Err(EmgError::ColumnCount { subject, expected, found });
            }
            if rows.len() != points || points == 0 {
                let (expected, found) = (points.max(1), rows.len());
                return Err(EmgError::PointCount { subject, expected, found });
            }
            if profiles.subjects.contains(&subject) {
                return Err(EmgError::RepeatedSubject { subject });
            }
            profiles.subjects.push(subject);
            profiles.values.extend((1..expected.len()).flat_map(|column| rows.column(column)));
        }
        Ok(profiles)
    }

    /// Numbers of the people, in the order of their tables.
    #[must_use]
    pub fn subjects(&self) -> &[u32] {
        &self.subjects
    }

    /// Number of points of a cycle, at least one.
    #[must_use]
    pub fn points(&self) -> usize {
        self.points
    }

    /// Profile of the person at `place` in a channel of [`HUMAN_CHANNELS`].
    #[must_use]
    pub fn profile(&self, place: usize, channel: usize) -> &[f64] {
        &self.values[(place * HUMAN_CHANNELS.len() + channel) * self.points..][..self.points]
    }

    /// Mean profile of a channel over all people but the one at place `without`.
    #[must_use]
    pub fn mean_profile(&self, channel: usize, without: Option<usize>) -> Vec<f64> {
        let places: Vec<usize> =
            (0..self.subjects.len()).filter(|&place| Some(place) != without).collect();
        let mean = |point: usize| {
            let sum: f64 = places.iter().map(|&place| self.profile(place, channel)[point]).sum();
            sum / places.len() as f64
        };
        (0..self.points).map(mean).collect()
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    fn labels() -> Vec<String> {
        [TIME].into_iter().chain(HUMAN_CHANNELS).map(str::to_owned).collect()
    }

    /// People with `points` points each; `value(subject, channel, point)`.
    pub(in crate::analysis::emg) fn people(
        count: u32,
        points: usize,
        value: impl Fn(u32, usize, usize) -> f64,
    ) -> HumanProfiles {
        let tables: Vec<Vec<f64>> = (0..count)
            .map(|subject| {
                let row = |point| {
                    let channels = (0..9).map(|channel| value(subject, channel, point)).collect();
                    [vec![point as f64], channels].concat()
                };
                (0..points).flat_map(row).collect()
            })
            .collect();
        let tables: Vec<SubjectTable<'_>> = (0..count)
            .zip(&tables)
            .map(|(subject, table)| SubjectTable { subject, rows: Rows::new(table, 10).unwrap() })
            .collect();
        HumanProfiles::new(&labels(), &tables).unwrap()
    }

    #[test]
    fn time_is_ignored_and_channels_keep_their_order() {
        let people = people(2, 3, |s, c, p| f64::from(s) * 100.0 + c as f64 * 10.0 + p as f64);
        assert_eq!(people.profile(1, 4), [140.0, 141.0, 142.0]);
        assert_eq!(people.mean_profile(0, None), [50.0, 51.0, 52.0]);
        assert_eq!(people.mean_profile(0, Some(0)), [100.0, 101.0, 102.0]);
    }

    #[test]
    fn wrong_labels_are_named_with_their_column() {
        let values = [0.0; 10];
        let tables = [SubjectTable { subject: 4, rows: Rows::new(&values, 10).unwrap() }];
        let mut swapped = labels();
        swapped.swap(7, 9);
        assert_eq!(
            HumanProfiles::new(&swapped, &tables),
            Err(EmgError::Label {
                column: 7,
                expected: "Vastus Lateral".to_owned(),
                found: "Vastus Medial".to_owned()
            })
        );
        assert!(matches!(
            HumanProfiles::new(&labels()[..9], &tables),
            Err(EmgError::Label { column: 9, .. })
        ));
    }

    #[test]
    fn tables_that_do_not_fit_together_are_typed_errors() {
        let values = vec![0.0; 90];
        let of = |tables: &[(u32, usize, usize)]| {
            let tables: Vec<SubjectTable<'_>> = tables
                .iter()
                .map(|&(subject, columns, rows)| SubjectTable {
                    subject,
                    rows: Rows::new(&values[..columns * rows], columns).unwrap(),
                })
                .collect();
            HumanProfiles::new(&labels(), &tables).unwrap_err()
        };
        assert_eq!(of(&[]), EmgError::TooFewSubjects { needed: 1, found: 0 });
        assert_eq!(of(&[(4, 9, 2)]), EmgError::ColumnCount { subject: 4, expected: 10, found: 9 });
        assert_eq!(
            of(&[(4, 10, 3), (5, 10, 2)]),
            EmgError::PointCount { subject: 5, expected: 3, found: 2 }
        );
        assert_eq!(of(&[(4, 10, 2), (4, 10, 2)]), EmgError::RepeatedSubject { subject: 4 });
        assert_eq!(of(&[(4, 10, 0)]), EmgError::PointCount { subject: 4, expected: 1, found: 0 });
    }
}

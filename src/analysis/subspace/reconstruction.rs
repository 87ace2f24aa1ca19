//! How well rebuilt values match measured ones.
//!
//! * `centred` (the published "variance weighted" R²): `1 − ΣSSE / ΣSST`, both summed over all columns, SST about each
//!   column's mean. Negative if the column means would do better.
//! * `uncentred`: `1 − ΣSSE / Σx²`, the explained variation of the muscle synergy literature.
//! * `uniform`: the mean over columns of each column's R². A column without variance counts 1 if it is rebuilt exactly,
//!   else 0.
//!
//! No unit; 1 is perfect. Degenerate: without variance `centred` is undefined, with zeros only `uncentred` is.
//! Oracle: `tests/analysis_parity.rs`, algorithms `r2`, `nmf_transform`.

use super::SubspaceError;

/// Scores of a reconstruction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Reconstruction {
    pub centred: Option<f64>,
    pub uncentred: Option<f64>,
    pub uniform: f64,
}

/// Compares `rebuilt` with `measured`, both row-major with `columns` columns.
pub fn reconstruction(
    measured: &[f64],
    rebuilt: &[f64],
    columns: usize,
) -> Result<Reconstruction, SubspaceError> {
    if columns == 0 || !measured.len().is_multiple_of(columns) {
        return Err(SubspaceError::MuscleCount { expected: columns, found: measured.len() });
    }
    if measured.len() != rebuilt.len() {
        return Err(SubspaceError::Length { expected: measured.len(), found: rebuilt.len() });
    }
    let rows = measured.len() / columns;
    if rows == 0 {
        return Err(SubspaceError::TooFewRows { found: 0 });
    }
    let mut mean = vec![0.0; columns];
    for row in measured.chunks_exact(columns) {
        mean.iter_mut().zip(row).for_each(|(sum, x)| *sum += x);
    }
    mean.iter_mut().for_each(|sum| *sum /= rows as f64);
    let (mut errors, mut deviations) = (vec![0.0; columns], vec![0.0; columns]);
    let mut squares = 0.0;
    for (row, rebuilt) in measured.chunks_exact(columns).zip(rebuilt.chunks_exact(columns)) {
        for column in 0..columns {
            let (x, y) = (row[column], rebuilt[column]);
            errors[column] += (x - y) * (x - y);
            deviations[column] += (x - mean[column]) * (x - mean[column]);
            squares += x * x;
        }
    }
    let error: f64 = errors.iter().sum();
    let score = |total: f64| (total > 0.0).then(|| 1.0 - error / total);
    let uniform: f64 = errors
        .iter()
        .zip(&deviations)
        .map(|(&error, &total)| match (error > 0.0, total > 0.0) {
            (_, true) => 1.0 - error / total,
            (true, false) => 0.0,
            (false, false) => 1.0,
        })
        .sum();
    Ok(Reconstruction {
        centred: score(deviations.iter().sum()),
        uncentred: score(squares),
        uniform: uniform / columns as f64,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_three_scores_by_hand() {
        // Column one: deviations 2, errors 1; column two: constant and missed.
        let found = reconstruction(&[1.0, 2.0, 3.0, 2.0], &[1.0, 2.0, 2.0, 3.0], 2).unwrap();
        assert_eq!(found.centred, Some(0.0));
        assert_eq!(found.uncentred, Some(1.0 - 2.0 / 18.0));
        assert!((found.uniform - 0.25).abs() < 1e-15);
    }

    #[test]
    fn unequal_lengths_and_nothing_are_refused() {
        let lengths = SubspaceError::Length { expected: 2, found: 1 };
        assert_eq!(reconstruction(&[1.0, 2.0], &[1.0], 2), Err(lengths));
        assert_eq!(reconstruction(&[], &[], 2), Err(SubspaceError::TooFewRows { found: 0 }));
        assert!(reconstruction(&[1.0], &[1.0], 0).is_err());
    }

    #[test]
    fn zeros_rebuilt_as_zeros_have_only_the_uniform_score() {
        let found = reconstruction(&[0.0; 6], &[0.0; 6], 3).unwrap();
        assert_eq!(found, Reconstruction { centred: None, uncentred: None, uniform: 1.0 });
    }
}

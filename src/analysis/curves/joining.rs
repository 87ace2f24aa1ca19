//! One curve out of several pieces of training.
//!
//! * [`merge_resumed`]: a run that was resumed from checkpoints logs some steps twice. A later piece removes what
//!   earlier ones logged at or after its first step; of equal steps the last value stays; then by step.
//! * [`stitch`]: pieces that each count from their own start are laid end to end, each shifted so that its smallest
//!   step falls on the end of the one before (the first one on 0).
//!
//! Empty pieces change nothing. Oracle: `tests/analysis_parity.rs`, algorithms `merge_resumed`, `seed_band`.

use super::Curve;

/// Joins pieces given in the order in which they were resumed.
#[must_use]
pub fn merge_resumed(pieces: &[Curve]) -> Curve {
    let mut points: Vec<(f64, f64)> = Vec::new();
    for piece in pieces {
        if let Some(start) = piece.steps.iter().copied().reduce(f64::min) {
            points.retain(|(step, _)| *step < start);
        }
        points.extend(piece.points());
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let mut merged: Vec<(f64, f64)> = Vec::with_capacity(points.len());
    for point in points {
        match merged.last_mut() {
            Some(last) if last.0.total_cmp(&point.0).is_eq() => *last = point,
            _ => merged.push(point),
        }
    }
    merged.into_iter().collect()
}

/// Lays pieces end to end, in the order given.
#[must_use]
pub fn stitch(pieces: &[Curve]) -> Curve {
    let mut end = 0.0;
    let mut points: Vec<(f64, f64)> = Vec::new();
    for piece in pieces {
        let Some(start) = piece.steps.iter().copied().reduce(f64::min) else { continue };
        let shift = end - start;
        points.extend(piece.points().map(|(step, value)| (step + shift, value)));
        end = points.iter().map(|(step, _)| *step).fold(end, f64::max);
    }
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    points.into_iter().collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curve(points: &[(f64, f64)]) -> Curve {
        points.iter().copied().collect()
    }

    #[test]
    fn a_resumed_run_replaces_what_it_repeats() {
        let pieces = [
            curve(&[(1.0, 0.1), (2.0, 0.2), (3.0, 0.3)]),
            curve(&[]),
            curve(&[(2.0, 0.5), (2.0, 0.6), (4.0, 0.4)]),
        ];
        assert_eq!(merge_resumed(&pieces), curve(&[(1.0, 0.1), (2.0, 0.6), (4.0, 0.4)]));
        assert!(merge_resumed(&[]).is_empty());
    }

    #[test]
    fn stitched_pieces_start_where_the_one_before_ended() {
        let pieces =
            [curve(&[(5.0, 0.1), (7.0, 0.2)]), curve(&[]), curve(&[(10.0, 0.3), (11.0, 0.4)])];
        assert_eq!(stitch(&pieces), curve(&[(0.0, 0.1), (2.0, 0.2), (2.0, 0.3), (3.0, 0.4)]));
    }
}

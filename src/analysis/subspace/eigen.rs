//! Eigenvectors of a symmetric matrix by falling eigenvalue, on one thread.

use faer::diag::Diag;
use faer::dyn_stack::{MemBuffer, MemStack};
use faer::linalg::evd::{ComputeEigenvectors, self_adjoint_evd, self_adjoint_evd_scratch};
use faer::{Mat, MatRef, Par};

use super::SubspaceError;

/// Eigenvalues, falling, those that rounding made negative as zero, and the eigenvectors as columns in the same order.
/// Only the lower triangle of `matrix` counts.
pub(super) fn falling_eigenpairs(
    matrix: MatRef<'_, f64>,
) -> Result<(Vec<f64>, Mat<f64>), SubspaceError> {
    let muscles = matrix.nrows();
    let mut values = Diag::<f64>::zeros(muscles);
    let mut vectors = Mat::<f64>::zeros(muscles, muscles);
    let scratch = self_adjoint_evd_scratch::<f64>(
        muscles,
        ComputeEigenvectors::Yes,
        Par::Seq,
        Default::default(),
    );
    self_adjoint_evd(
        matrix,
        values.as_mut(),
        Some(vectors.as_mut()),
        Par::Seq,
        MemStack::new(&mut MemBuffer::new(scratch)),
        Default::default(),
    )
    .map_err(|_| SubspaceError::NoConvergence { muscles })?;
    // They come in rising order.
    let falling = (0..muscles).rev().map(|index| values.column_vector()[index].max(0.0));
    let columns = Mat::from_fn(muscles, muscles, |i, j| vectors[(i, muscles - 1 - j)]);
    Ok((falling.collect(), columns))
}

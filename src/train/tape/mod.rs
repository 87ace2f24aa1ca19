//! The operations that the muscle transformer is made of, forward and back, over one sample.
//!
//! Matrices lie *feature by feature*: one row per feature, one column per token, rows filled up with zeros to a whole
//! number of [`LANES`]. So whatever is done to every token (norms, biases, rectifiers, thin products) runs over long
//! rows without a sum across a vector, and the rows of an attention head are one block of memory.
//!
//! Columns that only fill up hold numbers without meaning, but finite ones. They do no harm: no key is looked at beyond the
//! last token, so no loss depends on them and their derivatives are exactly zero.
//!
//! Loops are compiled for the widest vectors of the machine by `dispatch`, as far as they are inlined into it. A closure
//! is inlined for certain only if it can be called but once, so it gives away what it has captured.
//!
//! Forward keeps what backward needs in memory that is made once per thread. Backward turns derivatives by an
//! operation's output into those by its input, and adds those by its parameters to one row as long as all parameters.

pub mod attention;
pub mod layer_norm;
pub mod linear;
pub mod lookup;
pub mod one_token;
pub mod product;
#[cfg(test)]
mod tests;

/// Columns are a multiple of this, and so of every vector width in use.
pub const LANES: usize = 16;

/// Columns that hold `count` tokens.
#[must_use]
pub fn lanes(count: usize) -> usize {
    count.next_multiple_of(LANES)
}

/// Writes the first `columns` columns of `matrix` (rows of `stride` numbers), each times `scale`, as the rows of `turned`,
/// which begin every `turned_stride` numbers.
pub(super) fn turn(
    matrix: &[f32],
    stride: usize,
    columns: usize,
    scale: f32,
    turned: &mut [f32],
    turned_stride: usize,
) {
    let rows = matrix.len() / stride;
    let mut targets = turned.chunks_mut(turned_stride);
    // Sixteen columns at a time, which share the lines of the cache that they are read from.
    for first in (0..columns).step_by(LANES) {
        for (column, target) in (first..columns.min(first + LANES)).zip(&mut targets) {
            for (t, row) in target[..rows].iter_mut().zip(matrix.chunks_exact(stride)) {
                *t = scale * row[column];
            }
        }
    }
}

/// `target += source`.
pub(super) fn add(source: &[f32], target: &mut [f32]) {
    target.iter_mut().zip(source).for_each(|(t, s)| *t += s);
}

/// Sum of a row, in sixteen parts that are folded at the end.
pub(super) fn sum(row: &[f32]) -> f32 {
    let (chunks, rest) = row.as_chunks::<LANES>();
    let mut parts = [0.0_f32; LANES];
    for chunk in chunks {
        parts.iter_mut().zip(chunk).for_each(|(part, x)| *part += x);
    }
    parts.iter_mut().zip(rest).for_each(|(part, x)| *part += x);
    fold(parts)
}

/// Sum of sixteen numbers, half of them onto the other half until one is left.
#[expect(clippy::inline_always, reason = "`dispatch` compiles only what is inlined into it")]
#[inline(always)]
pub(super) fn fold(mut parts: [f32; LANES]) -> f32 {
    let mut width = LANES / 2;
    while width > 0 {
        let (low, high) = parts.split_at_mut(width);
        low.iter_mut().zip(high).for_each(|(a, b)| *a += *b);
        width /= 2;
    }
    parts[0]
}

//! Multi-head attention as PyTorch packs it (`spec/policy.md` §1.6).
//!
//! For head `i`, with `d_h = d/h` columns each: `O_i = softmax(Q_i K_iᵀ / √d_h) V_i`; the heads are laid side by side and
//! pass through one more dense layer. Keys are masked by leaving them out ([`Keys`]).
//!
//! Queries are worked off in blocks, so that a block's scores stay in the second-level cache. The softmax divides last:
//! `exp` of the scores multiplies the values, and the block of `O` is divided by the sums.

use faer::linalg::matmul::matmul;
use faer::{Accum, MatMut, MatRef, Par};

use super::elementwise::{exponentiate, vectorised};
use super::linear::Linear;
use super::weights::Weights;
use crate::policy::PolicyError;

/// Queries worked off together.
const QUERY_BLOCK: usize = 96;

/// Which rows the queries may look at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Keys {
    /// All of them.
    All,
    /// The first few; the others are padding.
    First(usize),
    /// Each query itself and the rows before it: rows are moments, and nobody sees the future.
    Past,
}

/// Scratch memory of attention: room for one block's scores and their sums.
#[derive(Debug, Clone)]
pub(super) struct AttentionScratch {
    scores: Vec<f32>,
    sums: Vec<f32>,
}

impl AttentionScratch {
    /// For up to `keys` keys.
    pub(super) fn new(keys: usize) -> Self {
        Self { scores: vec![0.0; QUERY_BLOCK * keys], sums: vec![0.0; QUERY_BLOCK] }
    }
}

/// Self-attention: queries, keys and values come from the same rows.
#[derive(Debug, Clone)]
pub(super) struct SelfAttention {
    heads: usize,
    project: Linear,
    output: Linear,
}

impl SelfAttention {
    /// Reads `<name>.in_proj_weight` and its companions.
    pub(super) fn read(
        weights: Weights,
        name: &str,
        width: usize,
        heads: usize,
    ) -> Result<Self, PolicyError> {
        let weight = weights.tensor(&format!("{name}.in_proj_weight"), &[3 * width, width])?;
        let bias = weights.tensor(&format!("{name}.in_proj_bias"), &[3 * width])?;
        let output = Linear::read(weights, &format!("{name}.out_proj"), width, width)?;
        Ok(Self { heads, project: Linear::new(width, weight, bias), output })
    }

    /// `stream += attention(normed)`. `projected` holds three times and `mixed` once as many numbers as `normed`.
    pub(super) fn accumulate(
        &self,
        normed: &[f32],
        keys: Keys,
        projected: &mut [f32],
        mixed: &mut [f32],
        scratch: &mut AttentionScratch,
        stream: &mut [f32],
    ) {
        let width = self.output.inputs();
        self.project.apply(normed, projected);
        let rows =
            MatRef::from_row_major_slice(projected, projected.len() / (3 * width), 3 * width);
        let key_count = match keys {
            Keys::First(count) => count,
            Keys::All | Keys::Past => rows.nrows(),
        };
        attend(
            self.heads,
            keys,
            rows.subcols(0, width),
            rows.get(..key_count, width..2 * width),
            rows.get(..key_count, 2 * width..),
            scratch,
            mixed,
        );
        self.output.accumulate(mixed, stream);
    }
}

/// Cross-attention: queries come from one set of rows, keys and values from another.
#[derive(Debug, Clone)]
pub(super) struct CrossAttention {
    heads: usize,
    query: Linear,
    key_value: Linear,
    output: Linear,
}

impl CrossAttention {
    /// Reads `<name>.in_proj_weight` and its companions.
    pub(super) fn read(
        weights: Weights,
        name: &str,
        width: usize,
        heads: usize,
    ) -> Result<Self, PolicyError> {
        let weight = weights.tensor(&format!("{name}.in_proj_weight"), &[3 * width, width])?;
        let bias = weights.tensor(&format!("{name}.in_proj_bias"), &[3 * width])?;
        let (query_weight, key_value_weight) = weight.split_at(width * width);
        let (query_bias, key_value_bias) = bias.split_at(width);
        Ok(Self {
            heads,
            query: Linear::new(width, query_weight, query_bias),
            key_value: Linear::new(width, key_value_weight, key_value_bias),
            output: Linear::read(weights, &format!("{name}.out_proj"), width, width)?,
        })
    }

    /// `stream += attention(normed, memory)`. `queries` and `mixed` hold as many numbers as `normed`, `keys_values`
    /// twice as many as `memory`.
    #[expect(clippy::too_many_arguments, reason = "scratch memory is the caller's")]
    pub(super) fn accumulate(
        &self,
        normed: &[f32],
        memory: &[f32],
        queries: &mut [f32],
        keys_values: &mut [f32],
        mixed: &mut [f32],
        scratch: &mut AttentionScratch,
        stream: &mut [f32],
    ) {
        let width = self.output.inputs();
        self.query.apply(normed, queries);
        self.key_value.apply(memory, keys_values);
        let both =
            MatRef::from_row_major_slice(keys_values, keys_values.len() / (2 * width), 2 * width);
        attend(
            self.heads,
            Keys::All,
            MatRef::from_row_major_slice(queries, queries.len() / width, width),
            both.subcols(0, width),
            both.subcols(width, width),
            scratch,
            mixed,
        );
        self.output.accumulate(mixed, stream);
    }
}

/// Attention of every head; `mixed` (queries × width, row-major) receives the heads side by side.
fn attend(
    heads: usize,
    keys: Keys,
    query: MatRef<'_, f32>,
    key: MatRef<'_, f32>,
    value: MatRef<'_, f32>,
    scratch: &mut AttentionScratch,
    mixed: &mut [f32],
) {
    let (query_count, width) = (query.nrows(), query.ncols());
    let key_count = key.nrows();
    let head_width = width / heads;
    // Scores in units of ln 2, for the power of two that follows.
    let scale = std::f32::consts::LOG2_E / (head_width as f32).sqrt();
    for first in (0..query_count).step_by(QUERY_BLOCK) {
        let rows = QUERY_BLOCK.min(query_count - first);
        for head in 0..heads {
            let column = head * head_width;
            let scores = &mut scratch.scores[..rows * key_count];
            matmul(
                MatMut::from_row_major_slice_mut(scores, rows, key_count),
                Accum::Replace,
                query.submatrix(first, column, rows, head_width),
                key.subcols(column, head_width).transpose(),
                scale,
                Par::Seq,
            );
            let sums = &mut scratch.sums[..rows];
            vectorised(
                #[inline(always)]
                || {
                    for (query, row) in scores.chunks_exact_mut(key_count).enumerate() {
                        let seen = if keys == Keys::Past { first + query + 1 } else { key_count };
                        let (seen, unseen) = row.split_at_mut(seen);
                        sums[query] = exponentiate(seen);
                        unseen.fill(0.0);
                    }
                },
            );
            let block = &mut mixed[first * width..(first + rows) * width];
            matmul(
                MatMut::from_row_major_slice_mut(block, rows, width)
                    .subcols_mut(column, head_width),
                Accum::Replace,
                MatRef::from_row_major_slice(scores, rows, key_count),
                value.subcols(column, head_width),
                1.0,
                Par::Seq,
            );
            for (row, &sum) in block.chunks_exact_mut(width).zip(&scratch.sums) {
                for x in &mut row[column..column + head_width] {
                    *x /= sum;
                }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_query_two_keys_by_hand() {
        // Width 1, one head: scores 0 and ln 3, so the weights are 1/4 and 3/4 and the mixture of 8 and 4 is 5.
        let (query, key, value) = ([1.0], [0.0, 3.0_f32.ln()], [8.0, 4.0]);
        let mut mixed = [0.0];
        attend(
            1,
            Keys::All,
            MatRef::from_row_major_slice(&query, 1, 1),
            MatRef::from_row_major_slice(&key, 2, 1),
            MatRef::from_row_major_slice(&value, 2, 1),
            &mut AttentionScratch::new(2),
            &mut mixed,
        );
        assert!((mixed[0] - 5.0).abs() < 2e-6, "{mixed:?}");
    }

    #[test]
    fn blocks_of_queries_and_heads_agree_with_the_definition() {
        let (heads, head_width, queries, keys) = (2, 8, 2 * QUERY_BLOCK + 5, 37);
        let width = heads * head_width;
        let wave =
            |n: usize, f: f32| -> Vec<f32> { (0..n).map(|i| (i as f32 * f).sin()).collect() };
        let (q, k, v) =
            (wave(queries * width, 0.71), wave(keys * width, 0.37), wave(keys * width, 0.53));
        let mut mixed = vec![0.0; queries * width];
        attend(
            heads,
            Keys::All,
            MatRef::from_row_major_slice(&q, queries, width),
            MatRef::from_row_major_slice(&k, keys, width),
            MatRef::from_row_major_slice(&v, keys, width),
            &mut AttentionScratch::new(keys),
            &mut mixed,
        );
        for (row, head) in (0..queries).flat_map(|row| (0..heads).map(move |head| (row, head))) {
            let columns = head * head_width..(head + 1) * head_width;
            let scores: Vec<f64> = (0..keys)
                .map(|key| {
                    let products = columns
                        .clone()
                        .map(|c| f64::from(q[row * width + c]) * f64::from(k[key * width + c]));
                    (products.sum::<f64>() / (head_width as f64).sqrt()).exp()
                })
                .collect();
            let sum: f64 = scores.iter().sum();
            for c in columns {
                let terms = (0..keys).map(|key| scores[key] * f64::from(v[key * width + c]));
                let want = terms.sum::<f64>() / sum;
                let got = f64::from(mixed[row * width + c]);
                assert!(
                    (got - want).abs() < 1e-6,
                    "row {row}, column {c}: {got} instead of {want}"
                );
            }
        }
    }

    #[test]
    fn nobody_sees_the_future() {
        // Width 1, one head, all scores equal: every row is the mean of the values up to its own.
        let numbers = [[0.0; 3], [1.0; 3], [6.0, 2.0, 1.0]];
        let [query, key, value] = numbers.each_ref().map(|n| MatRef::from_row_major_slice(n, 3, 1));
        let mut mixed = [0.0; 3];
        attend(1, Keys::Past, query, key, value, &mut AttentionScratch::new(3), &mut mixed);
        assert_eq!(mixed.map(f32::to_bits), [6.0_f32, 4.0, 3.0].map(f32::to_bits));
    }
}

//! Multi-head attention as PyTorch packs it (`spec/policy.md` §1.6).
//!
//! For head `i`, with `d_h = d/h` columns each: `O_i = softmax(Q_i K_iᵀ / √d_h) V_i`; the heads are laid side by side and
//! pass through one more dense layer. Keys are masked by leaving them out ([`Keys`]).
//!
//! Head by head, keys and values are packed for [`Product`]; then queries are worked off in blocks, so that a block's scores
//! stay in the cache. `1/√d_h` is part of the weights that make the queries. The softmax divides last: `exp` of the
//! scores multiplies the values, and the block of `O` is divided by the sums.

use super::elementwise::{exponentiate, vectorised};
use super::linear::Linear;
use super::product::{Finish, PANEL, Product, Rows, pack_columns, pack_rows};
use super::weights::Weights;
use crate::policy::PolicyError;

/// Queries worked off together.
const QUERY_BLOCK: usize = 48;

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

/// Scratch memory of attention: one head's keys and values, and what one block of queries makes of them.
#[derive(Debug, Clone)]
pub(super) struct AttentionScratch {
    keys: Vec<f32>,
    values: Vec<f32>,
    scores: Vec<f32>,
    sums: Vec<f32>,
    mixed: Vec<f32>,
}

impl AttentionScratch {
    /// For up to `keys` keys and heads of `head_width` columns.
    pub(super) fn new(keys: usize, head_width: usize) -> Self {
        let (padded_keys, padded_width) =
            (keys.next_multiple_of(PANEL), head_width.next_multiple_of(PANEL));
        Self {
            keys: vec![0.0; padded_keys * head_width],
            values: vec![0.0; keys * padded_width],
            scores: vec![0.0; QUERY_BLOCK * padded_keys],
            sums: vec![0.0; QUERY_BLOCK],
            mixed: vec![0.0; QUERY_BLOCK * padded_width],
        }
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
        let (mut weight, mut bias) = (weight.to_vec(), bias.to_vec());
        scale_queries(&mut weight[..width * width], width / heads);
        scale_queries(&mut bias[..width], width / heads);
        let output = Linear::read(weights, &format!("{name}.out_proj"), width, width)?;
        Ok(Self { heads, project: Linear::new(width, &weight, &bias), output })
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
        let rows = Rows::new(projected, 3 * width);
        let key_count = match keys {
            Keys::First(count) => count,
            Keys::All | Keys::Past => rows.count(),
        };
        let seen = rows.part(0, key_count);
        Attention {
            heads: self.heads,
            width,
            keys,
            query: rows,
            key: seen.columns_on(width),
            value: seen.columns_on(2 * width),
        }
        .mix(scratch, mixed);
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
        let (mut query_weight, mut query_bias) = (query_weight.to_vec(), query_bias.to_vec());
        scale_queries(&mut query_weight, width / heads);
        scale_queries(&mut query_bias, width / heads);
        Ok(Self {
            heads,
            query: Linear::new(width, &query_weight, &query_bias),
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
        let both = Rows::new(keys_values, 2 * width);
        Attention {
            heads: self.heads,
            width,
            keys: Keys::All,
            query: Rows::new(queries, width),
            key: both,
            value: both.columns_on(width),
        }
        .mix(scratch, mixed);
        self.output.accumulate(mixed, stream);
    }
}

/// Multiplies what makes the queries by `1/√d_h`, and by log₂e for the power of two that takes the place of `exp`.
fn scale_queries(numbers: &mut [f32], head_width: usize) {
    let scale = std::f32::consts::LOG2_E / (head_width as f32).sqrt();
    for x in numbers {
        *x *= scale;
    }
}

/// Attention of every head, whose columns lie side by side in the rows. Queries are scaled.
struct Attention<'a> {
    heads: usize,
    width: usize,
    keys: Keys,
    query: Rows<'a>,
    key: Rows<'a>,
    value: Rows<'a>,
}

impl Attention<'_> {
    /// Writes the heads side by side to `mixed`, queries × width.
    fn mix(&self, scratch: &mut AttentionScratch, mixed: &mut [f32]) {
        let head_width = self.width / self.heads;
        let key_count = self.key.count();
        let padded_keys = key_count.next_multiple_of(PANEL);
        let padded_width = head_width.next_multiple_of(PANEL);
        let keys = &mut scratch.keys[..padded_keys * head_width];
        let values = &mut scratch.values[..key_count * padded_width];
        for column in (0..self.width).step_by(head_width) {
            pack_columns(self.key.columns_on(column), head_width, keys);
            pack_rows(self.value.columns_on(column), head_width, values);
            for first in (0..self.query.count()).step_by(QUERY_BLOCK) {
                let count = QUERY_BLOCK.min(self.query.count() - first);
                let scores = &mut scratch.scores[..count * padded_keys];
                Product {
                    x: self.query.part(first, count).columns_on(column),
                    depth: head_width,
                    panels: keys,
                    finish: Finish::Replace,
                    y: scores,
                    y_stride: padded_keys,
                }
                .compute();
                self.exponentiate(first, scores, padded_keys, &mut scratch.sums);
                let block = &mut scratch.mixed[..count * padded_width];
                Product {
                    x: Rows::new(scores, padded_keys),
                    depth: key_count,
                    panels: values,
                    finish: Finish::Replace,
                    y: block,
                    y_stride: padded_width,
                }
                .compute();
                let rows = mixed[first * self.width..].chunks_exact_mut(self.width);
                for ((row, block), sum) in
                    rows.zip(block.chunks_exact(padded_width)).zip(&scratch.sums)
                {
                    for (x, y) in row[column..column + head_width].iter_mut().zip(block) {
                        *x = y / sum;
                    }
                }
            }
        }
    }

    /// Replaces the scores of the queries from `first` on by their powers, and writes the sum of each row.
    fn exponentiate(&self, first: usize, scores: &mut [f32], stride: usize, sums: &mut [f32]) {
        vectorised(
            #[inline(always)]
            || {
                for (query, (row, sum)) in scores.chunks_exact_mut(stride).zip(sums).enumerate() {
                    let row = &mut row[..self.key.count()];
                    let seen = if self.keys == Keys::Past { first + query + 1 } else { row.len() };
                    let (seen, unseen) = row.split_at_mut(seen);
                    *sum = exponentiate(seen);
                    unseen.fill(0.0);
                }
            },
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_query_two_keys_by_hand() {
        // Width 1, one head: scores 0 and ln 3, so the weights are 1/4 and 3/4 and the mixture of 8 and 4 is 5.
        let (mut query, key, value) = ([1.0], [0.0, 3.0_f32.ln()], [8.0, 4.0]);
        scale_queries(&mut query, 1);
        let mut mixed = [0.0];
        Attention {
            heads: 1,
            width: 1,
            keys: Keys::All,
            query: Rows::new(&query, 1),
            key: Rows::new(&key, 1),
            value: Rows::new(&value, 1),
        }
        .mix(&mut AttentionScratch::new(2, 1), &mut mixed);
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
        let mut scaled = q.clone();
        scale_queries(&mut scaled, head_width);
        Attention {
            heads,
            width,
            keys: Keys::All,
            query: Rows::new(&scaled, width),
            key: Rows::new(&k, width),
            value: Rows::new(&v, width),
        }
        .mix(&mut AttentionScratch::new(keys, head_width), &mut mixed);
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
        let [query, key, value] = numbers.each_ref().map(|numbers| Rows::new(numbers, 1));
        let mut mixed = [0.0; 3];
        Attention { heads: 1, width: 1, keys: Keys::Past, query, key, value }
            .mix(&mut AttentionScratch::new(3, 1), &mut mixed);
        assert_eq!(mixed.map(f32::to_bits), [6.0_f32, 4.0, 3.0].map(f32::to_bits));
    }
}

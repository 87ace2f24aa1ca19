//! Attention of all heads (`spec/policy.md` §1.6), forward and back.
//!
//! For head `i` with `d_h` features of queries Q, keys K and values V: `P = softmax(Qᵀ K/√d_h)`, `O = V Pᵀ`. Forward keeps
//! the exponentials E and their sums s, `P = E/s`. Back, row by row of P with `δ = ∂O · O`:
//! `∂V += ∂O P`, `∂S = P (∂Oᵀ V − δ)/√d_h`, `∂Q = K ∂Sᵀ`, `∂K += Q ∂S`.
//!
//! Queries are worked off in blocks, so that a block's scores stay in the first-level cache.

use pulp::Arch;

use super::product::{Product, Start};
use super::{LANES, lanes, turn};
use crate::policy::network::elementwise::exponentiate;

/// Queries worked off together.
const QUERY_BLOCK: usize = 32;

/// Sizes of one attention.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Attention {
    pub width: usize,
    pub heads: usize,
    /// Queries that are tokens, and the columns that hold them.
    pub queries: usize,
    pub query_columns: usize,
    /// Keys that are looked at, and the columns that hold them and others.
    pub keys: usize,
    pub key_columns: usize,
}

/// What backward needs, and what forward needs for a moment.
#[derive(Debug, Clone)]
pub struct Attended {
    /// Heads × queries × key columns.
    exponentials: Vec<f32>,
    /// Heads × queries.
    sums: Vec<f32>,
}

/// Memory of one thread.
#[derive(Debug, Clone)]
pub struct AttentionScratch {
    /// Queries × features of a head: queries, or slopes of them or of `O`.
    queries: Vec<f32>,
    /// Slopes of `O` by the sums, features of a head × columns of queries.
    divided: Vec<f32>,
    /// Keys × features of a head: keys or values.
    keys: Vec<f32>,
    /// A block of queries × features of a head.
    block: Vec<f32>,
    /// Queries × keys.
    scores: Vec<f32>,
    /// One number for each query.
    factors: Vec<f32>,
    products: Vec<f32>,
}

impl Attended {
    #[must_use]
    pub fn new(heads: usize, queries: usize, key_columns: usize) -> Self {
        Self {
            exponentials: vec![0.0; heads * queries * key_columns],
            sums: vec![0.0; heads * queries],
        }
    }
}

impl AttentionScratch {
    /// For heads of so many features and up to so many columns of queries and keys.
    #[must_use]
    pub fn new(head_width: usize, columns: usize) -> Self {
        let features = lanes(head_width);
        Self {
            queries: vec![0.0; columns * head_width],
            divided: vec![0.0; columns * head_width],
            keys: vec![0.0; columns * features],
            block: vec![0.0; QUERY_BLOCK * head_width],
            scores: vec![0.0; columns * columns],
            factors: vec![0.0; columns],
            products: vec![0.0; columns],
        }
    }
}

impl Attention {
    fn head_width(&self) -> usize {
        self.width / self.heads
    }

    /// Rows of head `head` in a matrix of so many columns.
    fn rows(&self, head: usize, columns: usize) -> std::ops::Range<usize> {
        let size = self.head_width() * columns;
        head * size..(head + 1) * size
    }

    /// `O` from queries, keys and values.
    pub fn apply(
        &self,
        [query, key, value]: [&[f32]; 3],
        kept: &mut Attended,
        scratch: &mut AttentionScratch,
        mixed: &mut [f32],
    ) {
        let (head_width, features) = (self.head_width(), lanes(self.head_width()));
        // Scores in units of ln 2, for the power of two that follows.
        let scale = std::f32::consts::LOG2_E / (head_width as f32).sqrt();
        for head in 0..self.heads {
            let (query_rows, key_rows) =
                (self.rows(head, self.query_columns), self.rows(head, self.key_columns));
            let query = &query[query_rows.clone()];
            turn(query, self.query_columns, self.queries, scale, &mut scratch.queries, head_width);
            let value = &value[key_rows.clone()];
            turn(value, self.key_columns, self.keys, 1.0, &mut scratch.keys, features);
            let mixed = &mut mixed[query_rows];
            for first in (0..self.queries).step_by(QUERY_BLOCK) {
                let count = QUERY_BLOCK.min(self.queries - first);
                let place = head * self.queries + first;
                let block = place * self.key_columns..(place + count) * self.key_columns;
                let exponentials = &mut kept.exponentials[block];
                Product {
                    rows: count,
                    depth: head_width,
                    columns: self.key_columns,
                    a: &scratch.queries[first * head_width..],
                    a_stride: head_width,
                    b: &key[key_rows.clone()],
                    b_stride: self.key_columns,
                    start: Start::Zero,
                    rectify: false,
                    c: exponentials,
                    c_stride: self.key_columns,
                }
                .compute();
                let sums = &mut kept.sums[place..place + count];
                exponentiate_rows(exponentials, self.keys, self.key_columns, sums);
                Product {
                    rows: count,
                    depth: self.keys,
                    columns: head_width,
                    a: exponentials,
                    a_stride: self.key_columns,
                    b: &scratch.keys,
                    b_stride: features,
                    start: Start::Zero,
                    rectify: false,
                    c: &mut scratch.block,
                    c_stride: head_width,
                }
                .compute();
                let block = &mut scratch.block[..count * head_width];
                for (row, sum) in block.chunks_exact_mut(head_width).zip(sums) {
                    row.iter_mut().for_each(|x| *x /= *sum);
                }
                turn(block, head_width, head_width, 1.0, &mut mixed[first..], self.query_columns);
            }
        }
    }

    /// Derivatives by queries (set), keys and values (set), from those by `O`, for the forward pass that `kept` is of.
    pub fn pull(
        &self,
        [query, key, value]: [&[f32]; 3],
        mixed: &[f32],
        mixed_slopes: &[f32],
        kept: &Attended,
        scratch: &mut AttentionScratch,
        [query_slopes, key_slopes, value_slopes]: [&mut [f32]; 3],
    ) {
        let (head_width, features) = (self.head_width(), lanes(self.head_width()));
        for head in 0..self.heads {
            let (query_rows, key_rows) =
                (self.rows(head, self.query_columns), self.rows(head, self.key_columns));
            let (query, mixed, mixed_slopes) = (
                &query[query_rows.clone()],
                &mixed[query_rows.clone()],
                &mixed_slopes[query_rows.clone()],
            );
            let (key, value) = (&key[key_rows.clone()], &value[key_rows.clone()]);
            turn(key, self.key_columns, self.keys, 1.0, &mut scratch.keys, features);
            let place = head * self.queries;
            let exponentials = &kept.exponentials[place * self.key_columns..];
            self.write_products(mixed, mixed_slopes, &mut scratch.products);
            self.divide(mixed_slopes, &kept.sums[place..][..self.queries], scratch);
            Product {
                rows: head_width,
                depth: self.queries,
                columns: self.key_columns,
                a: &scratch.divided,
                a_stride: self.query_columns,
                b: exponentials,
                b_stride: self.key_columns,
                start: Start::Zero,
                rectify: false,
                c: &mut value_slopes[key_rows.clone()],
                c_stride: self.key_columns,
            }
            .compute();
            self.pull_scores(exponentials, value, scratch);
            Product {
                rows: head_width,
                depth: self.queries,
                columns: self.key_columns,
                a: query,
                a_stride: self.query_columns,
                b: &scratch.scores,
                b_stride: self.key_columns,
                start: Start::Zero,
                rectify: false,
                c: &mut key_slopes[key_rows],
                c_stride: self.key_columns,
            }
            .compute();
            Product {
                rows: self.queries,
                depth: self.keys,
                columns: head_width,
                a: &scratch.scores,
                a_stride: self.key_columns,
                b: &scratch.keys,
                b_stride: features,
                start: Start::Zero,
                rectify: false,
                c: &mut scratch.queries,
                c_stride: head_width,
            }
            .compute();
            let query_slopes = &mut query_slopes[query_rows];
            let rows = &scratch.queries[..self.queries * head_width];
            turn(rows, head_width, head_width, 1.0, query_slopes, self.query_columns);
            for row in query_slopes.chunks_exact_mut(self.query_columns) {
                row[self.queries..].fill(0.0);
            }
        }
    }

    /// `δ` of every query.
    fn write_products(&self, mixed: &[f32], slopes: &[f32], products: &mut [f32]) {
        let products = &mut products[..self.query_columns];
        products.fill(0.0);
        let rows = mixed.chunks_exact(self.query_columns);
        for (row, slopes) in rows.zip(slopes.chunks_exact(self.query_columns)) {
            for ((product, x), slope) in products.iter_mut().zip(row).zip(slopes) {
                *product += x * slope;
            }
        }
    }

    /// Rows of exponentials are not divided by their sums; so the slopes of `O` are, as features × queries and turned over.
    fn divide(&self, slopes: &[f32], sums: &[f32], scratch: &mut AttentionScratch) {
        let AttentionScratch { queries, divided, factors, .. } = scratch;
        let factors = &mut factors[..self.query_columns];
        factors.fill(0.0);
        factors.iter_mut().zip(sums).for_each(|(factor, sum)| *factor = 1.0 / sum);
        let divided = &mut divided[..slopes.len()];
        let rows = divided.chunks_exact_mut(self.query_columns);
        for (row, slopes) in rows.zip(slopes.chunks_exact(self.query_columns)) {
            for ((x, slope), factor) in row.iter_mut().zip(slopes).zip(&*factors) {
                *x = slope * factor;
            }
        }
        turn(divided, self.query_columns, self.queries, 1.0, queries, self.head_width());
    }

    /// `∂S` of all queries.
    fn pull_scores(&self, exponentials: &[f32], value: &[f32], scratch: &mut AttentionScratch) {
        let head_width = self.head_width();
        let scale = 1.0 / (head_width as f32).sqrt();
        let AttentionScratch { queries, scores, factors, products, .. } = scratch;
        for first in (0..self.queries).step_by(QUERY_BLOCK) {
            let count = QUERY_BLOCK.min(self.queries - first);
            let block = first * self.key_columns..(first + count) * self.key_columns;
            let scores = &mut scores[block.clone()];
            Product {
                rows: count,
                depth: head_width,
                columns: self.key_columns,
                a: &queries[first * head_width..],
                a_stride: head_width,
                b: value,
                b_stride: self.key_columns,
                start: Start::Zero,
                rectify: false,
                c: scores,
                c_stride: self.key_columns,
            }
            .compute();
            let (exponentials, factors, products) =
                (&exponentials[block], &factors[first..], &products[first..]);
            Arch::new().dispatch(
                #[inline(always)]
                move || {
                    let scores = scores;
                    let rows = scores.chunks_exact_mut(self.key_columns);
                    let rows = rows.zip(exponentials.chunks_exact(self.key_columns));
                    let numbers = factors.iter().zip(products);
                    for ((row, exponentials), (factor, product)) in rows.zip(numbers) {
                        let product = product * factor;
                        for (score, exponential) in row.iter_mut().zip(exponentials) {
                            *score = (*score - product) * (exponential * scale);
                        }
                    }
                },
            );
        }
    }
}

/// Softmax before its division; keys that are not looked at become zero.
pub(super) fn exponentiate_rows(
    scores: &mut [f32],
    keys: usize,
    key_columns: usize,
    sums: &mut [f32],
) {
    Arch::new().dispatch(
        #[inline(always)]
        || {
            // Whole lanes: what fills them up must be small enough to vanish.
            let whole = keys.next_multiple_of(LANES);
            for (row, sum) in scores.chunks_exact_mut(key_columns).zip(sums) {
                row[keys..].fill(f32::MIN);
                *sum = exponentiate(&mut row[..whole]);
                row[keys..].fill(0.0);
            }
        },
    );
}

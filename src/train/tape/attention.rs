//! Attention of all heads (`spec/policy.md` §1.6), forward and back.
//!
//! For head `i` with `d_h` features of queries Q, keys K and values V: `P = softmax(Qᵀ K/√d_h)`, `O = V Pᵀ`. Forward keeps
//! the exponentials E and their sums s, `P = E/s`. Back, row by row of P with `δ = ∂O · O`:
//! `∂V += ∂O P`, `∂S = P (∂Oᵀ V − δ)/√d_h`, `∂Q = K ∂Sᵀ`, `∂K += Q ∂S`.
//!
//! Queries are worked off in blocks, so that a block's scores stay in the first-level cache.

use faer::traits::pulp::Arch;

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
    /// Queries × features of a head, or their slopes.
    queries: Vec<f32>,
    /// Keys × features of a head: keys or values.
    keys: Vec<f32>,
    /// A block of queries × features of a head.
    block: Vec<f32>,
    /// A block of queries × keys.
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
            keys: vec![0.0; columns * features],
            block: vec![0.0; QUERY_BLOCK * head_width],
            scores: vec![0.0; QUERY_BLOCK * columns],
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
                for ((query, row), sum) in
                    (first..).zip(scratch.block.chunks_exact(head_width)).zip(sums)
                {
                    for (feature, &x) in row.iter().enumerate() {
                        mixed[feature * self.query_columns + query] = x / *sum;
                    }
                }
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
        let scale = 1.0 / (head_width as f32).sqrt();
        for head in 0..self.heads {
            let (query_rows, key_rows) =
                (self.rows(head, self.query_columns), self.rows(head, self.key_columns));
            let (query, mixed, mixed_slopes) = (
                &query[query_rows.clone()],
                &mixed[query_rows.clone()],
                &mixed_slopes[query_rows.clone()],
            );
            let (key, value) = (&key[key_rows.clone()], &value[key_rows.clone()]);
            let (key_slopes, value_slopes) =
                (&mut key_slopes[key_rows.clone()], &mut value_slopes[key_rows.clone()]);
            let query_slopes = &mut query_slopes[query_rows];
            turn(
                mixed_slopes,
                self.query_columns,
                self.queries,
                1.0,
                &mut scratch.queries,
                head_width,
            );
            turn(key, self.key_columns, self.keys, 1.0, &mut scratch.keys, features);
            self.write_products(mixed, mixed_slopes, &mut scratch.products);
            for first in (0..self.queries).step_by(QUERY_BLOCK) {
                let count = QUERY_BLOCK.min(self.queries - first);
                let place = head * self.queries + first;
                let exponentials = &kept.exponentials[place * self.key_columns..];
                let sums = &kept.sums[place..place + count];
                // Rows of exponentials are not divided by their sums; so the slopes of O are.
                for ((factor, row), sum) in scratch.factors[..count]
                    .iter_mut()
                    .zip(scratch.queries[first * head_width..].chunks_exact_mut(head_width))
                    .zip(sums)
                {
                    *factor = 1.0 / sum;
                    row.iter_mut().for_each(|x| *x *= *factor);
                }
                let start = if first == 0 { Start::Zero } else { Start::Keep };
                let block = Block { first, count, start, head_width };
                self.pull_value(block, exponentials, scratch, value_slopes);
                self.pull_scores(block, exponentials, value, scale, scratch);
                Product {
                    rows: head_width,
                    depth: count,
                    columns: self.key_columns,
                    a: &query[first..],
                    a_stride: self.query_columns,
                    b: &scratch.scores,
                    b_stride: self.key_columns,
                    start,
                    rectify: false,
                    c: key_slopes,
                    c_stride: self.key_columns,
                }
                .compute();
                Product {
                    rows: count,
                    depth: self.keys,
                    columns: head_width,
                    a: &scratch.scores,
                    a_stride: self.key_columns,
                    b: &scratch.keys,
                    b_stride: features,
                    start: Start::Zero,
                    rectify: false,
                    c: &mut scratch.block,
                    c_stride: head_width,
                }
                .compute();
                let rows = scratch.block.chunks_exact(head_width);
                for (query, row) in (first..first + count).zip(rows) {
                    for (feature, &x) in row.iter().enumerate() {
                        query_slopes[feature * self.query_columns + query] = x;
                    }
                }
            }
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

    /// `∂V += ∂O P` for a block of queries.
    fn pull_value(
        &self,
        Block { first, count, start, head_width }: Block<'_>,
        exponentials: &[f32],
        scratch: &mut AttentionScratch,
        value_slopes: &mut [f32],
    ) {
        // The block's slopes of O, features × queries.
        let rows = &scratch.queries[first * head_width..(first + count) * head_width];
        turn(rows, head_width, head_width, 1.0, &mut scratch.block, QUERY_BLOCK);
        Product {
            rows: head_width,
            depth: count,
            columns: self.key_columns,
            a: &scratch.block,
            a_stride: QUERY_BLOCK,
            b: exponentials,
            b_stride: self.key_columns,
            start,
            rectify: false,
            c: value_slopes,
            c_stride: self.key_columns,
        }
        .compute();
    }

    /// `∂S` for a block of queries.
    fn pull_scores(
        &self,
        Block { first, count, head_width, .. }: Block<'_>,
        exponentials: &[f32],
        value: &[f32],
        scale: f32,
        scratch: &mut AttentionScratch,
    ) {
        let AttentionScratch { queries, scores, factors, products, .. } = scratch;
        let scores = &mut scores[..count * self.key_columns];
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
        Arch::new().dispatch(
            #[inline(always)]
            move || {
                let (scores, factors) = (scores, factors);
                let rows = scores.chunks_exact_mut(self.key_columns);
                let exponentials = exponentials.chunks_exact(self.key_columns);
                let numbers = factors.iter().zip(&products[first..]);
                for ((row, exponentials), (factor, product)) in rows.zip(exponentials).zip(numbers)
                {
                    let product = product * factor;
                    for (score, exponential) in row.iter_mut().zip(exponentials) {
                        *score = (*score - product) * (exponential * scale);
                    }
                }
            },
        );
    }
}

/// A block of queries.
#[derive(Clone, Copy)]
struct Block<'a> {
    first: usize,
    count: usize,
    start: Start<'a>,
    head_width: usize,
}

/// Softmax before its division; keys that are not looked at become zero.
fn exponentiate_rows(scores: &mut [f32], keys: usize, key_columns: usize, sums: &mut [f32]) {
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

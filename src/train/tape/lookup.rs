//! One query that looks at many tokens, without their keys and values (`spec/policy.md` §1.6).
//!
//! For head `i` with query `q`, tokens M (features × tokens), `k = W_K m + b_K` and `v = W_V m + b_V`: with `u = W_Kᵀ q` the
//! scores are `u · m/√d_h` and a number that all tokens share, which the softmax does not see; and with `c = M p` the head
//! gives `W_V c + b_V`. So two vectors for each head take the place of two matrices, and `∂b_K = 0`.
//!
//! Back, with `δ = ∂c · c`, `∂p = Mᵀ ∂c`, `s = p (∂p − δ)`: `∂u = M s/√d_h`, `∂M += ∂c pᵀ + u sᵀ/√d_h`.

use std::ops::Range;

use super::attention::exponentiate_rows;
use super::linear::Linear;
use super::product::{Product, Start};
use super::{lanes, turn};

/// Sizes of one look.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Lookup {
    pub width: usize,
    pub heads: usize,
    /// Tokens that are looked at, and the columns that hold them and others.
    pub tokens: usize,
    pub columns: usize,
}

/// What backward needs.
#[derive(Debug, Clone)]
pub struct LookedUp {
    /// Heads × columns: `p`.
    shares: Vec<f32>,
    /// Heads × features: `u/√d_h` in units of ln 2.
    questions: Vec<f32>,
    /// Heads × features: `c`.
    answers: Vec<f32>,
}

/// Memory of one thread.
#[derive(Debug, Clone)]
pub struct LookupScratch {
    sums: Vec<f32>,
    /// Tokens × heads: `p` or `s`.
    turned: Vec<f32>,
    /// Features × heads: `c` or `∂u`; features × twice the heads: `∂c` and `u/√d_h`.
    features: Vec<f32>,
    /// Heads × features: `∂c`, then `u/√d_h`.
    slopes: Vec<f32>,
    /// Heads × columns: `p`, then `∂p` and `s`.
    rows: Vec<f32>,
}

impl LookedUp {
    #[must_use]
    pub fn new(width: usize, heads: usize, columns: usize) -> Self {
        Self {
            shares: vec![0.0; heads * columns],
            questions: vec![0.0; heads * width],
            answers: vec![0.0; heads * width],
        }
    }
}

impl LookupScratch {
    #[must_use]
    pub fn new(width: usize, heads: usize, columns: usize) -> Self {
        Self {
            sums: vec![0.0; heads],
            turned: vec![0.0; columns * lanes(heads)],
            features: vec![0.0; width * 2 * heads],
            slopes: vec![0.0; 2 * heads * width],
            rows: vec![0.0; 2 * heads * columns],
        }
    }
}

impl Lookup {
    fn head_width(&self) -> usize {
        self.width / self.heads
    }

    /// Features of a head, in the query and among keys.
    fn keys(&self, head: usize) -> Range<usize> {
        head * self.head_width()..(head + 1) * self.head_width()
    }

    /// The same among values, which come after the keys.
    fn values(&self, head: usize) -> Range<usize> {
        let Range { start, end } = self.keys(head);
        self.width + start..self.width + end
    }

    /// Writes the heads' values side by side to `mixed`.
    pub fn apply(
        &self,
        query: &[f32],
        memory: &[f32],
        key_value: &Linear,
        kept: &mut LookedUp,
        scratch: &mut LookupScratch,
        mixed: &mut [f32],
    ) {
        let scale = std::f32::consts::LOG2_E / (self.head_width() as f32).sqrt();
        kept.questions.fill(0.0);
        for (head, question) in kept.questions.chunks_exact_mut(self.width).enumerate() {
            let keys = self.keys(head);
            key_value.pull_one_input(keys.clone(), &query[keys], question);
            question.iter_mut().for_each(|u| *u *= scale);
        }
        let shares = &mut kept.shares[..self.heads * self.columns];
        self.score(&kept.questions, memory, shares);
        exponentiate_rows(shares, self.tokens, self.columns, &mut scratch.sums);
        for (row, sum) in shares.chunks_exact_mut(self.columns).zip(&scratch.sums) {
            row.iter_mut().for_each(|p| *p /= sum);
        }
        self.gather(shares, memory, 1.0, scratch, &mut kept.answers);
        for (head, answer) in kept.answers.chunks_exact(self.width).enumerate() {
            let mixed = &mut mixed[self.keys(head)];
            key_value.apply_to_one(self.values(head), answer, false, mixed);
        }
    }

    /// Derivatives by the query (set) and by the tokens (added), from those by `mixed`.
    #[expect(clippy::too_many_arguments, reason = "memory is the caller's")]
    pub fn pull(
        &self,
        query: &[f32],
        memory: &[f32],
        key_value: &Linear,
        mixed_slopes: &[f32],
        kept: &LookedUp,
        scratch: &mut LookupScratch,
        query_slopes: &mut [f32],
        memory_slopes: &mut [f32],
        gradient: &mut [f32],
    ) {
        let size = self.heads * self.columns;
        let (answer_slopes, questions) = scratch.slopes.split_at_mut(self.heads * self.width);
        answer_slopes.fill(0.0);
        let answers = kept.answers.chunks_exact(self.width);
        for (head, (answer, slopes)) in
            answers.zip(answer_slopes.chunks_exact_mut(self.width)).enumerate()
        {
            let mixed_slopes = &mixed_slopes[self.keys(head)];
            key_value.pull_one(self.values(head), answer, mixed_slopes, slopes, gradient);
        }
        for (u, question) in questions.iter_mut().zip(&kept.questions) {
            *u = question * std::f32::consts::LN_2;
        }
        let (shares, scores) = scratch.rows[..2 * size].split_at_mut(size);
        shares.copy_from_slice(&kept.shares[..size]);
        self.score(answer_slopes, memory, scores);
        for (head, (scores, shares)) in
            scores.chunks_exact_mut(self.columns).zip(shares.chunks_exact(self.columns)).enumerate()
        {
            let features = head * self.width..(head + 1) * self.width;
            let answers = kept.answers[features.clone()].iter().zip(&answer_slopes[features]);
            let product = answers.map(|(c, slope)| c * slope).sum::<f32>();
            scores.iter_mut().zip(shares).for_each(|(s, p)| *s = p * (*s - product));
        }
        turn(&scratch.slopes, self.width, self.width, 1.0, &mut scratch.features, 2 * self.heads);
        Product {
            rows: self.width,
            depth: 2 * self.heads,
            columns: self.columns,
            a: &scratch.features,
            a_stride: 2 * self.heads,
            b: &scratch.rows[..2 * size],
            b_stride: self.columns,
            start: Start::Keep,
            rectify: false,
            c: memory_slopes,
            c_stride: self.columns,
        }
        .compute();
        // The answers' slopes have done their work; now their place holds the questions'.
        let scale = 1.0 / (self.head_width() as f32).sqrt();
        let (rows, mut slopes) =
            (std::mem::take(&mut scratch.rows), std::mem::take(&mut scratch.slopes));
        self.gather(&rows[size..2 * size], memory, scale, scratch, &mut slopes);
        for (head, slopes) in slopes.chunks_exact(self.width).take(self.heads).enumerate() {
            let keys = self.keys(head);
            key_value.multiply_one(keys.clone(), slopes, &mut query_slopes[keys.clone()]);
            key_value.pull_one_weight(keys.clone(), slopes, &query[keys], gradient);
        }
        (scratch.rows, scratch.slopes) = (rows, slopes);
    }

    /// One row for each head: what `vectors` (heads × features) have in common with every token.
    fn score(&self, vectors: &[f32], memory: &[f32], rows: &mut [f32]) {
        Product {
            rows: self.heads,
            depth: self.width,
            columns: self.columns,
            a: vectors,
            a_stride: self.width,
            b: memory,
            b_stride: self.columns,
            start: Start::Zero,
            rectify: false,
            c: rows,
            c_stride: self.columns,
        }
        .compute();
    }

    /// One vector for each head: the tokens' sum, each times its number in the head's row and `scale`.
    fn gather(
        &self,
        rows: &[f32],
        memory: &[f32],
        scale: f32,
        scratch: &mut LookupScratch,
        vectors: &mut [f32],
    ) {
        let stride = lanes(self.heads);
        turn(rows, self.columns, self.tokens, scale, &mut scratch.turned, stride);
        let sums = &mut scratch.features[..self.width * self.heads];
        Product {
            rows: self.width,
            depth: self.tokens,
            columns: self.heads,
            a: memory,
            a_stride: self.columns,
            b: &scratch.turned,
            b_stride: stride,
            start: Start::Zero,
            rectify: false,
            c: sums,
            c_stride: self.heads,
        }
        .compute();
        turn(sums, self.heads, self.heads, 1.0, vectors, self.width);
    }
}

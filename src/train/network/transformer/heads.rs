//! The heads: linear maps from decoded columns to numbers, and the standard deviations of actions
//! (`spec/policy.md` §1.8).
//!
//! With `z` the scale head of the (held) decoded queries, `p = softmax(z)` and `u = exp(p)` over the entries of an action:
//! `ln σ = log_std + p − ln mean(u)`. The mean is over one observation's entries, as this program plays, or over the whole
//! minibatch, padding included, as the published training has it ([`Spread`]).

use std::ops::Range;

use crate::train::tape::sum;

/// Over what the shape of the standard deviations is averaged.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub enum Spread {
    /// The action of one observation: the density of an action does not depend on its neighbours.
    #[default]
    Observation,
    /// All actions of the minibatch: the published code. It takes a second pass forward.
    Minibatch,
}

/// A linear map to one number.
#[derive(Debug, Clone)]
pub(super) struct Head {
    pub(super) weight: Range<usize>,
    pub(super) bias: usize,
}

impl Head {
    /// One number for each column of `x`.
    pub(super) fn apply(&self, numbers: &[f32], x: &[f32], columns: usize, y: &mut [f32]) {
        let y = &mut y[..columns];
        y.fill(numbers[self.bias]);
        for (row, &w) in x.chunks_exact(columns).zip(&numbers[self.weight.clone()]) {
            y.iter_mut().zip(row).for_each(|(y, x)| *y += x * w);
        }
    }

    /// Adds to the derivatives by weight and bias. `slopes` are zero in columns that only fill up.
    pub(super) fn pull_weight(&self, x: &[f32], slopes: &[f32], gradient: &mut [f32]) {
        let columns = slopes.len();
        for (row, w) in x.chunks_exact(columns).zip(&mut gradient[self.weight.clone()]) {
            *w += row.iter().zip(slopes).map(|(x, s)| x * s).sum::<f32>();
        }
        gradient[self.bias] += sum(slopes);
    }

    /// Writes the derivatives by `x`.
    pub(super) fn pull_input(&self, numbers: &[f32], slopes: &[f32], x_slopes: &mut [f32]) {
        let rows = x_slopes.chunks_exact_mut(slopes.len());
        for (row, &w) in rows.zip(&numbers[self.weight.clone()]) {
            row.iter_mut().zip(slopes).for_each(|(x, s)| *x = w * s);
        }
    }
}

/// The shape of one action's standard deviations.
#[derive(Debug, Clone, Default)]
pub(super) struct Shape {
    /// `p`.
    shares: Vec<f64>,
    /// `u`.
    spreads: Vec<f64>,
}

impl Shape {
    /// From the scale head's numbers, one for each entry of the action.
    pub(super) fn set(&mut self, logits: impl Iterator<Item = f32> + Clone) {
        let largest = logits.clone().fold(f32::NEG_INFINITY, f32::max);
        self.shares.clear();
        self.shares.extend(logits.map(|z| f64::from(z - largest).exp()));
        let total: f64 = self.shares.iter().sum();
        self.shares.iter_mut().for_each(|p| *p /= total);
        self.spreads.clear();
        self.spreads.extend(self.shares.iter().map(|p| p.exp()));
    }

    /// `Σ u`.
    pub(super) fn total(&self) -> f64 {
        self.spreads.iter().sum()
    }

    /// Writes `ln σ`, given `log_std` and the mean of `u`.
    pub(super) fn write(&self, log_deviation: f32, mean: f64, log_deviations: &mut [f32]) {
        for (log, p) in log_deviations.iter_mut().zip(&self.shares) {
            *log = (f64::from(log_deviation) + p - mean.ln()) as f32;
        }
    }

    /// Derivatives by the scale head's numbers of `Σ slopes · p`, written entry by entry by `write`.
    fn through_softmax(&self, slope: impl Fn(usize) -> f64, mut write: impl FnMut(usize, f64)) {
        let along: f64 = self.shares.iter().enumerate().map(|(i, p)| p * slope(i)).sum();
        for (i, p) in self.shares.iter().enumerate() {
            write(i, p * (slope(i) - along));
        }
    }

    /// Derivatives by the scale head's numbers, from those by `ln σ`, when the mean is over this action.
    pub(super) fn pull(&self, slopes: &[f32], write: impl FnMut(usize, f64)) {
        let sum: f64 = slopes.iter().map(|&s| f64::from(s)).sum();
        let total = self.total();
        self.through_softmax(|i| f64::from(slopes[i]) - sum * self.spreads[i] / total, write);
    }

    /// The part of them that does not come through the mean.
    pub(super) fn pull_direct(&self, slopes: &[f32], write: impl FnMut(usize, f64)) {
        self.through_softmax(|i| f64::from(slopes[i]), write);
    }

    /// The derivatives of `Σ u`.
    pub(super) fn pull_total(&self, write: impl FnMut(usize, f64)) {
        self.through_softmax(|i| self.spreads[i], write);
    }
}

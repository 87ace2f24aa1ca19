//! The transformer that attends over time (`spec/policy.md` §2.3), inference only; the paper's bilateral model.
//!
//! Two encoders take the place of the one: the *muscle encoder* lets the tokens of one moment look at each other; then a
//! code of the moment is added, and the *time encoder* lets every token look at its own past. The decoder, which actor
//! and critic share, asks the newest moment:
//!
//! `M_t = muscle_encoder(tokens_t) + code(t)`, `H = time_encoder(M_0 … M_now)` per token,
//! `actions = decoder(queries + code(now), H_now)`,
//!
//! with `code(t)[2i] = sin(t · 10000^(−2i/d))` and `code(t)[2i + 1]` the cosine of the same angle. A moment's `M_t` never
//! changes, so it is computed once and kept by whoever plays.

use super::attention::Keys;
use super::layers::{Scratch, Sizes};
use super::transformer::{Encoder, TaskConstants, Transformer, Workspace};
use super::weights::Weights;
use crate::policy::PolicyError;
use crate::policy::checkpoint::contents::TensorMap;

/// The network of one checkpoint.
#[derive(Debug, Clone)]
pub struct TemporalTransformer {
    /// Tokens, decoder and heads; its encoder is in the file and unused.
    base: Transformer,
    muscle_encoder: Encoder,
    time_encoder: Encoder,
}

/// Memory for one body's way through the network.
#[derive(Debug, Clone)]
pub struct TemporalWorkspace {
    inner: Workspace,
    /// One token's past, moments × width.
    past: Vec<f32>,
    encoded: Vec<f32>,
    scratch: Scratch,
    code: Vec<f32>,
}

impl TemporalTransformer {
    /// Reads the network off a checkpoint's tensors. The scale head is used if `scaled_variance`.
    pub fn from_tensors(
        tensors: &TensorMap,
        heads: usize,
        scaled_variance: bool,
    ) -> Result<Self, PolicyError> {
        let base = Transformer::from_tensors(tensors, heads, scaled_variance)?;
        let weights = Weights(tensors);
        let encoder = |name| Encoder::read(weights, name, base.sizes());
        Ok(Self {
            muscle_encoder: encoder("mlp_extractor.muscle_encoder")?,
            time_encoder: encoder("mlp_extractor.time_encoder")?,
            base,
        })
    }

    /// The parts it shares with the transformer without time.
    #[must_use]
    pub fn base(&self) -> &Transformer {
        &self.base
    }

    #[must_use]
    pub fn sizes(&self) -> &Sizes {
        self.base.sizes()
    }

    /// Memory for `task`, looking at up to `moments` moments.
    #[must_use]
    pub fn workspace(&self, task: &TaskConstants, moments: usize) -> TemporalWorkspace {
        let zeros = vec![0.0; moments * self.sizes().width];
        TemporalWorkspace {
            inner: self.base.workspace(task),
            past: zeros.clone(),
            encoded: zeros,
            scratch: Scratch::new(self.sizes(), moments),
            code: vec![0.0; self.sizes().width],
        }
    }

    /// What a moment `time` steps into the episode leaves for later ones: tokens × width, written to `moment`.
    pub fn encode_moment(
        &self,
        task: &TaskConstants,
        windows: &[f32],
        time: usize,
        moment: &mut [f32],
        workspace: &mut TemporalWorkspace,
    ) {
        self.base.embed(task, windows, &mut workspace.inner);
        let Workspace { stream, scratch, .. } = &mut workspace.inner;
        self.muscle_encoder.apply(stream, Keys::All, moment, scratch);
        write_code(time, &mut workspace.code);
        add_to_each(moment, &workspace.code);
    }

    /// Means of the actions at the newest of several moments, `time` steps into the episode. The moments were written
    /// by [`Self::encode_moment`] to `ring` and begin there at `starts`, from oldest to newest.
    pub fn action_means(
        &self,
        task: &TaskConstants,
        (ring, starts): (&[f32], &[usize]),
        time: usize,
        means: &mut [f32],
        workspace: &mut TemporalWorkspace,
    ) {
        let width = self.sizes().width;
        let TemporalWorkspace { inner, past, encoded, scratch, code } = workspace;
        let past = &mut past[..starts.len() * width];
        let encoded = &mut encoded[..starts.len() * width];
        for (token, memory) in inner.memory.chunks_exact_mut(width).enumerate() {
            for (row, start) in past.chunks_exact_mut(width).zip(starts) {
                row.copy_from_slice(&ring[start + token * width..][..width]);
            }
            self.time_encoder.apply(past, Keys::Past, encoded, scratch);
            memory.copy_from_slice(&encoded[encoded.len() - width..]);
        }
        inner.queries.copy_from_slice(&task.query_words);
        write_code(time, code);
        add_to_each(&mut inner.queries, code);
        self.base.decode_actions(task, false, inner, means);
    }

    /// Standard deviations of the actions decoded last; see [`Transformer::standard_deviations`].
    pub fn standard_deviations(&self, workspace: &TemporalWorkspace, deviations: &mut [f32]) {
        self.base.standard_deviations(&workspace.inner, deviations);
    }
}

/// The code of a moment.
fn write_code(time: usize, code: &mut [f32]) {
    let width = code.len() as f64;
    for (feature, x) in code.iter_mut().enumerate() {
        let pair = (feature - feature % 2) as f64;
        let angle = time as f64 * 10_000_f64.powf(-pair / width);
        *x = if feature % 2 == 0 { angle.sin() } else { angle.cos() } as f32;
    }
}

fn add_to_each(rows: &mut [f32], row: &[f32]) {
    for target in rows.chunks_exact_mut(row.len()) {
        for (x, &c) in target.iter_mut().zip(row) {
            *x += c;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_code_of_a_moment_is_sines_and_cosines_of_falling_frequency() {
        let mut code = [0.0; 4];
        write_code(3, &mut code);
        // Width 4: angles 3 and 3/100.
        let want = [3_f64.sin(), 3_f64.cos(), 0.03_f64.sin(), 0.03_f64.cos()];
        for (got, want) in code.iter().zip(want) {
            assert!((f64::from(*got) - want).abs() < 1e-7, "{code:?}");
        }
    }
}

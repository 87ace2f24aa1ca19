//! The transformer against `<name>_<task>.npz` and `<name>_padded_batch.npz`.

use std::path::Path;

use super::{Comparison, PolicyCheck, VerifyError};
use crate::npz::{Array, ArrayError, Arrays};
use crate::policy::PolicyError;
use crate::policy::checkpoint::{self, Limits};
use crate::policy::interface::{Policy, TaskInterface};
use crate::policy::loading::load_transformer;
use crate::policy::network::transformer::Transformer;
use crate::policy::policies::transformer::TransformerPolicy;

/// Files that carry the policy's name and hold something else.
const OTHER_RECORDINGS: [&str; 2] = ["param_sums", "vecnormalize_dump"];

/// Compares every recording of policy `name`.
pub(super) fn verify(
    folder: &Path,
    name: &str,
    files: &[String],
) -> Result<Vec<PolicyCheck>, VerifyError> {
    let limits = Limits::default();
    let path = folder.join(format!("{name}_model.zip"));
    let checkpoint = checkpoint::open(&path, &limits)?;
    let normaliser = folder.join(format!("{name}_model_vecnormalize.pkl"));
    let normaliser = checkpoint::open_normaliser(&normaliser, &limits)?;
    let policy = load_transformer(&checkpoint, Some(&normaliser))
        .map_err(|source| VerifyError::Policy { source, path })?;

    let mut checks = Vec::new();
    for file in files {
        let Some(recording) = file.strip_suffix(".npz").and_then(|stem| stem.strip_prefix(name))
        else {
            continue;
        };
        let Some(recording) = recording.strip_prefix('_') else { continue };
        if OTHER_RECORDINGS.contains(&recording) {
            continue;
        }
        let path = folder.join(file);
        // The list of task names is text, which the array reader refuses.
        let arrays = Arrays::open_some(&path, |array| array != "tasks")
            .map_err(|source| VerifyError::Array { source, path: path.clone() })?;
        let compared = if recording == "padded_batch" {
            verify_padded_batch(policy.network(), &arrays)
        } else {
            verify_task(&policy, recording, &arrays)
        };
        let comparisons = compared.map_err(|failure| failure.at(&path))?;
        checks.extend(comparisons.into_iter().map(|comparison| comparison.finish(file)));
    }
    Ok(checks)
}

/// What can go wrong inside one recording.
pub(super) enum Failure {
    Array(ArrayError),
    Policy(PolicyError),
}

impl Failure {
    pub(super) fn at(self, path: &Path) -> VerifyError {
        let path = path.to_path_buf();
        match self {
            Self::Array(source) => VerifyError::Array { source, path },
            Self::Policy(source) => VerifyError::Policy { source, path },
        }
    }
}

impl From<ArrayError> for Failure {
    fn from(error: ArrayError) -> Self {
        Self::Array(error)
    }
}

impl From<PolicyError> for Failure {
    fn from(error: PolicyError) -> Self {
        Self::Policy(error)
    }
}

/// One recording: several observations of one task.
fn verify_task(
    policy: &TransformerPolicy,
    task: &str,
    arrays: &Arrays,
) -> Result<Vec<Comparison>, Failure> {
    let network = policy.network();
    let width = network.sizes().width;
    let observation_words = words_of(arrays.get("obs_ids")?);
    let action_words = words_of(arrays.get("action_ids")?);
    let constants = network.prepare(task, &observation_words, &action_words, false)?;
    let mut workspace = network.workspace(&constants);
    let normaliser = policy.normaliser(&observation_words);

    let muscles = action_words.len();
    let raw = floats(arrays, "obs_raw", &[])?;
    let rows = arrays.get("obs_raw")?.rows();
    let window = observation_words.len() * network.sizes().lags;
    let recorded = |name: &str, columns: usize| floats(arrays, name, &[rows, columns]);
    let recorded_windows = recorded("obs_norm", window)?;
    let recorded_norms = recorded("enc_token_norm", observation_words.len())?;
    let recorded_means = recorded("action_mean", muscles)?;
    let recorded_deviations = recorded("sigma", muscles)?;
    let recorded_batch_means = recorded("batch_mean", muscles)?;
    let recorded_values = recorded("value", 1)?;
    let recorded_log_probabilities = recorded("log_prob", 1)?;

    let mut normalised = Comparison::new("normalised observation");
    let mut token_norm = Comparison::new("encoded token norm");
    let mut mean = Comparison::new("action mean");
    let mut batch_mean = Comparison::new("action mean in a batch");
    let mut deviation = Comparison::new("standard deviation");
    let mut log_probability = Comparison::new("log-probability");
    let mut value = Comparison::new("value");
    let mut batch_deviation = Comparison::new("standard deviation in a batch");

    let mut windows = vec![0.0; window];
    let (mut means, mut deviations) = (vec![0.0; muscles], vec![0.0; muscles]);
    let mut logits = Vec::new();
    for row in 0..rows {
        let of_window = row * window..(row + 1) * window;
        let of_muscles = row * muscles..(row + 1) * muscles;
        normaliser.apply(&raw[of_window.clone()], &mut windows);
        normalised.add(&windows, &recorded_windows[of_window]);

        network.encode(&constants, &windows, &mut workspace);
        let norms: Vec<f32> = workspace
            .memory()
            .chunks_exact(width)
            .map(|token| token.iter().map(|x| x * x).sum::<f32>().sqrt())
            .collect();
        token_norm.add(&norms, &recorded_norms[row * norms.len()..(row + 1) * norms.len()]);

        network.action_means(&constants, &mut workspace, &mut means);
        mean.add(&means, &recorded_means[of_muscles.clone()]);
        batch_mean.add(&means, &recorded_batch_means[of_muscles.clone()]);
        network.standard_deviations(&workspace, &mut deviations);
        deviation.add(&deviations, &recorded_deviations[of_muscles]);
        log_probability.add(
            &[log_probability_at_half_sigma(&deviations)],
            &recorded_log_probabilities[row..=row],
        );
        logits.push(network.scale_logits(&workspace).unwrap_or_default());
        value.add(&[network.value(&constants, &mut workspace)], &recorded_values[row..=row]);
    }
    let batch = sigma_of_batch(network.log_standard_deviation(), &logits);
    batch_deviation.add(&batch, &recorded("batch_sigma", muscles)?);

    let played = play(policy, task, observation_words, action_words, &raw[..window])?;
    let mut actor = Comparison::new("action mean after six steps");
    actor.add(&played, &recorded_means[..muscles]);
    Ok(vec![
        normalised,
        token_norm,
        mean,
        batch_mean,
        deviation,
        batch_deviation,
        log_probability,
        value,
        actor,
    ])
}

/// Feeds the frames of one recorded window to a bound policy, oldest first, and returns the last action.
fn play(
    policy: &TransformerPolicy,
    task: &str,
    observation_words: Vec<Vec<u16>>,
    action_words: Vec<Vec<u16>>,
    window: &[f32],
) -> Result<Vec<f32>, PolicyError> {
    let lags = policy.network().sizes().lags;
    let task = TaskInterface {
        task: task.to_owned(),
        muscle_count: action_words.len(),
        muscle_observation_length: observation_words.len(),
        clean_observation_length: 0,
        observation_words,
        action_words,
        muscle_models: Vec::new(),
    };
    let mut actor = policy.bind(&task, 1)?;
    let mut means = vec![0.0; task.muscle_count];
    actor.reset(0);
    for lag in 0..lags {
        let frame: Vec<f32> = window.iter().copied().skip(lag).step_by(lags).collect();
        actor.act(&[0], &frame, &mut means, None);
    }
    Ok(means)
}

/// One observation of every task in one batch, padded to the largest of them. Padding tokens are left out; padding
/// muscles count in σ, whose denominator is the mean over the whole batch.
fn verify_padded_batch(network: &Transformer, arrays: &Arrays) -> Result<Vec<Comparison>, Failure> {
    let lags = network.sizes().lags;
    let token_masks = arrays.get("obs_mask")?;
    let muscle_masks = arrays.get("action_ids_mask")?;
    let rows = token_masks.rows();
    let (tokens, muscles) = (columns(token_masks), columns(muscle_masks));
    let windows = floats(arrays, "obs", &[rows, tokens * lags])?;
    let observation_words = words_of(arrays.get("obs_ids")?);
    let action_words = words_of(arrays.get("action_ids")?);
    let recorded_means = floats(arrays, "mean", &[rows, muscles])?;
    let recorded_values = floats(arrays, "value", &[rows, 1])?;

    let mut mean = Comparison::new("action mean in a padded batch");
    let mut value = Comparison::new("value in a padded batch");
    let mut deviation = Comparison::new("standard deviation in a padded batch");
    let mut logits = Vec::new();
    for row in 0..rows {
        let (first_token, first_muscle) = (row * tokens, row * muscles);
        let token_count = unmasked(token_masks, row);
        let muscle_count = unmasked(muscle_masks, row);
        let constants = network.prepare(
            "padded batch",
            &observation_words[first_token..first_token + token_count],
            &action_words[first_muscle..first_muscle + muscle_count],
            true,
        )?;
        let mut workspace = network.workspace(&constants);
        let window = &windows[first_token * lags..(first_token + token_count) * lags];
        network.encode(&constants, window, &mut workspace);
        let mut means = vec![0.0; muscle_count];
        network.action_means(&constants, &mut workspace, &mut means);
        mean.add(&means, &recorded_means[first_muscle..first_muscle + muscle_count]);
        let mut of_row = network.scale_logits(&workspace).unwrap_or_default();
        let padding = of_row.pop().unwrap_or(0.0);
        of_row.resize(muscles, padding);
        logits.push(of_row);
        value.add(&[network.value(&constants, &mut workspace)], &recorded_values[row..=row]);
    }
    let sigma = sigma_of_batch(network.log_standard_deviation(), &logits);
    deviation.add(&sigma, &floats(arrays, "sigma", &[rows, muscles])?);
    Ok(vec![mean, value, deviation])
}

/// σ of a whole batch, row after row, from the scale logits of its rows: the denominator is the mean over all of them.
fn sigma_of_batch(log_standard_deviation: f32, logits: &[Vec<f32>]) -> Vec<f32> {
    let spreads: Vec<f64> = logits
        .iter()
        .flat_map(|row| {
            let largest = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
            let weights: Vec<f64> = row.iter().map(|&z| f64::from(z - largest).exp()).collect();
            let sum: f64 = weights.iter().sum();
            weights.into_iter().map(move |weight| (weight / sum).exp())
        })
        .collect();
    let mean = spreads.iter().sum::<f64>() / spreads.len() as f64;
    let base = f64::from(log_standard_deviation).exp();
    spreads.iter().map(|spread| (base * spread / mean) as f32).collect()
}

/// Log-probability of the action `mean + σ/2`, summed over the muscles.
fn log_probability_at_half_sigma(deviations: &[f32]) -> f32 {
    let half_ln_two_pi = 0.5 * std::f64::consts::TAU.ln();
    let terms = deviations.iter().map(|&s| -0.125 - f64::from(s).ln() - half_ln_two_pi);
    terms.sum::<f64>() as f32
}

/// The ids of each row of the last axis, without padding.
fn words_of(ids: &Array) -> Vec<Vec<u16>> {
    let longest = ids.shape.last().copied().unwrap_or(1).max(1);
    let word = |&id: &f64| (id > 0.0).then_some(id as u16);
    ids.to_f64().chunks(longest).map(|row| row.iter().filter_map(word).collect()).collect()
}

fn columns(array: &Array) -> usize {
    array.shape.get(1).copied().unwrap_or(1)
}

/// How many entries of a row of a mask are false.
fn unmasked(mask: &Array, row: usize) -> usize {
    let columns = columns(mask);
    mask.to_f32()[row * columns..(row + 1) * columns].iter().filter(|&&x| x < 0.5).count()
}

/// All numbers of array `name`, which must be as many as `expected` says, if it says anything.
pub(super) fn floats(
    arrays: &Arrays,
    name: &str,
    expected: &[usize],
) -> Result<Vec<f32>, ArrayError> {
    let array = arrays.get(name)?;
    let numbers = array.to_f32();
    if expected.is_empty() || expected.iter().product::<usize>() == numbers.len() {
        return Ok(numbers);
    }
    Err(ArrayError::Shape {
        array: name.to_owned(),
        expected: format!("{expected:?}"),
        found: array.shape.clone(),
    })
}

//! The published recurrent policy along recorded episodes, and natural-policy-gradient policies on recorded
//! observations.

use std::path::{Path, PathBuf};

use super::transformer::{Failure, floats};
use super::{Comparison, PolicyCheck, VerifyError};
use crate::npz::Arrays;
use crate::policy::checkpoint::{self, Limits};
use crate::policy::interface::{Policy, TaskInterface};
use crate::policy::loading::load_recurrent;
use crate::policy::policies::mlp::MlpPolicy;
use crate::policy::policies::recurrent::RecurrentPolicy;

/// Where the recurrent policy and its normaliser lie below the folder that holds the recordings' folder.
const RECURRENT_FOLDER: &str = "myochallenge2022_baoding_ppo_lstm";
const RECURRENT_CHECKPOINT: &str = "phase1_final.zip";
const RECURRENT_NORMALISER: &str = "normalized_env_phase1_final.pkl";

/// Compares every recorded episode of the recurrent policy.
pub(super) fn verify_recurrent(
    folder: &Path,
    files: &[String],
) -> Result<Vec<PolicyCheck>, VerifyError> {
    let recordings: Vec<&String> =
        files.iter().filter(|file| lies_between(file, "baoding_phase1_", ".npz")).collect();
    if recordings.is_empty() {
        return Ok(Vec::new());
    }
    let Some(home) = recurrent_folder(folder) else {
        let why = format!("the policy `{RECURRENT_FOLDER}/{RECURRENT_CHECKPOINT}` is not there");
        return Ok(recordings.iter().map(|file| PolicyCheck::skipped(file, &why)).collect());
    };
    let limits = Limits::default();
    let path = home.join(RECURRENT_CHECKPOINT);
    let checkpoint = checkpoint::open(&path, &limits)?;
    let normaliser = checkpoint::open_normaliser(&home.join(RECURRENT_NORMALISER), &limits)?;
    let policy = load_recurrent(&checkpoint, Some(&normaliser))
        .map_err(|source| VerifyError::Policy { source, path })?;

    let mut checks = Vec::new();
    for file in recordings {
        let path = folder.join(file);
        let arrays = Arrays::open(&path)
            .map_err(|source| VerifyError::Array { source, path: path.clone() })?;
        let comparisons = verify_episode(&policy, &arrays).map_err(|failure| failure.at(&path))?;
        checks.extend(comparisons.into_iter().map(|comparison| comparison.finish(file)));
    }
    Ok(checks)
}

fn lies_between(name: &str, prefix: &str, suffix: &str) -> bool {
    name.strip_prefix(prefix).is_some_and(|rest| rest.strip_suffix(suffix).is_some())
}

fn recurrent_folder(folder: &Path) -> Option<PathBuf> {
    let folder = folder.canonicalize().ok()?;
    folder.ancestors().skip(1).take(2).find_map(|above| {
        let home = above.join("checkpoints").join(RECURRENT_FOLDER);
        home.join(RECURRENT_CHECKPOINT).is_file().then_some(home)
    })
}

/// One recorded episode: the recurrent states follow from the observations alone.
fn verify_episode(policy: &RecurrentPolicy, arrays: &Arrays) -> Result<Vec<Comparison>, Failure> {
    let network = policy.network();
    let observations = arrays.get("obs")?;
    let (steps, length) = (observations.rows(), network.observation_length());
    let muscles = network.muscle_count();
    let actor = network.actor();
    let width = actor.initial_state().hidden.len();
    let recorded = |name: &str, columns: usize| floats(arrays, name, &[steps, columns]);
    let raw = recorded("obs", length)?;
    let recorded_inputs = recorded("obs_norm", length)?;
    let recorded_means = recorded("action_raw", muscles)?;
    let recorded_actions = recorded("action", muscles)?;
    let (recorded_hidden, recorded_cell) = (recorded("h_pi", width)?, recorded("c_pi", width)?);
    let recorded_values = recorded("value", 1)?;

    let mut normalised = Comparison::new("normalised observation");
    let mut hidden = Comparison::new("actor hidden state");
    let mut cell = Comparison::new("actor cell state");
    let mut mean = Comparison::new("action mean");
    let mut clipped = Comparison::new("clipped action");
    let mut value = Comparison::new("value");
    let mut critic_hidden = Comparison::new("critic hidden state");
    let mut critic_cell = Comparison::new("critic cell state");
    let mut played = Comparison::new("action mean through the actor");

    let mut bound = policy.bind(&clean_task(length, muscles), 1)?;
    bound.reset(0);
    let (mut state, mut scratch) = (actor.initial_state(), actor.scratch());
    let mut critic =
        network.critic().map(|critic| (critic, critic.initial_state(), critic.scratch()));
    let mut input = vec![0.0; length];
    let mut means = vec![0.0; muscles];
    for step in 0..steps {
        let of_input = step * length..(step + 1) * length;
        let of_state = step * width..(step + 1) * width;
        let of_muscles = step * muscles..(step + 1) * muscles;
        network.normaliser().apply(&raw[of_input.clone()], &mut input);
        normalised.add(&input, &recorded_inputs[of_input.clone()]);
        actor.step(&input, &mut state, &mut scratch, &mut means);
        hidden.add(&state.hidden, &recorded_hidden[of_state.clone()]);
        cell.add(&state.cell, &recorded_cell[of_state.clone()]);
        mean.add(&means, &recorded_means[of_muscles.clone()]);
        let actions: Vec<f32> = means.iter().map(|x| x.clamp(-1.0, 1.0)).collect();
        clipped.add(&actions, &recorded_actions[of_muscles.clone()]);
        if let Some((critic, state, scratch)) = &mut critic {
            let mut estimate = [0.0];
            critic.step(&input, state, scratch, &mut estimate);
            value.add(&estimate, &recorded_values[step..=step]);
            critic_hidden.add(&state.hidden, &recorded("h_vf", width)?[of_state.clone()]);
            critic_cell.add(&state.cell, &recorded("c_vf", width)?[of_state]);
        }
        bound.act(&[0], &raw[of_input], &mut means, None);
        played.add(&means, &recorded_means[of_muscles]);
    }
    let mut comparisons = vec![normalised, hidden, cell, mean, clipped, played];
    if critic.is_some() {
        comparisons.extend([value, critic_hidden, critic_cell]);
    }
    Ok(comparisons)
}

/// Compares the recorded rollouts of one natural-policy-gradient policy.
pub(super) fn verify_natural_policy_gradient(
    folder: &Path,
    environment: &str,
    files: &[String],
) -> Result<Vec<PolicyCheck>, VerifyError> {
    let path = folder.join(format!("{environment}_seed1_best_policy.pickle"));
    let checkpoint = checkpoint::open(&path, &Limits::default())?;
    let policy = MlpPolicy::natural_policy_gradient(&checkpoint.tensors)
        .map_err(|source| VerifyError::Policy { source, path })?;
    let prefix = format!("{environment}_rollout_");
    let mut checks = Vec::new();
    for file in files.iter().filter(|file| lies_between(file, &prefix, ".npz")) {
        let path = folder.join(file);
        let arrays = Arrays::open(&path)
            .map_err(|source| VerifyError::Array { source, path: path.clone() })?;
        for (quantity, observations, actions) in [
            ("action mean", "obs", "action"),
            ("action mean of random observations", "random_obs", "random_action"),
        ] {
            let comparison = compare_actions(&policy, &arrays, quantity, observations, actions)
                .map_err(|failure| failure.at(&path))?;
            checks.push(comparison.finish(file));
        }
    }
    Ok(checks)
}

fn compare_actions(
    policy: &MlpPolicy,
    arrays: &Arrays,
    quantity: &'static str,
    observations: &str,
    actions: &str,
) -> Result<Comparison, Failure> {
    let rows = arrays.get(observations)?.rows();
    let (length, muscles) = (policy.observation_length(), policy.muscle_count());
    let raw = floats(arrays, observations, &[rows, length])?;
    let mut means = vec![0.0; rows * muscles];
    let slots: Vec<usize> = (0..rows).collect();
    let mut actor = policy.bind(&clean_task(length, muscles), rows)?;
    actor.act(&slots, &raw, &mut means, None);
    let mut comparison = Comparison::new(quantity);
    comparison.add(&means, &floats(arrays, actions, &[rows, muscles])?);
    Ok(comparison)
}

/// A task of these sizes that is described by nothing else.
fn clean_task(observation_length: usize, muscle_count: usize) -> TaskInterface {
    TaskInterface {
        task: "recording".to_owned(),
        muscle_count,
        muscle_observation_length: 0,
        clean_observation_length: observation_length,
        observation_words: Vec::new(),
        action_words: Vec::new(),
        muscle_models: Vec::new(),
    }
}

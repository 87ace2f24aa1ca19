//! Settings of a policy, as Stable-Baselines3 writes them in JSON: `data` in an archive, the same as a loose file, or the
//! training run's `model_config.json`.
//!
//! `data` holds whatever JSON can express, and everything else as base64-coded cloudpickle under `:serialized:`. Those
//! blobs are programs; they are never decoded. What is needed of them is repeated beside them as plain JSON
//! (`spec/policy.md` §3.3). Where a setting was not given, the library that the policy's class belongs to took its own
//! default; for a class of an unknown library nothing is assumed.

use serde_json::Value;

use super::CheckpointError;
use super::contents::{Activation, Declared, ExplorationSettings, Scalars};
use super::limits::Budget;

/// Reads the settings in `text`. `part` names the file or archive member in messages.
pub(super) fn read(
    text: &[u8],
    part: &str,
    budget: &mut Budget,
) -> Result<Scalars, CheckpointError> {
    // Every value of a parsed document but the first comes after one of four characters.
    const BYTES_PER_VALUE: u64 = 128;
    let values =
        text.iter().filter(|byte| matches!(byte, b',' | b':' | b'[' | b'{')).count() as u64;
    budget
        .charge_memory(text.len() as u64 + BYTES_PER_VALUE * values)
        .map_err(|fault| CheckpointError::Limit { part: part.to_owned(), fault })?;
    let settings: Value = serde_json::from_slice(text)
        .map_err(|fault| CheckpointError::Settings { part: part.to_owned(), fault })?;
    let policy = &settings["policy_kwargs"];
    let activation = match policy["activation_fn"].as_str() {
        Some(class) => activation(class),
        None => default_activation(&settings),
    };
    Ok(Scalars {
        head_count: policy["net_arch"]["num_heads"].as_u64().and_then(|n| usize::try_from(n).ok()),
        policy_outputs_variance: policy["policy_outputs_variance"].as_bool(),
        activation,
        training_steps: settings["num_timesteps"].as_u64(),
        declared: Declared::from_policy_settings(policy),
        exploration: policy.is_object().then(|| exploration(&settings)),
        ..Scalars::default()
    })
}

/// `<class 'torch.nn.modules.activation.ReLU'>`: only the class name counts, and only a known one. A run's own
/// configuration has the name alone.
fn activation(class: &str) -> Option<Activation> {
    let path = class.strip_prefix("<class '").and_then(|class| class.strip_suffix("'>"));
    activation_called(path.unwrap_or(class))
}

/// The activation function whose class is called `path`, with or without its module.
pub(super) fn activation_called(path: &str) -> Option<Activation> {
    match path.rsplit('.').next()? {
        "ReLU" => Some(Activation::Relu),
        "Tanh" => Some(Activation::Tanh),
        "ELU" => Some(Activation::Elu),
        "SiLU" => Some(Activation::Silu),
        "GELU" => Some(Activation::Gelu),
        _ => None,
    }
}

/// What the libraries' own policies use when nothing else is asked for.
fn default_activation(settings: &Value) -> Option<Activation> {
    if !settings["policy_kwargs"].is_object() {
        return None;
    }
    match settings["policy_class"]["__module__"].as_str()? {
        "stable_baselines3.common.policies" | "sb3_contrib.common.recurrent.policies" => {
            Some(Activation::Tanh)
        }
        "stable_baselines3.sac.policies" => Some(Activation::Relu),
        _ => None,
    }
}

fn exploration(settings: &Value) -> ExplorationSettings {
    let policy = &settings["policy_kwargs"];
    let default = ExplorationSettings::default();
    let flag = |name: &str| policy[name].as_bool().unwrap_or(false);
    let number = |name: &str, default| policy[name].as_f64().unwrap_or(default);
    let bounds = [0, 1].map(|k| policy["std_clip"][k].as_f64().unwrap_or(default.clip[k]));
    // -1: only at the start of a rollout.
    let frequency = settings["sde_sample_freq"].as_i64().and_then(|n| usize::try_from(n).ok());
    ExplorationSettings {
        lattice: flag("use_lattice"),
        expln: flag("use_expln"),
        clip: bounds,
        alpha: number("alpha", default.alpha),
        regulariser: number("std_reg", default.regulariser),
        log_scale: number("log_std_init", default.log_scale),
        steps_between_draws: frequency.filter(|&steps| steps > 0),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::checkpoint::limits::Limits;

    fn settings(text: &str) -> Scalars {
        read(text.as_bytes(), "data", &mut Budget::new(&Limits::default())).unwrap()
    }

    #[test]
    fn an_activation_is_known_by_the_end_of_its_class_name_only() {
        let relu = "<class 'torch.nn.modules.activation.ReLU'>";
        assert_eq!(activation(relu), Some(Activation::Relu));
        assert_eq!(activation("<class 'evil.NotReLU'>"), None);
        assert_eq!(activation("<not serializable>"), None);
        assert_eq!(activation("Tanh"), Some(Activation::Tanh));
    }

    #[test]
    fn a_default_is_assumed_only_for_a_class_of_a_known_library() {
        let text = |module| {
            format!(r#"{{"policy_kwargs": {{}}, "policy_class": {{"__module__": "{module}"}}}}"#)
        };
        let of = |module| settings(&text(module)).activation;
        assert_eq!(of("stable_baselines3.common.policies"), Some(Activation::Tanh));
        assert_eq!(of("stable_baselines3.sac.policies"), Some(Activation::Relu));
        assert_eq!(of("somebody.policies"), None);
    }

    #[test]
    fn exploration_is_unknown_where_no_settings_are() {
        assert_eq!(settings("{}").exploration, None);
        let text = r#"{"policy_kwargs": {"use_lattice": true, "std_clip": [0.1, 2]}, "sde_sample_freq": 4}"#;
        let expected = ExplorationSettings {
            lattice: true,
            clip: [0.1, 2.0],
            steps_between_draws: Some(4),
            ..ExplorationSettings::default()
        };
        assert_eq!(settings(text).exploration, Some(expected));
    }
}

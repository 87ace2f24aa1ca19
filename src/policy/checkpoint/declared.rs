//! What a run says about its transformer in words: the settings inside the checkpoint and the `args.json` beside it
//! (`spec/policy.md` §3.3, §3.4).
//!
//! Some of it the tensors do not tell, such as the number of heads; the rest must agree with them. Only numbers, truth
//! values and names are taken, whatever else the document holds.

use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Facts about a transformer. `None`, or empty: not told.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Declared {
    #[serde(skip_serializing_if = "Option::is_none")]
    pub heads: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub width: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub feed_forward: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub encoder_layers: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub decoder_layers: Option<usize>,
    /// Observations before the current one that a token holds.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub memory_steps: Option<usize>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub shared_decoder: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub outputs_variance: Option<bool>,
    /// Whether every task has its own word embeddings.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub task_words: Option<bool>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub layer_norm_epsilon: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    pub norm_first: Option<bool>,
    /// Whether observations were normalised in training.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub normalised: Option<bool>,
    /// Tasks it was trained on, each once, in their order.
    pub tasks: Vec<String>,
    /// Whether training went on from another run's checkpoint, whose sizes then count and not those asked for.
    pub continued: bool,
    /// Moments that a transformer with attention over time looks back at.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moments: Option<usize>,
    /// Steps between two of those moments.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub moment_interval: Option<usize>,
    /// Share of those moments that it looks at, drawn anew at every step.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub kept_share: Option<f64>,
}

/// More task names than any run has.
const MOST_TASKS: usize = 1000;

impl Declared {
    /// Whether nothing is told.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        *self == Self::default()
    }

    /// From `policy_kwargs` of the settings inside a checkpoint.
    pub(super) fn from_policy_settings(policy: &Value) -> Self {
        let network = &policy["net_arch"];
        Self {
            heads: size(&network["num_heads"]),
            feed_forward: size(&network["dim_feedforward"]),
            encoder_layers: size(&network["num_encoder_layers"]),
            decoder_layers: size(&network["num_decoder_layers"]),
            shared_decoder: network["share_decoder"].as_bool(),
            outputs_variance: policy["policy_outputs_variance"].as_bool(),
            layer_norm_epsilon: network["layer_norm_eps"].as_f64(),
            norm_first: network["norm_first"].as_bool(),
            ..Self::default()
        }
    }

    /// From the arguments of a training run, `args.json`.
    pub(in crate::policy) fn from_arguments(arguments: &Value) -> Self {
        let layers = size(&arguments["num_layers"]);
        let mut tasks: Vec<String> = Vec::new();
        for task in arguments["tasks"].as_array().into_iter().flatten().take(MOST_TASKS) {
            if let Some(task) = task.as_str().filter(|task| !tasks.iter().any(|t| t == task)) {
                tasks.push(task.to_owned());
            }
        }
        Self {
            heads: size(&arguments["num_heads"]),
            width: size(&arguments["embedding_size"]),
            feed_forward: size(&arguments["dim_feedforward"]),
            encoder_layers: layers,
            decoder_layers: layers,
            memory_steps: size(&arguments["num_memory_steps"]),
            shared_decoder: arguments["separate_vf_decoder"].as_bool().map(|separate| !separate),
            outputs_variance: arguments["policy_outputs_variance"].as_bool(),
            task_words: arguments["positional_encoding"]
                .as_str()
                .map(|kind| kind == "task_specific"),
            normalised: arguments["ablate_obs_norm"].as_bool().map(|ablated| !ablated),
            tasks,
            continued: arguments["load_path"].as_str().is_some_and(|path| !path.is_empty()),
            moments: size(&arguments["k_bilateral"]),
            moment_interval: size(&arguments["time_skip"]),
            kept_share: arguments["mask_rate"].as_f64(),
            ..Self::default()
        }
    }
}

fn size(value: &Value) -> Option<usize> {
    value.as_u64().and_then(|size| usize::try_from(size).ok())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_give_sizes_and_each_task_once() {
        let arguments = serde_json::json!({
            "num_heads": 2, "embedding_size": 16, "num_layers": 3, "separate_vf_decoder": true,
            "tasks": ["pen", "kinesis", "pen"], "load_path": null, "ablate_obs_norm": false,
            "positional_encoding": "learned", "num_memory_steps": "five",
        });
        let declared = Declared::from_arguments(&arguments);
        let want = Declared {
            heads: Some(2),
            width: Some(16),
            encoder_layers: Some(3),
            decoder_layers: Some(3),
            shared_decoder: Some(false),
            task_words: Some(false),
            normalised: Some(true),
            tasks: vec!["pen".to_owned(), "kinesis".to_owned()],
            ..Declared::default()
        };
        assert_eq!(declared, want);
        assert!(Declared::from_arguments(&Value::Null).is_empty());
    }
}

//! What the tensors of a checkpoint say about its network: sizes of the layers and numbers of parameters.

use std::collections::BTreeSet;

use super::contents::{Checkpoint, Format};

/// How many numbers a checkpoint holds.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ParameterCounts {
    /// Elements of all tensors by name, as publications count them.
    pub stored: usize,
    /// The same without the names that share another one's storage: what training can change.
    pub distinct: usize,
}

/// Counts the parameters of `checkpoint`.
#[must_use]
pub fn parameter_counts(checkpoint: &Checkpoint) -> ParameterCounts {
    let count = |is_counted: &dyn Fn(&str) -> bool| {
        let tensors = checkpoint.tensors.iter().filter(|(name, _)| is_counted(name));
        tensors.map(|(_, tensor)| tensor.data.len()).sum()
    };
    ParameterCounts {
        stored: count(&|_| true),
        distinct: count(&|name| !checkpoint.aliases.contains_key(name)),
    }
}

/// The sizes that make up the network, in the order in which data pass through it. A size that the tensors do not
/// tell is left out.
#[must_use]
pub fn network_sizes(checkpoint: &Checkpoint) -> Vec<(&'static str, Vec<usize>)> {
    let shapes = Shapes(checkpoint);
    let mut sizes: Vec<(&'static str, Vec<usize>)> = Vec::new();
    let mut add = |name, size: Option<usize>| sizes.extend(size.map(|size| (name, vec![size])));
    match checkpoint.format {
        Format::ArnoldTransformer | Format::TemporalTransformer => {
            let tokenizer = "features_extractor.tokenizer.weight";
            add("vocabulary", shapes.axis(&shapes.first_containing("positional_encoder."), 0));
            add("window", shapes.axis(tokenizer, 1));
            add("embedding", shapes.axis(tokenizer, 0));
            add("heads", checkpoint.scalars.head_count);
            add("feed-forward", shapes.axis("mlp_extractor.encoder.layers.0.linear1.weight", 0));
            add("encoder layers", shapes.layers("mlp_extractor.encoder.layers."));
            add("time encoder layers", shapes.layers("mlp_extractor.time_encoder.layers."));
            for decoder in ["_action_decoder", "decoder"] {
                add("decoder layers", shapes.layers(&format!("mlp_extractor.{decoder}.layers.")));
            }
        }
        Format::RecurrentPpo => {
            add("observations", shapes.axis("lstm_actor.weight_ih_l0", 1));
            add("LSTM", shapes.axis("lstm_actor.weight_hh_l0", 1));
            sizes.extend(shapes.hidden("mlp_extractor.policy_net."));
            sizes.extend(shapes.axis("action_net.weight", 0).map(|size| ("actions", vec![size])));
        }
        Format::PpoMlp => {
            let first = ["mlp_extractor.policy_net.0.weight", "action_net.weight"];
            add("observations", first.iter().find_map(|name| shapes.axis(name, 1)));
            sizes.extend(shapes.hidden("mlp_extractor.policy_net."));
            sizes.extend(shapes.axis("action_net.weight", 0).map(|size| ("actions", vec![size])));
        }
        Format::SacMlp => {
            add("observations", shapes.axis("actor.latent_pi.0.weight", 1));
            sizes.extend(shapes.hidden("actor.latent_pi."));
            sizes.extend(shapes.axis("actor.mu.weight", 0).map(|size| ("actions", vec![size])));
        }
        Format::WalkingExpert => {
            add("observations", shapes.axis("net.affine_layers.0.weight", 1));
            sizes.extend(shapes.hidden("net.affine_layers."));
            sizes.extend(shapes.axis("action_mean.weight", 0).map(|size| ("actions", vec![size])));
        }
        Format::EnsembleClassifier => {
            add("features", shapes.axis("layer_1.weight", 1));
            sizes.extend(shapes.hidden("layer_"));
        }
        Format::NpgMlp => {
            add("observations", shapes.axis("in_shift", 0));
            let mut widths = shapes.widths("fc_layers.");
            widths.pop();
            sizes.extend((!widths.is_empty()).then_some(("hidden", widths)));
            sizes.extend(shapes.axis("out_shift", 0).map(|size| ("actions", vec![size])));
        }
    }
    sizes
}

/// Looks at shapes by tensor name.
struct Shapes<'a>(&'a Checkpoint);

impl Shapes<'_> {
    fn axis(&self, name: &str, axis: usize) -> Option<usize> {
        self.0.tensors.get(name)?.shape.get(axis).copied()
    }

    fn first_containing(&self, part: &str) -> String {
        self.0.tensors.keys().find(|name| name.contains(part)).cloned().unwrap_or_default()
    }

    /// The numbers that follow `prefix` in tensor names.
    fn indices(&self, prefix: &str) -> BTreeSet<usize> {
        let index = |name: &String| name.strip_prefix(prefix)?.split('.').next()?.parse().ok();
        self.0.tensors.keys().filter_map(index).collect()
    }

    fn layers(&self, prefix: &str) -> Option<usize> {
        let count = self.indices(prefix).len();
        (count > 0).then_some(count)
    }

    /// Output widths of a stack of linear layers.
    fn widths(&self, prefix: &str) -> Vec<usize> {
        let width = |index: usize| self.axis(&format!("{prefix}{index}.weight"), 0);
        self.indices(prefix).into_iter().filter_map(width).collect()
    }

    fn hidden(&self, prefix: &str) -> Option<(&'static str, Vec<usize>)> {
        let widths = self.widths(prefix);
        (!widths.is_empty()).then_some(("hidden", widths))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::checkpoint::contents::{Scalars, Tensor};

    #[test]
    fn an_alias_is_stored_but_not_distinct() {
        let tensor = |shape: &[usize]| Tensor {
            shape: shape.to_vec(),
            data: vec![0.0; shape.iter().product()],
        };
        let names = [
            ("action_net.weight", tensor(&[3, 4])),
            ("mlp_extractor.policy_net.0.weight", tensor(&[5, 7])),
            ("mlp_extractor.policy_net.2.weight", tensor(&[4, 5])),
            ("twin", tensor(&[4, 5])),
        ];
        let checkpoint = Checkpoint {
            format: Format::PpoMlp,
            tensors: names.map(|(name, tensor)| (name.to_owned(), tensor)).into(),
            aliases: [("twin".to_owned(), "mlp_extractor.policy_net.2.weight".to_owned())].into(),
            scalars: Scalars::default(),
            globals: Vec::new(),
        };
        let counts = parameter_counts(&checkpoint);
        assert_eq!(counts, ParameterCounts { stored: 87, distinct: 67 });
        let sizes = network_sizes(&checkpoint);
        assert_eq!(
            sizes,
            [("observations", vec![7]), ("hidden", vec![5, 4]), ("actions", vec![3])]
        );
    }
}

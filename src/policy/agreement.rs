//! Do the words about a transformer agree with its tensors?
//!
//! The settings inside a checkpoint must. So must the arguments of its run (`args.json`), unless training went on from
//! another run's checkpoint: then the network is that one's, whatever the arguments ask for.

use super::PolicyError;
use super::checkpoint::contents::{Checkpoint, Declared};
use super::network::weights::Weights;

/// PyTorch's default, the only value the network here computes with.
const LAYER_NORM_EPSILON: f64 = 1e-5;

/// Checks the settings of a transformer's `checkpoint` and the `arguments` of its run against its tensors, and lets the
/// arguments tell what the settings do not. Returns what a person should know.
pub(super) fn settle(
    checkpoint: &mut Checkpoint,
    arguments: Option<Declared>,
) -> Result<Vec<String>, PolicyError> {
    let mut warnings = Vec::new();
    let mut found = of_tensors(checkpoint)?;
    let settings = &mut checkpoint.scalars.declared;
    agree("the checkpoint", settings, &found)?;
    if settings.norm_first == Some(false) {
        let what = "a transformer that normalises after its branches".to_owned();
        return Err(PolicyError::Unsupported { what });
    }
    if let Some(epsilon) = settings.layer_norm_epsilon
        && (epsilon - LAYER_NORM_EPSILON).abs() > 1e-12
    {
        let what = format!("layer normalisation with ε = {epsilon}, only {LAYER_NORM_EPSILON} is");
        return Err(PolicyError::Unsupported { what });
    }
    if let Some(arguments) = arguments {
        found.heads = settings.heads;
        found.outputs_variance = settings.outputs_variance;
        match agree("`args.json`", &arguments, &found) {
            Err(difference) if arguments.continued => warnings.push(format!(
                "{difference}; the run went on from another checkpoint, so the tensors count"
            )),
            agreed => agreed?,
        }
        *settings = Declared {
            heads: settings.heads.or(arguments.heads),
            outputs_variance: settings.outputs_variance.or(arguments.outputs_variance),
            layer_norm_epsilon: settings.layer_norm_epsilon,
            norm_first: settings.norm_first,
            ..arguments
        };
    }
    // What the tensors tell needs no telling twice.
    *settings = Declared {
        width: None,
        feed_forward: None,
        encoder_layers: None,
        decoder_layers: None,
        memory_steps: None,
        shared_decoder: None,
        task_words: None,
        ..std::mem::take(settings)
    };
    let (heads, variance) = (settings.heads, settings.outputs_variance);
    checkpoint.scalars.head_count = checkpoint.scalars.head_count.or(heads);
    checkpoint.scalars.policy_outputs_variance =
        checkpoint.scalars.policy_outputs_variance.or(variance);
    Ok(warnings)
}

/// What the tensors themselves say.
fn of_tensors(checkpoint: &Checkpoint) -> Result<Declared, PolicyError> {
    let weights = Weights(&checkpoint.tensors);
    let [width, lags] = weights.matrix_size("features_extractor.tokenizer.weight")?;
    let [feed_forward, _] = weights.matrix_size("mlp_extractor.encoder.layers.0.linear1.weight")?;
    let layers =
        |stack: &str| weights.numbered(|k| format!("mlp_extractor.{stack}.layers.{k}.norm1")).len();
    let shared = weights.has("mlp_extractor.decoder.norm.weight");
    let task_words = "features_extractor.positional_encoder.task_embeddings.";
    Ok(Declared {
        width: Some(width),
        feed_forward: Some(feed_forward),
        encoder_layers: Some(layers("encoder")),
        decoder_layers: Some(layers(if shared { "decoder" } else { "_action_decoder" })),
        memory_steps: lags.checked_sub(1),
        shared_decoder: Some(shared),
        task_words: Some(!weights.names_between(task_words, ".weight").is_empty()),
        ..Declared::default()
    })
}

/// Fails on the first fact that both tell, each in another way.
fn agree(source: &'static str, said: &Declared, found: &Declared) -> Result<(), PolicyError> {
    let sizes = [
        ("attention heads", said.heads, found.heads),
        ("embedding size", said.width, found.width),
        ("feed-forward width", said.feed_forward, found.feed_forward),
        ("encoder layers", said.encoder_layers, found.encoder_layers),
        ("decoder layers", said.decoder_layers, found.decoder_layers),
        ("earlier observations per token", said.memory_steps, found.memory_steps),
    ]
    .map(|(what, said, found)| (what, said.map(|n| n.to_string()), found.map(|n| n.to_string())));
    let yes = |flag: Option<bool>| flag.map(|flag| if flag { "yes" } else { "no" }.to_owned());
    let flags = [
        ("shared decoder", yes(said.shared_decoder), yes(found.shared_decoder)),
        ("scaled σ", yes(said.outputs_variance), yes(found.outputs_variance)),
        ("words per task", yes(said.task_words), yes(found.task_words)),
    ];
    for (what, said, found) in sizes.into_iter().chain(flags) {
        if let (Some(said), Some(found)) = (said, found)
            && said != found
        {
            return Err(PolicyError::Contradiction { source_name: source, what, said, found });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::policy::checkpoint::contents::{Format, Scalars, Tensor};
    use crate::policy::network::Sizes;

    const SIZES: Sizes = Sizes {
        vocabulary: 4,
        lags: 6,
        width: 4,
        heads: 2,
        feed_forward: 8,
        encoder_layers: 2,
        decoder_layers: 1,
    };

    fn checkpoint(declared: Declared) -> Checkpoint {
        let tensor = |shape: Vec<usize>| {
            let count = shape.iter().product();
            Tensor { shape, data: vec![0.0; count] }
        };
        let shapes = SIZES.tensor_shapes().into_iter();
        Checkpoint {
            format: Format::ArnoldTransformer,
            tensors: shapes.map(|(name, shape)| (name, tensor(shape))).collect(),
            aliases: std::collections::BTreeMap::new(),
            scalars: Scalars { declared, ..Scalars::default() },
            globals: Vec::new(),
        }
    }

    #[test]
    fn arguments_tell_what_the_settings_do_not() {
        let mut silent = checkpoint(Declared::default());
        let arguments = Declared {
            heads: Some(2),
            memory_steps: Some(5),
            outputs_variance: Some(false),
            tasks: vec!["pen".to_owned()],
            ..Declared::default()
        };
        assert!(settle(&mut silent, Some(arguments)).unwrap().is_empty());
        assert_eq!(silent.scalars.head_count, Some(2));
        assert_eq!(silent.scalars.policy_outputs_variance, Some(false));
        assert_eq!(silent.scalars.declared.tasks, ["pen"]);
    }

    #[test]
    fn a_contradiction_names_both_numbers() {
        let settings = Declared { encoder_layers: Some(6), ..Declared::default() };
        let error = settle(&mut checkpoint(settings), None).unwrap_err().to_string();
        assert!(
            error.contains("the checkpoint says encoder layers: 6, ") && error.contains('2'),
            "{error}"
        );

        let heads = |n| Declared { heads: Some(n), ..Declared::default() };
        let error = settle(&mut checkpoint(heads(2)), Some(heads(4))).unwrap_err().to_string();
        assert!(error.contains("`args.json` says attention heads: 4"), "{error}");
    }

    #[test]
    fn arguments_of_a_run_that_went_on_do_not_describe_the_network() {
        let arguments = Declared { width: Some(64), continued: true, ..Declared::default() };
        let warnings = settle(&mut checkpoint(Declared::default()), Some(arguments)).unwrap();
        assert!(warnings[0].contains("64") && warnings[0].contains("went on"), "{warnings:?}");
    }

    #[test]
    fn another_kind_of_layer_is_refused() {
        for settings in [
            Declared { norm_first: Some(false), ..Declared::default() },
            Declared { layer_norm_epsilon: Some(1e-6), ..Declared::default() },
        ] {
            let error = settle(&mut checkpoint(settings), None).unwrap_err();
            assert!(matches!(error, PolicyError::Unsupported { .. }), "{error}");
        }
    }
}

//! The files around a transformer's checkpoint and what follows from them: `args.json`, `vocabulary.json`, the
//! normaliser's name; what has to be assumed where none of them says (`spec/policy.md` §3.1, §3.3, §3.4).

use std::path::Path;

use super::PolicyError;
use super::checkpoint::contents::{
    Checkpoint, Declared, Format, Normaliser, SignatureStatistics, TensorMap,
};
use super::checkpoint::{in_file as checkpoint_in_file, read_arguments};
use super::loading::in_file;
use super::network::weights::Weights;
use super::policies::temporal::Recall;
use super::speech::Speech;
use super::vocabulary::Vocabulary;
use crate::files::read_bounded;

/// A list of some thousand words, or the arguments of a run, are far below this.
const LARGEST_DOCUMENT: u64 = 1 << 20;

/// Whether the checkpoint is one of the transformers, whose tokens are described by words.
pub(super) fn is_transformer(format: Format) -> bool {
    matches!(format, Format::ArnoldTransformer | Format::TemporalTransformer)
}

/// The arguments of the run that wrote `checkpoint`, if they lie beside it.
pub(super) fn arguments_beside(checkpoint: &Path) -> Result<Option<Declared>, PolicyError> {
    let path = checkpoint.with_file_name("args.json");
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = read_bounded(&path, LARGEST_DOCUMENT)?;
    Ok(Some(read_arguments(&bytes).map_err(checkpoint_in_file(&path))?))
}

/// The vocabulary in the file `path`, if there is one and it is not the standard one.
pub(super) fn foreign_vocabulary(path: &Path) -> Result<Option<Vocabulary>, PolicyError> {
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = read_bounded(path, LARGEST_DOCUMENT)?;
    let vocabulary = Vocabulary::from_json(&bytes).map_err(in_file(path))?;
    Ok((vocabulary != Vocabulary::standard()).then_some(vocabulary))
}

/// The hash of a checkpoint together with what `args.json` and `vocabulary.json` say of it: other words, another policy.
pub(super) fn completed_hash(
    checkpoint_hash: &str,
    checkpoint: &Checkpoint,
    vocabulary: Option<&Vocabulary>,
) -> String {
    let words = vocabulary.map(Vocabulary::words);
    let facts = serde_json::json!([checkpoint_hash, checkpoint.scalars, words]);
    blake3::hash(facts.to_string().as_bytes()).to_hex().to_string()
}

/// What to say if the training steps in the two file names differ.
pub(super) fn steps_differ(checkpoint: &Path, normaliser: &Path) -> Option<String> {
    let (of_checkpoint, of_normaliser) = (steps_of(checkpoint)?, steps_of(normaliser)?);
    (of_checkpoint != of_normaliser).then(|| {
        format!(
            "the checkpoint is of step {of_checkpoint}, its normaliser `{}` of step {of_normaliser}",
            normaliser.display()
        )
    })
}

/// `<steps>` of `…_<steps>_steps.<extension>`.
pub(super) fn steps_of(path: &Path) -> Option<u64> {
    let stem = path.file_stem()?.to_str()?.strip_suffix("_steps")?;
    stem.rsplit('_').next()?.parse().ok()
}

/// Refuses a vocabulary that has another number of words than the embedding tables have rows.
pub(super) fn check_word_count(
    checkpoint: &Checkpoint,
    vocabulary: Option<&Vocabulary>,
) -> Result<(), PolicyError> {
    let words = vocabulary.map_or_else(|| Vocabulary::standard().len(), Vocabulary::len);
    match rows_of_tables(&checkpoint.tensors) {
        Some(rows) if rows != words => Err(PolicyError::Vocabulary {
            what: format!(
                "the checkpoint embeds {rows} words, {} {words}",
                if vocabulary.is_some() {
                    "its `vocabulary.json` has"
                } else {
                    "and without a `vocabulary.json` beside it there are"
                }
            ),
        }),
        _ => Ok(()),
    }
}

fn rows_of_tables(tensors: &TensorMap) -> Option<usize> {
    let mut tables = tensors
        .iter()
        .filter(|(name, _)| name.starts_with("features_extractor.positional_encoder."));
    tables.next().and_then(|(_, tensor)| tensor.shape.first().copied())
}

/// Brings embeddings and statistics into the order of the standard vocabulary and says so.
pub(super) fn translate(
    vocabulary: &Vocabulary,
    checkpoint: &mut Checkpoint,
    normaliser: &mut Option<Normaliser>,
) -> Result<String, PolicyError> {
    let standard = Vocabulary::standard();
    vocabulary.translate_embeddings(&standard, &mut checkpoint.tensors)?;
    if let Some(Normaliser::PerSignature(statistics)) = normaliser {
        vocabulary.translate_signatures(&standard, statistics);
    }
    Ok(format!(
        "the checkpoint's vocabulary of {} words is not the standard one of {}; embeddings were matched by word, and \
         {} words are new to it",
        vocabulary.len(),
        standard.len(),
        vocabulary.missing(&standard).len()
    ))
}

/// The network of a transformer's checkpoint, made by `build` from tensors, heads, and whether σ is scaled.
pub(super) fn transformer_network<N>(
    checkpoint: &Checkpoint,
    build: impl FnOnce(&TensorMap, usize, bool) -> Result<N, PolicyError>,
) -> Result<N, PolicyError> {
    let scaled_variance = checkpoint.scalars.policy_outputs_variance.unwrap_or(true);
    build(&checkpoint.tensors, head_count(checkpoint)?, scaled_variance)
}

/// What a transformer's words mean, by its normaliser and the tasks of its run.
pub(super) fn speech(
    checkpoint: &Checkpoint,
    normaliser: Option<&Normaliser>,
    lags: usize,
    atomic: Option<Vocabulary>,
) -> Result<Speech, PolicyError> {
    let format = "transformer";
    let declared = &checkpoint.scalars.declared;
    let statistics = match normaliser {
        Some(Normaliser::PerSignature(statistics)) => statistics.clone(),
        None if declared.normalised == Some(false) => not_normalising(),
        None => return Err(PolicyError::MissingNormaliser { format }),
        Some(_) => {
            let (expected, found) = ("per token signature", "per component");
            return Err(PolicyError::WrongNormaliser { format, expected, found });
        }
    };
    Ok(Speech::new(statistics, lags)?.with(atomic, declared.tasks.clone()))
}

/// Statistics of a run that let its observations be.
fn not_normalising() -> SignatureStatistics {
    SignatureStatistics {
        signatures: Vec::new(),
        mean: Vec::new(),
        variance: Vec::new(),
        count: Vec::new(),
        lags: 0,
        epsilon: 1e-8,
        clip: f64::INFINITY,
        enabled: false,
    }
}

/// Number of attention heads: what the files say, else what the published models of that width have.
fn head_count(checkpoint: &Checkpoint) -> Result<usize, PolicyError> {
    if let Some(heads) = checkpoint.scalars.head_count {
        return Ok(heads);
    }
    let name = "features_extractor.tokenizer.weight";
    let [width, _] = Weights(&checkpoint.tensors).matrix_size(name)?;
    Ok(if width >= 64 { 4 } else { 2 })
}

/// What the transformer's files do not say and is taken from the published models.
pub(super) fn assumptions(checkpoint: &Checkpoint) -> Vec<String> {
    let mut assumptions = Vec::new();
    if let (None, Ok(heads)) = (checkpoint.scalars.head_count, head_count(checkpoint)) {
        assumptions.push(format!(
            "the checkpoint does not say how many attention heads it has; {heads} are assumed"
        ));
    }
    if checkpoint.scalars.policy_outputs_variance.is_none() {
        let text = "the checkpoint does not say whether it scales its standard deviation per \
                    muscle; it is assumed to";
        assumptions.push(text.to_owned());
    }
    if checkpoint.format == Format::TemporalTransformer {
        assumptions.extend(Recall::assumptions(&checkpoint.scalars.declared));
    }
    assumptions
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn steps_are_read_off_names_that_have_them() {
        let steps = |name: &str| steps_of(Path::new(name));
        assert_eq!(steps("a/rl_model_64670238_steps.zip"), Some(64_670_238));
        assert_eq!(steps("rl_model_vecnormalize_100_steps.pkl"), Some(100));
        assert_eq!((steps("model.zip"), steps("rl_model_x_steps.zip")), (None, None));
        let (one, other) = (Path::new("rl_model_1_steps.zip"), Path::new("x_2_steps.pkl"));
        assert!(steps_differ(one, other).is_some_and(|text| text.contains("step 2")));
        assert_eq!(steps_differ(one, Path::new("env.pkl")), None);
    }
}

//! Makes a policy of a checkpoint and its normaliser, and says what was made of what.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::checkpoint::contents::{Checkpoint, ComponentStatistics, Format, Normaliser};
use super::checkpoint::{
    Limits, in_file as checkpoint_in_file, normaliser_beside, read_checkpoint, read_normaliser,
};
use super::network::transformer::Transformer;
use super::network::weights::Weights;
use super::policies::mlp::MlpPolicy;
use super::policies::recurrent::RecurrentPolicy;
use super::policies::transformer::TransformerPolicy;
use super::vocabulary::Vocabulary;
use super::{Policy, PolicyError};
use crate::files::read_bounded;

/// A policy and where it came from.
#[derive(Clone)]
pub struct Loaded {
    pub policy: Arc<dyn Policy>,
    /// File name of the checkpoint without its extension.
    pub name: String,
    pub format: Format,
    pub checkpoint_path: PathBuf,
    /// BLAKE3 of the checkpoint file, hexadecimal.
    pub checkpoint_hash: String,
    /// `None` for families that scale for themselves.
    pub normaliser_path: Option<PathBuf>,
    /// BLAKE3 of the normaliser file, hexadecimal.
    pub normaliser_hash: Option<String>,
    /// Whatever was assumed because no file says it.
    pub warnings: Vec<String>,
}

/// Reads the policy in the file `path`. Its normaliser is `normaliser`, or the file beside the checkpoint that by
/// custom holds it. A `vocabulary.json` in the same folder is heeded.
pub fn open(path: &Path, normaliser: Option<&Path>) -> Result<Loaded, PolicyError> {
    let limits = Limits::default();
    let (bytes, checkpoint_hash) = read(path, limits.file_bytes)?;
    let mut checkpoint = read_checkpoint(&bytes, &limits).map_err(checkpoint_in_file(path))?;
    drop(bytes);
    let mut warnings = Vec::new();

    let scales_for_itself = checkpoint.format == Format::NpgMlp;
    let normaliser_path = match normaliser {
        Some(path) => Some(path.to_path_buf()),
        None if scales_for_itself => None,
        None => {
            let mut found = normaliser_beside(path).into_iter();
            let first = found.next();
            warnings.extend(found.map(|other| {
                format!("`{}` may be a normaliser as well; it is not used", other.display())
            }));
            first
        }
    };
    let mut normaliser_hash = None;
    let mut normaliser = None;
    if let Some(path) = &normaliser_path {
        let (bytes, hash) = read(path, limits.file_bytes)?;
        normaliser = Some(read_normaliser(&bytes, &limits).map_err(checkpoint_in_file(path))?);
        normaliser_hash = Some(hash);
    }

    if checkpoint.format == Format::ArnoldTransformer {
        warnings.extend(assumptions(&checkpoint));
        if let Some(vocabulary) = foreign_vocabulary(&path.with_file_name("vocabulary.json"))? {
            let standard = Vocabulary::standard();
            vocabulary
                .translate_embeddings(&standard, &mut checkpoint.tensors)
                .map_err(in_file(path))?;
            if let Some(Normaliser::PerSignature(statistics)) = &mut normaliser {
                vocabulary.translate_signatures(&standard, statistics);
            }
            warnings.push(format!(
                "the checkpoint's vocabulary of {} words is not the standard one of {}; embeddings \
                 were matched by word",
                vocabulary.len(),
                standard.len()
            ));
        }
    }
    let policy = load(&checkpoint, normaliser.as_ref()).map_err(in_file(path))?;
    if !policy.is_stochastic() {
        let text = "the checkpoint explores in a way its file does not fully describe; it can only \
                    be played by its mean actions";
        warnings.push(text.to_owned());
    }
    Ok(Loaded {
        policy,
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        format: checkpoint.format,
        checkpoint_path: path.to_path_buf(),
        checkpoint_hash,
        normaliser_path,
        normaliser_hash,
        warnings,
    })
}

/// Makes a policy of what a checkpoint and its normaliser say.
pub fn load(
    checkpoint: &Checkpoint,
    normaliser: Option<&Normaliser>,
) -> Result<Arc<dyn Policy>, PolicyError> {
    Ok(match checkpoint.format {
        Format::ArnoldTransformer => Arc::new(load_transformer(checkpoint, normaliser)?),
        Format::RecurrentPpo => Arc::new(load_recurrent(checkpoint, normaliser)?),
        Format::PpoMlp => {
            let statistics = per_component(normaliser, "PPO perceptron")?;
            let activation = checkpoint.scalars.activation;
            Arc::new(MlpPolicy::ppo(&checkpoint.tensors, activation, statistics)?)
        }
        Format::NpgMlp if normaliser.is_some() => {
            let (format, expected, found) = ("natural-policy-gradient", "of its own", "another");
            return Err(PolicyError::WrongNormaliser { format, expected, found });
        }
        Format::NpgMlp => Arc::new(MlpPolicy::natural_policy_gradient(&checkpoint.tensors)?),
    })
}

/// The transformer in `checkpoint`, with access to its network.
pub(super) fn load_transformer(
    checkpoint: &Checkpoint,
    normaliser: Option<&Normaliser>,
) -> Result<TransformerPolicy, PolicyError> {
    let format = "transformer";
    let statistics = match normaliser {
        Some(Normaliser::PerSignature(statistics)) => statistics.clone(),
        Some(Normaliser::PerComponent(_)) => {
            let (expected, found) = ("per token signature", "per component");
            return Err(PolicyError::WrongNormaliser { format, expected, found });
        }
        None => return Err(PolicyError::MissingNormaliser { format }),
    };
    let network = Transformer::from_tensors(
        &checkpoint.tensors,
        head_count(checkpoint)?,
        checkpoint.scalars.policy_outputs_variance.unwrap_or(true),
    )?;
    TransformerPolicy::new(network, statistics)
}

/// The recurrent policy in `checkpoint`, with access to its network.
pub(super) fn load_recurrent(
    checkpoint: &Checkpoint,
    normaliser: Option<&Normaliser>,
) -> Result<RecurrentPolicy, PolicyError> {
    let statistics = per_component(normaliser, "recurrent PPO")?;
    RecurrentPolicy::from_tensors(&checkpoint.tensors, checkpoint.scalars.activation, statistics)
}

fn per_component<'a>(
    normaliser: Option<&'a Normaliser>,
    format: &'static str,
) -> Result<&'a ComponentStatistics, PolicyError> {
    match normaliser {
        Some(Normaliser::PerComponent(statistics)) => Ok(statistics),
        Some(Normaliser::PerSignature(_)) => {
            let (expected, found) = ("per component", "per token signature");
            Err(PolicyError::WrongNormaliser { format, expected, found })
        }
        None => Err(PolicyError::MissingNormaliser { format }),
    }
}

/// Number of attention heads: what the file says, else what the published models of that width have.
fn head_count(checkpoint: &Checkpoint) -> Result<usize, PolicyError> {
    if let Some(heads) = checkpoint.scalars.head_count {
        return Ok(heads);
    }
    let name = "features_extractor.tokenizer.weight";
    let [width, _] = Weights(&checkpoint.tensors).matrix_size(name)?;
    Ok(if width >= 64 { 4 } else { 2 })
}

/// What the transformer's file does not say and is taken from the published models.
fn assumptions(checkpoint: &Checkpoint) -> Vec<String> {
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
    assumptions
}

/// The vocabulary in the file `path`, if there is one and it is not the standard one.
fn foreign_vocabulary(path: &Path) -> Result<Option<Vocabulary>, PolicyError> {
    /// A list of some thousand words is far below this.
    const LARGEST_VOCABULARY: u64 = 1 << 20;
    if !path.is_file() {
        return Ok(None);
    }
    let bytes = read_bounded(path, LARGEST_VOCABULARY)?;
    let vocabulary = Vocabulary::from_json(&bytes).map_err(in_file(path))?;
    if vocabulary.is_atomic() {
        let what = "one embedding per sensor (atomic vocabulary)".to_owned();
        return Err(in_file(path)(PolicyError::Unsupported { what }));
    }
    Ok((vocabulary != Vocabulary::standard()).then_some(vocabulary))
}

/// The content of a file and its BLAKE3.
fn read(path: &Path, limit: u64) -> Result<(Vec<u8>, String), PolicyError> {
    let bytes = read_bounded(path, limit)?;
    let hash = blake3::hash(&bytes).to_hex().to_string();
    Ok((bytes, hash))
}

fn in_file(path: &Path) -> impl Fn(PolicyError) -> PolicyError {
    move |source| PolicyError::InFile { source: Box::new(source), path: path.to_path_buf() }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "small whole numbers are exact")]
mod tests {
    use super::*;
    use crate::policy::TaskInterface;
    use crate::policy::checkpoint::contents::{Scalars, Tensor};

    fn perceptron() -> Checkpoint {
        let tensor =
            |shape: &[usize], data: &[f32]| Tensor { shape: shape.to_vec(), data: data.to_vec() };
        Checkpoint {
            format: Format::PpoMlp,
            tensors: [
                ("mlp_extractor.policy_net.0.weight", tensor(&[2, 1], &[1.0, -1.0])),
                ("mlp_extractor.policy_net.0.bias", tensor(&[2], &[0.0, 0.0])),
                ("action_net.weight", tensor(&[1, 2], &[3.0, 4.0])),
                ("action_net.bias", tensor(&[1], &[0.5])),
                ("log_std", tensor(&[1], &[0.0])),
            ]
            .map(|(name, tensor)| (name.to_owned(), tensor))
            .into(),
            aliases: std::collections::BTreeMap::new(),
            scalars: Scalars {
                activation: Some(crate::policy::checkpoint::contents::Activation::Relu),
                ..Scalars::default()
            },
            globals: Vec::new(),
        }
    }

    fn statistics(length: usize) -> Normaliser {
        Normaliser::PerComponent(ComponentStatistics {
            mean: vec![1.0; length],
            variance: vec![4.0; length],
            epsilon: 0.0,
            clip: 10.0,
            enabled: true,
        })
    }

    fn task(observation_length: usize, muscle_count: usize) -> TaskInterface {
        TaskInterface {
            task: "test".to_owned(),
            muscle_count,
            muscle_observation_length: 0,
            clean_observation_length: observation_length,
            observation_words: Vec::new(),
            action_words: Vec::new(),
        }
    }

    #[test]
    fn a_perceptron_normalises_and_acts() {
        let policy = load(&perceptron(), Some(&statistics(1))).unwrap();
        let mut actor = policy.bind(&task(1, 1), 2).unwrap();
        let (mut means, mut deviations) = ([0.0; 2], [0.0; 2]);
        actor.act(&[1, 0], &[5.0, -1.0], &mut means, Some(&mut deviations));
        // (5 − 1)/2 = 2 → 3·2 + ½; (−1 − 1)/2 = −1 → 4·1 + ½.
        assert_eq!((means, deviations), ([6.5, 4.5], [1.0, 1.0]));
        assert!(actor.clips_actions());
    }

    #[test]
    fn a_missing_or_foreign_normaliser_is_refused() {
        let error = |normaliser| load(&perceptron(), normaliser).err().unwrap();
        assert!(matches!(error(None), PolicyError::MissingNormaliser { .. }));
        assert!(matches!(
            error(Some(&statistics(2))),
            PolicyError::NormaliserLength { expected: 1, found: 2 }
        ));
        let npg = Checkpoint { format: Format::NpgMlp, ..perceptron() };
        assert!(matches!(
            load(&npg, Some(&statistics(1))).err().unwrap(),
            PolicyError::WrongNormaliser { .. }
        ));
    }

    #[test]
    fn an_unknown_exploration_scheme_leaves_the_means() {
        let mut lattice = perceptron();
        lattice
            .tensors
            .insert("log_std".to_owned(), Tensor { shape: vec![2, 2], data: vec![0.0; 4] });
        let policy = load(&lattice, Some(&statistics(1))).unwrap();
        assert!(!policy.is_stochastic());
        let mut actor = policy.bind(&task(1, 1), 1).unwrap();
        let (mut means, mut deviations) = ([0.0], [0.0]);
        actor.act(&[0], &[5.0], &mut means, Some(&mut deviations));
        assert!(means == [6.5] && deviations[0].is_nan());
    }

    #[test]
    fn the_activation_is_never_guessed() {
        let silent = Checkpoint { scalars: Scalars::default(), ..perceptron() };
        let error = load(&silent, Some(&statistics(1))).err().unwrap();
        assert!(matches!(error, PolicyError::Missing { .. }), "{error}");
    }

    #[test]
    fn a_wrong_task_is_refused_with_both_numbers() {
        let policy = load(&perceptron(), Some(&statistics(1))).unwrap();
        for (task, what) in [(task(86, 1), "86"), (task(1, 39), "39")] {
            let message = policy.bind(&task, 1).err().unwrap().to_string();
            assert!(message.contains("expects 1 ") && message.contains(what), "{message}");
        }
    }
}

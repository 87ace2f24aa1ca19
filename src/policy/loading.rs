//! Makes a policy of a checkpoint and its normaliser, and says what was made of what.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use super::agreement;
use super::checkpoint::contents::{Checkpoint, ComponentStatistics, Format, Normaliser};
use super::checkpoint::{
    Limits, Package, in_file as checkpoint_in_file, normaliser_beside, read_checkpoint,
    read_normaliser, read_package,
};
use super::network::temporal::TemporalTransformer;
use super::network::transformer::Transformer;
use super::policies::mlp::MlpPolicy;
use super::policies::recurrent::RecurrentPolicy;
use super::policies::temporal::{Recall, TemporalPolicy};
use super::policies::transformer::TransformerPolicy;
use super::policies::uniform::UniformPolicy;
use super::policies::walking::WalkingPolicy;
use super::transformer_files::{
    arguments_beside, assumptions, check_word_count, completed_hash, foreign_vocabulary,
    is_transformer, speech, steps_differ, transformer_network, translate,
};
use super::vocabulary::Vocabulary;
use super::{Policy, PolicyError, companions, ensemble_folder};
use crate::files::read_bounded;

/// A policy and where it came from.
#[derive(Clone)]
pub struct Loaded {
    pub policy: Arc<dyn Policy>,
    /// File name of the checkpoint without its extension.
    pub name: String,
    /// `None` for a policy that comes from no file.
    pub format: Option<Format>,
    pub checkpoint_path: PathBuf,
    /// BLAKE3 of the checkpoint file and of what files beside it add to it, hexadecimal; empty if there is none.
    pub checkpoint_hash: String,
    /// `None` for families that scale for themselves.
    pub normaliser_path: Option<PathBuf>,
    /// BLAKE3 of the normaliser file, hexadecimal.
    pub normaliser_hash: Option<String>,
    /// Whatever was assumed because no file says it.
    pub warnings: Vec<String>,
    /// For a set of experts: what each task is played with. Empty for a policy that plays all its tasks itself.
    pub members: Vec<Member>,
}

/// One of a set of experts.
#[derive(Debug, Clone)]
pub struct Member {
    pub task: String,
    pub name: String,
    pub checkpoint_path: PathBuf,
    pub checkpoint_hash: String,
    pub normaliser_path: Option<PathBuf>,
    pub normaliser_hash: Option<String>,
}

/// Everything that belongs to one checkpoint, as it stands in the files: nothing is translated or built yet.
pub(super) struct Parts {
    pub(super) checkpoint: Checkpoint,
    pub(super) checkpoint_hash: String,
    pub(super) normaliser: Option<Normaliser>,
    pub(super) normaliser_path: Option<PathBuf>,
    pub(super) normaliser_hash: Option<String>,
    /// `None`: the standard one.
    pub(super) vocabulary: Option<Vocabulary>,
    pub(super) warnings: Vec<String>,
}

/// What to give as normaliser for a policy that was trained without one. That cannot be seen in its file, so it is never
/// assumed.
pub const NO_NORMALISER: &str = "none";

impl Loaded {
    /// Uniformly random actions between −1 and 1, which need no file.
    #[must_use]
    pub fn random() -> Self {
        let name = "random";
        Self {
            policy: Arc::new(UniformPolicy::new(1.0)),
            name: name.to_owned(),
            format: None,
            checkpoint_path: name.into(),
            checkpoint_hash: String::new(),
            normaliser_path: None,
            normaliser_hash: None,
            warnings: Vec::new(),
            members: Vec::new(),
        }
    }
}

/// Reads the policy in the file `path`. Its normaliser is `normaliser`, or the file beside the checkpoint that by
/// custom holds it, or, if it is called [`NO_NORMALISER`], none. A `vocabulary.json`, an `args.json` and a run's settings
/// in the same folder are heeded.
pub fn open(path: &Path, normaliser: Option<&Path>) -> Result<Loaded, PolicyError> {
    let Parts {
        mut checkpoint,
        checkpoint_hash,
        mut normaliser,
        normaliser_path,
        normaliser_hash,
        vocabulary,
        mut warnings,
    } = read_parts(path, normaliser)?;
    let mut atomic = None;
    if is_transformer(checkpoint.format) {
        check_word_count(&checkpoint, vocabulary.as_ref()).map_err(in_file(path))?;
        warnings.extend(assumptions(&checkpoint));
        match vocabulary {
            Some(vocabulary) if vocabulary.is_atomic() => atomic = Some(vocabulary),
            Some(vocabulary) => {
                let translated = translate(&vocabulary, &mut checkpoint, &mut normaliser);
                warnings.push(translated.map_err(in_file(path))?);
            }
            None => {}
        }
    }
    let (policy, checkpoint_hash) = if checkpoint.format == Format::EnsembleClassifier {
        let opened = ensemble_folder::open(&checkpoint, path, &checkpoint_hash, &Limits::default());
        let (policy, hash) = opened.map_err(in_file(path))?;
        (Arc::new(policy) as Arc<dyn Policy>, hash)
    } else {
        let policy = load_with(&checkpoint, normaliser.as_ref(), atomic).map_err(in_file(path))?;
        (policy, checkpoint_hash)
    };
    let always_by_means =
        matches!(checkpoint.format, Format::WalkingExpert | Format::EnsembleClassifier);
    if !policy.is_stochastic() && !always_by_means {
        let text = "the checkpoint explores in a way its file does not fully describe; it can only \
                    be played by its mean actions";
        warnings.push(text.to_owned());
    }
    Ok(Loaded {
        policy,
        name: path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        format: Some(checkpoint.format),
        checkpoint_path: path.to_path_buf(),
        checkpoint_hash,
        normaliser_path,
        normaliser_hash,
        warnings,
        members: Vec::new(),
    })
}

/// A checkpoint as a training goes on with it: its words are the standard ones.
#[derive(Debug, Clone)]
pub struct Stored {
    pub checkpoint: Checkpoint,
    pub normaliser: Option<Normaliser>,
    /// BLAKE3 of its files, hexadecimal.
    pub hash: String,
}

/// Reads what [`open`] makes a policy of.
pub fn read_stored(path: &Path) -> Result<Stored, PolicyError> {
    let Parts {
        mut checkpoint, checkpoint_hash, mut normaliser, normaliser_hash, vocabulary, ..
    } = read_parts(path, None)?;
    if is_transformer(checkpoint.format) {
        check_word_count(&checkpoint, vocabulary.as_ref()).map_err(in_file(path))?;
        if let Some(vocabulary) = vocabulary {
            translate(&vocabulary, &mut checkpoint, &mut normaliser).map_err(in_file(path))?;
        }
    }
    let hash = [&checkpoint_hash, normaliser_hash.as_deref().unwrap_or("")].join("+");
    Ok(Stored { checkpoint, normaliser, hash })
}

/// Reads everything that belongs to the checkpoint `path` and sees that it agrees.
pub(super) fn read_parts(path: &Path, normaliser: Option<&Path>) -> Result<Parts, PolicyError> {
    let limits = Limits::default();
    let (bytes, mut checkpoint_hash) = read(path, limits.file_bytes)?;
    let package = read_package(&bytes, &limits).map_err(checkpoint_in_file(path))?;
    if let Some(package) = package {
        return parts_of_package(package, checkpoint_hash, path, normaliser);
    }
    let mut checkpoint = read_checkpoint(&bytes, &limits).map_err(checkpoint_in_file(path))?;
    drop(bytes);
    let mut warnings = companions::complete(&mut checkpoint, path, &mut checkpoint_hash, &limits)?;

    let scales_for_itself = checkpoint.format.scales_for_itself();
    let unscaled = normaliser.is_some_and(|path| path == Path::new(NO_NORMALISER));
    let normaliser_path = match normaliser {
        Some(_) if unscaled => None,
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
    let own = unscaled.then(Normaliser::none);
    let (normaliser, normaliser_hash) = normaliser_of(normaliser_path.as_deref(), own, &limits)?;

    let mut vocabulary = None;
    if is_transformer(checkpoint.format) {
        let arguments = arguments_beside(path)?;
        let told = arguments.is_some();
        warnings.extend(agreement::settle(&mut checkpoint, arguments).map_err(in_file(path))?);
        warnings.extend(normaliser_path.as_ref().and_then(|other| steps_differ(path, other)));
        vocabulary = foreign_vocabulary(&path.with_file_name("vocabulary.json"))?;
        if told || vocabulary.is_some() {
            checkpoint_hash = completed_hash(&checkpoint_hash, &checkpoint, vocabulary.as_ref());
        }
    }
    Ok(Parts {
        checkpoint,
        checkpoint_hash,
        normaliser,
        normaliser_path,
        normaliser_hash,
        vocabulary,
        warnings,
    })
}

/// The same for a file that holds everything itself. A `normaliser` that is named counts instead of its own, and
/// one that lies beside it only if it has none.
fn parts_of_package(
    package: Package,
    checkpoint_hash: String,
    path: &Path,
    normaliser: Option<&Path>,
) -> Result<Parts, PolicyError> {
    let limits = Limits::default();
    let Package { mut checkpoint, normaliser: own, vocabulary, .. } = package;
    let vocabulary = vocabulary.map(Vocabulary::from_words).transpose().map_err(in_file(path))?;
    let vocabulary = vocabulary.filter(|words| *words != Vocabulary::standard());
    let mut warnings = Vec::new();
    if is_transformer(checkpoint.format) {
        warnings = agreement::settle(&mut checkpoint, None).map_err(in_file(path))?;
    }
    let scales_for_itself = checkpoint.format.scales_for_itself();
    let unscaled = normaliser.is_some_and(|path| path == Path::new(NO_NORMALISER));
    let beside = || normaliser_beside(path).into_iter().next();
    let normaliser_path = match normaliser {
        Some(_) if unscaled => None,
        Some(path) => Some(path.to_path_buf()),
        None if own.is_some() || scales_for_itself => None,
        None => beside(),
    };
    let own = if unscaled { Some(Normaliser::none()) } else { own };
    let (normaliser, normaliser_hash) = normaliser_of(normaliser_path.as_deref(), own, &limits)?;
    Ok(Parts {
        checkpoint,
        checkpoint_hash,
        normaliser,
        normaliser_path,
        normaliser_hash,
        vocabulary,
        warnings,
    })
}

/// The normaliser in the file `path` and its hash, or, without a file, the checkpoint's `own`.
fn normaliser_of(
    path: Option<&Path>,
    own: Option<Normaliser>,
    limits: &Limits,
) -> Result<(Option<Normaliser>, Option<String>), PolicyError> {
    let Some(path) = path else { return Ok((own, None)) };
    let (bytes, hash) = read(path, limits.file_bytes)?;
    let normaliser = read_normaliser(&bytes, limits).map_err(checkpoint_in_file(path))?;
    Ok((Some(normaliser), Some(hash)))
}

/// Makes a policy of what a checkpoint and its normaliser say.
pub fn load(
    checkpoint: &Checkpoint,
    normaliser: Option<&Normaliser>,
) -> Result<Arc<dyn Policy>, PolicyError> {
    load_with(checkpoint, normaliser, None)
}

/// The same for a policy whose words are whole descriptions.
fn load_with(
    checkpoint: &Checkpoint,
    normaliser: Option<&Normaliser>,
    atomic: Option<Vocabulary>,
) -> Result<Arc<dyn Policy>, PolicyError> {
    Ok(match checkpoint.format {
        Format::ArnoldTransformer => {
            let network = transformer_network(checkpoint, Transformer::from_tensors)?;
            let speech = speech(checkpoint, normaliser, network.sizes().lags, atomic)?;
            Arc::new(TransformerPolicy::speaking(network, speech))
        }
        Format::TemporalTransformer => {
            let network = transformer_network(checkpoint, TemporalTransformer::from_tensors)?;
            let speech = speech(checkpoint, normaliser, network.sizes().lags, atomic)?;
            let recall = Recall::declared(&checkpoint.scalars.declared)?;
            Arc::new(TemporalPolicy::new(network, speech, recall))
        }
        Format::RecurrentPpo => Arc::new(load_recurrent(checkpoint, normaliser)?),
        Format::PpoMlp => {
            let normaliser = required(normaliser, Format::PpoMlp)?;
            Arc::new(MlpPolicy::ppo(&checkpoint.tensors, &checkpoint.scalars, normaliser)?)
        }
        Format::SacMlp => {
            let (tensors, scalars) = (&checkpoint.tensors, &checkpoint.scalars);
            let normaliser = required(normaliser, Format::SacMlp)?;
            Arc::new(MlpPolicy::soft_actor_critic(tensors, scalars, normaliser)?)
        }
        format if format.scales_for_itself() && normaliser.is_some() => {
            let (format, expected, found) = (format.word(), "of its own", "another");
            return Err(PolicyError::WrongNormaliser { format, expected, found });
        }
        Format::NpgMlp => Arc::new(MlpPolicy::natural_policy_gradient(&checkpoint.tensors)?),
        Format::WalkingExpert => Arc::new(WalkingPolicy::from_tensors(&checkpoint.tensors)?),
        Format::EnsembleClassifier => {
            let what = "the folder with the networks that it chooses between";
            return Err(PolicyError::Missing { what });
        }
    })
}

/// The transformer in `checkpoint`, with access to its network.
pub(super) fn load_transformer(
    checkpoint: &Checkpoint,
    normaliser: Option<&Normaliser>,
) -> Result<TransformerPolicy, PolicyError> {
    let network = transformer_network(checkpoint, Transformer::from_tensors)?;
    let speech = speech(checkpoint, normaliser, network.sizes().lags, None)?;
    Ok(TransformerPolicy::speaking(network, speech))
}

/// The recurrent policy in `checkpoint`, with access to its network.
pub(super) fn load_recurrent(
    checkpoint: &Checkpoint,
    normaliser: Option<&Normaliser>,
) -> Result<RecurrentPolicy, PolicyError> {
    let statistics = per_component(normaliser, "recurrent PPO")?;
    RecurrentPolicy::from_tensors(&checkpoint.tensors, &checkpoint.scalars, statistics)
}

fn required(normaliser: Option<&Normaliser>, format: Format) -> Result<&Normaliser, PolicyError> {
    normaliser.ok_or(PolicyError::MissingNormaliser { format: format.word() })
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

/// The content of a file and its BLAKE3.
fn read(path: &Path, limit: u64) -> Result<(Vec<u8>, String), PolicyError> {
    let bytes = read_bounded(path, limit)?;
    let hash = blake3::hash(&bytes).to_hex().to_string();
    Ok((bytes, hash))
}

/// Attaches the path to an error.
pub(super) fn in_file(path: &Path) -> impl Fn(PolicyError) -> PolicyError {
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
            muscle_models: Vec::new(),
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

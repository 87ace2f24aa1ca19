//! Every family of expert answers as the library that wrote its file.
//!
//! The files in `tests/fixtures/experts` were saved by PyTorch, Stable-Baselines3 and sb3-contrib with random weights of
//! tiny networks; `scripts/make_expert_fixtures.py` makes them anew and records what they answer.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use arnold_analyze::files::write_atomic;
use arnold_analyze::npz::Arrays;
use arnold_analyze::policy::checkpoint::{self, Limits};
use arnold_analyze::policy::policies::muscle_model::{MuscleModel, MuscleParameters};
use arnold_analyze::policy::{self, Actor, Loaded, ObservationVariant, TaskInterface};

/// Sums of some dozen products in single precision, in another order than the library's.
const TOLERANCE: f32 = 5e-6;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/experts").join(name)
}

fn open(name: &str) -> Loaded {
    policy::open(&fixture(name), None).unwrap_or_else(|error| panic!("{error}"))
}

/// The recorded inputs and answers of a policy.
struct Recorded(Arrays);

impl Recorded {
    fn of(name: &str) -> Self {
        Self(Arrays::open(&fixture(&format!("{name}_io.npz"))).unwrap())
    }

    fn values(&self, name: &str) -> Vec<f32> {
        self.0.get(name).unwrap().to_f32()
    }

    /// Rows of a matrix.
    fn rows(&self, name: &str) -> Vec<Vec<f32>> {
        let array = self.0.get(name).unwrap();
        array.to_f32().chunks(array.shape[1]).map(<[f32]>::to_vec).collect()
    }
}

fn clean_task(observations: usize, muscles: usize) -> TaskInterface {
    TaskInterface {
        task: "recording".to_owned(),
        muscle_count: muscles,
        muscle_observation_length: 0,
        clean_observation_length: observations,
        observation_words: Vec::new(),
        action_words: Vec::new(),
        muscle_models: Vec::new(),
    }
}

fn assert_close(found: &[f32], expected: &[f32], what: &str) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (index, (found, expected)) in found.iter().zip(expected).enumerate() {
        let tolerance = TOLERANCE * (1.0 + expected.abs());
        assert!((found - expected).abs() < tolerance, "{what}[{index}]: {found}, not {expected}");
    }
}

/// Means and standard deviations of one body, step by step; an episode starts where `starts` is not zero.
fn play(
    actor: &mut dyn Actor,
    rows: &[Vec<f32>],
    muscles: usize,
    starts: &[f32],
) -> (Vec<f32>, Vec<f32>) {
    let mut means = vec![0.0; rows.len() * muscles];
    let mut deviations = means.clone();
    let outputs = means.chunks_exact_mut(muscles).zip(deviations.chunks_exact_mut(muscles));
    for (step, (row, (mean, deviation))) in rows.iter().zip(outputs).enumerate() {
        if starts.get(step).is_some_and(|&start| start != 0.0) {
            actor.reset(0);
        }
        actor.act(&[0], row, mean, Some(deviation));
    }
    (means, deviations)
}

/// Samples of one body along one episode, its normal numbers taken from `draws`.
fn sample(
    actor: &mut dyn Actor,
    rows: &[Vec<f32>],
    muscles: usize,
    draws: &mut dyn Iterator<Item = f32>,
) -> Vec<f32> {
    let (mut action, mut deviations) = (vec![0.0; muscles], vec![0.0; muscles]);
    let mut samples = Vec::new();
    actor.reset(0);
    for row in rows {
        actor.act(&[0], row, &mut action, Some(&mut deviations));
        actor.sample(0, &deviations, &mut action, &mut || f64::from(draws.next().unwrap()));
        samples.extend_from_slice(&action);
    }
    samples
}

#[test]
fn perceptrons_of_every_shape_answer_as_the_library() {
    for name in [
        "ppo_default",
        "ppo_elu_uneven",
        "ppo_no_hidden",
        "ppo_gelu",
        "ppo_gsde",
        "ppo_gsde_narrow",
    ] {
        let (policy, recorded) = (open(&name_of(name)).policy, Recorded::of(name));
        let mut actor = policy.bind(&clean_task(5, 3), 1).unwrap();
        let (means, deviations) = play(actor.as_mut(), &recorded.rows("obs"), 3, &[1.0]);
        assert_close(&means, &recorded.values("mean"), name);
        assert_close(&deviations, &recorded.values("deviation"), name);
        let clipped: Vec<f32> = means.iter().map(|mean| mean.clamp(-1.0, 1.0)).collect();
        assert_close(&clipped, &recorded.values("clipped"), name);
        assert!(actor.clips_actions() && policy.is_stochastic());
    }
}

/// File name of a recorded policy.
fn name_of(policy: &str) -> String {
    format!("{policy}.zip")
}

#[test]
fn noise_that_depends_on_the_state_is_drawn_as_the_library_draws_it() {
    for name in ["ppo_gsde", "ppo_gsde_narrow"] {
        let (policy, recorded) = (open(&name_of(name)).policy, Recorded::of(name));
        let mut actor = policy.bind(&clean_task(5, 3), 1).unwrap();
        // The library kept one matrix; where the policy draws it anew, it draws the same again.
        let mut draws = recorded.values("draws").into_iter().cycle();
        let samples = sample(actor.as_mut(), &recorded.rows("obs"), 3, &mut draws);
        assert_close(&samples, &recorded.values("sample"), name);
    }
}

#[test]
fn a_lattice_correlates_its_noise_as_specified() {
    for name in ["lattice", "lattice_gsde", "lattice_gsde_full"] {
        let (policy, recorded) = (open(&name_of(name)).policy, Recorded::of(name));
        assert!(policy.is_stochastic(), "{name}");
        let mut actor = policy.bind(&clean_task(5, 3), 1).unwrap();
        let rows = recorded.rows("obs");
        let (means, deviations) = play(actor.as_mut(), &rows, 3, &[1.0]);
        assert_close(&means, &recorded.values("mean"), name);
        assert_close(&deviations, &recorded.values("deviation"), name);
        let mut draws = recorded.values("draws").into_iter();
        let samples = sample(actor.as_mut(), &rows, 3, &mut draws);
        assert_close(&samples, &recorded.values("sample"), name);
        assert_eq!(draws.next(), None, "{name} left draws over");
    }
}

#[test]
fn recurrent_policies_of_every_shape_answer_as_the_library() {
    for name in ["recurrent_two_layers", "recurrent_shared", "recurrent_plain_critic"] {
        let (policy, recorded) = (open(&name_of(name)).policy, Recorded::of(name));
        let mut actor = policy.bind(&clean_task(5, 3), 1).unwrap();
        let starts = recorded.values("start");
        let (means, deviations) = play(actor.as_mut(), &recorded.rows("obs"), 3, &starts);
        assert_close(&means, &recorded.values("mean"), name);
        assert!(deviations.iter().all(|deviation| deviation.is_finite()));
    }
}

#[test]
fn a_control_subspace_projects_the_mean_onto_as_many_rows_as_the_run_had() {
    let recorded = Recorded::of("subspace");
    let folder = tempfile::tempdir().unwrap();
    for file in ["subspace.zip", "subspace_vecnormalize.pkl"] {
        std::fs::copy(fixture(file), folder.path().join(file)).unwrap();
    }
    let play = || {
        let loaded = policy::open(&folder.path().join("subspace.zip"), None).unwrap();
        let mut actor = loaded.policy.bind(&clean_task(6, 4), 1).unwrap();
        (play(actor.as_mut(), &recorded.rows("obs"), 4, &[1.0]).0, loaded.warnings)
    };
    let (means, warnings) = play();
    assert!(warnings.iter().any(|text| text.contains("csi_subspace")), "{warnings:?}");
    let full = recorded.values("mean_4");
    // The rows are far from orthogonal; the library inverts their products in single precision.
    let assert_near = |found: &[f32], expected: &[f32]| {
        for (found, expected) in found.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-4 * (1.0 + expected.abs()), "{found} {expected}");
        }
    };
    assert_near(&means, &full);
    assert_near(&full, &recorded.values("free"));
    for size in [1, 2, 4] {
        let arguments = format!("{{\"csi_subspace\": {size}}}");
        write_atomic(&folder.path().join("args.json"), arguments.as_bytes()).unwrap();
        let (means, warnings) = play();
        assert_near(&means, &recorded.values(&format!("mean_{size}")));
        assert!(warnings.is_empty(), "{warnings:?}");
    }
    write_atomic(&folder.path().join("args.json"), br#"{"csi_subspace": -1}"#).unwrap();
    let error = policy::open(&folder.path().join("subspace.zip"), None).err().unwrap().to_string();
    assert!(error.contains("csi_subspace") && error.contains("args.json"), "{error}");
}

#[test]
fn a_policy_that_was_trained_without_a_normaliser_is_played_without_only_on_demand() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("ppo_no_hidden.zip");
    std::fs::copy(fixture("ppo_no_hidden.zip"), &path).unwrap();
    let message = policy::open(&path, None).err().unwrap().to_string();
    assert!(message.contains("needs the normaliser"), "{message}");
    let loaded = policy::open(&path, Some(Path::new(policy::NO_NORMALISER))).unwrap();
    assert!(loaded.normaliser_path.is_none() && loaded.normaliser_hash.is_none());
    let mut actor = loaded.policy.bind(&clean_task(5, 3), 1).unwrap();
    let weights = checkpoint::open(&path, &Limits::default()).unwrap().tensors;
    // Without hidden layers the mean of the zero observation is the bias, that of a unit vector one column more.
    let (weight, bias) = (&weights["action_net.weight"].data, &weights["action_net.bias"].data);
    let rows = [vec![0.0; 5], vec![0.0, 100.0, 0.0, 0.0, 0.0]];
    let (means, _) = play(actor.as_mut(), &rows, 3, &[1.0]);
    assert_close(&means[..3], bias, "bias");
    let column: Vec<f32> =
        (0..3).map(|muscle| bias[muscle] + 100.0 * weight[5 * muscle + 1]).collect();
    assert_close(&means[3..], &column, "column");
    let gradient = policy::open(&fixture("walking.pth"), Some(Path::new(policy::NO_NORMALISER)));
    assert!(gradient.is_err(), "the walking expert brings its own");
}

/// Five sensors and two muscles of a policy that was made for nine and three.
fn small_task() -> TaskInterface {
    TaskInterface {
        muscle_count: 2,
        muscle_observation_length: 5,
        observation_words: vec![vec![3], vec![130, 4], vec![5], vec![3], vec![6]],
        action_words: vec![vec![20], vec![21]],
        ..clean_task(0, 2)
    }
}

#[test]
fn multi_task_perceptrons_play_a_task_smaller_than_their_matrix() {
    for name in ["multi_task_ppo", "multi_task_sac"] {
        let (policy, recorded) = (open(&name_of(name)).policy, Recorded::of(name));
        assert_eq!(policy.variant(), ObservationVariant::Muscle);
        let mut actor = policy.bind(&small_task(), 1).unwrap();
        let (means, deviations) = play(actor.as_mut(), &recorded.rows("obs"), 2, &[1.0]);
        assert_close(&means, &recorded.values("mean"), name);
        assert_close(&deviations, &recorded.values("deviation"), name);
        let clipped: Vec<f32> = means.iter().map(|mean| mean.clamp(-1.0, 1.0)).collect();
        assert_close(&clipped, &recorded.values("clipped"), name);
        let large = TaskInterface {
            muscle_observation_length: 10,
            observation_words: vec![vec![3]; 10],
            ..small_task()
        };
        let message = policy.bind(&large, 1).err().unwrap().to_string();
        assert!(message.contains('9') && message.contains("10"), "{message}");
        let strong = TaskInterface { muscle_count: 4, ..small_task() };
        assert!(policy.bind(&strong, 1).is_err());
    }
}

#[test]
fn a_soft_actor_critic_squashes_its_samples() {
    let (policy, recorded) = (open("multi_task_sac.zip").policy, Recorded::of("multi_task_sac"));
    assert!(policy.is_stochastic());
    let mut actor = policy.bind(&small_task(), 1).unwrap();
    let mut draws = recorded.values("draws").into_iter();
    let samples = sample(actor.as_mut(), &recorded.rows("obs"), 2, &mut draws);
    assert_close(&samples, &recorded.values("sample"), "sample");
}

#[test]
fn loose_weights_are_completed_by_the_settings_beside_them() {
    let recorded = Recorded::of("loose/policy");
    let loose = open("loose/policy.pth");
    assert!(loose.normaliser_path.is_some_and(|path| path.ends_with("env.pkl")));
    let normaliser = fixture("loose/env.pkl");
    // What `policy.save` writes holds the policy's construction; of it, only the activation function's name is used.
    let saved = policy::open(&fixture("policy_save.pth"), Some(&normaliser)).unwrap();
    for policy in [loose.policy, saved.policy] {
        let mut actor = policy.bind(&clean_task(5, 3), 1).unwrap();
        let (means, _) = play(actor.as_mut(), &recorded.rows("obs"), 3, &[1.0]);
        assert_close(&means, &recorded.values("mean"), "mean");
    }
    let silent = policy::open(&fixture("state_dict_and_data.pth"), Some(&normaliser));
    let message = silent.err().unwrap().to_string();
    assert!(message.contains("the activation function"), "{message}");
}

fn muscles(recorded: &Recorded) -> Vec<MuscleModel> {
    let numbers = |name: &str| recorded.0.get(name).unwrap().to_f64();
    let (parameters, ranges, accelerations) =
        (numbers("parameters"), numbers("length_range"), numbers("acc0"));
    let (parameters, ranges) = (parameters.as_chunks::<9>().0, ranges.as_chunks::<2>().0);
    let constants = parameters.iter().zip(ranges).zip(accelerations);
    constants
        .map(|((parameters, &length_range), acceleration)| {
            let parameters = MuscleParameters::new(parameters);
            MuscleModel { gain: parameters, bias: parameters, length_range, acceleration }
        })
        .collect()
}

#[test]
fn gains_and_biases_of_muscles_are_those_of_the_physics_library() {
    let recorded = Recorded::of("walking");
    let muscles = muscles(&recorded);
    let numbers = |name: &str| recorded.0.get(name).unwrap().to_f64();
    let (lengths, velocities) = (numbers("length"), numbers("velocity"));
    let expected = numbers("gain").into_iter().zip(numbers("bias"));
    let states = lengths.iter().zip(&velocities).zip(muscles.iter().cycle());
    for (((length, velocity), muscle), (gain, bias)) in states.zip(expected) {
        let close =
            |found: f64, expected: f64| (found - expected).abs() < 1e-9 * (1.0 + expected.abs());
        assert!(close(muscle.gain(*length, *velocity), gain), "{gain} at {length}, {velocity}");
        assert!(close(muscle.bias(*length), bias), "{bias} at {length}");
    }
}

#[test]
fn the_walking_expert_pulls_towards_the_lengths_it_wishes() {
    let recorded = Recorded::of("walking");
    let policy = open("walking.pth").policy;
    assert_eq!(policy.variant(), ObservationVariant::CleanAndMuscles);
    assert!(!policy.is_stochastic());
    let task = TaskInterface { muscle_models: muscles(&recorded), ..clean_task(7, 4) };
    let mut actor = policy.bind(&task, 1).unwrap();
    let parts = ["obs", "length", "velocity"].map(|name| recorded.rows(name));
    let rows: Vec<Vec<f32>> = (0..parts[0].len())
        .map(|row| parts.iter().flat_map(|part| part[row].iter().copied()).collect())
        .collect();
    let (means, deviations) = play(actor.as_mut(), &rows, 4, &[1.0]);
    assert!(deviations.iter().all(|deviation| deviation.is_nan()) && !actor.clips_actions());
    let expected = recorded.values("action");
    assert!(expected.iter().any(|action| action.abs() < 0.99), "all muscles are saturated");
    for (found, expected) in means.iter().zip(&expected) {
        // The wished length has an error of some 1e-7 of its own, which the stiff spring magnifies.
        assert!((found - expected).abs() < 1e-4, "{found}, not {expected}");
    }
    let message = policy.bind(&clean_task(7, 4), 1).err().unwrap().to_string();
    assert!(message.contains("muscle models"), "{message}");
}

#[test]
fn an_ensemble_hands_over_where_its_classifier_says_so() {
    let loaded = open("ensemble/classifier.pt");
    let recorded = Recorded::of("ensemble/classifier");
    let mut actor = loaded.policy.bind(&clean_task(50, 2), 2).unwrap();
    for (episode, probability) in ["hold", "base"].into_iter().zip(recorded.values("probability")) {
        assert_eq!(episode == "hold", probability < 0.5);
        let rows = recorded.rows(&format!("obs_{episode}"));
        let (means, _) = play(actor.as_mut(), &rows, 2, &[1.0]);
        assert_close(&means, &recorded.values(&format!("action_{episode}")), episode);
    }
    // The hash covers every file, not the classifier alone.
    let classifier = std::fs::read(fixture("ensemble/classifier.pt")).unwrap();
    assert_ne!(loaded.checkpoint_hash, blake3::hash(&classifier).to_hex().to_string());
}

#[test]
fn an_incomplete_ensemble_is_refused_by_the_part_it_lacks() {
    let folder = tempfile::tempdir().unwrap();
    let classifier = folder.path().join("classifier.pt");
    std::fs::copy(fixture("ensemble/classifier.pt"), &classifier).unwrap();
    let refusal = || policy::open(&classifier, None).err().unwrap().to_string();
    assert!(refusal().contains("scaler.pkl"), "{}", refusal());
    std::fs::copy(fixture("ensemble/scaler.pkl"), folder.path().join("scaler.pkl")).unwrap();
    assert!(refusal().contains("base"), "{}", refusal());
    std::fs::create_dir(folder.path().join("base")).unwrap();
    assert!(refusal().contains("without a network"), "{}", refusal());
}

//! Losses, gradients and one step of the optimiser against PyTorch and Stable-Baselines3, on one small minibatch.
//!
//! `scripts/make_training_fixtures.py` makes the numbers in `tests/fixtures/training`. Parameters and samples are sines of
//! their place, here as there. The loss of BC is that of OBC: the two differ in whose actions the body is moved by.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

use arnold_analyze::npz::Arrays;
use arnold_analyze::policy::checkpoint::contents::Activation;
use arnold_analyze::policy::network::Sizes;
use arnold_analyze::train::adam::{Adam, AdamSettings};
use arnold_analyze::train::network::mlp::{Mlp, MlpSettings};
use arnold_analyze::train::network::padded_input::PaddedInput;
use arnold_analyze::train::network::soft::{SoftActorCritic, SoftSettings, Transitions};
use arnold_analyze::train::network::transformer::{
    Spread, TaskWords, Transformer, TransformerSettings,
};
use arnold_analyze::train::{Coefficients, ImitationLoss, Parameters, Sample, Trainable};

/// Relative to the largest number of a tensor; of a step: of the whole step.
const TOLERANCE: f64 = 1e-4;
/// What single precision leaves of a derivative that is exactly zero, relative to the norm of the gradient.
const ROUNDING: f64 = 1e-7;
const SAMPLES: usize = 6;
const LEARNING_RATE: f64 = 1e-3;

fn fixture(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/training").join(name)
}

fn wave(count: usize, seed: f64, scale: f64) -> Vec<f32> {
    (0..count).map(|i| (scale * (0.61 * i as f64 + seed).sin()) as f32).collect()
}

/// Fills the parameters as the script does.
fn set_waves(parameters: &mut Parameters, first: usize) {
    let places = parameters.places().to_vec();
    for (seed, place) in (first..).zip(&places) {
        let offset =
            if place.name.contains("norm") && place.name.ends_with("weight") { 1.0 } else { 0.0 };
        let mut numbers = wave(place.range.len(), seed as f64, 0.3);
        numbers.iter_mut().for_each(|x| *x += offset);
        if place.name.contains("embedding") {
            numbers[..place.shape[1]].fill(0.0);
        }
        parameters.numbers_mut()[place.range.clone()].copy_from_slice(&numbers);
    }
}

/// The recipes of the script.
fn recipes() -> [(&'static str, Coefficients); 4] {
    let recipe = |policy_gradient, entropy, imitation, imitation_loss| Coefficients {
        policy_gradient,
        entropy,
        imitation,
        imitation_loss,
        ..Coefficients::default()
    };
    [
        ("ppo", recipe(1.0, 1e-2, 0.0, ImitationLoss::SquaredPerSample)),
        ("obc", recipe(0.0, 0.0, 1.0, ImitationLoss::SquaredPerSample)),
        ("obc_ppo", recipe(1.0, 1e-6, 1.0, ImitationLoss::SquaredOverAll)),
        ("density", recipe(0.0, 0.0, 1.0, ImitationLoss::NegativeLogProbability)),
    ]
}

/// One step of every recipe from the same start. `lengths` gives observation, muscles and action of a row.
fn compare(
    name: &str,
    make: impl Fn() -> Box<dyn Trainable>,
    lengths: impl Fn(usize) -> [usize; 3],
) {
    let recorded = Arrays::open(&fixture(&format!("{name}.npz"))).unwrap();
    let numbers = |name: String| recorded.get(&name).unwrap().to_f64();
    let old = numbers("old_log_probability".to_owned());
    let (advantages, targets) = (wave(SAMPLES, 3.0, 1.0), wave(SAMPLES, 4.0, 1.0));
    let rows: Vec<[Vec<f32>; 4]> = (0..SAMPLES)
        .map(|row| {
            let [observation, muscles, action] = lengths(row);
            let wave = |length, seed: usize| wave(length, (seed + row) as f64, 1.0);
            [wave(observation, 10), wave(action, 20), wave(muscles, 30), wave(action, 40)]
        })
        .collect();
    let sample = |row: usize, task: usize| {
        let [observation, action, expert_action, noise] = &rows[row];
        Sample {
            task,
            observation,
            action,
            old_log_probability: old[row] as f32,
            advantage: advantages[row],
            value_target: targets[row],
            expert_action,
            noise,
        }
    };
    for (recipe, coefficients) in recipes() {
        let mut network = make();
        set_waves(network.parameters_mut(), 0);
        let tasks = if name == "mlp" { 1 } else { 2 };
        let samples: Vec<_> = (0..SAMPLES).map(|row| sample(row, row % tasks)).collect();
        let mut gradient = Vec::new();
        let losses = network.gradient(&samples, &coefficients, 2, &mut gradient).unwrap();

        let imitation = if coefficients.imitates() { losses.imitation } else { f64::NAN };
        let found = [losses.total, losses.policy_gradient, losses.value, losses.entropy, imitation];
        for (found, expected) in found.iter().zip(numbers(format!("{recipe}_losses"))) {
            let error = (found - expected).abs();
            assert!(
                found.is_nan() || error <= TOLERANCE * expected.abs(),
                "{name}, {recipe}: {found}, {expected}"
            );
        }

        let expected = numbers(format!("{recipe}_gradient"));
        let norm = assert_gradient(
            &format!("{name}, {recipe}"),
            network.parameters(),
            &gradient,
            &expected,
        );

        let before = network.parameters().numbers().to_vec();
        let mut adam = Adam::new(AdamSettings::default(), network.parameters());
        let found =
            adam.step(network.parameters_mut(), &gradient, LEARNING_RATE, Some(0.7)).unwrap();
        assert!((found - norm).abs() <= TOLERANCE * norm, "{name}, {recipe}");
        let expected = numbers(format!("{recipe}_step"));
        assert_step(&format!("{name}, {recipe}"), network.parameters(), &before, &expected);
    }
}

/// Every number of a gradient. Returns the norm of the one that is expected.
fn assert_gradient(name: &str, parameters: &Parameters, gradient: &[f32], expected: &[f64]) -> f64 {
    assert_eq!(gradient.len(), expected.len(), "{name}");
    let norm = expected.iter().map(|g| g * g).sum::<f64>().sqrt();
    for place in parameters.places() {
        let (found, expected) = (&gradient[place.range.clone()], &expected[place.range.clone()]);
        let largest = expected.iter().fold(0.0_f64, |largest, g| largest.max(g.abs()));
        for (found, expected) in found.iter().zip(expected) {
            assert!(
                (f64::from(*found) - expected).abs() <= TOLERANCE * largest + ROUNDING * norm,
                "{name}, `{}`: {found} instead of {expected}, the largest is {largest}",
                place.name
            );
        }
    }
    norm
}

/// How far the parameters have gone from `before`.
fn assert_step(name: &str, parameters: &Parameters, before: &[f32], expected: &[f64]) {
    let squares = |numbers: &mut dyn Iterator<Item = f64>| numbers.map(|x| x * x).sum::<f64>();
    let step = parameters.numbers().iter().zip(before);
    let mut errors = step
        .zip(expected)
        .map(|((after, before), expected)| f64::from(*after) - f64::from(*before) - expected);
    let error = (squares(&mut errors) / squares(&mut expected.iter().copied())).sqrt();
    assert!(error <= TOLERANCE, "{name}: the step differs by {error}");
}

/// Names and shapes in the optimiser's order.
fn assert_same_tensors(parameters: &[&Parameters], name: &str) {
    let expected = std::fs::read_to_string(fixture(name)).unwrap();
    let places = parameters.iter().flat_map(|parameters| parameters.places());
    let found: Vec<String> =
        places.map(|place| format!("{} {:?}", place.name, place.shape)).collect();
    assert_eq!(found, expected.lines().collect::<Vec<_>>());
}

#[test]
fn a_perceptron_takes_the_steps_of_stable_baselines() {
    let settings = MlpSettings {
        observations: 5,
        muscles: 4,
        policy_layers: vec![7, 6],
        value_layers: vec![8],
        ..MlpSettings::default()
    };
    let make = || -> Box<dyn Trainable> { Box::new(Mlp::untrained(settings.clone()).unwrap()) };
    assert_same_tensors(&[make().parameters()], "mlp.txt");
    compare("mlp", make, |_| [5, 4, 4]);
}

#[test]
fn a_soft_actor_critic_takes_the_steps_of_stable_baselines() {
    const STATES: usize = 5;
    const ACTIONS: usize = 3;
    let input = PaddedInput::new(vec![STATES]);
    let (hidden, activation) = (vec![7, 6], Activation::Relu);
    let settings = SoftSettings { input, actions: ACTIONS, hidden, activation };
    let mut network = SoftActorCritic::untrained(settings).unwrap();
    assert_same_tensors(&[&network.actor, &network.critics], "soft.txt");
    set_waves(&mut network.actor, 0);
    // Targets begin as copies of critics, so they are set first.
    set_waves(&mut network.critics, 40);
    network.follow(1.0);
    set_waves(&mut network.critics, 20);
    let rows = |length: usize, seed: usize, scale: f64| -> Vec<f32> {
        (0..SAMPLES).flat_map(|row| wave(length, (seed + row) as f64, scale)).collect()
    };
    let batch = Transitions {
        states: rows(STATES, 10, 1.0),
        next_states: rows(STATES, 20, 1.0),
        actions: rows(ACTIONS, 30, 0.9),
        noise: rows(ACTIONS, 40, 1.0),
        next_noise: rows(ACTIONS, 50, 1.0),
        rewards: wave(SAMPLES, 3.0, 1.0),
        goes_on: vec![1.0, 1.0, 0.0, 1.0, 1.0, 1.0],
    };
    let recorded = Arrays::open(&fixture("soft.npz")).unwrap();
    let numbers = |name: &str| recorded.get(name).unwrap().to_f64();
    let losses = numbers("losses");
    let close = |what: &str, found: f64, expected: f64| {
        assert!(
            (found - expected).abs() <= TOLERANCE * expected.abs(),
            "{what}: {found}, {expected}"
        );
    };
    let settings = AdamSettings { epsilon: 1e-8, ..AdamSettings::default() };
    let temperature = (-0.5_f64).exp();
    let mut gradient = Vec::new();

    let judged = network.critic_gradient(&batch, temperature, 0.99, 2, &mut gradient);
    close("critics", judged.critic, losses[0]);
    assert_gradient("critics", &network.critics, &gradient, &numbers("critic_gradient"));
    let before = network.critics.numbers().to_vec();
    let mut adam = Adam::new(settings, &network.critics);
    adam.step(&mut network.critics, &gradient, LEARNING_RATE, None).unwrap();
    assert_step("critics", &network.critics, &before, &numbers("critic_step"));

    let acted = network.actor_gradient(&batch, temperature, 2, &mut gradient);
    close("actor", acted.actor, losses[1]);
    close("density", acted.log_probability, losses[2]);
    assert_gradient("actor", &network.actor, &gradient, &numbers("actor_gradient"));
    let before = network.actor.numbers().to_vec();
    let mut adam = Adam::new(settings, &network.actor);
    adam.step(&mut network.actor, &gradient, LEARNING_RATE, None).unwrap();
    assert_step("actor", &network.actor, &before, &numbers("actor_step"));

    network.follow(0.005);
    for (found, expected) in network.targets().iter().zip(numbers("target")) {
        assert!((f64::from(*found) - expected).abs() <= 1e-6, "target: {found}, {expected}");
    }

    let mut temperature = Parameters::zeros([("log_ent_coef".to_owned(), Vec::new())]);
    temperature.fill("log_ent_coef", -0.5).unwrap();
    let excess = acted.log_probability - ACTIONS as f64;
    let mut adam = Adam::new(settings, &temperature);
    adam.step(&mut temperature, &[-excess as f32], LEARNING_RATE, None).unwrap();
    close("temperature", temperature.numbers()[0].into(), numbers("log_temperature")[0]);
}

/// Tokens and muscles of the script's tasks.
const TASKS: [[usize; 2]; 2] = [[7, 5], [4, 2]];
const LAGS: usize = 3;

fn transformer(spread: Spread) -> Box<dyn Trainable> {
    let sizes = Sizes {
        vocabulary: 9,
        lags: LAGS,
        width: 8,
        heads: 2,
        feed_forward: 12,
        encoder_layers: 2,
        decoder_layers: 2,
    };
    let words = |count: usize| -> Vec<Vec<u16>> {
        let description =
            |i: usize| (0..=i % 3).map(|k| 2 + ((i * 5 + k * 3) % 7) as u16).collect();
        (0..count).map(description).collect()
    };
    let task = |[tokens, muscles]: [usize; 2]| TaskWords {
        task: format!("of {tokens} tokens"),
        sensors: words(tokens),
        muscles: words(muscles),
        action_length: TASKS[0][1],
    };
    let settings = TransformerSettings { spread, ..TransformerSettings::published(sizes) };
    Box::new(Transformer::untrained(settings, TASKS.map(task).to_vec()).unwrap())
}

#[test]
fn a_transformer_takes_the_steps_of_torch() {
    assert_same_tensors(&[transformer(Spread::Observation).parameters()], "transformer.txt");
    let lengths = |row: usize| {
        let [tokens, muscles] = TASKS[row % 2];
        [tokens * LAGS, muscles, TASKS[0][1]]
    };
    compare("transformer", || transformer(Spread::Observation), lengths);
    compare("transformer_over_batch", || transformer(Spread::Minibatch), lengths);
}

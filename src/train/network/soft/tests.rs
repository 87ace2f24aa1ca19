use super::*;
use crate::policy::checkpoint::contents::Normaliser;
use crate::policy::interface::{Policy, TaskInterface};
use crate::policy::policies::mlp::MlpPolicy;
use crate::train::network::Player;
use crate::train::network::differences::compare_tensors;

const ACTIONS: usize = 3;
const ROWS: usize = 12;
const TEMPERATURE: f64 = 0.3;

fn network(activation: Activation) -> SoftActorCritic {
    let input = PaddedInput::new(vec![5]);
    let settings = SoftSettings { input, actions: ACTIONS, hidden: vec![7, 6], activation };
    let mut random = Random::new([9; 32]);
    let mut network = SoftActorCritic::new(settings, &mut random).unwrap();
    for x in network.critics.numbers_mut() {
        *x += 0.2 * random.normal() as f32;
    }
    network
}

fn batch(rows: usize) -> Transitions {
    let mut random = Random::new([5; 32]);
    let mut normal = |n: usize| -> Vec<f32> { (0..n).map(|_| random.normal() as f32).collect() };
    Transitions {
        states: normal(rows * 5),
        actions: normal(rows * ACTIONS).iter().map(|x| x.tanh()).collect(),
        rewards: normal(rows),
        goes_on: (0..rows).map(|row| if row % 4 == 3 { 0.0 } else { 1.0 }).collect(),
        next_states: normal(rows * 5),
        noise: normal(rows * ACTIONS),
        next_noise: normal(rows * ACTIONS),
    }
}

#[test]
fn the_critics_have_the_gradient_of_their_differences() {
    let mut network = network(Activation::Tanh);
    let batch = batch(ROWS);
    let mut gradient = Vec::new();
    network.critic_gradient(&batch, TEMPERATURE, 0.9, 1, &mut gradient);
    let (places, start) = (network.critics.places().to_vec(), network.critics.numbers().to_vec());
    let mut random = Random::new([6; 32]);
    let moved =
        compare_tensors("critics", &places, &start, &gradient, 0.02, &mut random, &mut |numbers| {
            network.critics.numbers_mut().copy_from_slice(numbers);
            network.critic_gradient(&batch, TEMPERATURE, 0.9, 1, &mut Vec::new()).critic
        });
    assert!(moved > 0, "every gradient was negligible");
}

#[test]
fn the_actor_has_the_gradient_of_its_differences() {
    for temperature in [0.0, TEMPERATURE, 2.0] {
        let mut network = network(Activation::Tanh);
        let batch = batch(ROWS);
        let mut gradient = Vec::new();
        network.actor_gradient(&batch, temperature, 1, &mut gradient);
        let (places, start) = (network.actor.places().to_vec(), network.actor.numbers().to_vec());
        let mut random = Random::new([6; 32]);
        let moved = compare_tensors(
            "actor",
            &places,
            &start,
            &gradient,
            0.01,
            &mut random,
            &mut |numbers| {
                network.actor.numbers_mut().copy_from_slice(numbers);
                network.actor_gradient(&batch, temperature, 1, &mut Vec::new()).actor
            },
        );
        assert!(moved > 0, "every gradient was negligible");
    }
}

#[test]
fn a_deviation_out_of_its_bounds_learns_nothing() {
    let mut network = network(Activation::Relu);
    let bias = network.actor.place("actor.log_std.bias").unwrap().range.clone();
    network.actor.numbers_mut()[bias.clone()].copy_from_slice(&[-40.0, 0.0, 40.0]);
    let mut gradient = Vec::new();
    network.actor_gradient(&batch(ROWS), TEMPERATURE, 1, &mut gradient);
    let zero = gradient[bias].iter().map(|&g| g == 0.0).collect::<Vec<_>>();
    assert_eq!(zero, [true, false, true]);
}

#[test]
fn threads_do_not_change_a_byte() {
    let network = network(Activation::Relu);
    let batch = batch(70);
    let run = |threads| {
        let (mut critics, mut actor) = (Vec::new(), Vec::new());
        let judged = network.critic_gradient(&batch, TEMPERATURE, 0.9, threads, &mut critics);
        let acted = network.actor_gradient(&batch, TEMPERATURE, threads, &mut actor);
        let bits: Vec<u32> = critics.iter().chain(&actor).map(|x| x.to_bits()).collect();
        (judged, acted, bits)
    };
    let one = run(1);
    assert!([2, 3, 8].into_iter().all(|threads| run(threads) == one));
}

#[test]
fn targets_follow_the_critics_by_their_rate() {
    let mut network = network(Activation::Relu);
    let (before, critics) = (network.targets().to_vec(), network.critics.numbers().to_vec());
    network.follow(0.25);
    for ((after, before), critic) in network.targets().iter().zip(before).zip(critics) {
        assert!((after - (0.75 * before + 0.25 * critic)).abs() < 1e-6);
    }
}

#[test]
fn policy_reads_back_what_was_trained() {
    let network = network(Activation::Relu);
    let checkpoint = network.checkpoint();
    let (tensors, scalars) = (&checkpoint.tensors, &checkpoint.scalars);
    let policy = MlpPolicy::soft_actor_critic(tensors, scalars, &Normaliser::none()).unwrap();
    let task = TaskInterface {
        task: "any".to_owned(),
        muscle_count: ACTIONS,
        muscle_observation_length: 5,
        clean_observation_length: 5,
        observation_words: Vec::new(),
        action_words: Vec::new(),
        muscle_models: Vec::new(),
    };
    let mut actor = policy.bind(&task, 1).unwrap();
    actor.reset(0);
    let observation = [0.3, -0.2, 0.9, 0.1, -1.2];
    let (mut means, mut deviations) = ([0.0; ACTIONS], [0.0; ACTIONS]);
    actor.act(&[0], &observation, &mut means, Some(&mut deviations));
    let mut player = SoftPlayer::new(&network);
    for noise in [[0.0; ACTIONS], [0.4, -1.3, 0.8]] {
        let mut action = [0.0; ACTIONS];
        player.decide(0, &observation, &noise, &mut action);
        let mut expected = means;
        let mut draws = noise.iter().map(|&x| f64::from(x));
        actor.sample(0, &deviations, &mut expected, &mut || draws.next().unwrap());
        for (found, expected) in action.iter().zip(&expected) {
            assert!((found - expected).abs() < 1e-6, "{action:?} {expected:?}");
        }
    }
}

#[test]
fn random_actions_fill_their_range_evenly() {
    let mut random = Random::new([7; 32]);
    let noise: Vec<f32> = (0..40_000).map(|_| random.normal() as f32).collect();
    let mut actions = vec![0.0; noise.len()];
    UniformPlayer.decide(0, &[], &noise, &mut actions);
    for edge in [-0.8_f32, -0.3, 0.0, 0.5, 0.9] {
        let below = actions.iter().filter(|&&a| a < edge).count() as f32 / noise.len() as f32;
        // Four standard errors of a share.
        assert!((below - f32::midpoint(1.0, edge)).abs() < 0.01, "{below} below {edge}");
    }
}

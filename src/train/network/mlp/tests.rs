//! Derivatives against differences, bytes against threads, checkpoints against their reader.

use super::*;
use crate::policy::checkpoint::contents::Normaliser;
use crate::policy::interface::{Policy, TaskInterface};
use crate::policy::policies::mlp::MlpPolicy;
use crate::train::network::differences::{Batch, compare, every_loss, every_loss_at_once};

fn network(change: impl FnOnce(&mut MlpSettings)) -> Mlp {
    let mut settings = MlpSettings {
        observations: 5,
        muscles: 4,
        policy_layers: vec![7, 6],
        value_layers: vec![8],
        log_deviation: -0.3,
        orthogonal: false,
        ..MlpSettings::default()
    };
    change(&mut settings);
    let mut random = Random::new([9; 32]);
    let mut network = Mlp::new(settings, &mut random).unwrap();
    // Away from the symmetric start.
    for x in network.parameters_mut().numbers_mut() {
        *x += 0.2 * random.normal() as f32;
    }
    network
}

#[test]
fn every_loss_has_the_gradient_of_its_differences() {
    compare(&mut network(|_| ()), &[[5, 4]], &every_loss(), |_| true, 0.02);
}

#[test]
fn every_activation_has_the_gradient_of_its_differences() {
    // The rectifier's corners are kept away from by a small step.
    for (activation, step) in
        [(Activation::Elu, 0.01), (Activation::Silu, 0.02), (Activation::Gelu, 0.02)]
    {
        let mut network = network(|settings| settings.activation = activation);
        compare(&mut network, &[[5, 4]], &[("all", every_loss_at_once())], |_| true, step);
    }
}

#[test]
fn networks_without_hidden_layers_have_gradients_too() {
    let mut network = network(|settings| {
        settings.policy_layers.clear();
        settings.value_layers.clear();
    });
    compare(&mut network, &[[5, 4]], &every_loss(), |_| true, 0.005);
}

#[test]
fn a_lattice_has_the_gradient_of_its_differences() {
    let mut network = network(|settings| settings.lattice = true);
    compare(&mut network, &[[5, 4]], &every_loss(), |_| true, 0.02);
}

#[test]
fn a_control_subspace_has_the_gradient_of_its_differences() {
    for size in [1, 2, 9] {
        let subspace = Some(SubspaceSettings { size, trainable: true });
        let mut network = network(|settings| settings.subspace = subspace);
        compare(&mut network, &[[5, 4]], &every_loss(), |_| true, 0.01);
    }
}

#[test]
fn a_fixed_subspace_keeps_its_projection() {
    let subspace = Some(SubspaceSettings { size: 2, trainable: false });
    let network = network(|settings| settings.subspace = subspace);
    let batch = Batch::new(&network, &[[5, 4]], 6);
    let mut gradient = Vec::new();
    network.gradient(&batch.samples(), &every_loss_at_once(), 1, &mut gradient).unwrap();
    for place in network.parameters().places() {
        let zero = gradient[place.range.clone()].iter().all(|&g| g == 0.0);
        assert_eq!(zero, !place.trainable, "{}", place.name);
    }
}

#[test]
fn threads_do_not_change_a_byte() {
    let network = network(|settings| settings.lattice = true);
    let batch = Batch::new(&network, &[[5, 4]], 70);
    let run = |threads| {
        let mut gradient = Vec::new();
        let losses = network
            .gradient(&batch.samples(), &every_loss_at_once(), threads, &mut gradient)
            .unwrap();
        (losses, gradient.into_iter().map(f32::to_bits).collect::<Vec<_>>())
    };
    let one = run(1);
    assert!([2, 3, 8].into_iter().all(|threads| run(threads) == one));
}

#[test]
fn policy_reads_back_what_was_trained() {
    let plain = network(|_| ());
    let lattice = network(|settings| settings.lattice = true);
    let subspace = Some(SubspaceSettings { size: 2, trainable: true });
    let subspace = network(|settings| settings.subspace = subspace);
    for network in [plain, lattice, subspace] {
        let checkpoint = network.checkpoint();
        let normaliser = Normaliser::none();
        let policy = MlpPolicy::ppo(&checkpoint.tensors, &checkpoint.scalars, &normaliser).unwrap();
        assert!(policy.is_stochastic());
        let task = TaskInterface {
            task: "any".to_owned(),
            muscle_count: 4,
            muscle_observation_length: 5,
            clean_observation_length: 5,
            observation_words: Vec::new(),
            action_words: Vec::new(),
            muscle_models: Vec::new(),
        };
        let mut actor = policy.bind(&task, 1).unwrap();
        actor.reset(0);
        let observation = [0.3, -0.2, 0.9, 0.1, -1.2];
        let (mut means, mut deviations) = ([0.0; 4], [0.0; 4]);
        actor.act(&[0], &observation, &mut means, Some(&mut deviations));
        let noise: Vec<f32> = (0..network.noise_length(0)).map(|i| (i as f32).sin()).collect();
        let mut player = network.player();
        for noise in [vec![0.0; noise.len()], noise] {
            let mut action = [0.0; 4];
            player.decide(0, &observation, &noise, &mut action);
            let mut expected = means;
            let mut draws = noise.iter().map(|&x| f64::from(x));
            actor.sample(0, &deviations, &mut expected, &mut || draws.next().unwrap());
            for (found, expected) in action.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-5, "{action:?} {expected:?}");
            }
        }
    }
}

#[test]
fn a_sample_that_does_not_fit_is_named() {
    let network = network(|_| ());
    let batch = Batch::new(&network, &[[5, 4]], 3);
    let mut samples = batch.samples();
    samples[2].observation = &[0.0; 4];
    let error = network
        .gradient(&samples, &Coefficients::default(), 1, &mut Vec::new())
        .unwrap_err()
        .to_string();
    assert!(error.contains("sample 2") && error.contains("observation"), "{error}");
}

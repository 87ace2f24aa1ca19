//! Derivatives against differences, bytes against threads, checkpoints against their reader.

use super::*;
use crate::policy::network::Sizes;
use crate::policy::network::transformer::Transformer as Reader;
use crate::train::network::differences::{Batch, compare, every_loss, every_loss_at_once};

const SIZES: Sizes = Sizes {
    vocabulary: 9,
    lags: 3,
    width: 8,
    heads: 2,
    feed_forward: 12,
    encoder_layers: 2,
    decoder_layers: 2,
};

/// Small, because log-probabilities must stay on their side of the clipping.
const STEP: f64 = 4e-3;

/// Observation lengths and muscles of the tasks below.
const TASKS: [[usize; 2]; 2] = [[18 * 3, 5], [4 * 3, 2]];

fn words(task: &str, [observation, muscles]: [usize; 2], action_length: usize) -> TaskWords {
    let description =
        |i: usize| -> Vec<u16> { (0..=i % 3).map(|k| 2 + ((i * 5 + k * 3) % 7) as u16).collect() };
    TaskWords {
        task: task.to_owned(),
        sensors: (0..observation / SIZES.lags).map(description).collect(),
        muscles: (1..=muscles).map(description).collect(),
        action_length,
    }
}

fn network(change: impl FnOnce(&mut TransformerSettings), padded: bool) -> Transformer {
    let mut settings = TransformerSettings::published(SIZES);
    settings.log_deviation = -0.2;
    change(&mut settings);
    let length = |muscles: usize| if padded { 7 } else { muscles };
    let tasks = vec![
        words("one", TASKS[0], length(TASKS[0][1])),
        words("other", TASKS[1], length(TASKS[1][1])),
    ];
    let mut random = Random::new([3; 32]);
    let mut network = Transformer::new(settings, tasks, &mut random).unwrap();
    // Away from the symmetric start, and with a scale head that matters.
    let scale = network.parameters.place("log_std_net.0.weight").map(|p| p.range.clone());
    for (i, x) in network.parameters.numbers_mut().iter_mut().enumerate() {
        let wide = scale.as_ref().is_ok_and(|range| range.contains(&i));
        *x += if wide { 1.0 } else { 0.1 } * random.normal() as f32;
    }
    // Rectifiers far from their corners, half of them open: differences cannot stand a corner, PyTorch's gradients can.
    for place in network.parameters.places().to_vec() {
        if place.name.ends_with("linear1.bias") {
            for (i, x) in network.parameters.numbers_mut()[place.range].iter_mut().enumerate() {
                *x += if i % 2 == 0 { 5.0 } else { -5.0 };
            }
        }
    }
    network
}

/// The scale head looks at the decoded queries without moving them, which differences cannot see. So networks are compared
/// without it, and it on its own; PyTorch's gradients, which hold what they should, are compared elsewhere.
fn compare_without_scale_head(
    change: impl FnOnce(&mut TransformerSettings),
    padded: bool,
    losses: &[(&str, Coefficients)],
) {
    let change = |settings: &mut TransformerSettings| {
        settings.scaled_variance = false;
        change(settings);
    };
    compare(&mut network(change, padded), &TASKS, losses, |_| true, STEP);
}

#[test]
fn every_loss_has_the_gradient_of_its_differences() {
    compare_without_scale_head(|_| (), false, &every_loss());
}

#[test]
fn padded_actions_have_the_gradient_of_their_differences() {
    compare_without_scale_head(|_| (), true, &every_loss());
}

#[test]
fn every_variant_has_the_gradient_of_its_differences() {
    let all = &[("all", every_loss_at_once())];
    compare_without_scale_head(|settings| settings.tables = Tables::PerTask, false, all);
    compare_without_scale_head(|settings| settings.shared_decoder = true, false, all);
}

#[test]
fn the_scale_head_has_the_gradient_of_its_differences() {
    for (spread, padded) in [
        (Spread::Observation, false),
        (Spread::Observation, true),
        (Spread::Minibatch, false),
        (Spread::Minibatch, true),
    ] {
        let mut network = network(|settings| settings.spread = spread, padded);
        let is_compared = |name: &str| name.starts_with("log_std");
        compare(&mut network, &TASKS, &every_loss(), is_compared, STEP);
    }
}

#[test]
fn a_frozen_table_has_no_gradient() {
    let network = network(|settings| settings.tables = Tables::PerTaskFrozen, false);
    let batch = Batch::new(&network, &TASKS, 6);
    let mut gradient = Vec::new();
    network.gradient(&batch.samples(), &every_loss_at_once(), 1, &mut gradient).unwrap();
    for place in network.parameters().places().iter().filter(|place| !place.trainable) {
        assert!(gradient[place.range.clone()].iter().all(|&g| g == 0.0), "{}", place.name);
    }
}

#[test]
fn threads_do_not_change_a_byte() {
    for spread in [Spread::Observation, Spread::Minibatch] {
        let network = network(|settings| settings.spread = spread, true);
        let batch = Batch::new(&network, &TASKS, 37);
        let run = |threads| {
            let mut gradient = Vec::new();
            let coefficients = &every_loss_at_once();
            let losses =
                network.gradient(&batch.samples(), coefficients, threads, &mut gradient).unwrap();
            (losses, gradient.into_iter().map(f32::to_bits).collect::<Vec<_>>())
        };
        let one = run(1);
        assert!([2, 3].into_iter().all(|threads| run(threads) == one));
    }
}

#[test]
fn policy_reads_back_what_was_trained() {
    for (tables, shared, scaled) in [
        (Tables::Shared, false, true),
        (Tables::PerTask, false, true),
        (Tables::Shared, true, true),
        (Tables::Shared, false, false),
    ] {
        let network = network(
            |settings| {
                settings.tables = tables;
                settings.shared_decoder = shared;
                settings.scaled_variance = scaled;
            },
            false,
        );
        let reader =
            Reader::from_tensors(&network.checkpoint().tensors, SIZES.heads, scaled).unwrap();
        let mut player = network.player();
        for (index, task) in network.tasks().iter().enumerate() {
            let constants =
                reader.prepare(&task.task, &task.sensors, &task.muscles, false).unwrap();
            let mut workspace = reader.workspace(&constants);
            let observation: Vec<f32> =
                (0..TASKS[index][0]).map(|i| (i as f32 * 0.7).sin()).collect();
            reader.encode(&constants, &observation, &mut workspace);
            let muscles = task.muscles.len();
            let (mut means, mut deviations) = (vec![0.0; muscles], vec![0.0; muscles]);
            reader.action_means(&constants, &mut workspace, &mut means);
            reader.standard_deviations(&workspace, &mut deviations);
            let value = reader.value(&constants, &mut workspace);
            let (mut mean, mut one) = (vec![0.0; muscles], vec![0.0; muscles]);
            let decision = player.decide(index, &observation, &vec![0.0; muscles], &mut mean);
            player.decide(index, &observation, &vec![1.0; muscles], &mut one);
            assert!((decision.value - value).abs() < 1e-5);
            for i in 0..muscles {
                assert!((mean[i] - means[i]).abs() < 1e-5, "{mean:?} {means:?}");
                assert!((one[i] - mean[i] - deviations[i]).abs() < 1e-5);
            }
        }
    }
}

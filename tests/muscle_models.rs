//! The muscle model that the walking expert inverts is the one that the engine computes forces with.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]

mod common;

use arnold_analyze::assets::PhysicsVersion;
use arnold_analyze::policy::ObservationVariant;
use arnold_analyze::sim::random::Random;
use arnold_analyze::sim::tasks;
use common::physics::Physics;

#[test]
fn gain_times_activation_plus_bias_is_the_force_of_every_muscle() {
    for version in [PhysicsVersion::V2_3_7, PhysicsVersion::V3_17_0] {
        let physics = Physics::of(version);
        for task in ["elbow_pose", "baoding_p1_cw"] {
            let mut environment = physics.body(tasks::find(task).unwrap());
            let muscles = environment.interface().muscle_models;
            let mut random = Random::new([3; 32]);
            environment.reset(&mut random);
            let (mut pulling, mut stretched) = (0, 0);
            for _ in 0..40 {
                let actions: Vec<f32> =
                    muscles.iter().map(|_| 0.8 * random.normal() as f32).collect();
                environment.step(&actions);
                let body = environment.simulation();
                for (index, muscle) in muscles.iter().enumerate() {
                    let length = body.muscle_length()[index];
                    let gain = muscle.gain(length, body.muscle_velocity()[index]);
                    let bias = muscle.bias(length);
                    let expected = body.muscle_force()[index];
                    // Below the shortest length 2.3.7 continues the curve beyond zero, so that the muscle pushes.
                    if version == PhysicsVersion::V2_3_7 && gain >= 0.0 {
                        assert!(expected >= bias, "{task}, muscle {index}: {expected} N");
                        continue;
                    }
                    let found = gain * body.activation()[index] + bias;
                    let tolerance = 1e-9 * (1.0 + expected.abs());
                    assert!(
                        (found - expected).abs() < tolerance,
                        "{task} in {version}, muscle {index}: {found}, not {expected} N"
                    );
                    pulling += usize::from(gain < -1.0);
                    stretched += usize::from(bias < 0.0);
                }
            }
            assert!(pulling > 0 && stretched > 0, "{task}: no muscle pulled or was stretched");
        }
    }
}

#[test]
fn lengths_and_velocities_follow_the_clean_observation() {
    let physics = Physics::of(PhysicsVersion::V3_17_0);
    let mut environment = physics.body(tasks::find("elbow_pose").unwrap());
    environment.reset(&mut Random::new([4; 32]));
    environment.step(&[0.3; 6]);
    let read = |variant| {
        let mut observation = vec![0.0; environment.observation_length(variant)];
        environment.read_observation(variant, &mut observation);
        observation
    };
    let clean = read(ObservationVariant::Clean);
    let all = read(ObservationVariant::CleanAndMuscles);
    assert_eq!(all.len(), clean.len() + 12);
    assert_eq!(all[..clean.len()], clean);
    let body = environment.simulation();
    let state = body.muscle_length().iter().chain(body.muscle_velocity()).map(|&x| x as f32);
    assert!(all[clean.len()..].iter().copied().eq(state));
}

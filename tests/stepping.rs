//! What our control step leaves out changes no bit: after the first half of a step, accelerations alone give the state
//! that `mj_forward` gives, in both physics, for every task that is stepped so.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
mod common;

use arnold_analyze::assets::PhysicsVersion;
use arnold_analyze::sim::engine::Simulation;
use arnold_analyze::sim::muscles;
use arnold_analyze::sim::random::Random;
use arnold_analyze::sim::tasks::{self, Definition, Stepping};
use common::physics::Physics;

const STEPS: usize = 25;

/// The bits of everything a task or a recording looks at.
fn bits(simulation: &Simulation) -> Vec<u64> {
    let arrays = [
        simulation.qpos(),
        simulation.qvel(),
        simulation.qacc(),
        simulation.warm_start(),
        simulation.activation(),
        simulation.sensors(),
        simulation.muscle_length(),
        simulation.muscle_velocity(),
        simulation.muscle_force(),
        simulation.body_positions(),
        simulation.body_orientations(),
        simulation.body_matrices(),
        simulation.site_positions(),
        simulation.site_matrices(),
    ];
    arrays.concat().into_iter().map(f64::to_bits).collect()
}

/// One control step in the published order, up to what is computed last.
fn most_of_a_step(simulation: &mut Simulation, task: &Definition, actions: &mut Random) {
    for excitation in simulation.excitation_mut() {
        *excitation = muscles::excitation(actions.uniform(-1.0, 1.0) as f32);
    }
    simulation.step_second_half();
    (1..task.substeps).for_each(|_| simulation.step());
    simulation.step_first_half();
}

#[test]
fn accelerations_after_the_first_half_are_all_that_forward_adds() {
    for version in [PhysicsVersion::V2_3_7, PhysicsVersion::V3_17_0] {
        let physics = Physics::of(version);
        // Tasks of one finger or direction differ in nothing that is stepped.
        for name in ["elbow_pose", "hand_index_reach", "baoding_p2", "reorient", "pen", "relocate"]
        {
            let task = tasks::find(name).unwrap();
            assert_eq!(task.stepping, Stepping::Split);
            let [mut full, mut short] = [(); 2].map(|()| {
                let mut body = physics.body(task);
                body.reset(&mut Random::new([3; 32]));
                (body, Random::new([4; 32]))
            });
            for step in 0..STEPS {
                most_of_a_step(full.0.simulation_mut(), task, &mut full.1);
                full.0.simulation_mut().forward();
                most_of_a_step(short.0.simulation_mut(), task, &mut short.1);
                short.0.simulation_mut().forward_after_first_half();
                let same = bits(full.0.simulation()) == bits(short.0.simulation());
                assert!(same, "{name} in {version} differs after step {step}");
            }
        }
    }
}

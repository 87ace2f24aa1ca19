//! What episodes start from: goals and initial states are drawn from the published distributions, and what a task says
//! about them is what it draws.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::float_cmp, reason = "constants are set, not computed")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::f64::consts::FRAC_PI_2;

use arnold_analyze::assets::PhysicsVersion;
use arnold_analyze::sim::engine::Names;
use arnold_analyze::sim::environment::Environment;
use arnold_analyze::sim::random::Random;
use arnold_analyze::sim::tasks::{self, Chosen};
use common::physics::Physics;

fn mean(numbers: &[f64]) -> f64 {
    numbers.iter().sum::<f64>() / numbers.len() as f64
}

fn covariance(a: &[f64], b: &[f64]) -> f64 {
    let (mean_a, mean_b) = (mean(a), mean(b));
    a.iter().zip(b).map(|(a, b)| (a - mean_a) * (b - mean_b)).sum::<f64>() / a.len() as f64
}

/// Whether `draws` look uniform on [`low`, `high`]: inside, close to both ends, with the mean and the variance of the
/// uniform distribution within five standard errors.
fn assert_uniform(draws: &[f64], low: f64, high: f64, what: &str) {
    let (n, width) = (draws.len() as f64, high - low);
    // Angles come back from quaternions and sums with the rounding of double precision.
    let rounding = 1e-12;
    let (least, most) = draws.iter().fold((f64::MAX, f64::MIN), |(l, m), &x| (l.min(x), m.max(x)));
    assert!(least >= low - rounding && most <= high + rounding, "{what}: {least} to {most}");
    // The chance that n draws leave 10/n of the width empty at an end is e⁻¹⁰.
    let gap = 10.0 / n * width + rounding;
    assert!(least <= low + gap && most >= high - gap, "{what}: {least} to {most}");
    let (expected_mean, expected_variance) = (low.midpoint(high), width * width / 12.0);
    let mean_error = 5.0 * (expected_variance / n).sqrt() + rounding;
    assert!((mean(draws) - expected_mean).abs() < mean_error, "{what}: mean {}", mean(draws));
    // A uniform distribution has kurtosis 9/5.
    let variance_error = 5.0 * expected_variance * (0.8 / n).sqrt() + rounding;
    let variance = covariance(draws, draws);
    assert!((variance - expected_variance).abs() < variance_error, "{what}: variance {variance}");
}

/// Whether no two of `columns` are correlated beyond five standard errors. Constant columns count as independent.
fn assert_independent(columns: &[Vec<f64>], what: &str) {
    for (place, a) in columns.iter().enumerate() {
        for (other, b) in columns.iter().enumerate().take(place) {
            let scale = (covariance(a, a) * covariance(b, b)).sqrt();
            let correlation = if scale > 1e-24 { covariance(a, b) / scale } else { 0.0 };
            let limit = 5.0 / (a.len() as f64).sqrt();
            assert!(
                correlation.abs() < limit,
                "{what}: columns {other} and {place}: {correlation}"
            );
        }
    }
}

/// What `look` sees after each of `count` resets, one column per number.
fn after_resets(
    task: &str,
    count: u16,
    mut look: impl FnMut(&mut Environment) -> Vec<f64>,
) -> Vec<Vec<f64>> {
    let mut body = Physics::of(PhysicsVersion::V2_3_7).body(tasks::find(task).unwrap());
    let mut columns: Vec<Vec<f64>> = Vec::new();
    for episode in 0..count {
        let mut seed = [0; 32];
        seed[..2].copy_from_slice(&episode.to_le_bytes());
        body.reset(&mut Random::new(seed));
        assert!(body.simulation().qvel().iter().all(|v| v.to_bits() == 0), "{task} starts moving");
        assert!(body.simulation().activation().iter().all(|a| a.to_bits() == 0));
        assert_eq!(body.simulation().time().to_bits(), 0);
        let seen = look(&mut body);
        columns.resize(seen.len(), Vec::new());
        columns.iter_mut().zip(seen).for_each(|(column, number)| column.push(number));
    }
    columns
}

/// The blocks `keys` of the first observation.
fn first_observations(task: &str, count: u16, keys: &[&str]) -> Vec<Vec<f64>> {
    after_resets(task, count, |body| {
        keys.iter().flat_map(|key| body.block(key).unwrap()).copied().collect()
    })
}

/// Angles (x, y, z) of a quaternion (w, x, y, z) that stands for turns about the body's own x, y and z axes in this order.
fn euler([w, x, y, z]: [f64; 4]) -> [f64; 3] {
    [
        (2.0 * (w * x - y * z)).atan2(1.0 - 2.0 * (x * x + y * y)),
        (2.0 * (x * z + w * y)).asin(),
        (2.0 * (w * z - x * y)).atan2(1.0 - 2.0 * (y * y + z * z)),
    ]
}

/// Orientation of a body of the model in its parent.
fn orientation(body: &Environment, name: &str) -> [f64; 3] {
    let index = body.simulation().find(Names::Body, name).unwrap();
    euler(body.simulation().model_body_quat().as_chunks::<4>().0[index])
}

/// Place of a body of the model in its parent.
fn place(body: &Environment, name: &str) -> [f64; 3] {
    let index = body.simulation().find(Names::Body, name).unwrap();
    body.simulation().model_body_pos().as_chunks::<3>().0[index]
}

fn mass(body: &Environment, name: &str) -> f64 {
    body.simulation().model_body_mass()[body.simulation().find(Names::Body, name).unwrap()]
}

/// Joint angles of the hand at the start: all zero but the forearm's rotation.
fn assert_palm_up(columns: &[Vec<f64>], forearm: f64) {
    for (joint, angles) in columns.iter().enumerate() {
        let expected = if joint == 0 { forearm } else { 0.0 };
        assert!(angles.iter().all(|angle| (angle - expected).abs() < 1e-15), "joint {joint}");
    }
}

#[test]
fn elbow_targets_and_starts_are_uniform_and_independent() {
    for task in ["elbow_pose", "myosuite_elbow_pose"] {
        let columns = first_observations(task, 3000, &["pose_target", "qpos"]);
        assert_uniform(&columns[0], 0.0, 2.27, "target");
        assert_uniform(&columns[1], 0.0, 2.26893, "start");
        assert_independent(&columns, task);
    }
}

const TARGET_BOXES: [(&str, [f64; 3], [f64; 3]); 5] = [
    ("thumb", [-0.185, -0.577, 1.455], [-0.125, -0.517, 1.535]),
    ("index", [-0.191, -0.567, 1.445], [-0.111, -0.527, 1.465]),
    ("middle", [-0.186, -0.567, 1.437], [-0.106, -0.527, 1.457]),
    ("ring", [-0.188, -0.563, 1.435], [-0.108, -0.523, 1.455]),
    ("little", [-0.188, -0.548, 1.424], [-0.108, -0.508, 1.444]),
];

#[test]
fn fingertip_targets_fill_their_boxes() {
    let single = |finger: &(&str, _, _)| format!("hand_{}_reach", finger.0);
    let mut choices: Vec<(String, Vec<usize>)> =
        TARGET_BOXES.iter().enumerate().map(|(i, finger)| (single(finger), vec![i])).collect();
    choices.push(("hand_reach".to_owned(), (0..5).collect()));
    choices.push(("myosuite_hand_reach".to_owned(), (0..5).collect()));
    choices.push(("hand_reach:little+index".to_owned(), vec![1, 4]));
    for (task, fingers) in choices {
        let columns = first_observations(&task, 400, &["target_pos"]);
        assert_eq!(columns.len(), 3 * fingers.len());
        for (column, draws) in columns.iter().enumerate() {
            let (name, low, high) = TARGET_BOXES[fingers[column / 3]];
            let what = format!("{task}, {name}, axis {}", column % 3);
            assert_uniform(draws, low[column % 3], high[column % 3], &what);
        }
        assert_independent(&columns, &task);
        assert!(first_observations(&task, 1, &["qpos"]).iter().all(|angle| angle[0] == 0.0));
    }
}

#[test]
fn hand_poses_start_and_aim_anywhere_in_their_ranges() {
    let columns = first_observations("hand_pose", 600, &["pose_target", "qpos"]);
    assert_eq!(columns.len(), 46);
    let physics = Physics::of(PhysicsVersion::V2_3_7);
    let body = physics.body(tasks::find("hand_pose").unwrap());
    let said = body.task().starts();
    assert_eq!(said.len(), columns.len());
    for (start, draws) in said.iter().zip(&columns) {
        match &start.chosen {
            Chosen::Uniform { low, high } => {
                assert_uniform(draws, low[0], high[0], &start.quantity);
            }
            Chosen::Fixed(value) => assert!(draws.iter().all(|x| (x - value[0]).abs() < 1e-15)),
            other => panic!("{other:?}"),
        }
    }
    // Some of the numbers that `MyoSuite`'s ten hand shapes span, and the joints' own ranges.
    for (column, low, high) in
        [(3, 0.0248, 0.6392), (6, -1.309, -0.026_204_5), (22, 0.01571, 1.571)]
    {
        assert_uniform(&columns[column], low, high, "target");
    }
    let ranges = body.simulation().joint_range();
    for (joint, draws) in columns[23..].iter().enumerate() {
        assert_uniform(draws, ranges[2 * joint], ranges[2 * joint + 1], "start");
    }
    assert_independent(&columns, "hand_pose");
}

#[test]
fn the_pen_target_turns_about_two_axes() {
    for task in ["pen", "myosuite_pen_twirl"] {
        let columns = after_resets(task, 1000, |body| {
            let mut seen = orientation(body, "target").to_vec();
            seen.extend(body.simulation().qpos());
            seen
        });
        assert_uniform(&columns[0], -1.0, 1.0, "x");
        assert_uniform(&columns[1], -1.0, 1.0, "y");
        assert!(columns[2].iter().all(|z| z.abs() < 1e-12), "z turns");
        assert_independent(&columns[..2], task);
        assert_eq!(columns.len(), 3 + 29);
        assert_palm_up(&columns[3..], -1.5);
    }
}

#[test]
fn the_die_turns_about_three_axes_and_nothing_else_is_random() {
    let columns = after_resets("reorient", 1000, |body| {
        let mut seen = orientation(body, "target").to_vec();
        seen.extend(body.simulation().qpos());
        seen.extend(place(body, "Object"));
        seen.extend(place(body, "target"));
        seen.push(mass(body, "Object"));
        seen.extend(orientation(body, "Object"));
        seen
    });
    for (axis, draws) in columns[..3].iter().enumerate() {
        assert_uniform(draws, -0.785, 0.785, &format!("axis {axis}"));
    }
    assert_independent(&columns[..3], "reorient");
    assert_palm_up(&columns[3..32], -1.5);
    // The die is put 0.1 m beside the goal, and turned by the goal's compiled 0.001 rad about each axis.
    let fixed = [-0.24, -0.535, 1.46, -0.34, -0.535, 1.46, 0.108, 0.001, 0.001, 0.001];
    for (draws, expected) in columns[32..].iter().zip(fixed) {
        assert!(draws.iter().all(|x| (x - expected).abs() < 1e-6), "{} {expected}", draws[0]);
    }
}

#[test]
fn the_object_to_relocate_has_any_shape_size_and_place() {
    let mut shapes = Vec::new();
    let columns = after_resets("relocate", 800, |body| {
        let object = body.simulation().find(Names::Body, "Object").unwrap();
        let geoms = body.simulation().geoms_of(object);
        assert_eq!(geoms.len(), 3);
        let mut seen =
            [place(body, "target"), orientation(body, "target"), place(body, "Object")].concat();
        seen.push(mass(body, "Object"));
        for &geom in &geoms {
            let simulation = body.simulation();
            let size = &simulation.model_geom_size()[3 * geom..][..3];
            let offset = &simulation.model_geom_pos()[3 * geom..][..3];
            seen.extend(size);
            // The offset is drawn between minus and plus the size.
            seen.extend(offset.iter().zip(size).map(|(offset, size)| offset / size));
            seen.extend(euler(simulation.model_geom_quat().as_chunks::<4>().0[geom]));
            seen.extend(&simulation.model_geom_friction()[3 * geom..][..3]);
            assert_eq!(simulation.model_geom_rbound()[geom], 0.05);
            assert_eq!(simulation.model_geom_aabb()[6 * geom + 3..][..3], [0.025; 3]);
        }
        shapes.extend(geoms.iter().map(|&geom| body.simulation_mut().model_geom_type_mut()[geom]));
        assert_eq!(body.simulation().contact_count(), 0, "it starts in contact");
        let height = body.block("obj_pos").unwrap()[2];
        assert!((height - 0.98).abs() < 1e-12, "{height}");
        seen
    });
    let mut expected = vec![
        (0.0, 0.3),
        (-0.45, -0.1),
        (0.9, 1.05),
        (-0.2, 0.2),
        (-0.2, 0.2),
        (-0.2, 0.2),
        (-0.1, 0.1),
        (-0.35, -0.15),
        (1.0, 1.0),
        (0.05, 0.2),
    ];
    for _ in 0..3 {
        expected.extend([(0.015, 0.025); 3]);
        expected.extend([(-1.0, 1.0); 3]);
        expected.extend([(-FRAC_PI_2, FRAC_PI_2); 3]);
        expected.extend([(0.8, 1.2), (0.004, 0.006), (0.00008, 0.00012)]);
    }
    assert_eq!(columns.len(), expected.len());
    for (column, (draws, (low, high))) in columns.iter().zip(expected).enumerate() {
        assert_uniform(draws, low, high, &format!("column {column}"));
    }
    // Sphere, capsule, ellipsoid, cylinder, box: 2400 draws, five standard errors are 98.
    for shape in 2..=6 {
        let count = shapes.iter().filter(|&&s| s == shape).count();
        assert!((382..=578).contains(&count), "shape {shape}: {count} of {}", shapes.len());
    }
    assert!(shapes.iter().all(|shape| (2..=6).contains(shape)));
    let starts = after_resets("relocate", 5, |body| body.simulation().qpos().to_vec());
    assert!(starts.iter().all(|joint| joint.iter().all(|angle| *angle == joint[0])));
}

#[test]
fn walking_goals_fill_the_square_around_the_origin() {
    let columns = first_observations("kinesis", 1000, &["target_error"]);
    let root = [0.707_318_365_573_883_1, 0.681_105_077_266_693_1, 0.936_176_776_885_986_3];
    for (axis, draws) in columns[..2].iter().enumerate() {
        let goal: Vec<f64> = draws.iter().map(|error| error + root[axis]).collect();
        assert_uniform(&goal, -2.0, 2.0, &format!("axis {axis}"));
    }
    assert!(columns[2].iter().all(|error| (error + root[2] - 0.94).abs() < 1e-12));
    assert_independent(&columns[..2], "kinesis");
}

//! Tasks beside the recorded ones: what the walking expert sees, goals that stay ahead of the walker, `MyoSuite`'s own
//! environments against recorded episodes and published success rates, every task under random actions, and the order in
//! which signatures of all tasks get their statistics.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::path::Path;

use arnold_analyze::assets::PhysicsVersion;
use arnold_analyze::experiment::{evaluation, seed};
use arnold_analyze::npz::Arrays;
use arnold_analyze::policy::checkpoint::contents::Normaliser;
use arnold_analyze::policy::checkpoint::{self, Limits};
use arnold_analyze::policy::policies::uniform::UniformPolicy;
use arnold_analyze::policy::running_statistics::RunningStatistics;
use arnold_analyze::policy::{self, ObservationVariant, Policy};
use arnold_analyze::sim::engine::Names;
use arnold_analyze::sim::environment::Environment;
use arnold_analyze::sim::random::Random;
use arnold_analyze::sim::rollout::{self, ActionMode, Channels, Machine, RolloutPlan};
use arnold_analyze::sim::tasks::{self, Definition, RewardConfiguration};
use common::physics::Physics;
use common::{checkpoints, golden};

fn clean_observation(body: &Environment) -> Vec<f32> {
    let variant = ObservationVariant::Clean;
    let mut observation = vec![0.0; body.observation_length(variant)];
    body.read_observation(variant, &mut observation);
    observation
}

type Quaternion = [f64; 4];

fn product(a: Quaternion, b: Quaternion) -> Quaternion {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// `v` turned by `q`: q v q*.
fn turned(q: Quaternion, v: [f64; 3]) -> [f64; 3] {
    let conjugate = [q[0], -q[1], -q[2], -q[3]];
    let [_, x, y, z] = product(product(q, [0.0, v[0], v[1], v[2]]), conjugate);
    [x, y, z]
}

/// The walking expert's vector from body poses and sensors alone, by quaternions where the program uses matrices.
fn expert_vector(body: &Environment, goal: [f64; 3]) -> Vec<f64> {
    let simulation = body.simulation();
    let names = simulation.names_of(Names::Body);
    let position = |b: usize| simulation.body_positions().as_chunks::<3>().0[b];
    let orientation = |b: usize| simulation.body_orientations().as_chunks::<4>().0[b];
    let sensor = |row: usize| simulation.sensors().as_chunks::<3>().0[row];
    let parts = names.len() - 1;
    let root = position(1);
    let ahead = turned(orientation(1), [1.0, 0.0, 0.0]);
    let half = -0.5 * ahead[1].atan2(ahead[0]);
    let back = [half.cos(), 0.0, 0.0, half.sin()];
    let relative = |p: [f64; 3]| turned(back, [p[0] - root[0], p[1] - root[1], p[2] - root[2]]);

    let mut vector = vec![root[2]];
    let stored = &simulation.qpos()[3..7];
    let norm = stored.iter().map(|x| x * x).sum::<f64>().sqrt();
    // Stored with the scalar first, read with the scalar last.
    let q = [stored[3] / norm, stored[0] / norm, stored[1] / norm, stored[2] / norm];
    let image_of_x = turned(q, [1.0, 0.0, 0.0]);
    for angle in [(-image_of_x[2]).asin(), image_of_x[1].atan2(image_of_x[0])] {
        vector.extend([angle.cos(), angle.sin()]);
    }
    (2..=parts).for_each(|b| vector.extend(relative(position(b))));
    for b in 1..=parts {
        let local = product(back, orientation(b));
        vector.extend(turned(local, [1.0, 0.0, 0.0]));
        vector.extend(turned(local, [0.0, 0.0, 1.0]));
    }
    (0..2 * parts).for_each(|row| vector.extend(turned(back, sensor(row))));
    vector.extend(&simulation.sensors()[6 * parts..]);
    vector.extend([0.0; 42]);
    vector.extend(relative(goal));
    for name in ["tibia_l", "tibia_r", "talus_l", "talus_r", "toes_l", "toes_r"] {
        vector.extend(relative(position(names.iter().position(|n| n == name).unwrap())));
    }
    vector
}

/// Where the goal is, from the error to it along world axes.
fn goal(body: &Environment) -> [f64; 3] {
    let error = body.block("target_error").unwrap();
    std::array::from_fn(|axis| error[axis] + body.simulation().qpos()[axis])
}

#[test]
fn the_walking_expert_sees_what_body_poses_and_sensors_say() {
    for version in PhysicsVersion::ALL {
        let mut body = Physics::of(version).body(tasks::find("kinesis").unwrap());
        let mut random = Random::new([5; 32]);
        body.reset(&mut random);
        let mut moved = 0.0_f32;
        for step in 0..12 {
            let (seen, expected) = (clean_observation(&body), expert_vector(&body, goal(&body)));
            // 15 N + 69 for the 16 parts of the stand-in model.
            assert_eq!((seen.len(), expected.len()), (309, 309));
            for (element, (&seen, expected)) in seen.iter().zip(expected).enumerate() {
                let difference = (f64::from(seen) - expected).abs();
                let what = format!("MuJoCo {version}, step {step}, element {element}");
                assert!(difference < 1e-6 * expected.abs().max(1.0), "{what}: {seen} {expected}");
            }
            moved += seen[50..280].iter().map(|x| x.abs()).sum::<f32>();
            let action: Vec<f32> = (0..80).map(|_| random.uniform(-1.0, 1.0) as f32).collect();
            body.step(&action);
        }
        assert!(moved > 100.0);
    }
}

#[test]
fn the_published_start_looks_as_it_should_to_the_expert() {
    let mut body =
        Physics::of(PhysicsVersion::V2_3_7).body(tasks::find("kinesis_forward").unwrap());
    body.reset(&mut Random::new([0; 32]));
    let seen = clean_observation(&body);
    // Upright: the root's own z axis points up, its own x axis ahead, whatever the world's axes are.
    let root_axes = &seen[1 + 4 + 45..][..6];
    assert!(root_axes[0] > 0.99 && root_axes[1].abs() < 1e-6, "x axis {root_axes:?}");
    assert!(root_axes[5] > 0.99, "z axis {root_axes:?}");
    // The goal is straight ahead, and 0.94 m high while the root is a little lower.
    let goal = &seen[309 - 21..][..3];
    assert!((goal[0] - 2.0).abs() < 1e-6 && goal[1].abs() < 1e-6, "{goal:?}");
    assert!((goal[2] - (0.94 - 0.936_176_8)).abs() < 1e-6, "{goal:?}");
    // Right tibia on the right, left tibia on the left; both below the root.
    let (left, right) = (&seen[309 - 18..][..3], &seen[309 - 15..][..3]);
    assert!(left[1] > 0.02 && right[1] < -0.02, "left {left:?}, right {right:?}");
    assert!(left[2] < -0.2 && right[2] < -0.2, "left {left:?}, right {right:?}");
    assert!(seen[309 - 21 - 42..309 - 21].iter().all(|x| x.to_bits() == 0));
}

#[test]
fn a_goal_ahead_stays_where_it_was_put_or_goes_ahead_of_the_body() {
    let physics = Physics::of(PhysicsVersion::V2_3_7);
    for (task, moves) in [("kinesis_forward", false), ("kinesis_moving_goal", true)] {
        let mut body = physics.body(tasks::find(task).unwrap());
        body.reset(&mut Random::new([1; 32]));
        let ahead = |body: &Environment| {
            let simulation = body.simulation();
            let axis =
                turned(simulation.body_orientations().as_chunks::<4>().0[1], [1.0, 0.0, 0.0]);
            let length = axis[0].hypot(axis[1]);
            let root = simulation.qpos();
            [root[0] + 2.0 * axis[0] / length, root[1] + 2.0 * axis[1] / length, 0.94]
        };
        let close = |a: [f64; 3], b: [f64; 3]| a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-9);
        let first = goal(&body);
        assert!(close(first, ahead(&body)), "{task}: {first:?}");
        let mut random = Random::new([2; 32]);
        let (mut progress, mut travelled) = (0.0, 0.0);
        for _ in 0..20 {
            let before = goal(&body);
            let away = |body: &Environment, goal: [f64; 3]| {
                let root = body.simulation().qpos();
                (root[0] - goal[0]).hypot(root[1] - goal[1])
            };
            let start = away(&body, before);
            let action: Vec<f32> = (0..80).map(|_| random.uniform(-1.0, 1.0) as f32).collect();
            let outcome = body.step(&action);
            // A step is rewarded by the goal it had.
            progress += body.components()[0] / 20.0;
            travelled += start - away(&body, before);
            assert!(close(goal(&body), if moves { ahead(&body) } else { first }), "{task}");
            if outcome.ended() {
                break;
            }
        }
        assert!((progress - travelled).abs() < 1e-9, "{task}: {progress} {travelled}");
        assert!(travelled.abs() > 1e-3, "{task}: it stood still");
    }
}

#[test]
fn gait_is_read_by_the_names_of_its_blocks() {
    let mut body = Physics::of(PhysicsVersion::V2_3_7).body(tasks::find("kinesis").unwrap());
    body.reset(&mut Random::new([1; 32]));
    let lengths =
        ["feet_contact_force", "root_vel", "act"].map(|key| body.block(key).unwrap().len());
    assert_eq!(lengths, [4, 3, 80]);
    assert!(body.block("feet").is_none());
    let sensors = body.simulation().sensors();
    assert_eq!(body.block("feet_contact_force").unwrap(), &sensors[sensors.len() - 4..]);
}

/// A recorded episode of one of `MyoSuite`'s own environments: checkpoint folder, file, task.
const RECORDED: [(&str, &str, usize); 3] = [
    ("ElbowPose1D6MRandom", "myosuite_elbow_pose", 100),
    ("HandPenTwirlRandom", "myosuite_pen_twirl", 35),
    ("HandReachRandom", "myosuite_hand_reach", 2),
];

/// Rows of a recorded array as numbers.
fn rows(arrays: &Arrays, name: &str) -> Vec<Vec<f64>> {
    let array = arrays.get(name).unwrap();
    let numbers = array.to_f64();
    numbers.chunks(numbers.len() / array.rows()).map(<[f64]>::to_vec).collect()
}

#[test]
fn myosuites_own_environments_replay() {
    let Some(folder) = checkpoints("npg") else { return };
    for version in PhysicsVersion::ALL {
        let physics = Physics::of(version);
        for (name, task, steps) in RECORDED {
            let arrays =
                Arrays::open(&folder.join(format!("{name}_rollout_mj{version}.npz"))).unwrap();
            let what = format!("{task} in MuJoCo {version}");
            replay(&mut physics.body(tasks::find(task).unwrap()), &arrays, steps, &what);
        }
    }
}

fn replay(body: &mut Environment, arrays: &Arrays, steps: usize, what: &str) {
    let flat = |name: &str| arrays.get(name).unwrap().to_f64();
    let observations = rows(arrays, "obs");
    // Goals are sites, bodies, or the difference between the first angle and the error that is seen.
    let simulation = body.simulation_mut();
    simulation.model_array_mut("site_pos").unwrap().copy_from_slice(&flat("init_site_pos"));
    simulation.model_array_mut("body_quat").unwrap().copy_from_slice(&flat("init_body_quat"));
    simulation.reset();
    simulation.forward_without_actuation();
    simulation.qpos_mut().copy_from_slice(&flat("init_qpos"));
    simulation.forward();
    simulation.warm_start_mut().copy_from_slice(&flat("init_qacc_warmstart"));
    let target = observations[0][0] + observations[0][2];
    let state = serde_json::json!({"target_jnt_value": [target]});
    body.adopt(&tasks::RecordedStart { arrays, task_state: &state }).unwrap();

    let (excitations, positions) = (rows(arrays, "ctrl"), rows(arrays, "qpos"));
    let (rewards, solved) = (flat("reward"), flat("solved"));
    assert_eq!(rewards.len(), steps, "{what}");
    for step in 0..steps {
        let seen = clean_observation(body);
        assert_eq!(seen.len(), observations[step].len(), "{what}");
        for (element, (&seen, &recorded)) in seen.iter().zip(&observations[step]).enumerate() {
            let difference = (f64::from(seen) - recorded).abs();
            let limit = 1.2e-7 * recorded.abs() + 1e-15;
            assert!(
                difference <= limit,
                "{what}, step {step}, element {element}: {seen} {recorded}"
            );
        }
        body.simulation_mut().excitation_mut().copy_from_slice(&excitations[step]);
        let outcome = body.step_excited();
        let bits = |numbers: &[f64]| numbers.iter().map(|x| x.to_bits()).collect::<Vec<_>>();
        assert_eq!(bits(body.simulation().qpos()), bits(&positions[step]), "{what}, step {step}");
        assert!((outcome.reward - rewards[step]).abs() < 1e-12, "{what}, step {step}: {outcome:?}");
        assert_eq!(outcome.solved, solved[step] > 0.5, "{what}, step {step}");
        let last = step + 1 == steps;
        assert_eq!(outcome.ended(), last, "{what}, step {step}: {outcome:?}");
    }
}

/// Share of `episodes` with more than five solved steps, and their mean return.
fn success(
    physics: &Physics,
    task: &'static Definition,
    checkpoint: &Path,
    episodes: usize,
) -> (f64, f64) {
    let loaded = policy::open(checkpoint, None).unwrap();
    let plan =
        RolloutPlan { mode: ActionMode::Deterministic, ..plan(task, loaded.policy.as_ref()) };
    let played =
        evaluation::evaluate_task(&physics.machine(), &plan, episodes, 0, &|_| {}).unwrap();
    let succeeded = played.episodes.iter().filter(|episode| episode.solved_steps > 5).count();
    let returned: f64 = played.episodes.iter().map(|episode| episode.reward).sum();
    (succeeded as f64 / episodes as f64, returned / episodes as f64)
}

#[test]
fn published_baselines_succeed_as_often_as_recorded() {
    const EPISODES: usize = 60;
    let Some(folder) = checkpoints("npg") else { return };
    for version in PhysicsVersion::ALL {
        let physics = Physics::of(version);
        let recorded = std::fs::read(folder.join(format!("results_mj{version}.json"))).unwrap();
        let recorded: serde_json::Value = serde_json::from_slice(&recorded).unwrap();
        for (name, task, _) in RECORDED {
            let task = tasks::find(task).unwrap();
            let checkpoint = folder.join(format!("{name}_seed1_best_policy.pickle"));
            let (share, returned) = success(&physics, task, &checkpoint, EPISODES);
            let recorded = &recorded[task.environment.unwrap()];
            let (want, n) = (
                recorded["success_more_than_5_solved_steps"].as_f64().unwrap(),
                recorded["episodes"].as_f64().unwrap(),
            );
            eprintln!(
                "{} in MuJoCo {version}: success {share:.3} (recorded {want:.3}), return {returned:.1} (recorded {:.1})",
                task.name,
                recorded["mean_return"].as_f64().unwrap()
            );
            // Two shares of one probability: four standard errors of their difference.
            let pooled = (share * EPISODES as f64 + want * n) / (EPISODES as f64 + n);
            let error = (pooled * (1.0 - pooled) * (1.0 / EPISODES as f64 + 1.0 / n)).sqrt();
            assert!((share - want).abs() <= 4.0 * error, "{}: {share} {want}", task.name);
        }
    }
}

#[test]
fn the_hand_pose_baselines_fit_their_task() {
    let Some(folder) = checkpoints("myosuite_npg") else { return };
    let physics = Physics::of(PhysicsVersion::V2_3_7);
    let task = tasks::find("hand_pose").unwrap();
    let folder = folder.join("myoHandPoseRandom-v0");
    let mut played = 0;
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|extension| extension == "pickle") {
            let (_, returned) = success(&physics, task, &path, 4);
            // Trained to about −198 in 100 steps; even so far from it is the published network alive.
            assert!(returned.is_finite() && returned < 0.0, "{returned}");
            played += 1;
        }
    }
    assert_eq!(played, 3);
}

fn plan<'a>(task: &'static Definition, policy: &'a dyn Policy) -> RolloutPlan<'a> {
    RolloutPlan {
        task,
        policy,
        mode: ActionMode::Stochastic,
        action_noise: 0.0,
        projections: &[],
        channels: Channels::Counts,
        rewards: RewardConfiguration::Sparse,
    }
}

/// Plays `episodes` of uniformly random actions between −`bound` and `bound`; the number of steps in which the physics
/// diverged.
fn shaken(machine: &Machine, task: &'static Definition, bound: f32, episodes: usize) -> usize {
    let policy = UniformPolicy::new(bound);
    let specs: Vec<_> = (0..episodes).map(|i| seed::episode(7, task.name, i, None)).collect();
    let played = rollout::play(machine, &plan(task, &policy), &specs, &|_| {}).unwrap();
    assert_eq!(played.len(), episodes);
    for episode in &played {
        assert!((1..=task.horizon).contains(&episode.steps), "{}: {episode:?}", task.name);
        assert!(episode.reward.is_finite(), "{}: {episode:?}", task.name);
        assert!(episode.solved_steps <= episode.steps);
        assert!(episode.terminated || episode.steps == task.horizon, "{}: {episode:?}", task.name);
    }
    played.iter().map(|episode| episode.diverged_steps).sum()
}

#[test]
fn random_actions_end_every_episode_of_every_task() {
    for version in PhysicsVersion::ALL {
        let machine = Physics::of(version).machine();
        for task in tasks::every() {
            for bound in [1.0, 1.5] {
                shaken(&machine, task, bound, 2);
            }
        }
    }
}

/// Numbers of episodes from `$EPISODES`, tasks from `$TASKS` (comma-separated), else a thousand of all.
#[test]
#[ignore = "hours: EPISODES=1000 nice cargo test --release --test tasks -- --ignored --nocapture a_thousand"]
fn a_thousand_random_episodes_of_every_task() {
    let number = |text: String| text.parse::<usize>().unwrap();
    let episodes = std::env::var("EPISODES").map_or(1000, number);
    let named = std::env::var("TASKS").ok();
    let wanted = |task: &&Definition| {
        named.as_ref().is_none_or(|names| names.split(',').any(|name| name == task.name))
    };
    for version in PhysicsVersion::ALL {
        let machine = Physics::of(version).machine();
        for task in tasks::every().filter(wanted) {
            for (bound, episodes) in [(1.0, episodes), (1.5, episodes.div_ceil(10))] {
                let start = std::time::Instant::now();
                let diverged = shaken(&machine, task, bound, episodes);
                eprintln!(
                    "{} in MuJoCo {version}, ±{bound}: {episodes} episodes, {diverged} diverged steps, {:.0} s, {} MB",
                    task.name,
                    start.elapsed().as_secs_f64(),
                    resident_megabytes()
                );
            }
        }
    }
}

/// Memory of this process that is in use, as Linux says.
fn resident_megabytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:")).unwrap_or("0");
    let kilobytes = line.split_whitespace().next().and_then(|n| n.parse::<u64>().ok());
    kilobytes.unwrap_or(0) / 1024
}

#[test]
fn random_actions_are_uniform_and_belong_to_the_episode() {
    let machine = Physics::of(PhysicsVersion::V2_3_7).machine();
    let task = tasks::find("elbow_pose").unwrap();
    let policy = UniformPolicy::new(1.0);
    let play = |machine: &Machine, first: usize| {
        let plan = RolloutPlan { channels: Channels::All, ..plan(task, &policy) };
        let specs: Vec<_> = (first..4).map(|i| seed::episode(0, task.name, i, None)).collect();
        rollout::play(machine, &plan, &specs, &|_| {}).unwrap()
    };
    let played = play(&machine, 0);
    let actions: Vec<f64> =
        played.iter().flat_map(|e| &e.recording.action).map(|&a| f64::from(a)).collect();
    assert_eq!(actions.len(), 4 * 100 * 6);
    assert!(actions.iter().all(|a| a.abs() <= 1.0));
    let n = actions.len() as f64;
    let mean = actions.iter().sum::<f64>() / n;
    let square = actions.iter().map(|a| a * a).sum::<f64>() / n;
    // Variance 1/3, variance of the square 4/45; five standard errors.
    assert!(mean.abs() < 5.0 * (1.0 / 3.0 / n).sqrt(), "{mean}");
    assert!((square - 1.0 / 3.0).abs() < 5.0 * (4.0 / 45.0 / n).sqrt(), "{square}");
    let alone = play(&Machine { batch: 1, ..machine.clone() }, 2);
    assert_eq!(alone[..], played[2..]);
    assert_ne!(played[0].recording.action, played[1].recording.action);
}

/// The tasks of the published statistics, worker by worker.
const WORKERS: [&str; 14] = [
    "hand_thumb_reach",
    "hand_index_reach",
    "hand_middle_reach",
    "hand_ring_reach",
    "hand_little_reach",
    "reorient",
    "pen",
    "baoding_p1_cw",
    "baoding_p1_ccw",
    "baoding_p2",
    "baoding_p2_overlap",
    "elbow_pose",
    "relocate",
    "kinesis",
];

#[test]
fn signatures_of_all_tasks_come_in_the_published_order_and_take_stored_statistics() {
    let physics = Physics::of(PhysicsVersion::V2_3_7);
    let mut statistics = RunningStatistics::new(6);
    for task in WORKERS {
        let interface = physics.body(tasks::find(task).unwrap()).interface();
        statistics.rows_of(&interface.observation_words);
    }
    let fresh = statistics.to_stored();
    // 861 signatures and the padding.
    assert_eq!(fresh.signatures.len(), 862);
    let Some(folder) = golden("policy") else { return };
    let stored = folder.join("xs_model_vecnormalize.pkl");
    let Normaliser::PerSignature(stored) =
        checkpoint::open_normaliser(&stored, &Limits::default()).unwrap()
    else {
        panic!("statistics per signature")
    };
    assert_eq!(fresh.signatures, stored.signatures);

    statistics.merge(&stored).unwrap();
    let merged = statistics.to_stored();
    assert_eq!(merged.signatures, stored.signatures);
    for task in WORKERS {
        let arrays = Arrays::open(&folder.join(format!("xs_{task}.npz"))).unwrap();
        let words = physics.body(tasks::find(task).unwrap()).interface().observation_words;
        let rows = statistics.rows_of(&words);
        let flat = |name: &str| arrays.get(name).unwrap().to_f64();
        let (mean, variance, count) = (flat("norm_mean"), flat("norm_var"), flat("norm_count"));
        assert_eq!(count.len(), rows.len(), "{task}");
        for (sensor, row) in rows.into_iter().enumerate() {
            assert!((merged.count[row] - count[sensor]).abs() < 1e-9, "{task}, sensor {sensor}");
            for lag in 0..6 {
                let (stored, published) = (6 * row + lag, 6 * sensor + lag);
                for (got, want) in [
                    (merged.mean[stored], mean[published]),
                    (merged.variance[stored], variance[published]),
                ] {
                    let difference = (f64::from(got) - want).abs();
                    let limit = 3e-7 * want.abs() + 1e-12;
                    assert!(
                        difference <= limit,
                        "{task}, sensor {sensor}, lag {lag}: {got} {want}"
                    );
                }
            }
        }
    }
}

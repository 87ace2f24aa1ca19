//! A control step allocates nothing: an episode of twice the length asks for memory as often as the shorter one.
//!
//! Counted by the allocator of this binary, over everything `play` does in every thread: observation, policy, noise,
//! projection, physics as it is called from here, task code and the recording of all channels. What `MuJoCo` takes from
//! the system itself is not seen. The policies are made here, of the three kinds that can be played.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]
#![expect(unsafe_code, reason = "an allocator that counts hands everything on to the system's")]

mod common;

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering};

use arnold_analyze::analysis::subspace::{Covariance, Projection, principal_components};
use arnold_analyze::assets::PhysicsVersion;
use arnold_analyze::policy::checkpoint::contents::{
    Activation, ComponentStatistics, Normaliser, Scalars, SignatureStatistics, Tensor, TensorMap,
};
use arnold_analyze::policy::network::Sizes;
use arnold_analyze::policy::network::transformer::Transformer;
use arnold_analyze::policy::policies::mlp::MlpPolicy;
use arnold_analyze::policy::policies::recurrent::RecurrentPolicy;
use arnold_analyze::policy::policies::transformer::TransformerPolicy;
use arnold_analyze::policy::{Actor, ObservationVariant, Policy, PolicyError, TaskInterface};
use arnold_analyze::sim::rollout::{
    ActionMode, Channels, EpisodeSpec, Machine, RolloutPlan, Subspace, play,
};
use arnold_analyze::sim::tasks::{self, Definition, RewardConfiguration};
use common::physics::Physics;

/// The system's allocator, counting how often it is asked.
struct Counting;

static ASKED: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call goes to the system's allocator as it came.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        ASKED.fetch_add(1, Ordering::Relaxed);
        // SAFETY: the caller keeps the contract of `alloc`.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        ASKED.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        ASKED.fetch_add(1, Ordering::Relaxed);
        // SAFETY: as above.
        unsafe { System.realloc(pointer, layout, size) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: as above.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Steps of the shorter and of the longer episode.
const LENGTHS: [usize; 2] = [6, 12];

/// One test, because the counter counts for all threads of the process.
#[test]
fn an_episode_of_twice_the_length_allocates_as_often() {
    let physics = Physics::of(PhysicsVersion::V2_3_7);
    let mut wrong = Vec::new();
    let before = ASKED.load(Ordering::Relaxed);
    drop(vec![0_u8; 1]);
    assert!(ASKED.load(Ordering::Relaxed) > before, "the allocator does not count");
    for task in tasks::ALL {
        if task.source == tasks::Source::Data && !common::data_folder().join(task.model).is_file() {
            eprintln!("skipped: there is no model for `{}`", task.name);
            continue;
        }
        let interface = physics.body(task).interface();
        let mut policies: Vec<(&str, Box<dyn Policy>)> =
            vec![("transformer", Box::new(transformer()))];
        // An environment without an expert's observation is played by transformers only.
        if interface.clean_observation_length > 0 {
            policies.push(("LSTM", Box::new(recurrent(&interface))));
            policies.push(("perceptron", Box::new(perceptron(&interface))));
        }
        let projection = projection(interface.muscle_count);
        for (kind, policy) in &policies {
            let machine = physics.machine();
            let count = |steps| allocations(&machine, task, policy.as_ref(), &projection, steps);
            // What is made once per process is made now.
            let _once = count(LENGTHS[1]);
            let [(short, few), (long, many)] = LENGTHS.map(count);
            assert!(long > short, "{} with the {kind} ends after {short} steps", task.name);
            if few != many {
                let name = task.name;
                wrong.push(format!("{name}, {kind}: {few} in {short} steps, {many} in {long}"));
            }
        }
    }
    assert!(wrong.is_empty(), "\n{}\n", wrong.join("\n"));
    // And it would be noticed: one allocation per act of both bodies together.
    let elbow = tasks::find("elbow_pose").unwrap();
    let projection = projection(physics.body(elbow).interface().muscle_count);
    let [(_, few), (_, many)] =
        LENGTHS.map(|steps| allocations(&physics.machine(), elbow, &Wasteful, &projection, steps));
    assert_eq!(many - few, LENGTHS[1] - LENGTHS[0]);
}

/// A policy that allocates whenever it acts.
struct Wasteful;

impl Policy for Wasteful {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Muscle
    }

    fn bind(&self, _task: &TaskInterface, _slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        Ok(Box::new(Self))
    }
}

impl Actor for Wasteful {
    fn reset(&mut self, _slot: usize) {}

    fn act(
        &mut self,
        _slots: &[usize],
        observations: &[f32],
        means: &mut [f32],
        deviations: Option<&mut [f32]>,
    ) {
        let copy = std::hint::black_box(observations.to_vec());
        means.fill(copy[0]);
        if let Some(deviations) = deviations {
            deviations.fill(0.1);
        }
    }

    fn clips_actions(&self) -> bool {
        true
    }
}

/// Steps played, and how often memory was asked for, in two episodes of at most `horizon` steps at once.
fn allocations(
    machine: &Machine,
    task: &'static Definition,
    policy: &dyn Policy,
    projection: &Subspace,
    horizon: usize,
) -> (usize, usize) {
    // The registry's tasks live as long as the program, and so does what is played in their place.
    let mut shortened = *task;
    shortened.horizon = horizon;
    let task: &'static Definition = Box::leak(Box::new(shortened));
    let plan = RolloutPlan {
        task,
        policy,
        mode: ActionMode::Stochastic,
        action_noise: 0.1,
        projections: std::slice::from_ref(projection),
        channels: Channels::All,
        rewards: RewardConfiguration::Dense,
    };
    let spec = |episode: usize| EpisodeSpec {
        episode,
        reset_seed: [episode as u8; 32],
        action_seed: [7 + episode as u8; 32],
        projection: Some(0),
    };
    let specs = [spec(0), spec(1)];
    let before = ASKED.load(Ordering::Relaxed);
    let episodes = play(machine, &plan, &specs, &|_| ()).unwrap();
    let asked = ASKED.load(Ordering::Relaxed) - before;
    (episodes.iter().map(|episode| episode.steps).sum(), asked)
}

/// Onto three components of made-up actions.
fn projection(muscles: usize) -> Subspace {
    let mut actions = Covariance::new(muscles);
    (0..3 * muscles).for_each(|row| actions.push_row(&wave(muscles, row)).unwrap());
    Subspace::Actions(Projection::new(&principal_components(&actions).unwrap(), 3).unwrap())
}

/// Made-up numbers that differ everywhere.
fn wave(count: usize, seed: usize) -> Vec<f32> {
    (0..count).map(|i| 0.1 * ((i * i) as f32 * 0.61 + seed as f32).sin()).collect()
}

fn tensors(shapes: impl IntoIterator<Item = (String, Vec<usize>)>) -> TensorMap {
    let made = shapes.into_iter().enumerate();
    made.map(|(seed, (name, shape))| {
        let data = wave(shape.iter().product(), seed);
        (name, Tensor { shape, data })
    })
    .collect()
}

fn transformer() -> TransformerPolicy {
    let sizes = Sizes {
        vocabulary: 214,
        lags: 6,
        width: 8,
        heads: 2,
        feed_forward: 16,
        encoder_layers: 2,
        decoder_layers: 2,
    };
    let network = Transformer::from_tensors(&tensors(sizes.tensor_shapes()), sizes.heads, true);
    let statistics = SignatureStatistics {
        signatures: vec![vec![0]],
        mean: vec![0.0; sizes.lags],
        variance: vec![1.0; sizes.lags],
        count: vec![1.0],
        lags: sizes.lags,
        epsilon: 1e-8,
        clip: 10.0,
        enabled: true,
    };
    TransformerPolicy::new(network.unwrap(), statistics).unwrap()
}

fn statistics(length: usize) -> ComponentStatistics {
    ComponentStatistics {
        mean: vec![0.0; length],
        variance: vec![1.0; length],
        epsilon: 1e-8,
        clip: 10.0,
        enabled: true,
    }
}

fn recurrent(task: &TaskInterface) -> RecurrentPolicy {
    const WIDTH: usize = 8;
    let (inputs, muscles) = (task.clean_observation_length, task.muscle_count);
    let gates = 4 * WIDTH;
    let shapes = [
        ("lstm_actor.weight_ih_l0", vec![gates, inputs]),
        ("lstm_actor.weight_hh_l0", vec![gates, WIDTH]),
        ("lstm_actor.bias_ih_l0", vec![gates]),
        ("lstm_actor.bias_hh_l0", vec![gates]),
        ("action_net.weight", vec![muscles, WIDTH]),
        ("action_net.bias", vec![muscles]),
        ("log_std", vec![muscles]),
    ];
    let tensors = tensors(shapes.map(|(name, shape)| (name.to_owned(), shape)));
    RecurrentPolicy::from_tensors(&tensors, &Scalars::default(), &statistics(inputs)).unwrap()
}

fn perceptron(task: &TaskInterface) -> MlpPolicy {
    const WIDTH: usize = 8;
    let (inputs, muscles) = (task.clean_observation_length, task.muscle_count);
    let shapes = [
        ("mlp_extractor.policy_net.0.weight", vec![WIDTH, inputs]),
        ("mlp_extractor.policy_net.0.bias", vec![WIDTH]),
        ("action_net.weight", vec![muscles, WIDTH]),
        ("action_net.bias", vec![muscles]),
        ("log_std", vec![muscles]),
    ];
    let tensors = tensors(shapes.map(|(name, shape)| (name.to_owned(), shape)));
    let scalars = Scalars { activation: Some(Activation::Tanh), ..Scalars::default() };
    MlpPolicy::ppo(&tensors, &scalars, &Normaliser::PerComponent(statistics(inputs))).unwrap()
}

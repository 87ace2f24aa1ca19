//! What a control step costs, and how much of it is ours.
//!
//! For every task three loops play the same episode of random actions in turn, on one thread:
//!
//! * **bare**: `mj_step` as often as the task has physics steps per control step, nothing else;
//! * **order**: the engine calls that the published environments make in a control step, among them the second half of a
//!   step first, the first half last, and `mj_forward` after it;
//! * **whole**: our step (excitation, task, observation, reward), the observation a policy gets, and the recording of all
//!   channels.
//!
//! `order` over `bare` is the price of the published order, `whole` over `order` is ours. It is negative where our step
//! leaves out what the published order computes twice, without moving a bit. The rate counts whole steps and
//! the reset of every episode; its ratio is to the reference environments in Python with the same physics, one core,
//! the same actions' distribution, as the project measured them.
//!
//! Every step counts with its shortest time over all repeats, because the machine may do other things meanwhile; the
//! episode is the same in every repeat. The last table plays whole episodes with one thread and with two, in turn.
//!
//! `cargo bench --bench simulation -- --quick` takes seconds. The walking model is looked for in `$ARNOLD_DATA`, else
//! beside the recordings.

#![expect(clippy::print_stdout, reason = "a benchmark prints its table")]

use std::hint::black_box;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::time::{Duration, Instant};

use arnold_analyze::assets::{Cache, PhysicsVersion};
use arnold_analyze::policy::{Actor, ObservationVariant, Policy, PolicyError, TaskInterface};
use arnold_analyze::sim::bodies::Bodies;
use arnold_analyze::sim::engine::{EngineError, Library, Simulation};
use arnold_analyze::sim::environment::Environment;
use arnold_analyze::sim::muscles;
use arnold_analyze::sim::random::Random;
use arnold_analyze::sim::rollout::{ActionMode, Channels, EpisodeSpec, Machine, RolloutPlan, play};
use arnold_analyze::sim::tasks::{self, Definition, RewardConfiguration, Stepping};

/// Control steps per second of the reference environments in Python with `MuJoCo` 2.3.7, one core, random actions, by the
/// start of a task's name; and how many times that we want to reach.
const REFERENCE: [(&str, f64, f64); 7] = [
    ("elbow", 2280.0, 2.0),
    ("hand", 720.0, 1.4),
    ("pen", 710.0, 2.0),
    ("reorient", 940.0, 2.0),
    ("baoding", 630.0, 1.4),
    ("relocate", 730.0, 2.0),
    ("kinesis", 560.0, 2.0),
];

fn main() {
    let quick = std::env::args().any(|argument| argument == "--quick");
    let version = PhysicsVersion::V2_3_7;
    let cache = Cache::locate();
    let (library, models) = match (cache.physics_library(version), cache.myosuite()) {
        (Ok(library), Ok(models)) => (library, models),
        (Err(error), _) | (_, Err(error)) => {
            println!("not measured: {error}; {}", error.hint());
            return;
        }
    };
    let library = Library::open(version, &library).expect("the library was verified");
    let bodies = Arc::new(Bodies::new(library, &models, &data_folder()));
    println!("MuJoCo {version}{}", load());
    println!();
    steps(&bodies, if quick { 3 } else { 15 }, if quick { 20 } else { usize::MAX });
    println!();
    threads(&bodies, if quick { 1 } else { 3 });
}

/// The table of costs: `repeats` of at most `most_steps` steps each.
fn steps(bodies: &Bodies, repeats: usize, most_steps: usize) {
    println!(
        "task                bare µs  order µs  whole µs  order/bare  whole/order  steps/s  of Python   bar"
    );
    for task in tasks::ALL {
        let (bare, order, whole) = match costs(task, bodies, repeats, most_steps) {
            Ok(costs) => costs,
            Err(error) => {
                println!("{:18}  not measured: {error}", task.name);
                continue;
            }
        };
        let rate = 1e6 / (whole.step + whole.reset / whole.steps as f64);
        let reference = REFERENCE.iter().find(|(start, ..)| task.name.starts_with(start));
        let &(_, python, bar) = reference.expect("every task has a reference");
        println!(
            "{:18}  {:7.1}  {:8.1}  {:8.1}  {:+9.1} %  {:+10.1} %  {rate:7.0}  {:7.2} ×  {bar:3.1} ×",
            task.name,
            bare.step,
            order.step,
            whole.step,
            100.0 * (order.step / bare.step - 1.0),
            100.0 * (whole.step / order.step - 1.0),
            rate / python,
        );
    }
}

/// What a loop costs, µs.
struct Cost {
    step: f64,
    reset: f64,
    steps: usize,
}

/// Shortest times of a loop's reset and of each of its steps.
struct Shortest {
    reset: Duration,
    steps: Vec<Duration>,
}

impl Shortest {
    fn new(steps: usize) -> Self {
        Self { reset: Duration::MAX, steps: vec![Duration::MAX; steps] }
    }

    /// Runs one repeat: `reset`, then `step` for every step.
    fn repeat<B>(
        &mut self,
        body: &mut B,
        reset: impl Fn(&mut B),
        mut step: impl FnMut(&mut B, usize),
    ) {
        let begin = Instant::now();
        reset(body);
        self.reset = self.reset.min(begin.elapsed());
        for (index, best) in self.steps.iter_mut().enumerate() {
            let begin = Instant::now();
            step(body, index);
            *best = (*best).min(begin.elapsed());
        }
    }

    fn cost(&self) -> Cost {
        let microseconds = |time: &Duration| time.as_secs_f64() * 1e6;
        let (all, steps): (f64, _) = (self.steps.iter().map(microseconds).sum(), self.steps.len());
        Cost { step: all / steps as f64, reset: microseconds(&self.reset), steps }
    }
}

fn costs(
    task: &'static Definition,
    bodies: &Bodies,
    repeats: usize,
    most_steps: usize,
) -> Result<(Cost, Cost, Cost), EngineError> {
    let mut body = Environment::new(task, bodies, RewardConfiguration::Sparse)?;
    let muscles = body.muscles().len();
    let steps = task.horizon.min(most_steps);
    let actions = random_actions(steps, muscles);
    let action = |step: usize| &actions[step * muscles..][..muscles];
    let excitations: Vec<f64> = actions.iter().map(|&a| muscles::excitation(a)).collect();
    let excite = |simulation: &mut Simulation, step: usize| {
        simulation.excitation_mut().copy_from_slice(&excitations[step * muscles..][..muscles]);
    };
    let reset = |body: &mut Environment| body.reset(&mut Random::new([7; 32]));
    let mut observation = vec![0.0; body.observation_length(ObservationVariant::Muscle)];
    let mut recording = Channel::new(steps, &body);
    let [mut bare, mut order, mut whole] = [(); 3].map(|()| Shortest::new(steps));
    for _ in 0..repeats {
        bare.repeat(&mut body, reset, |body, step| {
            let simulation = body.simulation_mut();
            excite(simulation, step);
            (0..task.substeps).for_each(|_| simulation.step());
        });
        order.repeat(&mut body, reset, |body, step| {
            let simulation = body.simulation_mut();
            excite(simulation, step);
            published_order(simulation, task);
        });
        recording.clear();
        whole.repeat(&mut body, reset, |body, step| {
            body.read_observation(ObservationVariant::Muscle, &mut observation);
            black_box(&observation);
            let outcome = body.step(action(step));
            recording.push(action(step), body, outcome.solved, outcome.reward);
        });
        black_box(&recording);
    }
    Ok((bare.cost(), order.cost(), whole.cost()))
}

/// The engine calls of `Environment::step`, without anything of ours.
fn published_order(simulation: &mut Simulation, task: &Definition) {
    match task.stepping {
        Stepping::Split => {
            simulation.step_second_half();
            (1..task.substeps).for_each(|_| simulation.step());
            simulation.step_first_half();
            simulation.forward();
        }
        Stepping::Whole => {
            (0..task.substeps).for_each(|_| simulation.step());
            simulation.kinematics();
            simulation.kinematics();
        }
    }
}

/// What the rollout loop keeps of every step.
struct Channel {
    actions: Vec<f32>,
    excitations: Vec<f64>,
    states: Vec<f64>,
    solved: Vec<bool>,
    rewards: Vec<f64>,
}

impl Channel {
    fn new(steps: usize, body: &Environment) -> Self {
        let simulation = body.simulation();
        let muscles = simulation.activation().len();
        Self {
            actions: Vec::with_capacity(2 * steps * muscles),
            excitations: Vec::with_capacity(steps * muscles),
            states: Vec::with_capacity(steps * (muscles + simulation.qpos().len())),
            solved: Vec::with_capacity(steps),
            rewards: Vec::with_capacity(steps),
        }
    }

    fn clear(&mut self) {
        self.actions.clear();
        self.excitations.clear();
        self.states.clear();
        self.solved.clear();
        self.rewards.clear();
    }

    fn push(&mut self, action: &[f32], body: &Environment, solved: bool, reward: f64) {
        // Once as the mean, once as what was sent.
        self.actions.extend_from_slice(action);
        self.actions.extend_from_slice(action);
        self.excitations.extend(action.iter().map(|&a| muscles::excitation(a)));
        self.states.extend_from_slice(body.simulation().activation());
        self.states.extend_from_slice(body.simulation().qpos());
        self.solved.push(solved);
        self.rewards.push(reward);
    }
}

fn random_actions(steps: usize, muscles: usize) -> Vec<f32> {
    let mut random = Random::new([11; 32]);
    (0..steps * muscles).map(|_| random.uniform(-1.0, 1.0) as f32).collect()
}

/// The table of threads.
fn threads(bodies: &Arc<Bodies>, repeats: usize) {
    println!("task                1 thread, s  2 threads, s  faster   bar");
    for name in ["elbow_pose", "hand_index_reach", "baoding_p1_ccw", "relocate", "kinesis"] {
        let task = tasks::find(name).expect("the task exists");
        let episodes = if repeats == 1 { 2 } else { 64 };
        let specs: Vec<EpisodeSpec> = (0..episodes)
            .map(|episode| EpisodeSpec {
                episode,
                // The same episode again and again, so that both threads have the same to do.
                reset_seed: [7; 32],
                action_seed: [8; 32],
                projection: None,
            })
            .collect();
        let plan = RolloutPlan {
            task,
            policy: &RandomPolicy,
            mode: ActionMode::Deterministic,
            action_noise: 0.0,
            projections: &[],
            channels: Channels::All,
            rewards: RewardConfiguration::Sparse,
        };
        let mut best = [f64::INFINITY; 2];
        for _ in 0..repeats {
            for (threads, best) in [1, 2].into_iter().zip(&mut best) {
                let machine = Machine { bodies: bodies.clone(), threads, batch: 1 };
                let begin = Instant::now();
                match play(&machine, &plan, &specs, &|_| ()) {
                    Ok(episodes) => drop(black_box(episodes)),
                    Err(error) => return println!("{name:18}  not measured: {error}"),
                }
                *best = best.min(begin.elapsed().as_secs_f64());
            }
        }
        let [one, two] = best;
        println!("{name:18}  {one:11.3}  {two:12.3}  {:5.2} ×  1.9 ×", one / two);
    }
    println!("the machine lets a program use {} threads{}", available(), load());
}

/// Draws its actions and looks at nothing.
struct RandomPolicy;

struct RandomActor {
    random: Random,
}

impl Policy for RandomPolicy {
    fn variant(&self) -> ObservationVariant {
        ObservationVariant::Muscle
    }

    fn bind(&self, _task: &TaskInterface, _slots: usize) -> Result<Box<dyn Actor>, PolicyError> {
        Ok(Box::new(RandomActor { random: Random::new([11; 32]) }))
    }
}

impl Actor for RandomActor {
    fn reset(&mut self, _slot: usize) {
        self.random = Random::new([11; 32]);
    }

    fn act(
        &mut self,
        _slots: &[usize],
        _observations: &[f32],
        means: &mut [f32],
        _deviations: Option<&mut [f32]>,
    ) {
        means.fill_with(|| self.random.uniform(-1.0, 1.0) as f32);
    }

    fn clips_actions(&self) -> bool {
        true
    }
}

fn available() -> usize {
    std::thread::available_parallelism().map_or(1, usize::from)
}

/// What else the machine does, where the system says.
fn load() -> String {
    let text = std::fs::read_to_string("/proc/loadavg").unwrap_or_default();
    text.split(' ')
        .next()
        .filter(|load| !load.is_empty())
        .map_or(String::new(), |load| format!("; load average {load} over the last minute"))
}

fn data_folder() -> PathBuf {
    std::env::var_os("ARNOLD_DATA").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/models"),
        PathBuf::from,
    )
}

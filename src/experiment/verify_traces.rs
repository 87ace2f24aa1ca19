//! Replaying recorded episodes of the published environments on this machine: does our physics, our observation and our
//! reward agree?
//!
//! A trace is a pair `<name>.npz` + `<name>.json` (see the golden data's README): the complete state after reset, the
//! actions, and what the reference saw after every step. It is replayed twice over: excitations as recorded, so that the
//! state must agree bit for bit; and excitations from the recorded actions, which may differ from the recorded ones by
//! the reference's own rounding. `<task>.tokens.json` files are checked against our words.

use std::path::{Path, PathBuf};

use serde::Serialize;
use serde_json::Value;

use crate::assets::PhysicsVersion;
use crate::files::{self, FileError};
use crate::npz::{Array, ArrayError, Arrays};
use crate::policy::ObservationVariant;
use crate::sim::bodies::Bodies;
use crate::sim::engine::EngineError;
use crate::sim::environment::Environment;
use crate::sim::muscles;
use crate::sim::tasks::{self, RecordedStart, RewardConfiguration};

/// Excitations may differ by this many units in the last place of single precision.
const EXCITATION_ULP: u32 = 3;
/// Relative rounding of single precision, to which observations and rewards must agree.
const SINGLE_ROUNDING: f64 = 1.2e-7;
/// Below this size an element's rounding is that of the numbers it was computed from (lengths and angles of order 1 in
/// double precision), not its own.
const SMALLEST: f64 = 1e-8;
/// The id that fills short phrases.
const PADDING: u64 = 0;
/// Steps in an observation window.
const WINDOW: usize = 6;

/// Why a trace could not be replayed at all.
#[derive(Debug, thiserror::Error)]
pub enum TraceError {
    /// Reading.
    #[error(transparent)]
    File(#[from] FileError),
    /// An array is missing or has another shape.
    #[error("{source} in `{path}`")]
    Array {
        /// What is wrong.
        source: ArrayError,
        /// The trace.
        path: PathBuf,
    },
    /// The description is not what it should be.
    #[error("{what} in `{path}`")]
    Description {
        /// What is wrong.
        what: String,
        /// The trace's JSON file.
        path: PathBuf,
    },
    /// Physics.
    #[error(transparent)]
    Engine(#[from] EngineError),
    /// There is nothing to check.
    #[error("there are no traces in `{path}`")]
    Empty {
        /// The folder.
        path: PathBuf,
    },
}

/// A trace found in a folder.
#[derive(Debug, Clone)]
pub struct TraceFile {
    /// Code name of the task.
    pub task: String,
    /// Physics it was recorded in.
    pub physics: String,
    /// The array file; its description lies beside it as `.json`.
    pub path: PathBuf,
}

/// What replaying one trace showed. Differences are the largest absolute ones over all steps.
#[derive(Debug, Clone, Serialize)]
pub struct TraceReport {
    /// File name without its ending.
    pub name: String,
    /// Code name of the task.
    pub task: String,
    /// Physics version.
    pub physics: String,
    /// Replayed steps.
    pub steps: usize,
    /// Positions, velocities, activations, time and warm start; relative where they exceed 1.
    pub state: f64,
    /// Excitation from the recorded action, in units in the last place of single precision.
    pub excitation_ulp: u32,
    /// Observation in single precision.
    pub observation: f64,
    /// Number of observation elements beyond single rounding.
    pub observation_failures: usize,
    /// Reward components and totals, by name.
    pub rewards: Vec<(String, f64)>,
    /// Names of the rewards beyond single rounding.
    pub reward_failures: Vec<String>,
    /// `solved`, `terminated` and `truncated` agree at every step.
    pub flags_agree: bool,
    /// Words, ids and muscle names agree (`None`: no token file).
    pub words_agree: Option<bool>,
}

impl TraceReport {
    /// Whether everything agrees.
    #[must_use]
    pub fn agrees(&self) -> bool {
        self.state <= state_tolerance(&self.task, &self.physics)
            && self.excitation_ulp <= EXCITATION_ULP
            && self.observation_failures == 0
            && self.reward_failures.is_empty()
            && self.flags_agree
            && self.words_agree != Some(false)
    }
}

/// Largest allowed difference of the state: none, but for the legs in the old physics.
fn state_tolerance(task: &str, physics: &str) -> f64 {
    if task == "kinesis" && physics == "2.3.7" { 1e-12 } else { 0.0 }
}

/// Every trace below `folder`, in the order of their paths.
pub fn find_traces(folder: &Path) -> Result<Vec<TraceFile>, TraceError> {
    let mut traces = Vec::new();
    collect(folder, 3, &mut traces)?;
    traces.sort_by(|a, b| a.path.cmp(&b.path));
    if traces.is_empty() {
        return Err(TraceError::Empty { path: folder.to_path_buf() });
    }
    Ok(traces)
}

fn collect(folder: &Path, depth: usize, traces: &mut Vec<TraceFile>) -> Result<(), TraceError> {
    let fail = |source| FileError::Read { path: folder.to_path_buf(), source };
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let path = entry.map_err(fail)?.path();
        if path.is_dir() {
            if depth > 0 {
                collect(&path, depth - 1, traces)?;
            }
        } else if path.extension().is_some_and(|e| e == "npz") {
            // `<task>_mj<version>_s<seed>.npz`; other array files are not ours.
            let name = path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
            let Some((task, rest)) = name.rsplit_once("_mj") else { continue };
            let Some((physics, _seed)) = rest.split_once("_s") else { continue };
            traces.push(TraceFile { task: task.to_owned(), physics: physics.to_owned(), path });
        }
    }
    Ok(())
}

/// Replays one trace on one of `bodies`, whose physics must be the trace's. `None`: there is no such task here.
pub fn replay(trace: &TraceFile, bodies: &Bodies) -> Result<Option<TraceReport>, TraceError> {
    let Ok(definition) = tasks::find(&trace.task) else { return Ok(None) };
    let array_error = |source| TraceError::Array { source, path: trace.path.clone() };
    let description_path = trace.path.with_extension("json");
    let description = read_json(&description_path)?;
    let arrays = Arrays::open(&trace.path).map_err(array_error)?;
    let mut environment = Environment::new(definition, bodies, RewardConfiguration::Sparse)?;
    let start = RecordedStart { arrays: &arrays, task_state: &description["task_state"] };
    restore(&mut environment, &arrays).map_err(array_error)?;
    environment.adopt(&start).map_err(array_error)?;
    let mut report = TraceReport {
        name: trace.path.file_stem().unwrap_or_default().to_string_lossy().into_owned(),
        task: trace.task.clone(),
        physics: trace.physics.clone(),
        steps: 0,
        state: 0.0,
        excitation_ulp: 0,
        observation: 0.0,
        observation_failures: 0,
        rewards: Vec::new(),
        reward_failures: Vec::new(),
        flags_agree: true,
        words_agree: words_agree(&environment, &trace.path)?,
    };
    follow(&mut environment, &arrays, &mut report).map_err(array_error)?;
    Ok(Some(report))
}

/// Sets the recorded model fields and the complete recorded state.
fn restore(environment: &mut Environment, arrays: &Arrays) -> Result<(), ArrayError> {
    let simulation = environment.simulation_mut();
    for (name, array) in &arrays.0 {
        let Some(field) = name.strip_prefix("model_") else { continue };
        if field == "geom_type" {
            copy_integers(name, array, simulation.model_geom_type_mut())?;
        }
        // Colours, groups and site sizes are for the eye only and have no accessor.
        if let Some(target) = simulation.model_array_mut(field) {
            copy(name, array, target)?;
        }
    }
    simulation.reset();
    simulation.set_time(arrays.get("init_time")?.to_f64().first().copied().unwrap_or(0.0));
    let put = |name: &str, target: &mut [f64]| copy(name, arrays.get(name)?, target);
    put("init_qpos", simulation.qpos_mut())?;
    put("init_qvel", simulation.qvel_mut())?;
    put("init_act", simulation.activation_mut())?;
    put("init_ctrl", simulation.excitation_mut())?;
    put("init_mocap_pos", simulation.mocap_pos_mut())?;
    put("init_mocap_quat", simulation.mocap_quat_mut())?;
    simulation.forward();
    put("init_qacc_warmstart", simulation.warm_start_mut())
}

fn copy(name: &str, array: &Array, target: &mut [f64]) -> Result<(), ArrayError> {
    let values = array.to_f64();
    if values.len() != target.len() {
        return Err(ArrayError::Shape {
            array: name.to_owned(),
            expected: format!("{} elements", target.len()),
            found: array.shape.clone(),
        });
    }
    target.copy_from_slice(&values);
    Ok(())
}

fn copy_integers(name: &str, array: &Array, target: &mut [i32]) -> Result<(), ArrayError> {
    let mut values = vec![0.0; target.len()];
    copy(name, array, &mut values)?;
    for (to, from) in target.iter_mut().zip(values) {
        *to = from as i32;
    }
    Ok(())
}

/// A recorded array with one row per step.
struct Rows {
    values: Vec<f64>,
    width: usize,
}

impl Rows {
    fn of(arrays: &Arrays, name: &str, rows: usize) -> Result<Self, ArrayError> {
        let array = arrays.get(name)?;
        if array.rows() != rows {
            let expected = format!("{rows} rows");
            let (array, found) = (name.to_owned(), array.shape.clone());
            return Err(ArrayError::Shape { array, expected, found });
        }
        let values = array.to_f64();
        let width = values.len() / rows.max(1);
        if width == 0 {
            let (array, found) = (name.to_owned(), array.shape.clone());
            return Err(ArrayError::Shape { array, expected: "at least one column".into(), found });
        }
        Ok(Self { values, width })
    }

    /// The same, with as many columns as given.
    fn of_width(
        arrays: &Arrays,
        name: &str,
        rows: usize,
        width: usize,
    ) -> Result<Self, ArrayError> {
        let found = Self::of(arrays, name, rows)?;
        if found.width == width {
            return Ok(found);
        }
        let (array, found) = (name.to_owned(), vec![rows, found.width]);
        Err(ArrayError::Shape { array, expected: format!("{width} columns"), found })
    }

    fn row(&self, index: usize) -> &[f64] {
        &self.values[index * self.width..][..self.width]
    }
}

/// Steps through the whole trace and keeps the largest differences.
fn follow(
    environment: &mut Environment,
    arrays: &Arrays,
    report: &mut TraceReport,
) -> Result<(), ArrayError> {
    let action = arrays.get("action")?;
    let steps = action.rows();
    let muscles = environment.simulation().excitation().len();
    let actions = Rows::of_width(arrays, "action", steps, muscles)?;
    let excitations = Rows::of_width(arrays, "ctrl", steps, muscles)?;
    let observations = Rows::of(arrays, "obs", steps + 1)?;
    let mut states = Vec::new();
    for name in ["time", "qpos", "qvel", "act", "qacc_warmstart"] {
        states.push((name, Rows::of(arrays, name, steps)?));
    }
    let flag = |name| Rows::of(arrays, name, steps);
    let (terminated, truncated) = (flag("terminated")?, flag("truncated")?);
    let solved = flag("rwd_solved")?;
    let mut rewards = Vec::new();
    for (index, name) in environment.task().components().iter().enumerate() {
        // A component that the recording does not hold cannot be compared.
        if let Ok(rows) = Rows::of(arrays, &format!("rwd_{name}"), steps) {
            rewards.push(((*name).to_owned(), Some(index), rows));
        }
    }
    rewards.push(("reward".to_owned(), None, Rows::of(arrays, "reward", steps)?));
    let dense = Rows::of(arrays, "reward_dense_config", steps).ok();
    let mut largest = vec![0.0_f64; rewards.len()];
    let mut largest_dense = 0.0_f64;
    let mut dense_fails = false;
    let mut fails = vec![false; rewards.len()];
    let length = environment.observation_length(ObservationVariant::Muscle);
    let mut history = vec![0.0_f32; (steps + 1) * length];
    environment.read_observation(ObservationVariant::Muscle, &mut history[..length]);
    compare_observation(&history[..length], observations.row(0), report)?;
    for step in 0..steps {
        for (&a, &recorded) in actions.row(step).iter().zip(excitations.row(step)) {
            let ulp = ulp_distance(muscles::excitation(a as f32) as f32, recorded as f32);
            report.excitation_ulp = report.excitation_ulp.max(ulp);
        }
        environment.simulation_mut().excitation_mut().copy_from_slice(excitations.row(step));
        let outcome = environment.step_excited();
        let simulation = environment.simulation();
        for (name, rows) in &states {
            let time = [simulation.time()];
            let ours = match *name {
                "time" => &time[..],
                "qpos" => simulation.qpos(),
                "qvel" => simulation.qvel(),
                "act" => simulation.activation(),
                _ => simulation.warm_start(),
            };
            let difference = largest_difference(ours, rows.row(step));
            report.state = report.state.max(difference);
        }
        let newest = &mut history[(step + 1) * length..][..length];
        environment.read_observation(ObservationVariant::Muscle, newest);
        compare_observation(newest, observations.row(step + 1), report)?;
        for (place, (_, component, rows)) in rewards.iter().enumerate() {
            let ours = component.map_or(outcome.reward, |index| environment.components()[index]);
            note(ours, rows.row(step)[0], &mut largest[place], &mut fails[place]);
        }
        if let Some(rows) = &dense {
            let ours = environment.reward_under(RewardConfiguration::Dense);
            note(ours, rows.row(step)[0], &mut largest_dense, &mut dense_fails);
        }
        let says = |rows: &Rows| rows.row(step)[0] > 0.5;
        report.flags_agree &= outcome.solved == says(&solved)
            && outcome.terminated == says(&terminated)
            && outcome.truncated == says(&truncated);
    }
    compare_windows(&history, length, arrays, report)?;
    report.steps = steps;
    for ((name, _, _), (difference, failed)) in rewards.iter().zip(largest.iter().zip(&fails)) {
        report.rewards.push((name.clone(), *difference));
        if *failed {
            report.reward_failures.push(name.clone());
        }
    }
    if dense.is_some() {
        report.rewards.push(("dense reward".to_owned(), largest_dense));
        if dense_fails {
            report.reward_failures.push("dense reward".to_owned());
        }
    }
    Ok(())
}

/// Whether `ours` is `recorded` up to single rounding; NaN only agrees with NaN.
fn same(ours: f64, recorded: f64) -> bool {
    (ours.is_nan() && recorded.is_nan())
        || (ours - recorded).abs() <= SINGLE_ROUNDING * recorded.abs().max(SMALLEST)
}

fn note(ours: f64, recorded: f64, largest: &mut f64, failed: &mut bool) {
    *largest = worse(*largest, (ours - recorded).abs());
    *failed |= !same(ours, recorded);
}

/// The larger of two differences, where NaN is the largest of all.
fn worse(a: f64, b: f64) -> f64 {
    if a.is_nan() || b.is_nan() { f64::NAN } else { a.max(b) }
}

fn compare_observation(
    ours: &[f32],
    recorded: &[f64],
    report: &mut TraceReport,
) -> Result<(), ArrayError> {
    if ours.len() != recorded.len() {
        return Err(ArrayError::Shape {
            array: "obs".to_owned(),
            expected: format!("{} columns", ours.len()),
            found: vec![recorded.len()],
        });
    }
    for (&ours, &recorded) in ours.iter().zip(recorded) {
        let ours = f64::from(ours);
        report.observation = worse(report.observation, (ours - recorded).abs());
        report.observation_failures += usize::from(!same(ours, recorded));
    }
    Ok(())
}

/// Checks the recorded six-step windows against our own newest frames: zeros before the reset, oldest first.
fn compare_windows(
    history: &[f32],
    length: usize,
    arrays: &Arrays,
    report: &mut TraceReport,
) -> Result<(), ArrayError> {
    let (steps, windows) = (arrays.get("window_steps")?.to_f64(), arrays.get("window_obs")?);
    let values = windows.to_f64();
    if values.len() != steps.len() * length * WINDOW {
        return Err(ArrayError::Shape {
            array: "window_obs".to_owned(),
            expected: format!("{} × {length} × {WINDOW}", steps.len()),
            found: windows.shape.clone(),
        });
    }
    for (window, &step) in values.chunks_exact(length * WINDOW).zip(&steps) {
        for (element, row) in window.chunks_exact(WINDOW).enumerate() {
            for (column, &recorded) in row.iter().enumerate() {
                let frame = (step as usize + column).checked_sub(WINDOW - 1);
                let ours = frame.map_or(0.0, |frame| {
                    history.get(frame * length + element).map_or(f64::NAN, |&x| f64::from(x))
                });
                report.observation_failures += usize::from(!same(ours, recorded));
            }
        }
    }
    Ok(())
}

fn largest_difference(ours: &[f64], recorded: &[f64]) -> f64 {
    if ours.len() != recorded.len() {
        return f64::NAN;
    }
    // Relative for large numbers: accelerations of the warm start reach thousands of rad/s².
    let differences = ours.iter().zip(recorded).map(|(a, b)| {
        let difference = (a - b).abs() / b.abs().max(1.0);
        if a.to_bits() == b.to_bits() { 0.0 } else { difference.max(f64::MIN_POSITIVE) }
    });
    differences.fold(0.0, worse)
}

fn ulp_distance(a: f32, b: f32) -> u32 {
    // Both are in [0, 1]: their bit patterns are ordered like the numbers.
    a.to_bits().abs_diff(b.to_bits())
}

/// Compares our phrases, their ids and the muscles with `<task>.tokens.json` beside the trace.
fn words_agree(environment: &Environment, trace: &Path) -> Result<Option<bool>, TraceError> {
    let path = trace.with_file_name(format!("{}.tokens.json", environment.definition().name));
    if !path.is_file() {
        return Ok(None);
    }
    let tokens = read_json(&path)?;
    let strings = |value: &Value| -> Vec<String> {
        let items = value.as_array().into_iter().flatten();
        items.filter_map(|item| item.as_str().map(str::to_owned)).collect()
    };
    let ids = |value: &Value| -> Vec<u64> {
        let items = value.as_array().into_iter().flatten();
        items.filter_map(Value::as_u64).filter(|&id| id != PADDING).collect()
    };
    let rows = |key: &str| tokens[key].as_array().cloned().unwrap_or_default();
    let interface = environment.interface();
    let phrases: Vec<Vec<String>> = rows("obs_phrases").iter().map(strings).collect();
    let same_ids = |ours: &[Vec<u16>], recorded: &[Value]| {
        ours.len() == recorded.len()
            && ours
                .iter()
                .zip(recorded)
                .all(|(ours, recorded)| ours.iter().map(|&id| u64::from(id)).eq(ids(recorded)))
    };
    Ok(Some(
        environment.task().layout().phrases().eq(phrases.iter().map(Vec::as_slice))
            && same_ids(&interface.observation_words, &rows("obs_ids"))
            && same_ids(&interface.action_words, &rows("action_ids"))
            && environment.muscles() == strings(&tokens["actuators"]),
    ))
}

fn read_json(path: &Path) -> Result<Value, TraceError> {
    let bytes = files::read_bounded(path, 64 << 20)?;
    serde_json::from_slice(&bytes)
        .map_err(|e| TraceError::Description { what: e.to_string(), path: path.to_path_buf() })
}

/// The physics version of a trace, if this program has it.
#[must_use]
pub fn physics_of(trace: &TraceFile) -> Option<PhysicsVersion> {
    [PhysicsVersion::V2_3_7, PhysicsVersion::V3_17_0]
        .into_iter()
        .find(|version| version.to_string() == trace.physics)
}

//! Every reference case of the analyses that are built: numbers recorded from the authors' suite, NumPy and SciPy.
//!
//! The cases are whatever lies in the `analysis` folder of the golden data (`$ARNOLD_GOLDEN`, else
//! `../shared/golden`): a JSON file of cases beside an `.npz` of arrays. Tolerances and the way to compare come from
//! the case. Algorithms without an entry in [`run`] are counted and named on stderr.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use std::collections::{BTreeMap, BTreeSet};
use std::path::PathBuf;

use arnold_analyze::analysis::excitation::{action_for_excitation, excitation};
use arnold_analyze::analysis::performance::{BenchmarkRecord, EpisodeOutcome};
use arnold_analyze::analysis::stats::{Divisor, Summary, percentile};
use arnold_analyze::analysis::subspace::{
    Covariance, PrincipalComponents, Projection, mean_curve, own_curve, pooled_curve,
    principal_components,
};
use arnold_analyze::npz::{Array, Arrays};
use serde_json::Value;

/// What an algorithm computed for a case, by output name; NaN where undefined.
type Outputs = BTreeMap<String, Vec<f64>>;

/// Outputs that are components, i.e. rows defined up to their sign, in an `up_to_sign` case.
const SIGNLESS: [&str; 2] = ["components", "pool_components"];

/// One reference case with its arrays.
struct Case<'a> {
    name: String,
    description: &'a Value,
    arrays: &'a Arrays,
}

impl Case<'_> {
    fn algorithm(&self) -> &str {
        self.description["algorithm"].as_str().unwrap()
    }

    fn input(&self, name: &str) -> &Array {
        self.array("in", name)
    }

    fn array(&self, kind: &str, name: &str) -> &Array {
        let key =
            self.description[kind][name].as_str().unwrap_or_else(|| panic!("no {kind} `{name}`"));
        self.arrays.get(key).unwrap()
    }

    fn parameter(&self, name: &str) -> &Value {
        &self.description["params"][name]
    }

    /// Expected values of every output array and scalar.
    fn expected(&self) -> Outputs {
        let arrays = self.description["out"].as_object().unwrap();
        let scalars = self.description["scalars"].as_object().unwrap();
        let scalars = scalars.iter().map(|(name, value)| {
            assert!(value.is_number() || value.is_null(), "{}: scalar `{name}`", self.name);
            (name.clone(), vec![value.as_f64().unwrap_or(f64::NAN)])
        });
        arrays
            .keys()
            .map(|name| (name.clone(), self.array("out", name).to_f64()))
            .chain(scalars)
            .collect()
    }

    /// Absolute and relative tolerance of an output; `None` if it is informative only.
    fn tolerance(&self, name: &str) -> Option<(f64, f64)> {
        let tolerances = &self.description["tol"];
        let own = tolerances.get(name).unwrap_or(&tolerances["default"]);
        if own["ignore"] == Value::Bool(true) {
            return None;
        }
        Some((own["abs"].as_f64().unwrap_or(0.0), own["rel"].as_f64().unwrap_or(0.0)))
    }

    /// Compares what was computed with what is expected, collecting every difference.
    fn compare(&self, mut found: Outputs) -> Vec<String> {
        let signless = match self.description["compare"].as_str().unwrap() {
            "allclose" | "exact" => false,
            "up_to_sign" => true,
            other => panic!("{}: unknown comparison `{other}`", self.name),
        };
        let mut failures = Vec::new();
        for (name, want) in self.expected() {
            let Some((absolute, relative)) = self.tolerance(&name) else { continue };
            let Some(mut got) = found.remove(&name) else {
                failures.push(format!("{}: `{name}` was not computed", self.name));
                continue;
            };
            if got.len() != want.len() {
                failures.push(format!(
                    "{}: `{name}` has {} values, not {}",
                    self.name,
                    got.len(),
                    want.len()
                ));
                continue;
            }
            if signless && SIGNLESS.contains(&name.as_str()) {
                let width = *self.array("out", &name).shape.last().unwrap();
                align_signs(&mut got, &want, width);
            }
            let is_close = |got: f64, want: f64| {
                got.is_nan() && want.is_nan()
                    || (got - want).abs() <= absolute + relative * want.abs()
            };
            if let Some(at) = got.iter().zip(&want).position(|(&got, &want)| !is_close(got, want)) {
                failures.push(format!(
                    "{}: `{name}`[{at}] is {}, not {}",
                    self.name, got[at], want[at]
                ));
            }
        }
        failures
    }
}

/// Negates each row of `got` that points away from the same row of `want`.
fn align_signs(got: &mut [f64], want: &[f64], width: usize) {
    for (got, want) in got.chunks_exact_mut(width).zip(want.chunks_exact(width)) {
        if got.iter().zip(want).map(|(x, y)| x * y).sum::<f64>() < 0.0 {
            got.iter_mut().for_each(|x| *x = -*x);
        }
    }
}

/// Runs the algorithm of a case; `None` if it is not built.
fn run(case: &Case) -> Option<Outputs> {
    let algorithm: fn(&Case) -> Outputs = match case.algorithm() {
        "cumulative_ev" => cumulative_ev,
        "cumulative_ev_degenerate" => cumulative_ev_degenerate,
        "csi_project_pca" => csi_project_pca,
        "csi_curve" => csi_curve,
        "excitation" => excitations,
        "benchmark_fields" => benchmark_fields,
        "sem" => sem,
        "percentile_linear" => percentile_linear,
        _ => return None,
    };
    Some(algorithm(case))
}

fn outputs<const N: usize>(entries: [(&str, Vec<f64>); N]) -> Outputs {
    entries.into_iter().map(|(name, values)| (name.to_owned(), values)).collect()
}

fn covariance(matrix: &Array) -> Covariance {
    let mut covariance = Covariance::new(matrix.shape[1]);
    covariance.push_rows(&matrix.to_f64()).unwrap();
    covariance
}

fn components(matrix: &Array) -> PrincipalComponents {
    principal_components(&covariance(matrix)).unwrap()
}

fn cumulative_ev(case: &Case) -> Outputs {
    let task_count = case.description["in"].as_object().unwrap().len();
    let tasks: Vec<Covariance> =
        (0..task_count).map(|k| covariance(case.input(&format!("a{k}")))).collect();
    let mut stacked = Covariance::new(tasks[0].muscle_count());
    tasks.iter().for_each(|task| stacked.merge(task).unwrap());
    let pool = principal_components(&stacked).unwrap();
    let own: Vec<PrincipalComponents> =
        tasks.iter().map(|task| principal_components(task).unwrap()).collect();
    let own_curves: Vec<Vec<f64>> = own.iter().map(own_curve).collect();
    let pooled_curves: Vec<Vec<f64>> =
        tasks.iter().map(|task| pooled_curve(&pool, task).unwrap()).collect();

    let total = stacked.trace().unwrap();
    let mut found = outputs([
        ("pool_mean", pool.mean.clone()),
        ("pool_ratio", pool.variances.iter().map(|v| v / total).collect()),
        ("pool_components", pool.components.clone()),
        ("own_cum_mean", mean_curve(&own_curves)),
        ("shared_cum_mean", mean_curve(&pooled_curves)),
    ]);
    for (k, (own_cum, shared_cum)) in own_curves.into_iter().zip(pooled_curves).enumerate() {
        found.insert(format!("own_var{k}"), own[k].variances.clone());
        found.insert(format!("own_cum{k}"), own_cum);
        found.insert(format!("shared_cum{k}"), shared_cum);
    }
    found
}

/// The curve of a task without variance is zero in any basis; this one is the muscles themselves.
fn cumulative_ev_degenerate(case: &Case) -> Outputs {
    let task = covariance(case.input("a"));
    let muscles = task.muscle_count();
    assert!(principal_components(&task).is_err(), "a constant task has no components of its own");
    let mut components = vec![0.0; muscles * muscles];
    components.iter_mut().step_by(muscles + 1).for_each(|x| *x = 1.0);
    let basis = PrincipalComponents {
        mean: vec![0.0; muscles],
        variances: vec![1.0; muscles],
        components,
        rows: 100,
    };
    outputs([("shared", pooled_curve(&basis, &task).unwrap())])
}

fn csi_project_pca(case: &Case) -> Outputs {
    let basis = components(case.input("actions"));
    let x = case.input("x");
    let mut y = Vec::new();
    for count in case.parameter("n").as_array().unwrap() {
        let projection =
            Projection::new(&basis, usize::try_from(count.as_u64().unwrap()).unwrap()).unwrap();
        let mut scratch = vec![0.0; projection.scratch_length()];
        let mut actions = x.to_f64();
        for action in actions.chunks_exact_mut(projection.muscle_count()) {
            projection.apply_f64(action, &mut scratch);
        }
        y.extend(actions);
    }
    outputs([("mean", basis.mean.clone()), ("components", basis.components.clone()), ("y", y)])
}

fn csi_curve(case: &Case) -> Outputs {
    let fractions = case.input("fracs");
    let expert = case.parameter("expert").as_f64().unwrap();
    let (mean, sem) = fractions
        .to_f64()
        .chunks_exact(fractions.shape[1])
        .map(|episodes| {
            let summary = Summary::of(episodes, Divisor::Count);
            let relative = |value: Option<f64>| value.unwrap_or(f64::NAN) / expert;
            (relative(summary.mean), relative(summary.standard_error))
        })
        .unzip();
    outputs([("mean", mean), ("sem", sem)])
}

fn excitations(case: &Case) -> Outputs {
    let actions = case.input("a").to_f64();
    let found: Vec<f64> = actions.iter().copied().map(excitation).collect();
    for (action, &excitation) in actions.iter().zip(&found) {
        assert!((action_for_excitation(excitation) - action).abs() < 1e-9);
    }
    outputs([("e", found)])
}

fn benchmark_fields(case: &Case) -> Outputs {
    let steps = |name: &str| {
        case.input(name).to_f64().into_iter().map(|count| count as u32).collect::<Vec<u32>>()
    };
    let episodes: Vec<EpisodeOutcome> = steps("solved_steps")
        .into_iter()
        .zip(steps("episode_length"))
        .map(|(solved_steps, steps)| EpisodeOutcome { cumulative_reward: 0.0, solved_steps, steps })
        .collect();
    let horizon = u32::try_from(case.parameter("max_episode_steps").as_u64().unwrap()).unwrap();
    let record = serde_json::to_value(BenchmarkRecord::of(&episodes, horizon).unwrap()).unwrap();
    let fields = record.as_object().unwrap().iter();
    fields.filter_map(|(name, value)| Some((name.clone(), vec![value.as_f64()?]))).collect()
}

fn sem(case: &Case) -> Outputs {
    let divisor = match case.parameter("ddof").as_u64() {
        Some(0) => Divisor::Count,
        Some(1) => Divisor::CountMinusOne,
        other => panic!("unknown ddof {other:?}"),
    };
    let summary = Summary::of(&case.input("x").to_f64(), divisor);
    outputs([
        ("mean", vec![summary.mean.unwrap_or(f64::NAN)]),
        ("sem", vec![summary.standard_error.unwrap_or(f64::NAN)]),
    ])
}

fn percentile_linear(case: &Case) -> Outputs {
    let values = case.input("x").to_f64();
    let percents = case.input("q").to_f64();
    let found = percents.iter().map(|&q| percentile(&values, q).unwrap_or(f64::NAN)).collect();
    outputs([("value", found)])
}

#[test]
fn every_built_analysis_agrees_with_its_reference() {
    let Some(folder) = common::golden("analysis") else { return };
    let mut topics: Vec<PathBuf> = std::fs::read_dir(&folder)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.extension().is_some_and(|e| e == "json"))
        .filter(|path| path.with_extension("npz").exists())
        .collect();
    topics.sort();

    let mut compared = BTreeMap::<String, usize>::new();
    let mut not_built = BTreeSet::new();
    let mut failures = Vec::new();
    for path in topics {
        let json: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
        let arrays = Arrays::open(&path.with_extension("npz")).unwrap();
        for description in json["cases"].as_array().unwrap() {
            let topic = path.file_stem().unwrap().to_string_lossy();
            let name = format!("{topic} {}", description["id"].as_str().unwrap());
            let case = Case { name, description, arrays: &arrays };
            match run(&case) {
                Some(found) => {
                    failures.extend(case.compare(found));
                    *compared.entry(case.algorithm().to_owned()).or_default() += 1;
                }
                None => drop(not_built.insert(case.algorithm().to_owned())),
            }
        }
    }
    eprintln!("compared: {compared:?}");
    eprintln!("skipped: not built yet: {not_built:?}");
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(!compared.is_empty(), "the reference data hold no case of a built analysis");
}

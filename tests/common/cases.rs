//! Reference cases of the analyses: a JSON file of cases beside an `.npz` of arrays.
//!
//! Tolerances and the way to compare come from the case.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::collections::BTreeMap;
use std::path::Path;

use arnold_analyze::npz::{Array, Arrays};
use serde_json::Value;

/// What an algorithm computed for a case, by output name; NaN where undefined.
pub(crate) type Outputs = BTreeMap<String, Vec<f64>>;

/// Matrices whose columns are defined up to their sign in an `up_to_sign` case.
const SIGNLESS_COLUMNS: [&str; 4] = ["loadings", "unrotated", "rotated", "T"];
/// Matrices whose columns flip with those of another.
const FLIP_WITH: [(&str, &str); 2] = [("scores", "loadings"), ("T", "rotated")];

/// One reference case with its arrays.
pub(crate) struct Case<'a> {
    pub(crate) name: String,
    pub(crate) description: &'a Value,
    arrays: &'a Arrays,
}

/// The outputs of `entries`.
pub(crate) fn outputs<const N: usize>(entries: [(&str, Vec<f64>); N]) -> Outputs {
    entries.into_iter().map(|(name, values)| (name.to_owned(), values)).collect()
}

/// A value for comparison: NaN where undefined.
pub(crate) fn or_nan(value: Option<f64>) -> f64 {
    value.unwrap_or(f64::NAN)
}

/// A name for comparison.
pub(crate) fn text(text: &str) -> Vec<f64> {
    text.bytes().map(f64::from).collect()
}

/// Adds the numbers and names in `value` to `expected`.
fn flatten(name: String, value: &Value, expected: &mut Outputs) {
    let is_number = |value: &Value| value.is_number() || value.is_null();
    match value {
        Value::Object(fields) => {
            for (field, value) in fields {
                flatten(format!("{name}.{field}"), value, expected);
            }
        }
        Value::Array(values) if values.iter().all(is_number) => {
            expected.insert(name, values.iter().map(|value| or_nan(value.as_f64())).collect());
        }
        Value::Array(values) if values.iter().all(Value::is_string) => {
            let texts: Vec<&str> = values.iter().filter_map(Value::as_str).collect();
            expected.insert(name, text(&texts.join("\n")));
        }
        Value::Array(values) => {
            for (place, value) in values.iter().enumerate() {
                flatten(format!("{name}.{place}"), value, expected);
            }
        }
        Value::String(value) => drop(expected.insert(name, text(value))),
        value => {
            assert!(is_number(value), "scalar `{name}` is {value}");
            expected.insert(name, vec![or_nan(value.as_f64())]);
        }
    }
}

/// Runs every case of `topic` in `folder` and returns all differences, with the number of cases compared.
pub(crate) fn compare_topic(
    folder: &Path,
    topic: &str,
    run: impl Fn(&Case) -> Option<Outputs>,
) -> (usize, Vec<String>) {
    let path = folder.join(format!("{topic}.json"));
    let json: Value = serde_json::from_slice(&std::fs::read(&path).unwrap()).unwrap();
    let arrays = Arrays::open(&path.with_extension("npz")).unwrap();
    let (mut compared, mut failures) = (0, Vec::new());
    for description in json["cases"].as_array().unwrap() {
        let name = format!("{topic} {}", description["id"].as_str().unwrap());
        let case = Case { name, description, arrays: &arrays };
        match run(&case) {
            Some(found) => {
                failures.extend(case.compare(found));
                compared += 1;
            }
            None => eprintln!("skipped: {} ({}): not built here", case.name, case.algorithm()),
        }
    }
    (compared, failures)
}

impl Case<'_> {
    pub(crate) fn algorithm(&self) -> &str {
        self.description["algorithm"].as_str().unwrap()
    }

    pub(crate) fn input(&self, name: &str) -> &Array {
        self.array("in", name)
    }

    pub(crate) fn output(&self, name: &str) -> &Array {
        self.array("out", name)
    }

    pub(crate) fn parameter(&self, name: &str) -> &Value {
        &self.description["params"][name]
    }

    /// A number among the parameters.
    pub(crate) fn number(&self, name: &str) -> f64 {
        self.parameter(name).as_f64().unwrap()
    }

    /// A count among the parameters.
    pub(crate) fn count(&self, name: &str) -> usize {
        usize::try_from(self.parameter(name).as_u64().unwrap()).unwrap()
    }

    fn array(&self, kind: &str, name: &str) -> &Array {
        let key = self.description[kind][name].as_str();
        self.arrays.get(key.unwrap_or_else(|| panic!("{}: no {kind} `{name}`", self.name))).unwrap()
    }

    /// Expected values of every output array and scalar. What stands inside an object counts as `scalar.field`, lists
    /// of anything but numbers as `scalar.0` and so on, names as [`text`].
    fn expected(&self) -> Outputs {
        let mut expected: Outputs = self.description["out"]
            .as_object()
            .unwrap()
            .keys()
            .map(|name| (name.clone(), self.array("out", name).to_f64()))
            .collect();
        for (name, value) in self.description["scalars"].as_object().unwrap() {
            flatten(name.clone(), value, &mut expected);
        }
        expected
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
        let expected = self.expected();
        match self.description["compare"].as_str().unwrap() {
            "allclose" | "exact" => {}
            kind @ ("up_to_sign" | "up_to_sign_and_order") => {
                self.align(&mut found, &expected, kind == "up_to_sign_and_order");
            }
            other => panic!("{}: unknown comparison `{other}`", self.name),
        }
        let mut failures = Vec::new();
        for (name, want) in expected {
            let Some((absolute, relative)) = self.tolerance(&name) else { continue };
            let Some(got) = found.remove(&name) else {
                failures.push(format!("{}: `{name}` was not computed", self.name));
                continue;
            };
            if got.len() != want.len() {
                let (got, want) = (got.len(), want.len());
                failures.push(format!("{}: `{name}` has {got} values, not {want}", self.name));
                continue;
            }
            let is_close = |got: f64, want: f64| {
                got.is_nan() && want.is_nan()
                    || (got - want).abs() <= absolute + relative * want.abs()
            };
            if let Some(at) = got.iter().zip(&want).position(|(&got, &want)| !is_close(got, want)) {
                let (got, want) = (got[at], want[at]);
                failures.push(format!("{}: `{name}`[{at}] is {got}, not {want}", self.name));
            }
        }
        failures
    }

    /// Negates, and if asked reorders, the columns of `found` so that they lie as in `expected`.
    fn align(&self, found: &mut Outputs, expected: &Outputs, reorder: bool) {
        let mut chosen: BTreeMap<&str, Vec<(usize, f64)>> = BTreeMap::new();
        for name in SIGNLESS_COLUMNS {
            let (Some(got), Some(want)) = (found.get(name), expected.get(name)) else { continue };
            let width = *self.array("out", name).shape.last().unwrap();
            chosen.insert(name, columns_like(got, want, width, reorder));
        }
        for (name, leader) in FLIP_WITH {
            if let Some(columns) = chosen.get(leader).cloned() {
                chosen.insert(name, columns);
            }
        }
        for (name, columns) in chosen {
            let Some(values) = found.get_mut(name) else { continue };
            for row in values.chunks_exact_mut(columns.len()) {
                let before = row.to_vec();
                for (target, &(from, sign)) in row.iter_mut().zip(&columns) {
                    *target = sign * before[from];
                }
            }
        }
    }
}

/// For each column of `want`, the column of `got` that stands for it and the sign it needs.
fn columns_like(got: &[f64], want: &[f64], width: usize, reorder: bool) -> Vec<(usize, f64)> {
    let product = |from: usize, to: usize| -> f64 {
        let rows = got.chunks_exact(width).zip(want.chunks_exact(width));
        rows.map(|(got, want)| got[from] * want[to]).sum()
    };
    (0..width)
        .map(|to| {
            let best =
                |a: &usize, b: &usize| product(*a, to).abs().total_cmp(&product(*b, to).abs());
            let from = if reorder { (0..width).max_by(best).unwrap() } else { to };
            (from, product(from, to).signum())
        })
        .collect()
}

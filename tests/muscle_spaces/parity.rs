//! The numbers of both commands beside those of the authors' suite and scikit-learn, from recordings of their inputs.

use arnold_analyze::record::{Values, names, read_csv};

use super::{Value, folder, recording, save};
use crate::common::bench::Bench;
use crate::common::cases::{Case, Outputs, compare_topic};
use crate::common::golden;

/// A recording of one episode per input of the case, all in `set`, under the tasks' names.
fn record(bench: &Bench, set: &str, channel: &str, case: &Case, inputs: &[(&str, &str)]) {
    for (task, input) in inputs {
        let array = case.input(input);
        let channels = [(channel, vec![array.to_f64()])];
        save(bench, &format!("{set}/{task}"), recording(task, array.shape[1], &channels, &[true]));
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    let values = value.as_array().unwrap().iter();
    values.map(|value| value.as_f64().unwrap_or(f64::NAN)).collect()
}

/// Compares at least `least` cases of a topic that `run` knows; says so where there are no reference cases.
fn check(topic: &str, least: usize, run: impl Fn(&Case) -> Option<Outputs>) {
    let Some(folder) = golden("analysis") else { return };
    let (compared, failures) = compare_topic(&folder, topic, run);
    assert!(failures.is_empty(), "{failures:#?}");
    assert!(compared >= least, "only {compared} cases of {topic} were compared");
}

#[test]
fn subspaces_says_what_the_suite_says() {
    check("pvd_pad", 6, |case| match case.algorithm() {
        "pvd_pad" => Some(pair(case)),
        "pair_summary" => {
            let bench = Bench::new();
            let tasks = ["a0", "a1", "a2", "a3"].map(|name| (name, name));
            record(&bench, "set", names::ACTION, case, &tasks);
            let group = subspaces(&bench, "set", &[]);
            assert_eq!(group["pairs"], 6);
            let curve = |name: &str, key: &str| numbers(&group[name][key]);
            Some(Outputs::from(
                [("pvd", "mean"), ("pad", "mean"), ("pvd", "std"), ("pad", "std")].map(
                    |(name, key)| {
                        let suffix = if key == "std" { "sd" } else { key };
                        (format!("{name}_{suffix}"), curve(name, key))
                    },
                ),
            ))
        }
        _ => None,
    });
}

/// The first group of what `subspaces` finds in `set`.
fn subspaces(bench: &Bench, set: &str, options: &[&str]) -> Value {
    let recording = format!("policy={set}");
    let words = ["subspaces", "--recording", &recording, "--episodes", "1", "--json"];
    bench.json(&[&words[..], options].concat())["groups"][0].clone()
}

fn pair(case: &Case) -> Outputs {
    let bench = Bench::new();
    // The direction is from the alphabetically first task to the second.
    record(&bench, "there", names::ACTION, case, &[("one", "A"), ("two", "B")]);
    record(&bench, "back", names::ACTION, case, &[("one", "B"), ("two", "A")]);
    let mut found = Outputs::new();
    for (set, direction) in [("there", "ab"), ("back", "ba")] {
        for (option, name) in [("directed", "pvd"), ("difference", "difference")] {
            let group = subspaces(&bench, set, &["--pvd", option]);
            found.insert(format!("{name}_{direction}"), numbers(&group["pvd"]["mean"]));
        }
    }
    for angle in ["mean", "max", "min"] {
        let group = subspaces(&bench, "there", &["--pad", angle]);
        found.insert(format!("pad_{angle}"), numbers(&group["pad"]["mean"]));
    }
    found
}

#[test]
fn synergies_has_the_components_of_the_suite() {
    check("pca", 1, |case| {
        (case.algorithm() == "cumulative_ev").then(|| {
            let bench = Bench::new();
            let tasks = ["a0", "a1", "a2"].map(|name| (name, name));
            record(&bench, "set", names::ACTION_MEAN, case, &tasks);
            let words = ["synergies", "--recording", "policy=set", "--episodes", "1"];
            let document = bench.json(&[&words[..], &["--method", "pca", "--json"]].concat());
            let mut found = Outputs::new();
            let mean = &document["means"][0]["explained_variance"];
            found.insert("own_cum_mean".to_owned(), numbers(&mean["task"]["values"]));
            found.insert("shared_cum_mean".to_owned(), numbers(&mean["global"]["values"]));
            let table = Components::read(&document);
            for (place, task) in document["tasks"].as_array().unwrap().iter().enumerate() {
                let curve = |scope: &str| numbers(&task["explained_variance"][scope]["values"]);
                found.insert(format!("own_cum{place}"), curve("task"));
                found.insert(format!("shared_cum{place}"), curve("global"));
                found.insert(format!("own_var{place}"), table.variances(&format!("a{place}")));
            }
            let pooled = table.variances("pooled");
            let total: f64 = pooled.iter().sum();
            found.insert("pool_ratio".to_owned(), pooled.iter().map(|v| v / total).collect());
            found.insert("pool_mean".to_owned(), table.mean("pooled"));
            let want = case.output("pool_components").to_f64();
            found.insert("pool_components".to_owned(), table.weights_like("pooled", &want));
            found
        })
    });
}

/// The table of components.
struct Components {
    task: Vec<String>,
    component: Vec<i64>,
    variance: Vec<f64>,
    weight: Vec<f64>,
    mean: Vec<f64>,
}

impl Components {
    fn read(document: &Value) -> Self {
        let table = read_csv(&folder(document).join("components.csv")).unwrap();
        let floats = |name: &str| match &table.column(name).unwrap().values {
            Values::Floats(values) => values.clone(),
            other => panic!("{name}: {other:?}"),
        };
        let (Values::Texts(task), Values::Integers(component)) =
            (&table.column("task").unwrap().values, &table.column("component").unwrap().values)
        else {
            panic!("names and numbers were expected")
        };
        Self {
            task: task.clone(),
            component: component.clone(),
            variance: floats("variance"),
            weight: floats("weight"),
            mean: floats("mean"),
        }
    }

    /// `values` in the rows of `task`, row by row.
    fn of(&self, task: &str, values: &[f64]) -> Vec<f64> {
        let rows = self.task.iter().zip(values);
        rows.filter(|(name, _)| *name == task).map(|(_, value)| *value).collect()
    }

    fn muscles(&self, task: &str) -> usize {
        self.task.iter().zip(&self.component).filter(|(t, c)| *t == task && **c == 1).count()
    }

    fn variances(&self, task: &str) -> Vec<f64> {
        self.of(task, &self.variance).into_iter().step_by(self.muscles(task)).collect()
    }

    fn mean(&self, task: &str) -> Vec<f64> {
        self.of(task, &self.mean)[..self.muscles(task)].to_vec()
    }

    /// The components, each with the sign that it has in `want`.
    fn weights_like(&self, task: &str, want: &[f64]) -> Vec<f64> {
        let mut weights = self.of(task, &self.weight);
        let muscles = self.muscles(task);
        for (found, want) in weights.chunks_exact_mut(muscles).zip(want.chunks_exact(muscles)) {
            let product: f64 = found.iter().zip(want).map(|(x, y)| x * y).sum();
            found.iter_mut().for_each(|x| *x *= product.signum());
        }
        weights
    }
}

#[test]
fn synergies_rebuilds_as_well_as_scikit_learn() {
    check("nmf", 1, |case| {
        (case.algorithm() == "nmf_r2_curves").then(|| {
            let bench = Bench::new();
            record(&bench, "set", names::ACTION, case, &[("a0", "a0"), ("a1", "a1")]);
            let ranks = numbers(case.parameter("k"));
            let ranks: Vec<String> = ranks.iter().map(f64::to_string).collect();
            let words = ["synergies", "--recording", "policy=set", "--episodes", "1", "--json"];
            let (ranks, tolerance) = (ranks.join(","), case.number("tol").to_string());
            let iterations = case.count("max_iter").to_string();
            let options = [
                ["--method", "nmf"],
                ["--nmf-domain", "shift"],
                ["--nmf-init", "nndsvda"],
                ["--nmf-weights", "nnls"],
                ["--synergies", &ranks],
                ["--nmf-tolerance", &tolerance],
                ["--nmf-iterations", &iterations],
            ];
            let document = bench.json(&[&words[..], &options.concat()].concat());
            let curves = |scope: &str| {
                let tasks = document["tasks"].as_array().unwrap().iter();
                tasks.flat_map(|t| numbers(&t["reconstruction"][scope]["values"])).collect()
            };
            Outputs::from([
                ("own".to_owned(), curves("task")),
                ("shared".to_owned(), curves("global")),
            ])
        })
    });
}

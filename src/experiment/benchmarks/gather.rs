//! Results from several files and folders, put together.

use std::collections::BTreeMap;
use std::path::Path;

use crate::analysis::performance::{METHODS, TABLE_TASKS};
use crate::record::{
    Benchmark, BenchmarkEntry, BenchmarkInput, CsiResult, RecordError, SeedResult,
    find_csi_results, read_benchmark_input,
};

use super::{BenchmarkError, MetricMap};

/// What was found and not used.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct LeftOut {
    pub what: String,
    pub why: String,
}

/// Experts and methods.
#[derive(Debug, Clone, Default)]
pub struct Results {
    pub experts: Benchmark,
    pub methods: BTreeMap<String, Vec<SeedResult>>,
    /// Results of fine-tuning inside a control subspace.
    pub csi: Vec<CsiResult>,
    /// Policies with other histories, from a file of several.
    pub history: BTreeMap<String, Benchmark>,
    /// What counts as performance.
    pub metric: MetricMap,
    pub left_out: Vec<LeftOut>,
    /// Tasks that are compared, in the order of the table; set by [`Results::choose`].
    pub tasks: Vec<String>,
    /// Methods that were found in a tree and not asked for by name.
    found: Vec<String>,
}

impl Results {
    /// Nothing yet, to be measured by `metric`.
    #[must_use]
    pub fn measured_by(metric: MetricMap) -> Self {
        Self { metric, ..Self::default() }
    }

    /// Adds what lies at `path`. A single policy is called `name`, else by its file or folder.
    pub fn add(&mut self, name: Option<&str>, path: &Path) -> Result<(), BenchmarkError> {
        let csi = if path.is_dir() { find_csi_results(path)? } else { Vec::new() };
        let input = match read_benchmark_input(path) {
            Err(RecordError::NoFiles { .. }) if !csi.is_empty() => {
                self.csi.extend(csi);
                return Ok(());
            }
            input => input?,
        };
        // A folder of such files is no method.
        let is_csi = |folder: &str| csi.iter().any(|file| file.path.starts_with(path.join(folder)));
        match input {
            BenchmarkInput::Experts(experts) => self.add_experts(experts),
            BenchmarkInput::Seed(seed) => {
                let name = name.map_or_else(|| stem(path), str::to_owned);
                self.methods.entry(name).or_default().push(seed);
                Ok(())
            }
            BenchmarkInput::Several(policies) => {
                self.history.extend(policies);
                Ok(())
            }
            BenchmarkInput::Selection(methods) => {
                for (method, seeds) in methods {
                    self.found.push(method.clone());
                    self.methods.entry(method).or_default().extend(seeds);
                }
                Ok(())
            }
            BenchmarkInput::Tree((tree, unreadable)) => {
                for (method, seeds) in tree.methods.into_iter().filter(|(name, _)| !is_csi(name)) {
                    self.found.push(method.clone());
                    self.methods.entry(method).or_default().extend(seeds);
                }
                for (what, error) in unreadable.into_iter().filter(|(name, _)| !is_csi(name)) {
                    // A method of the paper's table that cannot be read is no small matter.
                    if METHODS.iter().any(|(name, _)| *name == what) {
                        return Err(error.into());
                    }
                    self.left_out.push(LeftOut { what, why: error.to_string() });
                }
                self.csi.extend(csi);
                self.add_experts(tree.experts)
            }
        }
    }

    /// Adds the experts at `path`, which holds nothing else.
    pub fn add_experts_at(&mut self, path: &Path) -> Result<(), BenchmarkError> {
        match read_benchmark_input(path)? {
            BenchmarkInput::Experts(experts) => self.add_experts(experts),
            BenchmarkInput::Seed(seed) => self.add_experts(seed.tasks),
            BenchmarkInput::Tree((tree, _)) if !tree.experts.is_empty() => {
                self.add_experts(tree.experts)
            }
            BenchmarkInput::Tree(_) | BenchmarkInput::Selection(_) | BenchmarkInput::Several(_) => {
                Err(RecordError::NoFiles { what: "of experts".to_owned(), path: path.into() }
                    .into())
            }
        }
    }

    fn add_experts(&mut self, experts: Benchmark) -> Result<(), BenchmarkError> {
        for (task, entry) in experts {
            let known = self.experts.insert(task.clone(), entry.clone());
            // The same file may be reached twice, through a tree and by itself.
            if known.is_some_and(|known| known != entry) {
                return Err(BenchmarkError::ExpertTwice { task });
            }
        }
        Ok(())
    }

    /// Fixes which tasks and methods are compared. Methods that merely lie in a tree, are not in the paper's table and
    /// lack a task are left out and named.
    pub fn choose(&mut self, tasks: &[String], methods: &[String]) -> Result<(), BenchmarkError> {
        let needs_experts = self.history.is_empty() || !self.methods.is_empty();
        if self.experts.is_empty() && needs_experts {
            return Err(BenchmarkError::NoExperts);
        }
        let listed = |names: &mut dyn Iterator<Item = &String>| {
            names.map(|name| format!("`{name}`")).collect::<Vec<_>>().join(", ")
        };
        if let Some(task) = tasks.iter().find(|task| !self.experts.contains_key(*task)) {
            let known = listed(&mut self.experts.keys());
            return Err(BenchmarkError::UnknownTask { task: task.clone(), known });
        }
        if let Some(method) = methods.iter().find(|name| !self.methods.contains_key(*name)) {
            let known = listed(&mut self.methods.keys());
            return Err(BenchmarkError::UnknownMethod { method: method.clone(), known });
        }
        for name in self.methods.iter().filter(|(_, seeds)| seeds.is_empty()).map(|(name, _)| name)
        {
            let why = "no result file of it is listed".to_owned();
            self.left_out.push(LeftOut { what: name.clone(), why });
        }
        self.methods.retain(|_, seeds| !seeds.is_empty());
        let wanted = |task: &String| tasks.is_empty() || tasks.contains(task);
        let mut chosen: Vec<String> = self.experts.keys().filter(|t| wanted(t)).cloned().collect();
        let place = |task: &String| TABLE_TASKS.iter().position(|known| known == task);
        chosen.sort_by_key(|task| (place(task).unwrap_or(usize::MAX), task.clone()));
        self.tasks = chosen;
        if !methods.is_empty() {
            self.methods.retain(|name, _| methods.contains(name));
            return Ok(());
        }
        let in_table = |name: &String| METHODS.iter().any(|(known, _)| known == name);
        for name in self.found.clone() {
            let Some(seeds) = self.methods.get(&name).filter(|_| !in_table(&name)) else {
                continue;
            };
            let has = |seed: &SeedResult, task: &String| {
                seed.tasks.get(task).is_some_and(|entry| self.metric.of(task, entry).is_some())
            };
            let missing = self.tasks.iter().find(|task| !seeds.iter().all(|seed| has(seed, task)));
            if let Some(task) = missing {
                let why = format!("it has no result for `{task}`; `--method {name}` asks for it");
                self.left_out.push(LeftOut { what: name.clone(), why });
                self.methods.remove(&name);
            }
        }
        Ok(())
    }

    /// The experts' records of the compared tasks.
    pub fn expert_entries(&self) -> impl Iterator<Item = (&str, &BenchmarkEntry)> + Clone {
        self.tasks.iter().filter_map(|task| Some((task.as_str(), self.experts.get(task)?)))
    }

    /// The experts' solved fractions of the compared tasks.
    pub(super) fn expert_fractions(&self) -> Result<Vec<f64>, BenchmarkError> {
        let share = |(task, entry): (&str, &BenchmarkEntry)| {
            let value = self.metric.of(task, entry);
            value.filter(|x| (0.0..=1.0).contains(x)).ok_or_else(|| BenchmarkError::ExpertValue {
                task: task.to_owned(),
                found: value.map_or_else(|| "none".to_owned(), |x| x.to_string()),
            })
        };
        self.expert_entries().map(share).collect()
    }

    /// The methods in the order of the paper's table, then the others by name.
    pub(super) fn ordered_methods(&self) -> Vec<(&str, &[SeedResult])> {
        let place = |name: &str| METHODS.iter().position(|(known, _)| *known == name);
        let mut methods: Vec<(&str, &[SeedResult])> =
            self.methods.iter().map(|(name, seeds)| (name.as_str(), seeds.as_slice())).collect();
        methods.sort_by_key(|(name, _)| (place(name).unwrap_or(usize::MAX), *name));
        methods
    }
}

/// What a path calls its policy: its file's name without `_results.json`, or its folder's.
fn stem(path: &Path) -> String {
    let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
    let folder = || path.parent().and_then(Path::file_name).unwrap_or_default().to_string_lossy();
    match name.strip_suffix("_results.json") {
        Some(stem) => stem.to_owned(),
        None if name == "results.json" => folder().into_owned(),
        None => name.strip_suffix(".json").unwrap_or(&name).to_owned(),
    }
}

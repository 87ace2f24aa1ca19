//! What training runs logged, from wherever it lies.
//!
//! A run is a method and a task with one or more files or folders: the pieces of one seed in the order in which they were
//! resumed. The task `all` takes every tag or column that ends in `/solved` and knows its task by its own name or
//! the environment's.
//! Several runs of one method and task are its seeds 0, 1, 2 ….

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::analysis::curves::Curve;
use crate::record::{
    CurvePoint, EventScalars, RecordError, ScalarSeries, read_curve_table, read_event_file,
    read_event_run, read_run_table,
};
use crate::sim::tasks;

use super::LearningError;

/// What a value measures.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Metric {
    SolvedFraction,
    Reward,
}

/// One seed's logged points, in pieces.
#[derive(Debug, Clone, PartialEq)]
pub struct Logged {
    /// As the table calls it; empty for runs.
    pub panel: String,
    pub method: String,
    pub seed: String,
    /// Code name; empty if not known.
    pub task: String,
    pub stage: String,
    pub metric: Metric,
    pub pieces: Vec<Curve>,
}

/// A training run, as asked for.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RunInput {
    pub method: String,
    /// Code name of the task, or `all`.
    pub task: String,
    pub paths: Vec<PathBuf>,
}

/// Everything that was logged.
#[derive(Debug, Clone, Default)]
pub struct Logs {
    pub curves: Vec<Logged>,
    /// Files that end early or are damaged; their readable part counts.
    pub damaged: Vec<String>,
}

/// The tag under which returns are logged.
const REWARD_TAG: &str = "rollout/ep_rew_mean";
/// The task of every environment in a log.
const EVERY: &str = "all";

impl Logged {
    /// What its line is called: the method, and its stage if it has one.
    pub(super) fn series_name(&self) -> String {
        if self.stage.is_empty() {
            self.method.clone()
        } else {
            format!("{}, {}", self.method, self.stage)
        }
    }

    /// What its panel is called: the task's name, and the panel's where it says more.
    pub(super) fn title(&self) -> String {
        let task = tasks::find(&self.task).map_or(self.task.as_str(), |task| task.paper_name);
        match (self.panel.as_str(), task) {
            ("", _) => task.to_owned(),
            (panel, "") => panel.to_owned(),
            (panel, _) if panel.eq_ignore_ascii_case(task) => task.to_owned(),
            (panel, _) => format!("{task}, {panel}"),
        }
    }
}

impl Logs {
    /// Adds a portable table.
    pub fn add_table(&mut self, path: &Path) -> Result<(), LearningError> {
        let points = read_curve_table(path)?;
        // In the order of first appearance.
        let mut places: BTreeMap<[String; 6], usize> = BTreeMap::new();
        let mut found: Vec<(Logged, Vec<(f64, f64)>)> = Vec::new();
        for point in points {
            let CurvePoint { panel, method, seed, task, stage, metric, step, value } = point;
            let kind = match metric.as_str() {
                "solved_fraction" | "" => Metric::SolvedFraction,
                "reward" => Metric::Reward,
                other => {
                    return Err(LearningError::Record(RecordError::Malformed {
                        place: "column `metric`".to_owned(),
                        what: format!("`{other}` is neither `solved_fraction` nor `reward`"),
                        path: path.to_path_buf(),
                    }));
                }
            };
            let key = [&panel, &method, &seed, &task, &stage, &metric].map(String::clone);
            let next = found.len();
            let at = *places.entry(key).or_insert(next);
            if at == next {
                let logged =
                    Logged { panel, method, seed, task, stage, metric: kind, pieces: Vec::new() };
                found.push((logged, Vec::new()));
            }
            found[at].1.push((step, value));
        }
        for (mut logged, mut points) in found {
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            logged.pieces.push(points.into_iter().collect());
            self.curves.push(logged);
        }
        Ok(())
    }

    /// Adds a run. `tag` names what to read from event files; without it, the solved fraction.
    pub fn add_run(&mut self, run: &RunInput, tag: Option<&str>) -> Result<(), LearningError> {
        let mut pieces: Vec<(String, Metric, Vec<Curve>)> = Vec::new();
        for path in &run.paths {
            for (task, metric, curve) in self.read(path, &run.task, tag)? {
                match pieces.iter_mut().find(|(known, kind, _)| *known == task && *kind == metric) {
                    Some((_, _, curves)) => curves.push(curve),
                    None => pieces.push((task, metric, vec![curve])),
                }
            }
        }
        for (task, metric, pieces) in pieces {
            let same = |known: &&Logged| known.method == run.method && known.task == task;
            let seed = self.curves.iter().filter(same).count().to_string();
            let (method, panel, stage) = (run.method.clone(), String::new(), String::new());
            self.curves.push(Logged { panel, method, seed, task, stage, metric, pieces });
        }
        Ok(())
    }

    /// The curves in one file or folder: task, metric, points.
    fn read(
        &mut self,
        path: &Path,
        task: &str,
        tag: Option<&str>,
    ) -> Result<Vec<(String, Metric, Curve)>, LearningError> {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        if path.is_dir() || name.contains("tfevents") {
            let scalars =
                if path.is_dir() { read_event_run(path)? } else { read_event_file(path)? };
            for (file, damage) in &scalars.damaged {
                self.damaged.push(format!("`{}`: {damage}", file.display()));
            }
            return from_events(&scalars, path, task, tag);
        }
        let nothing = |what: String| LearningError::NoSeries { what, path: path.to_path_buf() };
        let columns = read_run_table(path)?;
        if task == EVERY {
            let known = columns.into_iter().filter(|(_, points)| !points.is_empty());
            let curves: Vec<_> = known
                .filter_map(|(environment, points)| {
                    let task = task_of(&environment)?;
                    Some((task.to_owned(), Metric::SolvedFraction, points.into_iter().collect()))
                })
                .collect();
            return if curves.is_empty() {
                Err(nothing("a known environment".to_owned()))
            } else {
                Ok(curves)
            };
        }
        let is_only = columns.len() == 1;
        let (_, points) = columns
            .into_iter()
            .find(|(environment, _)| is_only || task_of(environment) == Some(task))
            .ok_or_else(|| nothing(format!("the environment of `{task}`")))?;
        Ok(vec![(task.to_owned(), Metric::SolvedFraction, points.into_iter().collect())])
    }
}

fn from_events(
    scalars: &EventScalars,
    path: &Path,
    task: &str,
    tag: Option<&str>,
) -> Result<Vec<(String, Metric, Curve)>, LearningError> {
    let nothing = |what: String| LearningError::NoSeries { what, path: path.to_path_buf() };
    let curve = |series: &ScalarSeries| -> Curve {
        let points = series.points.iter().filter(|point| point.value.is_finite());
        points.map(|point| (point.step as f64, point.value)).collect()
    };
    if task == EVERY {
        let curves: Vec<_> = scalars
            .series
            .iter()
            .filter_map(|series| {
                let environment = series.tag.strip_suffix("/solved")?.rsplit('/').next()?;
                let task = task_of(environment)?;
                Some((task.to_owned(), Metric::SolvedFraction, curve(series)))
            })
            .collect();
        return if curves.is_empty() {
            Err(nothing("`<environment>/solved`".to_owned()))
        } else {
            Ok(curves)
        };
    }
    let series = match tag {
        Some(tag) => scalars.series(tag).ok_or_else(|| nothing(format!("the tag `{tag}`")))?,
        None => solved_in(scalars, task)
            .or_else(|| scalars.solved())
            .or_else(|| scalars.series(REWARD_TAG))
            .ok_or_else(|| nothing(format!("a tag with `solved`, or `{REWARD_TAG}`")))?,
    };
    let mut found = (Metric::SolvedFraction, curve(series));
    if series.tag == REWARD_TAG {
        found.0 = Metric::Reward;
    } else if found.1.is_empty() && !series.points.is_empty() {
        // Some runs of walking logged a solved fraction that is never a number.
        let reward = scalars.series(REWARD_TAG).ok_or_else(|| {
            nothing(format!("`{}` with a defined value, nor `{REWARD_TAG}`", series.tag))
        })?;
        found = (Metric::Reward, curve(reward));
    }
    Ok(vec![(task.to_owned(), found.0, found.1)])
}

/// The solved fraction in `task`, where a run of several tasks logged each by its name or that of its environment.
fn solved_in<'a>(scalars: &'a EventScalars, task: &str) -> Option<&'a ScalarSeries> {
    scalars.series.iter().find(|series| {
        let of = series.tag.strip_suffix("/solved").and_then(|tag| tag.rsplit('/').next());
        of.is_some_and(|of| of == task || task_of(of) == Some(task))
    })
}

/// The code name of the task that an environment is of, or that is meant by its own name. Both directions of rotating balls log under one name, which
/// stands for the first.
fn task_of(environment: &str) -> Option<&'static str> {
    let mut tasks = tasks::ALL.iter();
    tasks
        .find(|task| task.environment == Some(environment) || task.name == environment)
        .map(|task| task.name)
}

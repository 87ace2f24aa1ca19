//! The tables: upstream's columns, then intervals, then what is printed in the paper.
//!
//! In percent of the experts unless a column says `fraction`. `ci_low` and `ci_high` are the ends of the 95 % interval of
//! the mean by Student's t over seeds; undefined for one seed.

use serde_json::{Map, Value, json};

use crate::analysis::performance::{
    FAMILIES, Improvement, MethodTest, PUBLISHED_OVERALL, PublishedImprovement, PublishedMethod,
};
use crate::analysis::stats::t_interval;
use crate::record::{BenchmarkEntry, RecordError, Rows, Table};

use super::{CONFIDENCE, MethodNumbers, Performance, Results, label_of, task_label};

/// Ends of the interval of a mean.
fn interval(mean: Option<f64>, sem: Option<f64>, seeds: usize) -> Option<(f64, f64)> {
    let (mean, half) = (mean?, t_interval(sem?, seeds, CONFIDENCE)?);
    Some((mean - half, mean + half))
}

impl Performance {
    /// One row per seed and task.
    pub fn seed_table(&self, results: &Results) -> Result<Table, RecordError> {
        let mut rows: Vec<(&MethodNumbers, usize, usize)> = Vec::new();
        for method in &self.methods {
            for seed in 0..method.fractions.len() {
                rows.extend((0..self.tasks.len()).map(|task| (method, seed, task)));
            }
        }
        let file = |method: &str, seed: usize| {
            let found = results.methods.get(method).and_then(|seeds| seeds.get(seed));
            let name = found.and_then(|seed| seed.path.file_name());
            name.unwrap_or_default().to_string_lossy().into_owned()
        };
        Rows::of(&rows)
            .text("method", |(method, ..)| method.name.clone())
            .count("seed", |(_, seed, _)| *seed)
            .text("task", |(.., task)| self.tasks[*task].clone())
            .number("solved_fraction", "", |(method, seed, task)| {
                Some(method.fractions[*seed][*task])
            })
            .number("relative_pct", "%", |(method, seed, task)| {
                Some(method.relative.task(*task)[*seed])
            })
            .text("file", |(method, seed, _)| file(&method.name, *seed))
            .table()
    }

    /// One row per method and family, the average over all tasks last.
    pub fn family_table(&self) -> Result<Table, RecordError> {
        let rows: Vec<_> = self.methods.iter().flat_map(|method| &method.families).collect();
        let published = |method: &str, family: &str| PublishedMethod::find(method)?.family(family);
        Rows::of(&rows)
            .text("method", |row| row.method.clone())
            .text("column", |row| row.column.to_owned())
            .number("mean", "%", |row| row.mean)
            .number("sem", "%", |row| row.sem)
            .count("n_seeds", |row| row.n_seeds)
            .number("ci_low", "%", |row| interval(row.mean, row.sem, row.n_seeds).map(|i| i.0))
            .number("ci_high", "%", |row| interval(row.mean, row.sem, row.n_seeds).map(|i| i.1))
            .number("published_mean", "%", |row| published(&row.method, row.column).map(|p| p.0))
            .number("published_sem", "%", |row| published(&row.method, row.column).map(|p| p.1))
            .table()
    }

    /// One row per method and task.
    pub fn task_table(&self) -> Result<Table, RecordError> {
        let rows: Vec<_> = self.methods.iter().flat_map(|method| &method.tasks).collect();
        let published = |method: &str, task: &str| PublishedMethod::find(method)?.task(task);
        Rows::of(&rows)
            .text("method", |row| row.method.clone())
            .text("column", |row| row.column.to_owned())
            .text("task", |row| row.task.clone())
            .number("mean", "%", |row| row.mean)
            .number("sem", "%", |row| row.sem)
            .count("n_seeds", |row| row.n_seeds)
            .number("ci_low", "%", |row| interval(row.mean, row.sem, row.n_seeds).map(|i| i.0))
            .number("ci_high", "%", |row| interval(row.mean, row.sem, row.n_seeds).map(|i| i.1))
            .number("published_mean", "%", |row| published(&row.method, &row.task).map(|p| p.0))
            .number("published_sem", "%", |row| published(&row.method, &row.task).map(|p| p.1))
            .table()
    }

    /// One row per method the reference was tested against; the experts last, whose p is not corrected.
    pub fn test_table(&self) -> Result<Table, RecordError> {
        let mut rows: Vec<MethodTest> = self.tests.clone();
        rows.push(MethodTest {
            method: "expert".to_owned(),
            test: self.overall,
            n_tasks: self.tasks.len(),
            p_holm: f64::NAN,
        });
        let printed =
            |method: &str, pick: fn((f64, f64, f64)) -> f64| Some(pick(self.printed_test(method)?));
        Rows::of(&rows)
            .text("method", |row| row.method.clone())
            .number("W", "", |row| row.test.map(|test| test.statistic))
            .number("p", "", |row| row.test.map(|test| test.p))
            .count("n_tasks", |row| row.n_tasks)
            .count("n_nonzero", |row| row.test.map_or(0, |test| test.nonzero))
            .number("rank_biserial", "", |row| row.test.map(|test| test.rank_biserial))
            .number("p_holm", "", |row| Some(row.p_holm))
            .number("published_W", "", |row| match row.method.as_str() {
                "expert" => self.is_published_reference().then_some(PUBLISHED_OVERALL.0),
                method => printed(method, |test| test.1),
            })
            .number("published_p", "", |row| {
                let is_overall = row.method == "expert" && self.is_published_reference();
                is_overall.then_some(PUBLISHED_OVERALL.1)
            })
            .number("published_p_holm", "", |row| printed(&row.method, |test| test.2))
            .number("published_rank_biserial", "", |row| printed(&row.method, |test| test.0))
            .table()
    }

    /// One row per task: the reference against the expert. The columns of the reference bear its name.
    pub fn improvement_table(&self) -> Result<Table, RecordError> {
        let name = self.reference.as_deref().unwrap_or_default();
        let printed = |row: &Improvement, pick: fn(&PublishedImprovement) -> f64| {
            let found = PublishedImprovement::find(&row.task)?;
            self.is_published_reference().then(|| pick(found))
        };
        Rows::of(&self.improvements)
            .text("task", |row| row.task.clone())
            .number("expert", "", |row| Some(row.expert))
            .number(name, "", |row| row.solved.mean)
            .number(&format!("{name}_sem"), "", |row| row.solved.standard_error)
            .number("improvement", "%", |row| row.test.map(|test| test.mean))
            .number("sem", "%", |row| row.test.map(|test| test.standard_error))
            .number("t", "", |row| row.test.and_then(|test| test.t))
            .number("p", "", |row| row.test.map(|test| test.p))
            .count("n_seeds", |row| row.solved.count)
            .number("p_holm", "", |row| Some(row.p_holm))
            .number("published_improvement", "%", |row| printed(row, |p| p.improvement.0))
            .number("published_sem", "%", |row| printed(row, |p| p.improvement.1))
            .number("published_t", "", |row| printed(row, |p| p.t))
            .number("published_p_holm", "", |row| printed(row, |p| p.p_holm))
            .table()
    }

    /// Whether the printed tests are of this reference.
    pub(super) fn is_published_reference(&self) -> bool {
        self.reference.as_deref() == Some(super::REFERENCE)
    }

    /// Rank-biserial correlation, W and Holm p as printed.
    fn printed_test(&self, method: &str) -> Option<(f64, f64, f64)> {
        if self.is_published_reference() { PublishedMethod::find(method)?.test } else { None }
    }

    /// Rows of the table of families for LaTeX, a star where the average differs from the reference's.
    #[must_use]
    pub fn family_rows_latex(&self) -> String {
        let row = |method: &MethodNumbers| {
            let test = self.tests.iter().find(|test| test.method == method.name);
            let star = if test.is_some_and(|test| test.p_holm < 0.05) { "$^*$" } else { "" };
            let cells = method.families.iter().map(|cell| latex_cell(cell.mean, cell.sem));
            (latex_text(&method.label), cells.collect::<Vec<_>>(), star)
        };
        latex_rows(self.methods.iter().map(row))
    }

    /// Rows of the table of tasks for LaTeX.
    #[must_use]
    pub fn task_rows_latex(&self) -> String {
        let row = |method: &MethodNumbers| {
            let cells = method.tasks.iter().map(|cell| latex_cell(cell.mean, cell.sem));
            (latex_text(&method.label), cells.collect::<Vec<_>>(), "")
        };
        latex_rows(self.methods.iter().map(row))
    }

    /// Everything that is printed, as a document.
    #[must_use]
    pub fn document(&self) -> Value {
        let mut methods = Map::new();
        for method in &self.methods {
            let mut families = Map::new();
            for row in &method.families {
                let published =
                    PublishedMethod::find(&row.method).and_then(|found| found.family(row.column));
                families
                    .insert(row.column.to_owned(), cell(row.mean, row.sem, row.n_seeds, published));
            }
            let mut tasks = Map::new();
            for row in &method.tasks {
                let published =
                    PublishedMethod::find(&row.method).and_then(|found| found.task(&row.task));
                tasks.insert(row.task.clone(), cell(row.mean, row.sem, row.n_seeds, published));
            }
            let seeds = method.fractions.len();
            let entry = json!({"label": method.label, "seeds": seeds, "families": families, "tasks": tasks});
            methods.insert(method.name.clone(), entry);
        }
        let tests: Vec<Value> = self
            .tests
            .iter()
            .map(|row| {
                json!({
                    "method": row.method,
                    "label": label_of(&row.method),
                    "W": row.test.map(|test| test.statistic),
                    "p": row.test.map(|test| test.p),
                    "n_tasks": row.n_tasks,
                    "n_nonzero": row.test.map(|test| test.nonzero),
                    "rank_biserial": row.test.map(|test| test.rank_biserial),
                    "p_holm": Some(row.p_holm).filter(|p| !p.is_nan()),
                    "published": self.printed_test(&row.method).map(|(r, w, p)| {
                        json!({"rank_biserial": r, "W": w, "p_holm": p})
                    }),
                })
            })
            .collect();
        let improvements: Vec<Value> =
            self.improvements.iter().map(|row| self.improved(row)).collect();
        let published = self.is_published_reference().then_some(PUBLISHED_OVERALL);
        json!({
            "tasks": self.tasks,
            "methods": methods,
            "reference": self.reference,
            "metric_map": self.metric.name(),
            "tests": tests,
            "overall": self.overall.map(|test| json!({
                "W": test.statistic,
                "p": test.p,
                "rank_biserial": test.rank_biserial,
                "published": published.map(|(w, p)| json!({"W": w, "p": p})),
            })),
            "improvements": improvements,
        })
    }

    fn improved(&self, row: &Improvement) -> Value {
        let published =
            PublishedImprovement::find(&row.task).filter(|_| self.is_published_reference());
        json!({
            "task": row.task,
            "expert": row.expert,
            "solved_fraction": row.solved.mean,
            "solved_fraction_sem": row.solved.standard_error,
            "improvement": row.test.map(|test| test.mean),
            "sem": row.test.map(|test| test.standard_error),
            "t": row.test.and_then(|test| test.t),
            "p": row.test.map(|test| test.p),
            "p_holm": Some(row.p_holm).filter(|p| !p.is_nan()),
            "n_seeds": row.solved.count,
            "published": published.map(|p| json!({
                "improvement": p.improvement.0,
                "sem": p.improvement.1,
                "t": p.t,
                "p_holm": p.p_holm,
                "p_is_bound": p.p_is_bound,
            })),
        })
    }
}

fn cell(mean: Option<f64>, sem: Option<f64>, seeds: usize, published: Option<(f64, f64)>) -> Value {
    let ends = interval(mean, sem, seeds).map(|(low, high)| [low, high]);
    let published = published.map(|(mean, sem)| [mean, sem]);
    json!({"mean": mean, "sem": sem, "n_seeds": seeds, "interval_95": ends, "published": published})
}

/// One row per expert: solved fraction with its s.e.m. over episodes, beside the printed one.
pub fn expert_table(results: &Results) -> Result<Table, RecordError> {
    let rows: Vec<(&str, &BenchmarkEntry)> = results.expert_entries().collect();
    Rows::of(&rows)
        .text("task", |(task, _)| (*task).to_owned())
        .number("solved_fraction", "", |(_, entry)| entry.avg_solved_step_frac)
        .number("sem", "", |(_, entry)| episode_error(entry))
        .count("n_episodes", |(_, entry)| entry.num_episodes.unwrap_or(0))
        .count("horizon", |(_, entry)| entry.max_episode_steps.unwrap_or(0) as usize)
        .number("published", "", |(task, _)| PublishedImprovement::find(task).map(|p| p.expert))
        .table()
}

/// The experts as a document.
#[must_use]
pub fn expert_document(results: &Results) -> Value {
    let rows = results.expert_entries().map(|(task, entry)| {
        json!({
            "task": task,
            "solved_fraction": entry.avg_solved_step_frac,
            "sem": episode_error(entry),
            "n_episodes": entry.num_episodes,
            "published": PublishedImprovement::find(task).map(|p| p.expert),
        })
    });
    rows.collect()
}

/// Standard error over the episodes of one record, from its population deviation.
pub(super) fn episode_error(entry: &BenchmarkEntry) -> Option<f64> {
    let (horizon, episodes) = (entry.max_episode_steps?, entry.num_episodes?);
    let is_known = horizon > 0 && episodes > 0;
    is_known.then_some(entry.std_solved_steps? / f64::from(horizon) / (episodes as f64).sqrt())
}

/// The heading of a family's column.
#[must_use]
pub fn family_label(column: &str) -> &'static str {
    const LABELS: [&str; 6] = ["Finger", "Elbow", "Baoding", "Reorient", "Reloc.", "Walk"];
    let place = FAMILIES.iter().position(|(name, _)| *name == column);
    place.map_or("Avg", |place| LABELS[place])
}

fn latex_rows<'a>(rows: impl Iterator<Item = (String, Vec<String>, &'a str)>) -> String {
    let lines =
        rows.map(|(label, cells, star)| format!("{label} & {}{star} \\\\\n", cells.join(" & ")));
    lines.collect::<Vec<String>>().concat()
}

fn latex_cell(mean: Option<f64>, sem: Option<f64>) -> String {
    match (mean, sem) {
        (Some(mean), Some(sem)) => format!("${mean:.1} \\pm {sem:.1}$"),
        (Some(mean), None) => format!("${mean:.1}$"),
        (None, _) => "--".to_owned(),
    }
}

fn latex_text(text: &str) -> String {
    let special = |c: char| matches!(c, '_' | '&' | '%' | '$' | '#' | '{' | '}');
    text.chars().flat_map(|c| special(c).then_some('\\').into_iter().chain([c])).collect()
}

/// The names of the compared tasks, as printed.
#[must_use]
pub fn task_labels(tasks: &[String]) -> Vec<String> {
    tasks.iter().map(|task| task_label(task)).collect()
}

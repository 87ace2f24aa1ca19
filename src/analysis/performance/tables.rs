//! The table of families and the table of tasks, one row per cell.
//!
//! Field names are the columns of the published `families.csv` and `per_task.csv`. Mean and s.e.m. in percent of the
//! expert, over seeds, divisor n − 1.
//!
//! A seed without a defined value for one of the tasks is an error, unless missing values are allowed: then its cell is
//! left out, and so is its family and its average. Oracle: `relative.rs`.

use super::super::stats::Summary;
use super::{FAMILIES, PerformanceError, RelativeMatrix};

/// A method: solved fractions of its seeds, one row per seed, one value per task.
#[derive(Debug, Clone, PartialEq)]
pub struct Method {
    pub name: String,
    pub seeds: Vec<Vec<f64>>,
}

impl Method {
    /// Its percentages of the experts. With `allow_missing`, undefined values stay undefined.
    pub fn relative(
        &self,
        tasks: &[&str],
        experts: &[f64],
        allow_missing: bool,
    ) -> Result<RelativeMatrix, PerformanceError> {
        if tasks.len() != experts.len() {
            return Err(PerformanceError::TaskCount {
                expected: tasks.len(),
                found: experts.len(),
            });
        }
        let matrix = RelativeMatrix::new(&self.seeds, experts)?;
        let missing = (0..tasks.len()).find_map(|task| {
            let seed = matrix.task(task).iter().position(|x| x.is_nan())?;
            Some((task, seed))
        });
        match missing {
            Some((task, seed)) if !allow_missing => Err(PerformanceError::MissingTask {
                method: self.name.clone(),
                seed,
                task: tasks[task].to_owned(),
            }),
            _ => Ok(matrix),
        }
    }
}

/// A cell of the table of families: `families.csv`.
#[derive(Debug, Clone, PartialEq)]
pub struct FamilyRow {
    pub method: String,
    /// A family, or `avg`.
    pub column: &'static str,
    pub mean: Option<f64>,
    pub sem: Option<f64>,
    pub n_seeds: usize,
}

/// A cell of the table of tasks: `per_task.csv`.
#[derive(Debug, Clone, PartialEq)]
pub struct TaskRow {
    pub method: String,
    /// The family of the task.
    pub column: &'static str,
    pub task: String,
    pub mean: Option<f64>,
    pub sem: Option<f64>,
    pub n_seeds: usize,
}

/// The row of `method` in the table of families: six families and the average over all `tasks`. A family none of whose
/// tasks were compared is left out; a family of which one is missing is undefined.
#[must_use]
pub fn family_rows(method: &str, tasks: &[&str], matrix: &RelativeMatrix) -> Vec<FamilyRow> {
    let place = |task: &&str| tasks.iter().position(|known| known == task);
    let row = |column, summary: Summary| FamilyRow {
        method: method.to_owned(),
        column,
        mean: summary.mean,
        sem: summary.standard_error,
        n_seeds: summary.count,
    };
    let mut rows: Vec<FamilyRow> = FAMILIES
        .iter()
        .filter(|(_, members)| members.iter().any(|task| place(task).is_some()))
        .map(|&(family, members)| {
            let places: Option<Vec<usize>> = members.iter().map(place).collect();
            let nothing = Summary { mean: None, standard_error: None, count: 0 };
            row(family, places.map_or(nothing, |places| matrix.family_summary(&places)))
        })
        .collect();
    let all: Vec<usize> = (0..tasks.len()).collect();
    rows.push(row("avg", matrix.family_summary(&all)));
    rows
}

/// The row of `method` in the table of tasks.
#[must_use]
pub fn task_rows(method: &str, tasks: &[&str], matrix: &RelativeMatrix) -> Vec<TaskRow> {
    tasks
        .iter()
        .enumerate()
        .map(|(place, &task)| {
            let summary = matrix.task_summary(place);
            TaskRow {
                method: method.to_owned(),
                column: super::family_of(task).unwrap_or("other"),
                task: task.to_owned(),
                mean: summary.mean,
                sem: summary.standard_error,
                n_seeds: summary.count,
            }
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_missing_task_is_an_error_that_names_it_unless_allowed() {
        let method =
            Method { name: "obc".to_owned(), seeds: vec![vec![0.5, 0.5], vec![f64::NAN, 0.5]] };
        let tasks = ["pen", "reorient"];
        let error = method.relative(&tasks, &[0.5, 0.5], false).unwrap_err();
        assert_eq!(error.to_string(), "seed 1 of `obc` has no defined value for task `pen`");
        let matrix = method.relative(&tasks, &[0.5, 0.5], true).unwrap();
        let rows = family_rows("obc", &tasks, &matrix);
        assert_eq!(rows.iter().map(|row| row.column).collect::<Vec<_>>(), ["reorient", "avg"]);
        assert_eq!((rows[0].n_seeds, rows[0].mean), (1, Some(100.0)));
        assert_eq!(task_rows("obc", &tasks, &matrix)[1].n_seeds, 2);
    }

    #[test]
    fn half_a_family_is_no_family() {
        let matrix = RelativeMatrix::from_percent(&[vec![100.0]], 1).unwrap();
        let rows = family_rows("obc", &["pen"], &matrix);
        assert_eq!((rows[0].column, rows[0].mean), ("reorient", None));
        assert_eq!((rows[1].column, rows[1].mean), ("avg", Some(100.0)));
    }
}

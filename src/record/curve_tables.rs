//! Learning curves in tables.
//!
//! * The **portable** table: columns `panel,method,seed,task,stage,step,value,metric`, one row per logged point; the
//!   metric is `solved_fraction` or `reward`. Other columns are ignored.
//! * The log of a **multi-task run**: `_step`, `global_step` and one column `<environment>/solved` per task; empty cells
//!   were not logged. Steps are those of `global_step`.
//!
//! Undefined steps and values are left out. Both may be gzipped.

use std::path::Path;

use super::{RecordError, Table, Values, read_columns, read_csv};

/// One logged point of a portable table.
#[derive(Debug, Clone, PartialEq)]
pub struct CurvePoint {
    pub panel: String,
    pub method: String,
    pub seed: String,
    pub task: String,
    pub stage: String,
    pub metric: String,
    pub step: f64,
    pub value: f64,
}

/// The logged points of one environment: steps and values.
pub type RunColumn = (String, Vec<(f64, f64)>);

/// Reads a portable table.
pub fn read_curve_table(path: &Path) -> Result<Vec<CurvePoint>, RecordError> {
    const NAMES: [&str; 8] =
        ["panel", "method", "seed", "task", "stage", "metric", "step", "value"];
    let table = read_columns(path, &NAMES)?;
    let text = |name: &str| texts(&table, name);
    let (panel, method, seed) = (text("panel"), text("method"), text("seed"));
    let (task, stage, metric) = (text("task"), text("stage"), text("metric"));
    let (step, value) = (numbers(&table, "step", path)?, numbers(&table, "value", path)?);
    Ok((0..table.row_count())
        .filter(|&row| step[row].is_finite() && value[row].is_finite())
        .map(|row| CurvePoint {
            panel: panel[row].clone(),
            method: method[row].clone(),
            seed: seed[row].clone(),
            task: task[row].clone(),
            stage: stage[row].clone(),
            metric: metric[row].clone(),
            step: step[row],
            value: value[row],
        })
        .collect())
}

/// Reads the log of a multi-task run: for each environment its logged points.
pub fn read_run_table(path: &Path) -> Result<Vec<RunColumn>, RecordError> {
    const ENDING: &str = "/solved";
    let table = read_csv(path)?;
    let steps = numbers(&table, "global_step", path)?;
    let mut columns = Vec::new();
    for column in table.columns() {
        let Some(environment) = column.name.strip_suffix(ENDING) else { continue };
        let values = numbers(&table, &column.name, path)?;
        let points = steps.iter().copied().zip(values);
        let points = points.filter(|(step, value)| step.is_finite() && value.is_finite());
        columns.push((environment.to_owned(), points.collect()));
    }
    if columns.is_empty() {
        return Err(RecordError::NoColumn {
            column: format!("*{ENDING}"),
            known: format!("{} columns", table.columns().len()),
            path: path.to_path_buf(),
        });
    }
    Ok(columns)
}

/// A column as texts, whatever it holds: seeds are numbers or names.
fn texts(table: &Table, name: &str) -> Vec<String> {
    match table.column(name).map(|column| &column.values) {
        Some(Values::Texts(texts)) => texts.clone(),
        Some(Values::Integers(values)) => values.iter().map(ToString::to_string).collect(),
        Some(Values::Flags(values)) => values.iter().map(ToString::to_string).collect(),
        // A column of empty cells only is read as undefined numbers.
        Some(Values::Floats(values)) => {
            values.iter().map(|x| if x.is_nan() { String::new() } else { x.to_string() }).collect()
        }
        None => Vec::new(),
    }
}

fn numbers(table: &Table, name: &str, path: &Path) -> Result<Vec<f64>, RecordError> {
    match table.column(name).map(|column| &column.values) {
        Some(Values::Floats(values)) => Ok(values.clone()),
        Some(Values::Integers(values)) => Ok(values.iter().map(|&x| x as f64).collect()),
        Some(_) => Err(RecordError::Malformed {
            place: format!("column `{name}`"),
            what: "it does not hold numbers".to_owned(),
            path: path.to_path_buf(),
        }),
        None => Err(RecordError::NoColumn {
            column: name.to_owned(),
            known: format!("{} columns", table.columns().len()),
            path: path.to_path_buf(),
        }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files;

    fn written(text: &str) -> (tempfile::TempDir, std::path::PathBuf) {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("x.csv");
        files::write_atomic(&path, text.as_bytes()).unwrap();
        (folder, path)
    }

    #[test]
    fn a_portable_table_keeps_seeds_as_names_and_leaves_out_what_is_undefined() {
        let (_folder, path) = written(
            "panel,method,seed,task,stage,step,value,metric\n\
             finetuning,obc,0,pen,,1,0.5,solved_fraction\n\
             finetuning,obc,0,pen,,2,,solved_fraction\n",
        );
        let points = read_curve_table(&path).unwrap();
        assert_eq!(points.len(), 1);
        assert_eq!((points[0].seed.as_str(), points[0].stage.as_str()), ("0", ""));
    }

    #[test]
    fn a_run_table_has_a_curve_per_environment() {
        let (_folder, path) =
            written("_step,global_step,A-v0/solved,B-v0/solved,x\n1,10,0.1,,5\n2,20,,0.2,5\n");
        let columns = read_run_table(&path).unwrap();
        assert_eq!(columns[0], ("A-v0".to_owned(), vec![(10.0, 0.1)]));
        assert_eq!(columns[1], ("B-v0".to_owned(), vec![(20.0, 0.2)]));
        let (_folder, path) = written("global_step,x\n1,2\n");
        assert!(read_run_table(&path).unwrap_err().to_string().contains("`*/solved`"));
        let (_folder, path) = written("A/solved\n1\n");
        assert!(read_run_table(&path).unwrap_err().to_string().contains("`global_step`"));
    }
}

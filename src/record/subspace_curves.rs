//! Published control-subspace curves: `curves.csv`, one row per factorisation, scope, basis, task and dimension.
//!
//! The reconstruction stands in a column `reconstruction`, or `reconstruction_4dp` where it was rounded to four
//! decimals. `solved_fraction_sem` may be missing. Other columns are ignored. A run of `csi` writes the same columns as
//! Parquet.

use std::path::Path;

use super::read_table::read_whole;
use super::{RecordError, Table, Values};

/// One point of a curve.
#[derive(Debug, Clone, PartialEq)]
pub struct SubspacePoint {
    /// `pca` or `nmf`.
    pub method: String,
    /// `task` or `global`.
    pub scope: String,
    pub basis_policy: String,
    pub task: String,
    pub dimension: usize,
    /// Share of variance, or R² for `nmf`, which can be negative.
    pub reconstruction: f64,
    pub solved_fraction: f64,
    pub solved_fraction_sem: Option<f64>,
    pub n_episodes: usize,
    pub n_fits: usize,
}

/// Reads the points of a file in their order.
pub fn read_subspace_curves(path: &Path) -> Result<Vec<SubspacePoint>, RecordError> {
    let table = read_whole(path)?;
    let reader = Reader { table: &table, path };
    let reconstruction = if table.column("reconstruction").is_some() {
        "reconstruction"
    } else {
        "reconstruction_4dp"
    };
    let texts = |name| reader.texts(name);
    let (method, scope) = (texts("method")?, texts("scope")?);
    let (basis_policy, task) = (texts("basis_policy")?, texts("task")?);
    let dimension = reader.counts("dimension")?;
    let reconstruction = reader.numbers(reconstruction)?;
    let solved_fraction = reader.numbers("solved_fraction")?;
    let has_error = table.column("solved_fraction_sem").is_some();
    let errors = if has_error { Some(reader.numbers("solved_fraction_sem")?) } else { None };
    let (n_episodes, n_fits) = (reader.counts("n_episodes")?, reader.counts("n_fits")?);
    Ok((0..table.row_count())
        .map(|row| SubspacePoint {
            method: method[row].clone(),
            scope: scope[row].clone(),
            basis_policy: basis_policy[row].clone(),
            task: task[row].clone(),
            dimension: dimension[row],
            reconstruction: reconstruction[row],
            solved_fraction: solved_fraction[row],
            solved_fraction_sem: errors.as_ref().map(|errors| errors[row]).filter(|x| !x.is_nan()),
            n_episodes: n_episodes[row],
            n_fits: n_fits[row],
        })
        .collect())
}

struct Reader<'a> {
    table: &'a Table,
    path: &'a Path,
}

impl Reader<'_> {
    fn values(&self, name: &str) -> Result<&Values, RecordError> {
        let missing = || self.fault(name, "there is no such column".to_owned());
        self.table.column(name).map(|column| &column.values).ok_or_else(missing)
    }

    fn texts(&self, name: &str) -> Result<&[String], RecordError> {
        match self.values(name)? {
            Values::Texts(texts) => Ok(texts),
            _ => Err(self.fault(name, "it does not hold names".to_owned())),
        }
    }

    fn numbers(&self, name: &str) -> Result<Vec<f64>, RecordError> {
        match self.values(name)? {
            Values::Floats(values) => Ok(values.clone()),
            Values::Integers(values) => Ok(values.iter().map(|&x| x as f64).collect()),
            _ => Err(self.fault(name, "it does not hold numbers".to_owned())),
        }
    }

    fn counts(&self, name: &str) -> Result<Vec<usize>, RecordError> {
        let Values::Integers(values) = self.values(name)? else {
            return Err(self.fault(name, "it does not hold whole numbers".to_owned()));
        };
        let count =
            |&x: &i64| usize::try_from(x).map_err(|_| self.fault(name, format!("{x} is no count")));
        values.iter().map(count).collect()
    }

    fn fault(&self, column: &str, what: String) -> RecordError {
        let place = format!("column `{column}`");
        RecordError::Malformed { place, what, path: self.path.to_path_buf() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::files;

    #[test]
    fn both_names_of_the_reconstruction_are_read_and_faults_name_the_column() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("curves.csv");
        let read = |text: &str| {
            files::write_atomic(&path, text.as_bytes()).unwrap();
            read_subspace_curves(&path)
        };
        let head = "method,scope,basis_policy,task,dimension";
        let rounded = format!(
            "{head},reconstruction_4dp,solved_fraction,n_episodes,n_fits\nnmf,task,arnold,pen,2,-0.1,0.5,100,10\n"
        );
        let point = read(&rounded).unwrap().remove(0);
        assert_eq!((point.dimension, point.reconstruction, point.n_fits), (2, -0.1, 10));
        assert_eq!(point.solved_fraction_sem, None);
        let full = rounded.replace("_4dp,solved_fraction", ",solved_fraction,solved_fraction_sem");
        let full = full.replace("0.5,100", "0.5,0.25,100");
        assert_eq!(read(&full).unwrap()[0].solved_fraction_sem, Some(0.25));
        let error = read(&rounded.replace(",2,", ",-2,")).unwrap_err().to_string();
        assert!(error.contains("column `dimension`") && error.contains("-2"), "{error}");
        let error = read("method\npca\n").unwrap_err().to_string();
        assert!(error.contains("column `scope`"), "{error}");
    }
}

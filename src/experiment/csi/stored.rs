//! The projections of a finished sweep, made again from the table of its bases.
//!
//! The table holds every number bit for bit, so an episode that is played again in a task's own components is the one that
//! was played. Of several factorisations with as many synergies it is the first, which serves the first episodes.

use std::path::Path;

use crate::analysis::subspace::{
    PrincipalComponents, Projection, SubspaceError, SynergyProjection,
};
use crate::record::{RecordError, Table, Values, read_columns};
use crate::sim::rollout::Subspace;

use super::super::ExperimentError;
use super::{Method, Scope};

/// The projection of the first episode of `task`, which has so many `muscles`, onto so many `components` of its own, by the
/// table of bases in `path`.
pub fn stored_projection(
    path: &Path,
    method: &Method,
    task: &str,
    muscles: usize,
    components: usize,
) -> Result<Subspace, ExperimentError> {
    let failed =
        |source: SubspaceError| ExperimentError::Subspace { task: task.to_owned(), source };
    let complete = |values: Vec<f64>, expected: usize| {
        if values.len() == expected {
            return Ok(values);
        }
        Err(RecordError::Malformed {
            place: format!("the basis of `{task}` with {components} components"),
            what: format!("it has {} weights, expected {expected}", values.len()),
            path: path.to_path_buf(),
        })
    };
    let of_task = [("scope", Scope::Task.word()), ("tasks", task)];
    match method {
        Method::PrincipalComponents => {
            let table =
                read_columns(path, &["scope", "tasks", "component", "weight", "mean_action"])?;
            let weights = complete(chosen(&table, "weight", &of_task, &[]), muscles * muscles)?;
            let mean = chosen(&table, "mean_action", &of_task, &[("component", 1)]);
            let mean = complete(mean, muscles)?;
            let basis =
                PrincipalComponents { mean, variances: Vec::new(), components: weights, rows: 0 };
            Projection::new(&basis, components).map(Subspace::Actions).map_err(failed)
        }
        Method::Synergies(options) => {
            let table = read_columns(path, &["scope", "tasks", "dimension", "fit", "weight"])?;
            let first = [("dimension", components as i64), ("fit", 0)];
            let weights = chosen(&table, "weight", &of_task, &first);
            let synergies = complete(weights, components * muscles)?;
            SynergyProjection::new(&synergies, muscles, &options.of_fit(0))
                .map(Subspace::Excitations)
                .map_err(failed)
        }
    }
}

/// The numbers of `column` in the rows that have those `words` and `numbers`.
fn chosen(
    table: &Table,
    column: &str,
    words: &[(&str, &str)],
    numbers: &[(&str, i64)],
) -> Vec<f64> {
    let values = |name: &str| table.column(name).map(|column| &column.values);
    let is_chosen = |row: &usize| {
        let has_word = |&(name, word): &(&str, &str)| match values(name) {
            Some(Values::Texts(all)) => all[*row] == word,
            _ => false,
        };
        let has_number = |&(name, number): &(&str, i64)| match values(name) {
            Some(Values::Integers(all)) => all[*row] == number,
            _ => false,
        };
        words.iter().all(has_word) && numbers.iter().all(has_number)
    };
    match values(column) {
        Some(Values::Floats(all)) => (0..all.len()).filter(is_chosen).map(|row| all[row]).collect(),
        _ => Vec::new(),
    }
}

#[cfg(test)]
mod tests {
    use super::super::SynergyOptions;
    use super::*;
    use crate::record::{Column, write_csv};

    /// Two muscles; the rows of another task and of the pooled basis are not to be taken.
    fn write(path: &Path) {
        let scope = ["task", "task", "task", "task", "task", "global"].map(str::to_owned);
        let tasks = ["pen", "pen", "pen", "pen", "die", "pen"].map(str::to_owned);
        let table = Table::new(vec![
            Column::unitless("scope", scope.to_vec()),
            Column::unitless("tasks", tasks.to_vec()),
            Column::unitless("component", vec![1_i64, 1, 2, 2, 1, 1]),
            Column::unitless("dimension", vec![1_i64, 1, 2, 2, 1, 1]),
            Column::unitless("fit", vec![0_i64; 6]),
            Column::unitless("weight", vec![0.6, 0.8, 0.8, -0.6, 9.0, 9.0]),
            Column::unitless("mean_action", vec![0.5, 0.25, 0.5, 0.25, 9.0, 9.0]),
        ]);
        write_csv(path, &table.unwrap()).unwrap();
    }

    #[test]
    fn the_projection_of_a_table_is_that_of_its_task() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bases.csv");
        write(&path);
        let method = Method::PrincipalComponents;
        let Subspace::Actions(projection) = stored_projection(&path, &method, "pen", 2, 1).unwrap()
        else {
            panic!("no projection of actions")
        };
        let mut action = [1.5, 0.25];
        projection.apply_f64(&mut action, &mut vec![0.0; projection.scratch_length()]);
        // (1, 0) beside the mean, onto (0.6, 0.8).
        assert!((action[0] - 0.86).abs() < 1e-15 && (action[1] - 0.73).abs() < 1e-15, "{action:?}");
        let synergies = Method::Synergies(SynergyOptions::default());
        let found = stored_projection(&path, &synergies, "pen", 2, 1).unwrap();
        assert!(matches!(found, Subspace::Excitations(synergies) if synergies.rank() == 1));
    }

    #[test]
    fn a_basis_that_is_not_whole_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("bases.csv");
        write(&path);
        let method = Method::PrincipalComponents;
        for (task, muscles, found) in [("pen", 3, "4 weights, expected 9"), ("die", 2, "1 weights")]
        {
            let error =
                stored_projection(&path, &method, task, muscles, 1).unwrap_err().to_string();
            assert!(error.contains(found) && error.contains("bases.csv"), "{error}");
        }
        let nothing = folder.path().join("nothing.parquet");
        assert!(stored_projection(&nothing, &method, "pen", 2, 1).is_err());
    }
}

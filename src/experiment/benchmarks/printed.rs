//! The paper's printed tables as tables, for whoever has no result files.

use crate::analysis::performance::{
    FAMILIES, PUBLISHED_IMPROVEMENTS, PUBLISHED_METHODS, PUBLISHED_OVERALL, TABLE_TASKS,
};
use crate::record::{Column, RecordError, Table};

/// One of the printed tables.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PrintedTable {
    Families,
    Tasks,
    Tests,
    Improvements,
}

impl PrintedTable {
    /// Its rows, with upstream's column names.
    pub fn table(self) -> Result<Table, RecordError> {
        match self {
            Self::Families => {
                let names: Vec<&str> =
                    FAMILIES.iter().map(|(name, _)| *name).chain(["avg"]).collect();
                cells("column", &names)
            }
            Self::Tasks => cells("task", &TABLE_TASKS),
            Self::Tests => tests(),
            Self::Improvements => improvements(),
        }
    }
}

/// Mean and s.e.m. of every method in every column.
fn cells(title: &str, names: &[&str]) -> Result<Table, RecordError> {
    let rows: Vec<_> = PUBLISHED_METHODS
        .iter()
        .flat_map(|method| names.iter().map(move |name| (method, *name)))
        .collect();
    let value = |method: &crate::analysis::performance::PublishedMethod, name: &str| {
        method.task(name).filter(|_| title == "task").or_else(|| method.family(name))
    };
    let nan = (f64::NAN, f64::NAN);
    let values: Vec<(f64, f64)> =
        rows.iter().map(|(method, name)| value(method, name).unwrap_or(nan)).collect();
    Table::new(vec![
        Column::unitless("method", rows.iter().map(|(m, _)| m.name.to_owned()).collect::<Vec<_>>()),
        Column::unitless(
            title,
            rows.iter().map(|(_, name)| (*name).to_owned()).collect::<Vec<_>>(),
        ),
        Column::new("mean", "%", values.iter().map(|(mean, _)| *mean).collect::<Vec<_>>()),
        Column::new("sem", "%", values.iter().map(|(_, sem)| *sem).collect::<Vec<_>>()),
        Column::unitless("n_seeds", rows.iter().map(|(m, _)| m.seeds as i64).collect::<Vec<_>>()),
    ])
}

fn tests() -> Result<Table, RecordError> {
    let (w, p) = PUBLISHED_OVERALL;
    let mut rows: Vec<(&str, [f64; 4])> = PUBLISHED_METHODS
        .iter()
        .filter_map(|method| {
            let (r, w, p_holm) = method.test?;
            Some((method.name, [w, f64::NAN, r, p_holm]))
        })
        .collect();
    rows.push(("expert", [w, p, f64::NAN, f64::NAN]));
    let column = |place: usize| rows.iter().map(|(_, cells)| cells[place]).collect::<Vec<f64>>();
    Table::new(vec![
        Column::unitless(
            "method",
            rows.iter().map(|(name, _)| (*name).to_owned()).collect::<Vec<_>>(),
        ),
        Column::unitless("W", column(0)),
        Column::unitless("p", column(1)),
        Column::unitless("rank_biserial", column(2)),
        Column::unitless("p_holm", column(3)),
    ])
}

fn improvements() -> Result<Table, RecordError> {
    let rows = &PUBLISHED_IMPROVEMENTS;
    Table::new(vec![
        Column::unitless("task", rows.iter().map(|row| row.task.to_owned()).collect::<Vec<_>>()),
        Column::unitless("expert", rows.iter().map(|row| row.expert).collect::<Vec<_>>()),
        Column::unitless("arnold", rows.iter().map(|row| row.arnold.0).collect::<Vec<_>>()),
        Column::unitless("arnold_sem", rows.iter().map(|row| row.arnold.1).collect::<Vec<_>>()),
        Column::new(
            "improvement",
            "%",
            rows.iter().map(|row| row.improvement.0).collect::<Vec<_>>(),
        ),
        Column::new("sem", "%", rows.iter().map(|row| row.improvement.1).collect::<Vec<_>>()),
        Column::unitless("t", rows.iter().map(|row| row.t).collect::<Vec<_>>()),
        Column::unitless("p_holm", rows.iter().map(|row| row.p_holm).collect::<Vec<_>>()),
        Column::unitless("p_is_bound", rows.iter().map(|row| row.p_is_bound).collect::<Vec<_>>()),
    ])
}

#[cfg(test)]
mod whole {
    use super::*;

    #[test]
    fn every_printed_table_is_whole() {
        let rows = |table: PrintedTable| table.table().unwrap().row_count();
        assert_eq!(rows(PrintedTable::Families), 70);
        assert_eq!(rows(PrintedTable::Tasks), 140);
        assert_eq!(rows(PrintedTable::Tests), 10);
        assert_eq!(rows(PrintedTable::Improvements), 14);
        let families = PrintedTable::Families.table().unwrap();
        let undefined = crate::record::to_csv(&families).contains(",,");
        assert!(!undefined, "the elbow is a family as well as a task");
    }
}

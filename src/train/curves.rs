//! The curves of a run: `curves.parquet` for programs, an event file for `TensorBoard` (`spec/training.md` §5.12).
//!
//! One row per iteration. The table holds nothing that depends on the clock, so it is the same for the same run; the event
//! file has the times and the steps per second besides.

use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

use super::TrainError;
use crate::record::{self, Column, EventWriter, Table, Values};

/// Name of the table.
const TABLE: &str = "curves.parquet";
/// Name of the event file: what `TensorBoard` looks for, without a host or a process in it.
const EVENTS: &str = "events.out.tfevents.0.arnold-analyze";
/// Name of the column that says how many steps were done.
const STEP: &str = "step";

/// Curves that grow.
#[derive(Debug)]
pub(super) struct Curves {
    table: PathBuf,
    events: EventWriter,
    steps: Vec<i64>,
    /// Name and one value per row; NaN where there is none.
    columns: Vec<(String, Vec<f64>)>,
}

impl Curves {
    /// The curves in `folder` up to `steps`: what came later is forgotten. A run that began at `first` has none until then.
    pub(super) fn open(folder: &Path, steps: u64, first: u64) -> Result<Self, TrainError> {
        let events = EventWriter::open(&folder.join(EVENTS), steps as i64, now())?;
        let table = folder.join(TABLE);
        let mut curves = Self { table, events, steps: Vec::new(), columns: Vec::new() };
        if steps > first {
            curves.read(steps as i64)?;
        }
        Ok(curves)
    }

    fn read(&mut self, steps: i64) -> Result<(), TrainError> {
        let (table, _) = record::read_parquet(&self.table)?;
        let rows = |column: &Column| match &column.values {
            Values::Integers(all) => {
                Some(all.iter().take_while(|&&s| s <= steps).copied().collect())
            }
            _ => None,
        };
        let known: Option<Vec<i64>> = table.column(STEP).and_then(rows);
        let known =
            known.ok_or_else(|| TrainError::State { what: "table of curves".to_owned() })?;
        for column in table.columns() {
            if let Values::Floats(values) = &column.values {
                let values = values.iter().take(known.len()).copied().collect();
                self.columns.push((column.name.clone(), values));
            }
        }
        self.steps = known;
        Ok(())
    }

    /// Adds a row; `steps_per_second` goes to `TensorBoard` only.
    pub(super) fn add(
        &mut self,
        steps: u64,
        values: &[(String, f64)],
        steps_per_second: f64,
    ) -> Result<(), TrainError> {
        for (name, value) in values {
            let place = self.columns.iter().position(|(known, _)| known == name);
            let place = place.unwrap_or_else(|| {
                self.columns.push((name.clone(), vec![f64::NAN; self.steps.len()]));
                self.columns.len() - 1
            });
            self.columns[place].1.push(*value);
        }
        self.steps.push(steps as i64);
        for (_, column) in &mut self.columns {
            column.resize(self.steps.len(), f64::NAN);
        }
        let known = values.iter().filter(|(_, value)| value.is_finite());
        let scalars = known.map(|(name, value)| (name.as_str(), *value));
        let scalars = scalars.chain([("time/fps", steps_per_second)]);
        Ok(self.events.write(steps as i64, now(), scalars)?)
    }

    /// Writes the table as it is.
    pub(super) fn save(&self) -> Result<(), TrainError> {
        self.events.sync()?;
        let mut columns = vec![Column::unitless(STEP, self.steps.clone())];
        let curves = self.columns.iter();
        columns.extend(curves.map(|(name, values)| Column::unitless(name.clone(), values.clone())));
        Ok(record::write_parquet(&self.table, &Table::new(columns)?, &[])?)
    }
}

/// Seconds since 1970.
fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |passed| passed.as_secs_f64())
}

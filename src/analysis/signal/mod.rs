//! Signals sampled at a fixed rate: tables of samples, filters, resampling.

mod butterworth;
mod resample;
mod rows;
mod zero_phase;

pub use butterworth::{LowPass, LowPassOptions};
pub use resample::{resample, resample_rows};
pub use rows::Rows;

use crate::units::Hertz;

/// Why a signal cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum SignalError {
    #[error("{values} values do not make rows of {columns}")]
    Ragged { values: usize, columns: usize },
    #[error("row {row}, column {column} is {value}, not a finite number")]
    NotFinite { row: usize, column: usize, value: f64 },
    #[error("a sample rate of {rate} Hz is not a positive number")]
    SampleRate { rate: Hertz },
    #[error("a cut-off of {cutoff} Hz is not a positive number")]
    Cutoff { cutoff: Hertz },
    #[error("a low-pass has order 1 to {most}, not {order}")]
    Order { order: usize, most: usize },
}

//! Statistics of samples.

mod bootstrap;
mod percentile;
mod summary;

pub use bootstrap::{BootstrapOptions, Interval, bootstrap_interval, bootstrap_mean};
pub use percentile::percentile;
pub use summary::{Divisor, Summary, mean, standard_deviation, standard_error};

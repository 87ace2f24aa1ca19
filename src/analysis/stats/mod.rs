//! Statistics of samples.

mod bootstrap;
mod corrections;
mod correlation;
mod mann_whitney;
mod percentile;
mod ranks;
mod replication;
mod sidedness;
mod summary;
mod t_test;
mod wilcoxon;

pub use bootstrap::{
    BootstrapOptions, Interval, bootstrap_difference, bootstrap_interval, bootstrap_mean,
};
pub use corrections::{Correction, bonferroni, holm};
pub use correlation::{LARGEST_CORRELATION, fisher_z, pearson};
pub use mann_whitney::{LARGEST_SAMPLE, MannWhitney, mann_whitney, mann_whitney_normal};
pub use percentile::percentile;
pub use replication::{ReplicationError, bootstrap_units, unit_means};
pub use sidedness::Sidedness;
pub use summary::{Divisor, Summary, mean, standard_deviation, standard_error};
pub use t_test::{TTest, one_sample_t, t_interval, t_p};
pub use wilcoxon::{
    MOST_EXACT_PAIRS, NullDistribution, Wilcoxon, WilcoxonMethod, Zeros, rank_biserial, wilcoxon,
    wilcoxon_exact_p, wilcoxon_with,
};

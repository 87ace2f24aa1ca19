//! Which way an effect may go to count. It changes conclusions, so it has no default.

use std::fmt;

/// The alternative hypothesis of a test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sidedness {
    /// Different, either way.
    TwoSided,
    /// The first is greater.
    Greater,
    /// The first is less.
    Less,
}

impl Sidedness {
    /// The p value from the (lower, upper) tail probabilities, each including what was observed.
    pub(super) fn p(self, (lower, upper): (f64, f64)) -> f64 {
        match self {
            Self::TwoSided => (2.0 * lower.min(upper)).min(1.0),
            Self::Greater => upper.min(1.0),
            Self::Less => lower.min(1.0),
        }
    }
}

impl fmt::Display for Sidedness {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::TwoSided => "two-sided",
            Self::Greater => "greater",
            Self::Less => "less",
        })
    }
}

//! Tests of a tidy table: which rows belong together, which groups are compared, and what comes of it.
//!
//! 1. Rows of one group and one *unit of replication* are averaged: a hundred episodes of one seed are one observation.
//! 2. Groups are compared: with each other, pair by pair or as independent samples, or each with a number.
//! 3. p values of one family of tests are corrected together; every value of the column `by` is a family of its own.
//!
//! Nothing that decides a conclusion is chosen here: unit, alternative, zeros and correction stand in the [`Plan`] and
//! again in every result. A comparison says `a` − `b`. Undefined values and pairs without a partner are errors, or left
//! out and counted.
//!
//! Oracle: the tests themselves are those of `analysis::stats`; `tests/stats_command.rs` repeats the published tables.

mod report;
mod samples;

use crate::analysis::stats::{
    BootstrapOptions, Correction, Divisor, Interval, LARGEST_SAMPLE, MOST_EXACT_PAIRS,
    NullDistribution, Sidedness, Summary, Zeros, bootstrap_difference, bootstrap_mean,
    mann_whitney, mann_whitney_normal, one_sample_t, wilcoxon_with,
};
use crate::record::Table;

pub use report::correction_name;
use samples::{Group, families};

/// What is asked of a table.
#[derive(Debug, Clone, PartialEq)]
pub struct Plan {
    pub test: Test,
    /// Column of the numbers.
    pub value: String,
    /// Columns that together name a unit of replication; none: every row is one.
    pub unit: Vec<String>,
    /// Column of the groups; without it all rows are one group.
    pub group: Option<String>,
    /// Column that splits the table into families of tests.
    pub by: Option<String>,
    pub design: Design,
    /// The group that is compared with each other one; without it, every pair.
    pub compare: Option<String>,
    pub correction: Option<Correction>,
    pub bootstrap: BootstrapOptions,
    /// Leave out rows without a value and pairs without a partner.
    pub skip_undefined: bool,
}

/// Which test.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Test {
    Wilcoxon {
        zeros: Zeros,
        alternative: Sidedness,
        distribution: NullDistribution,
    },
    MannWhitney {
        alternative: Sidedness,
        distribution: NullDistribution,
    },
    T {
        alternative: Sidedness,
    },
    /// Intervals alone, no test.
    Bootstrap,
}

/// What is compared with what.
#[derive(Debug, Clone, PartialEq)]
pub enum Design {
    /// Units of two groups that have the same value in this column.
    Paired(String),
    /// Every group with a number.
    Reference(f64),
    /// Groups as independent samples.
    Independent,
}

/// One group of one family.
#[derive(Debug, Clone, PartialEq)]
pub struct GroupRow {
    pub family: String,
    pub group: String,
    /// Over units, divisor n − 1.
    pub summary: Summary,
    pub rows: usize,
    /// Bootstrap interval of the mean over units.
    pub interval: Option<Interval>,
}

/// One comparison.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    pub family: String,
    pub a: String,
    /// A group, or the number compared with.
    pub b: String,
    /// Pairs, or units of each group.
    pub n: (usize, Option<usize>),
    /// Non-zero differences, for the signed-rank test.
    pub n_nonzero: Option<usize>,
    pub statistic: Option<f64>,
    pub p: Option<f64>,
    pub p_corrected: Option<f64>,
    pub rank_biserial: Option<f64>,
    /// Mean of a − b.
    pub difference: f64,
    pub interval: Option<Interval>,
    /// How p came about.
    pub method: String,
}

/// What came of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Report {
    pub plan: Plan,
    pub groups: Vec<GroupRow>,
    pub comparisons: Vec<Comparison>,
    pub left_out_rows: usize,
    pub left_out_pairs: usize,
}

/// Why a table cannot be tested.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum HypothesisError {
    #[error("the table has no row")]
    NoRows,
    #[error("column `{column}` holds {found}, not numbers")]
    NotNumbers { column: String, found: &'static str },
    #[error("row {row} of column `{column}` names nothing: it is undefined")]
    NoLabel { column: String, row: usize },
    #[error("{count} of {rows} values in column `{column}` are undefined, the first in row {row}")]
    Undefined { column: String, count: usize, rows: usize, row: usize },
    #[error("column `{column}` has only one group, `{group}`: there is nothing to compare it with")]
    OneGroup { column: String, group: String },
    #[error("there is no group `{group}`; there are {known}")]
    UnknownGroup { group: String, known: String },
    #[error("there are {tests} tests in one family, and no correction is chosen")]
    NoCorrection { tests: usize },
    #[error(
        "`{pair}` of column `{column}` is there {count} times in group `{group}`, as units {units}"
    )]
    SeveralUnits { pair: String, column: String, group: String, count: usize, units: String },
    #[error("unit `{unit}` of group `{group}` has several values in column `{column}`")]
    SeveralPairs { unit: String, group: String, column: String },
    #[error("`{pair}` of column `{column}` is in group `{there}`, but not in `{missing}`")]
    NoPartner { pair: String, column: String, there: String, missing: String },
    #[error("{found} pairs are too many to count exactly, {most} are possible")]
    TooManyPairs { found: usize, most: usize },
    #[error("{groups} groups are more than can be compared with each other, {most} are possible")]
    TooManyGroups { groups: usize, most: usize },
    #[error("a test between `{a}` and `{b}` needs at least {least} units, found {found}")]
    TooFew { a: String, b: String, least: usize, found: usize },
}

/// More groups than this give more pairs than anybody reads.
const MOST_GROUPS: usize = 200;

impl Plan {
    /// The columns that are needed, each once.
    #[must_use]
    pub fn columns(&self) -> Vec<&str> {
        let pair = if let Design::Paired(column) = &self.design { Some(column) } else { None };
        let all = [Some(&self.value), self.group.as_ref(), self.by.as_ref(), pair];
        let mut columns: Vec<&str> =
            all.into_iter().flatten().chain(&self.unit).map(String::as_str).collect();
        let mut seen = std::collections::BTreeSet::new();
        columns.retain(|column| seen.insert(*column));
        columns
    }

    /// Runs the tests on `table`, which must have [`Plan::columns`].
    pub fn run(self, table: &Table) -> Result<Report, HypothesisError> {
        let (families, left_out_rows) = families(table, &self)?;
        let mut report = Report {
            groups: Vec::new(),
            comparisons: Vec::new(),
            left_out_rows,
            left_out_pairs: 0,
            plan: self,
        };
        for (family, groups) in families {
            for group in &groups {
                report.groups.push(group_row(&family, group, &report.plan.bootstrap));
            }
            let mut comparisons = report.plan.compare_groups(&family, &groups)?;
            report.left_out_pairs +=
                comparisons.iter().map(|(_, left_out)| left_out).sum::<usize>();
            report.plan.correct(&mut comparisons)?;
            report.comparisons.extend(comparisons.into_iter().map(|(comparison, _)| comparison));
        }
        Ok(report)
    }

    /// The comparisons of one family, each with the number of pairs it left out.
    fn compare_groups(
        &self,
        family: &str,
        groups: &[Group],
    ) -> Result<Vec<(Comparison, usize)>, HypothesisError> {
        if let Design::Reference(reference) = self.design {
            let one = |group: &Group| {
                let differences: Vec<f64> =
                    group.units.iter().map(|unit| unit.mean - reference).collect();
                let number = reference.to_string();
                Ok((self.of_differences(family, &group.name, &number, &differences)?, 0))
            };
            return groups.iter().map(one).collect();
        }
        if self.test == Test::Bootstrap && groups.len() == 1 {
            return Ok(Vec::new());
        }
        let pairs = self.pairs_of_groups(groups)?;
        pairs
            .into_iter()
            .map(|(a, b)| match &self.design {
                Design::Paired(column) => {
                    let (differences, left_out) =
                        samples::paired(a, b, column, self.skip_undefined)?;
                    Ok((self.of_differences(family, &a.name, &b.name, &differences)?, left_out))
                }
                _ => Ok((self.of_samples(family, a, b)?, 0)),
            })
            .collect()
    }

    /// Who is compared with whom.
    fn pairs_of_groups<'a>(
        &self,
        groups: &'a [Group],
    ) -> Result<Vec<(&'a Group, &'a Group)>, HypothesisError> {
        if let [only] = groups {
            return Err(HypothesisError::OneGroup {
                column: self.group.clone().unwrap_or_default(),
                group: only.name.clone(),
            });
        }
        if let Some(name) = &self.compare {
            let chosen = groups.iter().find(|group| group.name == *name).ok_or_else(|| {
                let names: Vec<String> =
                    groups.iter().take(20).map(|group| format!("`{}`", group.name)).collect();
                HypothesisError::UnknownGroup { group: name.clone(), known: names.join(", ") }
            })?;
            let others = groups.iter().filter(|group| group.name != *name);
            return Ok(others.map(|other| (chosen, other)).collect());
        }
        if groups.len() > MOST_GROUPS {
            let (groups, most) = (groups.len(), MOST_GROUPS);
            return Err(HypothesisError::TooManyGroups { groups, most });
        }
        let after = |place: usize| groups[place + 1..].iter();
        Ok((0..groups.len()).flat_map(|i| after(i).map(move |b| (&groups[i], b))).collect())
    }

    fn of_differences(
        &self,
        family: &str,
        a: &str,
        b: &str,
        differences: &[f64],
    ) -> Result<Comparison, HypothesisError> {
        let summary = Summary::of(differences, Divisor::CountMinusOne);
        let mut row = Comparison {
            family: family.to_owned(),
            a: a.to_owned(),
            b: b.to_owned(),
            n: (differences.len(), None),
            n_nonzero: None,
            statistic: None,
            p: None,
            p_corrected: None,
            rank_biserial: None,
            difference: summary.mean.unwrap_or(f64::NAN),
            interval: bootstrap_mean(differences, &self.bootstrap),
            method: String::new(),
        };
        let few = |least| HypothesisError::TooFew {
            a: a.to_owned(),
            b: b.to_owned(),
            least,
            found: differences.len(),
        };
        match self.test {
            Test::Wilcoxon { zeros, alternative, distribution } => {
                let (found, most) = (differences.len(), MOST_EXACT_PAIRS);
                if distribution == NullDistribution::Exact && found > most {
                    return Err(HypothesisError::TooManyPairs { found, most });
                }
                let test = wilcoxon_with(differences, zeros, alternative, distribution);
                let test = test.filter(|_| !differences.is_empty()).ok_or_else(|| few(1))?;
                row.n_nonzero = Some(test.nonzero);
                row.statistic = Some(test.statistic);
                row.p = Some(test.p);
                row.rank_biserial = Some(test.rank_biserial);
                row.method = test.method.to_string();
            }
            Test::T { alternative } => {
                let test = one_sample_t(differences, alternative).ok_or_else(|| few(2))?;
                row.statistic = test.t;
                row.p = Some(test.p);
                row.method = format!("t, df {}", test.degrees_of_freedom);
            }
            Test::MannWhitney { .. } | Test::Bootstrap => {}
        }
        Ok(row)
    }

    fn of_samples(
        &self,
        family: &str,
        a: &Group,
        b: &Group,
    ) -> Result<Comparison, HypothesisError> {
        let values = |group: &Group| group.units.iter().map(|unit| unit.mean).collect::<Vec<f64>>();
        let (first, second) = (values(a), values(b));
        let mean = |values: &[f64]| values.iter().sum::<f64>() / values.len() as f64;
        let mut row = Comparison {
            family: family.to_owned(),
            a: a.name.clone(),
            b: b.name.clone(),
            n: (first.len(), Some(second.len())),
            n_nonzero: None,
            statistic: None,
            p: None,
            p_corrected: None,
            rank_biserial: None,
            difference: mean(&first) - mean(&second),
            interval: bootstrap_difference(&first, &second, &self.bootstrap),
            method: String::new(),
        };
        if let Test::MannWhitney { alternative, distribution } = self.test {
            let found = first.len() + second.len();
            let is_exact = match distribution {
                NullDistribution::Automatic => found <= LARGEST_SAMPLE,
                NullDistribution::Exact if found > LARGEST_SAMPLE => {
                    return Err(HypothesisError::TooManyPairs { found, most: LARGEST_SAMPLE });
                }
                other => other == NullDistribution::Exact,
            };
            let test = if is_exact {
                mann_whitney(&first, &second, alternative)
            } else {
                mann_whitney_normal(&first, &second, alternative)
            };
            let method = if is_exact { "exact" } else { "normal" };
            method.clone_into(&mut row.method);
            row.statistic = test.map(|test| test.u);
            row.p = test.map(|test| test.p);
            row.rank_biserial = test.map(|test| test.rank_biserial);
        }
        Ok(row)
    }

    /// Corrects the p values of one family.
    fn correct(&self, comparisons: &mut [(Comparison, usize)]) -> Result<(), HypothesisError> {
        let p: Vec<f64> = comparisons.iter().map(|(row, _)| row.p.unwrap_or(f64::NAN)).collect();
        let tests = p.iter().filter(|p| !p.is_nan()).count();
        let correction = match self.correction {
            Some(correction) => correction,
            None if tests > 1 => return Err(HypothesisError::NoCorrection { tests }),
            None => Correction::None,
        };
        for ((row, _), corrected) in comparisons.iter_mut().zip(correction.apply(&p)) {
            row.p_corrected = Some(corrected).filter(|p| !p.is_nan());
        }
        Ok(())
    }
}

fn group_row(family: &str, group: &Group, bootstrap: &BootstrapOptions) -> GroupRow {
    let means: Vec<f64> = group.units.iter().map(|unit| unit.mean).collect();
    GroupRow {
        family: family.to_owned(),
        group: group.name.clone(),
        summary: Summary::of(&means, Divisor::CountMinusOne),
        rows: group.units.iter().map(|unit| unit.rows).sum(),
        interval: bootstrap_mean(&means, bootstrap),
    }
}

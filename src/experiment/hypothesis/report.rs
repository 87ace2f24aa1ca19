//! The result of tests as tables and as a document. Everything that decides a conclusion is written into both.

use serde_json::{Value, json};

use crate::analysis::stats::{Correction, NullDistribution, Sidedness, Zeros};
use crate::record::{Column, RecordError, Table};

use super::{Comparison, Design, Plan, Report, Test};

impl Test {
    /// Its name, as asked for.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Wilcoxon { .. } => "wilcoxon",
            Self::MannWhitney { .. } => "mann-whitney",
            Self::T { .. } => "t",
            Self::Bootstrap => "bootstrap",
        }
    }

    /// The letter of its statistic.
    #[must_use]
    pub fn statistic(self) -> &'static str {
        match self {
            Self::Wilcoxon { .. } => "W",
            Self::MannWhitney { .. } => "U",
            Self::T { .. } => "t",
            Self::Bootstrap => "",
        }
    }

    fn alternative(self) -> Option<Sidedness> {
        match self {
            Self::Wilcoxon { alternative, .. }
            | Self::MannWhitney { alternative, .. }
            | Self::T { alternative } => Some(alternative),
            Self::Bootstrap => None,
        }
    }

    fn zeros(self) -> Option<&'static str> {
        match self {
            Self::Wilcoxon { zeros: Zeros::Drop, .. } => Some("drop"),
            Self::Wilcoxon { zeros: Zeros::Keep, .. } => Some("keep"),
            _ => None,
        }
    }

    fn distribution(self) -> Option<&'static str> {
        match self {
            Self::Wilcoxon { distribution, .. } | Self::MannWhitney { distribution, .. } => {
                Some(match distribution {
                    NullDistribution::Automatic => "auto",
                    NullDistribution::Exact => "exact",
                    NullDistribution::Normal => "normal",
                })
            }
            _ => None,
        }
    }
}

/// The word for a correction.
#[must_use]
pub fn correction_name(correction: Correction) -> &'static str {
    match correction {
        Correction::None => "none",
        Correction::Holm => "holm",
        Correction::Bonferroni => "bonferroni",
    }
}

impl Plan {
    /// What decides the result, as a document.
    #[must_use]
    pub fn document(&self) -> Value {
        let (pair, reference) = match &self.design {
            Design::Paired(column) => (Some(column), None),
            Design::Reference(number) => (None, Some(*number)),
            Design::Independent => (None, None),
        };
        let unit = if self.unit.is_empty() { json!("row") } else { json!(self.unit) };
        json!({
            "test": self.test.name(),
            "alternative": self.test.alternative().map(|side| side.to_string()),
            "zeros": self.test.zeros(),
            "distribution": self.test.distribution(),
            "value": self.value,
            "unit": unit,
            "group": self.group,
            "pair": pair,
            "reference": reference,
            "by": self.by,
            "compare": self.compare,
            "correction": self.correction.map(correction_name),
            "skip_undefined": self.skip_undefined,
            "bootstrap": {
                "resamples": self.bootstrap.resamples,
                "confidence": self.bootstrap.confidence,
                "seed": self.bootstrap.seed,
            },
        })
    }

    /// The unit of replication in words.
    #[must_use]
    pub fn unit_label(&self) -> String {
        if self.unit.is_empty() { "row".to_owned() } else { self.unit.join(" / ") }
    }
}

impl Report {
    /// One row per group and family.
    pub fn group_table(&self) -> Result<Table, RecordError> {
        let rows = || self.groups.iter();
        let or_nan = |x: Option<f64>| x.unwrap_or(f64::NAN);
        let unit = || vec![self.plan.unit_label(); self.groups.len()];
        Table::new(vec![
            Column::unitless("family", rows().map(|row| row.family.clone()).collect::<Vec<_>>()),
            Column::unitless("group", rows().map(|row| row.group.clone()).collect::<Vec<_>>()),
            Column::unitless("unit", unit()),
            Column::unitless(
                "n_units",
                rows().map(|row| row.summary.count as i64).collect::<Vec<_>>(),
            ),
            Column::unitless("n_rows", rows().map(|row| row.rows as i64).collect::<Vec<_>>()),
            Column::unitless("mean", rows().map(|r| or_nan(r.summary.mean)).collect::<Vec<_>>()),
            Column::unitless(
                "sem",
                rows().map(|row| or_nan(row.summary.standard_error)).collect::<Vec<_>>(),
            ),
            Column::unitless(
                "ci_low",
                rows().map(|row| or_nan(row.interval.map(|i| i.low))).collect::<Vec<_>>(),
            ),
            Column::unitless(
                "ci_high",
                rows().map(|row| or_nan(row.interval.map(|i| i.high))).collect::<Vec<_>>(),
            ),
        ])
    }

    /// One row per comparison.
    pub fn comparison_table(&self) -> Result<Table, RecordError> {
        let plan = &self.plan;
        let text = |name: &str, value: &dyn Fn(&Comparison) -> String| {
            Column::unitless(name, self.comparisons.iter().map(value).collect::<Vec<_>>())
        };
        let number = |name: &str, value: &dyn Fn(&Comparison) -> Option<f64>| {
            let values = self.comparisons.iter().map(|row| value(row).unwrap_or(f64::NAN));
            Column::unitless(name, values.collect::<Vec<_>>())
        };
        let word = |word: Option<&str>| word.unwrap_or_default().to_owned();
        let alternative = plan.test.alternative().map(|side| side.to_string());
        let correction = plan.correction.map_or("none", correction_name);
        Table::new(vec![
            text("family", &|row| row.family.clone()),
            text("a", &|row| row.a.clone()),
            text("b", &|row| row.b.clone()),
            text("test", &|_| plan.test.name().to_owned()),
            text("unit", &|_| plan.unit_label()),
            text("alternative", &|_| word(alternative.as_deref())),
            text("zeros", &|_| word(plan.test.zeros())),
            text("correction", &|_| correction.to_owned()),
            text("method", &|row| row.method.clone()),
            Column::unitless(
                "n_a",
                self.comparisons.iter().map(|row| row.n.0 as i64).collect::<Vec<_>>(),
            ),
            Column::unitless(
                "n_b",
                self.comparisons
                    .iter()
                    .map(|row| row.n.1.unwrap_or(row.n.0) as i64)
                    .collect::<Vec<_>>(),
            ),
            number("n_nonzero", &|row| row.n_nonzero.map(|n| n as f64)),
            number("statistic", &|row| row.statistic),
            number("p", &|row| row.p),
            number("p_corrected", &|row| row.p_corrected),
            number("rank_biserial", &|row| row.rank_biserial),
            number("mean_difference", &|row| Some(row.difference)),
            number("ci_low", &|row| row.interval.map(|i| i.low)),
            number("ci_high", &|row| row.interval.map(|i| i.high)),
        ])
    }

    /// All of it.
    #[must_use]
    pub fn document(&self) -> Value {
        let interval = |i: Option<crate::analysis::stats::Interval>| i.map(|i| [i.low, i.high]);
        let groups: Vec<Value> = self
            .groups
            .iter()
            .map(|row| {
                json!({
                    "family": row.family,
                    "group": row.group,
                    "n_units": row.summary.count,
                    "n_rows": row.rows,
                    "mean": row.summary.mean,
                    "sem": row.summary.standard_error,
                    "interval": interval(row.interval),
                })
            })
            .collect();
        let comparisons: Vec<Value> = self
            .comparisons
            .iter()
            .map(|row| {
                json!({
                    "family": row.family,
                    "a": row.a,
                    "b": row.b,
                    "n_a": row.n.0,
                    "n_b": row.n.1.unwrap_or(row.n.0),
                    "n_nonzero": row.n_nonzero,
                    "statistic": row.statistic,
                    "p": row.p,
                    "p_corrected": row.p_corrected,
                    "rank_biserial": row.rank_biserial,
                    "mean_difference": row.difference,
                    "interval": interval(row.interval),
                    "method": row.method,
                })
            })
            .collect();
        json!({
            "plan": self.plan.document(),
            "groups": groups,
            "comparisons": comparisons,
            "left_out_rows": self.left_out_rows,
            "left_out_pairs": self.left_out_pairs,
        })
    }
}

//! From the rows of a table to groups of units.
//!
//! Families, groups and units stand in the order in which they first appear.

use std::collections::{BTreeMap, BTreeSet};

use crate::record::{Table, Values};

use super::{Design, HypothesisError, Plan};

/// The units of one group.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Group {
    pub(super) name: String,
    pub(super) units: Vec<Unit>,
}

/// One unit of replication.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Unit {
    pub(super) name: String,
    /// What it is paired by; empty in other designs.
    pub(super) pair: String,
    /// Of its rows.
    pub(super) mean: f64,
    pub(super) rows: usize,
}

/// The name of a family and its groups.
pub(super) type Family = (String, Vec<Group>);

/// The families with their groups, and the number of rows left out.
pub(super) fn families(
    table: &Table,
    plan: &Plan,
) -> Result<(Vec<Family>, usize), HypothesisError> {
    let values = numbers(table, &plan.value)?;
    if values.is_empty() {
        return Err(HypothesisError::NoRows);
    }
    let undefined = values.iter().filter(|x| !x.is_finite()).count();
    if let Some(row) = values.iter().position(|x| !x.is_finite()).filter(|_| !plan.skip_undefined) {
        let (column, rows) = (plan.value.clone(), values.len());
        return Err(HypothesisError::Undefined { column, count: undefined, rows, row: row + 1 });
    }
    let family = plan.by.as_deref().map(|column| Labels::of(table, column)).transpose()?;
    let group = plan.group.as_deref().map(|column| Labels::of(table, column)).transpose()?;
    let pair = match &plan.design {
        Design::Paired(column) => Some(Labels::of(table, column)?),
        _ => None,
    };
    let unit: Vec<Labels<'_>> =
        plan.unit.iter().map(|column| Labels::of(table, column)).collect::<Result<_, _>>()?;
    let mut families: Vec<Family> = Vec::new();
    let mut places = Places::default();
    for (row, &value) in values.iter().enumerate() {
        let label = |labels: &Option<Labels<'_>>| match labels {
            Some(labels) => labels.at(row),
            None => Ok(String::new()),
        };
        let (family, group, pair) = (label(&family)?, label(&group)?, label(&pair)?);
        let group = if plan.group.is_none() { plan.value.clone() } else { group };
        let unit = if unit.is_empty() {
            (row + 1).to_string()
        } else {
            let parts: Result<Vec<String>, _> = unit.iter().map(|labels| labels.at(row)).collect();
            parts?.join(" / ")
        };
        // Left out only now: a label that is missing is an error in any row.
        if !value.is_finite() {
            continue;
        }
        let (family_at, group_at, unit_at) = places.of(&family, &group, &unit);
        if family_at == families.len() {
            families.push((family, Vec::new()));
        }
        let groups = &mut families[family_at].1;
        if group_at == groups.len() {
            groups.push(Group { name: group, units: Vec::new() });
        }
        let group = &mut groups[group_at];
        if unit_at == group.units.len() {
            group.units.push(Unit { name: unit, pair, mean: value, rows: 1 });
            continue;
        }
        let known = &mut group.units[unit_at];
        if known.pair != pair {
            let column = match &plan.design {
                Design::Paired(column) => column.clone(),
                _ => String::new(),
            };
            let group = group.name.clone();
            return Err(HypothesisError::SeveralPairs { unit, group, column });
        }
        // The sum for now.
        known.mean += value;
        known.rows += 1;
    }
    let units = families.iter_mut().flat_map(|(_, groups)| groups).flat_map(|g| &mut g.units);
    units.for_each(|unit| unit.mean /= unit.rows as f64);
    if families.is_empty() {
        return Err(HypothesisError::NoRows);
    }
    Ok((families, undefined))
}

/// Differences a − b of the units with the same pair label, in the order of a, and the number of labels without partner.
pub(super) fn paired(
    a: &Group,
    b: &Group,
    column: &str,
    skip: bool,
) -> Result<(Vec<f64>, usize), HypothesisError> {
    let (first, second) = (by_pair(a, column)?, by_pair(b, column)?);
    let in_a: BTreeSet<&str> = first.keys().copied().collect();
    let in_b: BTreeSet<&str> = second.keys().copied().collect();
    let alone = in_a.symmetric_difference(&in_b).count();
    if let Some(pair) = in_a.symmetric_difference(&in_b).next().filter(|_| !skip) {
        let (there, missing) = if in_a.contains(pair) { (a, b) } else { (b, a) };
        return Err(HypothesisError::NoPartner {
            pair: (*pair).to_owned(),
            column: column.to_owned(),
            there: there.name.clone(),
            missing: missing.name.clone(),
        });
    }
    let both = a.units.iter().filter_map(|unit| Some((unit, second.get(unit.pair.as_str())?)));
    Ok((both.map(|(unit, other)| unit.mean - other).collect(), alone))
}

fn by_pair<'a>(group: &'a Group, column: &str) -> Result<BTreeMap<&'a str, f64>, HypothesisError> {
    let mut pairs = BTreeMap::new();
    for unit in &group.units {
        if pairs.insert(unit.pair.as_str(), unit.mean).is_some() {
            let same = group.units.iter().filter(|other| other.pair == unit.pair);
            let names: Vec<String> =
                same.clone().take(3).map(|unit| format!("`{}`", unit.name)).collect();
            return Err(HypothesisError::SeveralUnits {
                pair: unit.pair.clone(),
                column: column.to_owned(),
                group: group.name.clone(),
                count: same.count(),
                units: names.join(", "),
            });
        }
    }
    Ok(pairs)
}

/// Finds families, groups and units by name; a new one gets the next place.
#[derive(Default)]
struct Places {
    families: BTreeMap<String, usize>,
    groups: BTreeMap<(usize, String), usize>,
    units: BTreeMap<(usize, usize, String), usize>,
    /// Groups of each family, and units of each group.
    counts: BTreeMap<(usize, Option<usize>), usize>,
}

impl Places {
    fn of(&mut self, family: &str, group: &str, unit: &str) -> (usize, usize, usize) {
        let next = self.families.len();
        let family = *self.families.entry(family.to_owned()).or_insert(next);
        let counts = &mut self.counts;
        let mut count = |key| {
            let count = counts.entry(key).or_insert(0);
            *count += 1;
            *count - 1
        };
        let group =
            *self.groups.entry((family, group.to_owned())).or_insert_with(|| count((family, None)));
        let unit = *self
            .units
            .entry((family, group, unit.to_owned()))
            .or_insert_with(|| count((family, Some(group))));
        (family, group, unit)
    }
}

/// A column read as names.
struct Labels<'a> {
    column: &'a str,
    values: &'a Values,
}

impl<'a> Labels<'a> {
    fn of(table: &'a Table, column: &'a str) -> Result<Self, HypothesisError> {
        let found = table.column(column).ok_or(HypothesisError::NoRows)?;
        Ok(Self { column, values: &found.values })
    }

    fn at(&self, row: usize) -> Result<String, HypothesisError> {
        match self.values {
            Values::Texts(texts) if !texts[row].is_empty() => Ok(texts[row].clone()),
            Values::Integers(values) => Ok(values[row].to_string()),
            Values::Flags(values) => Ok(values[row].to_string()),
            Values::Floats(values) if values[row].is_finite() => Ok(values[row].to_string()),
            _ => Err(HypothesisError::NoLabel { column: self.column.to_owned(), row: row + 1 }),
        }
    }
}

/// A column read as numbers; flags count as 0 and 1.
fn numbers(table: &Table, column: &str) -> Result<Vec<f64>, HypothesisError> {
    match table.column(column).map(|column| &column.values) {
        Some(Values::Floats(values)) => Ok(values.clone()),
        Some(Values::Integers(values)) => Ok(values.iter().map(|&x| x as f64).collect()),
        Some(Values::Flags(values)) => Ok(values.iter().map(|&x| f64::from(u8::from(x))).collect()),
        Some(Values::Texts(texts)) if !texts.is_empty() => {
            Err(HypothesisError::NotNumbers { column: column.to_owned(), found: "texts" })
        }
        _ => Err(HypothesisError::NoRows),
    }
}

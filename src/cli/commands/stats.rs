//! `stats`: the paper's tests on any tidy table.

use std::path::PathBuf;

use clap::{Args, ValueEnum};
use serde_json::{Value, json};

use crate::analysis::stats::{BootstrapOptions, Correction, NullDistribution, Sidedness, Zeros};
use crate::cli::context::{Context, Outcome};
use crate::cli::finish::{self, Output};
use crate::cli::render::{self, Align, Hinted};
use crate::experiment::hypothesis::{Design, HypothesisError, Plan, Report, Test};
use crate::files;
use crate::record::{self, RecordError};

/// Arguments of `stats`.
#[derive(Debug, Args)]
#[command(after_help = "Example: do two methods differ over tasks, seeds averaged first?\n  \
    arnold-analyze stats seeds.csv --test wilcoxon --value relative_pct \\\n    \
    --group method --unit task --pair task \\\n    --alternative two-sided --zeros drop --correction holm")]
pub struct StatsArguments {
    /// Tidy table: Parquet or CSV, also gzipped; one row per observation
    #[arg(value_name = "FILE")]
    file: PathBuf,
    /// Which test; `bootstrap` gives intervals alone
    #[arg(long, value_enum)]
    test: Kind,
    /// Column of the numbers
    #[arg(long, value_name = "COLUMN")]
    value: String,
    /// Columns that name the unit of replication: its rows are averaged first. `row`: every row is independent
    #[arg(long, value_name = "COLUMN", num_args = 1.., required = true)]
    unit: Vec<String>,
    /// Column of the groups that are compared
    #[arg(long, value_name = "COLUMN")]
    group: Option<String>,
    /// Pair units of two groups that are equal in this column
    #[arg(long, value_name = "COLUMN", requires = "group", conflicts_with = "reference")]
    pair: Option<String>,
    /// Compare every group with this number
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true, value_parser = finite)]
    reference: Option<f64>,
    /// Compare this group with each other one; without it, every pair of groups
    #[arg(long, value_name = "GROUP", requires = "group", conflicts_with = "reference")]
    compare: Option<String>,
    /// What counts as an effect; a comparison is `a` − `b`
    #[arg(long, value_enum)]
    alternative: Option<Alternative>,
    /// Differences of exactly zero: dropped before ranking (Wilcoxon), or ranked and left out of the sums (Pratt)
    #[arg(long, value_enum)]
    zeros: Option<ZeroHandling>,
    /// Where p is read off; `auto` counts small samples exactly
    #[arg(long, value_enum, default_value_t = Distribution::Auto)]
    distribution: Distribution,
    /// Correction of p over the tests of a family; needed when there are several
    #[arg(long, value_enum)]
    correction: Option<CorrectionKind>,
    /// Column that splits the table: each value is tested, and corrected, as a family of its own
    #[arg(long, value_name = "COLUMN")]
    by: Option<String>,
    /// Leave out rows without a value and pairs without a partner, and say how many
    #[arg(long)]
    skip_undefined: bool,
    /// Confidence of the bootstrap intervals
    #[arg(long, value_name = "SHARE", default_value_t = BootstrapOptions::default().confidence, value_parser = share)]
    confidence: f64,
    /// Resamples of the bootstrap
    #[arg(long, value_name = "N", default_value_t = BootstrapOptions::default().resamples as u32, value_parser = clap::value_parser!(u32).range(100..=1_000_000))]
    resamples: u32,
    /// Seed of the bootstrap
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Also write the result as Parquet and CSV into a folder of its own below this one
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Kind {
    /// Signed rank of paired differences
    Wilcoxon,
    /// Rank sum of independent samples
    MannWhitney,
    /// One sample, or paired differences
    T,
    /// Intervals of means and differences
    Bootstrap,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Alternative {
    TwoSided,
    Greater,
    Less,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum ZeroHandling {
    Drop,
    Keep,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Distribution {
    Auto,
    Exact,
    Normal,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum CorrectionKind {
    None,
    Holm,
    Bonferroni,
}

fn finite(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| x.is_finite());
    number.ok_or_else(|| "expected a number".to_owned())
}

fn share(text: &str) -> Result<f64, String> {
    let number = text.parse::<f64>().ok().filter(|x| *x > 0.0 && *x < 1.0);
    number.ok_or_else(|| "expected a share between 0 and 1, as 0.95".to_owned())
}

/// Runs the command.
pub fn run(context: &Context, arguments: &StatsArguments) -> anyhow::Result<Outcome> {
    let plan = plan(arguments)?;
    let table = record::read_columns(&arguments.file, &plan.columns())
        .map_err(|error| read_error(&error))?;
    let sha256 = files::sha256_of_file(&arguments.file)?;
    let rows = table.row_count();
    let document = plan.document();
    let report = plan.run(&table).map_err(|error| with_hint(&error, arguments))?;
    let name = arguments.file.file_name().unwrap_or_default().to_string_lossy();
    let mut result = report.document();
    result["input"] = json!({"file": name, "sha256": sha256, "rows": rows});
    let Some(out) = &arguments.out else {
        if context.json {
            let mut shown = json!({"command": "stats"});
            if let (Some(into), Value::Object(result)) = (shown.as_object_mut(), result) {
                into.extend(result);
            }
            render::print_json(&shown)?;
        } else {
            render::print_text(&text(&result))?;
        }
        return Ok(outcome(&report));
    };
    let decides = json!({"plan": document, "input_sha256": sha256});
    let (folder, finished) = finish::open_below(context, out, "stats", &decides)?;
    let manifest = if let Some(manifest) = finished {
        manifest
    } else {
        let mut output = Output::new(&folder);
        output.tidy("groups", &report.group_table()?)?;
        if !report.comparisons.is_empty() {
            output.tidy("comparisons", &report.comparison_table()?)?;
        }
        output.finish_with(json!([]), result, json!({}))?
    };
    finish::print(context, &folder, &manifest, &text)?;
    Ok(outcome(&report))
}

fn outcome(report: &Report) -> Outcome {
    if report.left_out_rows + report.left_out_pairs > 0 {
        Outcome::SomethingSkipped
    } else {
        Outcome::Done
    }
}

/// What was typed, as what it means. Whatever decides a conclusion must have been typed.
fn plan(arguments: &StatsArguments) -> anyhow::Result<Plan> {
    let missing = |option: &str, why: &str| {
        Hinted::new(format!("`--test` needs `{option}`: {why}"), format!("add `{option}`"))
    };
    let alternative = || match arguments.alternative {
        Some(Alternative::TwoSided) => Ok(Sidedness::TwoSided),
        Some(Alternative::Greater) => Ok(Sidedness::Greater),
        Some(Alternative::Less) => Ok(Sidedness::Less),
        None => Err(missing(
            "--alternative two-sided|greater|less",
            "which way an effect may go changes the conclusion, so it is not chosen for you",
        )),
    };
    let distribution = match arguments.distribution {
        Distribution::Auto => NullDistribution::Automatic,
        Distribution::Exact => NullDistribution::Exact,
        Distribution::Normal => NullDistribution::Normal,
    };
    let test = match arguments.test {
        Kind::Wilcoxon => Test::Wilcoxon {
            zeros: match arguments.zeros {
                Some(ZeroHandling::Drop) => Zeros::Drop,
                Some(ZeroHandling::Keep) => Zeros::Keep,
                None => {
                    let why = "what becomes of differences of exactly zero changes p";
                    return Err(missing("--zeros drop|keep", why));
                }
            },
            alternative: alternative()?,
            distribution,
        },
        Kind::MannWhitney => Test::MannWhitney { alternative: alternative()?, distribution },
        Kind::T => Test::T { alternative: alternative()? },
        Kind::Bootstrap => Test::Bootstrap,
    };
    let design = match (&arguments.pair, arguments.reference) {
        (Some(column), _) => Design::Paired(column.clone()),
        (None, Some(number)) => Design::Reference(number),
        (None, None) => Design::Independent,
    };
    match (arguments.test, &design) {
        (Kind::Wilcoxon | Kind::T, Design::Independent) => {
            let why = "it tests differences";
            return Err(missing("--pair COLUMN` or `--reference NUMBER", why));
        }
        (Kind::MannWhitney, Design::Paired(_) | Design::Reference(_)) => {
            return Err(Hinted::new(
                "`--test mann-whitney` compares independent samples: it has no pairs and no reference",
                "leave out `--pair` and `--reference`, or take `--test wilcoxon`",
            ));
        }
        (Kind::MannWhitney, Design::Independent) if arguments.group.is_none() => {
            return Err(missing("--group COLUMN", "it compares groups"));
        }
        _ => {}
    }
    let every_row = arguments.unit == ["row"];
    Ok(Plan {
        test,
        value: arguments.value.clone(),
        unit: if every_row { Vec::new() } else { arguments.unit.clone() },
        group: arguments.group.clone(),
        by: arguments.by.clone(),
        design,
        compare: arguments.compare.clone(),
        correction: arguments.correction.map(|kind| match kind {
            CorrectionKind::None => Correction::None,
            CorrectionKind::Holm => Correction::Holm,
            CorrectionKind::Bonferroni => Correction::Bonferroni,
        }),
        bootstrap: BootstrapOptions {
            resamples: arguments.resamples as usize,
            confidence: arguments.confidence,
            seed: arguments.seed,
        },
        skip_undefined: arguments.skip_undefined,
    })
}

fn read_error(error: &RecordError) -> anyhow::Error {
    let hint = match error {
        RecordError::NoColumn { .. } => "columns are given by their exact name",
        RecordError::File(_) => "check the path",
        _ => {
            "a tidy table is Parquet or CSV (also gzipped), with a row of column names and one row per observation"
        }
    };
    Hinted::new(error.to_string(), hint)
}

/// What to do about it.
fn with_hint(error: &HypothesisError, arguments: &StatsArguments) -> anyhow::Error {
    use HypothesisError as E;
    let hint = match error {
        E::NoRows => "a table needs a row of column names and at least one row with a value",
        E::NotNumbers { .. } => "`--value` names a column of numbers",
        E::NoLabel { .. } => {
            "give every row a name in this column, or leave such rows out of the table"
        }
        E::Undefined { .. } | E::NoPartner { .. } => {
            "`--skip-undefined` leaves them out and says how many; without it nothing is lost silently"
        }
        E::OneGroup { .. } if arguments.test == Kind::MannWhitney => {
            "`--group` names a column with two groups or more"
        }
        E::OneGroup { .. } => "`--reference NUMBER` compares one group with a number",
        E::UnknownGroup { .. } => "`--compare` takes one of these",
        E::NoCorrection { .. } => "choose `--correction holm`, `bonferroni` or `none`",
        E::SeveralUnits { .. } => {
            "a pair is one unit of each group: average over more with `--unit`, e.g. with the column given to `--pair`"
        }
        E::SeveralPairs { .. } => "name the unit by more columns: `--unit A B`",
        E::TooManyPairs { .. } => "`--distribution normal` approximates",
        E::TooManyGroups { .. } => "`--compare GROUP` compares one group with the others",
        E::TooFew { .. } => "is the unit of replication the one you mean? `--unit` says it",
    };
    Hinted::new(error.to_string(), hint)
}

fn text(result: &Value) -> String {
    let plan = &result["plan"];
    let rows = |value: &Value| value.as_array().cloned().unwrap_or_default();
    let word = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let (groups, comparisons) = (rows(&result["groups"]), rows(&result["comparisons"]));
    let has_families = plan["by"].is_string();
    let confidence = plan["bootstrap"]["confidence"].as_f64().unwrap_or(f64::NAN);
    let interval_title = format!("{} % interval", trimmed(100.0 * confidence));
    let digits = digits_for(&groups);
    let interval = |row: &Value| {
        let end = |i: usize| render::number(&row["interval"][i], digits);
        if row["interval"].is_null() {
            "–".to_owned()
        } else {
            format!("{} … {}", end(0), end(1))
        }
    };
    let family = |row: &Value| has_families.then(|| word(&row["family"]));
    let family_column =
        || has_families.then_some((plan["by"].as_str().unwrap_or_default(), Align::Left));

    let mut columns: Vec<(&str, Align)> = family_column().into_iter().collect();
    columns.extend([
        (plan["group"].as_str().unwrap_or("column"), Align::Left),
        ("units", Align::Right),
        ("rows", Align::Right),
        ("mean", Align::Right),
        ("± s.e.m.", Align::Right),
        (interval_title.as_str(), Align::Right),
    ]);
    let lines: Vec<Vec<String>> = groups
        .iter()
        .map(|row| {
            let cells = [
                word(&row["group"]),
                row["n_units"].to_string(),
                row["n_rows"].to_string(),
                render::number(&row["mean"], digits),
                render::number(&row["sem"], digits),
                interval(row),
            ];
            family(row).into_iter().chain(cells).collect()
        })
        .collect();
    let mut text = render::table(&columns, &lines);
    if !comparisons.is_empty() {
        text += "\n";
        let share = interval_title.trim_end_matches(" interval");
        text += &comparison_text(plan, &comparisons, share, &interval, &family, &family_column);
    }
    text + "\n" + &statement(result)
}

fn comparison_text<'a>(
    plan: &'a Value,
    comparisons: &[Value],
    interval_title: &str,
    interval: &dyn Fn(&Value) -> String,
    family: &dyn Fn(&Value) -> Option<String>,
    family_column: &dyn Fn() -> Option<(&'a str, Align)>,
) -> String {
    let word = |value: &Value| value.as_str().unwrap_or_default().to_owned();
    let statistic = match plan["test"].as_str() {
        Some("wilcoxon") => "W",
        Some("mann-whitney") => "U",
        _ => "t",
    };
    let is_tested = plan["test"] != "bootstrap";
    let has_correction = plan["correction"].is_string() && plan["correction"] != "none";
    let has_ranks = statistic != "t";
    let is_reference = plan["reference"].is_number();
    let corrected = format!("p {}", word(&plan["correction"]));
    let mut columns: Vec<(&str, Align)> = family_column().into_iter().collect();
    columns.extend([("a", Align::Left), ("b", Align::Left), ("n", Align::Right)]);
    if is_tested {
        columns.extend([(statistic, Align::Right), ("p", Align::Right)]);
        columns.extend(has_correction.then_some((corrected.as_str(), Align::Right)));
        columns.extend(has_ranks.then_some(("r", Align::Right)));
    }
    let difference = format!("a − b, {interval_title}");
    columns.push((difference.as_str(), Align::Right));
    let lines: Vec<Vec<String>> = comparisons
        .iter()
        .map(|row| {
            let (n_a, n_b) = (row["n_a"].to_string(), row["n_b"].to_string());
            let n = if n_a == n_b || is_reference { n_a } else { format!("{n_a}, {n_b}") };
            let mut cells: Vec<String> = family(row).into_iter().collect();
            cells.extend([word(&row["a"]), word(&row["b"]), n]);
            if is_tested {
                let value = row["statistic"].as_f64();
                let digits = if has_ranks { 1 } else { 3 };
                let value = value.map_or_else(|| "–".to_owned(), |x| whole_or(x, digits));
                cells.extend([value, render::probability(&row["p"])]);
                cells.extend(has_correction.then(|| render::probability(&row["p_corrected"])));
                cells.extend(has_ranks.then(|| render::number(&row["rank_biserial"], 3)));
            }
            cells.push(interval(row));
            cells
        })
        .collect();
    render::table(&columns, &lines)
}

/// What was tested, and by which choices: a reader of the table needs nothing else.
fn statement(result: &Value) -> String {
    let plan = &result["plan"];
    let word = |name: &str| plan[name].as_str().unwrap_or_default();
    let comparisons = result["comparisons"].as_array();
    let mut methods: Vec<&str> = comparisons
        .into_iter()
        .flatten()
        .filter_map(|row| row["method"].as_str())
        .filter(|method| !method.is_empty() && !method.starts_with('t'))
        .collect();
    methods.dedup();
    methods.sort_unstable();
    methods.dedup();
    let methods =
        if methods.is_empty() { String::new() } else { format!(", {}", methods.join(" and ")) };
    let test = match word("test") {
        "wilcoxon" if word("zeros") == "drop" => "Wilcoxon signed rank, zeros dropped",
        "wilcoxon" => "Wilcoxon signed rank, zeros ranked (Pratt)",
        "mann-whitney" => "Mann–Whitney rank sum",
        "t" => "t test of one sample or of differences",
        _ => "No test; intervals only",
    };
    let side = if plan["alternative"].is_null() {
        String::new()
    } else {
        format!(", {}", word("alternative"))
    };
    let unit = match &plan["unit"] {
        Value::Array(columns) => {
            let names: Vec<&str> = columns.iter().filter_map(Value::as_str).collect();
            format!("{}; its rows are averaged first", names.join(" / "))
        }
        _ => "row; every row counts as independent".to_owned(),
    };
    let mut lines = vec![format!("Test                 {test}{side}{methods}")];
    lines.push(format!("Unit of replication  {unit}"));
    if let Some(pair) = plan["pair"].as_str() {
        lines.push(format!("Pairs                equal in {pair}"));
    }
    if let Some(correction) = plan["correction"].as_str() {
        let over = plan["by"]
            .as_str()
            .map_or_else(|| "all tests".to_owned(), |by| format!("the tests of one {by}"));
        lines.push(format!("Correction           {correction}, over {over}"));
    }
    let bootstrap = &plan["bootstrap"];
    lines.push(format!(
        "Intervals            bootstrap over units, {} resamples, seed {}",
        render::grouped(bootstrap["resamples"].as_u64().unwrap_or(0)),
        bootstrap["seed"]
    ));
    for (key, what) in
        [("left_out_rows", "rows without a value"), ("left_out_pairs", "pairs without a partner")]
    {
        if let Some(count) = result[key].as_u64().filter(|&count| count > 0) {
            lines.push(format!("Left out             {count} {what}"));
        }
    }
    lines.join("\n") + "\n"
}

/// So many decimals that the largest mean has four digits, at least two and at most six decimals.
fn digits_for(groups: &[Value]) -> usize {
    let largest =
        groups.iter().filter_map(|row| row["mean"].as_f64()).fold(0.0, |a: f64, b| a.max(b.abs()));
    if largest <= 0.0 {
        return 3;
    }
    (3 - largest.log10().floor() as i64).clamp(2, 6) as usize
}

fn whole_or(value: f64, digits: usize) -> String {
    if value.fract() == 0.0 { format!("{value:.0}") } else { format!("{value:.digits$}") }
}

fn trimmed(value: f64) -> String {
    let text = format!("{value:.2}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}

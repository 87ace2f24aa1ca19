//! `doctor`: what is installed, what is missing and the command that mends it.
//!
//! Exit code 0 when nothing is broken, even if something is not installed yet; 1 when something installed is damaged or
//! `$ARNOLD_POLICY` names nothing.

use clap::Args;
use serde_json::json;

use super::{data_sets, setup::state_of};
use crate::assets::data::{DataError, DataFolder, DataSet, catalogue};
use crate::assets::pip::Pip;
use crate::assets::{AssetError, Cache, Part, SETUP_COMMAND, platform};
use crate::cli::context::{Context, Outcome};
use crate::cli::default_policy::{self, Origin};
use crate::cli::render::{self, Align, Hinted};
use crate::policy::shelf;

/// Arguments of `doctor`.
#[derive(Debug, Args)]
pub struct DoctorArguments {}

/// One line of the examination.
struct Finding {
    what: String,
    state: &'static str,
    detail: String,
    remedy: Option<String>,
    broken: bool,
}

impl Finding {
    fn good(what: impl Into<String>, state: &'static str, detail: impl Into<String>) -> Self {
        let (what, detail) = (what.into(), detail.into());
        Self { what, state, detail, remedy: None, broken: false }
    }

    fn mended_by(mut self, remedy: impl Into<String>) -> Self {
        self.remedy = Some(remedy.into());
        self
    }

    fn broken_if(mut self, broken: bool) -> Self {
        self.broken = broken;
        self
    }
}

/// Runs the command.
pub fn run(context: &Context, _arguments: &DoctorArguments) -> anyhow::Result<Outcome> {
    let findings = examine(context, &Cache::locate());
    if context.json {
        let documents: Vec<_> = findings
            .iter()
            .map(|finding| {
                json!({
                    "what": finding.what,
                    "state": finding.state,
                    "detail": finding.detail,
                    "remedy": finding.remedy,
                    "broken": finding.broken,
                })
            })
            .collect();
        render::print_json(&json!({ "findings": documents }))?;
    } else {
        let columns = [("what", Align::Left), ("state", Align::Left), ("detail", Align::Left)];
        let rows: Vec<_> = findings
            .iter()
            .map(|f| vec![f.what.clone(), f.state.to_owned(), f.detail.clone()])
            .collect();
        let mut text = render::table(&columns, &rows);
        let mended = findings.iter().filter_map(|f| Some((&f.what, f.remedy.as_ref()?)));
        for (index, (what, remedy)) in mended.enumerate() {
            text.extend([if index == 0 { "\n" } else { "" }, what, ": ", remedy, "\n"]);
        }
        render::print_text(&text)?;
    }
    match findings.into_iter().find(|finding| finding.broken) {
        None => Ok(Outcome::Done),
        Some(Finding { what, state, detail, remedy, .. }) => Err(Hinted::new(
            format!("{what} is {state}: {detail}"),
            remedy.unwrap_or_else(|| format!("run `{SETUP_COMMAND}`")),
        )),
    }
}

fn examine(context: &Context, cache: &Cache) -> Vec<Finding> {
    let mut findings = vec![
        Finding::good("arnold-analyze", "found", env!("CARGO_PKG_VERSION")),
        Finding::good("platform", "found", platform::describe_here()),
        Finding::good("SIMD", "found", simd_level()),
        Finding::good("cache", "found", cache.root().display().to_string()),
    ];
    findings.extend(Part::ALL.map(|part| part_finding(cache, part)));
    findings.push(policy_finding(context, cache));
    findings.push(data_finding(context));
    let data = DataFolder::at(&context.data);
    findings.extend(catalogue::ALL.iter().map(|set| data_set_finding(&data, set)));
    findings.push(match Pip::find() {
        Some(pip) => {
            // The rest of what pip says is where it lies.
            let version = pip.version.split(" from ").next().unwrap_or_default();
            Finding::good("pip", "found", format!("{} ({version})", pip.command()))
        }
        None => Finding::good("pip", "missing", "neither pip nor uv can be run").mended_by(format!(
            "`apt-get install python3-pip`, or take wheels from a folder: `{SETUP_COMMAND} --from DIR`"
        )),
    });
    findings
}

fn part_finding(cache: &Cache, part: Part) -> Finding {
    let verified = cache.verify(part);
    let finding = Finding::good(
        part.to_string(),
        state_of(&verified),
        match &verified {
            Ok(receipt) => format!("{} files, {}", receipt.files.len(), part.licence()),
            Err(error) => error.to_string(),
        },
    );
    match verified {
        Ok(_) => finding,
        Err(AssetError::NoWheel { .. }) => finding.mended_by("use another machine or version"),
        Err(AssetError::Missing { command, .. }) => finding.mended_by(format!("`{command}`")),
        Err(error) => finding.mended_by(error.hint()).broken_if(true),
    }
}

/// The policy used when none is named.
fn policy_finding(context: &Context, cache: &Cache) -> Finding {
    let what = "default policy";
    match default_policy::choose(&context.data, cache, &[]) {
        Ok((path, Origin::Variable)) if shelf::find(&path, &context.data).is_err() => {
            Finding::good(what, "missing", format!("$ARNOLD_POLICY, {}", path.display()))
                .mended_by("set `ARNOLD_POLICY` to a checkpoint that exists, or unset it")
                .broken_if(true)
        }
        Ok((_, Origin::Carried)) => Finding::good(what, "found", Origin::Carried.reason()),
        Ok((path, origin)) => {
            Finding::good(what, "found", format!("{}, {}", path.display(), origin.reason()))
        }
        Err(error) => Finding::good(what, "missing", Origin::Carried.reason())
            .mended_by(error.hint())
            .broken_if(true),
    }
}

/// One published data set: whether it is there, and what for.
fn data_set_finding(data: &DataFolder, set: &DataSet<'_>) -> Finding {
    let verified = data.verify(set);
    let purpose = match &verified {
        Ok(receipt) => format!("{} files, {}", receipt.files.len(), set.purpose),
        Err(DataError::Damaged { reason, path, .. }) => format!("{reason} in `{}`", path.display()),
        Err(_) => format!("{}, {}", set.purpose, data_sets::size(set.bytes())),
    };
    let finding =
        Finding::good(format!("data set {}", set.name), data_sets::state_of(&verified), purpose);
    match verified {
        Ok(_) => finding,
        Err(error @ DataError::Damaged { .. }) => finding.mended_by(error.hint()).broken_if(true),
        Err(error) => finding.mended_by(error.hint()),
    }
}

/// The data folder. Nothing needs it to start, so a missing folder is no fault.
fn data_finding(context: &Context) -> Finding {
    let folder = &context.data;
    match std::fs::read_dir(folder) {
        Ok(entries) => {
            let mut names: Vec<String> = entries
                .filter_map(|entry| Some(entry.ok()?.file_name().to_string_lossy().into_owned()))
                .filter(|name| !name.starts_with('.'))
                .collect();
            names.sort();
            let held = if names.is_empty() { "empty".to_owned() } else { names.join(", ") };
            Finding::good("data", "found", format!("{}: {held}", folder.display()))
        }
        Err(_) => Finding::good("data", "missing", folder.display().to_string()).mended_by(
            "nothing needs it to start; `setup` puts published data sets there, or name another with \
             `--data DIR` or `ARNOLD_DATA`",
        ),
    }
}

/// The widest vector instructions this processor has of those the program can use.
fn simd_level() -> &'static str {
    #[cfg(target_arch = "x86_64")]
    {
        if std::is_x86_feature_detected!("avx512f") {
            return "AVX-512";
        }
        if std::is_x86_feature_detected!("avx2") && std::is_x86_feature_detected!("fma") {
            return "AVX2 with FMA";
        }
        "SSE2"
    }
    #[cfg(not(target_arch = "x86_64"))]
    if cfg!(target_arch = "aarch64") { "NEON" } else { "portable" }
}

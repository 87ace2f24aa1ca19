//! A command inside another: `plan` reads one from its own line, `work` and `gather` from the plan.

use clap::Parser;

use crate::experiment::plan::{PLAN, Plan};

use super::args::Arguments;
use super::context::{Context, Outcome};
use super::render::Hinted;
use super::sweep::Assignment;

/// Does `assignment` of the command typed as `words`.
pub(super) fn run(
    context: &Context,
    words: Vec<String>,
    assignment: Assignment,
) -> anyhow::Result<Outcome> {
    let line = std::iter::once("arnold-analyze").chain(words.iter().map(String::as_str));
    let arguments = Arguments::try_parse_from(line)?;
    if !arguments.command.plays() {
        return Err(Hinted::new(
            format!("`{}` plays no episodes", words.first().map_or("", String::as_str)),
            "plan a command that plays: `csi`, `evaluate`, `rollout`, `smoothness`, `kinematics`, …",
        ));
    }
    let mut inner = context.clone();
    if words.iter().any(|word| word == "--data" || word.starts_with("--data=")) {
        inner.data.clone_from(&arguments.global.data);
    }
    inner.json |= arguments.global.json;
    inner.quiet |= arguments.global.quiet;
    inner.words = words;
    inner.assignment = Some(assignment);
    super::dispatch(&inner, arguments.command)
}

/// Does `assignment` of the command that was planned in its folder, from the folder in which that was typed, if it is
/// there.
pub(super) fn planned(context: &Context, assignment: Assignment) -> anyhow::Result<Outcome> {
    let folder = &assignment.folder;
    if !folder.join(PLAN).exists() {
        return Err(Hinted::new(
            format!("there is no plan in `{}`", folder.display()),
            "`arnold-analyze plan --out DIR COMMAND…` makes one",
        ));
    }
    let plan = Plan::read(folder)?;
    if plan.typed.folder.is_dir() {
        std::env::set_current_dir(&plan.typed.folder)?;
    }
    let mut inner = context.clone();
    if plan.typed.data.is_dir() {
        inner.data.clone_from(&plan.typed.data);
    }
    run(&inner, plan.typed.words, assignment)
}

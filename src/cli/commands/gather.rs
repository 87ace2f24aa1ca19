//! `gather`: the results of a sweep, once all of it is played.

use std::path::PathBuf;

use clap::Args;

use crate::cli::context::{Context, Outcome};
use crate::cli::replay;
use crate::cli::sweep::{Assignment, Purpose};

/// Arguments of `gather`.
#[derive(Debug, Args)]
pub struct GatherArguments {
    /// Folder of the sweep
    #[arg(value_name = "DIR")]
    folder: PathBuf,
}

/// Runs the command.
pub fn run(context: &Context, arguments: &GatherArguments) -> anyhow::Result<Outcome> {
    let folder = std::path::absolute(&arguments.folder)?;
    replay::planned(context, Assignment { folder, purpose: Purpose::Gather })
}

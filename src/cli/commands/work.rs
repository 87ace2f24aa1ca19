//! `work`: plays a shard of a planned sweep.

use std::num::NonZeroUsize;
use std::path::PathBuf;

use clap::Args;

use crate::cli::context::{Context, Outcome};
use crate::cli::replay;
use crate::cli::sweep::{Assignment, Purpose};
use crate::experiment::plan::Shard;

use super::status;

/// Arguments of `work`.
#[derive(Debug, Args)]
pub struct WorkArguments {
    /// Folder of the sweep
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// Which part to play, e.g. `2/7`: in any order, anywhere, any number of times [default: everything that is missing]
    #[arg(long, value_name = "I/N", value_parser = shard)]
    shard: Option<Shard>,
    /// Worker threads; results do not depend on it [default: as planned]
    #[arg(long, value_name = "N")]
    threads: Option<NonZeroUsize>,
    /// Bodies per thread; results do not depend on it [default: as planned]
    #[arg(long, value_name = "N")]
    batch: Option<NonZeroUsize>,
}

fn shard(text: &str) -> Result<Shard, String> {
    let numbers = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
    let shard = numbers.and_then(|(number, count)| Shard::new(number, count));
    shard.ok_or_else(|| "expected a number and how many there are, e.g. `2/7`".to_owned())
}

/// Runs the command.
pub fn run(context: &Context, arguments: &WorkArguments) -> anyhow::Result<Outcome> {
    let WorkArguments { threads, batch, .. } = *arguments;
    let shard = arguments.shard.unwrap_or(Shard::ALL);
    let purpose = Purpose::Work { shard, threads, batch };
    let folder = std::path::absolute(&arguments.folder)?;
    replay::planned(context, Assignment { folder: folder.clone(), purpose })?;
    status::print(context, &folder)?;
    Ok(Outcome::Done)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_shard_is_one_of_so_many() {
        assert_eq!(shard("2/7"), Ok(Shard::new(2, 7).unwrap()));
        for wrong in ["", "2", "0/7", "8/7", "1/0", "a/b", "1/2/3", "-1/2"] {
            assert!(shard(wrong).is_err(), "{wrong}");
        }
    }
}

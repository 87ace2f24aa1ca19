//! What several tests need: recordings of the published code, the installed physics, and the program as a process.
//!
//! Recordings and checkpoints are too large for the repository. They are looked for in `$ARNOLD_GOLDEN`, else in
//! `../shared/golden`; where there are none, a test says "skipped" on stderr and ends.

#![allow(dead_code, reason = "every test binary uses another part of this")]

pub(crate) mod bench;
pub(crate) mod cases;
#[cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
pub(crate) mod physics;

use std::path::{Path, PathBuf};

/// The folder of recordings, which may not exist.
fn golden_root() -> PathBuf {
    let named = std::env::var_os("ARNOLD_GOLDEN").filter(|folder| !folder.is_empty());
    let beside = || Path::new(env!("CARGO_MANIFEST_DIR")).join("../shared/golden");
    named.map_or_else(beside, PathBuf::from)
}

fn existing(folder: PathBuf) -> Option<PathBuf> {
    if folder.is_dir() {
        return Some(folder);
    }
    eprintln!("skipped: there is no folder `{}`", folder.display());
    None
}

/// The recordings of one topic (`env`, `policy`, …), if they are here.
pub(crate) fn golden(topic: &str) -> Option<PathBuf> {
    existing(golden_root().join(topic))
}

/// The data folder in which the walking model lies: `$ARNOLD_DATA`, else beside the recordings.
pub(crate) fn data_folder() -> PathBuf {
    let named = std::env::var_os("ARNOLD_DATA").filter(|folder| !folder.is_empty());
    named.map_or_else(|| golden_root().join("../models"), PathBuf::from)
}

/// A folder of published checkpoints, beside that of the recordings, if it is here.
pub(crate) fn checkpoints(name: &str) -> Option<PathBuf> {
    existing(golden_root().join("../checkpoints").join(name))
}

/// A folder of published data, beside that of the recordings, if it is here.
pub(crate) fn published(name: &str) -> Option<PathBuf> {
    existing(golden_root().join("../data").join(name))
}

/// The published recurrent Baoding policy, if it is here.
pub(crate) fn recurrent_baoding_policy() -> Option<PathBuf> {
    Some(checkpoints("myochallenge2022_baoding_ppo_lstm")?.join("phase1_final.zip"))
}

//! A sweep on a real Slurm gives the bytes of one process, though a shard is requeued and another told to end.
//!
//! Debian: `apt-get install slurm-wlm munge`. The cluster is started for the test and needs root; without these the test
//! says so and ends.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]

use std::path::{Path, PathBuf};
use std::process::Command;

fn installed(program: &str) -> bool {
    let folders = std::env::var_os("PATH").unwrap_or_default();
    let places = std::env::split_paths(&folders).chain([PathBuf::from("/usr/sbin")]);
    places.into_iter().any(|folder| folder.join(program).is_file())
}

fn is_root() -> bool {
    let output = Command::new("id").arg("-u").output();
    output.is_ok_and(|output| output.stdout == b"0\n")
}

#[test]
fn a_job_array_with_a_requeued_shard_gives_the_bytes_of_one_process() {
    let needed = ["munged", "slurmctld", "slurmd", "sbatch"];
    if let Some(missing) = needed.iter().find(|program| !installed(program)) {
        eprintln!("skipped: `{missing}` is not installed (Debian: slurm-wlm munge)");
        return;
    }
    if !is_root() {
        eprintln!("skipped: only root can start a cluster");
        return;
    }
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/slurm/cluster.sh");
    let output = Command::new(script)
        .arg(env!("CARGO_BIN_EXE_arnold-analyze"))
        .env_remove("ARNOLD_POLICY")
        .env_remove("ARNOLD_DATA")
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&output.stdout);
    let complained = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success(), "{said}\n{complained}");
}

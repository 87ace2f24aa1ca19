//! The invented people of `data/emg/synthetic`: part of every clone, so this runs everywhere.

use std::path::Path;
use std::process::Command;

use arnold_analyze::analysis::emg;
use arnold_analyze::analysis::undefined::Undefined;

use super::common::bench::files_below;
use super::human_folder::people_in;

fn folder() -> std::path::PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("data/emg/synthetic")
}

#[test]
fn invented_people_agree_as_their_document_says_and_say_that_they_are_invented() {
    let people = people_in(&folder());
    assert!(emg::channel_faults(&people).is_empty());
    let ceiling = emg::leave_one_out(&people).unwrap().overall(&[], Undefined::Propagate).unwrap();
    let document = std::fs::read_to_string(folder().join("../README.md")).unwrap();
    assert!(document.contains(&format!("correlates with {ceiling:.3} on average")), "{ceiling}");
    assert!(folder().join("SYNTHETIC").is_file());
}

#[test]
fn the_script_makes_the_committed_files_to_the_byte() {
    let made = tempfile::tempdir().unwrap();
    let script = Path::new(env!("CARGO_MANIFEST_DIR")).join("scripts/synthetic_emg.py");
    match Command::new("python3").arg(script).arg(made.path()).status() {
        Ok(status) => assert!(status.success()),
        Err(error) => {
            eprintln!("skipped: python3: {error}");
            return;
        }
    }
    assert_eq!(files_below(made.path()), files_below(&folder()));
}

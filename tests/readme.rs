//! The README and the map name only what exists: commands with their options, make targets, tasks, files.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[cfg(feature = "play")]
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::Command;

const PROGRAM: &str = env!("CARGO_BIN_EXE_arnold-analyze");

fn path(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join(name)
}

fn text(name: &str) -> String {
    std::fs::read_to_string(path(name)).unwrap()
}

/// The commands in the README's code blocks that start with `name`, without prompt and comment.
fn commands(name: &str) -> Vec<Vec<String>> {
    let readme = text("README.md");
    let blocks = readme.split("```").skip(1).step_by(2);
    let lines = blocks.flat_map(str::lines).map(|line| line.strip_prefix("$ ").unwrap_or(line));
    let words = lines.map(|line| {
        let command = line.split(" #").next().unwrap_or_default();
        command.split_whitespace().map(str::to_owned).collect::<Vec<_>>()
    });
    // A table may begin with the program's name; its next word is then a cell, in another column.
    let typed = |words: &Vec<String>| words.len() > 1 && words[0] == name && words[1] != "found";
    words.filter(typed).collect()
}

/// Whether the program understands `arguments`. The `--help` at the end keeps it from doing anything.
fn parses(arguments: &[String]) -> bool {
    let output = Command::new(PROGRAM).args(arguments).arg("--help").output().unwrap();
    output.status.success()
}

#[test]
fn every_command_in_the_readme_is_understood() {
    let commands = commands("arnold-analyze");
    assert!(commands.len() >= 7, "{commands:?}");
    for command in commands {
        assert!(parses(&command[1..]), "the README's `{}` is not understood", command.join(" "));
    }
}

#[test]
fn a_wrong_option_or_value_would_be_noticed() {
    let words = |line: &str| line.split(' ').map(str::to_owned).collect::<Vec<_>>();
    assert!(parses(&words("evaluate --physics 2.3.7")));
    for wrong in
        ["evaluate --phisics 2.3.7", "evaluate --physics 2.3", "evaluated", "verify trace x"]
    {
        assert!(!parses(&words(wrong)), "{wrong}");
    }
}

#[test]
fn the_make_targets_exist_and_the_test_command_is_what_ci_runs() {
    let named: Vec<String> = commands("make").iter().map(|words| words.join(" ")).collect();
    assert_eq!(named, ["make demo", "make test"]);
    let makefile = text("Makefile");
    for command in &named {
        let target = command.replace("make ", "") + ":";
        assert!(
            makefile.lines().any(|line| line.starts_with(&target)),
            "no target for `{command}`"
        );
    }
    assert!(text(".ci/run").lines().any(|line| line == named[1]), ".ci/run does not call it");
}

#[cfg(feature = "sim")]
#[test]
fn the_table_of_tasks_is_the_registry() {
    let readme = text("README.md");
    let table: BTreeSet<&str> =
        readme.lines().filter_map(|line| line.strip_prefix("| `")?.split('`').next()).collect();
    let tasks = arnold_analyze::sim::tasks::every().map(|task| task.name).collect();
    assert_eq!(table, tasks);
}

#[test]
fn every_file_named_in_the_documents_exists() {
    for document in ["README.md", "ARCHITECTURE.md", "CONTRIBUTING.md"] {
        let content = text(document);
        let places = content.split(['`', '(', ')', '"']);
        let is_file = |word: &&str| {
            ["src/", "tests/", "docs/", "LICENSE", "CITATION"].iter().any(|s| word.starts_with(s))
        };
        let named: Vec<&str> = places.filter(is_file).collect();
        assert!(!named.is_empty(), "{document} names no file");
        for name in named {
            assert!(path(name).exists(), "{document} names `{name}`, which does not exist");
        }
    }
}

#[test]
fn the_picture_is_small() {
    let size = std::fs::metadata(path("docs/csi.png")).unwrap().len();
    assert!(size < 150_000, "{size} bytes");
}

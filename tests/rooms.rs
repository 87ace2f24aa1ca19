//! The rooms of the house and the one direction in which they use each other.
//!
//! Reads every file below `src` as tokens (comments, texts and the tests at the bottom of a file do not count) and fails
//! when a room uses one it may not, names a crate that belongs to another room, contains `unsafe` outside `sim`, or when
//! a file grows beyond what one can read.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::path::{Path, PathBuf};

#[path = "rooms/tokens.rs"]
mod tokens;

use tokens::Token;

/// A room and the rooms it may use.
const ROOMS: [(&str, &str); 14] = [
    ("cli", "analysis assets experiment figure files npz policy record sim train units"),
    ("experiment", "analysis assets figure files npz policy record sim units"),
    ("sim", "analysis assets files npz policy random units"),
    ("train", "analysis files npz policy random record sim"),
    ("policy", "files npz units zip_directory"),
    ("analysis", "units"),
    ("record", "files npz units"),
    ("figure", "files units"),
    ("assets", "files"),
    ("npz", "files zip_directory"),
    ("random", ""),
    ("files", ""),
    ("units", ""),
    ("zip_directory", ""),
];

/// Crates that only some rooms may name.
const OWNED_CRATES: &[(&str, &str)] = &[
    ("clap", "cli"),
    ("signal_hook", "cli"),
    ("indicatif", "cli"),
    ("polars", "record"),
    ("mcap", "record"),
    ("hdf5_pure", "record"),
    ("zstd", "record"),
    ("flate2", "assets record"),
    ("rerun", "record"),
    ("re_sdk", "record"),
    ("re_sdk_types", "record"),
    ("libloading", "sim"),
    ("realfft", "analysis"),
    ("statrs", "analysis policy"),
    ("safetensors", "policy"),
    ("svg2pdf", "figure"),
    ("resvg", "figure"),
    ("notosans", "figure"),
    ("ureq", "assets"),
    ("tar", "assets"),
    ("rustix", "assets"),
];

/// What mathematics has no business with: results must not depend on files, threads, clocks or the environment.
const NOT_IN_ANALYSIS: [&str; 6] = ["fs", "thread", "time", "env", "process", "net"];

const LONGEST_FILE: usize = 600;

#[test]
fn every_arrow_points_one_way() {
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("src");
    let mut files = Vec::new();
    collect(&source, &mut files);
    assert!(files.len() > 20, "found only {} files below `{}`", files.len(), source.display());
    let mut found = Vec::new();
    for file in files {
        let text = std::fs::read_to_string(&file).unwrap();
        let name = file.strip_prefix(&source).unwrap().to_string_lossy().replace('\\', "/");
        found.extend(violations(&name, &text));
    }
    assert!(found.is_empty(), "\n{}\n", found.join("\n"));
}

fn collect(folder: &Path, files: &mut Vec<PathBuf>) {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut paths: Vec<_> = entries.map(|entry| entry.unwrap().path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            collect(&path, files);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            files.push(path);
        }
    }
}

/// Everything wrong with the file called `name` (below `src`), one line each.
fn violations(name: &str, text: &str) -> Vec<String> {
    let mut found = Vec::new();
    let lines = text.lines().count();
    if lines > LONGEST_FILE && !name.starts_with("sim/engine/bindings") {
        found.push(format!("src/{name}: {lines} lines, more than {LONGEST_FILE}"));
    }
    if matches!(name, "lib.rs" | "main.rs") {
        return found;
    }
    let modules: Vec<&str> =
        name.trim_end_matches(".rs").trim_end_matches("/mod").split('/').collect();
    let room = modules[0];
    let Some((_, allowed)) = ROOMS.iter().find(|(known, _)| *known == room) else {
        found.push(format!("src/{name}: `{room}` is not a room of the house"));
        return found;
    };
    let tokens = without_tests(tokens::read(text));
    let mut complain = |line, what: String| found.push(format!("src/{name}:{line}: {what}"));
    for (used, line) in rooms_used(&tokens, modules.len()) {
        if used != room && !allowed.split(' ').any(|one| one == used) {
            complain(line, format!("`{room}` may not use `{used}`"));
        }
    }
    for (index, token) in tokens.iter().enumerate() {
        if token.text == "unsafe" && room != "sim" {
            complain(token.line, format!("`{room}` may not contain `unsafe`"));
        }
        if !starts_path(&tokens, index) {
            continue;
        }
        let owner = OWNED_CRATES.iter().find(|(owned, _)| *owned == token.text);
        if let Some((owned, owner)) =
            owner.filter(|(_, owners)| !owners.split(' ').any(|owner| owner == room))
        {
            complain(token.line, format!("`{room}` may not name `{owned}`, only `{owner}` may"));
        }
        if room == "analysis" && token.text == "std" {
            for (used, line) in heads(&tokens, index + 2) {
                if NOT_IN_ANALYSIS.contains(&used.as_str()) {
                    complain(line, format!("`analysis` may not use `std::{used}`"));
                }
            }
        }
    }
    found
}

/// Cuts off the tests, which stand at the bottom: everything from `#[cfg(test)] mod` on.
fn without_tests(mut tokens: Vec<Token>) -> Vec<Token> {
    const START: [&str; 8] = ["#", "[", "cfg", "(", "test", ")", "]", "mod"];
    let is_start = |window: &[Token]| window.iter().map(|token| token.text.as_str()).eq(START);
    if let Some(start) = tokens.windows(START.len()).position(is_start) {
        tokens.truncate(start);
    }
    tokens
}

fn is(tokens: &[Token], index: usize, text: &str) -> bool {
    tokens.get(index).is_some_and(|token| token.text == text)
}

/// Whether the word at `index` is the first of a path, i.e. may be the name of a crate.
fn starts_path(tokens: &[Token], index: usize) -> bool {
    let after = |text| index > 0 && is(tokens, index - 1, text);
    !after("::") && !after(".") && (is(tokens, index + 1, "::") || after("use"))
}

/// The rooms named by `crate::room`, by `crate::{room, …}`, and by enough `super::` to leave a module at `depth`.
fn rooms_used(tokens: &[Token], depth: usize) -> Vec<(String, usize)> {
    let mut used = Vec::new();
    for index in (0..tokens.len()).filter(|&index| starts_path(tokens, index)) {
        let mut end = index;
        while is(tokens, end, "super") && is(tokens, end + 1, "::") {
            end += 2;
        }
        if matches!(tokens[index].text.as_str(), "crate" | "arnold_analyze") {
            used.extend(heads(tokens, index + 2));
        } else if end > index && (end - index) / 2 >= depth {
            used.extend(heads(tokens, end));
        }
    }
    used
}

/// The first word of a path, or of each path in a group in braces, starting at `index`.
fn heads(tokens: &[Token], index: usize) -> Vec<(String, usize)> {
    let Some(first) = tokens.get(index) else { return Vec::new() };
    if first.text != "{" {
        return vec![(first.text.clone(), first.line)];
    }
    let (mut heads, mut depth, mut is_head) = (Vec::new(), 0, false);
    for token in &tokens[index..] {
        match token.text.as_str() {
            "{" => {
                depth += 1;
                is_head = depth == 1;
            }
            "}" if depth == 1 => break,
            "}" => depth -= 1,
            "," => is_head = depth == 1,
            text if is_head => {
                heads.push((text.to_owned(), token.line));
                is_head = false;
            }
            _ => {}
        }
    }
    heads
}

#[test]
fn an_arrow_that_turns_round_is_found_however_it_is_spelled() {
    let cases = [
        ("analysis/pca.rs", "use crate::sim::Model;", "`analysis` may not use `sim`"),
        ("analysis/pca.rs", "fn f() { crate::files::g() }", "`analysis` may not use `files`"),
        ("policy/mod.rs", "use crate::{units::{A, B}, sim::{a}};", "`policy` may not use `sim`"),
        ("policy/network/mlp.rs", "use super::super::super::sim;", "`policy` may not use `sim`"),
        ("sim/mod.rs", "use super::cli::render;", "`sim` may not use `cli`"),
        ("sim/model.rs", "use crate::experiment::plan;", "`sim` may not use `experiment`"),
        ("record/a.rs", "use arnold_analyze::analysis::a;", "`record` may not use `analysis`"),
        ("assets/pip.rs", "pub use crate::cli;", "`assets` may not use `cli`"),
        ("files.rs", "use crate::units;", "`files` may not use `units`"),
        ("analysis/pca.rs", "use polars::prelude::*;", "only `record` may"),
        ("assets/pip.rs", "let x = libloading::Library::new();", "only `sim` may"),
        ("experiment/plan.rs", "#[derive(clap::Args)] struct A;", "only `cli` may"),
        ("sim/model.rs", "use indicatif;", "only `cli` may"),
        ("policy/mod.rs", "fn f() { unsafe { g() } }", "`policy` may not contain `unsafe`"),
        ("analysis/pca.rs", "use std::{f64, fs};", "`analysis` may not use `std::fs`"),
        ("analysis/pca.rs", "std::thread::spawn(f);", "`analysis` may not use `std::thread`"),
        ("helpers/mod.rs", "", "`helpers` is not a room of the house"),
    ];
    for (name, text, complaint) in cases {
        let found = violations(name, text);
        assert_eq!(found.len(), 1, "{name}: {text}: {found:?}");
        assert!(found[0].contains(complaint), "{name}: {text}: {found:?}");
    }
}

#[test]
fn what_is_allowed_or_only_talked_about_is_not_an_arrow() {
    let cases = [
        ("analysis/a.rs", "use crate::units::Hertz; use crate::analysis::pad; use std::f64;"),
        ("analysis/stats/ranks.rs", "use super::super::pca; use super::holm;"),
        (
            "analysis/a.rs",
            "/// `crate::sim`\n// crate::sim unsafe\n/* crate::cli /* clap:: */ x */",
        ),
        ("analysis/a.rs", "const A: &str = \"crate::sim \\\" unsafe\"; const B: char = '\"';"),
        ("analysis/a.rs", "const A: &str = r#\"crate::sim \" unsafe\"#; fn f<'a>(x: &'a str) {}"),
        ("analysis/a.rs", "#[cfg(test)]\nmod tests { use crate::npz; use std::fs; }"),
        ("cli/args.rs", "use clap::Parser; use crate::{sim, record};"),
        ("sim/engine/library.rs", "unsafe { libloading::Library::new(path) }"),
        ("policy/mod.rs", "pub(crate) fn f() { record.polars.len() }"),
    ];
    for (name, text) in cases {
        assert_eq!(violations(name, text), Vec::<String>::new(), "{name}: {text}");
    }
}

#[test]
fn a_file_longer_than_one_can_read_is_found_and_generated_ones_are_not() {
    let text = "\n".repeat(LONGEST_FILE + 1);
    assert_eq!(violations("sim/model.rs", &text).len(), 1);
    assert_eq!(violations("lib.rs", &text).len(), 1);
    assert_eq!(violations("sim/engine/bindings_2_3_7.rs", &text).len(), 0);
    assert_eq!(violations("sim/model.rs", &text[1..]).len(), 0);
}

#[test]
fn a_complaint_carries_its_line() {
    let text = "/* one\ntwo */\nconst A: &str = \"\n\";\nuse crate::sim;\n";
    assert_eq!(violations("units.rs", text), ["src/units.rs:5: `units` may not use `sim`"]);
}

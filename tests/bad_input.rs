//! Bad input as a person meets it: one error that names the file and the cause, a hint, the right exit code, nothing on
//! stdout, and nothing left behind.

#![cfg(all(feature = "sim", feature = "parquet", feature = "figures"))]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "hostile/build.rs"]
#[allow(dead_code, reason = "only some of the pieces are needed here")]
mod build;
mod common;

use common::bench::Bench;
use common::physics::elbow_policy;
use common::{checkpoints, golden, recurrent_baoding_policy};

/// Runs `words`, which must fail with `code`, say one error with each of `names` in it, give a hint, print nothing and
/// leave no results.
fn refuses(bench: &Bench, code: i32, words: &[&str], names: &[&str]) {
    let before = common::bench::files_below(&bench.path("."));
    let ended = bench.run(words);
    let said = &ended.stderr;
    assert_eq!(ended.code, code, "{words:?}: {said}");
    assert_eq!(ended.stdout, "", "{words:?}");
    let errors: Vec<&str> = said.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{words:?}: {said}");
    for name in names {
        assert!(errors[0].contains(name), "{words:?}: no `{name}` in: {}", errors[0]);
    }
    let hints = said.lines().filter(|line| line.starts_with("hint: ")).count();
    assert_eq!(hints, 1, "{words:?}: {said}");
    assert!(!said.contains("panicked"), "{words:?}: {said}");
    let after = common::bench::files_below(&bench.path("."));
    assert!(after.keys().eq(before.keys()), "{words:?} left {:?}", after.keys());
}

/// As [`refuses`], for a checkpoint played with `evaluate`.
fn refuses_policy(bench: &Bench, policy: &str, more: &[&str], names: &[&str]) {
    let words = [&["evaluate", "--episodes", "1", "--policy", policy], more].concat();
    refuses(bench, 1, &words, names);
}

/// The elbow policy's bytes.
fn elbow_bytes() -> Vec<u8> {
    std::fs::read(elbow_policy()).unwrap()
}

#[test]
fn a_checkpoint_that_is_missing_a_folder_or_something_else_is_named() {
    let bench = Bench::new();
    refuses_policy(&bench, "nothing.zip", &[], &["there is no policy `nothing.zip`"]);
    refuses_policy(&bench, ".", &[], &["no checkpoint in the folder `.`"]);
    bench.write("letter.zip", b"Dear Arnold,\n");
    refuses_policy(
        &bench,
        "letter.zip",
        &[],
        &["`letter.zip`", "neither a zip archive nor a pickle"],
    );
    bench.write("empty.pickle", b"");
    refuses_policy(&bench, "empty.pickle", &[], &["`empty.pickle`"]);
    for command in ["inspect", "evaluate", "csi", "rollout"] {
        let option: &[&str] = if command == "inspect" { &[] } else { &["--policy"] };
        let words = [&[command], option, &["nothing.zip"]].concat();
        refuses(&bench, 1, &words, &["`nothing.zip`"]);
    }
    for kind in ["traces", "policy"] {
        refuses(&bench, 1, &["verify", kind, "nothing"], &["`nothing`"]);
        refuses(&bench, 1, &["verify", kind, "."], &["`.`"]);
    }
}

#[test]
fn a_checkpoint_that_was_cut_short_is_named() {
    let bench = Bench::new();
    let pickle = elbow_bytes();
    bench.write("short.pickle", &pickle[..pickle.len() / 2]);
    refuses_policy(&bench, "short.pickle", &[], &["`short.pickle`", "ends too early"]);
    let archive = build::good_policy();
    bench.write("short.zip", &archive[..archive.len() / 2]);
    refuses_policy(&bench, "short.zip", &[], &["`short.zip`", "damaged"]);
    refuses(&bench, 1, &["inspect", "short.zip"], &["`short.zip`", "damaged"]);
}

#[test]
fn a_checkpoint_is_known_by_its_content_and_not_by_its_name() {
    let bench = Bench::new();
    bench.write("renamed.zip", &elbow_bytes());
    let words = ["--task", "elbow_pose", "--episodes", "1", "--json", "--quiet"];
    let renamed = bench.json(&[&["evaluate", "--policy", "renamed.zip"], &words[..]].concat());
    let original = bench.json(&[&["evaluate"], &words[..]].concat());
    assert_eq!(renamed["tasks"], original["tasks"]);

    let Some(policy) = recurrent_baoding_policy() else { return };
    bench.write("renamed.pickle", &std::fs::read(&policy).unwrap());
    let document = bench.json(&["inspect", "renamed.pickle", "--json"]);
    assert_eq!(document["sizes"]["actions"], 39, "{document}");
}

#[test]
fn a_policy_of_another_body_is_refused_with_both_numbers() {
    let bench = Bench::new();
    let elbow = elbow_policy().display().to_string();
    let named = format!("`{elbow}`");
    for task in ["baoding_p1_ccw", "hand_index_reach"] {
        refuses_policy(&bench, &elbow, &["--task", task], &[&named, task, "expects 9 "]);
    }
    refuses_policy(&bench, &elbow, &["--task", "hand"], &[&named, "fits none of the tasks"]);
}

#[test]
fn a_program_in_a_checkpoint_or_normaliser_never_runs() {
    let bench = Bench::new();
    let marker = bench.path("executed");
    let program = build::call("os.system", &[build::text(&format!("touch {}", marker.display()))]);
    bench.write("evil.pickle", &build::pickle(&program));
    bench.write("evil.zip", &build::policy_with(program.clone()));
    bench.write("evil.pkl", &build::smuggled(&program));
    for name in ["evil.pickle", "evil.zip"] {
        refuses_policy(&bench, name, &[], &[&format!("`{name}`"), "os.system"]);
        refuses(&bench, 1, &["inspect", name], &[&format!("`{name}`"), "os.system"]);
    }
    let elbow = elbow_policy().display().to_string();
    let normaliser = ["--normaliser", "evil.pkl"];
    refuses_policy(&bench, &elbow, &normaliser, &["`evil.pkl`", "os.system"]);
    bench.write("protocol0.pickle", b"cos\nsystem\n(S'touch executed'\ntR.");
    refuses_policy(&bench, "protocol0.pickle", &[], &["`protocol0.pickle`"]);
    assert!(!marker.exists());
}

#[test]
fn a_normaliser_that_is_missing_or_belongs_to_another_policy_is_named() {
    let bench = Bench::new();
    let elbow = elbow_policy().display().to_string();
    let with = |name: &'static str| ["--normaliser", name];
    refuses_policy(&bench, &elbow, &with("nothing.pkl"), &["`nothing.pkl`", "does not exist"]);
    bench.write("three.pkl", &build::good_component_normaliser());
    bench.write("tokens.pkl", &build::good_signature_normaliser());
    refuses_policy(&bench, &elbow, &with("three.pkl"), &["`three.pkl`", "normaliser"]);
    if let Some(policy) = recurrent_baoding_policy() {
        let policy = policy.display().to_string();
        let (length, kind) = (["`three.pkl`", "3 entries", "86"], ["`tokens.pkl`", "per token"]);
        refuses_policy(&bench, &policy, &with("three.pkl"), &length);
        refuses_policy(&bench, &policy, &with("tokens.pkl"), &kind);
        // Alone in a folder it has none.
        bench.write("alone.zip", &std::fs::read(&policy).unwrap());
        refuses_policy(&bench, "alone.zip", &[], &["`alone.zip`", "there is none"]);
    }
    let (Some(recordings), Some(_)) = (golden("policy"), checkpoints("npg")) else { return };
    let policy = recordings.join("xs_model.zip").display().to_string();
    refuses_policy(&bench, &policy, &with("three.pkl"), &["`three.pkl`", "per component"]);
    refuses_policy(&bench, &policy, &with("tokens.pkl"), &["`tokens.pkl`"]);
}

#[test]
fn an_unknown_task_gets_a_suggestion() {
    let bench = Bench::new();
    let names = ["`elbow_poze`", "did you mean `elbow_pose`?"];
    refuses(&bench, 1, &["evaluate", "--task", "elbow_poze"], &names);
    refuses(&bench, 1, &["csi", "--task", "elbow_pose,elbow_poze"], &names);
    refuses(&bench, 1, &["tasks", "elbow_poze"], &names);
}

#[test]
fn a_folder_that_cannot_be_written_is_named_before_anything_is_played() {
    let bench = Bench::new();
    bench.write("file", b"");
    for command in ["evaluate", "csi", "rollout"] {
        // Enough episodes to outlast every patience.
        let words = [command, "--episodes", "1000000", "--quiet", "--out", "file/results"];
        refuses(&bench, 1, &words, &["file/results"]);
    }
}

#[test]
fn numbers_that_make_no_sense_are_refused_with_what_was_expected() {
    let bench = Bench::new();
    let cases: [(&str, &str, &str); 11] = [
        ("--episodes", "0", "at least 1"),
        ("--episodes", "-3", "at least 1"),
        ("--threads", "0", "at least 1"),
        ("--batch", "many", "at least 1"),
        ("--action-noise", "-1", "not negative"),
        ("--action-noise", "nan", "not negative"),
        ("--seed", "-1", "not negative"),
        ("--physics", "9.9", "2.3.7 or 3.17.0"),
        ("--components", "0", "no number of components"),
        ("--components", "3-", "no number of components"),
        ("--components", "5-2", "empty"),
    ];
    for (option, value, expected) in cases {
        refuses(&bench, 2, &["csi", option, value], &[option, value, expected]);
    }
    refuses(&bench, 2, &["evaluate", "--components", "1"], &["--components"]);
    let beyond = ["csi", "--task", "elbow_pose", "--components", "7,8"];
    refuses(&bench, 1, &beyond, &["at most 6 muscles"]);
}

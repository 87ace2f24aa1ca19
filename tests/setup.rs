//! `setup` and `doctor` as processes: what they say and leave behind when wheels are wrong or missing, and when several
//! run at once. No network: wheels come from folders made here, `pip` is a script or not there.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};

use arnold_analyze::assets::{Cache, Event, Part, PhysicsVersion, Source};
use arnold_analyze::files;
use zip::write::SimpleFileOptions;

const PROGRAM: &str = env!("CARGO_BIN_EXE_arnold-analyze");
const NOTHING: [String; 0] = [];
const PHYSICS: Part = Part::Physics(PhysicsVersion::V2_3_7);

/// A cache that does not exist yet, and a place for wheels.
struct Bench {
    folder: tempfile::TempDir,
}

impl Bench {
    fn new() -> Self {
        Self { folder: tempfile::tempdir().unwrap() }
    }

    fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(PROGRAM);
        command.args(arguments).env("ARNOLD_CACHE", self.path("cache"));
        command.env_remove("ARNOLD_POLICY").env_remove("ARNOLD_DATA");
        command
    }

    fn setup_from_wheels(&self) -> Command {
        let mut command = self.command(&["setup", "--from"]);
        command.arg(self.path("wheels"));
        command
    }

    /// Wheels of `MuJoCo` 2.3.7 for every platform, whose library says `content`.
    fn fake_wheels(&self, content: &[u8]) {
        for tag in [
            "manylinux_2_17_x86_64.manylinux2014_x86_64",
            "manylinux_2_17_aarch64.manylinux2014_aarch64",
            "macosx_11_0_arm64",
            "macosx_10_16_x86_64",
        ] {
            let wheel = self.path("wheels").join(format!("mujoco-2.3.7-cp311-cp311-{tag}.whl"));
            let libraries = ["mujoco/libmujoco.so.2.3.7", "mujoco/libmujoco.2.3.7.dylib"];
            write_wheel(&wheel, &libraries, content);
        }
    }

    /// What lies in the cache besides the lock.
    fn leftovers(&self) -> Vec<String> {
        let entries = std::fs::read_dir(self.path("cache")).into_iter().flatten();
        let names = entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        names.filter(|name| name != ".lock").collect()
    }
}

fn write_wheel(path: &Path, entries: &[&str], content: &[u8]) {
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for entry in entries {
        writer.start_file(*entry, SimpleFileOptions::default()).unwrap();
        writer.write_all(content).unwrap();
    }
    files::write_atomic(path, &writer.finish().unwrap().into_inner()).unwrap();
}

/// Runs `command`, which must end with `code`; what it said on stderr.
fn fails_with(code: i32, command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = stderr(&output);
    assert_eq!(output.status.code(), Some(code), "{text}");
    text
}

fn stderr(output: &Output) -> String {
    String::from_utf8_lossy(&output.stderr).into_owned()
}

#[test]
fn a_wheel_with_another_library_is_refused_by_name_and_hashes_and_nothing_stays() {
    let bench = Bench::new();
    bench.fake_wheels(b"not MuJoCo");
    let text = fails_with(1, &mut bench.setup_from_wheels());
    let found = files::sha256_hex(b"not MuJoCo");
    assert!(text.contains("error: `mujoco/libmujoco."), "{text}");
    assert!(text.contains(&format!(" has SHA-256 {found}, expected ")), "{text}");
    assert!(text.contains(".whl`\n\nhint: "), "{text}");
    assert_eq!(bench.leftovers(), NOTHING);
}

#[test]
fn a_folder_without_the_wheel_says_which_one_is_missing() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("wheels")).unwrap();
    let text = fails_with(1, &mut bench.setup_from_wheels());
    assert!(text.contains("no wheel of MuJoCo 2.3.7"), "{text}");
    assert_eq!(bench.leftovers(), NOTHING);
}

#[test]
fn setups_that_run_together_all_refuse_and_leave_nothing() {
    let bench = Bench::new();
    bench.fake_wheels(b"not MuJoCo");
    let start = |_| {
        let mut command = bench.setup_from_wheels();
        command.stdout(Stdio::null()).stderr(Stdio::null()).spawn().unwrap()
    };
    let running: Vec<_> = (0..4).map(start).collect();
    for mut process in running {
        assert_eq!(process.wait().unwrap().code(), Some(1));
    }
    assert_eq!(bench.leftovers(), NOTHING);
}

#[test]
fn what_a_killed_setup_left_is_cleared_by_the_next() {
    let bench = Bench::new();
    bench.fake_wheels(b"not MuJoCo");
    files::write_atomic(&bench.path("cache/.staging-killed/part/a"), b"half").unwrap();
    fails_with(1, &mut bench.setup_from_wheels());
    assert_eq!(bench.leftovers(), NOTHING);
}

#[test]
fn checking_an_empty_cache_fails_with_the_command_that_fills_it_and_creates_nothing() {
    let bench = Bench::new();
    let text = fails_with(1, &mut bench.command(&["setup", "--check"]));
    assert!(text.contains("MyoSuite 2.2.0 is not installed"), "{text}");
    assert!(text.ends_with("\n\nhint: run `arnold-analyze setup`\n"), "{text}");
    assert!(!bench.path("cache").exists());
}

#[test]
fn a_cache_that_cannot_be_written_is_named_with_the_variable_that_moves_it() {
    let bench = Bench::new();
    bench.fake_wheels(b"not MuJoCo");
    files::write_atomic(&bench.path("a file"), b"").unwrap();
    let mut command = bench.setup_from_wheels();
    let text = fails_with(1, command.env("ARNOLD_CACHE", bench.path("a file/cache")));
    assert!(text.contains("a file/cache"), "{text}");
    assert!(text.contains("hint: set `ARNOLD_CACHE`"), "{text}");
}

#[test]
fn without_pip_and_uv_setup_says_what_to_install() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("empty")).unwrap();
    let text = fails_with(1, bench.command(&["setup"]).env("PATH", bench.path("empty")));
    assert!(text.contains("found neither `pip` nor `uv`"), "{text}");
    assert!(text.contains("apt-get install python3-pip"), "{text}");
    assert_eq!(bench.leftovers(), NOTHING);
}

#[cfg(unix)]
#[test]
fn when_pip_fails_its_last_lines_are_shown() {
    use std::os::unix::fs::PermissionsExt;
    let bench = Bench::new();
    let script = bench.path("programs/python3");
    let text = b"#!/bin/sh\nfor word; do [ \"$word\" = --version ] && echo pip 1 && exit 0; done\n\
        echo the network is down >&2\nexit 1\n";
    files::write_atomic(&script, text).unwrap();
    std::fs::set_permissions(&script, std::fs::Permissions::from_mode(0o755)).unwrap();
    let text = fails_with(1, bench.command(&["setup"]).env("PATH", bench.path("programs")));
    let complaint = "`python3 -m pip download mujoco==2.3.7` failed:\n  the network is down\n";
    assert!(text.contains(complaint), "{text}");
    assert_eq!(bench.leftovers(), NOTHING);
}

#[test]
fn a_damaged_part_is_named_and_kept_until_a_good_one_replaces_it() {
    let bench = Bench::new();
    files::write_atomic(&bench.path("cache/myosuite-2.2.0/a"), b"").unwrap();
    bench.fake_wheels(b"not MuJoCo");
    let text = fails_with(1, &mut bench.command(&["setup", "--check"]));
    assert!(text.contains("MyoSuite 2.2.0 is damaged: no receipt"), "{text}");
    fails_with(1, &mut bench.setup_from_wheels());
    assert_eq!(bench.leftovers(), ["myosuite-2.2.0"]);
}

#[test]
fn the_doctor_names_what_is_missing_without_calling_it_broken() {
    let bench = Bench::new();
    let output = bench.command(&["doctor", "--json"]).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", stderr(&output));
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let findings = document["findings"].as_array().unwrap();
    let models = findings.iter().find(|finding| finding["what"] == "MyoSuite 2.2.0").unwrap();
    assert_eq!(models["state"], "missing");
    assert_eq!(models["remedy"], "`arnold-analyze setup`");
    assert!(findings.iter().all(|finding| finding["broken"] == false));
}

#[test]
fn the_doctor_fails_when_something_installed_is_damaged() {
    let bench = Bench::new();
    std::fs::create_dir_all(bench.path("cache/myosuite-2.2.0")).unwrap();
    let text = fails_with(1, &mut bench.command(&["doctor"]));
    assert!(text.contains("MyoSuite 2.2.0 is damaged"), "{text}");
}

#[cfg(not(feature = "download"))]
#[test]
fn a_program_that_cannot_fetch_data_sets_names_the_feature_it_lacks() {
    let bench = Bench::new();
    let data = bench.path("data");
    for option in ["--kinesis", "--emg", "--arnold"] {
        let text = fails_with(1, bench.command(&["setup", option, "--data"]).arg(&data));
        assert!(text.contains("was built without the feature `download`"), "{text}");
        assert!(text.contains("hint: build it with `cargo build --release`"), "{text}");
        assert!(!data.exists());
    }
}

/// A bench with a true wheel of `MuJoCo` 2.3.7, made of what the user's cache holds. `make test` fills that cache first;
/// elsewhere there is nothing to look at, which is said.
fn bench_with_a_true_wheel() -> Option<Bench> {
    let cache = Cache::locate();
    let verified = cache.verify(PHYSICS);
    let receipt = verified.inspect_err(|error| eprintln!("skipped: {error}")).ok()?;
    let bench = Bench::new();
    let mut writer = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for name in receipt.files.keys() {
        writer.start_file(name, SimpleFileOptions::default()).unwrap();
        writer.write_all(&std::fs::read(cache.folder(PHYSICS).join(name)).unwrap()).unwrap();
    }
    let wheel = bench.path("wheels").join(&receipt.wheel);
    files::write_atomic(&wheel, &writer.finish().unwrap().into_inner()).unwrap();
    Some(bench)
}

/// Installs from the bench's wheels into its cache; what happened.
fn install(bench: &Bench) -> Vec<Event> {
    let mut events = Vec::new();
    let source = Source::Folder(bench.path("wheels"));
    let cache = Cache::at(bench.path("cache"));
    cache.ensure(&[PHYSICS], &source, &mut |event| events.push(event)).unwrap();
    events
}

#[test]
fn installers_that_run_together_install_once_and_all_succeed() {
    let Some(bench) = bench_with_a_true_wheel() else { return };
    let events: Vec<Event> = std::thread::scope(|scope| {
        let running: Vec<_> = (0..4).map(|_| scope.spawn(|| install(&bench))).collect();
        running.into_iter().flat_map(|thread| thread.join().unwrap()).collect()
    });
    let count = |wanted: fn(&Event) -> bool| events.iter().filter(|event| wanted(event)).count();
    assert_eq!(count(|event| matches!(event, Event::Installed(..))), 1);
    assert_eq!(count(|event| matches!(event, Event::Present(_))), 3);
    assert_eq!(bench.leftovers().len(), 1);
    Cache::at(bench.path("cache")).physics_library(PhysicsVersion::V2_3_7).unwrap();
}

#[test]
fn a_library_with_one_flipped_bit_is_noticed_and_replaced() {
    let Some(bench) = bench_with_a_true_wheel() else { return };
    install(&bench);
    let cache = Cache::at(bench.path("cache"));
    let library = cache.physics_library(PhysicsVersion::V2_3_7).unwrap();
    let mut bytes = std::fs::read(&library).unwrap();
    bytes[1000] ^= 1;
    files::write_atomic(&library, &bytes).unwrap();
    let text = cache.physics_library(PhysicsVersion::V2_3_7).unwrap_err().to_string();
    assert!(text.contains(&files::sha256_hex(&bytes)), "{text}");
    assert!(text.ends_with(&format!(" in `{}`", library.display())), "{text}");
    let events = install(&bench);
    assert!(events.iter().any(|event| matches!(event, Event::Replacing(..))), "{events:?}");
    cache.physics_library(PhysicsVersion::V2_3_7).unwrap();
    assert_eq!(bench.leftovers().len(), 1);
}

#[test]
fn the_models_and_the_default_policy_of_the_users_cache_are_whole() {
    let cache = Cache::locate();
    match cache.myosuite() {
        Ok(models) => {
            assert!(models.join("envs/myo/assets/elbow/myoelbow_1dof6muscles.xml").is_file());
            assert!(cache.npg_elbow_policy().unwrap().is_file());
        }
        Err(error) => eprintln!("skipped: {error}"),
    }
}

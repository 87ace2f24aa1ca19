//! Published data sets from a folder and from servers that answer wrongly, slowly, by half or not at all. Archives and
//! sums are made here; the servers listen on this machine.

#![cfg(feature = "download")]
#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

use std::io::Write;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use arnold_analyze::assets::data::{
    Checksum, Content, DataError, DataEvent, DataSet, Origin, RemoteFile,
};
use arnold_analyze::files;

#[path = "data_sets/bench.rs"]
mod bench;
#[path = "data_sets/server.rs"]
mod server;

use bench::{Bench, FILE, noise, set_of};
use server::{Answer, Server};

const PROGRAM: &str = env!("CARGO_BIN_EXE_arnold-analyze");

fn count(events: &[DataEvent], wanted: fn(&DataEvent) -> bool) -> usize {
    events.iter().filter(|event| wanted(event)).count()
}

fn starts(events: &[DataEvent]) -> Vec<u64> {
    let start = |event: &DataEvent| match event {
        DataEvent::Fetching { start, .. } => Some(*start),
        _ => None,
    };
    events.iter().filter_map(start).collect()
}

#[test]
fn an_archive_in_a_folder_is_installed_once_with_a_receipt_that_names_no_date() {
    let bench = Bench::new();
    bench.fetch(&bench.mirror()).unwrap();
    assert!(bench.is_installed(), "{:?}", bench.all());
    let receipt = std::fs::read(bench.path("data/.setup/set.json")).unwrap();
    let document: serde_json::Value = serde_json::from_slice(&receipt).unwrap();
    assert_eq!(document["fetched"][FILE], format!("SHA-256 {}", bench.sum));
    assert_eq!(document["files"]["a.xml"], files::sha256_hex(b"a"));
    let again = bench.fetch(&bench.mirror()).unwrap();
    assert_eq!(again, [DataEvent::Present("set".to_owned())]);
    let other = Bench::new();
    other.fetch(&other.mirror()).unwrap();
    assert_eq!(std::fs::read(other.path("data/.setup/set.json")).unwrap(), receipt);
}

#[test]
fn md5_proves_an_archive_as_the_record_states_it() {
    let bench = Bench::new();
    bench.mirror();
    // MD5 of nothing: of a file that has other bytes it is wrong, of an empty one right.
    let empty = "d41d8cd98f00b204e9800998ecf8427e";
    let bytes = bench.archive.len() as u64;
    let file = RemoteFile { name: FILE, bytes, checksum: Checksum::Md5(empty) };
    let error = bench.fetch_set(&set_of(&[file]), &bench.mirror()).unwrap_err();
    assert!(error.to_string().contains(&format!("expected MD5 {empty}")), "{error}");
    let files = [RemoteFile { name: "nothing", bytes: 0, checksum: Checksum::Md5(empty) }];
    bench.put("mirror/nothing", b"");
    let set = DataSet { content: Content::Files, ..set_of(&files) };
    bench.fetch_set(&set, &bench.mirror()).unwrap();
    assert_eq!(bench.all(), [".setup/set.json", "set/nothing"]);
}

#[test]
fn a_folder_with_other_bytes_or_without_the_file_changes_nothing() {
    let bench = Bench::new();
    let mut wrong = bench.archive.clone();
    wrong[100] ^= 1;
    bench.put("mirror/set.tar.gz", &wrong);
    let origin = Origin::Folder(bench.path("mirror"));
    let error = bench.fetch(&origin).unwrap_err();
    assert!(matches!(error, DataError::WrongSum { .. }), "{error}");
    assert!(error.to_string().contains(&files::sha256_hex(&wrong)), "{error}");
    bench.put("mirror/set.tar.gz", &wrong[1..]);
    let text = bench.fetch(&origin).unwrap_err().to_string();
    assert!(
        text.contains(&format!("{} bytes, expected {} bytes", wrong.len() - 1, wrong.len())),
        "{text}"
    );
    let error = bench.fetch(&Origin::Folder(bench.path("nowhere"))).unwrap_err();
    assert!(matches!(error, DataError::NotInFolder { .. }), "{error}");
    assert!(bench.all().is_empty(), "{:?}", bench.all());
}

#[test]
fn a_server_gives_the_same_as_a_folder() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |_| Answer::Whole);
    let events = bench.fetch(&server.origin()).unwrap();
    assert!(bench.is_installed(), "{:?}", bench.all());
    assert_eq!(starts(&events), [0]);
    assert_eq!(server.requests(), ["/base/set.tar.gz "]);
}

#[test]
fn a_connection_that_is_cut_is_continued_where_it_was_cut() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |request| match request {
        0 => Answer::Cut(100_000),
        1 => Answer::Cut(50_000),
        _ => Answer::Whole,
    });
    let events = bench.fetch(&server.origin()).unwrap();
    assert!(bench.is_installed());
    assert_eq!(starts(&events), [0, 100_000, 150_000]);
    let asked = server.requests();
    assert_eq!(asked[1..], ["/base/set.tar.gz bytes=100000-", "/base/set.tar.gz bytes=150000-"]);
    assert_eq!(count(&events, |event| matches!(event, DataEvent::Retrying { .. })), 2);
}

#[test]
fn what_a_dead_program_fetched_is_continued_by_the_next() {
    let bench = Bench::new();
    bench.put("data/.setup/set.tar.gz.part", &bench.archive[..123_456]);
    bench.put("data/.setup/staging-dead/set/a.xml", b"half");
    let server = Server::start(&bench.archive, |_| Answer::Whole);
    let events = bench.fetch(&server.origin()).unwrap();
    assert_eq!(starts(&events), [123_456]);
    assert!(bench.is_installed(), "{:?}", bench.all());
}

#[test]
fn a_whole_unfinished_file_is_used_without_asking_anybody() {
    let bench = Bench::new();
    bench.put("data/.setup/set.tar.gz.part", &bench.archive);
    let server = Server::start(&bench.archive, |_| Answer::Status("500 Broken"));
    bench.fetch(&server.origin()).unwrap();
    assert!(bench.is_installed());
    assert_eq!(server.requests().len(), 0);
}

#[test]
fn a_beginning_of_another_file_is_noticed_and_fetched_anew_once() {
    let bench = Bench::new();
    for wrong in [vec![7; 1000], vec![7; bench.archive.len()], vec![7; bench.archive.len() + 5]] {
        let bench = Bench::new();
        bench.put("data/.setup/set.tar.gz.part", &wrong);
        let server = Server::start(&bench.archive, |_| Answer::Whole);
        let events = bench.fetch(&server.origin()).unwrap();
        assert_eq!(starts(&events).last(), Some(&0), "{events:?}");
        assert!(bench.is_installed(), "{:?}", bench.all());
    }
    bench.put("data/.setup/set.tar.gz.part", &[7; 1000]);
    let mut wrong = bench.archive.clone();
    wrong[200_000] ^= 1;
    let server = Server::start(&wrong, |_| Answer::Whole);
    let error = bench.fetch(&server.origin()).unwrap_err();
    assert!(matches!(error, DataError::WrongSum { .. }), "{error}");
    assert_eq!(server.requests().len(), 2);
    assert!(bench.all().is_empty(), "{:?}", bench.all());
}

#[test]
fn a_server_that_knows_no_ranges_is_listened_to_from_the_start() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |request| match request {
        0 => Answer::Cut(100_000),
        _ => Answer::WithoutRange,
    });
    let events = bench.fetch(&server.origin()).unwrap();
    assert_eq!(starts(&events), [0, 0]);
    assert!(bench.is_installed());
}

#[test]
fn a_range_that_was_not_asked_for_is_not_appended() {
    let bench = Bench::new();
    bench.put("data/.setup/set.tar.gz.part", &bench.archive[..1000]);
    let server = Server::start(&bench.archive, |request| match request {
        0 => Answer::RangeFrom(500),
        _ => Answer::Whole,
    });
    let events = bench.fetch(&server.origin()).unwrap();
    assert_eq!(starts(&events), [0]);
    assert!(bench.is_installed());
}

#[test]
fn a_server_without_the_file_is_asked_once_and_the_error_says_what_to_do() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |_| Answer::Status("404 Not Found"));
    let error = bench.fetch(&server.origin()).unwrap_err();
    let text = error.to_string();
    assert!(text.contains("404"), "{text}");
    assert!(text.contains("no data set was changed"), "{text}");
    assert!(text.contains(&format!("{}/set.tar.gz", server.base())), "{text}");
    let hint = error.hint();
    assert!(hint.contains("ARNOLD_MIRROR"), "{hint}");
    assert!(hint.contains("`arnold-analyze setup --set --from DIR`"), "{hint}");
    assert_eq!(server.requests().len(), 1);
    assert!(bench.all().is_empty(), "{:?}", bench.all());
}

#[test]
fn a_server_that_is_busy_is_asked_again_and_one_that_stays_so_is_left() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |request| match request {
        0 => Answer::Status("503 Service Unavailable"),
        1 => Answer::Status("429 Too Many Requests"),
        _ => Answer::Whole,
    });
    let events = bench.fetch(&server.origin()).unwrap();
    assert_eq!(count(&events, |event| matches!(event, DataEvent::Retrying { .. })), 2);
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |_| Answer::Status("503 Service Unavailable"));
    let text = bench.fetch(&server.origin()).unwrap_err().to_string();
    assert!(text.contains("(tried 3 times)"), "{text}");
    assert_eq!(server.requests().len(), 3);
}

#[test]
fn redirects_are_followed_with_the_range_and_not_for_ever() {
    let bench = Bench::new();
    bench.put("data/.setup/set.tar.gz.part", &bench.archive[..1000]);
    let server = Server::start(&bench.archive, |request| match request {
        0 => Answer::Redirect("/elsewhere"),
        _ => Answer::Whole,
    });
    let events = bench.fetch(&server.origin()).unwrap();
    assert_eq!(starts(&events), [1000]);
    assert_eq!(server.requests()[1], "/elsewhere bytes=1000-");
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |_| Answer::Redirect("/again"));
    let error = bench.fetch(&server.origin()).unwrap_err();
    assert!(matches!(error, DataError::Refused { .. }), "{error}");
    assert!(server.requests().len() <= 7, "{:?}", server.requests());
}

#[test]
fn a_file_of_another_size_is_refused_before_it_is_fetched() {
    let bench = Bench::new();
    let server = Server::start(&[bench.archive.as_slice(), b"more"].concat(), |_| Answer::Whole);
    let text = bench.fetch(&server.origin()).unwrap_err().to_string();
    assert!(
        text.contains(&format!("the file there has {} bytes", bench.archive.len() + 4)),
        "{text}"
    );
    assert!(bench.all().is_empty(), "{:?}", bench.all());
}

#[test]
fn a_server_that_goes_on_for_ever_is_stopped_at_the_size_of_the_file() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |_| Answer::Endless);
    let text = bench.fetch(&server.origin()).unwrap_err().to_string();
    assert!(text.contains("sends more than the file"), "{text}");
    assert!(!bench.path("data/set").exists());
}

#[test]
fn a_server_that_says_nothing_is_left_after_the_time_it_has() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |_| Answer::Silence);
    let start = Instant::now();
    let error = bench.fetch(&server.origin()).unwrap_err();
    assert!(matches!(error, DataError::Unreachable { attempts: 3, .. }), "{error}");
    assert!(start.elapsed() < Duration::from_secs(5), "{:?}", start.elapsed());
}

#[test]
fn where_nobody_listens_the_error_says_what_was_tried_and_what_to_do() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |_| Answer::Whole);
    let origin = server.origin();
    drop(server);
    let error = bench.fetch(&origin).unwrap_err();
    assert!(matches!(error, DataError::Unreachable { attempts: 3, kept: 0, .. }), "{error}");
    assert!(error.hint().contains("ARNOLD_MIRROR"));
}

#[test]
fn files_that_are_there_already_stay_if_they_are_the_same_and_nothing_moves_if_one_is_not() {
    let bench = Bench::new();
    bench.put("data/set/a.xml", b"a");
    bench.put("data/set/own.txt", b"mine");
    let events = bench.fetch(&bench.mirror()).unwrap();
    assert!(
        matches!(events.last(), Some(DataEvent::Installed { files: 2, kept: 1, .. })),
        "{events:?}"
    );
    assert_eq!(std::fs::read(bench.path("data/set/own.txt")).unwrap(), b"mine");
    let bench = Bench::new();
    bench.put("data/set/meshes/b.stl", b"another");
    let error = bench.fetch(&bench.mirror()).unwrap_err();
    assert!(matches!(error, DataError::Conflict { .. }), "{error}");
    assert!(error.to_string().contains("b.stl"), "{error}");
    assert_eq!(bench.all(), ["set/meshes/b.stl"]);
    let bench = Bench::new();
    bench.put("data/set/meshes", b"a file where a folder should be");
    let error = bench.fetch(&bench.mirror()).unwrap_err();
    assert!(matches!(error, DataError::Conflict { .. }), "{error}");
    assert_eq!(bench.all(), ["set/meshes"]);
}

#[test]
fn a_file_that_changed_is_named_and_never_replaced_and_one_that_is_gone_comes_back() {
    let bench = Bench::new();
    bench.fetch(&bench.mirror()).unwrap();
    bench.put("data/set/a.xml", b"b");
    let error = bench.fetch(&bench.mirror()).unwrap_err();
    assert!(matches!(error, DataError::Damaged { .. }), "{error}");
    assert!(error.to_string().contains("a.xml"), "{error}");
    assert_eq!(std::fs::read(bench.path("data/set/a.xml")).unwrap(), b"b");
    std::fs::remove_file(bench.path("data/set/a.xml")).unwrap();
    bench.fetch(&bench.mirror()).unwrap();
    assert!(bench.is_installed(), "{:?}", bench.all());
}

#[cfg(unix)]
#[test]
fn a_link_in_the_place_of_the_data_set_is_not_followed() {
    use std::os::unix::fs::symlink;
    for link in ["data/set", "data/set/meshes", "data/.setup", "data/.setup/set.tar.gz.part"] {
        let bench = Bench::new();
        std::fs::create_dir_all(bench.path("elsewhere")).unwrap();
        std::fs::create_dir_all(bench.path(link).parent().unwrap()).unwrap();
        symlink(bench.path("elsewhere"), bench.path(link)).unwrap();
        let server = Server::start(&bench.archive, |_| Answer::Whole);
        let error = bench.fetch(&server.origin()).unwrap_err();
        assert!(matches!(error, DataError::NotPlain { .. }), "{link}: {error}");
        assert_eq!(std::fs::read_dir(bench.path("elsewhere")).unwrap().count(), 0, "{link}");
        assert!(!bench.path("data/set/a.xml").exists(), "{link}");
    }
}

#[test]
fn an_archive_with_anything_else_inside_is_refused_whole() {
    for name in ["other/a", "set2/a"] {
        let bench = Bench::with(&[("set/a", b"1"), (name, b"2")]);
        let error = bench.fetch(&bench.mirror()).unwrap_err();
        assert!(matches!(error, DataError::BadArchive { .. }), "{error}");
        assert!(error.to_string().contains(name), "{error}");
        assert!(bench.all().is_empty(), "{:?}", bench.all());
    }
}

#[test]
fn of_several_files_all_come_or_none() {
    let bench = Bench::new();
    let sums = [files::sha256_hex(b"1"), files::sha256_hex(b"2")];
    let file = |name, sum| RemoteFile { name, bytes: 1, checksum: Checksum::Sha256(sum) };
    let files = [file("one.npy", &sums[0]), file("two.npy", &sums[1])];
    let set = DataSet { content: Content::Files, ..set_of(&files) };
    bench.put("mirror/one.npy", b"1");
    let origin = Origin::Folder(bench.path("mirror"));
    assert!(bench.fetch_set(&set, &origin).is_err());
    assert!(bench.all().is_empty(), "{:?}", bench.all());
    bench.put("mirror/two.npy", b"2");
    bench.fetch_set(&set, &origin).unwrap();
    assert_eq!(bench.all(), [".setup/set.json", "set/one.npy", "set/two.npy"]);
}

#[test]
fn programs_that_fetch_together_fetch_once() {
    let bench = Bench::new();
    let server = Server::start(&bench.archive, |_| Answer::Whole);
    let origin = server.origin();
    std::thread::scope(|scope| {
        for _ in 0..4 {
            scope.spawn(|| bench.fetch(&origin).unwrap());
        }
    });
    assert_eq!(server.requests().len(), 1);
    assert!(bench.is_installed());
}

/// The program with a data folder on the bench and no mirror.
fn command(bench: &Bench, arguments: &[&str]) -> Command {
    let mut command = Command::new(PROGRAM);
    command.arg("--data").arg(bench.path("data")).args(arguments);
    command.env_remove("ARNOLD_MIRROR").env_remove("ARNOLD_DATA").env_remove("ARNOLD_POLICY");
    command.env("ARNOLD_CACHE", bench.path("cache"));
    command
}

fn fails_with(code: i32, command: &mut Command) -> String {
    let output = command.output().unwrap();
    let text = String::from_utf8_lossy(&output.stderr).into_owned();
    assert_eq!(output.status.code(), Some(code), "{text}");
    text
}

#[test]
fn the_program_says_sizes_and_room_before_it_asks_the_mirror() {
    let bench = Bench::new();
    std::fs::create_dir(bench.path("mirror")).unwrap();
    let mut setup = command(&bench, &["setup", "--arnold"]);
    let text = fails_with(1, setup.env("ARNOLD_MIRROR", bench.path("mirror")));
    assert!(text.contains("checkpoints: 2.81 GB, Zenodo 21807280\n"), "{text}");
    assert!(text.contains("Together 3.42 GB, and at least as much again unpacked; "), "{text}");
    assert!(text.contains(" free in `"), "{text}");
    assert!(text.contains("error: no `arnold-final-checkpoints.tar.gz` in `"), "{text}");
    let mut setup = command(&bench, &["setup", "--arnold", "benchmarks,extra_results", "--from"]);
    let text = fails_with(1, setup.arg(bench.path("mirror")));
    assert!(text.contains("Together 3.2 MB"), "{text}");
    assert!(!text.contains("checkpoints:"), "{text}");
    let text = fails_with(2, &mut command(&bench, &["setup", "--arnold", "everything"]));
    assert!(text.contains("checkpoints, experts, benchmarks, extra_results"), "{text}");
}

#[test]
fn a_mirror_with_other_bytes_cannot_pass_them_for_the_published_ones() {
    let bench = Bench::with(&[("kinesis/xml/myolegs_onlylegs.xml", b"<mujoco/>")]);
    bench.put("mirror/kinesis.tar.gz", &bench.archive);
    let mut setup = command(&bench, &["setup", "--kinesis"]);
    let text = fails_with(1, setup.env("ARNOLD_MIRROR", bench.path("mirror")));
    assert!(text.contains("bytes, expected 13129926 bytes; it was not used"), "{text}");
    assert!(bench.all().is_empty(), "{:?}", bench.all());
}

#[test]
fn looking_for_a_data_set_that_is_not_there_names_the_command_and_creates_nothing() {
    let bench = Bench::new();
    let text = fails_with(1, &mut command(&bench, &["setup", "--emg", "--check"]));
    assert!(text.contains("the data set `emg` is not in `"), "{text}");
    assert!(text.ends_with("\n\nhint: run `arnold-analyze setup --emg`\n"), "{text}");
    assert!(!bench.path("data").exists());
}

#[test]
fn the_doctor_lists_every_data_set_with_its_command_and_calls_none_broken() {
    let bench = Bench::new();
    bench.put("data/kinesis/xml/own.xml", b"mine");
    let output = command(&bench, &["doctor", "--json"]).output().unwrap();
    let document: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let findings = document["findings"].as_array().unwrap();
    let of = |name: &str| findings.iter().find(|finding| finding["what"] == name).unwrap();
    assert_eq!(of("data set kinesis")["state"], "unverified");
    assert_eq!(of("data set emg")["state"], "missing");
    assert_eq!(of("data set emg")["remedy"], "run `arnold-analyze setup --emg`");
    let remedy = of("data set checkpoints")["remedy"].as_str().unwrap();
    assert_eq!(remedy, "run `arnold-analyze setup --arnold checkpoints`");
    assert!(findings.iter().all(|finding| finding["broken"] == false));
}

#[cfg(unix)]
#[test]
fn a_program_that_is_killed_while_it_fetches_is_continued_by_the_next() {
    let bench = Bench::new();
    // Of the right size, so that it is fetched; of the wrong sum, so that it is not used.
    let published = noise(13_129_926);
    let server = Server::start(&published, |request| match request {
        0 => Answer::Stall(5_000_000),
        _ => Answer::Whole,
    });
    let mut setup = command(&bench, &["setup", "--kinesis"]);
    setup.env("ARNOLD_MIRROR", server.base()).stdout(Stdio::null()).stderr(Stdio::null());
    let mut process = setup.spawn().unwrap();
    let part = bench.path("data/.setup/kinesis.tar.gz.part");
    let size = || std::fs::metadata(&part).map_or(0, |metadata| metadata.len());
    let start = Instant::now();
    while size() < 5_000_000 && start.elapsed() < Duration::from_secs(20) {
        std::thread::sleep(Duration::from_millis(10));
    }
    process.kill().unwrap();
    process.wait().unwrap();
    assert_eq!(size(), 5_000_000);
    let mut setup = command(&bench, &["setup", "--kinesis"]);
    let text = fails_with(1, setup.env("ARNOLD_MIRROR", server.base()));
    assert!(text.contains("Fetching the rest of 13.1 MB after 5.0 MB"), "{text}");
    assert!(text.contains("has MD5 "), "{text}");
    let asked = server.requests();
    // The rest does not make the published file, so it is fetched anew once, and refused.
    assert_eq!(asked[1..], ["/base/kinesis.tar.gz bytes=5000000-", "/base/kinesis.tar.gz "]);
    assert!(bench.all().is_empty(), "{:?}", bench.all());
}

/// A copy of the published human EMG, if this machine has one: `$ARNOLD_EMG`.
#[test]
fn the_published_emg_is_what_the_catalogue_says() {
    let Some(folder) = std::env::var_os("ARNOLD_EMG") else {
        eprintln!("skipped: ARNOLD_EMG names no folder with the published files");
        return;
    };
    let bench = Bench::new();
    let mut setup = command(&bench, &["setup", "--emg", "--from"]);
    let mut log = std::io::stderr();
    let output = setup.arg(folder).output().unwrap();
    log.write_all(&output.stderr).unwrap();
    assert_eq!(output.status.code(), Some(0));
    assert_eq!(bench.all().iter().filter(|name| name.starts_with("emg/")).count(), 10);
}

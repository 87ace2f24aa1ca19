//! Hostile files: each gives its own typed error, within a second of processor time and 256 MiB of memory, and nothing
//! in it runs. `tests/hostile/make_corpus.py` makes the files; each is read here by the library, and once more by a
//! process of its own that is measured. Beside them: good files cut short, changed at random, and made at random.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "hostile/build.rs"]
#[allow(dead_code, reason = "only some of the pieces are needed here")]
mod build;
#[path = "hostile/corpus.rs"]
mod corpus;

use std::collections::BTreeMap;
use std::io::Write;
use std::path::Path;
use std::process::Stdio;

use arnold_analyze::npz::{self, Arrays, Elements};
use arnold_analyze::policy::checkpoint::contents::{Checkpoint, Format, Normaliser};
use arnold_analyze::policy::checkpoint::{self, CheckpointError, Limits};
use arnold_analyze::policy::vocabulary::Vocabulary;
use build::*;
use corpus::{CORPUS, Entry, MARKER, python, script};
use proptest::prelude::*;
use serde_json::Value;

/// Most resident memory of a process that reads one file, and its limit on address space.
const MEMORY: u64 = 256 << 20;

fn read_policy(bytes: &[u8]) -> Result<Checkpoint, CheckpointError> {
    checkpoint::read_checkpoint(bytes, &Limits::default())
}

fn read_normaliser(bytes: &[u8]) -> Result<Normaliser, CheckpointError> {
    checkpoint::read_normaliser(bytes, &Limits::default())
}

/// What the reader called `reader` says about `bytes`: nothing, or the error as a value and as a message.
fn refusal(reader: &str, bytes: &[u8]) -> Option<(String, String)> {
    fn both<T, E: std::fmt::Debug + ToString>(result: Result<T, E>) -> Option<(String, String)> {
        result.err().map(|error| (format!("{error:?}"), error.to_string()))
    }
    match reader {
        "policy" => both(read_policy(bytes)),
        "normaliser" => both(read_normaliser(bytes)),
        "scaler" => both(checkpoint::read_scaler(bytes, &Limits::default())),
        "npy" => both(npz::parse_npy("a", bytes)),
        "npz" => both(Arrays::parse(bytes, 64 << 20, |_| true)),
        "vocabulary" => both(Vocabulary::from_json(bytes)),
        "safetensors" => both(checkpoint::embedded(bytes, &Limits::default())),
        "arguments" => both(checkpoint::read_arguments(bytes)),
        other => panic!("no reader is called {other}"),
    }
}

#[test]
fn the_corpus_is_large_and_the_same_every_time() {
    let refused = CORPUS.entries.iter().filter(|entry| entry.error.is_some()).count();
    assert!(refused >= 350, "only {refused} hostile files");
    for reader in
        ["policy", "normaliser", "scaler", "safetensors", "npy", "npz", "vocabulary", "arguments"]
    {
        assert!(CORPUS.entries.iter().any(|entry| entry.reader == reader), "{reader}");
    }
    let again = tempfile::tempdir().unwrap();
    script(&["write", again.path().to_str().unwrap()]);
    for entry in &CORPUS.entries {
        let bytes = std::fs::read(again.path().join(&entry.file)).unwrap();
        assert!(bytes == CORPUS.read(entry), "{} differs", entry.file);
    }
}

#[test]
fn the_payloads_run_when_python_opens_them() {
    let said = script(&["check"]).stdout;
    let said = String::from_utf8(said).unwrap();
    let live: usize = said.split(' ').next().unwrap().parse().unwrap();
    assert!(live >= 40, "{said}");
}

#[test]
fn each_hostile_file_gives_its_own_typed_error_and_nothing_runs() {
    let mut wrong = Vec::new();
    for Entry { file, attacks, reader, error, says } in &CORPUS.entries {
        let bytes = std::fs::read(CORPUS.folder().join(file)).unwrap();
        let mut complain = |what: String| wrong.push(format!("{file} ({attacks}): {what}"));
        let (value, message) = match (refusal(reader, &bytes), error) {
            (None, None) => continue,
            (None, Some(_)) => {
                complain("was accepted".to_owned());
                continue;
            }
            (Some((value, _)), None) => {
                complain(format!("was refused: {value}"));
                continue;
            }
            (Some(found), Some(_)) => found,
        };
        // The variants must follow one another in the printed value.
        let mut rest = value.as_str();
        for variant in error.iter().flat_map(|error| error.split('/')) {
            match rest.split_once(variant) {
                Some((_, after)) => rest = after,
                None => complain(format!("expected {error:?}, got {value}")),
            }
        }
        for part in says.iter().filter(|part| !message.contains(*part)) {
            complain(format!("no `{part}` in: {message}"));
        }
        if message.len() > 600 || message.chars().any(char::is_control) {
            complain(format!("is no message for a terminal: {message:?}"));
        }
    }
    assert!(wrong.is_empty(), "{} files:\n{}", wrong.len(), wrong.join("\n"));
    assert!(!Path::new(MARKER).exists());
}

/// What `measure.py` says about one process.
struct Measured {
    code: i64,
    processor_seconds: f64,
    peak_bytes: u64,
    said: String,
}

/// Runs `command` once per word, each in its own process within [`MEMORY`].
fn measured(command: &[&str], words: &[String]) -> Vec<Measured> {
    let mut child = python("measure.py")
        .arg(MEMORY.to_string())
        .args(command)
        // With physics installed, `inspect` also builds every body to say which tasks a good policy fits.
        .env("ARNOLD_CACHE", CORPUS.folder().join("no-cache"))
        .current_dir(CORPUS.folder())
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    child.stdin.take().unwrap().write_all(words.join("\n").as_bytes()).unwrap();
    let ended = child.wait_with_output().unwrap();
    assert!(ended.status.success());
    let lines = String::from_utf8(ended.stdout).unwrap();
    let measured = lines.lines().map(|line| {
        let line: Value = serde_json::from_str(line).unwrap();
        Measured {
            code: line["code"].as_i64().unwrap(),
            processor_seconds: line["processor_seconds"].as_f64().unwrap(),
            peak_bytes: line["peak_bytes"].as_u64().unwrap(),
            said: line["stderr"].as_str().unwrap().to_owned(),
        }
    });
    measured.collect()
}

/// Checks time and memory of each process, and prints the worst.
fn within_bounds(entries: &[&Entry], measured: &[Measured]) {
    assert_eq!(entries.len(), measured.len());
    let wrong: Vec<String> = entries
        .iter()
        .zip(measured)
        .filter(|(_, m)| m.processor_seconds >= 1.0 || m.peak_bytes >= MEMORY)
        .map(|(entry, m)| {
            format!("{}: {} s, {} bytes", entry.attacks, m.processor_seconds, m.peak_bytes)
        })
        .collect();
    let by_time = |a: &&(&&Entry, &Measured), b: &&(&&Entry, &Measured)| {
        a.1.processor_seconds.total_cmp(&b.1.processor_seconds)
    };
    let pairs: Vec<(&&Entry, &Measured)> = entries.iter().zip(measured).collect();
    let (slowest, time) = pairs.iter().max_by(by_time).unwrap();
    let (largest, memory) = pairs.iter().max_by_key(|(_, m)| m.peak_bytes).unwrap();
    eprintln!("{} processes", pairs.len());
    eprintln!("slowest: {:.3} s, {}", time.processor_seconds, slowest.attacks);
    eprintln!("largest: {} MiB, {}", memory.peak_bytes >> 20, largest.attacks);
    assert!(wrong.is_empty(), "\n{}", wrong.join("\n"));
}

#[test]
fn the_program_refuses_each_hostile_file_within_a_second_and_256_mib() {
    let inspected = |entry: &&Entry| matches!(&entry.reader[..], "policy" | "normaliser");
    let entries: Vec<&Entry> = CORPUS.entries.iter().filter(inspected).collect();
    let words: Vec<String> = entries.iter().map(|entry| entry.file.clone()).collect();
    let before = names_in(CORPUS.folder());
    let results = measured(&[env!("CARGO_BIN_EXE_arnold-analyze"), "inspect"], &words);
    for (entry, Measured { code, said, .. }) in entries.iter().zip(&results) {
        let Entry { file, attacks, error, .. } = entry;
        // `inspect` recognises both kinds of file: what is only in the wrong place is read.
        let misplaced = matches!(error.as_deref(), Some("NotANormaliser" | "NotAPolicy"));
        if error.is_none() || misplaced && *code == 0 {
            assert_eq!((*code, &said[..]), (0, ""), "{attacks}");
            continue;
        }
        assert_eq!(*code, 1, "{attacks}: {said}");
        let count = |start: &str| said.lines().filter(|line| line.starts_with(start)).count();
        assert_eq!((count("error: "), count("hint: ")), (1, 1), "{attacks}: {said}");
        assert!(said.contains(&format!("`{file}`")), "{attacks}: {said}");
        let controls = said.chars().any(|c| c.is_control() && c != '\n');
        assert!(!controls && said.len() < 2_000, "{attacks}: {said:?}");
    }
    assert_eq!(names_in(CORPUS.folder()), before, "something was written");
    within_bounds(&entries, &results);
}

#[test]
fn the_library_refuses_each_hostile_array_and_vocabulary_within_a_second_and_256_mib() {
    let read_here = |entry: &&Entry| !matches!(&entry.reader[..], "policy" | "normaliser");
    let entries: Vec<&Entry> = CORPUS.entries.iter().filter(read_here).collect();
    let words: Vec<String> =
        entries.iter().map(|entry| format!("{} {}", entry.reader, entry.file)).collect();
    let this = std::env::current_exe().unwrap();
    let alone = "reads_the_file_that_is_its_last_argument";
    let options = ["--ignored", "--exact", "--test-threads=1", alone];
    let results = measured(&[&[this.to_str().unwrap()], &options[..]].concat(), &words);
    for (entry, Measured { code, said, .. }) in entries.iter().zip(&results) {
        assert_eq!(*code, 0, "{}: {said}", entry.attacks);
    }
    within_bounds(&entries, &results);
}

#[test]
#[ignore = "run by the test above, in one process per file"]
fn reads_the_file_that_is_its_last_argument() {
    // The test harness takes it for the name of one more test, which there is not.
    let words = std::env::args().next_back().unwrap();
    let (reader, file) = words.split_once(' ').unwrap();
    drop(refusal(reader, &std::fs::read(file).unwrap()));
}

fn names_in(folder: &Path) -> Vec<std::ffi::OsString> {
    let entries = std::fs::read_dir(folder).unwrap();
    let mut names: Vec<_> = entries.map(|entry| entry.unwrap().file_name()).collect();
    names.sort();
    names
}

#[test]
fn the_good_files_are_read() {
    let good: BTreeMap<&str, Vec<u8>> = CORPUS
        .entries
        .iter()
        .filter(|entry| entry.attacks.starts_with("nothing: "))
        .map(|entry| (&entry.attacks["nothing: ".len()..], CORPUS.read(entry)))
        .collect();
    for policy in [good_policy(), good["a policy"].clone()] {
        let policy = read_policy(&policy).unwrap();
        let weight = &policy.tensors["action_net.weight"].data[..];
        assert_eq!((policy.format, weight), (Format::PpoMlp, &[1.0; 3][..]));
        assert_eq!(policy.scalars.training_steps, Some(7));
    }
    let policy = read_policy(&good["a policy stored column by column"]).unwrap();
    assert_eq!(policy.tensors["action_net.weight"].data, [0.0, 3.0, 1.0, 4.0, 2.0, 5.0]);
    for policy in [good_gradient_policy(), good["an NPG policy"].clone()] {
        let policy = read_policy(&policy).unwrap();
        let shape = &policy.tensors["fc_layers.0.weight"].shape[..];
        assert_eq!((policy.format, shape), (Format::NpgMlp, &[3, 2][..]));
    }
    for normaliser in [good_component_normaliser(), good["a normaliser by component"].clone()] {
        let Normaliser::PerComponent(read) = read_normaliser(&normaliser).unwrap() else {
            panic!("wrong kind")
        };
        assert_eq!((read.mean, read.variance), (vec![0.0, 1.0, -2.0], vec![1.0, 0.5, 4.0]));
    }
    for normaliser in [good_signature_normaliser(), good["a normaliser by signature"].clone()] {
        let Normaliser::PerSignature(read) = read_normaliser(&normaliser).unwrap() else {
            panic!("wrong kind")
        };
        assert_eq!(read.signatures, [vec![0], vec![5, 130]]);
        assert!(read.enabled && read.lags == 3);
    }
}

/// The small good files.
fn good_files() -> [(&'static str, Vec<u8>); 4] {
    [
        ("policy", good_policy()),
        ("gradient policy", good_gradient_policy()),
        ("component normaliser", good_component_normaliser()),
        ("signature normaliser", good_signature_normaliser()),
    ]
}

#[test]
fn a_file_cut_short_anywhere_is_refused() {
    let is_read = |bytes: &[u8]| read_policy(bytes).is_ok() || read_normaliser(bytes).is_ok();
    for (name, bytes) in good_files() {
        assert!(is_read(&bytes), "{name}");
        for length in (0..bytes.len()).step_by(97).chain([bytes.len() - 1]) {
            assert!(!is_read(&bytes[..length]), "{name} cut to {length} bytes was accepted");
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 2_000, failure_persistence: None, ..ProptestConfig::default() })]

    #[test]
    fn random_bytes_never_panic(bytes in prop::collection::vec(any::<u8>(), 0..400)) {
        for start in [&b""[..], b"\x80\x04", b"PK\x03\x04"] {
            let bytes = [start, &bytes].concat();
            prop_assert!(read_policy(&bytes).is_err());
            prop_assert!(read_normaliser(&bytes).is_err());
        }
    }

    /// Opcodes that the machine knows, in random order: far more of them reach its inside than random bytes do.
    #[test]
    fn random_programs_never_panic(opcodes in prop::collection::vec(0..OPCODES.len(), 0..200)) {
        let program: Vec<u8> = opcodes.iter().flat_map(|&index| OPCODES[index]).copied().collect();
        prop_assert!(read_normaliser(&pickle(&program)).is_err());
        prop_assert!(read_policy(&policy_archive(&torch_file(&pickle(&program), &[]))).is_err());
    }

    /// What survives a mutation is still a normaliser or a policy that makes sense.
    #[test]
    fn random_changes_never_panic(
        which in 0..4_usize,
        changes in prop::collection::vec((any::<prop::sample::Index>(), any::<u8>()), 1..6),
        cut in any::<prop::sample::Index>(),
        inserted in prop::collection::vec(any::<u8>(), 0..4),
    ) {
        let mut bytes = good_files()[which].1.clone();
        for (index, value) in changes {
            let at = index.index(bytes.len());
            bytes[at] = value;
        }
        let at = cut.index(bytes.len());
        bytes.splice(at..at, inserted);
        if let Ok(policy) = read_policy(&bytes) {
            for tensor in policy.tensors.values() {
                prop_assert_eq!(tensor.data.len(), tensor.shape.iter().product::<usize>());
                prop_assert!(tensor.data.iter().all(|value| value.is_finite()));
            }
        }
        match read_normaliser(&bytes) {
            Ok(Normaliser::PerComponent(read)) => {
                prop_assert_eq!(read.mean.len(), read.variance.len());
                prop_assert!(read.variance.iter().all(|value| *value >= 0.0 && value.is_finite()));
            }
            Ok(Normaliser::PerSignature(read)) => {
                prop_assert_eq!(read.mean.len(), read.signatures.len() * read.lags);
                prop_assert_eq!(read.count.len(), read.signatures.len());
            }
            Err(_) => {}
        }
    }
}

/// Limits that small files can reach.
const SMALL: Limits = Limits {
    file_bytes: 1 << 16,
    memory: 1 << 16,
    opcodes: 2_000,
    stack: 500,
    memo_entries: 500,
    depth: 32,
    members: 50,
    member_bytes: 1 << 16,
    compression_ratio: 20,
};

/// A `.npy` file with any claims.
fn npy(element: &str, column_major: bool, shape: &[u64], data: &[u8]) -> Vec<u8> {
    let order = if column_major { "True" } else { "False" };
    let shape = shape.iter().map(|axis| format!("{axis}, ")).collect::<Vec<_>>().concat();
    let header =
        format!("{{'descr': '{element}', 'fortran_order': {order}, 'shape': ({shape}), }}\n");
    let length = u16::try_from(header.len()).unwrap().to_le_bytes();
    [b"\x93NUMPY\x01\x00", &length[..], header.as_bytes(), data].concat()
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 500, failure_persistence: None, ..ProptestConfig::default() })]

    /// Whatever the numbers are, they come out as they went in.
    #[test]
    fn weights_are_read_as_they_were_written(values in prop::collection::vec(-1e30_f32..1e30, 1..200)) {
        let count = i32::try_from(values.len()).unwrap();
        let storage: Vec<u8> = values.iter().flat_map(|value| value.to_le_bytes()).collect();
        let object = pickle(&named(&[("action_net.weight", vector("0", count))]));
        let policy = read_policy(&policy_archive(&torch_file(&object, &[("0", &storage)]))).unwrap();
        prop_assert_eq!(&policy.tensors["action_net.weight"].data, &values);
    }

    #[test]
    fn statistics_are_read_as_they_were_written(
        rows in prop::collection::vec((-1e30_f64..1e30, 0.0_f64..1e30), 1..100),
    ) {
        let (mean, variance): (Vec<f64>, Vec<f64>) = rows.into_iter().unzip();
        let shape = [i32::try_from(mean.len()).unwrap()];
        let file = component_normaliser(array(&shape, &mean), array(&shape, &variance));
        let Normaliser::PerComponent(read) = read_normaliser(&file).unwrap() else { panic!("wrong kind") };
        prop_assert_eq!((read.mean, read.variance), (mean, variance));
    }

    #[test]
    fn arrays_are_read_as_they_were_written(
        rows in 0..20_u64,
        columns in 0..20_u64,
        column_major in any::<bool>(),
    ) {
        // Element (i, j) holds its place in row-major order.
        let place = |flat: u64| match (column_major, rows, columns) {
            (true, 1.., 1..) => (flat % rows) * columns + flat / rows,
            _ => flat,
        };
        let data: Vec<u8> = (0..rows * columns).flat_map(|flat| place(flat).to_le_bytes()).collect();
        let file = npy("<i8", column_major, &[rows, columns], &data);
        let read = npz::parse_npy("a", &file).unwrap();
        let count = i64::try_from(rows * columns).unwrap();
        prop_assert_eq!(read.elements, Elements::I64((0..count).collect()));
        let packed = archive(&[("a.npy", &file)]);
        prop_assert_eq!(Arrays::parse(&packed, 1 << 20, |_| true).unwrap().0["a"].rows() as u64, rows);
    }

    #[test]
    fn claims_of_arrays_never_panic(
        element in prop::sample::select(vec!["<f8", "<f4", "|b1", "<i2", ">f8", "|O", "<c16"]),
        column_major in any::<bool>(),
        shape in prop::collection::vec(prop_oneof![0..5_u64, any::<u64>()], 0..4),
        data in prop::collection::vec(any::<u8>(), 0..64),
        cut in any::<prop::sample::Index>(),
    ) {
        let file = npy(element, column_major, &shape, &data);
        if let Ok(read) = npz::parse_npy("a", &file) {
            prop_assert_eq!(read.to_f64().len(), read.shape.iter().product::<usize>());
            let short = &file[..cut.index(file.len())];
            // Of an array that holds nothing, the header alone is the whole.
            prop_assert!(data.is_empty() || npz::parse_npy("a", short).is_err());
        }
        prop_assert!(Arrays::parse(&archive(&[("a.npy", &file)]), 32, |_| true).is_err());
    }

    /// Numbers of the directory and of the end of an archive, replaced by any other: where most lies are told.
    #[test]
    fn lies_in_a_directory_never_panic(
        lies in prop::collection::vec((any::<prop::sample::Index>(), prop_oneof![any::<u32>(), 0..300_u32]), 1..4),
        wide in any::<bool>(),
    ) {
        let mut bytes = good_policy();
        let start = central_header(&bytes, "data");
        for (index, lie) in lies {
            let at = start + index.index(bytes.len() - start - 3);
            let width = if wide { 4 } else { 2 };
            bytes[at..at + width].copy_from_slice(&lie.to_le_bytes()[..width]);
        }
        for limits in [SMALL, Limits::default()] {
            if let Ok(policy) = checkpoint::read_checkpoint(&bytes, &limits) {
                prop_assert_eq!(&policy.tensors["action_net.weight"].data[..], &[1.0; 3]);
            }
        }
    }

    /// Everything that is read fits into the memory that the limits allow, and a limit only ever refuses.
    #[test]
    fn what_is_read_fits_the_limits(
        counts in prop::collection::vec(1..6_000_i32, 1..6),
        memory in 0..200_000_u64,
    ) {
        let names: Vec<String> = (0..counts.len()).map(|k| format!("action_net.{k}")).collect();
        let keys: Vec<String> = (0..counts.len()).map(|k| k.to_string()).collect();
        let contents: Vec<Vec<u8>> =
            counts.iter().map(|&count| ones(usize::try_from(count).unwrap())).collect();
        let tensors: Vec<(&str, Code)> = names
            .iter()
            .zip(&keys)
            .zip(&counts)
            .map(|((name, key), &count)| (&name[..], vector(key, count)))
            .collect();
        let storages: Vec<(&str, &[u8])> =
            keys.iter().zip(&contents).map(|(key, content)| (&key[..], &content[..])).collect();
        let file = policy_archive(&torch_file(&pickle(&named(&tensors)), &storages));
        let freely = read_policy(&file).unwrap();
        let limits = Limits { memory, ..Limits::default() };
        match checkpoint::read_checkpoint(&file, &limits) {
            Ok(policy) => {
                let held: usize = policy.tensors.values().map(|tensor| 4 * tensor.data.len()).sum();
                prop_assert!(held as u64 <= memory, "{} bytes of {}", held, memory);
                prop_assert_eq!(policy.tensors, freely.tensors);
            }
            Err(error) => prop_assert!(error.to_string().contains("more than the limit"), "{}", error),
        }
    }
}

/// One spelling of most opcodes that the machine knows.
const OPCODES: &[&[u8]] = &[
    b"N",
    b"\x88",
    b"\x89",
    b"K\x01",
    b"J\xff\xff\xff\xff",
    b"M\x00\x01",
    b"\x8a\x01\x7f",
    b"G\0\0\0\0\0\0\0\0",
    b"\x8c\x01a",
    b"X\x01\0\0\0b",
    b"C\x01c",
    b"B\x01\0\0\0d",
    b")",
    b"\x85",
    b"\x86",
    b"\x87",
    b"(",
    b"t",
    b"]",
    b"}",
    b"\x8f",
    b"\x91",
    b"a",
    b"e",
    b"\x90",
    b"s",
    b"u",
    b"0",
    b"1",
    b"2",
    b"p0\n",
    b"q\x00",
    b"\x94",
    b"g0\n",
    b"h\x00",
    b"h\x01",
    b"cnumpy\ndtype\n",
    b"ccollections\nOrderedDict\n",
    b"R",
    b"\x81",
    b"b",
    b"Q",
    b"\x93",
];

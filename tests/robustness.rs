//! Hostile checkpoints: each gives its own typed error, within a second and the memory limit, and nothing runs. The
//! cases are in `tests/hostile`; here are the good files they are made from, cut short and changed at random.

#![expect(clippy::unwrap_used, reason = "a test fails by panicking")]

#[path = "hostile/mod.rs"]
mod hostile;

use arnold_analyze::policy::checkpoint::contents::{Checkpoint, Format, Normaliser};
use arnold_analyze::policy::checkpoint::{self, CheckpointError, Limits};
use hostile::build::*;
use proptest::prelude::*;

fn read_policy(bytes: &[u8]) -> Result<Checkpoint, CheckpointError> {
    checkpoint::read_checkpoint(bytes, &Limits::default())
}

fn read_normaliser(bytes: &[u8]) -> Result<Normaliser, CheckpointError> {
    checkpoint::read_normaliser(bytes, &Limits::default())
}

#[test]
fn the_good_files_are_read() {
    let policy = read_policy(&good_policy()).unwrap();
    assert_eq!(
        (policy.format, &policy.tensors["action_net.weight"].data[..]),
        (Format::PpoMlp, &[1.0; 3][..])
    );
    assert_eq!(policy.scalars.training_steps, Some(7));
    let policy = read_policy(&good_gradient_policy()).unwrap();
    assert_eq!(
        (policy.format, &policy.tensors["fc_layers.0.weight"].shape[..]),
        (Format::NpgMlp, &[3, 2][..])
    );
    let Normaliser::PerComponent(read) = read_normaliser(&good_component_normaliser()).unwrap()
    else {
        panic!("wrong kind")
    };
    assert_eq!((read.mean, read.variance), (vec![0.0, 1.0, -2.0], vec![1.0, 0.5, 4.0]));
    let Normaliser::PerSignature(read) = read_normaliser(&good_signature_normaliser()).unwrap()
    else {
        panic!("wrong kind")
    };
    assert_eq!(read.signatures, [vec![0], vec![5, 130]]);
    assert!(read.enabled && read.lags == 3);
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

//! Pickles that would run something, that grow without end, or that are malformed.

use arnold_analyze::policy::checkpoint::{
    CheckpointError, EmbeddedTensorError, LimitExceeded, PickleError,
};

use super::build::*;
use super::case::{check_normalisers, check_policies};

#[test]
fn programs_in_a_pickle_are_refused_by_name_and_never_run() {
    let folder = tempfile::tempdir().unwrap();
    let marker = folder.path().join("executed");
    let command = format!("touch {}", marker.display());
    let system = call("os.system", &[text(&command)]);
    check_normalisers(vec![
        case!("os.system alone", pickle(&system),
            pickle_error!(PickleError::UnknownGlobal { name, offset: 2 }) if name == "os.system"),
        case!("os.system among the attributes", smuggled(&system),
            pickle_error!(PickleError::UnknownGlobal { name, .. }) if name == "os.system"),
        case!("a global hidden in a text of two parts",
            smuggled(&[text("numpy"), text("core.multiarray.scalar"), b"\x93".to_vec()].concat()),
            pickle_error!(PickleError::UnknownGlobal { name, .. }) if name == "numpy.core.multiarray.scalar"),
        case!(
            "a global whose module is computed",
            smuggled(&[call("numpy.dtype", &[]), text("x"), b"\x93".to_vec()].concat()),
            pickle_error!(PickleError::WrongOperand { operation: "STACK_GLOBAL", .. })
        ),
        case!(
            "calling the result of a call",
            smuggled(&[call("numpy.dtype", &[]), tuple(&[]), b"R".to_vec()].concat()),
            pickle_error!(PickleError::WrongOperand { operation: "REDUCE", .. })
        ),
        case!(
            "a state on a name",
            smuggled(&[&global("numpy.ndarray")[..], &named(&[]), b"b"].concat()),
            pickle_error!(PickleError::WrongOperand { operation: "BUILD", .. })
        ),
        case!(
            "INST",
            smuggled(b"(ios\nsystem\n"),
            pickle_error!(PickleError::ForbiddenOpcode { opcode: b'i', .. })
        ),
        case!(
            "OBJ",
            smuggled(&[b"(", &global("numpy.ndarray")[..], b"o"].concat()),
            pickle_error!(PickleError::ForbiddenOpcode { opcode: b'o', .. })
        ),
        case!(
            "NEWOBJ_EX",
            smuggled(&[&global("numpy.ndarray")[..], b")}\x92"].concat()),
            pickle_error!(PickleError::ForbiddenOpcode { opcode: 0x92, .. })
        ),
        case!(
            "EXT1",
            smuggled(b"\x82\x01"),
            pickle_error!(PickleError::ForbiddenOpcode { opcode: 0x82, .. })
        ),
        case!(
            "a persistent id where none belongs",
            smuggled(&[&text("x")[..], b"Q"].concat()),
            pickle_error!(PickleError::ForbiddenOpcode { opcode: b'Q', .. })
        ),
        case!("a name that would rewrite the terminal", smuggled(b"c\x1b[2J\nx\n"),
            pickle_error!(PickleError::UnknownGlobal { name, .. }) if !name.contains('\x1b')),
    ]);
    let load = |global: &str| call(global, &[bytes(b"")]);
    check_policies(vec![
        case!("os.system instead of a policy", pickle(&system),
            pickle_error!(PickleError::UnknownGlobal { name, .. }) if name == "os.system"),
        case!("os.system instead of a weight", policy_with(system.clone()),
            pickle_error!(PickleError::UnknownGlobal { name, .. }) if name == "os.system"),
        case!("a pickle within the pickle", policy_with(load("torch.storage._load_from_bytes")),
            pickle_error!(PickleError::UnknownGlobal { name, .. }) if name == "torch.storage._load_from_bytes"),
        case!("getattr of something else",
            gradient_policy(embedded(&[2]), call("builtins.getattr", &[global("torch._C._VariableFunctions"), text("save")])),
            pickle_error!(PickleError::ForbiddenCall { name, .. }) if name == "builtins.getattr"),
        case!("os.system in an embedded stream",
            gradient_policy(embedded_stream(&[2], &pickle(&system)), tanh()),
            CheckpointError::EmbeddedTensor {
                fault: EmbeddedTensorError::Pickle(PickleError::UnknownGlobal { name, .. }), ..
            } if name == "os.system"),
        case!(
            "a normaliser instead of a policy",
            good_component_normaliser(),
            CheckpointError::NotAPolicy { .. }
        ),
    ]);
    assert!(!marker.exists());
}

#[test]
fn pickles_that_grow_without_end_reach_a_limit() {
    let deep_lists = [&b"\x80\x04"[..], &b"]".repeat(100_000), &b"a".repeat(99_999), b"."].concat();
    let deep_tuples = [&b"\x80\x04)"[..], &b"\x85".repeat(100_000), b"."].concat();
    let deep_state = {
        let depth = 1_000;
        let start = [&global("numpy.dtype")[..], b")R"].concat().repeat(depth);
        [b"\x80\x04", &start[..], &b"b".repeat(depth - 1), b"."].concat()
    };
    // Each step makes a pair of the value before: 2^60 leaves if anyone unfolded it.
    let doubling =
        [&b"\x80\x04N\x94"[..], &b"\x94\x94".repeat(0), &b"2\x86".repeat(60), b"."].concat();
    check_normalisers(vec![
        case!(
            "lists in lists",
            deep_lists,
            pickle_error!(PickleError::Limit {
                fault: LimitExceeded { resource: "levels of nesting", .. },
                ..
            })
        ),
        case!(
            "tuples in tuples",
            deep_tuples,
            pickle_error!(PickleError::Limit {
                fault: LimitExceeded { resource: "levels of nesting", .. },
                ..
            })
        ),
        case!(
            "states in states",
            deep_state,
            pickle_error!(PickleError::Limit {
                fault: LimitExceeded { resource: "levels of nesting", .. },
                ..
            })
        ),
        case!("a value that doubles", doubling, CheckpointError::NotANormaliser { .. }),
        case!(
            "a list that holds itself",
            pickle(b"]\x94h\x00a"),
            pickle_error!(PickleError::Recursive)
        ),
        case!(
            "a dictionary that holds itself",
            pickle(b"}\x94Nh\x00s"),
            pickle_error!(PickleError::Recursive)
        ),
        case!(
            "a record that is its own state",
            pickle(&[&global("numpy.dtype")[..], b")R\x94h\x00b"].concat()),
            pickle_error!(PickleError::Recursive)
        ),
        case!(
            "a full memo",
            [&b"\x80\x04N"[..], &b"\x94".repeat(500_000), b"."].concat(),
            pickle_error!(PickleError::Limit {
                fault: LimitExceeded { resource: "values in the memo", .. },
                ..
            })
        ),
        case!(
            "a full stack",
            [&b"\x80\x04"[..], &b"N".repeat(500_000), b"."].concat(),
            pickle_error!(PickleError::Limit {
                fault: LimitExceeded { resource: "values on the stack", .. },
                ..
            })
        ),
        case!(
            "marks without end",
            [&b"\x80\x04"[..], &b"(".repeat(500_000), b"."].concat(),
            pickle_error!(PickleError::Limit {
                fault: LimitExceeded { resource: "open marks", .. },
                ..
            })
        ),
        case!(
            "opcodes without end",
            [&b"\x80\x04"[..], &b"N0".repeat(1_000_000), b"N."].concat(),
            pickle_error!(PickleError::Limit {
                fault: LimitExceeded { resource: "pickle opcodes", .. },
                ..
            })
        ),
        case!(
            "a list that is filled again and again",
            [&b"\x80\x04](NNNNNNNNt\x94"[..], &b"h\x00h\x00h\x00\x87".repeat(900_000), b"."]
                .concat(),
            pickle_error!(PickleError::Limit { .. })
        ),
    ]);
}

#[test]
fn malformed_pickles_are_refused() {
    let huge_text = [&b"\x8d"[..], &u64::MAX.to_le_bytes()].concat();
    let huge_frame = [&b"\x95"[..], &u64::MAX.to_le_bytes()].concat();
    let long_name = [b"c".as_slice(), &b"a".repeat(100_000)].concat();
    check_normalisers(vec![
        case!("nothing", Vec::new(), CheckpointError::UnknownFormat),
        case!("a text file", b"hello".to_vec(), CheckpointError::UnknownFormat),
        case!(
            "protocol 9",
            replaced(&good_component_normaliser(), b"\x80\x04", b"\x80\x09"),
            CheckpointError::UnknownFormat
        ),
        case!(
            "a protocol in the middle",
            smuggled(b"\x80\x04N"),
            pickle_error!(PickleError::UnsupportedProtocol { .. })
        ),
        case!("an empty pickle", pickle(b""), pickle_error!(PickleError::EmptyStack { .. })),
        case!(
            "two values",
            pickle(b"NN"),
            pickle_error!(PickleError::LeftoverValues { count: 1, .. })
        ),
        case!(
            "an open mark",
            pickle(b"(N0N"),
            pickle_error!(PickleError::EmptyStack { .. })
                | pickle_error!(PickleError::LeftoverValues { .. })
        ),
        case!(
            "popping below a mark",
            smuggled(b"(0)(\x85"),
            pickle_error!(PickleError::EmptyStack { .. })
        ),
        case!(
            "a value never kept",
            smuggled(b"j\xff\xff\xff\xff"),
            pickle_error!(PickleError::UnknownMemo { index: 0xffff_ffff, .. })
        ),
        case!(
            "a text of 2^64 bytes",
            smuggled(&huge_text),
            pickle_error!(PickleError::Truncated { .. } | PickleError::ImpossibleLength { .. })
        ),
        case!(
            "a text of -1 bytes",
            smuggled(b"T\xff\xff\xff\xff"),
            pickle_error!(PickleError::ImpossibleLength { length: -1, .. })
        ),
        case!(
            "a frame of 2^64 bytes",
            smuggled(&huge_frame),
            pickle_error!(PickleError::ImpossibleLength { .. })
        ),
        case!(
            "a text that is not UTF-8",
            smuggled(b"X\x01\x00\x00\x00\xff"),
            pickle_error!(PickleError::InvalidText { .. })
        ),
        case!(
            "a name without an end",
            smuggled(&long_name),
            pickle_error!(PickleError::InvalidText { .. })
        ),
        case!(
            "half a pair",
            smuggled(b"}(Nu"),
            pickle_error!(PickleError::WrongOperand { operation: "SETITEMS", .. })
        ),
        case!(
            "adding to a tuple",
            smuggled(b")Na"),
            pickle_error!(PickleError::WrongOperand { operation: "APPEND", .. })
        ),
        case!(
            "bytes after the end",
            [good_component_normaliser(), vec![0; 5]].concat(),
            pickle_error!(PickleError::TrailingBytes { count: 5, .. })
        ),
    ]);
}

//! torch tensors that do not fit their storage.

use arnold_analyze::policy::checkpoint::{
    ArchiveError, CheckpointError, EmbeddedTensorError, LimitExceeded, PickleError, TensorError,
};

use super::build::*;
use super::case::check_policies;

#[test]
#[expect(clippy::too_many_lines, reason = "a table of cases")]
fn tensors_that_do_not_fit_their_storage_are_refused() {
    let three = || storage("torch.FloatStorage", "0", int(3));
    let weight = |offset, shape: &[i64], strides: &[i64]| {
        policy_with(tensor(three(), offset, shape, strides))
    };
    let state = |weight: Code| pickle(&named(&[("action_net.weight", weight)]));
    check_policies(vec![
        case!(
            "one element too far",
            weight(1, &[3], &[1]),
            tensor_error!(TensorError::OutsideStorage { reached: 3, count: 3 })
        ),
        case!(
            "a stride too long",
            weight(0, &[2], &[3]),
            tensor_error!(TensorError::OutsideStorage { reached: 3, .. })
        ),
        case!(
            "a stride that overflows",
            weight(0, &[2, 1], &[i64::MAX, 1]),
            tensor_error!(TensorError::OutsideStorage { .. })
        ),
        case!(
            "a stride of zero over a huge shape",
            weight(0, &[1 << 40], &[0]),
            tensor_error!(TensorError::Overlapping { .. })
        ),
        case!(
            "a shape that overflows",
            weight(0, &[i64::MAX, i64::MAX], &[0, 0]),
            tensor_error!(TensorError::ImpossibleShape { .. })
        ),
        case!(
            "more axes than strides",
            weight(0, &[3, 1], &[1]),
            tensor_error!(TensorError::ImpossibleShape { .. })
        ),
        case!("a negative size", weight(0, &[-3], &[1]), tensor_error!(TensorError::Malformed(_))),
        case!(
            "a negative stride",
            weight(2, &[3], &[-1]),
            tensor_error!(TensorError::Malformed(_))
        ),
        case!(
            "a negative offset",
            weight(-1, &[3], &[1]),
            tensor_error!(TensorError::Malformed(_))
        ),
        case!(
            "a storage longer than its member",
            policy_with(vector("0", 1_000_000)),
            tensor_error!(TensorError::WrongLength { found: 12, .. })
        ),
        case!(
            "a storage that is not there",
            policy_with(vector("1", 3)),
            CheckpointError::Archive(ArchiveError::MissingMember { .. })
        ),
        case!(
            "a storage outside the archive",
            policy_with(vector("../../../etc/passwd", 3)),
            tensor_error!(TensorError::Malformed(_))
        ),
        case!(
            "a storage described in two ways",
            policy_archive(&torch_file(
                &pickle(&named(&[
                    ("action_net.a", vector("0", 3)),
                    ("action_net.b", vector("0", 2))
                ])),
                &[("0", &ones(3))]
            )),
            tensor_error!(TensorError::Malformed(_))
        ),
        case!(
            "one name twice",
            policy_archive(&torch_file(
                &pickle(&named(&[
                    ("action_net.a", vector("0", 3)),
                    ("action_net.a", vector("0", 3))
                ])),
                &[("0", &ones(3))]
            )),
            tensor_error!(TensorError::Duplicate)
        ),
        case!(
            "a storage of an unknown class",
            policy_with(tensor(storage("torch.QInt8Storage", "0", int(3)), 0, &[3], &[1])),
            pickle_error!(PickleError::UnknownGlobal { .. })
        ),
        case!(
            "a weight that is no number",
            policy_archive(&torch_file(
                &state(vector("0", 3)),
                &[("0", &f32::NAN.to_le_bytes().repeat(3))]
            )),
            tensor_error!(TensorError::NotFinite { index: 0, .. })
        ),
        case!(
            "a big-endian torch file",
            policy_archive(&torch_file_of("big", &state(vector("0", 3)), &[("0", &ones(3))])),
            tensor_error!(TensorError::BigEndian)
        ),
        case!(
            "a tensor name that would rewrite the terminal",
            policy_archive(&torch_file(
                &pickle(&named(&[("action_net.\x1b[2J", vector("0", 3))])),
                &[("0", &ones(3))]
            )),
            CheckpointError::Record { .. }
        ),
        case!(
            "a list instead of a state dictionary",
            policy_archive(&torch_file(&pickle(&list(&[])), &[])),
            CheckpointError::Record { .. }
        ),
        case!(
            "a number instead of a tensor",
            policy_with(int(3)),
            tensor_error!(TensorError::Malformed(_))
        ),
        case!(
            "an empty state dictionary",
            policy_archive(&torch_file(&pickle(&named(&[])), &[])),
            CheckpointError::UnknownNetwork { .. }
        ),
        case!(
            "a big-endian stream",
            gradient_policy(embedded_stream(&[2], &stream(false, 2, &ones(2))), tanh()),
            CheckpointError::EmbeddedTensor {
                fault: EmbeddedTensorError::Tensor(TensorError::BigEndian),
                ..
            }
        ),
        case!(
            "a stream that is too short",
            gradient_policy(embedded_stream(&[2], &stream(true, 2, &ones(1))), tanh()),
            CheckpointError::EmbeddedTensor {
                fault: EmbeddedTensorError::Tensor(TensorError::WrongLength { .. }),
                ..
            }
        ),
        case!(
            "a layer of another width",
            gradient_policy(embedded(&[4]), tanh()),
            tensor_error!(TensorError::WrongShape { .. })
        ),
        case!(
            "many names for one large storage",
            {
                let names: Vec<String> = (0..1_000).map(|k| format!("action_net.{k}")).collect();
                let count = 1 << 20;
                let tensors: Vec<(&str, Code)> =
                    names.iter().map(|name| (&name[..], vector("0", count))).collect();
                policy_archive(&torch_file(&pickle(&named(&tensors)), &[("0", &ones(1 << 20))]))
            },
            tensor_error!(TensorError::Limit(LimitExceeded { resource: "bytes of memory", .. }))
        ),
    ]);
}

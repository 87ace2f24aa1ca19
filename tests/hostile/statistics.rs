//! Normalisers whose arrays lie or whose numbers are impossible.

use arnold_analyze::policy::checkpoint::{CheckpointError, RecordError, TensorError};

use super::build::*;
use super::case::check_normalisers;

#[test]
fn statistics_that_no_training_produces_are_refused() {
    let ones = || array(&[3], &[1.0; 3]);
    let with_mean = |mean: Code| component_normaliser(mean, ones());
    let table = |words: Code, row: i32| {
        signature_normaliser(dictionary(&[(tuple(&[int(0)]), int(0)), (words, int(row))]))
    };
    check_normalisers(vec![
        case!(
            "a mean that is no number",
            with_mean(array(&[3], &[0.0, f64::NAN, 0.0])),
            CheckpointError::ImpossibleStatistic { index: 1, .. }
        ),
        case!(
            "an infinite variance",
            component_normaliser(ones(), array(&[3], &[1.0, 1.0, f64::INFINITY])),
            CheckpointError::ImpossibleStatistic { index: 2, .. }
        ),
        case!(
            "a negative variance",
            component_normaliser(ones(), array(&[3], &[-1e-9, 1.0, 1.0])),
            CheckpointError::ImpossibleStatistic { index: 0, .. }
        ),
        case!(
            "an epsilon of zero",
            replaced(&good_component_normaliser(), &float(1e-8), &float(0.0)),
            CheckpointError::ImpossibleStatistic { .. }
        ),
        case!(
            "a clip that is no number",
            replaced(&good_component_normaliser(), &float(10.0), &float(f64::NAN)),
            CheckpointError::ImpossibleStatistic { .. }
        ),
        case!(
            "a mean and a variance of different lengths",
            with_mean(array(&[2], &[0.0; 2])),
            tensor_error!(TensorError::WrongShape { .. })
        ),
        case!(
            "big-endian numbers",
            with_mean(raw_array(&[int(3)], dtype("f8", ">"), bytes(&[0; 24]))),
            tensor_error!(TensorError::BigEndian)
        ),
        case!(
            "big-endian in the type's name",
            with_mean(raw_array(&[int(3)], dtype(">f8", "|"), bytes(&[0; 24]))),
            tensor_error!(TensorError::BigEndian)
        ),
        case!(
            "an array of objects",
            with_mean(raw_array(&[int(3)], dtype("O8", "|"), list(&[none(), none(), none()]))),
            tensor_error!(TensorError::Malformed(RecordError::Unexpected { .. }))
        ),
        case!("an array of objects in bytes", with_mean(raw_array(&[int(3)], dtype("O8", "|"), bytes(&[0; 24]))),
            tensor_error!(TensorError::UnknownElementType { name }) if name == "O8"),
        case!(
            "a negative size",
            with_mean(raw_array(&[int(-3)], dtype("f8", "<"), bytes(&[0; 24]))),
            tensor_error!(TensorError::Malformed(_))
        ),
        case!(
            "more elements than bytes",
            with_mean(raw_array(&[long(1 << 60)], dtype("f8", "<"), bytes(&[0; 24]))),
            tensor_error!(TensorError::ImpossibleShape { .. } | TensorError::WrongLength { .. })
        ),
        case!(
            "a size that overflows",
            with_mean(raw_array(
                &[long(i64::MAX), long(i64::MAX)],
                dtype("f8", "<"),
                bytes(&[0; 24])
            )),
            tensor_error!(TensorError::ImpossibleShape { .. })
        ),
        case!("one row twice", table(tuple(&[int(5)]), 0), CheckpointError::Record { .. }),
        case!("a row beyond the last", table(tuple(&[int(5)]), 2), CheckpointError::Record { .. }),
        case!(
            "a word beyond all vocabularies",
            table(tuple(&[int(70_000)]), 1),
            CheckpointError::Record { .. }
        ),
        case!("half a word", table(tuple(&[float(1.5)]), 1), CheckpointError::Record { .. }),
        case!(
            "words that are not sorted",
            table(tuple(&[int(9), int(5)]), 1),
            CheckpointError::Record { .. }
        ),
        case!("a signature without words", table(tuple(&[]), 1), CheckpointError::Record { .. }),
    ]);
}

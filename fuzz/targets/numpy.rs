//! NumPy files: single arrays, and archives of them.

#![no_main]

use arnold_analyze::npz::{self, Arrays};
use arnold_analyze_fuzz::{check_message, within_memory};

/// Bytes of memory for what is read from one input.
const MEMORY: u64 = 1 << 20;

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let arrays = if bytes.starts_with(b"PK") {
        within_memory(MEMORY, || Arrays::parse(bytes, MEMORY, |_| true))
            .map(|arrays| arrays.0.into_values().collect())
    } else {
        // Up to eight bytes become of each.
        within_memory(16 * bytes.len() as u64, || npz::parse_npy("x", bytes))
            .map(|array| vec![array])
    };
    match arrays {
        Ok(arrays) => {
            for array in &arrays {
                let count: usize = array.shape.iter().product();
                assert_eq!(array.to_f64().len(), count);
            }
        }
        Err(error) => check_message(&error),
    }
});

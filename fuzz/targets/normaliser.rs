//! Normalisers: any pickle that states its protocol, read for its statistics.

#![no_main]

use arnold_analyze::policy::checkpoint;
use arnold_analyze_fuzz::{LIMITS, check_message, check_normaliser, within_memory};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    match within_memory(LIMITS.memory, || checkpoint::read_normaliser(bytes, &LIMITS)) {
        Ok(normaliser) => check_normaliser(&normaliser),
        Err(error) => check_message(&error),
    }
});

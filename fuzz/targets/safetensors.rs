//! safetensors files: the places of the arrays, the document in the header, weights and statistics.

#![no_main]

use arnold_analyze::policy::checkpoint;
use arnold_analyze_fuzz::{LIMITS, check_message, check_normaliser, check_policy, within_memory};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    match within_memory(LIMITS.memory, || checkpoint::read_checkpoint(bytes, &LIMITS)) {
        Ok(policy) => check_policy(&policy),
        Err(error) => check_message(&error),
    }
    match within_memory(LIMITS.memory, || checkpoint::embedded(bytes, &LIMITS)) {
        Ok(found) => found.and_then(|(normaliser, _)| normaliser).iter().for_each(check_normaliser),
        Err(error) => check_message(&error),
    }
});

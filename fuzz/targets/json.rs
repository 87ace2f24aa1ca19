//! The one JSON file beside a checkpoint that decides what its rows mean: `vocabulary.json`.

#![no_main]

use arnold_analyze::policy::vocabulary::Vocabulary;
use arnold_analyze_fuzz::{check_message, within_memory};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    // A word costs an entry of the map and of the list beside its own text.
    const BYTES_PER_BYTE: u64 = 64;
    let allowed = BYTES_PER_BYTE * bytes.len() as u64;
    match within_memory(allowed, || Vocabulary::from_json(bytes)) {
        Ok(vocabulary) => assert!(vocabulary.len() <= bytes.len()),
        Err(error) => check_message(&error),
    }
});

//! The JSON files beside a checkpoint: `vocabulary.json` decides what its rows mean, `args.json` what its tensors do not tell.

#![no_main]

use arnold_analyze::policy::checkpoint;
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
    if let Err(error) = within_memory(allowed, || checkpoint::read_arguments(bytes)) {
        check_message(&error);
    }
});

//! Zip archives as they come: the directory, the members, the torch files nested in them, the settings.

#![no_main]

use arnold_analyze::policy::checkpoint;
use arnold_analyze_fuzz::{LIMITS, check_message, check_policy, within_memory};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    match within_memory(LIMITS.memory, || checkpoint::read_checkpoint(bytes, &LIMITS)) {
        Ok(policy) => check_policy(&policy),
        Err(error) => check_message(&error),
    }
    match within_memory(LIMITS.memory, || checkpoint::list_globals(bytes, &LIMITS)) {
        Ok(pickles) => pickles
            .iter()
            .filter_map(|pickle| pickle.globals.as_ref().err())
            .for_each(check_message),
        Err(error) => check_message(&error),
    }
});

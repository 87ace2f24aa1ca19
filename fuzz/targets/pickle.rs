//! The pickle machine: any program, with every list of allowed names, and with none at all.

#![no_main]

use arnold_analyze::policy::checkpoint;
use arnold_analyze_fuzz::{LIMITS, check_message, check_normaliser, check_policy, within_memory};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let program = [b"\x80\x04", bytes].concat();
    match within_memory(LIMITS.memory, || checkpoint::list_globals(&program, &LIMITS)) {
        Ok(pickles) => pickles
            .iter()
            .filter_map(|pickle| pickle.globals.as_ref().err())
            .for_each(check_message),
        Err(error) => check_message(&error),
    }
    match within_memory(LIMITS.memory, || checkpoint::read_checkpoint(&program, &LIMITS)) {
        Ok(policy) => check_policy(&policy),
        Err(error) => check_message(&error),
    }
    match within_memory(LIMITS.memory, || checkpoint::read_normaliser(&program, &LIMITS)) {
        Ok(normaliser) => check_normaliser(&normaliser),
        Err(error) => check_message(&error),
    }
});

//! torch storages: the input is the pickle of a state dictionary in an archive that is otherwise well made, with one
//! storage of twelve numbers for it to lie about.

#![no_main]

use std::io::{Cursor, Write};

use arnold_analyze::policy::checkpoint;
use arnold_analyze_fuzz::{LIMITS, check_message, check_policy, within_memory};
use zip::write::{SimpleFileOptions, ZipWriter};

libfuzzer_sys::fuzz_target!(|bytes: &[u8]| {
    let Some(file) = torch_file(bytes) else { return };
    match within_memory(LIMITS.memory, || checkpoint::read_checkpoint(&file, &LIMITS)) {
        Ok(policy) => check_policy(&policy),
        Err(error) => check_message(&error),
    }
});

/// A torch file around `pickle`.
fn torch_file(pickle: &[u8]) -> Option<Vec<u8>> {
    let mut writer = ZipWriter::new(Cursor::new(Vec::new()));
    let storage = 1.0_f32.to_le_bytes().repeat(12);
    let members: [(&str, &[u8]); 3] = [
        ("archive/data.pkl", pickle),
        ("archive/byteorder", b"little"),
        ("archive/data/0", &storage),
    ];
    let options = SimpleFileOptions::default().compression_method(zip::CompressionMethod::Stored);
    for (name, content) in members {
        writer.start_file(name, options).ok()?;
        writer.write_all(content).ok()?;
    }
    Some(writer.finish().ok()?.into_inner())
}

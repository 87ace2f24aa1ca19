//! A hostile file, and the check that it gives its own error within a second and the memory limit.

use std::io::Write;
use std::sync::{Mutex, PoisonError};
use std::time::{Duration, Instant};

use arnold_analyze::policy::checkpoint::{self, CheckpointError, Limits};

/// A hostile file: what it is, its bytes, and what must be said about it.
pub(crate) struct Case {
    pub(crate) name: &'static str,
    pub(crate) bytes: Vec<u8>,
    pub(crate) is_expected: fn(&CheckpointError) -> bool,
}

macro_rules! case {
    ($name:literal, $bytes:expr, $($expected:tt)+) => {
        $crate::hostile::case::Case { name: $name, bytes: $bytes, is_expected: |error| matches!(error, $($expected)+) }
    };
}

/// Tests run side by side; time and memory are those of one file at a time.
static MEASURING: Mutex<()> = Mutex::new(());

/// Reads each file and checks the error, the time and the memory.
fn check(cases: Vec<Case>, read: impl Fn(&[u8]) -> Option<CheckpointError>) {
    // A file may take what the limit allows, plus itself and what the allocator keeps.
    const MARGIN: u64 = 160 << 20;
    for Case { name, bytes, is_expected } in cases {
        let _alone = MEASURING.lock().unwrap_or_else(PoisonError::into_inner);
        let before = reset_peak_memory();
        let start = Instant::now();
        let error = read(&bytes).unwrap_or_else(|| panic!("{name}: was accepted"));
        let elapsed = start.elapsed();
        assert!(is_expected(&error), "{name}: {error} ({error:?})");
        assert!(elapsed < Duration::from_secs(1), "{name}: took {elapsed:?}");
        if let (Some(before), Some(after)) = (before, peak_memory()) {
            let grown = after.saturating_sub(before);
            assert!(grown < Limits::default().memory + MARGIN, "{name}: took {grown} bytes");
        }
        let message = error.to_string();
        assert!(message.len() < 500 && !message.chars().any(char::is_control), "{name}: {message}");
    }
}

pub(crate) fn check_policies(cases: Vec<Case>) {
    check(cases, |bytes| checkpoint::read_checkpoint(bytes, &Limits::default()).err());
}

pub(crate) fn check_normalisers(cases: Vec<Case>) {
    check(cases, |bytes| checkpoint::read_normaliser(bytes, &Limits::default()).err());
}

/// Largest resident memory of this process so far, in bytes; `None` where the system does not say.
fn peak_memory() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    Some(1024 * line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()?)
}

/// Starts the count of the peak anew and returns it.
fn reset_peak_memory() -> Option<u64> {
    let mut file = std::fs::OpenOptions::new().write(true).open("/proc/self/clear_refs").ok()?;
    file.write_all(b"5").ok()?;
    peak_memory()
}

macro_rules! pickle_error {
    ($($pattern:tt)+) => { arnold_analyze::policy::checkpoint::CheckpointError::Pickle { fault: $($pattern)+, .. } };
}

macro_rules! tensor_error {
    ($($pattern:tt)+) => { arnold_analyze::policy::checkpoint::CheckpointError::Tensor { fault: $($pattern)+, .. } };
}

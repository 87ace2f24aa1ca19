//! What the fuzz targets share: limits that a small input can reach, an allocator that counts, and what must hold for
//! whatever the readers accept.
//!
//! A finding is a panic, an overflow, an input that takes ten seconds, or one that makes a reader hold more memory
//! than its limits allow.

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicUsize, Ordering::Relaxed};

use arnold_analyze::policy::checkpoint::Limits;
use arnold_analyze::policy::checkpoint::contents::{Checkpoint, Normaliser};

/// Limits of a megabyte, so that inputs of some kilobytes can cross them.
pub const LIMITS: Limits = Limits {
    file_bytes: 1 << 20,
    memory: 1 << 20,
    opcodes: 20_000,
    stack: 5_000,
    memo_entries: 5_000,
    depth: 64,
    members: 500,
    member_bytes: 1 << 20,
    compression_ratio: 200,
};

/// What a reader may hold beside what it is charged: buffers of fixed size (the inflater's window above all), messages,
/// and what the allocator rounds up.
const MARGIN: usize = 1 << 20;

/// The system's allocator, counting.
struct Counting;

static LIVE: AtomicUsize = AtomicUsize::new(0);
static PEAK: AtomicUsize = AtomicUsize::new(0);

// SAFETY: every call is passed on to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        let live = LIVE.fetch_add(layout.size(), Relaxed) + layout.size();
        PEAK.fetch_max(live, Relaxed);
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, place: *mut u8, layout: Layout) {
        LIVE.fetch_sub(layout.size(), Relaxed);
        unsafe { System.dealloc(place, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

/// Runs a reader and checks that it kept to the memory that it was given.
///
/// # Panics
///
/// When it did not.
pub fn within_memory<T>(allowed: u64, read: impl FnOnce() -> T) -> T {
    let before = LIVE.load(Relaxed);
    PEAK.store(before, Relaxed);
    let result = read();
    let held = PEAK.load(Relaxed).saturating_sub(before);
    let allowed = usize::try_from(allowed).unwrap_or(usize::MAX).saturating_add(MARGIN);
    assert!(held <= allowed, "held {held} bytes of memory, {allowed} are allowed");
    result
}

/// Checks a policy that was accepted.
///
/// # Panics
///
/// When it makes no sense.
pub fn check_policy(policy: &Checkpoint) {
    for (name, tensor) in &policy.tensors {
        assert_eq!(tensor.data.len(), tensor.shape.iter().product::<usize>(), "{name}");
        assert!(tensor.data.iter().all(|value| value.is_finite()), "{name}");
    }
    for (alias, original) in &policy.aliases {
        assert_eq!(policy.tensors[alias], policy.tensors[original]);
    }
    is_printable(policy.tensors.keys().chain(&policy.globals));
}

/// Checks a normaliser that was accepted.
///
/// # Panics
///
/// When it makes no sense.
pub fn check_normaliser(normaliser: &Normaliser) {
    let (epsilon, clip) = match normaliser {
        Normaliser::PerComponent(read) => {
            assert_eq!(read.mean.len(), read.variance.len());
            assert!(read.mean.iter().all(|value| value.is_finite()));
            assert!(read.variance.iter().all(|value| *value >= 0.0 && value.is_finite()));
            (read.epsilon, read.clip)
        }
        Normaliser::PerSignature(read) => {
            let rows = read.signatures.len();
            assert_eq!(
                (read.mean.len(), read.variance.len()),
                (rows * read.lags, rows * read.lags)
            );
            assert_eq!(read.count.len(), rows);
            assert!(read.mean.iter().all(|value| value.is_finite()));
            assert!(read.variance.iter().all(|value| *value >= 0.0 && value.is_finite()));
            assert!(read.signatures.iter().all(|words| words.is_sorted()));
            (read.epsilon, read.clip)
        }
    };
    assert!(epsilon > 0.0 && epsilon.is_finite() && clip > 0.0 && clip.is_finite());
}

/// Checks that a message can be shown to a person.
///
/// # Panics
///
/// When it would rewrite the terminal or fill it.
pub fn check_message(error: &impl std::fmt::Display) {
    let message = error.to_string();
    assert!(message.len() < 2_000, "a message of {} bytes", message.len());
    is_printable([&message]);
}

fn is_printable<'a>(texts: impl IntoIterator<Item = &'a String>) {
    for text in texts {
        assert!(!text.chars().any(char::is_control), "{text:?}");
    }
}

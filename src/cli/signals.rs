//! `SIGINT` (Ctrl-C) and `SIGTERM` (a scheduler): the first asks to end after the episodes in play, a second one ends at
//! once.

use std::io;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, OnceLock};

use signal_hook::consts::{SIGINT, SIGTERM};
use signal_hook::flag;

static ASKED: OnceLock<Arc<AtomicBool>> = OnceLock::new();

/// From here on both signals are heard.
pub fn listen() -> io::Result<()> {
    if ASKED.get().is_some() {
        return Ok(());
    }
    let asked = ASKED.get_or_init(Arc::default);
    for signal in [SIGINT, SIGTERM] {
        // In this order: a signal that finds the flag set ends the program, the first one only sets it.
        flag::register_conditional_shutdown(signal, 128 + signal, Arc::clone(asked))?;
        flag::register(signal, Arc::clone(asked))?;
    }
    Ok(())
}

/// Whether nobody asked to stop.
#[must_use]
pub fn go_on() -> bool {
    !ASKED.get().is_some_and(|asked| asked.load(Ordering::Relaxed))
}

//! Ctrl-C: the work under way ends at its next step, and what is finished is written.

use std::sync::atomic::{AtomicBool, Ordering};

use crate::failure::Failure;

static ASKED: AtomicBool = AtomicBool::new(false);

/// What a shell expects of a program that ended on SIGINT.
pub(crate) const EXIT_CODE: u8 = 130;

/// From here on, Ctrl-C (and SIGTERM) asks the work to end; a second one ends the process at once.
///
/// # Errors
/// If the system refuses a handler.
pub(crate) fn listen() -> Result<(), Failure> {
    let handler = || {
        if ASKED.swap(true, Ordering::Relaxed) {
            std::process::exit(i32::from(EXIT_CODE));
        }
        eprintln!("\nending: what is finished will be written (Ctrl-C again to drop it)");
    };
    ctrlc::set_handler(handler).map_err(|error| Failure::failed(format!("no handler for Ctrl-C: {error}")))
}

/// Whether the work was asked to end.
pub(crate) fn asked() -> bool {
    ASKED.load(Ordering::Relaxed)
}

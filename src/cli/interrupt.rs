//! Ctrl-C, and the system's request to end.

use impasto::Stop;

use super::console::note;

/// Exit code of programs that an interruption ended.
const INTERRUPTED: i32 = 130;

/// A stop that is requested by the first interruption; the second one leaves at once. `saying` tells
/// which of both does what.
pub fn stop(saying: &'static str) -> Stop {
    let stop = Stop::default();
    let requested = stop.clone();
    let handled = ctrlc::set_handler(move || {
        if requested.is_requested() {
            std::process::exit(INTERRUPTED);
        }
        requested.request();
        note(format_args!("\n{saying}"));
    });
    // Without a handler an interruption ends the program, as it always did.
    drop(handled);
    stop
}

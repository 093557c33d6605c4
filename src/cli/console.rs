//! What the user sees: the result on stdout, everything else on stderr.
//!
//! Failing writes are ignored: a reader that closed the pipe (`impasto info M | head -1`) has
//! seen what it wanted, and there is nobody left to tell.

use std::fmt::Display;
use std::io::{self, Write};

/// The command's result.
pub fn result(text: &str) {
    let _ = writeln!(io::stdout().lock(), "{}", text.trim_end());
}

/// How things stand.
pub fn note(text: impl Display) {
    let _ = writeln!(io::stderr().lock(), "{text}");
}

/// Why the command failed, in one line.
pub fn error(problem: impl Display) {
    // Names in messages come from files: they must not steer the terminal.
    let line = problem
        .to_string()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ")
        .replace(char::is_control, "\u{fffd}");
    let _ = writeln!(io::stderr().lock(), "error: {line}");
}

//! The `impasto` command.

mod cli;
mod memory;
mod output;

use std::process::ExitCode;

fn main() -> ExitCode {
    memory::keep();
    cli::main()
}

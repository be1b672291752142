//! `vbgs-studio`: the window, and everything it does without a display.

mod cli;

use std::process::ExitCode;

fn main() -> ExitCode {
    cli::run()
}

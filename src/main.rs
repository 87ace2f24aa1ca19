//! `arnold-analyze`: parse, dispatch, turn the outcome into an exit code.

use std::process::ExitCode;

fn main() -> ExitCode {
    arnold_analyze::cli::main(std::env::args_os())
}

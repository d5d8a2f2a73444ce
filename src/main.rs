//! The binary: all it does is in the library's `cli`.

use std::process::ExitCode;

fn main() -> ExitCode {
    deaflow::cli::main(std::env::args_os(), deaflow::BUILD).into()
}

//! The version of this program, the digest of its sources, and how it is started.

use std::ffi::OsString;
use std::io;
use std::process::Command;
use std::sync::OnceLock;

use super::digest::Digest;

/// The version of deaflow.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

static BUILD: OnceLock<String> = OnceLock::new();

static OWN_COMMAND: OnceLock<Vec<OsString>> = OnceLock::new();

/// Sets the words that start the command line of deaflow, where it is part of another program. Only the first call has
/// an effect.
pub fn set_own_command(words: Vec<OsString>) {
    OWN_COMMAND.get_or_init(|| words);
}

/// Returns the words that start this program: its file, unless [`set_own_command`] was called.
///
/// # Errors
/// If its file is not known.
pub fn own_command() -> io::Result<Vec<OsString>> {
    match OWN_COMMAND.get() {
        Some(words) => Ok(words.clone()),
        None => Ok(vec![std::env::current_exe()?.into()]),
    }
}

/// Returns a command that starts this program.
///
/// # Errors
/// As [`own_command`].
pub fn own_process() -> io::Result<Command> {
    let words = own_command()?;
    let (program, arguments) = words.split_first().ok_or(io::ErrorKind::NotFound)?;
    let mut command = Command::new(program);
    command.args(arguments);
    Ok(command)
}

/// Sets the digest of the sources. The binary does so at start, since a crate does not know the sources of the others.
/// Only the first call has an effect.
pub fn set_build(digest: &str) {
    BUILD.get_or_init(|| digest.to_owned());
}

/// Returns the digest of the sources, or of the executable if [`set_build`] was not called, as in tests.
#[must_use]
pub fn build() -> &'static str {
    BUILD.get_or_init(|| {
        let program = std::env::current_exe().and_then(std::fs::read).unwrap_or_default();
        Digest::of(&program).to_string()
    })
}

/// Returns the version and the build, which differs for different sources.
#[must_use]
pub fn version() -> String {
    format!("{VERSION} (build {})", &build()[..Digest::SHORT])
}

/// Returns the name of this program for files.
#[must_use]
pub fn software() -> String {
    format!("deaflow {}", version())
}

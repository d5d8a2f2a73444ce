//! The version of this program, and the digest of its sources.

use std::sync::OnceLock;

use super::digest::Digest;

/// The version of deaflow.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

static BUILD: OnceLock<String> = OnceLock::new();

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

//! Which program this is: its version, and the sources that it was built of.

use std::sync::OnceLock;

use super::digest::Digest;

/// The version of deaflow.
pub const VERSION: &str = env!("CARGO_PKG_VERSION");

static BUILD: OnceLock<String> = OnceLock::new();

/// Names the sources of this program by their digest, before anything asks for them. The binary does so as it begins,
/// since no room knows the sources of the others. The first call counts.
pub fn set_build(digest: &str) {
    BUILD.get_or_init(|| digest.to_owned());
}

/// The digest of the sources of this program; of the program itself where nobody named them, as in tests and in programs of
/// others.
#[must_use]
pub fn build() -> &'static str {
    BUILD.get_or_init(|| {
        let program = std::env::current_exe().and_then(std::fs::read).unwrap_or_default();
        Digest::of(&program).to_string()
    })
}

/// The version, and which build of it: two builds of other sources are told apart.
#[must_use]
pub fn version() -> String {
    format!("{VERSION} (build {})", &build()[..Digest::SHORT])
}

/// This program, as files name it.
#[must_use]
pub fn software() -> String {
    format!("deaflow {}", version())
}

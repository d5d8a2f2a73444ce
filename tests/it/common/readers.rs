//! Programs that read what deaflow writes as its users' programs do, and that are too large to install unasked:
//! Chromium, onnxruntime, pyvista and readers of CAD files. Tests use them where `DEAFLOW_READERS=all` says so, as
//! `make test-all` does; Chromium, which takes seconds, wherever it is installed.

use std::io::Write;
use std::path::Path;
use std::process::Command;

/// Whether such programs are to be used.
fn wanted() -> bool {
    std::env::var_os("DEAFLOW_READERS").is_some_and(|value| value == "all")
}

/// A large reader if it is wanted and there; otherwise says on stderr, past the capture of test output, what is left
/// out.
pub fn find<T>(what: &str, look: impl FnOnce() -> Option<T>) -> Option<T> {
    match wanted() {
        true => installed(what, look),
        false => {
            leave_out(what, "`make test-all` uses it");
            None
        }
    }
}

/// A reader if it is there; otherwise says so in the same way.
pub fn installed<T>(what: &str, look: impl FnOnce() -> Option<T>) -> Option<T> {
    let found = look();
    if found.is_none() {
        leave_out(what, "it is not installed");
    }
    found
}

fn leave_out(what: &str, why: &str) {
    let _ = writeln!(std::io::stderr(), "LEFT OUT: {what}: {why}");
}

/// The python that imports all of the modules: that of a folder under `target/`, or one of the system's.
pub fn python(folder: &str, modules: &str) -> Option<String> {
    let own = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("target")
        .join(folder)
        .join("bin/python");
    let known = [own.display().to_string(), "python3".into(), "/usr/bin/python3".into()];
    known.into_iter().find(|python| {
        let test = Command::new(python).args(["-c", &format!("import {modules}")]).output();
        test.is_ok_and(|output| output.status.success())
    })
}

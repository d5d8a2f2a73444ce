//! Output of commands compared with the files in `tests/it/snapshots`, one per test. Tests check facts by exit codes,
//! JSON and numbers, and the wording by a snapshot, so that new wording is accepted in one place:
//!
//! ```sh
//! INSTA_UPDATE=always cargo test --test it     # rewrites the files whose output changed; review them by `git diff`
//! INSTA_UPDATE=no cargo test --test it         # fails where output differs, and writes nothing
//! ```

use std::fmt::{self, Display, Write};
use std::sync::LazyLock;

use insta::internals::SnapshotContents;
use insta::{Comparator, Settings, Snapshot};
use regex::{Captures, Regex};

use super::Ended;
use super::compare::{Tolerance, is_digest, same};

const FOLDER: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/it/snapshots");

/// Results may differ in their last digits between kinds of processors.
const TOLERANCE: Tolerance = Tolerance(2e-3);

/// What several commands of a test print, each under a title.
#[derive(Default)]
pub struct Transcript(String);

impl Transcript {
    pub fn add(&mut self, title: impl Display, printed: impl Display) {
        let _ = write!(self.0, "# {title}\n{printed}\n");
    }
}

impl Display for Transcript {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl Display for Ended {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        match self.code {
            Some(code) => writeln!(f, "exit code {code}")?,
            None => writeln!(f, "ended by a signal")?,
        }
        for (name, text) in [("stdout", &self.stdout), ("stderr", &self.stderr)] {
            if !text.is_empty() {
                write!(f, "--- {name}\n{text}")?;
            }
        }
        Ok(())
    }
}

/// Compares a text, an [`Ended`] or a [`Transcript`] with the snapshot that has the name of the test. A second snapshot
/// in a test gets a suffix.
macro_rules! snapshot {
    ($printed:expr) => {
        $crate::common::snapshot!($printed, "")
    };
    ($printed:expr, $suffix:expr) => {{
        fn here() {}
        $crate::common::snapshots::check(std::any::type_name_of_val(&here), $suffix, &$printed)
    }};
}
pub(crate) use snapshot;

/// Compares a text with the snapshot of the function in which `here` is defined.
pub fn check(here: &str, suffix: &str, printed: &dyn Display) {
    let path = here
        .split("::")
        .skip(1)
        .filter(|part| !matches!(*part, "here" | "{{closure}}"));
    let mut name = path.collect::<Vec<_>>().join("__");
    if !suffix.is_empty() {
        name = format!("{name}__{suffix}");
    }
    let mut settings = Settings::new();
    settings.set_snapshot_path(FOLDER);
    settings.set_prepend_module_to_snapshot(false);
    settings.set_omit_expression(true);
    settings.set_comparator(Box::new(SameOutput));
    settings.bind(|| insta::assert_snapshot!(name, masked(&printed.to_string())));
}

/// Replaces numbers by `#`, for results of trained networks and others that differ between kinds of processors.
pub fn without_numbers(text: &str) -> String {
    static NUMBERS: LazyLock<Regex> = LazyLock::new(|| Regex::new(r"[+−-]?[0-9]+(\.[0-9]+)?(e[−-]?[0-9]+)?").unwrap());
    NUMBERS.replace_all(&masked(text), "#").into_owned()
}

struct SameOutput;

impl Comparator for SameOutput {
    fn matches(&self, reference: &Snapshot, test: &Snapshot) -> bool {
        match (reference.contents(), test.contents()) {
            (SnapshotContents::Text(a), SnapshotContents::Text(b)) => same(&a.to_string(), &b.to_string(), TOLERANCE),
            _ => false,
        }
    }

    fn dyn_clone(&self) -> Box<dyn Comparator> {
        Box::new(Self)
    }
}

static FOLDERS: LazyLock<Regex> = LazyLock::new(|| Regex::new(r#"[^\s"'`(=:]*/\.tmp[0-9A-Za-z]{6}"#).unwrap());
static WORDS: LazyLock<Regex> = LazyLock::new(|| Regex::new("[0-9A-Za-z]{8,}").unwrap());
static MEASURED: LazyLock<Vec<(Regex, &str)>> = LazyLock::new(|| {
    let patterns = [
        // Names of log files: time and process.
        (r"[0-9]{4}-[0-9]{2}-[0-9]{2}T[0-9-]+\.[0-9]+Z-[0-9]+", "[run]"),
        (r"[0-9]{4}-[0-9]{2}-[0-9]{2}([T ][0-9:.]+Z?)?( UTC)?", "[time]"),
        (r"\b[0-9]{1,2}:[0-9]{2}(:[0-9]{2})?\b", "[time]"),
        (r"\b[0-9]+(\.[0-9]+)? (µs|ms|s|min|h)( [0-9]+ (s|min))?\b", "[time]"),
        (r"\b[0-9]+(\.[0-9]+)? (bytes|B|kB|MB|GB|KiB|MiB|GiB)\b", "[size]"),
        (r"\b127\.0\.0\.1:[0-9]+", "127.0.0.1:[port]"),
        (r"\b(process|pid) [0-9]+", "$1 [pid]"),
        // Rules of tables are as wide as their columns.
        ("─{4,}", "───"),
        ("═{4,}", "═══"),
        (r"(?m)[ \t]+$", ""),
    ];
    patterns
        .map(|(pattern, mask)| (Regex::new(pattern).unwrap(), mask))
        .into()
});

/// Replaces what differs from run to run and from machine to machine.
fn masked(text: &str) -> String {
    let text = text.replace(env!("CARGO_BIN_EXE_deaflow"), "deaflow");
    let mut text = FOLDERS
        .replace_all(&text, "[folder]")
        .replace(concat!(env!("CARGO_MANIFEST_DIR"), "/"), "[repository]/")
        .replace(concat!("deaflow ", env!("CARGO_PKG_VERSION")), "deaflow [version]")
        .replace(&deaflow::base::host_name(), "[host]");
    for (pattern, mask) in MEASURED.iter() {
        text = pattern.replace_all(&text, *mask).into_owned();
    }
    let digest = |found: &Captures| {
        let word = &found[0];
        let is_decimal = word.bytes().all(|b| b.is_ascii_digit());
        let is_masked = is_digest(word) && (!is_decimal || matches!(word.len(), 12 | 64));
        if is_masked { "[digest]" } else { word }.to_owned()
    };
    WORDS.replace_all(&text, digest).into_owned()
}

#[test]
fn values_of_one_run_are_masked() {
    for (text, mask) in [
        ("wrote /tmp/.tmpA1b2C3/out.h5, 41.4 MB", "wrote [folder]/out.h5, [size]"),
        ("solved 1.66 s a0fee3aeb495", "solved [time] [digest]"),
        ("after 2 min 3 s, at 2026-01-31T12:00:01Z", "after [time], at [time]"),
        ("1000000000000 rows, 6161.6 V", "1000000000000 rows, 6161.6 V"),
    ] {
        assert_eq!(masked(text), mask);
    }
}

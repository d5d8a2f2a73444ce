//! Examples at the end of a command's help.

/// The text of some command lines as it stands below the options.
macro_rules! examples {
    ($($line:literal),+ $(,)?) => {
        concat!("Examples:" $(, "\n  ", $line)+)
    };
}

pub(super) use examples;

/// The heading that [`examples!`] writes.
pub const HEADING: &str = "Examples:";

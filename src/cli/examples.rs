//! Examples at the end of a command's help.

/// Formats command lines as the text below the options of a command.
macro_rules! examples {
    ($($line:literal),+ $(,)?) => {
        concat!("Examples:" $(, "\n  ", $line)+)
    };
}

/// The heading that [`examples!`] writes.
pub const HEADING: &str = "Examples:";

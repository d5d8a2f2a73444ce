//! Names of things that people list in files.

/// Whether a text is a name of letters, digits, `-` and `_`, of at most so many characters.
#[must_use]
pub fn is_plain_name(text: &str, longest: usize) -> bool {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (1..=longest).contains(&text.len()) && text.chars().all(is_allowed)
}

//! Plain names.

/// Returns whether a text is a name of letters, digits, `-` and `_` with at most `longest` characters.
#[must_use]
pub fn is_plain_name(text: &str, longest: usize) -> bool {
    let is_allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    (1..=longest).contains(&text.len()) && text.chars().all(is_allowed)
}

//! Text that changes nothing about a terminal.
//!
//! Names in pipelines, attributes of files, names of files and messages of libraries come from elsewhere. In them a control
//! character could clear the screen, set its title or hide what was written before, and a mark of direction could show words in
//! another order than they have (Boucher and Anderson, "Trojan Source", USENIX Security 2023).

use std::borrow::Cow;
use std::fmt::Write;

/// Whether a character is none that a text may have: a control other than line break and tab, a mark that changes the direction of
/// what follows, a separator that some take for a line break, or one that no text has at all.
#[must_use]
pub fn is_unprintable(c: char) -> bool {
    match c {
        '\n' | '\t' => false,
        '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => true,
        '\u{fffe}' | '\u{ffff}' => true,
        c => c.is_control(),
    }
}

/// The text with `\u{fffd}` in place of every such character. A line break of two characters becomes one of one.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    match text.contains(is_unprintable) {
        true => text.replace("\r\n", "\n").replace(is_unprintable, "\u{fffd}").into(),
        false => text.into(),
    }
}

/// A JSON document in which every such character is escaped. It stands in strings only: elsewhere JSON has none.
#[must_use]
pub fn printable_json(json: &str) -> Cow<'_, str> {
    // Serialisers escape the first 32 controls, and no others.
    if !json.contains(is_unprintable) {
        return json.into();
    }
    let mut text = String::with_capacity(json.len() + 64);
    for c in json.chars() {
        if is_unprintable(c) {
            // Writing to a text cannot fail.
            let _ = write!(text, "\\u{:04x}", u32::from(c));
        } else {
            text.push(c);
        }
    }
    text.into()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_a_terminal_would_obey_is_replaced_and_the_rest_stays() {
        let text = "a\u{1b}[2J\u{7}b\rc\r\nd\te\u{9b}31m\u{202e}f\u{7f}é 日本 🎈\n";
        let shown = printable(text);
        assert_eq!(
            shown,
            "a\u{fffd}[2J\u{fffd}b\u{fffd}c\nd\te\u{fffd}31m\u{fffd}f\u{fffd}é 日本 🎈\n"
        );
        assert!(!shown.contains(is_unprintable));
        assert!(matches!(printable("plain\n"), Cow::Borrowed("plain\n")));
    }

    #[test]
    fn json_means_the_same_afterwards() {
        let value = serde_json::json!({ "a\u{9b}\u{1b}": ["\u{7f}\u{202e}\n", "é"] });
        let text = serde_json::to_string_pretty(&value).unwrap();
        assert!(text.contains('\u{9b}'), "the serialiser does not escape it");
        let shown = printable_json(&text);
        assert!(!shown.contains(is_unprintable));
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).unwrap(), value);
    }
}

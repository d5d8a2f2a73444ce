//! Removes characters that control a terminal.
//!
//! Names in pipelines, attributes, file names and messages of libraries are not trusted. A control character in them
//! could clear the screen, set its title or hide earlier output, and a bidirectional control could show words in
//! another order (Boucher and Anderson, "Trojan Source", USENIX Security 2023).

use std::borrow::Cow;
use std::fmt::Write;

/// Returns whether a character is not allowed in output: a control character other than line break and tab, a
/// bidirectional control, a Unicode line or paragraph separator, or a noncharacter.
#[must_use]
pub fn is_unprintable(c: char) -> bool {
    match c {
        '\n' | '\t' => false,
        '\u{2028}' | '\u{2029}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}' => true,
        '\u{fffe}' | '\u{ffff}' => true,
        c => c.is_control(),
    }
}

/// Replaces every such character by `\u{fffd}`, and CR LF by LF.
#[must_use]
pub fn printable(text: &str) -> Cow<'_, str> {
    match text.contains(is_unprintable) {
        true => text.replace("\r\n", "\n").replace(is_unprintable, "\u{fffd}").into(),
        false => text.into(),
    }
}

/// Escapes every such character in a JSON document, where it can only occur in strings.
#[must_use]
pub fn printable_json(json: &str) -> Cow<'_, str> {
    // Serialisers escape the first 32 control characters only.
    if !json.contains(is_unprintable) {
        return json.into();
    }
    let mut text = String::with_capacity(json.len() + 64);
    for c in json.chars() {
        if is_unprintable(c) {
            // Writing to a string cannot fail.
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
    fn control_characters_are_replaced_and_others_remain() {
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
    fn escaped_json_has_the_same_meaning() {
        let value = serde_json::json!({ "a\u{9b}\u{1b}": ["\u{7f}\u{202e}\n", "é"] });
        let text = serde_json::to_string_pretty(&value).unwrap();
        assert!(text.contains('\u{9b}'), "the serialiser does not escape it");
        let shown = printable_json(&text);
        assert!(!shown.contains(is_unprintable));
        assert_eq!(serde_json::from_str::<serde_json::Value>(&shown).unwrap(), value);
    }
}

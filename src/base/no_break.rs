//! Keeps numbers and their units on one line.

/// The no-break space.
pub const NO_BREAK: char = '\u{a0}';

/// The units.
const UNITS: [&str; 30] = [
    "mm", "µm", "nm", "m", "V", "kV", "MV", "V/m", "MV/m", "%", "ms", "s", "min", "h", "deg", "Hz", "kHz", "Pa", "kPa",
    "MPa", "B", "kB", "MB", "GB", "C", "nC", "µC", "N", "cells", "UTC",
];

/// Puts no-break spaces between numbers and their units.
#[must_use]
pub fn no_break_units(line: &str) -> String {
    let mut text = String::with_capacity(line.len());
    let mut words = line.split(' ').peekable();
    while let Some(word) = words.next() {
        text += word;
        let Some(next) = words.peek() else { break };
        let unit = next.trim_end_matches([',', ';', ':', '.', ')']);
        let is_number = word.ends_with(|c: char| c.is_ascii_digit());
        let is_bound = (is_number && (UNITS.contains(&unit) || unit == "±"))
            || word == "±"
            || (word == "<" && text.ends_with("±\u{a0}<"));
        text.push(if is_bound { NO_BREAK } else { ' ' });
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_numbers_are_bound_to_units() {
        assert_eq!(
            no_break_units("a gain of 5.4 %, 2.1 mm ± 0.1 in 7 steps"),
            "a gain of 5.4\u{a0}%, 2.1\u{a0}mm ±\u{a0}0.1 in 7 steps"
        );
    }
}

//! Formats numbers, durations and sizes for people, and names for files.

use deaflow_base::{four_digits, measured, rounded_by, with_minus};

/// Writes a duration.
pub fn seconds(seconds: f64) -> String {
    match seconds {
        s if s < 0.0095 => format!("{:.0} ms", 1e3 * s),
        s if s < 9.95 => format!("{s:.2} s"),
        s if s < 59.95 => format!("{s:.1} s"),
        s if s < 3_599.5 => format!("{} min {:02.0} s", (s.round() / 60.0).floor(), s.round() % 60.0),
        s => {
            let minutes = (s / 60.0).round();
            format!("{} h {:02.0} min", (minutes / 60.0).floor(), minutes % 60.0)
        }
    }
}

/// Writes a duration in s in the largest unit in which it is an integer.
pub fn duration(seconds: f64) -> String {
    let units = [(3600.0, "h"), (60.0, "min")];
    let whole = units
        .into_iter()
        .find(|(unit, _)| seconds >= *unit && seconds % unit == 0.0);
    let (unit, name) = whole.unwrap_or((1.0, "s"));
    format!("{} {name}", seconds / unit)
}

/// Writes a file size.
pub fn bytes(bytes: u64) -> String {
    let units = [("GB", 1e9), ("MB", 1e6), ("kB", 1e3)];
    let bytes = bytes as f64;
    match units.iter().find(|(_, size)| bytes >= 0.9995 * size) {
        Some((unit, size)) => format!("{:.1} {unit}", bytes / size),
        None => format!("{bytes} B"),
    }
}

/// Writes a length in mm with four significant digits and at most four decimals, without its unit.
pub fn mm(value: f64) -> String {
    four_digits(value)
}

/// Returns a text with a capital first letter.
pub fn capitalised(text: &str) -> String {
    let mut letters = text.chars();
    let first = letters.next().map(|first| first.to_uppercase().to_string());
    first.unwrap_or_default() + letters.as_str()
}

/// Writes a number with five significant digits; integers in full.
pub fn number(value: f64) -> String {
    let whole = value.fract() == 0.0 && value.abs() < 1e15;
    let decimals = match value.abs() {
        _ if whole => 0,
        size if size >= 1e-4 => (4.0 - size.log10().floor()).clamp(0.0, 8.0) as usize,
        _ => return with_minus(&format!("{value:.4e}")),
    };
    with_minus(&format!("{value:.decimals$}"))
}

/// Writes a number with three significant digits; those below 0.0001 as a bound.
pub fn three(value: f64) -> String {
    const LEAST: f64 = 1e-4;
    let size = value.abs();
    if !value.is_finite() || value == 0.0 {
        return with_minus(&(value + 0.0).to_string());
    }
    if size < LEAST {
        return if value > 0.0 { "< 0.0001" } else { "> −0.0001" }.to_owned();
    }
    // The exponent of the rounded number: 0.9996 has as many decimals as 1.
    let scientific = format!("{size:.2e}");
    let power = scientific.split_once('e').and_then(|(_, power)| power.parse().ok());
    let decimals = (2 - power.unwrap_or(0_i32)).max(0) as usize;
    with_minus(&format!("{value:.decimals$}"))
}

/// Writes a fraction in percent, with three significant digits.
pub fn percents(fraction: f64) -> String {
    format!("{} %", three(100.0 * fraction))
}

/// Writes a difference in percent with its sign, with three significant digits.
pub fn change(change: f64) -> String {
    signed(percents(change), change)
}

/// Adds the sign of a positive number to its text.
pub fn signed(text: String, number: f64) -> String {
    match text.starts_with(|c: char| c.is_ascii_digit()) && number > 0.0 {
        true => format!("+{text}"),
        false => text,
    }
}

/// Writes a length in mm rounded by its estimated error, with four digits if that is not known, without its unit.
pub fn mm_measured(value: f64, error: Option<f64>) -> String {
    error.map_or_else(|| mm(value), |error| measured(value, error))
}

/// Writes a coefficient of determination, rounded by its distance from 1: 0.928, 0.99987.
pub fn r_squared(value: f64) -> String {
    rounded_by(value, 1.0 - value)
}

/// Writes a fraction in percent, with a number of decimals.
pub fn percent(fraction: f64, decimals: usize) -> String {
    with_minus(&format!("{:.*} %", decimals, 100.0 * fraction))
}

/// Writes a number of things.
pub fn counted(n: usize, one: &str, many: &str) -> String {
    match n {
        1 => format!("1 {one}"),
        n => format!("{n} {many}"),
    }
}

/// Shortens a text to `most` letters.
pub fn cut(text: &str, most: usize) -> String {
    match text.chars().count() > most {
        true => text.chars().take(most - 1).chain(['…']).collect(),
        false => text.to_owned(),
    }
}

/// Quotes a word for a shell if necessary.
#[must_use]
pub fn shell_word(word: &str) -> String {
    let is_plain = |c: char| c.is_ascii_alphanumeric() || "-_./:=@,+%".contains(c);
    match !word.is_empty() && word.chars().all(is_plain) {
        true => word.to_owned(),
        false => format!("'{}'", word.replace('\'', "'\\''")),
    }
}

/// Returns overrides as options of a command, each after a space: ` --set 'scene.drive.voltage=4 kV'`.
pub fn set_options<'a>(overrides: impl IntoIterator<Item = (&'a String, &'a String)>) -> String {
    let option = |(path, value): (&String, &String)| format!(" --set {}", shell_word(&format!("{path}={value}")));
    overrides.into_iter().map(option).collect()
}

/// Returns the name of a figure file.
pub fn figure_name(stage: &str, digest: &str, figure: &str) -> String {
    format!("{}-{digest:.8}-{figure}.png", file_name(stage))
}

/// Replaces characters that a file name must not have.
pub fn file_name(name: &str) -> String {
    let safe = |c: char| {
        if c.is_alphanumeric() || c == '-' || c == '_' {
            c
        } else {
            '-'
        }
    };
    let safe: String = name.chars().take(60).map(safe).collect();
    if safe.is_empty() { "unnamed".into() } else { safe }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn durations_and_sizes_are_short_and_round() {
        let times = [0.004, 3.456, 59.97, 125.2, 3_599.6, 7_380.0].map(seconds);
        assert_eq!(
            times,
            ["4 ms", "3.46 s", "1 min 00 s", "2 min 05 s", "1 h 00 min", "2 h 03 min"]
        );
        for (value, text) in [
            (0.0, "0 ms"),
            (0.0094, "9 ms"),
            (0.01, "0.01 s"),
            (59.94, "59.9 s"),
            (59.97, "1 min 00 s"),
        ] {
            assert_eq!(seconds(value), text);
        }
        let sizes = [0, 999, 1_500, 999_990, 2_340_000_000].map(bytes);
        assert_eq!(sizes, ["0 B", "999 B", "1.5 kB", "1.0 MB", "2.3 GB"]);
        assert_eq!((mm(-1.23456), percent(0.9912, 1)), ("−1.235".into(), "99.1 %".into()));
        assert_eq!(cut("abcdef", 4), "abc…");
    }

    #[test]
    fn numbers_have_three_significant_digits_and_small_ones_are_bounds() {
        for (value, text) in [
            (2.154_73, "2.15"),
            (0.999_6, "1.00"),
            (-0.042_71, "−0.0427"),
            (0.000_04, "< 0.0001"),
            (-0.000_04, "> −0.0001"),
            (0.0, "0"),
            (-0.0, "0"),
            (1234.5, "1234"),
            (99.96, "100"),
            (f64::NAN, "NaN"),
        ] {
            assert_eq!(three(value), text);
        }
        assert_eq!(
            [0.0169, -0.05, 0.0, 1e-7].map(change),
            ["+1.69 %", "−5.00 %", "0 %", "< 0.0001 %"]
        );
        assert_eq!(
            [0.927_74, 0.999_871, 1.0, -3.21].map(r_squared),
            ["0.928", "0.99987", "1.000000", "−3.2"]
        );
        assert_eq!([1.0, 0.989_84].map(percents), ["100 %", "99.0 %"]);
        assert_eq!(
            [Some(0.022), None].map(|error| mm_measured(0.786_792_74, error)),
            ["0.787 ± 0.022", "0.7868"]
        );
    }

    #[test]
    fn words_are_quoted_if_a_shell_would_split_them() {
        assert_eq!(shell_word("pipelines/a.yaml:verified"), "pipelines/a.yaml:verified");
        assert_eq!(shell_word("drive.voltage=4000 V"), "'drive.voltage=4000 V'");
        assert_eq!(["", "a b", "it's"].map(shell_word), ["''", "'a b'", "'it'\\''s'"]);
    }
}

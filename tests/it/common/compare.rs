//! Whether two outputs are the same: words are equal, numbers are close, and values that change from run to run (times,
//! digests, widths of columns) are ignored.

/// Relative difference allowed between two numbers with decimals. Two units of the last digit are allowed too.
#[derive(Clone, Copy)]
pub struct Tolerance(pub f64);

/// Tolerance for pages of documentation, whose numbers come from other machines.
const PAGES: Tolerance = Tolerance(0.05);

/// A piece of a line.
#[derive(Debug)]
enum Piece {
    Text(String),
    /// The unit of the last place is 0 for a whole number.
    Number {
        value: f64,
        unit_of_last_place: f64,
    },
    Digest,
    Time,
}

impl Piece {
    fn agrees(&self, other: &Self, tolerance: Tolerance) -> bool {
        match (self, other) {
            (Self::Text(a), Self::Text(b)) => a == b,
            (
                Self::Number {
                    value: a,
                    unit_of_last_place: u,
                },
                Self::Number {
                    value: b,
                    unit_of_last_place: v,
                },
            ) if *u > 0.0 && *v > 0.0 => (a - b).abs() <= (tolerance.0 * a.abs().max(b.abs())).max(2.0 * u.max(*v)),
            // Whole numbers are counts.
            (Self::Number { value: a, .. }, Self::Number { value: b, .. }) => a == b,
            (Self::Digest, Self::Digest) | (Self::Time, Self::Time) => true,
            _ => false,
        }
    }
}

fn agree(a: &[Piece], b: &[Piece], tolerance: Tolerance) -> bool {
    a.len() == b.len() && a.iter().zip(b).all(|(a, b)| a.agrees(b, tolerance))
}

/// Compares two outputs wholly; where lines break does not matter.
pub fn same(a: &str, b: &str, tolerance: Tolerance) -> bool {
    agree(&pieces(a), &pieces(b), tolerance)
}

/// Fraction of the pieces of both lines that they have in common, in any order: 1 for equal lines, 0 for unrelated
/// ones.
pub fn similarity(a: &str, b: &str) -> f64 {
    let (a, mut b) = (pieces(a), pieces(b));
    let total = a.len() + b.len();
    let mut common = 0;
    for piece in a {
        if let Some(at) = b.iter().position(|other| piece.agrees(other, PAGES)) {
            b.swap_remove(at);
            common += 2;
        }
    }
    if total == 0 {
        1.0
    } else {
        f64::from(common) / total as f64
    }
}

/// Whether a line of a page shows a printed line; `…` at its end stands for any words.
pub fn shows(shown: &str, printed: &str) -> bool {
    let (start, is_cut) = shown.strip_suffix('…').map_or((shown, false), |start| (start, true));
    let (expected, mut found) = (pieces(start), pieces(printed));
    if is_cut {
        found.truncate(expected.len());
    }
    agree(&expected, &found, PAGES)
}

/// Whether a line of a page stands for any number of printed lines.
pub fn is_gap(shown: &str) -> bool {
    shown.ends_with('…') && pieces(shown.trim_end_matches('…')).is_empty()
}

/// Whether a line has nothing but spaces and rules.
pub fn is_empty(line: &str) -> bool {
    pieces(line).is_empty()
}

/// Compares a block of a page with what was printed.
pub fn check(shown: &str, printed: &str) -> Result<(), String> {
    let mut printed = printed.lines().filter(|line| !is_empty(line));
    let mut gap = false;
    for line in shown.lines() {
        if is_gap(line) {
            gap = true;
        } else if !is_empty(line) {
            let found = if gap {
                printed.find(|found| shows(line, found))
            } else {
                printed.next()
            };
            if !found.is_some_and(|found| shows(line, found)) {
                let found = found.unwrap_or_default();
                return Err(format!("the page shows `{line}`, the command printed `{found}`"));
            }
            gap = false;
        }
    }
    match printed.next() {
        Some(rest) if !gap => Err(format!("the page does not show `{rest}`, which the command printed")),
        _ => Ok(()),
    }
}

/// The pieces of a text without spaces, line breaks, rules and frames.
fn pieces(line: &str) -> Vec<Piece> {
    let mut found: Vec<Piece> = Vec::new();
    let is_frame = |c: char| c.is_whitespace() || matches!(c, '─' | '═' | '│');
    for word in line.split(is_frame).filter(|word| !word.is_empty()) {
        let is_unit = matches!(word.trim_end_matches([',', ';', '.', ')']), "s" | "ms" | "min" | "h");
        if is_unit && matches!(found.last(), Some(Piece::Number { .. })) {
            found.pop();
            if !matches!(found.last(), Some(Piece::Time)) {
                found.push(Piece::Time);
            }
        } else if is_clock(word) {
            found.push(Piece::Time);
        } else {
            split(word, &mut found);
        }
    }
    found
}

/// Splits a word into digests, numbers and the rest.
fn split(word: &str, found: &mut Vec<Piece>) {
    let mut rest = word;
    while let Some(first) = rest.chars().next() {
        let run = rest.find(|c: char| !c.is_ascii_alphanumeric()).unwrap_or(rest.len());
        let taken = if is_digest(&rest[..run]) {
            found.push(Piece::Digest);
            run
        } else if let Some((piece, length)) = number(rest) {
            found.push(piece);
            length
        } else {
            let length = if run > 0 { run } else { first.len_utf8() };
            found.push(Piece::Text(rest[..length].to_owned()));
            length
        };
        rest = &rest[taken..];
    }
}

/// A date, a time of day, or both: `2026-01-31`, `12:00:01`, `2026-01-31T12:00:01.000Z`.
fn is_clock(word: &str) -> bool {
    let separators = word.chars().filter(|c| matches!(c, '-' | ':')).count();
    let digits = word.chars().filter(char::is_ascii_digit).count();
    let others = word
        .chars()
        .all(|c| c.is_ascii_digit() || matches!(c, '-' | ':' | 'T' | '.' | 'Z'));
    others && separators >= 2 && digits >= 6
}

/// At least eight hexadecimal digits, with a decimal one among them.
pub fn is_digest(text: &str) -> bool {
    let hexadecimal = |c: char| matches!(c, '0'..='9' | 'a'..='f');
    text.len() >= 8 && text.chars().all(hexadecimal) && text.contains(|c: char| c.is_ascii_digit())
}

/// The number that a text begins with, and its length.
fn number(text: &str) -> Option<(Piece, usize)> {
    let after = |start: usize| {
        text[start..]
            .find(|c: char| !c.is_ascii_digit())
            .map_or(text.len(), |n| start + n)
    };
    let sign = usize::from(text.starts_with(['+', '-']));
    let mut end = after(sign);
    if end == sign {
        return None;
    }
    let mut places = 0;
    if text[end..].starts_with('.') && after(end + 1) > end + 1 {
        places = after(end + 1) - end - 1;
        end = after(end + 1);
    }
    let digits = end;
    for exponent in ["e-", "e"] {
        if text[digits..].starts_with(exponent) && after(digits + exponent.len()) > digits + exponent.len() {
            end = after(digits + exponent.len());
            break;
        }
    }
    let value: f64 = text[..end].parse().ok()?;
    let exponent: i32 = text[digits..end].trim_start_matches('e').parse().unwrap_or(0);
    let unit_of_last_place = if places == 0 && exponent == 0 {
        0.0
    } else {
        10_f64.powi(exponent - places as i32)
    };
    Some((
        Piece::Number {
            value,
            unit_of_last_place,
        },
        end,
    ))
}

#[test]
fn equal_but_for_what_varies() {
    let shown = " solved   solve   built   1.66 s   a0fee3aeb495   41.4 MB\n…\nsimulated 2.155 mm ± 0.0000\n";
    let printed =
        "solved  solve  built  2 min 3 s  0123456789ab  41.6 MB\n\nother\n───\nsimulated  2.154 mm ± 0.0001\n";
    check(shown, printed).unwrap();
    for (a, b) in [
        ("built", "reused"),
        ("2.155 mm", "2.355 mm"),
        ("41.4 MB", "51.4 MB"),
        ("solved", "small"),
    ] {
        assert!(check(&shown.replacen(a, b, 1), printed).is_err(), "{a} {b}");
    }
    check("one …\ntwo\n", "one more\ntwo\n").unwrap();
    assert!(check("one\n", "one\ntwo\n").is_err());
    assert!(check("one\ntwo\n", "one\n").is_err());
}

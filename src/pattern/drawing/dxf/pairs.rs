//! The text of a DXF file: pairs of a code and a value, a line each.

use crate::PatternFileError;

/// The largest absolute value of a number.
const LARGEST: f64 = 1e9;

/// A value with its code and the number of its line.
#[derive(Clone, Copy, Debug)]
pub struct Pair<'a> {
    pub code: i32,
    pub value: &'a str,
    pub line: usize,
}

impl Pair<'_> {
    pub fn number(&self) -> Result<f64, PatternFileError> {
        match self.value.parse::<f64>() {
            Ok(number) if number.abs() <= LARGEST => Ok(number),
            _ => Err(self.error("a number", &format!("from -{LARGEST:e} to {LARGEST:e}"))),
        }
    }

    pub fn integer(&self) -> Result<i64, PatternFileError> {
        let error = || self.error("an integer", "in digits");
        self.value.parse::<i64>().map_err(|_| error())
    }

    fn error(&self, what: &str, allowed: &str) -> PatternFileError {
        let shown: String = self.value.chars().take(40).collect();
        PatternFileError::new(format!("line {}: \"{shown}\" is not {what}", self.line))
            .help(format!("allowed: {allowed}"))
    }
}

/// Splits a text into pairs, up to its end or to EOF.
pub fn pairs(text: &str) -> Result<Vec<Pair<'_>>, PatternFileError> {
    let mut pairs = Vec::new();
    let mut lines = text.lines().enumerate();
    while let Some((at, code)) = lines.next() {
        let Ok(code) = code.trim().parse::<i32>() else {
            if code.trim().is_empty() && lines.clone().all(|(_, line)| line.trim().is_empty()) {
                break;
            }
            let shown: String = code.chars().take(40).collect();
            return Err(
                PatternFileError::new(format!("line {}: \"{shown}\" is not a code of DXF", at + 1))
                    .help("allowed: text files of DXF, in which lines with a code and lines with a value alternate"),
            );
        };
        let Some((at, value)) = lines.next() else {
            return Err(
                PatternFileError::new(format!("line {}: the value is missing; the file ends", at + 2))
                    .help("export the drawing again"),
            );
        };
        let (value, line) = (value.trim(), at + 1);
        if code == 0 && value == "EOF" {
            break;
        }
        pairs.push(Pair { code, value, line });
    }
    Ok(pairs)
}

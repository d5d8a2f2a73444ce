//! Converts the contents of pattern files, of any format, to patterns.

use std::fs::File;
use std::io::Read;
use std::path::Path;

use super::raster::{Pattern, PatternForm, allowed_cells};

/// Largest number of patterns in one argument; on 50 × 50 cells their fields take 830 MB.
const MOST: u64 = 20_000;

/// Largest number of cells in one argument.
pub(super) const MOST_CELLS: u64 = MOST * 2500;

/// Why a file contains no patterns, and what is allowed.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct PatternFileError {
    what: String,
    help: Option<String>,
}

impl PatternFileError {
    pub(super) fn new(what: impl Into<String>) -> Self {
        Self {
            what: what.into(),
            help: None,
        }
    }

    /// Returns what is allowed, if that does not depend on the pattern form.
    #[must_use]
    pub fn own_advice(&self) -> Option<&str> {
        self.help.as_deref()
    }

    /// Returns what is allowed for patterns of this form.
    #[must_use]
    pub fn advice(&self, form: PatternForm) -> String {
        let usual = || {
            format!(
                "a pattern has {} cells, each {}",
                form.raster,
                allowed_cells(form.groups)
            )
        };
        self.help.clone().unwrap_or_else(usual)
    }

    pub(super) fn help(mut self, help: impl Into<String>) -> Self {
        self.help = Some(help.into());
        self
    }
}

/// Reads a file of at most `limit` bytes.
pub(super) fn bytes(path: &Path, limit: u64) -> Result<Vec<u8>, PatternFileError> {
    let mut bytes = Vec::new();
    File::open(path)
        .and_then(|file| file.take(limit + 1).read_to_end(&mut bytes))
        .map_err(|e| PatternFileError::new(e.to_string()))?;
    if bytes.len() as u64 > limit {
        return Err(PatternFileError::new(format!("the file has more than {limit} bytes")));
    }
    Ok(bytes)
}

/// Returns the number of patterns in an array of this shape.
pub(super) fn count(shape: &[u64], form: PatternForm) -> Result<usize, PatternFileError> {
    let [columns, rows] = form.raster.sides().map(|side| side as u64);
    let n = match *shape {
        [y, x] if (y, x) == (rows, columns) => 1,
        [n, y, x] if (y, x) == (rows, columns) => n,
        _ => {
            return Err(
                PatternFileError::new(format!("the array has shape {}", shape_text(shape)))
                    .help(format!("allowed: ({rows}, {columns}) or (n, {rows}, {columns})")),
            );
        }
    };
    let most = (MOST_CELLS / form.raster.cells() as u64).clamp(1, MOST);
    match n {
        0 => Err(PatternFileError::new(format!(
            "the array has shape {} and contains no pattern",
            shape_text(shape)
        ))
        .help("allowed: n from 1")),
        n if n <= most => Ok(n as usize),
        _ => Err(PatternFileError::new(format!("found {n} patterns in one argument"))
            .help(format!("allowed: at most {most}"))),
    }
}

fn shape_text(shape: &[u64]) -> String {
    match shape {
        [one] => format!("({one},)"),
        _ => format!("({})", shape.iter().map(u64::to_string).collect::<Vec<_>>().join(", ")),
    }
}

/// Converts values, row by row from below and pattern after pattern, to patterns.
pub(super) fn patterns(values: &[f64], form: PatternForm) -> Result<Vec<Pattern>, PatternFileError> {
    patterns_from(values, form, 0, values.len() > form.raster.cells())
}

/// Converts the values of consecutive patterns, the first of which has the number `first`.
pub(super) fn patterns_from(
    values: &[f64],
    form: PatternForm,
    first: usize,
    several: bool,
) -> Result<Vec<Pattern>, PatternFileError> {
    let one = |(index, values): (usize, &[f64])| {
        let index = first + index;
        if let Some(at) = values.iter().position(|v| group(*v, form.groups).is_none()) {
            let place = if several { format!("[{index}]") } else { String::new() };
            return Err(PatternFileError::new(format!(
                "cell {place}[y={}][x={}] is {}",
                at / form.raster.columns(),
                at % form.raster.columns(),
                number(values[at])
            )));
        }
        let cells: Vec<u8> = values.iter().filter_map(|v| group(*v, form.groups)).collect();
        Pattern::of_form(form, &cells).map_err(|e| PatternFileError::new(e.to_string()))
    };
    values.chunks(form.raster.cells()).enumerate().map(one).collect()
}

/// Converts a value to the number of an electrode group, or 0.
fn group(value: f64, groups: usize) -> Option<u8> {
    let is_one = value.fract() == 0.0 && (0.0..=groups as f64).contains(&value);
    is_one.then_some(value as u8)
}

/// Formats a value shortly; a double may have 300 digits.
fn number(value: f64) -> String {
    if value == 0.0 || (1e-5..1e15).contains(&value.abs()) || !value.is_finite() {
        value.to_string()
    } else {
        format!("{value:e}")
    }
}

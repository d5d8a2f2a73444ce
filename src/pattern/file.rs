//! Converts the contents of pattern files, of any format, to patterns.

use std::fs::File;
use std::io::Read;
use std::path::Path;
use std::sync::Arc;

use super::electrodes::Electrodes;
use super::raster::{Pattern, PatternForm, allowed_cells};
use deaflow_array::ArrayError;
use deaflow_base::TableError;

/// Largest number of patterns in one argument; on 50 × 50 cells their fields take 830 MB.
const MOST: u64 = 20_000;

/// Largest number of cells in one argument.
const MOST_CELLS: u64 = MOST * 2500;

/// Why a file contains no patterns, and what is allowed.
#[derive(Debug, thiserror::Error)]
#[error("{what}")]
pub struct PatternFileError {
    what: String,
    help: Option<String>,
}

impl From<TableError> for PatternFileError {
    fn from(error: TableError) -> Self {
        Self::new(error.to_string())
    }
}

impl From<ArrayError> for PatternFileError {
    fn from(error: ArrayError) -> Self {
        Self::new(error.to_string()).help(error.help())
    }
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
            let refusal = PatternFileError::new(format!("the array has shape {}", shape_text(shape)));
            let allowed = format!("allowed: ({rows}, {columns}) or (n, {rows}, {columns})");
            return Err(match *shape {
                [x, y] | [x, y, _] if (y, x) == (rows, columns) => refusal.help(format!(
                    "{allowed}; the axes seem to be reversed, as MATLAB's h5write leaves them"
                )),
                _ => refusal.help(allowed),
            });
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

/// The patterns of a file.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FilePatterns {
    /// The patterns, in order.
    pub patterns: Vec<Pattern>,
    /// What the reader did that a user should know, and what is unusual: each a phrase without the name of the file.
    pub notes: Vec<String>,
    /// The shapes of the electrodes of its only pattern, if cells stand for them that differ.
    pub shapes: Option<Arc<Electrodes>>,
}

impl FilePatterns {
    pub(super) fn new(patterns: Vec<Pattern>) -> Self {
        let mut notes = Vec::new();
        let count = |is_such: &dyn Fn(&Pattern) -> bool| patterns.iter().filter(|pattern| is_such(pattern)).count();
        let bare = count(&|pattern| pattern.groups() == 0);
        let is_of_cells = |pattern: &Pattern| pattern.electrodes().is_none() && pattern.coverage().is_none();
        let full = count(&|pattern| is_of_cells(pattern) && pattern.cells().iter().all(|cell| *cell != 0));
        for (found, what) in [(bare, "has no electrode"), (full, "is covered completely")] {
            match (found, patterns.len()) {
                (0, _) => {}
                (_, 1) => notes.push(format!("the pattern {what}")),
                (found, all) => notes.push(format!("{found} of {all} patterns: each {what}")),
            }
        }
        Self {
            patterns,
            notes,
            shapes: None,
        }
    }
}

/// The value of electrodes in masks of 8 or 16 bits, which many programs write.
const MASKS: [f64; 2] = [255.0, 65535.0];

/// Whether a value is that of electrodes in masks of 8 or 16 bits.
#[must_use]
pub fn is_of_mask(value: f64) -> bool {
    MASKS.contains(&value)
}

/// A cell with such a value, while patterns are read.
const HIGH: u8 = u8::MAX;

/// Values that are converted to patterns, row by row from below and pattern after pattern.
pub(super) struct Cells {
    form: PatternForm,
    /// Whether there are several patterns.
    several: bool,
    cells: Vec<u8>,
    /// The first value of a mask, with its place.
    high: Option<(usize, f64)>,
    /// Whether there are other values than 0 and one of a mask.
    is_mixed: bool,
}

impl Cells {
    /// Starts with no values; `n` patterns are to come.
    pub fn new(form: PatternForm, n: usize) -> Self {
        Self {
            form,
            several: n > 1,
            cells: Vec::new(),
            high: None,
            is_mixed: false,
        }
    }

    /// Adds values.
    pub fn add(&mut self, values: &[f64]) -> Result<(), PatternFileError> {
        for &value in values {
            let at = self.cells.len();
            let cell = match group(value, self.form.groups) {
                Some(cell) => {
                    self.is_mixed |= cell != 0;
                    cell
                }
                None if is_of_mask(value) => {
                    let (_, first) = *self.high.get_or_insert((at, value));
                    self.is_mixed |= first != value;
                    HIGH
                }
                None => return Err(self.refusal(at, value)),
            };
            self.cells.push(cell);
        }
        Ok(())
    }

    /// Returns the patterns. If all values are 0 and 255, or 0 and 65535, they are those of a mask.
    pub fn finish(mut self) -> Result<FilePatterns, PatternFileError> {
        if let Some((at, value)) = self.high {
            if self.is_mixed {
                return Err(self.refusal(at, value));
            }
            self.cells.iter_mut().for_each(|cell| *cell = u8::from(*cell == HIGH));
        }
        let all = self.cells.chunks(self.form.raster.cells());
        let patterns = all.map(|cells| Pattern::of_form(self.form, cells));
        let patterns = patterns.collect::<Result<Vec<_>, _>>();
        let mut read = FilePatterns::new(patterns.map_err(|e| PatternFileError::new(e.to_string()))?);
        read.notes.extend(
            self.high
                .map(|(_, value)| format!("values 0 and {value} read as 0 and 1")),
        );
        Ok(read)
    }

    fn refusal(&self, at: usize, value: f64) -> PatternFileError {
        let (columns, cells) = (self.form.raster.columns(), self.form.raster.cells());
        let index = match self.several {
            true => format!("[{}]", at / cells),
            false => String::new(),
        };
        let (y, x) = (at % cells / columns, at % columns);
        PatternFileError::new(format!("cell {index}[y={y}][x={x}] is {}", number(value)))
    }
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

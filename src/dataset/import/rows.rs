//! Rows whose numbers are a pattern and a field of a clamped membrane each.

use std::ops::Range;

use rayon::prelude::*;

use super::error::ImportError;
use crate::base::{Digest, DigestWriter};
use crate::field::{CORNERS, Field};
use crate::pattern::{CELLS, Pattern, Raster};

/// What the frame may seem to move, mm: rounding of whoever wrote it.
const ROUNDING_MM: f64 = 1e-6;

/// Numbers of a field.
const VALUES: usize = CORNERS * CORNERS * 2;

/// Patterns with their fields.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    /// The patterns.
    pub patterns: Vec<Pattern>,
    /// Their fields.
    pub fields: Vec<Field>,
}

impl Rows {
    /// Rows from their numbers, `[row][y][x]` and `[row][y][x][component]`, the first of which has that number in its file.
    ///
    /// # Errors
    /// When a cell is neither 0 nor 1, a displacement is no number or longer than the side, or the frame moves.
    pub fn new(cells: &[f64], displacement: Vec<f64>, first: usize, side_mm: f64) -> Result<Self, ImportError> {
        let rows = cells
            .par_chunks(CELLS * CELLS)
            .zip(displacement.par_chunks(VALUES))
            .enumerate();
        let checked =
            rows.map(|(row, (cells, values))| Ok((pattern(cells, first + row)?, field(values, first + row, side_mm)?)));
        let checked: Vec<(Pattern, Field)> = checked.collect::<Result<_, _>>()?;
        let (patterns, fields) = checked.into_iter().unzip();
        Ok(Self { patterns, fields })
    }

    /// How many there are.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patterns.len()
    }

    /// Whether there are none.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.patterns.is_empty()
    }

    /// Some of them.
    #[must_use]
    pub fn part(&self, range: Range<usize>) -> Self {
        Self {
            patterns: self.patterns[range.clone()].to_vec(),
            fields: self.fields[range].to_vec(),
        }
    }

    /// Adds others after them.
    pub fn append(&mut self, mut others: Self) {
        self.patterns.append(&mut others.patterns);
        self.fields.append(&mut others.fields);
    }

    /// What they are known by, whatever file they come from.
    #[must_use]
    pub fn digest(&self) -> Digest {
        let rows = self.patterns.par_iter().zip(&self.fields);
        let digests = rows.map(|(pattern, field)| {
            let bytes: Vec<u8> = field.values().iter().flat_map(|value| value.to_le_bytes()).collect();
            DigestWriter::new().bytes(pattern.cells()).bytes(&bytes).finish()
        });
        let mut all = DigestWriter::new();
        for digest in digests.collect::<Vec<Digest>>() {
            all.bytes(digest.as_bytes());
        }
        all.finish()
    }
}

fn pattern(cells: &[f64], row: usize) -> Result<Pattern, ImportError> {
    if let Some(at) = cells.iter().position(|cell| *cell != 0.0 && *cell != 1.0) {
        return Err(ImportError::Cell {
            row,
            y: at / CELLS,
            x: at % CELLS,
            found: cells[at],
        });
    }
    Ok(Pattern::from_fn(Raster::PAPER, |x, y| cells[y * CELLS + x] == 1.0))
}

/// The frame of what is kept stands still: rounding is no displacement.
fn field(values: &[f64], row: usize, side_mm: f64) -> Result<Field, ImportError> {
    let mut kept = Vec::with_capacity(VALUES);
    for (corner, u) in values.chunks_exact(2).enumerate() {
        let (x, y) = (corner % CORNERS, corner / CORNERS);
        let found_mm = u[0].hypot(u[1]);
        if !found_mm.is_finite() {
            let found = if u[0].is_finite() { u[1] } else { u[0] };
            return Err(ImportError::NotFinite { row, y, x, found });
        }
        if found_mm > side_mm {
            return Err(ImportError::Far {
                row,
                y,
                x,
                found_mm,
                side_mm,
            });
        }
        let on_frame = [x, y].iter().any(|&place| place == 0 || place == CELLS);
        if on_frame && found_mm > ROUNDING_MM {
            return Err(ImportError::Frame { row, y, x, found_mm });
        }
        // Adding zero makes one number of the two zeros.
        kept.extend(u.iter().map(|value| if on_frame { 0.0 } else { value + 0.0 }));
    }
    Field::from_values(Raster::PAPER, kept).map_err(|e| ImportError::Unreadable(e.to_string()))
}

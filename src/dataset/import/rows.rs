//! Imported rows: each is a valid pattern with a field of a clamped membrane.

use std::ops::Range;

use rayon::prelude::*;

use super::error::ImportError;
use crate::Device;
use deaflow_base::{Digest, DigestWriter};
use deaflow_field::Field;
use deaflow_pattern::{Pattern, is_of_mask};

/// Largest displacement on the frame in mm that counts as rounding.
const ROUNDING_MM: f64 = 1e-6;

/// Patterns with their fields.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Rows {
    /// The patterns.
    pub patterns: Vec<Pattern>,
    /// Their fields.
    pub fields: Vec<Field>,
}

impl Rows {
    /// Checks rows of cells `[row][y][x]` and displacements `[row][y][x][component]`.
    /// `first` is the number of the first row in its file.
    ///
    /// # Errors
    /// When a cell is neither 0 nor an electrode group, a displacement is not finite or exceeds the longer side, or the
    /// frame moves.
    pub fn new(cells: &[f64], displacement: Vec<f64>, first: usize, device: &Device) -> Result<Self, ImportError> {
        let rows = cells
            .par_chunks(device.raster().cells())
            .zip(displacement.par_chunks(2 * device.raster().corners()))
            .enumerate();
        let checked = rows.map(|(row, (cells, values))| {
            Ok::<_, ImportError>((
                pattern(cells, first + row, device)?,
                field(values, first + row, device)?,
            ))
        });
        let checked: Vec<(Pattern, Field)> = checked.collect::<Result<_, ImportError>>()?;
        let (patterns, fields) = checked.into_iter().unzip();
        Ok(Self { patterns, fields })
    }

    /// Returns the number of rows.
    #[must_use]
    pub fn len(&self) -> usize {
        self.patterns.len()
    }

    /// Returns whether there are no rows.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.patterns.is_empty()
    }

    /// Returns a range of the rows.
    #[must_use]
    pub fn part(&self, range: Range<usize>) -> Self {
        Self {
            patterns: self.patterns[range.clone()].to_vec(),
            fields: self.fields[range].to_vec(),
        }
    }

    /// Appends other rows.
    pub fn append(&mut self, mut others: Self) {
        self.patterns.append(&mut others.patterns);
        self.fields.append(&mut others.fields);
    }

    /// Returns the digest of the rows. It does not depend on the format of the file.
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

/// Returns a pattern. One whose values are 0 and 255, or 0 and 65535, is a mask.
fn pattern(cells: &[f64], row: usize, device: &Device) -> Result<Pattern, ImportError> {
    let columns = device.raster().columns();
    let mask = cells
        .iter()
        .copied()
        .find(|cell| *cell != 0.0)
        .filter(|cell| is_of_mask(*cell));
    let is_allowed = |cell: f64| match mask {
        Some(electrode) => cell == 0.0 || cell == electrode,
        None => cell.fract() == 0.0 && (0.0..=device.groups as f64).contains(&cell),
    };
    if let Some(at) = cells.iter().position(|cell| !is_allowed(*cell)) {
        return Err(ImportError::Cell {
            row,
            y: at / columns,
            x: at % columns,
            found: cells[at],
        });
    }
    Ok(Pattern::from_groups(device.raster(), |x, y| {
        let cell = cells[y * columns + x];
        if mask == Some(cell) { 1 } else { cell as u8 }
    }))
}

/// Checks the values of a field. Displacements on the frame become exactly 0.
fn field(values: &[f64], row: usize, device: &Device) -> Result<Field, ImportError> {
    let columns = device.raster().corner_sides()[0];
    let side_mm = device.membrane.size_mm.into_iter().fold(0.0, f64::max);
    let mut kept = Vec::with_capacity(values.len());
    for (corner, u) in values.chunks_exact(2).enumerate() {
        let (x, y) = (corner % columns, corner / columns);
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
                size: device.membrane.size_text(),
            });
        }
        let on_frame = device.is_on_frame(corner);
        if on_frame && found_mm > ROUNDING_MM {
            return Err(ImportError::Frame { row, y, x, found_mm });
        }
        // Adding zero turns -0 into 0.
        kept.extend(u.iter().map(|value| if on_frame { 0.0 } else { value + 0.0 }));
    }
    Field::from_values(device.raster(), kept).map_err(|e| ImportError::Unreadable(e.to_string()))
}

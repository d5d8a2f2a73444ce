//! What a row says about itself, without any simulation.

use super::diagnosis::on_the_frame;
use super::rows::{Batch, Columns, Dataset};
use super::symmetric::{PROJECTIONS, Standing, asymmetry, projections};
use crate::base::{Digest, OrbitId};
use crate::field::{CORNERS, Field};
use crate::pattern::{CELLS, Pattern, Raster, Symmetry};

/// Values of a row: cells, displacements.
const CELL_VALUES: usize = CELLS * CELLS;
const FIELD_VALUES: usize = CORNERS * CORNERS * 2;

/// A row as far as it can be used.
pub struct CheckedRow {
    /// Its pattern, where it is one.
    pub pattern: Option<Pattern>,
    /// Its field, where it claims to have one and all values are numbers.
    pub field: Option<Field>,
    /// Whether it claims to have no field.
    pub claims_none: bool,
    /// Whether it claims to have none and has one: numbers, and not all of them zero.
    pub is_hidden: bool,
}

impl CheckedRow {
    /// Row `at` of a batch; `has_field` is what the dataset claims.
    #[must_use]
    pub fn of(batch: &Batch, at: usize, has_field: bool) -> Self {
        let cells: Option<Vec<u8>> = batch.cells[at * CELL_VALUES..][..CELL_VALUES]
            .iter()
            .map(|&cell| [0.0, 1.0].iter().position(|&known| known == cell).map(|k| k as u8))
            .collect();
        let values = &batch.displacement[at * FIELD_VALUES..][..FIELD_VALUES];
        Self {
            pattern: cells.and_then(|cells| Pattern::from_cells(Raster::PAPER, &cells).ok()),
            field: has_field
                .then(|| Field::from_values(Raster::PAPER, values.to_vec()).ok())
                .flatten(),
            claims_none: !has_field,
            is_hidden: !has_field && values.iter().all(|u| u.is_finite()) && values.iter().any(|&u| u != 0.0),
        }
    }

    /// Pattern and field, where the row has both.
    #[must_use]
    pub fn usable(&self) -> Option<(&Pattern, &Field)> {
        Some((self.pattern.as_ref()?, self.field.as_ref()?))
    }
}

/// What stays of a row once it has been read.
pub struct Facts {
    /// Whether each cell is 0 or 1.
    pub is_pattern: bool,
    /// Whether the row claims to have a field.
    pub claims_field: bool,
    /// Whether it has one, of numbers.
    pub has_field: bool,
    /// Whether it claims to have none and has one.
    pub is_hidden: bool,
    /// Largest displacement magnitude on the frame, mm.
    pub frame: f64,
    /// Largest displacement magnitude, mm.
    pub peak: f64,
    /// Part of the membrane that is active.
    pub area: f64,
    /// Sides between an active and a bare cell: what a mesh has to resolve.
    pub edges: usize,
    /// Identity of the pattern, and the one that it shares with its images.
    pub identity: Option<(Digest, OrbitId)>,
    /// Identity of the pattern that the declared symmetry carries to this one.
    pub unturned: Option<Digest>,
    /// Whether the pattern may be of the declared family; `None` where that is not known.
    pub fits_family: Option<bool>,
    /// How far the field is from having the symmetries of its pattern, mm.
    pub asymmetry: f64,
    /// Projections of the field in the frame of the smallest image, mm.
    pub projections: [f64; PROJECTIONS],
}

impl Facts {
    /// What is to be kept of row `index` of the dataset.
    #[must_use]
    pub fn of(row: &CheckedRow, index: usize, dataset: &Dataset<'_>) -> Self {
        let columns = &dataset.columns;
        let standing = row.pattern.as_ref().map(Standing::of);
        let field = row.field.as_ref();
        let mut facts = Self {
            is_pattern: row.pattern.is_some(),
            claims_field: claims_field(columns, index),
            has_field: field.is_some(),
            is_hidden: row.is_hidden,
            frame: field.map_or(0.0, on_the_frame),
            peak: field.map_or(0.0, Field::max_magnitude),
            area: row.pattern.as_ref().map_or(0.0, Pattern::area_fraction),
            edges: row.pattern.as_ref().map_or(0, edges),
            identity: standing.as_ref().map(|standing| (standing.pattern, standing.orbit)),
            unturned: row
                .pattern
                .as_ref()
                .and_then(|pattern| unturned(pattern, columns, index)),
            fits_family: row.pattern.as_ref().and_then(|pattern| {
                let family = &columns.family.as_ref()?[index];
                dataset.families.admits(family, pattern)
            }),
            asymmetry: 0.0,
            projections: [0.0; PROJECTIONS],
        };
        if let (Some(standing), Some(field)) = (standing, field) {
            facts.asymmetry = asymmetry(field, &standing.stabiliser);
            facts.projections = projections(&field.transformed(standing.to_smallest));
        }
        facts
    }

    /// Whether the row has a pattern and a field.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.is_pattern && self.has_field
    }
}

/// Whether row `index` claims to have a field: all do, unless the dataset says how each ended.
#[must_use]
pub fn claims_field(columns: &Columns, index: usize) -> bool {
    columns.has_field.as_ref().is_none_or(|claims| claims[index])
}

fn unturned(pattern: &Pattern, columns: &Columns, index: usize) -> Option<Digest> {
    let symmetry = usize::try_from(columns.symmetry.as_ref()?[index]).ok()?;
    let turned = pattern.transformed(Symmetry::ALL.get(symmetry)?.inverse());
    Some(Digest::of(turned.cells()))
}

fn edges(pattern: &Pattern) -> usize {
    let cell = |x: usize, y: usize| pattern.is_active(x, y);
    let inner = (0..CELLS - 1).flat_map(|i| (0..CELLS).map(move |k| (i, k)));
    inner
        .map(|(i, k)| usize::from(cell(i, k) != cell(i + 1, k)) + usize::from(cell(k, i) != cell(k, i + 1)))
        .sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn edges_are_counted_between_cells() {
        assert_eq!(edges(&Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (20, 30))), 4);
        assert_eq!(edges(&Pattern::from_fn(Raster::PAPER, |x, _| x < 25)), 50);
        assert_eq!(
            edges(&Pattern::from_fn(Raster::PAPER, |x, y| (x + y) % 2 == 0)),
            2 * 49 * 50
        );
    }

    #[test]
    fn what_is_no_pattern_or_no_number_is_not_used() {
        let mut batch = Batch {
            cells: vec![0.0; CELL_VALUES],
            displacement: vec![0.0; FIELD_VALUES],
        };
        assert!(CheckedRow::of(&batch, 0, true).usable().is_some());
        assert!(CheckedRow::of(&batch, 0, false).usable().is_none());
        batch.displacement[3] = f64::NAN;
        batch.cells[7] = 0.5;
        let row = CheckedRow::of(&batch, 0, true);
        assert!(row.pattern.is_none() && row.field.is_none());
    }
}

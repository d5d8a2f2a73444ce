//! What a row says about itself, without any simulation.

use super::rows::{Batch, Columns, Dataset};
use super::symmetric::{PROJECTIONS, Projections, Standing, asymmetry};
use crate::Device;
use deaflow_base::{Digest, OrbitId};
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Symmetry};

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
    /// Row `at` of a batch of a device; `has_field` is what the dataset claims.
    #[must_use]
    pub fn of(batch: &Batch, at: usize, has_field: bool, device: &Device) -> Self {
        let (raster, groups) = (device.raster(), device.groups as f64);
        let is_group = |cell: f64| cell.fract() == 0.0 && (0.0..=groups).contains(&cell);
        let (cells, fields) = (raster.cells(), 2 * raster.corners());
        let cells: Option<Vec<u8>> = batch.cells[at * cells..][..cells]
            .iter()
            .map(|&cell| is_group(cell).then_some(cell as u8))
            .collect();
        let values = &batch.displacement[at * fields..][..fields];
        Self {
            pattern: cells.and_then(|cells| Pattern::of_form(device.form(), &cells).ok()),
            field: has_field
                .then(|| Field::from_values(raster, values.to_vec()).ok())
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
    pub fn of(row: &CheckedRow, index: usize, dataset: &Dataset<'_>, projections: &Projections) -> Self {
        let (columns, device) = (&dataset.columns, dataset.device);
        let standing = row
            .pattern
            .as_ref()
            .map(|pattern| Standing::of(pattern, device.symmetries));
        let field = row.field.as_ref();
        let mut facts = Self {
            is_pattern: row.pattern.is_some(),
            claims_field: claims_field(columns, index),
            has_field: field.is_some(),
            is_hidden: row.is_hidden,
            frame: field.map_or(0.0, |field| device.on_the_frame(field)),
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
            facts.projections = projections.of(&field.transformed(standing.to_smallest));
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
    let [columns, rows] = pattern.raster().sides();
    let cell = |x: usize, y: usize| pattern.group(x, y);
    let along = (0..rows).flat_map(|y| (1..columns).map(move |x| cell(x, y) != cell(x - 1, y)));
    let across = (1..rows).flat_map(|y| (0..columns).map(move |x| cell(x, y) != cell(x, y - 1)));
    along.chain(across).filter(|differs| *differs).count()
}

#[cfg(test)]
mod tests {
    use super::*;
    use deaflow_pattern::{Membrane, Raster, Symmetries};

    #[test]
    fn edges_are_counted_between_cells() {
        assert_eq!(edges(&Pattern::from_fn(Raster::PAPER, |x, y| (x, y) == (20, 30))), 4);
        assert_eq!(edges(&Pattern::from_fn(Raster::PAPER, |x, _| x < 25)), 50);
        assert_eq!(
            edges(&Pattern::from_fn(Raster::PAPER, |x, y| (x + y) % 2 == 0)),
            2 * 49 * 50
        );
        let raster = Raster::new(7, 3).unwrap();
        assert_eq!(edges(&Pattern::from_groups(raster, |x, _| x as u8 / 3)), 6);
    }

    #[test]
    fn what_is_no_pattern_or_no_number_is_not_used() {
        let raster = Raster::new(7, 3).unwrap();
        let membrane = Membrane {
            raster,
            size_mm: [7.0, 6.0],
        };
        let device = Device::new(membrane, 2, Symmetries::RECTANGLE, None);
        let mut batch = Batch {
            cells: vec![2.0; raster.cells()],
            displacement: vec![0.0; 2 * raster.corners()],
        };
        assert!(CheckedRow::of(&batch, 0, true, &device).usable().is_some());
        assert!(CheckedRow::of(&batch, 0, false, &device).usable().is_none());
        batch.displacement[3] = f64::NAN;
        batch.cells[7] = 0.5;
        let row = CheckedRow::of(&batch, 0, true, &device);
        assert!(row.pattern.is_none() && row.field.is_none());
    }
}

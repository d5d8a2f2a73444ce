//! Properties of a row that need no simulation.

use super::rows::{Batch, Columns, Dataset};
use super::symmetric::{PROJECTIONS, PatternSymmetry, Projections, asymmetry};
use crate::Device;
use deaflow_base::{Digest, OrbitId};
use deaflow_field::Field;
use deaflow_pattern::{Pattern, Symmetry};

/// The valid parts of a row.
pub struct CheckedRow {
    /// Its pattern, if valid.
    pub pattern: Option<Pattern>,
    /// Its field, if the row claims to have one and all values are finite.
    pub field: Option<Field>,
    /// Whether the row claims to have no field.
    pub claims_none: bool,
    /// Whether the row claims to have no field, but has finite values that are not all zero.
    pub is_hidden: bool,
}

impl CheckedRow {
    /// Checks row `at` of a batch; `has_field` is the claim of the dataset.
    #[must_use]
    pub fn of(batch: &Batch, at: usize, has_field: bool, device: &Device) -> Self {
        let (raster, groups) = (device.raster(), device.groups as f64);
        let is_group = |cell: f64| cell.fract() == 0.0 && (0.0..=groups).contains(&cell);
        let (cells, fields) = (raster.cells(), 2 * raster.corners());
        let cells = batch.cells[at * cells..][..cells].iter();
        let cells: Option<Vec<u8>> = cells.map(|&cell| is_group(cell).then_some(cell as u8)).collect();
        let values = &batch.displacement[at * fields..][..fields];
        let field = || Field::from_values(raster, values.to_vec()).ok();
        Self {
            pattern: cells.and_then(|cells| Pattern::of_form(device.form(), &cells).ok()),
            field: has_field.then(field).flatten(),
            claims_none: !has_field,
            is_hidden: !has_field && values.iter().all(|u| u.is_finite()) && values.iter().any(|&u| u != 0.0),
        }
    }

    /// Returns pattern and field, if the row has both.
    #[must_use]
    pub fn usable(&self) -> Option<(&Pattern, &Field)> {
        Some((self.pattern.as_ref()?, self.field.as_ref()?))
    }
}

/// The properties of a row that are kept in memory.
pub struct Facts {
    /// Whether all cells are valid.
    pub is_pattern: bool,
    /// Whether the row claims to have a field.
    pub claims_field: bool,
    /// Whether it has a field of finite values.
    pub has_field: bool,
    /// Whether it claims to have no field, but has one.
    pub is_hidden: bool,
    /// Largest displacement magnitude on the frame, mm.
    pub frame: f64,
    /// Largest displacement magnitude, mm.
    pub peak: f64,
    /// Active part of the membrane.
    pub area: f64,
    /// Number of sides between different cells, a measure of the detail that a mesh must resolve.
    pub edges: usize,
    /// Digest and orbit of the pattern.
    pub identity: Option<(Digest, OrbitId)>,
    /// Digest of the pattern that the declared symmetry maps to this pattern.
    pub source_pattern: Option<Digest>,
    /// Whether the pattern can belong to the declared family; `None` if unknown.
    pub fits_family: Option<bool>,
    /// Largest difference between the field and its images under the symmetries of its pattern, mm.
    pub asymmetry: f64,
    /// Projections of the field, transformed with the pattern to the smallest image, mm.
    pub projections: [f64; PROJECTIONS],
}

impl Facts {
    /// Computes the properties of row `index` of the dataset.
    #[must_use]
    pub fn of(row: &CheckedRow, index: usize, dataset: &Dataset<'_>, projections: &Projections) -> Self {
        let (columns, device) = (&dataset.columns, dataset.device);
        let (pattern, field) = (row.pattern.as_ref(), row.field.as_ref());
        let symmetry = pattern.map(|pattern| PatternSymmetry::of(pattern, device.symmetries));
        let fits_family = |pattern| {
            let family = &columns.family.as_ref()?[index];
            dataset.families.admits(family, pattern)
        };
        let mut facts = Self {
            is_pattern: pattern.is_some(),
            claims_field: claims_field(columns, index),
            has_field: field.is_some(),
            is_hidden: row.is_hidden,
            frame: field.map_or(0.0, |field| device.max_on_frame(field)),
            peak: field.map_or(0.0, Field::max_magnitude),
            area: pattern.map_or(0.0, |pattern| pattern.area_fraction(device.free.as_ref())),
            edges: pattern.map_or(0, edges),
            identity: symmetry.as_ref().map(|symmetry| (symmetry.pattern, symmetry.orbit)),
            source_pattern: pattern.and_then(|pattern| source_pattern(pattern, columns, index)),
            fits_family: pattern.and_then(fits_family),
            asymmetry: 0.0,
            projections: [0.0; PROJECTIONS],
        };
        if let (Some(symmetry), Some(field)) = (symmetry, field) {
            facts.asymmetry = asymmetry(field, &symmetry.stabiliser);
            facts.projections = projections.of(&field.transformed(symmetry.to_smallest));
        }
        facts
    }

    /// Returns whether the row has a pattern and a field.
    #[must_use]
    pub fn is_usable(&self) -> bool {
        self.is_pattern && self.has_field
    }
}

/// Returns whether row `index` claims to have a field. Without the column `outcome` all rows do.
#[must_use]
pub fn claims_field(columns: &Columns, index: usize) -> bool {
    columns.has_field.as_ref().is_none_or(|claims| claims[index])
}

fn source_pattern(pattern: &Pattern, columns: &Columns, index: usize) -> Option<Digest> {
    let symmetry = usize::try_from(columns.symmetry.as_ref()?[index]).ok()?;
    let source = pattern.transformed(Symmetry::ALL.get(symmetry)?.inverse());
    Some(Digest::of(source.cells()))
}

/// Returns the number of sides between different cells.
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
    fn invalid_cells_and_displacements_are_not_used() {
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

//! The device that the rows of a dataset are patterns and fields of.

use deaflow_field::Field;
use deaflow_pattern::{Membrane, Part, Parts, PatternForm, Raster, Symmetries};

/// A file holds fewer rows than this many bytes to each row of the source paper's membrane: DEFLATE, the densest filter, makes a thousandth
/// of its 20 kB.
const BYTES_OF_ROW: u64 = 16;

/// Whether so many rows on these cells are more than a file of that many bytes holds.
#[must_use]
pub fn is_overlong(rows: u64, raster: Raster, bytes: u64) -> bool {
    let [own, paper] = [raster, Raster::PAPER].map(|raster| raster.corners() as u64);
    rows.saturating_mul(own) > (bytes / BYTES_OF_ROW).saturating_mul(paper)
}

/// What rows are held to.
#[derive(Clone, Debug)]
pub struct Device {
    /// Its rectangle.
    pub membrane: Membrane,
    /// How many groups of electrodes patterns may have.
    pub groups: usize,
    /// What maps it to itself.
    pub symmetries: Symmetries,
    /// Whether each corner of cells is held by the frame.
    held: Vec<bool>,
}

impl Device {
    /// A device by its parts; without these all cells are membrane, held on its edges.
    #[must_use]
    pub fn new(membrane: Membrane, groups: usize, symmetries: Symmetries, parts: Option<&Parts>) -> Self {
        let [columns, rows] = membrane.raster.corner_sides();
        let is_held = |x: usize, y: usize| match parts {
            Some(parts) => parts.around(x, y).contains(&Part::Frame),
            None => x == 0 || y == 0 || x == columns - 1 || y == rows - 1,
        };
        Self {
            membrane,
            groups,
            symmetries,
            held: (0..columns * rows)
                .map(|at| is_held(at % columns, at / columns))
                .collect(),
        }
    }

    /// Its cells.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.membrane.raster
    }

    /// What patterns of it are.
    #[must_use]
    pub fn form(&self) -> PatternForm {
        PatternForm {
            raster: self.raster(),
            groups: self.groups,
        }
    }

    /// Whether the frame holds a corner of cells, by its place in `[y][x]`.
    ///
    /// # Panics
    /// When there is no such corner.
    #[must_use]
    pub fn holds(&self, corner: usize) -> bool {
        self.held[corner]
    }

    /// The largest displacement magnitude of a field in mm where the frame holds the membrane.
    #[must_use]
    pub fn on_the_frame(&self, field: &Field) -> f64 {
        let corners = field.values().chunks_exact(2).zip(&self.held);
        let held = corners.filter(|(_, is_held)| **is_held);
        held.map(|(u, _)| u[0].hypot(u[1])).fold(0.0, f64::max)
    }

    /// The field with nothing on the frame.
    #[must_use]
    pub fn inside(&self, field: &Field) -> Field {
        let values = field.values().iter().enumerate();
        let values = values.map(|(at, &u)| if self.held[at / 2] { 0.0 } else { u });
        Field::from_values(field.raster(), values.collect()).unwrap_or_else(|_| Field::zero(field.raster()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_frame_is_told_from_the_inside() {
        let raster = Raster::new(4, 3).unwrap();
        let membrane = Membrane {
            raster,
            size_mm: [8.0, 3.0],
        };
        let part = |x: usize, _| if x == 0 { Part::Frame } else { Part::Membrane };
        let parts = Parts::new(raster, 0, part).unwrap();
        // The corners of one row, from the left.
        let row = |device: &Device| [5, 6, 7, 8, 9].map(|corner| device.holds(corner));
        let plain = Device::new(membrane, 1, Symmetries::RECTANGLE, None);
        assert_eq!(row(&plain), [true, false, false, false, true]);
        let framed = Device::new(membrane, 1, Symmetries::RECTANGLE, Some(&parts));
        assert_eq!(row(&framed), [true, true, false, false, true]);
        let mut values = vec![0.0; 2 * raster.corners()];
        values[2 * 7] = 0.5;
        let inner = Field::from_values(raster, values.clone()).unwrap();
        values[2 * 6 + 1] = -0.25;
        let moved = Field::from_values(raster, values).unwrap();
        assert_eq!([&plain, &framed].map(|device| device.on_the_frame(&moved)), [0.0, 0.25]);
        assert_eq!((plain.inside(&moved), framed.inside(&moved)), (moved, inner));
    }
}

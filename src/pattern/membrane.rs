//! The rectangle that patterns are drawn on.

use super::raster::Raster;
use super::symmetry::Symmetries;

/// A membrane as those see it who draw on it: its sides, and its cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Membrane {
    /// Its cells.
    pub raster: Raster,
    /// Its sides along x and y in mm.
    pub size_mm: [f64; 2],
}

impl Membrane {
    /// A square with the raster of the source paper, its side in mm.
    #[must_use]
    pub const fn square(side_mm: f64) -> Self {
        Self {
            raster: Raster::PAPER,
            size_mm: [side_mm; 2],
        }
    }

    /// What maps it to itself, cell by cell.
    #[must_use]
    pub fn symmetries(&self) -> Symmetries {
        match self.raster.is_square() && self.size_mm[0] == self.size_mm[1] {
            true => Symmetries::SQUARE,
            false => Symmetries::RECTANGLE,
        }
    }

    /// Its sides for people: one for a square.
    #[must_use]
    pub fn size_text(&self) -> String {
        match self.size_mm {
            [x, y] if x == y => format!("{x} mm"),
            [x, y] => format!("{x} × {y} mm"),
        }
    }

    /// The sides of a cell in mm.
    #[must_use]
    pub fn cell_mm(&self) -> [f64; 2] {
        let [columns, rows] = self.raster.sides();
        [self.size_mm[0] / columns as f64, self.size_mm[1] / rows as f64]
    }

    /// The centre of the cell at column `x`, row `y`, in mm from the lower left corner.
    #[must_use]
    pub fn centre_mm(&self, x: usize, y: usize) -> [f64; 2] {
        let [columns, rows] = self.raster.sides();
        let centre = |cell: usize, size: f64, cells: usize| (cell as f64 + 0.5) * size / cells as f64;
        [centre(x, self.size_mm[0], columns), centre(y, self.size_mm[1], rows)]
    }

    /// A point in mm from the lower left corner, in cells.
    #[must_use]
    pub fn in_cells(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [columns, rows] = self.raster.sides();
        [x / self.size_mm[0] * columns as f64, y / self.size_mm[1] * rows as f64]
    }
}

//! The rectangle that carries the electrode pattern.

use super::raster::Raster;
use super::symmetry::Symmetries;

/// The size of a membrane and its cells.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Membrane {
    /// The cells.
    pub raster: Raster,
    /// The sides along x and y in mm.
    pub size_mm: [f64; 2],
}

impl Membrane {
    /// Returns a square membrane with the raster of the source paper; the side is in mm.
    #[must_use]
    pub const fn square(side_mm: f64) -> Self {
        Self {
            raster: Raster::PAPER,
            size_mm: [side_mm; 2],
        }
    }

    /// Returns the volume in ml below a mean height of 1 mm.
    #[must_use]
    pub fn ml_per_mm(&self) -> f64 {
        1e-3 * self.size_mm.iter().product::<f64>()
    }

    /// Returns the symmetries that map the membrane to itself, cell by cell.
    #[must_use]
    pub fn symmetries(&self) -> Symmetries {
        match self.raster.is_square() && self.size_mm[0] == self.size_mm[1] {
            true => Symmetries::SQUARE,
            false => Symmetries::RECTANGLE,
        }
    }

    /// Formats the size: one side for a square.
    #[must_use]
    pub fn size_text(&self) -> String {
        match self.size_mm {
            [x, y] if x == y => format!("{x} mm"),
            [x, y] => format!("{x} × {y} mm"),
        }
    }

    /// Returns the sides of a cell in mm.
    #[must_use]
    pub fn cell_mm(&self) -> [f64; 2] {
        let [columns, rows] = self.raster.sides();
        [self.size_mm[0] / columns as f64, self.size_mm[1] / rows as f64]
    }

    /// Returns the centre of the cell at column `x`, row `y`, in mm from the lower left corner.
    #[must_use]
    pub fn centre_mm(&self, x: usize, y: usize) -> [f64; 2] {
        let [columns, rows] = self.raster.sides();
        let centre = |cell: usize, size: f64, cells: usize| (cell as f64 + 0.5) * size / cells as f64;
        [centre(x, self.size_mm[0], columns), centre(y, self.size_mm[1], rows)]
    }

    /// Converts a point in mm from the lower left corner to cells.
    #[must_use]
    pub fn in_cells(&self, [x, y]: [f64; 2]) -> [f64; 2] {
        let [columns, rows] = self.raster.sides();
        [x / self.size_mm[0] * columns as f64, y / self.size_mm[1] * rows as f64]
    }
}

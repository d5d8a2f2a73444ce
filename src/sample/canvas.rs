//! The cells on which patterns are drawn.

use std::sync::Arc;

use deaflow_base::{Canonical, Decimal};
use deaflow_pattern::{Bits, Membrane, Pattern, Raster};

/// The shorter side of a membrane in units of length; on the source paper's membrane a unit is a cell.
const LENGTHS: f64 = 50.0;

/// The cells of a membrane and their sides. Lengths are in fiftieths of the shorter side of the membrane, so that a
/// family looks the same on every membrane; on the source paper's these are cells.
#[derive(Clone, Debug, PartialEq)]
pub struct Canvas {
    raster: Raster,
    /// The sides of a cell.
    cell: [f64; 2],
    /// The cells that are neither frame nor body; `None` if all are free.
    free: Option<Arc<Bits>>,
}

impl Canvas {
    /// The canvas of the source paper.
    pub const PAPER: Self = Self {
        raster: Raster::PAPER,
        cell: [1.0; 2],
        free: None,
    };

    /// Returns the canvas of a membrane.
    #[must_use]
    pub fn of(membrane: &Membrane) -> Self {
        let [width, height] = membrane.size_mm;
        let length = width.min(height) / LENGTHS;
        Self {
            raster: membrane.raster,
            cell: membrane.cell_mm().map(|side| side / length),
            free: None,
        }
    }

    /// Returns the canvas on which only some cells are free: area fractions are shares of these.
    #[must_use]
    pub fn with_free(self, free: Option<Bits>) -> Self {
        Self {
            free: free.map(Arc::new),
            ..self
        }
    }

    /// Returns the cells that are neither frame nor body; `None` if all are free.
    #[must_use]
    pub fn free(&self) -> Option<&Bits> {
        self.free.as_deref()
    }

    /// Returns the numbers of the free cells, in ascending order.
    pub(super) fn free_cells(&self) -> Vec<usize> {
        let columns = self.raster.columns();
        let is_free = |cell: &usize| self.free().is_none_or(|free| free.has(cell % columns, cell / columns));
        (0..self.raster.cells()).filter(is_free).collect()
    }

    /// Returns how many cells are free.
    #[must_use]
    pub fn free_count(&self) -> usize {
        self.free().map_or(self.raster.cells(), Bits::count)
    }

    /// The cells.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// The sides of a cell.
    #[must_use]
    pub fn cell(&self) -> [f64; 2] {
        self.cell
    }

    /// The sides.
    #[must_use]
    pub fn size(&self) -> [f64; 2] {
        let [columns, rows] = self.raster.sides().map(|count| count as f64);
        [columns * self.cell[0], rows * self.cell[1]]
    }

    /// The centre of the canvas.
    #[must_use]
    pub fn middle(&self) -> [f64; 2] {
        self.size().map(|side| 0.5 * side)
    }

    /// Returns the centre of a cell (column, row) from the lower left corner.
    #[must_use]
    pub fn centre(&self, x: usize, y: usize) -> [f64; 2] {
        [(x as f64 + 0.5) * self.cell[0], (y as f64 + 0.5) * self.cell[1]]
    }

    /// Returns the centres of all cells, `[y][x]`.
    pub fn centres(&self) -> impl Iterator<Item = [f64; 2]> {
        let columns = self.raster.columns();
        (0..self.raster.cells()).map(move |cell| self.centre(cell % columns, cell / columns))
    }

    /// Returns the pattern of the active cells, `[y][x]`.
    #[must_use]
    pub fn pattern(&self, active: &[bool]) -> Pattern {
        let columns = self.raster.columns();
        Pattern::from_fn(self.raster, |x, y| active[y * columns + x])
    }

    /// Returns the parameters that distinguish samples from those on the source paper's membrane, for keys.
    #[must_use]
    pub fn parameters(&self) -> Vec<(&'static str, Canonical)> {
        if (self.raster, self.cell) == (Self::PAPER.raster, Self::PAPER.cell) {
            return Vec::new();
        }
        let [columns, rows] = self.raster.sides();
        let aspect = Decimal::from_f64(self.cell[0] / self.cell[1]).unwrap_or(Decimal::ZERO);
        vec![
            ("cells", [columns, rows].into_iter().map(Canonical::from).collect()),
            ("cell_aspect", aspect.into()),
        ]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_are_cells_on_the_membrane_of_the_paper() {
        for side in [50.0, 51.0, 20.0, 33.3] {
            assert_eq!(Canvas::of(&Membrane::square(side)), Canvas::PAPER);
        }
        assert!(Canvas::PAPER.parameters().is_empty());
        let canvas = Canvas::of(&Membrane {
            raster: Raster::new(120, 40).unwrap(),
            size_mm: [60.0, 30.0],
        });
        assert_eq!(canvas.size(), [100.0, 50.0]);
        assert_eq!(
            (canvas.middle(), canvas.centre(0, 0)),
            ([50.0, 25.0], [5.0 / 12.0, 0.625])
        );
        assert_eq!(canvas.parameters().len(), 2);
    }
}

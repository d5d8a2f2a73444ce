//! The raster of square cells that a pattern is drawn on.

use std::fmt;

use super::symmetry::Symmetry;
use crate::base::OrbitId;

/// Cells along one side of the membrane. The source paper's membrane has 50 × 50.
pub const CELLS: usize = 50;

/// An electrode pattern: 50 × 50 cells, `[y][x]` with the origin at the lower left, 1 = electrode, 0 = bare.
#[derive(Clone, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct Pattern {
    cells: Box<[u8]>,
}

/// Numbers that are not a pattern.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PatternError {
    /// The wrong number of cells.
    #[error("a pattern has {} cells (50 × 50), found {found}", CELLS * CELLS)]
    Shape {
        /// How many values there were.
        found: usize,
    },
    /// A value other than 0 and 1.
    #[error("cell [y={y}][x={x}] is {found}; a cell is 0 (bare) or 1 (electrode)")]
    Value {
        /// Row, from below.
        y: usize,
        /// Column, from the left.
        x: usize,
        /// What stood there.
        found: u8,
    },
}

impl Pattern {
    /// A pattern from its 2500 cells, row by row from below.
    ///
    /// # Errors
    /// When there are not 2500 values, or one is neither 0 nor 1.
    pub fn from_cells(cells: &[u8]) -> Result<Self, PatternError> {
        if cells.len() != CELLS * CELLS {
            return Err(PatternError::Shape { found: cells.len() });
        }
        match cells.iter().position(|&c| c > 1) {
            Some(at) => Err(PatternError::Value {
                y: at / CELLS,
                x: at % CELLS,
                found: cells[at],
            }),
            None => Ok(Self { cells: cells.into() }),
        }
    }

    /// The pattern whose cell (x, y) is active where `active(x, y)`.
    #[must_use]
    pub fn from_fn(active: impl Fn(usize, usize) -> bool) -> Self {
        Self {
            cells: (0..CELLS * CELLS)
                .map(|i| u8::from(active(i % CELLS, i / CELLS)))
                .collect(),
        }
    }

    /// All cells, row by row from below.
    #[must_use]
    pub fn cells(&self) -> &[u8] {
        &self.cells
    }

    /// Whether the cell at column `x`, row `y` carries an electrode.
    ///
    /// # Panics
    /// When `x` or `y` is not below 50.
    #[must_use]
    pub fn is_active(&self, x: usize, y: usize) -> bool {
        assert!(x < CELLS && y < CELLS, "cell ({x}, {y}) is outside the membrane");
        self.cells[y * CELLS + x] == 1
    }

    /// How many cells are active.
    #[must_use]
    pub fn active_cells(&self) -> usize {
        self.cells.iter().map(|&c| usize::from(c)).sum()
    }

    /// The share of active cells, 0 to 1.
    #[must_use]
    pub fn area_fraction(&self) -> f64 {
        self.active_cells() as f64 / (CELLS * CELLS) as f64
    }

    /// The image under a symmetry: `(gS)(gX) = S(X)`.
    #[must_use]
    pub fn transformed(&self, g: Symmetry) -> Self {
        let mut cells = vec![0; CELLS * CELLS].into_boxed_slice();
        for (&cell, to) in self.cells.iter().zip(g.permutation(CELLS)) {
            cells[to] = cell;
        }
        Self { cells }
    }

    /// The identity shared by a pattern and its seven images: the digest of the smallest of the eight.
    #[must_use]
    pub fn orbit(&self) -> OrbitId {
        let smallest = Symmetry::ALL.iter().map(|&g| self.transformed(g)).min();
        OrbitId::of(&smallest.expect("there are eight symmetries").cells)
    }
}

impl fmt::Debug for Pattern {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Pattern({} of {} cells active)", self.active_cells(), CELLS * CELLS)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn refuses_what_is_not_a_pattern() {
        assert_eq!(
            Pattern::from_cells(&[0; 10]).unwrap_err(),
            PatternError::Shape { found: 10 }
        );
        let mut cells = vec![0; 2500];
        cells[103] = 2;
        assert_eq!(
            Pattern::from_cells(&cells).unwrap_err(),
            PatternError::Value { y: 2, x: 3, found: 2 }
        );
    }

    #[test]
    fn a_rotation_carries_the_lower_left_corner_to_the_lower_right() {
        let corner = Pattern::from_fn(|x, y| x == 0 && y == 0);
        let quarter = Symmetry::ALL[1];
        assert!(corner.transformed(quarter).is_active(CELLS - 1, 0));
    }

    #[test]
    fn all_images_share_one_orbit() {
        let pattern = Pattern::from_fn(|x, y| (3 * x + y * y) % 7 < 3 && x > y / 2);
        for g in Symmetry::ALL {
            assert_eq!(pattern.transformed(g).orbit(), pattern.orbit());
            assert_eq!(pattern.transformed(g).transformed(g.inverse()), pattern);
        }
        let mut other = pattern.cells().to_vec();
        other[17] ^= 1;
        assert_ne!(Pattern::from_cells(&other).unwrap().orbit(), pattern.orbit());
    }
}

//! The parts of a device: membrane, frame and rigid bodies.

use super::bits::Bits;
use super::raster::Raster;
use super::symmetry::{Symmetries, Symmetry};

/// What a cell belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Part {
    /// Membrane, which can move.
    Membrane,
    /// Frame, which does not move.
    Frame,
    /// A rigid body, by its number from 0.
    Body(usize),
}

/// The parts of a device.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Parts {
    raster: Raster,
    cells: Vec<Part>,
    bodies: usize,
}

/// Why parts do not form a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PartsError {
    /// The frame covers everything.
    #[error("the frame covers every cell of the membrane")]
    NothingFree,
    /// A body without cells.
    #[error("body {body} covers no cell: it contains the centre of no cell")]
    EmptyBody {
        /// Its number from 0.
        body: usize,
    },
    /// A body that touches the frame.
    #[error("body {body} touches the frame at the cell corner [{x}, {y}]")]
    BodyAtFrame {
        /// Its number from 0.
        body: usize,
        /// Column of the corner.
        x: usize,
        /// Row of the corner.
        y: usize,
    },
    /// Two bodies that touch.
    #[error("bodies {} and {} touch at the cell corner [{x}, {y}]", .bodies[0], .bodies[1])]
    BodiesTouch {
        /// Their numbers from 0.
        bodies: [usize; 2],
        /// Column of the corner.
        x: usize,
        /// Row of the corner.
        y: usize,
    },
}

impl Parts {
    /// Builds the parts from the part of each cell (column, row) and the number of bodies.
    ///
    /// # Errors
    /// When no cell is free, a body has no cell, or a body touches the frame or another body.
    pub fn new(raster: Raster, bodies: usize, part: impl Fn(usize, usize) -> Part) -> Result<Self, PartsError> {
        let cells = (0..raster.cells()).map(|at| part(at % raster.columns(), at / raster.columns()));
        let parts = Self {
            raster,
            cells: cells.collect(),
            bodies,
        };
        parts.check()?;
        Ok(parts)
    }

    fn check(&self) -> Result<(), PartsError> {
        if let Some(body) = (0..self.bodies).find(|body| !self.cells.contains(&Part::Body(*body))) {
            return Err(PartsError::EmptyBody { body });
        }
        let [columns, rows] = self.raster.corner_sides();
        for (x, y) in (0..rows).flat_map(|y| (0..columns).map(move |x| (x, y))) {
            let around = self.around(x, y);
            let Some(body) = around.iter().find_map(|part| part.body()) else {
                continue;
            };
            for other in around {
                match other {
                    Part::Frame => return Err(PartsError::BodyAtFrame { body, x, y }),
                    Part::Body(other) if other != body => {
                        let bodies = [body.min(other), body.max(other)];
                        return Err(PartsError::BodiesTouch { bodies, x, y });
                    }
                    Part::Body(_) | Part::Membrane => {}
                }
            }
        }
        if self.cells.contains(&Part::Membrane) {
            Ok(())
        } else {
            Err(PartsError::NothingFree)
        }
    }

    /// Returns the parts of the cells around a corner; cells beyond the membrane are frame.
    #[must_use]
    pub fn around(&self, x: usize, y: usize) -> [Part; 4] {
        let cell = |x: Option<usize>, y: Option<usize>| match (x, y) {
            (Some(x), Some(y)) if x < self.raster.columns() && y < self.raster.rows() => self.at(x, y),
            _ => Part::Frame,
        };
        let (left, low) = (x.checked_sub(1), y.checked_sub(1));
        [
            cell(left, low),
            cell(Some(x), low),
            cell(left, Some(y)),
            cell(Some(x), Some(y)),
        ]
    }

    /// Returns the raster.
    #[must_use]
    pub fn raster(&self) -> Raster {
        self.raster
    }

    /// Returns the number of bodies.
    #[must_use]
    pub fn bodies(&self) -> usize {
        self.bodies
    }

    /// Returns the part of the cell at column `x`, row `y`.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> Part {
        self.cells[y * self.raster.columns() + x]
    }

    /// Returns the cells whose part satisfies a condition.
    #[must_use]
    pub fn cells(&self, is_in: impl Fn(Part) -> bool) -> Bits {
        Bits::from_fn(self.raster, |x, y| is_in(self.at(x, y)))
    }

    /// Returns the cells that may carry electrodes.
    #[must_use]
    pub fn free_cells(&self) -> Bits {
        self.cells(|part| part == Part::Membrane)
    }

    /// Returns the symmetries that map each part to itself, or a body to another body that `alike` accepts.
    #[must_use]
    pub fn symmetries(&self, of: Symmetries, alike: impl Fn(Symmetry, usize, usize) -> bool) -> Symmetries {
        of.filter(|g| {
            let sides = self.raster.sides();
            let mut images = g.permutation(sides).enumerate();
            self.raster.transformed(g) == self.raster
                && images.all(|(from, to)| match (self.cells[from], self.cells[to]) {
                    (Part::Body(from), Part::Body(to)) => alike(g, from, to),
                    (from, to) => from == to,
                })
        })
    }
}

impl Part {
    /// Returns the number of the body.
    #[must_use]
    pub fn body(self) -> Option<usize> {
        match self {
            Self::Body(body) => Some(body),
            Self::Membrane | Self::Frame => None,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Parts drawn in characters, the first row at the top.
    fn drawn(rows: &[&str]) -> Result<Parts, PartsError> {
        let raster = Raster::new(rows[0].len(), rows.len()).unwrap();
        let part = |x: usize, y: usize| match rows[rows.len() - 1 - y].as_bytes()[x] {
            b'.' => Part::Membrane,
            b'#' => Part::Frame,
            body => Part::Body(usize::from(body - b'0')),
        };
        let bodies = rows.concat().bytes().filter(u8::is_ascii_digit).max();
        Parts::new(raster, bodies.map_or(0, |last| usize::from(last - b'0') + 1), part)
    }

    #[test]
    fn invalid_parts_are_rejected() {
        assert_eq!(drawn(&["##", "##"]), Err(PartsError::NothingFree));
        assert_eq!(drawn(&["...", ".1.", "..."]), Err(PartsError::EmptyBody { body: 0 }));
        let at_frame = |x, y| Err(PartsError::BodyAtFrame { body: 0, x, y });
        assert_eq!(drawn(&["...", "0..", "..."]), at_frame(0, 1));
        assert_eq!(drawn(&["0"]), at_frame(0, 0));
        assert_eq!(drawn(&["....", "..#.", ".0..", "...."]), at_frame(2, 2));
        assert_eq!(
            drawn(&["....", "..1.", ".0..", "...."]),
            Err(PartsError::BodiesTouch {
                bodies: [0, 1],
                x: 2,
                y: 2
            })
        );
        assert!(drawn(&["#.#", ".#.", "#.#"]).is_ok());
    }

    #[test]
    fn symmetries_are_those_of_the_parts() {
        let count = |rows: &[&str]| {
            let parts = drawn(rows).unwrap();
            parts.symmetries(Symmetries::SQUARE, |_, a, b| a == b).count()
        };
        assert_eq!(count(&["....", ".00.", ".00.", "...."]), 8);
        assert_eq!(count(&["#...", "....", "....", "...."]), 2);
        assert_eq!(count(&["....", "##..", "....", "...#"]), 1);
        assert_eq!(count(&[".....", ".0.1.", ".....", ".....", "....."]), 1);
        let parts = drawn(&[".....", ".....", ".0.1.", ".....", "....."]).unwrap();
        assert_eq!(parts.symmetries(Symmetries::SQUARE, |_, _, _| true).count(), 4);
        assert_eq!(parts.symmetries(Symmetries::SQUARE, |_, a, b| a == b).count(), 2);
    }
}

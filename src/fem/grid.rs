//! The elements of a mesh and their sizes, which differ where elements end at the edges of a strip along the sides of cells.

use crate::field::Mesh;

/// The thinnest element, in units of a cell's side.
pub const THINNEST: f64 = 1e-3;
/// The most elements along a cell: those of the finest mesh, and two that strips add.
const MOST: usize = Mesh::MOST_ELEMENTS + 2;

/// The elements of a mesh. Their sizes are the same in every cell, symmetric about its middle, and 1 on the mean: the unit is
/// the side that the elements would have if all had the same.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Grid {
    mesh: Mesh,
    sizes: Option<[f64; MOST]>,
}

impl Grid {
    /// Elements of one size.
    #[must_use]
    pub fn uniform(mesh: Mesh) -> Self {
        Self { mesh, sizes: None }
    }

    /// Elements no larger than those of a mesh, with edges at a distance of `strip` from the sides of each cell, in units of a
    /// cell's side, up to ½. A strip thinner than [`THINNEST`] is made that wide, and a gap that is thinner is closed.
    #[must_use]
    pub fn along_strips(mesh: Mesh, strip: f64) -> Self {
        let strip = strip.max(THINNEST);
        let count = |width: f64| (width * mesh.elements_per_cell() as f64 - 1e-9).ceil() as usize;
        let gap = 1.0 - 2.0 * strip;
        let (strip, inner) = if gap < THINNEST {
            (0.5, 0)
        } else {
            (strip, count(gap).max(1))
        };
        let outer = count(strip).max(1);
        let all = inner + 2 * outer;
        let size = |at: usize| {
            let width = if at < outer || at >= outer + inner {
                strip / outer as f64
            } else {
                gap / inner as f64
            };
            all as f64 * width
        };
        Self {
            mesh: Mesh::new(all, mesh.order()),
            sizes: Some(std::array::from_fn(|at| if at < all { size(at) } else { 1.0 })),
        }
    }

    /// How many elements there are, and of which order.
    #[must_use]
    pub fn mesh(&self) -> Mesh {
        self.mesh
    }

    /// Whether all elements have the same size.
    #[must_use]
    pub fn is_uniform(&self) -> bool {
        self.sizes.is_none()
    }

    /// The size of an element by its column or row.
    #[must_use]
    pub fn size(&self, at: usize) -> f64 {
        self.sizes
            .map_or(1.0, |sizes| sizes[at % self.mesh.elements_per_cell()])
    }

    /// Where an element begins, by its column or row.
    #[must_use]
    pub fn start(&self, at: usize) -> f64 {
        let first = at - at % self.mesh.elements_per_cell();
        first as f64 + (first..at).map(|at| self.size(at)).sum::<f64>()
    }

    /// Where the middle of an element lies in its cell, by its column or row, in units of the cell's side.
    #[must_use]
    pub fn middle_in_cell(&self, at: usize) -> f64 {
        let count = self.mesh.elements_per_cell();
        (self.start(at % count) + 0.5 * self.size(at)) / count as f64
    }
}

impl From<Mesh> for Grid {
    fn from(mesh: Mesh) -> Self {
        Self::uniform(mesh)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_fill_a_cell_symmetrically_and_end_at_the_strip() {
        for asked in 1..=Mesh::MOST_ELEMENTS {
            for strip in [0.001, 1.0 / 64.0, 0.1, 0.125, 0.2, 0.25, 0.3, 0.4, 0.49, 0.5] {
                let grid = Grid::along_strips(Mesh::biquadratic(asked), strip);
                let count = grid.mesh().elements_per_cell();
                assert!((asked..=asked + 2).contains(&count));
                let starts: Vec<f64> = (0..=count).map(|at| grid.start(at) / count as f64).collect();
                assert!((starts[count] - 1.0).abs() < 1e-14);
                for at in 0..count {
                    let size = starts[at + 1] - starts[at];
                    assert!((starts[at] + starts[count - at] - 1.0).abs() < 1e-14);
                    assert!(
                        size >= 0.999 * THINNEST && size * asked as f64 <= 1.0 + 1e-8,
                        "{asked} {strip}"
                    );
                    assert!((grid.size(at + 7 * count) - count as f64 * size).abs() < 1e-12);
                    assert!((grid.middle_in_cell(at + count) - starts[at] - 0.5 * size).abs() < 1e-14);
                }
                for edge in [strip, 1.0 - strip] {
                    assert!(
                        starts.iter().any(|start| (start - edge).abs() < 1e-14),
                        "{asked} {strip}"
                    );
                }
                assert!((grid.start(3 * count + 1) / count as f64 - 3.0 - starts[1]).abs() < 1e-13);
            }
        }
    }

    #[test]
    fn what_is_too_thin_for_an_element_is_widened_or_closed() {
        let starts = |strip| {
            let grid = Grid::along_strips(Mesh::bilinear(2), strip);
            let count = grid.mesh().elements_per_cell();
            (0..=count).map(|at| grid.start(at) / count as f64).collect::<Vec<_>>()
        };
        assert!((starts(1e-6)[1] - THINNEST).abs() < 1e-15);
        assert_eq!(starts(0.4999), [0.0, 0.5, 1.0]);
    }
}

//! Regions of a membrane in mm, and the cells in them.

use super::bits::Bits;
use super::membrane::Membrane;

/// A region of the membrane in mm from its lower left corner.
#[derive(Clone, Debug, PartialEq)]
pub enum Region {
    /// Two opposite corners. The border belongs to the rectangle.
    Rectangle([[f64; 2]; 2]),
    /// A disc. The border belongs to it.
    Disc {
        /// The centre.
        centre: [f64; 2],
        /// The radius.
        radius: f64,
    },
    /// The corners in order. If the polygon crosses itself, the even-odd rule applies. The border belongs to it.
    Polygon(Vec<[f64; 2]>),
    /// Cells of a membrane with this raster.
    Cells(Bits),
}

/// How far outside of a border a point still counts as on it, relative to the coordinates: rounding must not make the
/// cells of a symmetric region asymmetric.
const RESOLUTION: f64 = 1e-12;

impl Region {
    fn contains(&self, [x, y]: [f64; 2]) -> bool {
        match self {
            Self::Cells(_) => false,
            Self::Rectangle([[a, b], [c, d]]) => {
                let between = |at: f64, one: f64, other: f64| {
                    let tolerance = RESOLUTION * (one.abs() + other.abs());
                    at >= one.min(other) - tolerance && at <= one.max(other) + tolerance
                };
                between(x, *a, *c) && between(y, *b, *d)
            }
            Self::Disc { centre, radius } => {
                let tolerance = RESOLUTION * (centre[0].abs() + centre[1].abs() + radius);
                (x - centre[0]).hypot(y - centre[1]) <= radius + tolerance
            }
            Self::Polygon(corners) => is_inside(corners, [x, y]),
        }
    }

    /// Returns the cells whose centre lies in the region; none for cells of another raster.
    #[must_use]
    pub fn cells(&self, membrane: Membrane) -> Bits {
        match self {
            Self::Cells(cells) if cells.raster() == membrane.raster => cells.clone(),
            _ => Bits::from_fn(membrane.raster, |x, y| self.contains(membrane.centre_mm(x, y))),
        }
    }
}

/// Returns whether a point lies in a polygon: on its border, or with an odd number of its edges to the right.
fn is_inside(corners: &[[f64; 2]], [x, y]: [f64; 2]) -> bool {
    let edges = corners.iter().zip(corners.iter().cycle().skip(1));
    let mut inside = false;
    for (&[a, b], &[c, d]) in edges {
        let (along, across) = ([c - a, d - b], [x - a, y - b]);
        let length = along[0].hypot(along[1]);
        let tolerance = RESOLUTION * (a.abs() + b.abs() + c.abs() + d.abs());
        let distance = (along[0] * across[1] - along[1] * across[0]).abs() / length;
        let share = (along[0] * across[0] + along[1] * across[1]) / (length * length);
        if distance <= tolerance && (0.0..=1.0).contains(&share) {
            return true;
        }
        if (b > y) != (d > y) && x < a + (y - b) / (d - b) * (c - a) {
            inside = !inside;
        }
    }
    inside
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Raster;

    fn drawn(region: &Region) -> Vec<String> {
        let membrane = Membrane {
            raster: Raster::new(6, 4).unwrap(),
            size_mm: [6.0, 4.0],
        };
        let cells = region.cells(membrane);
        let row = |y| (0..6).map(|x| if cells.has(x, y) { '#' } else { '.' }).collect();
        (0..4).rev().map(row).collect()
    }

    #[test]
    fn a_cell_belongs_to_the_region_of_its_centre() {
        let polygon = |corners: &[[f64; 2]]| Region::Polygon(corners.to_vec());
        assert_eq!(
            drawn(&polygon(&[
                [0.0, 0.0],
                [6.0, 0.0],
                [6.0, 2.0],
                [2.0, 2.0],
                [2.0, 4.0],
                [0.0, 4.0]
            ])),
            ["##....", "##....", "######", "######"]
        );
        // The diagonal runs through centres, which belong to it.
        assert_eq!(
            drawn(&polygon(&[[0.0, 0.0], [4.0, 4.0], [0.0, 4.0]])),
            ["####..", "###...", "##....", "#....."]
        );
        // What lies inside twice does not.
        let twice = [
            [0.0, 0.0],
            [6.0, 0.0],
            [6.0, 4.0],
            [0.0, 4.0],
            [0.0, 0.0],
            [3.0, 0.0],
            [3.0, 4.0],
            [0.0, 4.0],
        ];
        assert_eq!(drawn(&polygon(&twice)), ["...###"; 4]);
        let disc = Region::Disc {
            centre: [3.0, 2.0],
            radius: 1.5_f64.hypot(0.5),
        };
        assert_eq!(drawn(&disc), ["..##..", ".####.", ".####.", "..##.."]);
        let rectangle = Region::Rectangle([[4.5, 3.5], [1.5, 0.6]]);
        assert_eq!(drawn(&rectangle), [".####.", ".####.", ".####.", "......"]);
    }
}

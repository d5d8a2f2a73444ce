//! The corners of cells that move with a rigid body, and the arms by which rotations count as arc lengths.

use super::leads::Edge;
use super::model::Scene;

/// How far inside the border of a body a corner is, at least, as a share of a cell: elements follow the border by
/// polygons.
const INSIDE: f64 = 0.25;

/// The corners of cells that move with a rigid body.
#[derive(Clone, Debug, PartialEq)]
pub struct BodyCorners {
    /// The centroid of the body in mm.
    pub centroid_mm: [f64; 2],
    /// Column and row of each corner.
    corners: Vec<[usize; 2]>,
    cell_mm: [f64; 2],
}

impl BodyCorners {
    /// Returns the place of a corner in mm.
    #[must_use]
    pub fn place_mm(&self, corner: [usize; 2]) -> [f64; 2] {
        [0, 1].map(|axis| corner[axis] as f64 * self.cell_mm[axis])
    }

    /// Returns the corner that is farthest from a place in mm, and its distance in mm; the first of equal ones. `None`
    /// if a body is so small that no corner moves with it.
    #[must_use]
    pub fn farthest(&self, from_mm: [f64; 2]) -> Option<(f64, [usize; 2])> {
        let distances = self.corners.iter().map(|&corner| {
            let [x, y] = self.place_mm(corner);
            ((x - from_mm[0]).hypot(y - from_mm[1]), corner)
        });
        distances.reduce(|best, one| if one.0 > best.0 { one } else { best })
    }

    /// Returns the distance of the outermost corner from the centroid in mm: the arm by which a rotation of the body
    /// counts as an arc length.
    #[must_use]
    pub fn arm_mm(&self) -> Option<f64> {
        self.farthest(self.centroid_mm).map(|(arm, _)| arm)
    }
}

impl Scene {
    /// Returns the corners of cells that move with a rigid body; `None` if there is no such body. If elements follow
    /// its border, these are the corners inside of it.
    #[must_use]
    pub fn corners_of_body(&self, body: usize) -> Option<BodyCorners> {
        let cells = self.cells_of_body(body);
        let own = BodyCorners {
            centroid_mm: self.centroid_of_body(body)?,
            corners: cells
                .iter()
                .flat_map(|[x, y]| (0..4).map(move |k| [x + k % 2, y + k / 2]))
                .collect(),
            cell_mm: self.membrane().cell_mm(),
        };
        let Some(border) = self.border_of_body(body) else {
            return Some(own);
        };
        let is_inside = |corner: &[usize; 2]| {
            let [x, y] = own.place_mm(*corner);
            let [dx, dy] = own.cell_mm.map(|side| INSIDE * side);
            let around = [[x - dx, y], [x + dx, y], [x, y - dy], [x, y + dy]];
            around.into_iter().all(|place| border.contains(place))
        };
        Some(BodyCorners {
            centroid_mm: border.centroid().unwrap_or(own.centroid_mm),
            corners: own.corners.iter().copied().filter(is_inside).collect(),
            ..own
        })
    }

    /// Returns half the length of the bar of a side in mm: the arm by which a rotation of the bar counts as an arc
    /// length. `None` if the side has no bar.
    #[must_use]
    pub fn arm_of_bar_mm(&self, edge: Edge) -> Option<f64> {
        let sides = self.geometry.sides.as_ref()?;
        sides.of(edge).bar()?;
        Some(0.5 * self.membrane().size_mm[1 - edge.normal_axis()])
    }
}

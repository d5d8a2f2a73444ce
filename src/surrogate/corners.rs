//! The corners of cells at which networks predict displacements.
//!
//! If all sides are held, these are the inner corners, which are not on the edges of the raster, 49 × 49 of the paper's
//! membrane. Otherwise they are all corners, which are the inner corners of a raster with a rim of one more cell.

use deaflow_pattern::Raster;
use deaflow_scene::{Edge, Scene, SideSupport};

/// Columns and rows of inner corners.
pub(crate) fn inner_sides(raster: Raster) -> [usize; 2] {
    raster.sides().map(|side| side - 1)
}

/// Number of inner corners.
pub(crate) fn inner_corners(raster: Raster) -> usize {
    inner_sides(raster).into_iter().product()
}

/// The components along x and y of the displacement that the left, right, lower and upper side hold.
pub type HeldSides = [[bool; 2]; 4];

/// The corners at which a network of a device predicts displacements.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Corners {
    raster: Raster,
    /// `None` if all sides are held.
    held: Option<HeldSides>,
}

impl Corners {
    /// The inner corners, of a device whose sides are all held.
    #[must_use]
    pub fn inner(raster: Raster) -> Self {
        Self { raster, held: None }
    }

    /// All corners, of a device whose sides hold some components of the displacement.
    #[must_use]
    pub fn all(raster: Raster, held: HeldSides) -> Self {
        Self {
            raster,
            held: Some(held),
        }
    }

    /// The corners of the device of a scene.
    #[must_use]
    pub fn of(scene: &Scene) -> Self {
        let raster = scene.membrane().raster;
        match &scene.geometry.sides {
            None => Self::inner(raster),
            Some(sides) => Self::all(raster, Edge::ALL.map(|edge| components_held(sides.of(edge), edge))),
        }
    }

    /// Returns the cells of the device.
    #[must_use]
    pub fn raster(self) -> Raster {
        self.raster
    }

    /// Returns the components that its sides hold; `None` if they hold all.
    #[must_use]
    pub fn held(self) -> Option<HeldSides> {
        self.held
    }

    /// Returns the columns and rows of the corners.
    pub(crate) fn sides(self) -> [usize; 2] {
        match self.held {
            None => inner_sides(self.raster),
            Some(_) => self.raster.corner_sides(),
        }
    }

    /// Returns the number of corners.
    pub(crate) fn count(self) -> usize {
        self.sides().into_iter().product()
    }

    /// Returns the cells of the network, of which these are the inner corners; `None` if there are too many.
    pub(crate) fn of_network(self) -> Option<Raster> {
        match self.held {
            None => Some(self.raster),
            Some(_) => {
                let [columns, rows] = self.raster.sides().map(|side| side + 2);
                Raster::new(columns, rows)
            }
        }
    }

    /// Returns whether a network predicts the displacement of a corner (column, row) of the device.
    pub(crate) fn has(self, corner: [usize; 2]) -> bool {
        let sides = self.raster.sides();
        self.held.is_some() || (0..2).all(|axis| (1..sides[axis]).contains(&corner[axis]))
    }

    /// Returns whether a side holds a component of the displacement of a corner (column, row) of the device.
    pub(crate) fn holds(self, [x, y]: [usize; 2], component: usize) -> bool {
        let [right, top] = self.raster.sides();
        let on = [x == 0, x == right, y == 0, y == top];
        let holds = |side: usize| self.held.is_none_or(|held| held[side][component]);
        (0..4).any(|side| on[side] && holds(side))
    }

    /// Returns 0 for each component that a side holds, and 1 for the others, `[y][x][component]`.
    pub(crate) fn movable(self) -> Vec<f32> {
        let [columns, rows] = self.raster.corner_sides();
        let corners = (0..rows).flat_map(|y| (0..columns).map(move |x| [x, y]));
        let kept = corners.filter(|corner| self.has(*corner));
        let each = kept.flat_map(|corner| [(corner, 0), (corner, 1)]);
        each.map(|(corner, c)| f32::from(u8::from(!self.holds(corner, c))))
            .collect()
    }
}

/// Returns the components of the displacement from rest that are zero on a side.
fn components_held(side: &SideSupport, edge: Edge) -> [bool; 2] {
    match side.bar() {
        // One that turns moves along both axes.
        Some(bar) => {
            let [x, y, turns] = bar.moves();
            [!x && !turns, !y && !turns]
        }
        None => side.holds(edge),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_corners_are_the_inner_ones_of_a_raster_with_a_rim() {
        let raster = Raster::new(3, 2).unwrap();
        let inner = Corners::inner(raster);
        assert_eq!(
            (inner.sides(), inner.count(), inner.of_network()),
            ([2, 1], 2, Some(raster))
        );
        assert_eq!(inner.movable(), [1.0; 4]);
        // The left is held, the right moves along x, the bottom is a roller.
        let all = Corners::all(raster, [[true; 2], [false, true], [false, true], [false; 2]]);
        let rim = all.of_network().unwrap();
        assert_eq!((all.sides(), all.count()), (inner_sides(rim), inner_corners(rim)));
        let movable = all.movable();
        let at = |x: usize, y: usize| [movable[2 * (4 * y + x)], movable[2 * (4 * y + x) + 1]];
        assert_eq!([at(0, 0), at(0, 1), at(0, 2)], [[0.0; 2]; 3]);
        assert_eq!([at(3, 0), at(3, 1), at(3, 2)], [[1.0, 0.0]; 3]);
        assert_eq!([at(1, 0), at(1, 1), at(1, 2)], [[1.0, 0.0], [1.0; 2], [1.0; 2]]);
    }

    #[test]
    fn a_bar_holds_what_it_does_not_move_along() {
        let of = |right: &str| {
            let scene = format!(
                "{{ geometry: {{ size: [40 mm, 20 mm], thickness: 1 mm, prestretch: 2, cells: [4, 2], sides: {{ right: \
                 {right}, top: free, bottom: roller }} }}, material: {{ model: neo-hookean, shear_modulus: 45 kPa, \
                 relative_permittivity: 4.7 }}, drive: {{ voltage: 4 kV }} }}"
            );
            Corners::of(&Scene::from_text(&scene).unwrap()).held().unwrap()
        };
        let others = |right| [[true; 2], right, [false, true], [false; 2]];
        assert_eq!(of("{ bar: { moves: [x] } }"), others([false, true]));
        assert_eq!(of("{ bar: { displacement: [2 mm, 0 mm] } }"), others([true; 2]));
        assert_eq!(of("free"), others([false; 2]));
        assert_eq!(of("roller"), others([true, false]));
        assert_eq!(Corners::of(&Scene::vhb4910()), Corners::inner(Raster::PAPER));
    }
}

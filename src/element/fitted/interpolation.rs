//! Displacements at the corners of cells whose node has moved.

use super::curve::Point;
use super::{Fitted, NodeLayout};
use deaflow_pattern::Part;

/// How the value at the corner of a cell follows from those of nodes.
#[derive(Clone, Debug, PartialEq)]
pub struct Interpolation {
    /// The corner (column, row).
    pub corner: [usize; 2],
    /// Indices of nodes for the first component, with their weights.
    pub weights: Vec<(usize, f64)>,
}

/// Returns the interpolations of the corners of cells, with `step` elements along their sides, whose nodes have moved.
///
/// # Errors
/// If no element covers the place of a corner, with the place.
pub(super) fn at_cell_corners(
    layout: NodeLayout,
    step: [usize; 2],
    fitted: &Fitted,
) -> Result<Vec<Interpolation>, Point> {
    let elements = [layout.columns(), layout.rows()];
    let corners = [0, 1].map(|axis| elements[axis] / step[axis] + 1);
    let all = (0..corners[1]).flat_map(|row| (0..corners[0]).map(move |column| [column, row]));
    all.filter_map(|corner| {
        let vertex = [0, 1].map(|axis| corner[axis] * step[axis]);
        let point = vertex.map(|at| at as f64);
        let node = vertex.map(|at| at * layout.degree());
        if fitted.position(layout, node) == point {
            return None;
        }
        let covering = covering(layout, fitted, vertex, point).ok_or(point);
        Some(covering.map(|(weights, _)| Interpolation { corner, weights }))
    })
    .collect()
}

/// Returns the weights of the nodes of a mapped element that covers a point in units of elements, near a vertex, and
/// its part; `None` if none does.
pub(super) fn covering(
    layout: NodeLayout,
    fitted: &Fitted,
    vertex: [usize; 2],
    point: Point,
) -> Option<(Vec<(usize, f64)>, Part)> {
    let (degree, side) = (layout.degree(), layout.degree() + 1);
    let near =
        |place: [usize; 2]| (0..2).all(|axis| place[axis] <= vertex[axis] + 1 && place[axis] + 2 >= vertex[axis]);
    for element in fitted.mapped().elements().iter().filter(|element| near(element.place)) {
        let [column, row] = element.place;
        let position = |node: usize| [column * degree + node % side, row * degree + node / side];
        let positions: Vec<Point> = (0..side * side)
            .map(|node| fitted.position(layout, position(node)))
            .collect();
        if let Some(values) = element.values_at(degree, &positions, point) {
            let weights = element.nodes(layout).into_iter().zip(values).collect();
            return Some((weights, element.content.part));
        }
    }
    None
}

//! Rigid bodies that move out of the plane with the membrane: all nodes of a body have one height.

use deaflow_field::Order;
use deaflow_pattern::Part;

use crate::element::{Bilinear, Biquadratic, Element};
use crate::grid::Grid;
use crate::sheet::Lift;

/// A body that moves out of the plane.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Lifted {
    /// Indices of its nodes, for the first component.
    nodes: Vec<usize>,
    /// Its area in the plane: a part of the volume is below it.
    area: f64,
    /// Force and spring out of the plane, without dimension.
    lift: Lift,
}

/// Returns the bodies of a grid, with forces and springs in its units.
pub(super) fn bodies(grid: &Grid, lifts: &[Lift]) -> Vec<Lifted> {
    let mut areas = vec![0.0; lifts.len()];
    for element in grid.each_element() {
        if let Part::Body(body) = grid.content(element).part {
            areas[body] += match grid.order() {
                Order::Bilinear => grid.areas_of(element, Bilinear::WEIGHTS).iter().sum::<f64>(),
                Order::Biquadratic => grid.areas_of(element, Biquadratic::WEIGHTS).iter().sum(),
            };
        }
    }
    let of_grid = grid.supports().into_iter().flat_map(|supports| supports.bodies());
    let each = of_grid.zip(lifts).zip(areas);
    each.map(|((body, lift), area)| Lifted {
        nodes: body.nodes.iter().map(|(at, _)| at).collect(),
        area,
        lift: *lift,
    })
    .collect()
}

impl Lifted {
    /// Returns the height in heights of nodes.
    pub fn height(&self, heights: &[f64]) -> f64 {
        // All are equal; a body has a cell.
        self.nodes.first().map_or(0.0, |at| heights[*at])
    }

    /// Returns the sum of forces on its nodes.
    pub fn force(&self, forces: &[f64]) -> f64 {
        self.nodes.iter().map(|at| forces[*at]).sum()
    }

    /// Writes a force as equal forces on its nodes, whose products with a height are those of the force.
    pub fn spread(&self, force: f64, forces: &mut [f64]) {
        let each = force / self.nodes.len() as f64;
        self.nodes.iter().for_each(|at| forces[*at] = each);
    }

    /// Returns the energy of the spring and a share of the load.
    pub fn energy(&self, height: f64, share: f64) -> f64 {
        0.5 * self.lift.spring * height * height - share * self.lift.load * height
    }

    /// Returns the volume below it.
    pub fn volume(&self, height: f64) -> f64 {
        self.area * height
    }

    /// Returns the area, on which a pressure acts.
    pub fn area(&self) -> f64 {
        self.area
    }

    /// Returns the force and the spring.
    pub fn lift(&self) -> Lift {
        self.lift
    }
}

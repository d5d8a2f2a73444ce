//! The mesh of devices in fits and comparisons.

use deaflow_base::parameters;
use deaflow_fem::SolveOptions;
use deaflow_field::{Mesh, Order};

/// The relative residual of simulations, whose errors must not look like those of measurements.
const RESIDUAL: f64 = 1e-10;

parameters! {
    /// The mesh of devices.
    pub struct MeshChoice as "the mesh of devices" {
        /// Elements along one side of a cell, for devices; without it 1, and more until the results no longer change.
        pub elements_per_cell: Option<u64> [1..=8],
        /// Polynomial order of the elements, for devices.
        pub order: u64 [1..=2] = 2,
    }
}

impl MeshChoice {
    /// Returns mesh and tolerance.
    #[must_use]
    pub fn options(&self) -> SolveOptions {
        let order = match self.order {
            1 => Order::Bilinear,
            _ => Order::Biquadratic,
        };
        SolveOptions {
            mesh: Mesh::new(self.elements_per_cell.unwrap_or(1) as usize, order),
            tolerance: RESIDUAL,
        }
    }

    /// Returns whether the mesh is chosen.
    #[must_use]
    pub fn is_chosen(&self) -> bool {
        self.elements_per_cell.is_some()
    }
}

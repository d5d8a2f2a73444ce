//! The preconditioner: the inverse of the componentwise Laplacian of a mesh with frames and bodies.

use std::sync::{Arc, Mutex, PoisonError, Weak};

pub use super::capacitance::is_clustered;
use super::capacitance::{Capacitance, CapacitanceScratch};
use super::error::SetupError;
use super::grid::Grid;
pub use super::rectangle::is_large_or_long;
use super::rectangle::{Rectangle, RectangleScratch};
use super::rigid::Pose;
use super::supports::Supports;

/// The inverse Laplacian of a grid with frames and bodies.
pub struct Laplacian {
    rectangle: Rectangle,
    capacitance: Option<Capacitance>,
    /// The supports of a membrane with motions of the whole that nothing resists.
    floating: Option<Arc<Supports>>,
}

/// The inverses in use and their grids, shared by the solvers of one membrane: with frames and many nodes one takes
/// seconds to compute.
static SHARED: Mutex<Vec<(Grid, Weak<Laplacian>)>> = Mutex::new(Vec::new());

/// Vectors for [`Laplacian::solve`].
pub struct LaplacianScratch {
    rectangle: RectangleScratch,
    capacitance: Option<CapacitanceScratch>,
    /// Forces in balance, of a floating membrane.
    balanced: Vec<f32>,
}

impl Laplacian {
    /// Creates the inverse Laplacian of a grid.
    ///
    /// # Errors
    /// If the eigenvectors cannot be computed.
    pub fn new(grid: &Grid) -> Result<Self, SetupError> {
        Self::with_mass(grid, 0.0)
    }

    /// Returns the inverse Laplacian of a grid: that of another solver on an equal grid, or a new one.
    ///
    /// # Errors
    /// As [`Laplacian::new`].
    pub fn shared(grid: &Grid) -> Result<Arc<Self>, SetupError> {
        let known = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        let mut equal = known.iter().filter(|(of, _)| of.shares_laplacian(grid));
        let found = equal.find_map(|(_, known)| known.upgrade());
        // It is computed without the lock, which would hold up other grids.
        drop(known);
        if let Some(found) = found {
            return Ok(found);
        }
        let own = Arc::new(Self::new(grid)?);
        let mut known = SHARED.lock().unwrap_or_else(PoisonError::into_inner);
        known.retain(|(_, known)| known.strong_count() > 0);
        known.push((grid.clone(), Arc::downgrade(&own)));
        Ok(own)
    }

    /// Creates the inverse of the Laplacian plus a multiple of the consistent mass.
    ///
    /// # Errors
    /// As [`Laplacian::new`].
    pub fn with_mass(grid: &Grid, mass: f64) -> Result<Self, SetupError> {
        let rectangle = Rectangle::new(grid, mass)?;
        let capacitance = grid
            .shared_supports()
            .map(|supports| Capacitance::new(supports, &rectangle));
        let floating = grid.shared_supports().filter(|supports| supports.gauge().is_some());
        Ok(Self {
            rectangle,
            capacitance,
            floating,
        })
    }

    /// Returns the vectors for a solve.
    #[must_use]
    pub fn scratch(&self) -> LaplacianScratch {
        LaplacianScratch {
            rectangle: self.rectangle.scratch(),
            capacitance: self.capacitance.as_ref().map(Capacitance::scratch),
            balanced: Vec::new(),
        }
    }

    /// Writes the solution for `r`, which is admissible for frames and bodies at these poses, into `z`.
    pub fn solve(&self, r: &[f32], poses: &[Pose], z: &mut [f32], scratch: &mut LaplacianScratch) {
        let Some(supports) = &self.floating else {
            return self.solve_held(r, poses, z, scratch);
        };
        let mut balanced = std::mem::take(&mut scratch.balanced);
        balanced.clear();
        balanced.extend_from_slice(r);
        supports.balance(poses, &mut balanced);
        self.solve_held(&balanced, poses, z, scratch);
        supports.centre(poses, z);
        scratch.balanced = balanced;
    }

    fn solve_held(&self, r: &[f32], poses: &[Pose], z: &mut [f32], scratch: &mut LaplacianScratch) {
        match (&self.capacitance, &mut scratch.capacitance) {
            (Some(capacitance), Some(own)) => {
                capacitance.solve(&self.rectangle, r, poses, z, (&mut scratch.rectangle, own));
            }
            _ => self.rectangle.solve(r, z, &mut scratch.rectangle),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::energy::NeoHookean;
    use crate::operator::{Activity, Operator};
    use crate::sheet::Sheet;
    use deaflow_field::{Mesh, Order};
    use deaflow_pattern::{Membrane, Pattern, Raster};

    #[test]
    fn it_inverts_the_tangent_of_a_membrane_without_thickness_and_voltage() {
        // With a = b = 0 the energy is ½|∇u|² and the tangent is the Laplacian.
        let material = NeoHookean::without_thickness();
        let rectangle = |sides: [usize; 2], size_mm, prestretch| Sheet {
            membrane: Membrane {
                raster: Raster::new(sides[0], sides[1]).unwrap(),
                size_mm,
            },
            prestretch,
            ..Sheet::paper()
        };
        let sheets = [
            Sheet::paper(),
            rectangle([7, 12], [30.0, 50.0], [3.0, 4.0]),
            rectangle([40, 3], [50.0, 10.0], [5.0, 2.0]),
            rectangle([1, 31], [1.0, 20.0], [3.0, 3.0]),
            rectangle([101, 40], [60.0, 20.0], [3.0, 3.5]),
            rectangle([1, 1], [1.0, 2.0], [3.0, 1.0]),
        ];
        let meshes = [
            (1, Order::Bilinear),
            (2, Order::Bilinear),
            (3, Order::Bilinear),
            (1, Order::Biquadratic),
        ];
        for (sheet, (per_cell, order)) in sheets
            .into_iter()
            .flat_map(|sheet| meshes.map(|mesh| (sheet.clone(), mesh)))
        {
            let grid = Grid::uniform(Mesh::new(per_cell, order), &sheet);
            let layout = grid.layout();
            let activity = Activity::new(&grid, &Pattern::from_fn(sheet.raster(), |_, _| false));
            let operator = Operator::new(&material, &activity);
            let laplacian = Laplacian::new(&grid).unwrap();
            let mut u: Vec<f32> = (0..layout.vector_len())
                .map(|i| ((i * i) as f32 * 0.037).sin())
                .collect();
            grid.restrict(&vec![0.0_f32; u.len()], &mut u);
            let zero = vec![0.0; layout.vector_len()];
            let (mut r, mut back) = (zero.clone(), zero.clone());
            operator.tangent(&zero, &u, &mut r);
            laplacian.solve(&r, &grid.poses(&u), &mut back, &mut laplacian.scratch());
            let worst = u.iter().zip(&back).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
            assert!(worst < 1e-3, "{sheet:?} {per_cell} {order:?}: {worst:e}");
        }
    }
}

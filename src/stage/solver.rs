//! The parameters of the finite-element solver, shared by everything that simulates.

use crate::base::{Canonical, Decimal, Dimension, InputError, Map, Quantity};
use crate::fem::{AccurateSimulation, AccurateSolver, MembraneSolver, Order, SetupError, SolveOptions};
use crate::field::Simulator;
use crate::pattern::Pattern;
use crate::scene::Scene;

/// Where the unknowns stand.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum MeshRequest {
    /// One mesh for all patterns.
    Fixed {
        /// Elements along one side of a cell, 1 to 8.
        elements_per_cell: u64,
        /// Polynomial order of the elements, 1 or 2.
        order: u64,
    },
    /// For each pattern the mesh on which the discretisation error is estimated below this many mm.
    Accuracy(f64),
}

/// A solver that is ready.
pub enum Solver {
    /// On one mesh.
    Fixed(Box<MembraneSolver>, SolveOptions),
    /// On the mesh that each pattern needs.
    Accurate(Box<AccurateSolver>),
}

impl Solver {
    /// The solver for a scene.
    ///
    /// # Errors
    /// When the mesh or the relative residual `tolerance` is out of range.
    pub fn new(scene: &Scene, mesh: MeshRequest, tolerance: f64) -> Result<Self, SetupError> {
        match mesh {
            MeshRequest::Accuracy(mm) => Ok(Self::Accurate(Box::new(AccurateSolver::new(scene, mm, tolerance)?))),
            MeshRequest::Fixed {
                elements_per_cell,
                order,
            } => {
                let order = if order == 2 {
                    Order::Biquadratic
                } else {
                    Order::Bilinear
                };
                let options = SolveOptions {
                    elements_per_cell: elements_per_cell as usize,
                    order,
                    tolerance,
                };
                Ok(Self::Fixed(Box::new(MembraneSolver::new(scene, options)?), options))
            }
        }
    }

    /// Whether results come with an estimate of their discretisation error.
    pub fn estimates(&self) -> bool {
        matches!(self, Self::Accurate(_))
    }

    /// One result per pattern, in order; on a fixed mesh without an estimate of its error.
    ///
    /// # Errors
    /// When a finer mesh cannot be set up.
    pub fn simulate(&self, patterns: &[Pattern]) -> Result<Vec<AccurateSimulation>, SetupError> {
        match self {
            Self::Accurate(solver) => solver.simulate(patterns),
            Self::Fixed(solver, options) => {
                let result = |simulation| AccurateSimulation {
                    simulation,
                    elements_per_cell: options.elements_per_cell,
                    order: options.order,
                    discretisation_error: None,
                };
                Ok(solver.simulate(patterns).into_iter().map(result).collect())
            }
        }
    }
}

/// Mesh and tolerance as a stage states them, exactly.
pub struct SolverParameters {
    mesh: MeshParameters,
    tolerance: Decimal,
}

enum MeshParameters {
    Fixed { elements_per_cell: u64, order: u64 },
    Accuracy(Quantity),
}

impl SolverParameters {
    /// The keys that [`SolverParameters::read`] looks for.
    pub const KEYS: [&str; 4] = ["elements_per_cell", "order", "accuracy", "tolerance"];

    /// Reads `elements_per_cell` and `order`, or instead of them `accuracy`, and `tolerance`; each is optional.
    ///
    /// # Errors
    /// When one is out of range, or `accuracy` stands beside a mesh.
    pub fn read(map: &Map<'_>, elements_per_cell: u64) -> Result<Self, InputError> {
        let (elements, order) = (map.optional("elements_per_cell"), map.optional("order"));
        let mesh = match map.optional("accuracy") {
            Some(node) if elements.is_some() || order.is_some() => {
                return Err(node
                    .error("`accuracy` picks the mesh, so `elements_per_cell` and `order` cannot stand beside it")
                    .help("give either `accuracy` or a mesh"));
            }
            Some(node) => MeshParameters::Accuracy(node.quantity_in("accuracy", Dimension::Length, 1e-9, 1e3)?),
            None => MeshParameters::Fixed {
                elements_per_cell: elements.map_or(Ok(elements_per_cell), |n| n.whole("elements_per_cell", 1, 8))?,
                order: order.map_or(Ok(1), |n| n.whole("order", 1, 2))?,
            },
        };
        let tolerance = map
            .optional("tolerance")
            .map(|n| n.quantity_in("tolerance", Dimension::Number, 1e-12, 1e-3));
        let tolerance = tolerance
            .transpose()?
            .map_or_else(|| Decimal::from(1).scaled(-8), |t| t.base());
        Ok(Self { mesh, tolerance })
    }

    /// The canonical value, with further entries.
    pub fn canonical<const N: usize>(&self, more: [(&str, Canonical); N]) -> Canonical {
        let mut own = vec![("tolerance", Canonical::from(self.tolerance))];
        match &self.mesh {
            MeshParameters::Fixed {
                elements_per_cell,
                order,
            } => {
                own.extend([
                    ("elements_per_cell", (*elements_per_cell).into()),
                    ("order", (*order).into()),
                ]);
            }
            MeshParameters::Accuracy(accuracy) => own.push(("accuracy", accuracy.into())),
        }
        Canonical::map(own.into_iter().chain(more))
    }

    /// The solver for a scene.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn build(&self, scene: &Scene) -> Result<Solver, SetupError> {
        let mesh = match &self.mesh {
            MeshParameters::Fixed {
                elements_per_cell,
                order,
            } => MeshRequest::Fixed {
                elements_per_cell: *elements_per_cell,
                order: *order,
            },
            MeshParameters::Accuracy(accuracy) => MeshRequest::Accuracy(accuracy.value()),
        };
        Solver::new(scene, mesh, self.tolerance.to_f64())
    }
}

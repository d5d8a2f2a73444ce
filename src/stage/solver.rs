//! The parameters of the finite-element solver, shared by everything that simulates.

mod schema;

use std::borrow::Cow;
use std::fmt;
use std::path::Path;

use super::method::Method;
use crate::base::{Canonical, Decimal, Dimension, Document, InputError, Map, Quantity};
use crate::fem::effects::screening::resolve;
use crate::fem::{AccurateSimulation, AccurateSolver, LinearResponse, MembraneSolver, Order, SetupError, SolveOptions};
use crate::field::{Simulation, Simulator};
use crate::pattern::Pattern;
use crate::scene::{Effects, Scene};

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
    /// By the linear response on one mesh and so many chord steps.
    Response(Box<LinearResponse>, SolveOptions, u32),
}

impl Solver {
    /// The solver for a scene, whose effects are decided first where it says `effects: auto`. The relative residual
    /// `tolerance` counts for Newton's method only.
    ///
    /// # Errors
    /// When the mesh or the tolerance is out of range, the membrane has no linear response, or its effects cannot be simulated.
    pub fn new(scene: &Scene, method: Method, mesh: MeshRequest, tolerance: f64) -> Result<Self, SetupError> {
        let scene = &resolve(scene)?;
        let (elements_per_cell, order) = match mesh {
            MeshRequest::Accuracy(mm) => {
                return Ok(Self::Accurate(Box::new(AccurateSolver::new(scene, mm, tolerance)?)));
            }
            MeshRequest::Fixed {
                elements_per_cell,
                order,
            } => (elements_per_cell as usize, order),
        };
        let order = if order == 2 {
            Order::Biquadratic
        } else {
            Order::Bilinear
        };
        let options = SolveOptions {
            elements_per_cell,
            order,
            tolerance,
        };
        match method.chord_steps() {
            None => Ok(Self::Fixed(Box::new(MembraneSolver::new(scene, options)?), options)),
            Some(steps) => Ok(Self::Response(
                Box::new(LinearResponse::new(scene, options)?),
                options,
                steps,
            )),
        }
    }

    /// Whether results come with an estimate of their discretisation error.
    pub fn estimates(&self) -> bool {
        matches!(self, Self::Accurate(_))
    }

    /// The effects of a scene that results say something about beside the displacement: none where they are estimates.
    pub fn observed<'a>(&self, effects: &'a Effects) -> Cow<'a, Effects> {
        match self {
            Self::Response(..) => Cow::Owned(Effects::default()),
            Self::Fixed(..) | Self::Accurate(_) => Cow::Borrowed(effects),
        }
    }

    /// One result per pattern, in order; on a fixed mesh without an estimate of its error.
    ///
    /// # Errors
    /// When a finer mesh cannot be set up.
    pub fn simulate(&self, patterns: &[Pattern]) -> Result<Vec<AccurateSimulation>, SetupError> {
        match self {
            Self::Accurate(solver) => solver.simulate(patterns),
            Self::Fixed(solver, options) => Ok(on_one_mesh(solver.simulate(patterns), options)),
            Self::Response(response, options, steps) => Ok(on_one_mesh(response.simulate(patterns, *steps), options)),
        }
    }
}

fn on_one_mesh(simulations: Vec<Simulation>, options: &SolveOptions) -> Vec<AccurateSimulation> {
    let each = |simulation| on_mesh(simulation, options);
    simulations.into_iter().map(each).collect()
}

/// A result with the mesh that it was asked for on, and without an estimate of its error.
pub fn on_mesh(simulation: Simulation, options: &SolveOptions) -> AccurateSimulation {
    AccurateSimulation {
        simulation,
        elements_per_cell: options.elements_per_cell,
        order: options.order,
        discretisation_error: None,
    }
}

/// What went wrong, with what helps where a method is to blame.
pub fn explained(error: &SetupError) -> String {
    match error {
        SetupError::Unstable => format!("{error}; `method: newton` says how far each pattern gets"),
        other => other.to_string(),
    }
}

/// Method, mesh and tolerance as a stage states them, exactly.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SolverParameters {
    method: Method,
    mesh: MeshParameters,
    tolerance: Decimal,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum MeshParameters {
    Fixed { elements_per_cell: u64, order: u64 },
    Accuracy(Quantity),
}

impl SolverParameters {
    /// The keys that [`SolverParameters::read`] looks for.
    pub const KEYS: [&str; 5] = ["method", "elements_per_cell", "order", "accuracy", "tolerance"];

    /// Newton's method on a mesh.
    pub fn newton(elements_per_cell: u64, order: u64) -> Self {
        Self::on_mesh(Method::Newton, elements_per_cell, order)
    }

    /// A method on a mesh, with the usual tolerance.
    pub fn on_mesh(method: Method, elements_per_cell: u64, order: u64) -> Self {
        Self {
            method,
            mesh: MeshParameters::Fixed {
                elements_per_cell,
                order,
            },
            tolerance: usual_tolerance(),
        }
    }

    /// Newton's method on the mesh that an accuracy takes.
    pub fn accurate(accuracy: Quantity) -> Self {
        Self {
            method: Method::Newton,
            mesh: MeshParameters::Accuracy(accuracy),
            tolerance: usual_tolerance(),
        }
    }

    /// Reads `method`; `elements_per_cell` and `order`, or instead of them `accuracy`; and `tolerance`. Each is optional.
    ///
    /// # Errors
    /// When one is out of range, `accuracy` stands beside a mesh, or a method takes no accuracy or tolerance.
    pub fn read(map: &Map<'_>, elements_per_cell: u64) -> Result<Self, InputError> {
        let method = map.optional("method").map_or(Ok(Method::Newton), Method::read)?;
        if method.chord_steps().is_some() {
            refuse_beside(map, method)?;
        }
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
        let tolerance = tolerance.transpose()?.map_or_else(usual_tolerance, |t| t.base());
        Ok(Self {
            method,
            mesh,
            tolerance,
        })
    }

    /// The canonical value, with further entries. What a method does not use is no part of it.
    pub fn canonical<const N: usize>(&self, more: [(&str, Canonical); N]) -> Canonical {
        let mut own = vec![("method", Canonical::from(self.method.to_string().as_str()))];
        if self.method == Method::Newton {
            own.push(("tolerance", self.tolerance.into()));
        }
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
        Solver::new(scene, self.method, mesh, self.tolerance.to_f64())
    }

    /// From the text that an artifact of a solve stage carries.
    ///
    /// # Errors
    /// When it is not understood.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        let document = Document::from_text(Path::new("solver"), text)?;
        Self::read(&document.root.fields("the solver", &Self::KEYS)?, 2)
    }

    /// Relative residual at which Newton's method ends.
    pub fn tolerance(&self) -> f64 {
        self.tolerance.to_f64()
    }

    /// The method.
    pub fn method(&self) -> Method {
        self.method
    }

    /// How much work a pattern is: the number of unknowns, of which biquadratic elements have four times as many and couple
    /// each to more.
    pub fn weight(&self) -> f64 {
        let (elements, order) = self.mesh().unwrap_or((1, 1));
        let factor = if order == 2 { 6.0 } else { 1.0 };
        factor * (elements * elements) as f64
    }

    /// Elements along one side of a cell and their order, where one mesh serves all patterns.
    pub fn mesh(&self) -> Option<(u64, u64)> {
        match self.mesh {
            MeshParameters::Fixed {
                elements_per_cell,
                order,
            } => Some((elements_per_cell, order)),
            MeshParameters::Accuracy(_) => None,
        }
    }

    /// The same on another mesh of comparable kind, by which the error of this one can be told: half as many elements per
    /// cell, lower order where there is but one, and two elements where that is of the lowest order too. `None` where the mesh
    /// follows from an accuracy.
    pub fn beside(&self) -> Option<Self> {
        let (elements_per_cell, order) = match self.mesh()? {
            (1, 1) => (2, 1),
            (1, _) => (1, 1),
            (elements, order) => (elements / 2, order),
        };
        Some(Self {
            mesh: MeshParameters::Fixed {
                elements_per_cell,
                order,
            },
            ..self.clone()
        })
    }

    /// The accuracy that was asked for instead of a mesh.
    pub fn accuracy(&self) -> Option<Quantity> {
        match self.mesh {
            MeshParameters::Accuracy(accuracy) => Some(accuracy),
            MeshParameters::Fixed { .. } => None,
        }
    }
}

/// The keys of a stage that solves so, on one line without braces; what has its usual value is left out, apart from the
/// mesh.
impl fmt::Display for SolverParameters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "method: {}", self.method)?;
        match &self.mesh {
            MeshParameters::Fixed {
                elements_per_cell,
                order,
            } => write!(f, ", elements_per_cell: {elements_per_cell}, order: {order}")?,
            MeshParameters::Accuracy(accuracy) => write!(f, ", accuracy: {accuracy}")?,
        }
        if self.method == Method::Newton && self.tolerance != usual_tolerance() {
            write!(f, ", tolerance: {:e}", self.tolerance.to_f64())?;
        }
        Ok(())
    }
}

fn usual_tolerance() -> Decimal {
    Decimal::from(1).scaled(-8)
}

/// Methods that look for no equilibrium have neither an accuracy nor a tolerance.
fn refuse_beside(map: &Map<'_>, method: Method) -> Result<(), InputError> {
    if let Some(node) = map.optional("accuracy") {
        return Err(node
            .error(format!(
                "`accuracy` cannot stand beside `method: {method}`, whose error is not that of the mesh alone"
            ))
            .help("give a mesh by `elements_per_cell` and `order`, or `method: newton`"));
    }
    map.optional("tolerance").map_or(Ok(()), |node| {
        Err(node
            .error(format!(
                "`tolerance` means nothing beside `method: {method}`, which looks for no equilibrium"
            ))
            .help("leave it out, or take `method: newton`"))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read(text: &str) -> Result<SolverParameters, InputError> {
        let document = Document::from_text(Path::new("t"), text).unwrap();
        SolverParameters::read(&document.root.fields("t", &SolverParameters::KEYS)?, 2)
    }

    #[test]
    fn parameters_survive_their_own_text() {
        for text in [
            "{ method: linear }",
            "{ method: chord:3, elements_per_cell: 1, order: 2 }",
            "{ accuracy: 10 um }",
            "{ elements_per_cell: 4, tolerance: 1e-6 }",
            "{}",
        ] {
            let parameters = read(text).unwrap();
            assert_eq!(
                read(&format!("{{ {parameters} }}")).unwrap(),
                parameters,
                "{parameters}"
            );
        }
        assert_eq!(
            read("{ method: newton, tolerance: 0.00000001 }").unwrap(),
            read("{}").unwrap()
        );
        assert_eq!(read("{}").unwrap(), SolverParameters::newton(2, 1));
    }

    #[test]
    fn what_a_method_does_not_take_is_refused() {
        for (text, said) in [
            (
                "{ method: linear, accuracy: 0.01 mm }",
                "`accuracy` cannot stand beside",
            ),
            ("{ method: chord:2, tolerance: 1e-6 }", "`tolerance` means nothing"),
            ("{ accuracy: 0.01 mm, order: 2 }", "picks the mesh"),
        ] {
            assert!(read(text).unwrap_err().to_string().contains(said), "{text}");
        }
    }

    #[test]
    fn the_method_is_part_of_the_key_and_an_unused_tolerance_is_not() {
        let [newton, linear, chord] =
            ["{}", "{ method: linear }", "{ method: chord:1 }"].map(|text| read(text).unwrap().canonical([]));
        assert!(newton != linear && linear != chord);
        assert!(linear.leaves().iter().all(|(path, _)| path != "tolerance"));
    }
}

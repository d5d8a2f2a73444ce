//! The parameters of a solver, shared by everything that simulates: method, mesh and tolerance.

use std::fmt;
use std::path::Path;

use super::method::Method;
use super::solver::Solver;
use crate::base::{Canonical, Decimal, Dimension, Document, InputError, Map, Node, Quantity};
use crate::fem::error::SetupError;
use crate::field::{Mesh, Order};
use crate::scene::Scene;

/// Where the unknowns stand.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeshRequest {
    /// One mesh for all patterns.
    Fixed(Mesh),
    /// For each pattern the mesh on which the discretisation error is estimated below this length.
    Accuracy(Quantity),
}

impl From<Mesh> for MeshRequest {
    fn from(mesh: Mesh) -> Self {
        Self::Fixed(mesh)
    }
}

/// Method, mesh and tolerance as a stage states them, exactly.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct SolverParameters {
    method: Method,
    mesh: MeshRequest,
    tolerance: Decimal,
}

impl SolverParameters {
    /// The keys that [`SolverParameters::read`] looks for.
    pub const KEYS: [&str; 5] = ["method", "elements_per_cell", "order", "accuracy", "tolerance"];

    /// A method on a mesh or to an accuracy, with the usual tolerance.
    #[must_use]
    pub fn new(method: Method, mesh: impl Into<MeshRequest>) -> Self {
        Self {
            method,
            mesh: mesh.into(),
            tolerance: usual_tolerance(),
        }
    }

    /// The same with another relative residual; one that is not finite is left out.
    #[must_use]
    pub fn with_tolerance(self, tolerance: f64) -> Self {
        Self {
            tolerance: Decimal::from_f64(tolerance).unwrap_or(self.tolerance),
            ..self
        }
    }

    /// Reads `method`; `elements_per_cell` and `order`, or instead of them `accuracy`; and `tolerance`. Each is optional, and
    /// the mesh is `usual` where nothing is said.
    ///
    /// # Errors
    /// When one is out of range, `accuracy` stands beside a mesh, or a method takes no accuracy or tolerance.
    pub fn read(map: &Map<'_>, usual: Mesh) -> Result<Self, InputError> {
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
            Some(node) => MeshRequest::Accuracy(node.quantity_in("accuracy", Dimension::Length, 1e-9, 1e3)?),
            None => {
                let number = |node: Option<&Node>, key, most, usual: usize| {
                    node.map_or(Ok(usual), |node| node.whole(key, 1, most as u64).map(|n| n as usize))
                };
                let elements = number(
                    elements,
                    "elements_per_cell",
                    Mesh::MOST_ELEMENTS,
                    usual.elements_per_cell(),
                )?;
                let order = match number(order, "order", 2, usual.order().degree())? {
                    1 => Order::Bilinear,
                    _ => Order::Biquadratic,
                };
                MeshRequest::Fixed(Mesh::new(elements, order))
            }
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
    #[must_use]
    pub fn canonical<const N: usize>(&self, more: [(&str, Canonical); N]) -> Canonical {
        let mut own = vec![("method", Canonical::from(self.method.to_string().as_str()))];
        if self.method == Method::Newton {
            own.push(("tolerance", self.tolerance.into()));
        }
        match &self.mesh {
            MeshRequest::Fixed(mesh) => own.extend([
                ("elements_per_cell", mesh.elements_per_cell().into()),
                ("order", mesh.order().degree().into()),
            ]),
            MeshRequest::Accuracy(accuracy) => own.push(("accuracy", accuracy.into())),
        }
        Canonical::map(own.into_iter().chain(more))
    }

    /// The solver for a scene.
    ///
    /// # Errors
    /// When it cannot be set up.
    pub fn build(&self, scene: &Scene) -> Result<Solver, SetupError> {
        Solver::new(scene, self)
    }

    /// From the text that an artifact of a solve stage carries.
    ///
    /// # Errors
    /// When it is not understood.
    pub fn from_text(text: &str) -> Result<Self, InputError> {
        let document = Document::from_text(Path::new("solver"), text)?;
        Self::read(&document.root.fields("the solver", &Self::KEYS)?, Mesh::bilinear(2))
    }

    /// Relative residual at which Newton's method ends.
    #[must_use]
    pub fn tolerance(&self) -> f64 {
        self.tolerance.to_f64()
    }

    /// The method.
    #[must_use]
    pub fn method(&self) -> Method {
        self.method
    }

    /// Where the unknowns stand.
    #[must_use]
    pub fn mesh_request(&self) -> MeshRequest {
        self.mesh
    }

    /// How much work a pattern is: the number of unknowns, of which biquadratic elements have four times as many and couple
    /// each to more.
    #[must_use]
    pub fn weight(&self) -> f64 {
        let mesh = self.mesh().unwrap_or(Mesh::bilinear(1));
        let factor = if mesh.order() == Order::Biquadratic { 6.0 } else { 1.0 };
        factor * (mesh.elements_per_cell() as f64).powi(2)
    }

    /// The mesh, where one serves all patterns.
    #[must_use]
    pub fn mesh(&self) -> Option<Mesh> {
        match self.mesh {
            MeshRequest::Fixed(mesh) => Some(mesh),
            MeshRequest::Accuracy(_) => None,
        }
    }

    /// The same on another mesh of comparable kind, by which the error of this one can be told: half as many elements per
    /// cell, lower order where there is but one, and two elements where that is of the lowest order too. `None` where the mesh
    /// follows from an accuracy.
    #[must_use]
    pub fn beside(&self) -> Option<Self> {
        let mesh = match self.mesh()? {
            mesh if mesh == Mesh::bilinear(1) => Mesh::bilinear(2),
            mesh if mesh.elements_per_cell() == 1 => Mesh::bilinear(1),
            mesh => Mesh::new(mesh.elements_per_cell() / 2, mesh.order()),
        };
        Some(Self {
            mesh: MeshRequest::Fixed(mesh),
            ..self.clone()
        })
    }

    /// The accuracy that was asked for instead of a mesh.
    #[must_use]
    pub fn accuracy(&self) -> Option<Quantity> {
        match self.mesh {
            MeshRequest::Accuracy(accuracy) => Some(accuracy),
            MeshRequest::Fixed(_) => None,
        }
    }
}

/// The keys of a stage that solves so, on one line without braces; what has its usual value is left out, apart from the
/// mesh.
impl fmt::Display for SolverParameters {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "method: {}", self.method)?;
        match &self.mesh {
            MeshRequest::Fixed(mesh) => write!(f, ", {mesh}")?,
            MeshRequest::Accuracy(accuracy) => write!(f, ", accuracy: {accuracy}")?,
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
        SolverParameters::read(&document.root.fields("t", &SolverParameters::KEYS)?, Mesh::bilinear(2))
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
        assert_eq!(
            read("{}").unwrap(),
            SolverParameters::new(Method::Newton, Mesh::bilinear(2))
        );
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

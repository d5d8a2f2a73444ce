//! Finite elements as a method to be measured: Newton's method, the linear response and chord steps, or an accuracy.

use super::contender::{Contender, Ready};
use crate::base::{Canonical, Dimension, Fields, InputError, Node, NodeValue, Quantity, Schema};
use crate::fem::{MeshRequest, Method, Solver, SolverParameters};
use crate::field::{Field, Mesh};
use crate::pattern::Pattern;
use crate::scene::Scene;

/// Finite elements with their settings.
pub struct Elements(SolverParameters);

const KEYS: [&str; 4] = ["method", "elements_per_cell", "order", "accuracy"];

impl Elements {
    /// Reads a word, the method with 2 bilinear elements per cell, or a mapping with the keys of a solve stage.
    ///
    /// # Errors
    /// When it is neither, or as a solve stage refuses it.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        if let NodeValue::Text(_) = node.value() {
            return Ok(Self(SolverParameters::new(Method::read(node)?, Mesh::bilinear(2))));
        }
        Ok(Self(SolverParameters::read(
            &node.fields("a method", &KEYS)?,
            Mesh::bilinear(2),
        )?))
    }

    /// What [`Elements::read`] accepts.
    pub fn schema() -> Schema {
        let settings = Fields::new("A method with its mesh, or an accuracy.");
        Schema::any_of([
            Method::schema(),
            SolverParameters::schema(settings, Mesh::bilinear(2), false).into(),
        ])
    }

    /// What is measured unless a list is given.
    pub fn usual() -> Vec<Self> {
        let mesh = |method, mesh: Mesh| Self(SolverParameters::new(method, mesh));
        let estimates = [
            (Method::Linear, Mesh::bilinear(1)),
            (Method::Linear, Mesh::bilinear(2)),
            (Method::Chord(1), Mesh::bilinear(1)),
            (Method::Chord(1), Mesh::bilinear(2)),
            (Method::Chord(2), Mesh::bilinear(2)),
            (Method::Chord(2), Mesh::biquadratic(1)),
            (Method::Chord(4), Mesh::biquadratic(1)),
        ];
        let bilinear = [1, 2, 4, 8].map(Mesh::bilinear);
        let meshes = bilinear.into_iter().chain([1, 2, 4].map(Mesh::biquadratic));
        // 0.03, 0.01 and 0.003 mm, as exact as if they were read.
        let accuracies = ["0.03", "0.01", "0.003"];
        let accurate = accuracies
            .iter()
            .filter_map(|mm| Quantity::parse(mm, Dimension::Length).ok());
        let estimates = estimates.into_iter().map(|(method, on)| mesh(method, on));
        let newton = meshes.map(|on| mesh(Method::Newton, on));
        let accurate = accurate.map(|mm| Self(SolverParameters::new(Method::Newton, MeshRequest::Accuracy(mm))));
        estimates.chain(newton).chain(accurate).collect()
    }
}

impl Contender for Elements {
    fn settings(&self) -> String {
        self.0.to_string()
    }

    fn canonical(&self) -> Canonical {
        self.0.canonical([])
    }

    fn promise_mm(&self) -> Option<f64> {
        self.0.accuracy().map(|accuracy| accuracy.value())
    }

    fn finds_equilibria(&self) -> bool {
        self.0.method() == Method::Newton
    }

    fn is_coarser_than(&self, reference: &SolverParameters) -> bool {
        match (self.0.mesh(), reference.mesh()) {
            (Some(own), Some(finest)) => {
                own.order() <= finest.order()
                    && (own.elements_per_cell() < finest.elements_per_cell() || own.order() < finest.order())
            }
            _ => true,
        }
    }

    fn prepare(&self, scene: &Scene) -> Result<Box<dyn Ready>, String> {
        let solver = self.0.build(scene).map_err(|e| e.to_string())?;
        Ok(Box::new(solver))
    }
}

impl Ready for Solver {
    fn fields(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, String> {
        let results = self.simulate(patterns).map_err(|e| e.to_string())?;
        Ok(results.into_iter().map(|result| result.simulation.field).collect())
    }
}

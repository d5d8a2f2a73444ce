//! Finite elements as a method to be measured: Newton's method, the linear response and chord steps, or an accuracy.

use super::contender::{Contender, Ready};
use crate::base::{Canonical, Dimension, Fields, InputError, Node, NodeValue, Quantity, Schema};
use crate::field::Field;
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::stage::method::Method;
use crate::stage::solver::{Solver, SolverParameters, explained};

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
            return Ok(Self(SolverParameters::on_mesh(Method::read(node)?, 2, 1)));
        }
        Ok(Self(SolverParameters::read(&node.fields("a method", &KEYS)?, 2)?))
    }

    /// What [`Elements::read`] accepts.
    pub fn schema() -> Schema {
        let settings = Fields::new("A method with its mesh, or an accuracy.");
        Schema::any_of([Method::schema(), SolverParameters::schema(settings, 2, false).into()])
    }

    /// What is measured unless a list is given.
    pub fn usual() -> Vec<Self> {
        let mesh = |method, (elements, order)| Self(SolverParameters::on_mesh(method, elements, order));
        let estimates = [
            (Method::Linear, (1, 1)),
            (Method::Linear, (2, 1)),
            (Method::Chord(1), (1, 1)),
            (Method::Chord(1), (2, 1)),
            (Method::Chord(2), (2, 1)),
            (Method::Chord(2), (1, 2)),
            (Method::Chord(4), (1, 2)),
        ];
        let meshes = [(1, 1), (2, 1), (4, 1), (8, 1), (1, 2), (2, 2), (4, 2)];
        // 0.03, 0.01 and 0.003 mm, as exact as if they were read.
        let accuracies = ["0.03", "0.01", "0.003"];
        let accurate = accuracies
            .iter()
            .filter_map(|mm| Quantity::parse(mm, Dimension::Length).ok());
        let estimates = estimates.into_iter().map(|(method, on)| mesh(method, on));
        let newton = meshes.into_iter().map(|on| mesh(Method::Newton, on));
        let accurate = accurate.map(|mm| Self(SolverParameters::accurate(mm)));
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
            (Some((elements, order)), Some((finest, highest))) => {
                order <= highest && (elements < finest || order < highest)
            }
            _ => true,
        }
    }

    fn prepare(&self, scene: &Scene) -> Result<Box<dyn Ready>, String> {
        let solver = self.0.build(scene).map_err(|e| explained(&e))?;
        Ok(Box::new(solver))
    }
}

impl Ready for Solver {
    fn fields(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, String> {
        let results = self.simulate(patterns).map_err(|e| explained(&e))?;
        Ok(results.into_iter().map(|result| result.simulation.field).collect())
    }
}

//! What judges the patterns of a search: a network, an estimate, or Newton's method.

use std::fmt;

use crate::base::{InputError, Node, Schema};
use crate::fem::SetupError;
use crate::field::{Field, PredictError, Predictor};
use crate::pattern::Pattern;
use crate::scene::Scene;
use crate::stage::method::Method;
use crate::stage::solver::{Solver, SolverParameters, explained};
use crate::surrogate::Surrogate;

const ALLOWED: &str = "allowed: auto, surrogate, newton, linear, chord:N with N from 1 to 50";

/// What a stage asks for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Wanted {
    /// The cheapest that is accurate enough.
    Auto,
    /// The network that the stage needs.
    Surrogate,
    /// A method on one bilinear element per cell.
    Elements(Method),
}

impl Wanted {
    /// Reads a word.
    ///
    /// # Errors
    /// When it is none of them.
    pub fn read(node: &Node) -> Result<Self, InputError> {
        let text = node.text("evaluator")?;
        match text {
            "auto" => Ok(Self::Auto),
            "surrogate" => Ok(Self::Surrogate),
            other => other.parse().map(Self::Elements).map_err(|_: String| {
                let message = format!("`evaluator` cannot be {text:?}");
                node.error(message).help(ALLOWED)
            }),
        }
    }

    /// What [`Wanted::read`] accepts.
    pub fn schema() -> Schema {
        Schema::any_of([Schema::word(&["auto", "surrogate"]), Method::schema()])
            .says("What judges patterns: the network, an estimate, Newton's method, or of these the cheapest that is accurate enough.")
            .default("auto")
    }
}

impl fmt::Display for Wanted {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Auto => f.write_str("auto"),
            Self::Surrogate => f.write_str("surrogate"),
            Self::Elements(method) => method.fmt(f),
        }
    }
}

/// An evaluator that is ready, or why it cannot be used.
pub struct Evaluator {
    /// Its settings on one line, as in an accuracy stage.
    pub settings: String,
    /// Predicts fields.
    pub predictor: Result<Box<dyn Predictor>, String>,
}

impl Evaluator {
    /// A network.
    pub fn network(surrogate: Surrogate) -> Self {
        Self {
            settings: format!("network: {}", surrogate.kind().name()),
            predictor: Ok(Box::new(surrogate)),
        }
    }

    /// A method on bilinear elements.
    pub fn elements(scene: &Scene, method: Method, elements_per_cell: u64) -> Self {
        let parameters = SolverParameters::on_mesh(method, elements_per_cell, 1);
        let ready = |solver| Box::new(Elements(solver)) as Box<dyn Predictor>;
        Self {
            settings: parameters.to_string(),
            predictor: parameters.build(scene).map(ready).map_err(|e| explained(&e)),
        }
    }
}

/// Finite elements as a predictor.
struct Elements(Solver);

impl Predictor for Elements {
    fn predict(&self, patterns: &[Pattern]) -> Result<Vec<Field>, PredictError> {
        let fields = self.predict_some(patterns)?.into_iter().enumerate();
        let missing = |at: usize| PredictError(format!("pattern {at} has no field"));
        fields.map(|(at, field)| field.ok_or_else(|| missing(at))).collect()
    }

    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<Field>>, PredictError> {
        let results = self
            .0
            .simulate(patterns)
            .map_err(|e: SetupError| PredictError(explained(&e)))?;
        Ok(results.into_iter().map(|result| result.simulation.field).collect())
    }
}

#[cfg(test)]
mod tests {
    use std::path::Path;

    use super::*;
    use crate::base::Document;

    #[test]
    fn evaluators_are_read_as_they_are_written() {
        let read = |text: &str| Wanted::read(&Document::from_text(Path::new("e"), text).unwrap().root);
        for text in ["auto", "surrogate", "linear", "chord:2", "newton"] {
            assert_eq!(read(text).unwrap().to_string(), text);
        }
        assert!(read("surogate").is_err() && read("chord:0").is_err());
    }

    #[test]
    fn estimates_give_no_field_where_there_is_none() {
        let scene = Scene::vhb4910().at_voltage(10e3);
        let patterns = [25, 0].map(|width| Pattern::from_fn(|x, _| x < width));
        let linear = Evaluator::elements(&scene, Method::Linear, 1).predictor.unwrap();
        let fields = linear.predict_some(&patterns).unwrap();
        assert!(fields[0].is_none() && fields[1].is_some());
        assert!(
            linear
                .predict(&patterns)
                .unwrap_err()
                .to_string()
                .contains("pattern 0 has no field")
        );
        let hot = Evaluator::elements(&Scene::vhb4910().at_voltage(20e3), Method::Linear, 1);
        assert!(hot.predictor.err().unwrap().contains("not stable"));
    }
}

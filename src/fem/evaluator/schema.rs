//! What a solver's parameters may look like.

use serde_json::json;

use super::method::Method;
use super::parameters::SolverParameters;
use crate::base::{Dimension, Fields, Schema};
use crate::field::Mesh;

impl SolverParameters {
    /// Adds the keys that [`SolverParameters::read`] looks for, the tolerance only where it is wanted.
    #[must_use]
    pub fn schema(fields: Fields, usual: Mesh, with_tolerance: bool) -> Fields {
        let fields = fields
            .optional("method", Method::schema().default("newton"))
            .optional(
                "elements_per_cell",
                Schema::whole(1, 8)
                    .says("Elements along one side of a cell.")
                    .default(usual.elements_per_cell()),
            )
            .optional(
                "order",
                Schema::whole(1, 2)
                    .says("Polynomial order of the elements.")
                    .default(usual.order().degree()),
            )
            .optional(
                "accuracy",
                Schema::quantity(Dimension::Length, 1e-9, 1e3).says(
                    "Instead of a mesh: the mesh of each pattern is picked so that its displacement is this accurate.",
                ),
            )
            .apart("accuracy", "elements_per_cell")
            .apart("accuracy", "order")
            .rule(estimates_lack("accuracy"));
        if !with_tolerance {
            return fields;
        }
        let tolerance = Schema::number(1e-12, 1e-3).says("Relative residual at which an equilibrium is accepted.");
        fields
            .optional("tolerance", tolerance.default(1e-8))
            .rule(estimates_lack("tolerance"))
    }
}

/// A method other than Newton's stands beside no such key.
fn estimates_lack(key: &str) -> serde_json::Value {
    json!({
        "if": { "required": ["method"], "properties": { "method": { "not": { "const": "newton" } } } },
        "then": { "not": { "required": [key] } },
    })
}

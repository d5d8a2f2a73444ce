//! Designs before they are searched, as the mapping of their stage has them.

use deaflow_design::{Method, Moment};

/// A design that a stage is to search.
#[derive(Clone, Debug, PartialEq)]
pub struct PlannedDesign {
    /// The stage.
    pub stage: String,
    /// Its label; empty without one.
    pub case: String,
    /// The target.
    pub target: String,
    /// What it is for, in YAML, as artifacts have it.
    pub objective: String,
    /// Of what that counts.
    pub moment: Moment,
    /// The wanted area fraction, or `free`.
    pub area: String,
    /// Its constraints in YAML, as artifacts have them.
    pub constraints: String,
    /// How it is searched.
    pub method: Method,
    /// Units along a side of a search along the gradient.
    pub units: usize,
}

impl PlannedDesign {
    /// What of their objectives and areas differs, as in `area 0.5 and 0.4`; empty where both are the same.
    #[must_use]
    pub fn differences(&self, other: &Self) -> Vec<String> {
        let differs = |name: &str, one: &str, two: &str| (one != two).then(|| format!("{name} {one} and {two}"));
        let objective = differs("objective", &self.objective, &other.objective);
        let area = differs("area", &self.area, &other.area);
        objective.into_iter().chain(area).collect()
    }

    /// By what its rows in a verification are told from those of other designs of its target.
    #[must_use]
    pub fn row(&self) -> (Method, usize) {
        match self.method {
            // What the genetic algorithm finds has units of its own.
            Method::Ga => (Method::Ga, 0),
            Method::Adjoint => (Method::Adjoint, self.units),
        }
    }
}

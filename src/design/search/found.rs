//! The result of a search: one row for each design, and for the intuitive designs.

use super::candidates::CandidateAccuracy;
use crate::evolve::GenerationReport;
use crate::local_search::{LocalOptimum, SearchStep};
use deaflow_field::StateFields;
use deaflow_pattern::{Pattern, Role};

/// A design of a target.
#[derive(Clone, Debug)]
pub struct FoundDesign {
    /// How it was found.
    pub role: Role,
    /// The number among several designs of the target, from 0.
    pub member: usize,
    /// Units along a side of the membrane in the search; [`CELLS`](deaflow_pattern::CELLS) if units were the cells of
    /// any raster.
    pub units: usize,
    /// The pattern.
    pub pattern: Pattern,
    /// The fields in the states of the device by the evaluator; zero if it has none.
    pub predicted: StateFields,
    /// Predicted mean displacement along the target directions in mm.
    pub value_mm: f64,
    /// The value that counts for several masks, as [`Goal::robust_value`](crate::Goal::robust_value); `None` for the
    /// mask as drawn.
    pub robust_value: Option<f64>,
    /// F; smaller is better.
    pub fitness: f64,
    /// `met`, or the requirements that are not met. The text is part of artifact digests.
    pub status: String,
}

/// The steps of a local search.
#[derive(Clone, Debug)]
pub struct Refinement {
    /// The role of the result.
    pub role: Role,
    /// The number among several designs, from 0.
    pub member: usize,
    /// The steps.
    pub steps: Vec<SearchStep>,
}

/// A finished search.
#[derive(Clone, Debug)]
pub struct SearchResult {
    /// The settings of the evaluator that predicted the fields.
    pub evaluator: String,
    /// The designs, and the intuitive designs for comparison.
    pub designs: Vec<FoundDesign>,
    /// The generations of the genetic algorithm.
    pub generations: Vec<GenerationReport>,
    /// The local searches.
    pub refinements: Vec<Refinement>,
    /// Number of patterns that the evaluator judged in the genetic algorithm.
    pub evaluations: usize,
    /// The accuracy of each candidate, if an evaluator was selected automatically.
    pub accuracies: Vec<CandidateAccuracy>,
}

/// A pattern that was found.
pub(super) struct FoundPattern {
    pub role: Role,
    pub units: usize,
    pub member: usize,
    pub pattern: Pattern,
}

/// The findings of a search so far.
#[derive(Default)]
pub(super) struct Findings {
    pub patterns: Vec<FoundPattern>,
    pub generations: Vec<GenerationReport>,
    pub refinements: Vec<Refinement>,
    pub evaluations: usize,
}

impl Findings {
    /// Adds the result of a local search.
    pub fn add(&mut self, role: Role, member: usize, units: usize, optimum: LocalOptimum) {
        self.patterns.push(FoundPattern {
            role,
            units,
            member,
            pattern: optimum.pattern,
        });
        self.refinements.push(Refinement {
            role,
            member,
            steps: optimum.steps,
        });
    }
}

//! What a search has found: a row for each pattern, beside those of the intuitive designs.

use super::probe::Probe;
use super::shortage::report_shortage;
use super::{Search, SearchError};
use crate::evolve::GenerationReport;
use crate::local_search::{LocalOptimum, SearchStep};
use deaflow_field::{Field, NO_FIELD, Predictor, StateFields};
use deaflow_pattern::{CELLS, Pattern, Role};

/// One pattern of a target.
#[derive(Clone, Debug)]
pub struct FoundDesign {
    /// How it came about.
    pub role: Role,
    /// Which of several designs of the target.
    pub member: usize,
    /// Units along a side of the membrane on which it was searched; [`CELLS`] where these are its cells, however many.
    pub units: usize,
    /// The pattern.
    pub pattern: Pattern,
    /// Its fields in the states of the device by the evaluator; zero where it has none.
    pub predicted: StateFields,
    /// Predicted mean displacement along the wanted directions in mm.
    pub value_mm: f64,
    /// F; smaller is better.
    pub fitness: f64,
    /// `met`, or which requirements are not.
    pub status: String,
}

/// How one local search went.
#[derive(Clone, Debug)]
pub struct Refinement {
    /// The role of its result.
    pub role: Role,
    /// Which of several designs.
    pub member: usize,
    /// Its steps.
    pub steps: Vec<SearchStep>,
}

/// A finished search.
#[derive(Clone, Debug)]
pub struct SearchResult {
    /// The settings of the evaluator that predicted the fields.
    pub evaluator: String,
    /// The designs, and the intuitive ones that they are compared with.
    pub designs: Vec<FoundDesign>,
    /// The generations of the genetic algorithm.
    pub generations: Vec<GenerationReport>,
    /// The local searches.
    pub refinements: Vec<Refinement>,
    /// Patterns that the genetic algorithm predicted.
    pub evaluations: usize,
    /// What each evaluator said where one was to be chosen.
    pub probes: Vec<Probe>,
}

/// A pattern that was found.
pub(super) struct FoundPattern {
    pub role: Role,
    pub units: usize,
    pub member: usize,
    pub pattern: Pattern,
}

/// What a search has found so far.
#[derive(Default)]
pub(super) struct Findings {
    pub patterns: Vec<FoundPattern>,
    pub generations: Vec<GenerationReport>,
    pub refinements: Vec<Refinement>,
    pub evaluations: usize,
}

impl Findings {
    /// Adds the end of a local search.
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

impl Search<'_> {
    /// The result of a search: its patterns and the intuitive ones, with their fields and what each does not keep.
    pub(super) fn result(
        &self,
        evaluator: String,
        predictor: &dyn Predictor<StateFields>,
        findings: Findings,
        probes: Vec<Probe>,
    ) -> Result<SearchResult, SearchError> {
        let mut found = findings.patterns;
        let intuitive = self.intuitive();
        let area = found.last().map_or(0.5, |best| best.pattern.area_fraction());
        for (role, pattern) in [
            (Role::Intuitive, intuitive.at_own_area()),
            (Role::IntuitiveEqualArea, intuitive.at_area(area)),
        ] {
            found.push(FoundPattern {
                role,
                units: CELLS,
                member: 0,
                pattern,
            });
        }
        let patterns: Vec<Pattern> = found.iter().map(|found| found.pattern.clone()).collect();
        let fields = predictor.predict_some(&patterns)?;
        let feasible = match self.feasibility()? {
            Some(feasibility) => feasibility.feasible(&patterns)?,
            None => vec![true; patterns.len()],
        };
        let rows = found.into_iter().zip(fields).zip(feasible);
        let mut designs: Vec<FoundDesign> = rows
            .map(|((found, fields), feasible)| self.design(found, fields, feasible))
            .collect();
        report_shortage(&mut designs, self.options.designs, self.options.distance.to_f64());
        Ok(SearchResult {
            evaluator,
            designs,
            generations: findings.generations,
            refinements: findings.refinements,
            evaluations: findings.evaluations,
            probes,
        })
    }

    fn design(&self, found: FoundPattern, fields: Option<StateFields>, feasible: bool) -> FoundDesign {
        let goal = &self.target.goal;
        let status = match &fields {
            None => NO_FIELD.to_owned(),
            Some(_) => self.status(&found, feasible),
        };
        let fields = fields.unwrap_or_else(|| vec![Field::zero(goal.raster()); self.drivers.len()]);
        FoundDesign {
            value_mm: goal.value_mm(&fields),
            fitness: goal.fitness(&found.pattern, &fields),
            role: found.role,
            member: found.member,
            units: found.units,
            pattern: found.pattern,
            predicted: fields,
            status,
        }
    }

    /// `met`, or in words which requirements are not. The intuitive design at its own area has no area to meet.
    fn status(&self, found: &FoundPattern, feasible: bool) -> String {
        let (low, high) = self.area_range();
        let area = found.pattern.area_fraction();
        let mut lines = Vec::new();
        if found.role != Role::Intuitive && !(low - 1e-9..=high + 1e-9).contains(&area) {
            let (wanted, tolerance) = (self.target.area, self.options.area_tolerance);
            lines.push(format!("area {area:.4}, wanted {wanted} within {tolerance}"));
        }
        lines.extend(self.constraints.violations(&found.pattern).lines());
        if !feasible {
            lines.push("the margins from pull-in or breakdown are not kept".to_owned());
        }
        match lines.is_empty() {
            true => "met".to_owned(),
            false => lines.join("; "),
        }
    }
}

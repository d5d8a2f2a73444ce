//! Converts the findings of a search to its result.

use super::candidates::CandidateAccuracy;
use super::found::{Findings, FoundDesign, FoundPattern, SearchResult};
use super::shortage::report_shortage;
use super::{Search, SearchError};
use crate::status::status_of;
use crate::target::Area;
use deaflow_field::{NO_FIELD, Predictor, StateFields};
use deaflow_pattern::{CELLS, Pattern, Role};

impl Search<'_> {
    /// The result of a search: fields and status of its patterns and of the intuitive designs.
    pub(super) fn result(
        &self,
        evaluator: String,
        predictor: &dyn Predictor<StateFields>,
        findings: Findings,
        accuracies: Vec<CandidateAccuracy>,
    ) -> Result<SearchResult, SearchError> {
        let mut found = findings.patterns;
        let intuitive = self.intuitive();
        let area = found
            .last()
            .map_or(0.5, |best| self.constraints.area_fraction(&best.pattern));
        for (role, pattern) in [
            (Role::Intuitive, self.constraints.connected(intuitive.at_own_area())),
            (
                Role::IntuitiveEqualArea,
                self.constraints.connected(intuitive.at_area(area)),
            ),
        ] {
            found.push(FoundPattern {
                role,
                units: CELLS,
                member: 0,
                pattern,
            });
        }
        let mut designs = self.designs(found, predictor)?;
        report_shortage(&mut designs, self.options.designs, self.options.distance.to_f64());
        Ok(SearchResult {
            evaluator,
            designs,
            generations: findings.generations,
            refinements: findings.refinements,
            evaluations: findings.evaluations,
            accuracies,
        })
    }

    /// Patterns with their fields and their status.
    pub(super) fn designs(
        &self,
        found: Vec<FoundPattern>,
        predictor: &dyn Predictor<StateFields>,
    ) -> Result<Vec<FoundDesign>, SearchError> {
        let patterns: Vec<Pattern> = found.iter().map(|found| found.pattern.clone()).collect();
        let fields = predictor.predict_some(&patterns)?;
        let feasible = match self.feasibility()? {
            Some(feasibility) => feasibility.feasible(&patterns)?,
            None => vec![true; patterns.len()],
        };
        let rows = found.into_iter().zip(fields).zip(feasible);
        Ok(rows
            .map(|((found, fields), feasible)| self.design(found, fields, feasible))
            .collect())
    }

    fn design(&self, found: FoundPattern, fields: Option<StateFields>, feasible: bool) -> FoundDesign {
        let goal = &self.target.goal;
        let status = match &fields {
            None if goal.is_robust() => format!("{NO_FIELD} with one of the masks, or a short circuit"),
            None => NO_FIELD.to_owned(),
            Some(_) => self.status(&found, feasible),
        };
        let mut fields = fields.unwrap_or_else(|| goal.at_rest(self.drivers.len()));
        let (fitness, robust_value) = (
            goal.fitness(self.constraints.area_fraction(&found.pattern), &fields),
            goal.robust_value(&fields),
        );
        fields.truncate(self.drivers.len());
        FoundDesign {
            value_mm: goal.value_mm(&fields),
            fitness,
            robust_value,
            role: found.role,
            member: found.member,
            units: found.units,
            pattern: found.pattern,
            predicted: fields,
            status,
        }
    }

    /// `met`, or the requirements that are not met. The intuitive design at its own area has no target area.
    fn status(&self, found: &FoundPattern, feasible: bool) -> String {
        let (low, high) = self.area_range();
        let area = self.constraints.area_fraction(&found.pattern);
        let mut lines = Vec::new();
        if found.role != Role::Intuitive && !(low - 1e-9..=high + 1e-9).contains(&area) {
            let (wanted, tolerance) = (self.target.area, self.options.area_tolerance);
            lines.push(match wanted {
                Area::AtMost(_) => format!("area {area:.4}, wanted {wanted}"),
                Area::Free | Area::Near(_) => format!("area {area:.4}, wanted {wanted} within {tolerance}"),
            });
        }
        lines.extend(self.constraints.violations(&found.pattern).lines());
        if !feasible {
            lines.push("the margins from pull-in or breakdown are not kept".to_owned());
        }
        status_of(&lines)
    }
}

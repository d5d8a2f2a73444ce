//! The search by the genetic algorithm.

use super::candidates::{Candidate, CandidateAccuracy, DesignReferences, PATTERNS, cheapest_evaluator};
use super::found::{Findings, FoundPattern};
use super::{Evaluators, Search, SearchError, SearchResult};
use crate::evolve::{EvolveError, EvolveProblem, evolve, first_generation_of};
use crate::genome::UNITS;
use crate::objective::RoughScore;
use deaflow_field::{Evaluator, InStates};
use deaflow_pattern::{Pattern, Role};

/// The settings of an evaluator, the evaluator in each state, and the accuracy of each candidate.
type ChosenEvaluator = (String, InStates<Box<dyn Evaluator>>, Vec<CandidateAccuracy>);

impl Search<'_> {
    pub(super) fn genetic(&self, evaluators: Evaluators) -> Result<SearchResult, SearchError> {
        let (settings, evaluator, accuracies) = self.evaluator(evaluators)?;
        let rough = self.rough()?;
        let problem = EvolveProblem {
            predictor: &evaluator,
            goal: &self.target.goal,
            constraints: self.constraints,
            feasibility: self.feasibility()?,
            rough: rough.as_ref(),
        };
        let evolution =
            evolve(&problem, &self.options.evolve(), self.progress).map_err(|error| self.evolve_error(error))?;
        let found = evolution.winners.into_iter().enumerate();
        let mut findings = Findings {
            patterns: found
                .map(|(member, winner)| FoundPattern {
                    role: Role::Ga,
                    units: UNITS,
                    member,
                    pattern: winner.pattern,
                })
                .collect(),
            refinements: Vec::new(),
            evaluations: evolution.evaluations,
            generations: evolution.history,
        };
        if self.options.refine {
            self.refine(&mut findings)?;
        }
        self.result(settings, &evaluator, findings, accuracies)
    }

    /// The named evaluator, or the cheapest one that is accurate enough, with its settings, and the accuracy of each
    /// candidate.
    pub(super) fn evaluator(&self, evaluators: Evaluators) -> Result<ChosenEvaluator, SearchError> {
        let (candidate, accuracies) = match evaluators {
            Evaluators::Named(candidate) => (candidate, Vec::new()),
            Evaluators::Cheapest(candidates) => self.cheapest(candidates)?,
        };
        let settings = candidate.settings;
        match candidate.evaluator {
            Ok(evaluator) => Ok((settings, evaluator, accuracies)),
            Err(why) => Err(SearchError::Evaluator { settings, why }),
        }
    }

    /// The error of a genetic algorithm for the target.
    pub(super) fn evolve_error(&self, error: EvolveError) -> SearchError {
        match error {
            EvolveError::Stopped(stopped) => stopped.into(),
            source => SearchError::Evolve {
                target: self.target.name.clone(),
                source,
            },
        }
    }

    /// The rough score; `None` if all patterns are judged.
    fn rough(&self) -> Result<Option<RoughScore<'_>>, SearchError> {
        if self.options.judged.to_f64() >= 1.0 {
            return Ok(None);
        }
        let elements = self.elements.gradient()?;
        Ok(RoughScore::new(&self.target.goal, elements, self.drivers.len())?)
    }

    /// The cheapest evaluator that is accurate enough, and the accuracy of each candidate.
    fn cheapest(&self, candidates: Vec<Candidate>) -> Result<(Candidate, Vec<CandidateAccuracy>), SearchError> {
        let count = self.options.population.min(PATTERNS);
        let genomes = first_generation_of(&self.target.goal, self.constraints, self.options.seed.0, count);
        let patterns: Vec<Pattern> = genomes
            .iter()
            .map(|genome| genome.pattern(self.target.goal.raster()))
            .collect();
        let (similar, values_mm) = self.similar_designs()?;
        let references = DesignReferences {
            patterns: &similar,
            values_mm: &values_mm,
            value_mm: &|fields| self.target.goal.value_mm(fields),
        };
        let accuracy_mm = self.options.evaluator_accuracy.value();
        Ok(cheapest_evaluator(candidates, &patterns, &references, accuracy_mm)?)
    }

    /// Patterns similar to future designs, with their displacements, since errors on the best patterns differ from
    /// those on random patterns: the intuitive design, and the result of a gradient search from it on the units of the
    /// genetic algorithm.
    fn similar_designs(&self) -> Result<(Vec<Pattern>, Vec<f64>), SearchError> {
        let problem = self.problem_on(UNITS)?;
        let intuitive = self.intuitive_start();
        let followed = problem.follow_gradient(&intuitive, &|_| ())?;
        let patterns: Vec<Pattern> = [intuitive]
            .into_iter()
            .chain(followed.ok().map(|optimum| optimum.pattern))
            .collect();
        let fields = self.elements.gradient()?.predict_some(&patterns)?;
        let pairs = patterns.into_iter().zip(fields);
        let known = pairs.filter_map(|(pattern, fields)| Some((pattern, self.target.goal.value_mm(&fields?))));
        Ok(known.unzip())
    }
}

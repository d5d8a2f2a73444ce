//! The search of a front: the best design of an objective within several limits of the active area or of the charge
//! (ε-constraints, Haimes et al., IEEE Transactions on Systems, Man, and Cybernetics 1(3), 1971).
//!
//! The search begins at the largest limit, from several start patterns. Each smaller limit is searched from the design
//! of the one before, whose weakest cells are removed: a few simulations lead to a new optimum. Then designs that a
//! smaller one dominates are searched again, from that one.
//!
//! The local search keeps to ranges of the area by itself. A charge is kept by its weight in the score (a multiplier),
//! which is adapted until the charge is just below its limit.

use std::cell::RefCell;
use std::sync::atomic::{AtomicUsize, Ordering};

use super::found::{Findings, FoundDesign};
use super::{Evaluators, Search, SearchError, SearchResult};
use crate::front::{Cost, Front, FrontMethod, FrontPoint, OtherObjective, hypervolume};
use crate::local_search::{LocalOptimum, SearchProblem, SearchStep, StartError};
use crate::objective::Goal;
use deaflow_field::{Differentiable, Field, PredictError, Predictor, StateFields, WithGradient};
use deaflow_pattern::{Pattern, Role};

/// Rounding of areas, and of charges in nC.
const ROUNDING: f64 = 1e-9;

/// What became of a point of a front.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum PointOutcome {
    /// It is a design of the front.
    Found,
    /// The design of a smaller limit, by its number from 0, is at least as good.
    Dominated(usize),
    /// There is no design within the limit.
    None(StartError),
}

/// A searched front.
#[derive(Clone, Debug)]
pub struct FoundFront {
    /// The designs, by ascending limits. The number among several designs is that of their limit.
    pub result: SearchResult,
    /// The limits of area or charge, ascending; none of the genetic algorithm.
    pub limits: Vec<f64>,
    /// What became of each.
    pub outcomes: Vec<PointOutcome>,
    /// The objectives of each design in their order, the first of the target, then the
    /// [others](crate::Front::others): gains over the membrane at rest, and area or charge in nC.
    pub values: Vec<Vec<f64>>,
    /// The reference of the hypervolume in each objective.
    pub reference: Vec<f64>,
    /// The number of simulated patterns and the hypervolume of the designs so far, whenever one was found or improved.
    pub history: Vec<(usize, f64)>,
}

/// A model that counts the patterns that it simulates.
struct Counted<'a> {
    model: &'a dyn Differentiable<StateFields>,
    count: AtomicUsize,
}

impl Counted<'_> {
    fn add(&self, patterns: usize) {
        self.count.fetch_add(patterns, Ordering::Relaxed);
    }

    fn count(&self) -> usize {
        self.count.load(Ordering::Relaxed)
    }
}

impl Predictor<StateFields> for Counted<'_> {
    fn predict_some(&self, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.add(patterns.len());
        self.model.predict_some(patterns)
    }
}

impl Differentiable<StateFields> for Counted<'_> {
    fn gradient(
        &self,
        pattern: &Pattern,
        slope: &dyn Fn(&StateFields) -> StateFields,
    ) -> Result<Option<WithGradient<StateFields>>, PredictError> {
        self.add(1);
        self.model.gradient(pattern, slope)
    }

    fn predict_near(&self, base: &Pattern, patterns: &[Pattern]) -> Result<Vec<Option<StateFields>>, PredictError> {
        self.add(patterns.len());
        self.model.predict_near(base, patterns)
    }

    fn linear_response(&self, weights: &[StateFields]) -> Result<Option<Vec<WithGradient<f64>>>, PredictError> {
        self.model.linear_response(weights)
    }
}

/// A design within a limit.
#[derive(Clone)]
struct Point {
    optimum: LocalOptimum,
    at: FrontPoint,
    /// The weight of the charge with which it was found.
    weight: f64,
}

/// Number of weights that are tried for one limit of the charge.
const WEIGHTS: usize = 8;

/// Share of a limit by which a charge may be below it.
const CLOSE: f64 = 0.005;

/// A running search of a front.
struct FrontSearch<'s, 'a> {
    search: &'s Search<'a>,
    /// The second objective.
    cost: &'s Cost,
    model: &'s Counted<'a>,
    /// The accepted steps: the number of simulated patterns, the number of the limit and the design.
    steps: RefCell<Vec<(usize, usize, FrontPoint)>>,
}

impl Search<'_> {
    /// Searches a front: one cost by ε-constraints, and others by the genetic algorithm, for which `evaluators` creates
    /// the evaluators. The target is that of the first objective, with a free area.
    ///
    /// # Errors
    /// If the scene cannot be simulated, or no design is found.
    pub fn front(&self, front: &Front, evaluators: impl FnOnce() -> Evaluators) -> Result<FoundFront, SearchError> {
        match (&front.others[..], front.pareto.method) {
            ([OtherObjective::Cost(cost)], FrontMethod::Epsilon) => self.front_within_limits(cost, front.pareto.points),
            _ => self.genetic_front(front, evaluators),
        }
    }

    /// Searches the front of the target and a cost by ε-constraints.
    fn front_within_limits(&self, cost: &Cost, points: usize) -> Result<FoundFront, SearchError> {
        let model = Counted {
            model: self.elements.gradient()?,
            count: AtomicUsize::new(0),
        };
        let search = FrontSearch {
            search: self,
            cost,
            model: &model,
            steps: RefCell::default(),
        };
        let last = points - 1;
        // Without given ends, the largest limit is that of the best design of all.
        let first = match cost.within() {
            Some(_) => None,
            None => Some(search.searched_from_starts((last, f64::INFINITY), true)?),
        };
        let largest = match &first {
            None => cost.limits(points, 0.0)[last],
            Some(Ok(point)) => point.at.cost,
            Some(Err(why)) => return Err(self.no_start(*why)),
        };
        let limits = cost.limits(points, largest);
        let mut points = search.downwards(&limits, first)?;
        let outcomes = search.upwards(&limits, &mut points)?;
        let reference = FrontPoint {
            value: 0.0,
            cost: cost.reference(limits[last]),
        };
        let history = search.history(&limits, reference);
        let kept = points
            .iter()
            .zip(&outcomes)
            .filter(|(_, outcome)| **outcome == PointOutcome::Found);
        let kept = kept.filter_map(|(point, _)| point.as_ref().ok());
        let values = kept.map(|point| vec![point.at.value, point.at.cost]).collect();
        Ok(FoundFront {
            result: self.front_result(points, &outcomes)?,
            values,
            limits,
            outcomes,
            reference: vec![reference.value, reference.cost],
            history,
        })
    }

    /// The error of a search without any design.
    pub(super) fn no_start(&self, why: StartError) -> SearchError {
        let (target, tried) = (self.target.name.clone(), self.options.starts);
        SearchError::NoStart { target, tried, why }
    }

    /// The designs of the points that are not dominated.
    fn front_result(
        &self,
        points: Vec<Result<Point, StartError>>,
        outcomes: &[PointOutcome],
    ) -> Result<SearchResult, SearchError> {
        let mut findings = Findings::default();
        for (at, (point, outcome)) in points.into_iter().zip(outcomes).enumerate() {
            match (point, outcome) {
                (Ok(point), PointOutcome::Found) => {
                    findings.add(Role::Optimum, at, self.options.units, point.optimum);
                }
                (Err(why), _) if !outcomes.contains(&PointOutcome::Found) => return Err(self.no_start(why)),
                _ => {}
            }
        }
        let designs: Vec<FoundDesign> = self.designs(findings.patterns, self.elements.gradient()?)?;
        Ok(SearchResult {
            evaluator: self.elements.settings(),
            designs,
            generations: Vec::new(),
            refinements: findings.refinements,
            evaluations: 0,
            accuracies: Vec::new(),
        })
    }
}

impl FrontSearch<'_, '_> {
    /// The problem of a goal within a limit of the area; the charge is free.
    fn problem<'p>(&'p self, goal: &'p Goal, limit: f64) -> Result<SearchProblem<'p>, SearchError> {
        let (search, is_charge) = (self.search, self.cost.is_charge());
        let area = if is_charge { 1.0 } else { limit.min(1.0) };
        let problem = search.problem_of((self.model, goal), search.options.units, (0.0, area));
        Ok(problem.with_feasibility(search.feasibility()?))
    }

    /// Records the steps of a search within a limit, with a weight of the charge.
    fn observe(&self, at: usize, weight: f64) -> impl Fn(&SearchStep) {
        move |step: &SearchStep| {
            self.search.progress.step(step);
            let is_charge = self.cost.is_charge();
            let point = FrontPoint {
                value: self.gain(step.score + weight * step.charge),
                cost: if is_charge { step.charge } else { step.area },
            };
            self.steps.borrow_mut().push((self.model.count(), at, point));
        }
    }

    /// The best design within a limit from the start patterns. The first of these searches has a step of the progress
    /// for each pattern, and one more.
    fn searched_from_starts(
        &self,
        (at, limit): (usize, f64),
        is_first: bool,
    ) -> Result<Result<Point, StartError>, SearchError> {
        let search = self.search;
        let searched = || {
            if is_first {
                search.progress.searched();
            }
        };
        let problem = self.problem(&search.target.goal, limit)?;
        let found = search.best_of(&problem, &search.starts(), &self.observe(at, 0.0), &searched)?;
        match self.point(found, 0.0) {
            Ok(point) if point.at.cost > limit + ROUNDING => self.within_charge(at, limit, &point),
            found => Ok(found),
        }
    }

    /// A design within a limit from another one.
    fn searched_from_design(
        &self,
        at: usize,
        limit: f64,
        start: &Point,
    ) -> Result<Result<Point, StartError>, SearchError> {
        match self.cost.is_charge() {
            true => self.within_charge(at, limit, start),
            false => self.follow((at, limit), &start.optimum.pattern, 0.0),
        }
    }

    /// Follows the gradient with a weight of the charge.
    fn follow(
        &self,
        (at, limit): (usize, f64),
        start: &Pattern,
        weight: f64,
    ) -> Result<Result<Point, StartError>, SearchError> {
        let goal = self.search.target.goal.clone().with_charge_weight(weight);
        let problem = self.problem(&goal, limit)?;
        let found = problem.follow_gradient(start, &self.observe(at, weight))?;
        Ok(self.point(found, weight))
    }

    /// The best design within a limit of the charge from another one, by several weights of the charge.
    fn within_charge(&self, at: usize, limit: f64, start: &Point) -> Result<Result<Point, StartError>, SearchError> {
        // A tenth of the score for the whole charge, if no weight is known.
        let score = self.search.target.goal.score(&start.optimum.fields);
        let mut weight = match start.weight > 0.0 {
            true => start.weight,
            false => 0.1 * score.abs() / start.at.cost,
        };
        let (mut from, mut best) = (start.optimum.pattern.clone(), None::<Point>);
        let (mut above, mut below) = (None, None);
        for _ in 0..WEIGHTS {
            match self.follow((at, limit), &from, weight)? {
                Ok(point) if point.at.cost > limit + ROUNDING => {
                    above = Some((weight, point.at.cost));
                    from = point.optimum.pattern;
                }
                Ok(point) => {
                    let is_close = point.at.cost >= (1.0 - CLOSE) * limit;
                    below = Some((weight, point.at.cost));
                    from.clone_from(&point.optimum.pattern);
                    if best.as_ref().is_none_or(|known| point.at.value > known.at.value) {
                        best = Some(point);
                    }
                    if is_close {
                        break;
                    }
                }
                // No electrode is worth its charge.
                Err(StartError::NoPattern) => below = Some((weight, 0.0)),
                Err(why @ StartError::NoField) => return Ok(best.ok_or(why)),
            }
            weight = next_weight(above, below, limit);
        }
        Ok(best.ok_or(StartError::NoPattern))
    }

    /// What a score gains over the membrane at rest.
    fn gain(&self, score: f64) -> f64 {
        self.search.target.goal.gain(score, self.search.drivers.len())
    }

    /// A design that gains nothing is none.
    fn point(&self, found: Result<LocalOptimum, StartError>, weight: f64) -> Result<Point, StartError> {
        let optimum = found?;
        let area = self.search.constraints.area_fraction(&optimum.pattern);
        let at = FrontPoint {
            value: self.gain(self.search.target.goal.score(&optimum.fields)),
            cost: match self.cost.is_charge() {
                true => optimum.fields.iter().map(Field::charge).sum(),
                false => area,
            },
        };
        match area > 0.0 && at.value > 0.0 {
            true => Ok(Point { optimum, at, weight }),
            false => Err(StartError::NoPattern),
        }
    }

    /// Searches all limits, the largest first, for which a design may be known.
    fn downwards(
        &self,
        limits: &[f64],
        mut known: Option<Result<Point, StartError>>,
    ) -> Result<Vec<Result<Point, StartError>>, SearchError> {
        let mut points: Vec<Result<Point, StartError>> = Vec::new();
        for (at, &limit) in limits.iter().enumerate().rev() {
            let before = points.iter().rev().find_map(|point| point.as_ref().ok());
            let point = match (known.take(), before) {
                (Some(known), _) => known,
                // A design that is the best within a larger limit is so within this one.
                (None, Some(before)) if before.at.cost <= limit + ROUNDING => Ok(before.clone()),
                (None, Some(before)) => self.searched_from_design(at, limit, before)?,
                (None, None) => self.searched_from_starts((at, limit), points.is_empty())?,
            };
            if !points.is_empty() {
                self.search.progress.searched();
            }
            points.push(point);
        }
        points.reverse();
        Ok(points)
    }

    /// Finds the points that one of a smaller limit dominates, and searches them again from that one.
    fn upwards(
        &self,
        limits: &[f64],
        points: &mut [Result<Point, StartError>],
    ) -> Result<Vec<PointOutcome>, SearchError> {
        let mut outcomes = Vec::new();
        for at in 0..points.len() {
            let best = (0..at).filter_map(|other| Some((other, points[other].as_ref().ok()?.clone())));
            let best = best.reduce(|best, other| {
                if other.1.at.value > best.1.at.value {
                    other
                } else {
                    best
                }
            });
            if let (Some((_, best)), Ok(point)) = (&best, &points[at])
                && best.at.covers(&point.at)
                && best.optimum.pattern != point.optimum.pattern
                && let Ok(found) = self.searched_from_design(at, limits[at], best)?
            {
                points[at] = Ok(found);
            }
            outcomes.push(match (&points[at], best) {
                (Err(why), _) => PointOutcome::None(*why),
                (Ok(point), Some((other, best))) if best.at.covers(&point.at) => PointOutcome::Dominated(other),
                (Ok(_), _) => PointOutcome::Found,
            });
        }
        Ok(outcomes)
    }

    /// The hypervolume of the best designs so far, at each step at which it grows.
    fn history(&self, limits: &[f64], reference: FrontPoint) -> Vec<(usize, f64)> {
        let (mut best, mut history) = (vec![None::<FrontPoint>; limits.len()], Vec::<(usize, f64)>::new());
        for &(count, at, point) in self.steps.borrow().iter() {
            let is_within = point.cost <= limits[at] + ROUNDING;
            if !is_within || best[at].is_some_and(|known| known.value >= point.value) {
                continue;
            }
            best[at] = Some(point);
            let known: Vec<FrontPoint> = best.iter().flatten().copied().collect();
            let reached = hypervolume(&known, reference);
            match history.last_mut() {
                Some((_, before)) if reached <= *before => {}
                Some((last, before)) if *last == count => *before = reached,
                _ => history.push((count, reached)),
            }
        }
        history
    }
}

/// The next weight of the charge for a limit, given those with a charge above and below it: between them if both are
/// known, otherwise twice or half of the known one.
fn next_weight(above: Option<(f64, f64)>, below: Option<(f64, f64)>, limit: f64) -> f64 {
    match (above, below) {
        (Some((low, more)), Some((high, less))) => {
            let target = (1.0 - 0.5 * CLOSE) * limit;
            let share = ((more - target) / (more - less)).clamp(0.1, 0.9);
            low + share * (high - low)
        }
        (Some((low, _)), None) => 2.0 * low,
        (None, Some((high, _))) => 0.5 * high,
        (None, None) => 0.0,
    }
}

#[cfg(test)]
mod tests;

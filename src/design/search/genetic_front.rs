//! The search of a front by the genetic algorithm NSGA-II.
//!
//! Half of the first generation may be the best patterns of the linear response: the cells that are worth most to the
//! objectives, which are weighted in several ways, at several areas. On the default scene these reach most of the
//! front of displacement against area; the genetic algorithm improves what is between.

use super::found::{Findings, FoundPattern};
use super::front::FoundFront;
use super::{Evaluators, Search, SearchError, SearchResult};
use crate::evolve::{EvolveError, FrontMember, FrontProblem, evolve_front};
use crate::front::{Cost, Front, OtherObjective, hypervolume_of};
use crate::genome::{Genome, UNITS, Units, unit_of};
use crate::objective::Goal;
use deaflow_field::{Field, Predictor, StateFields};
use deaflow_pattern::{Pattern, Raster, Role};

/// Areas of the patterns of the first generation that the linear response suggests: these many, at equal steps.
const AREAS: usize = 12;

/// The largest of these areas.
const LARGEST_AREA: f64 = 0.6;

/// Steps of the weights between two objectives.
const WEIGHTS: usize = 4;

impl Search<'_> {
    /// Searches a front by the genetic algorithm.
    pub(super) fn genetic_front(
        &self,
        front: &Front,
        evaluators: impl FnOnce() -> Evaluators,
    ) -> Result<FoundFront, SearchError> {
        // Only finite elements measure the charge.
        let (settings, chosen, accuracies) = match front.has_charge() {
            true => (self.elements.settings(), None, Vec::new()),
            false => {
                let (settings, evaluator, accuracies) = self.evaluator(evaluators())?;
                (settings, Some(evaluator), accuracies)
            }
        };
        let predictor: &dyn Predictor<StateFields> = match &chosen {
            Some(evaluator) => evaluator,
            None => self.elements.gradient()?,
        };
        let states = self.drivers.len();
        let gain = |goal: &Goal, fields: &StateFields| goal.gain(goal.score(fields), states);
        let values = |pattern: &Pattern, fields: &StateFields| {
            let others = front.others.iter().map(|other| match other {
                OtherObjective::Value(_, goal) => gain(goal, fields),
                OtherObjective::Cost(Cost::Area(_)) => -self.constraints.area_fraction(pattern),
                OtherObjective::Cost(Cost::Charge(_)) => -fields.iter().map(Field::charge).sum::<f64>(),
            });
            std::iter::once(gain(&self.target.goal, fields)).chain(others).collect()
        };
        let mut first = self.suggested(front)?;
        first.truncate(self.options.population / 2);
        let problem = FrontProblem {
            predictor,
            values: &values,
            constraints: self.constraints,
            feasibility: self.feasibility()?,
            first: &first,
        };
        let found = evolve_front(&problem, &self.options.evolve(), self.progress);
        let found = found.map_err(|error| self.evolve_error(error))?;
        // Without electrodes nothing moves. That is no design, and better than one that gains nothing.
        let gains = |member: &FrontMember| {
            let others = front.others.iter().zip(&member.values[1..]);
            let gains = others.filter(|(other, _)| matches!(other, OtherObjective::Value(..)));
            member.values[0] > 0.0 || gains.into_iter().any(|(_, value)| *value > 0.0)
        };
        let mut designs: Vec<&FrontMember> = Vec::new();
        for member in found.front.iter().filter(|member| gains(member)) {
            if designs.iter().all(|known| known.values != member.values) {
                designs.push(member);
            }
        }
        if designs.is_empty() {
            return Err(self.evolve_error(EvolveError::NoDesign));
        }
        let all: Vec<Vec<f64>> = designs.iter().map(|member| member.values.clone()).collect();
        let reference = reference(front, &all);
        let chosen = most_different(&all, (1 + front.others.len(), front.pareto.points), &reference, front);
        let mut findings = Findings::default();
        for (member, at) in chosen.iter().enumerate() {
            findings.patterns.push(FoundPattern {
                role: Role::Ga,
                units: UNITS,
                member,
                pattern: designs[*at].pattern.clone(),
            });
        }
        let mut history = Vec::<(usize, f64)>::new();
        for (at, generation) in found.history.iter().enumerate() {
            let reached = hypervolume_of(&generation.front, &reference);
            // A generation keeps a part of a large front: at the end stands what it has.
            if at + 1 == found.history.len() || history.last().is_none_or(|(_, before)| reached > *before) {
                history.push((generation.evaluations, reached));
            }
        }
        let evaluations = found.history.last().map_or(0, |last| last.evaluations);
        let signs = front.others.iter().map(|other| match other {
            OtherObjective::Value(..) => 1.0,
            OtherObjective::Cost(_) => -1.0,
        });
        let signs: Vec<f64> = std::iter::once(1.0).chain(signs).collect();
        let natural = |values: &[f64]| values.iter().zip(&signs).map(|(value, sign)| value * sign).collect();
        Ok(FoundFront {
            values: chosen.iter().map(|at| natural(&all[*at])).collect(),
            reference: natural(&reference),
            limits: Vec::new(),
            outcomes: Vec::new(),
            history,
            result: SearchResult {
                evaluator: settings,
                designs: self.designs(findings.patterns, predictor)?,
                generations: Vec::new(),
                refinements: Vec::new(),
                evaluations,
                accuracies,
            },
        })
    }

    /// Genomes whose units are worth most to the objectives in the linear response.
    fn suggested(&self, front: &Front) -> Result<Vec<Genome>, SearchError> {
        let elements = self.elements.gradient()?;
        let others = front.others.iter().filter_map(|other| match other {
            OtherObjective::Value(_, goal) => Some(&**goal),
            OtherObjective::Cost(_) => None,
        });
        let goals: Vec<&Goal> = std::iter::once(&self.target.goal).chain(others).collect();
        let mut worths: Vec<Vec<f64>> = Vec::new();
        for goal in goals {
            let slope = goal.slope(&goal.at_rest(self.drivers.len()));
            let Some(responses) = elements.linear_response(&[slope])? else {
                return Ok(Vec::new());
            };
            worths.extend(responses.into_iter().filter_map(|(_, worth)| scaled(worth)));
        }
        let mixed = mixtures(&worths);
        let groups = self.constraints.groups();
        let raster = self.constraints.membrane().raster;
        let units = Units::of(self.constraints.allowed());
        let each = mixed
            .iter()
            .map(|worth| units.shared(unit_worths(worth, groups, raster)));
        let genomes = each.map(|worth| by_area(&worth)).collect::<Vec<_>>();
        // The areas of all mixtures by turns, so that few genomes still have all of them.
        Ok((0..AREAS)
            .flat_map(|at| genomes.iter().filter_map(move |areas| areas.get(at).cloned()))
            .collect())
    }
}

/// Values as shares of the largest; `None` if all are zero, or one is not finite.
fn scaled(worth: Vec<f64>) -> Option<Vec<f64>> {
    let largest = worth.iter().fold(0.0, |largest: f64, value| largest.max(value.abs()));
    let is_usable = largest > 0.0 && worth.iter().all(|value| value.is_finite());
    is_usable.then(|| worth.into_iter().map(|value| value / largest).collect())
}

/// Each of several lists of worths, and each pair with several weights.
fn mixtures(worths: &[Vec<f64>]) -> Vec<Vec<f64>> {
    let mut mixed = worths.to_vec();
    for (at, one) in worths.iter().enumerate() {
        for other in &worths[at + 1..] {
            for step in 1..WEIGHTS {
                let share = step as f64 / WEIGHTS as f64;
                let pairs = one.iter().zip(other);
                mixed.push(pairs.map(|(a, b)| (1.0 - share) * a + share * b).collect());
            }
        }
    }
    mixed
}

/// The most valuable group of each unit and its worth, from the worths of cells, `[group][y][x]`.
fn unit_worths(worth: &[f64], groups: usize, raster: Raster) -> Vec<(u8, f64)> {
    let (cells, [columns, _]) = (raster.cells(), raster.sides());
    let mut sums = vec![vec![0.0; UNITS * UNITS]; groups];
    for cell in 0..cells {
        let [x, y] = unit_of(raster, [cell % columns, cell / columns]);
        for (group, sums) in sums.iter_mut().enumerate() {
            sums[y * UNITS + x] += worth.get(group * cells + cell).copied().unwrap_or(0.0);
        }
    }
    let best = |unit: usize| {
        let of_groups = sums
            .iter()
            .enumerate()
            .map(|(group, sums)| (group as u8 + 1, sums[unit]));
        of_groups
            .reduce(|best, other| if other.1 > best.1 { other } else { best })
            .unwrap_or((1, 0.0))
    };
    (0..UNITS * UNITS).map(best).collect()
}

/// The genomes of the units that are worth most, at several areas; none beyond the units that are worth something.
fn by_area(units: &[(u8, f64)]) -> Vec<Genome> {
    let mut ranked: Vec<usize> = (0..units.len()).filter(|&unit| units[unit].1 > 0.0).collect();
    ranked.sort_by(|&a, &b| units[b].1.total_cmp(&units[a].1).then(a.cmp(&b)));
    let count = |at: usize| ((at + 1) as f64 / AREAS as f64 * LARGEST_AREA * units.len() as f64).round() as usize;
    let counts = (0..AREAS).map(count).filter(|&count| count <= ranked.len());
    counts
        .map(|count| {
            let mut genes = vec![0; units.len()];
            ranked[..count].iter().for_each(|&unit| genes[unit] = units[unit].0);
            Genome::from_groups(|x, y| genes[y * UNITS + x])
        })
        .collect()
}

/// The reference of the hypervolume: no gain, or the least one of the front if that is a loss; of a cost the given
/// reference, or the largest cost of the front.
fn reference(front: &Front, values: &[Vec<f64>]) -> Vec<f64> {
    let least = |objective: usize| {
        values
            .iter()
            .map(|values| values[objective])
            .fold(f64::INFINITY, f64::min)
    };
    let others = front.others.iter().enumerate().map(|(at, other)| match other {
        OtherObjective::Value(..) => least(at + 1).min(0.0),
        OtherObjective::Cost(cost) => -cost.reference(-least(at + 1)),
    });
    std::iter::once(least(0).min(0.0)).chain(others).collect()
}

/// The indices of points that make the front: the best of each objective that is a gain, then one after the other that
/// adds the largest hypervolume. So a front with more points has those of one with fewer. Sorted by the first
/// objective.
fn most_different(
    values: &[Vec<f64>],
    (objectives, most): (usize, usize),
    reference: &[f64],
    front: &Front,
) -> Vec<usize> {
    if values.len() <= most {
        return by_first(values, (0..values.len()).collect());
    }
    let is_gain = |objective: &usize| match objective.checked_sub(1) {
        None => true,
        Some(at) => matches!(front.others[at], OtherObjective::Value(..)),
    };
    let mut chosen: Vec<usize> = Vec::new();
    for objective in (0..objectives).filter(is_gain) {
        let better = |a: usize, b: usize| {
            if values[b][objective] > values[a][objective] {
                b
            } else {
                a
            }
        };
        let best = (0..values.len()).reduce(better);
        chosen.extend(best.filter(|best| !chosen.contains(best)));
    }
    chosen.truncate(most);
    while chosen.len() < most {
        let with = |at: usize| {
            let all: Vec<Vec<f64>> = chosen.iter().chain([&at]).map(|at| values[*at].clone()).collect();
            (at, hypervolume_of(&all, reference))
        };
        let others = (0..values.len()).filter(|at| !chosen.contains(at));
        let best = others
            .map(with)
            .reduce(|best, other| if other.1 > best.1 { other } else { best });
        match best {
            Some((at, _)) => chosen.push(at),
            None => break,
        }
    }
    by_first(values, chosen)
}

/// Points sorted by the first objective.
fn by_first(values: &[Vec<f64>], mut points: Vec<usize>) -> Vec<usize> {
    points.sort_by(|&a, &b| values[a][0].total_cmp(&values[b][0]).then(a.cmp(&b)));
    points
}

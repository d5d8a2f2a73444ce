//! The fit of parameters to sets of data of different kinds.

use crate::curve::{Curve, FitError};
use crate::data_set::{DataSet, Noise, Numbers, Prepared};
use crate::elastomer::Number;
use crate::field::{CorrelatedNoise, FieldResult};
use crate::fit::{CurveResiduals, Options, Outlier, Verdict, fit, outliers};
use crate::law::LawKind;
use crate::least_squares::Evaluation;
use crate::parameter::FreeParameter;
use crate::solution::{Coordinate, Correlated, Estimate, Model, Profiles, Scale, Solution};
use crate::warning::{Warning, curve_warnings};
use deaflow_linalg::Mat;

/// The factor by which further starts differ from those given.
const FURTHER: f64 = 2.0;
/// The largest number of further starts.
const FURTHER_STARTS: usize = 6;

/// The settings of a joint fit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointOptions {
    /// Values of parameters that are not free. Those that no set needs are ignored.
    pub fixed: Vec<(String, f64)>,
    /// Which parameters get a profile.
    pub profiles: Profiles,
    /// Values of all free parameters from which further searches start.
    pub more_starts: Vec<Vec<f64>>,
}

/// A set of data beside the fitted model.
#[derive(Clone, Debug, PartialEq)]
pub struct SetResult {
    /// The name.
    pub name: String,
    /// The number of numbers that count: not those of stress at stretch 1; of fields, two for each point.
    pub points: usize,
    /// χ² of the set, or the sum of the squares of its residuals.
    pub sum_of_squares: f64,
    /// (model − data)/σ where σ is stated, else (model − data)/|data| or model − data, by row; zero at stretch 1. Of
    /// fields, those of ux and uy of each point in turn.
    pub residuals: Vec<f64>,
    /// The numbers of the model, by row; not a number at stretch 1 of stresses at equilibrium. Empty for fields.
    pub simulated: Vec<f64>,
    /// The images, of fields.
    pub field: Option<FieldResult>,
}

/// Parameters fitted to sets of data.
#[derive(Clone, Debug)]
pub struct JointFit {
    /// The free parameters in the order in which they were given. Standard errors, intervals and profiles take
    /// correlation of the noise of fields into account.
    pub estimate: Estimate,
    /// The standard errors if all noise were independent.
    pub independent_errors: Vec<Option<f64>>,
    /// The sets in the order in which they were given.
    pub sets: Vec<SetResult>,
    /// Points far from the model.
    pub outliers: Vec<Outlier>,
    /// What in the data should be looked at.
    pub warnings: Vec<Warning>,
    /// What the data determine.
    pub verdict: Verdict,
}

/// Fits free parameters to all sets.
///
/// # Errors
/// When a set or a parameter is not valid, a set lacks a parameter, the model has no state at any start, or a
/// simulation fails.
pub fn fit_together(
    parameters: &[FreeParameter],
    sets: &[DataSet<'_>],
    options: &JointOptions,
) -> Result<JointFit, FitError> {
    let model = JointModel::new(parameters, sets, &options.fixed)?;
    let starts = starts(parameters, options)?;
    let mut solution = Solution::new(&model, &starts);
    if model.failure().is_none() && !solution.as_ref().is_some_and(Solution::converged) {
        let further = Solution::new(&model, &model.further_starts(&starts));
        solution = match (solution, further) {
            (Some(one), Some(other)) => Some(one.or(other)),
            (one, other) => one.or(other),
        };
    }
    let found = match (model.failure(), solution) {
        (Some(error), _) => return Err(error),
        (None, None) => return Err(model.no_state(&starts)),
        (None, Some(solution)) => solution,
    };
    let estimate = found.estimate(options.profiles);
    let results = model.results(&found.values(), found.residuals(), found.correlation_lengths());
    if let Some(error) = model.failure() {
        return Err(error);
    }
    let results = results.ok_or_else(|| model.no_state(&[found.values()]))?;
    Ok(JointFit {
        independent_errors: found.independent_errors(),
        outliers: all_outliers(&results, found.spread()),
        warnings: warnings(sets, &results),
        sets: results,
        verdict: Verdict::of(&estimate),
        estimate,
    })
}

/// Returns the numbers of a model of a specimen or a sheet for values of its parameters by name.
///
/// # Errors
/// When the set is not valid, a parameter is missing, or there is no state.
pub fn simulate(set: &DataSet<'_>, values: &[(String, f64)]) -> Result<Vec<f64>, FitError> {
    let prepared = Prepared::new(set, &|_| false)?;
    let values: Vec<f64> = sources(&prepared, &[], values)?
        .into_iter()
        .map(|source| match source {
            Source::Fixed(value) => value,
            Source::Free(_) => f64::NAN,
        })
        .collect();
    let none = || FitError::NoState {
        set: prepared.name.to_owned(),
    };
    prepared.simulated(&values).ok_or_else(none)
}

/// Returns the starts of the searches.
fn starts(parameters: &[FreeParameter], options: &JointOptions) -> Result<Vec<Vec<f64>>, FitError> {
    let mut starts = vec![parameters.iter().map(|parameter| parameter.start).collect::<Vec<f64>>()];
    starts.extend(options.more_starts.iter().cloned());
    if let Some(start) = starts.iter().find(|start| start.len() != parameters.len()) {
        let (found, expected) = (start.len(), parameters.len());
        return Err(FitError::StartCount { found, expected });
    }
    for (i, parameter) in parameters.iter().enumerate() {
        parameter.coordinate(starts.iter().map(|start| start[i]))?;
    }
    Ok(starts)
}

fn all_outliers(results: &[SetResult], spread: f64) -> Vec<Outlier> {
    let of = |result: &SetResult| match &result.field {
        Some(field) => field.statistics.outliers.clone(),
        None => {
            let (name, residuals) = (result.name.clone(), result.residuals.clone());
            outliers(&[CurveResiduals { name, residuals }], spread)
        }
    };
    results.iter().flat_map(of).collect()
}

/// Returns the warnings about curves, those of one law together, and about images.
fn warnings(sets: &[DataSet<'_>], results: &[SetResult]) -> Vec<Warning> {
    let mut laws: Vec<(LawKind, Vec<Curve>)> = Vec::new();
    for set in sets {
        if let DataSet::Curve(law, curve) = set {
            match laws.iter_mut().find(|(kind, _)| kind == law) {
                Some((_, curves)) => curves.push(curve.clone()),
                None => laws.push((*law, vec![curve.clone()])),
            }
        }
    }
    let options = Options {
        profiles: Profiles::Never,
        ..Options::default()
    };
    // Curves that do not determine their law alone still have stretches.
    let of_law = |(law, curves): (LawKind, Vec<Curve>)| match fit(&curves, law, &options) {
        Ok(fit) => fit.warnings,
        Err(_) => curves.iter().flat_map(curve_warnings).collect(),
    };
    let images = results.iter().flat_map(|result| &result.field);
    let dropped = images.flat_map(|field| &field.images).filter(|image| image.dropped > 0);
    let dropped = dropped.map(|image| Warning::Dropped {
        image: image.name.clone(),
        rows: image.dropped,
    });
    laws.into_iter().flat_map(of_law).chain(dropped).collect()
}

/// Where the value of a parameter of a set comes from.
#[derive(Clone, Copy, Debug)]
enum Source {
    Free(usize),
    Fixed(f64),
}

/// All sets.
struct JointModel<'a> {
    coordinates: Vec<Coordinate>,
    sets: Vec<Prepared<'a>>,
    /// Of the parameters of each set.
    sources: Vec<Vec<Source>>,
}

impl<'a> JointModel<'a> {
    fn new(parameters: &[FreeParameter], sets: &'a [DataSet<'a>], fixed: &[(String, f64)]) -> Result<Self, FitError> {
        let nothing = |what| FitError::Nothing { what };
        sets.first().ok_or_else(|| nothing("data"))?;
        parameters.first().ok_or_else(|| nothing("free parameters"))?;
        for (i, parameter) in parameters.iter().enumerate() {
            if parameters[..i].iter().any(|other| other.name == parameter.name) {
                let name = parameter.name.clone();
                return Err(FitError::RepeatedParameter { name });
            }
        }
        let is_free = |name: &str| parameters.iter().any(|parameter| parameter.name == name);
        let sets: Vec<Prepared<'a>> = sets
            .iter()
            .map(|set| Prepared::new(set, &is_free))
            .collect::<Result<_, _>>()?;
        check_noise(&sets)?;
        let model = Self {
            coordinates: parameters.iter().map(|p| p.coordinate([])).collect::<Result<_, _>>()?,
            sources: sets
                .iter()
                .map(|set| sources(set, parameters, fixed))
                .collect::<Result<_, _>>()?,
            sets,
        };
        let numbers: usize = model.sets.iter().map(Prepared::count).sum();
        let fitted = parameters.len() + model.nuisance();
        if numbers < fitted {
            let parameters = fitted;
            return Err(FitError::TooFewNumbers { numbers, parameters });
        }
        for (i, parameter) in parameters.iter().enumerate() {
            let is_used = |source: &Source| matches!(source, Source::Free(free) if *free == i);
            if !model.sources.iter().flatten().any(is_used) {
                let name = parameter.name.clone();
                return Err(FitError::UnusedParameter { name });
            }
        }
        Ok(model)
    }

    /// Returns the values of the parameters of a set.
    fn values(&self, set: usize, free: &[f64]) -> Vec<f64> {
        let value = |source: &Source| match *source {
            Source::Free(i) => free[i],
            Source::Fixed(value) => value,
        };
        self.sources[set].iter().map(value).collect()
    }

    /// Returns the most promising starts at which one positive parameter is smaller or larger than at those given, or
    /// two are: searches may end where there is no state beyond.
    fn further_starts(&self, starts: &[Vec<f64>]) -> Vec<Vec<f64>> {
        let positive: Vec<usize> = (0..self.coordinates.len())
            .filter(|i| self.coordinates[*i].scale == Scale::Logarithm)
            .collect();
        let moves = positive
            .iter()
            .flat_map(|i| [1.0 / FURTHER, FURTHER].map(|factor| (*i, factor)));
        let moves: Vec<(usize, f64)> = moves.collect();
        let moved = |start: &Vec<f64>, moves: &[(usize, f64)]| {
            let mut start = start.clone();
            for (i, factor) in moves {
                let (lower, upper) = self.coordinates[*i].limits;
                start[*i] = (start[*i] * factor).clamp(lower, upper);
            }
            start
        };
        let pairs = moves.iter().enumerate().flat_map(|(at, one)| {
            let others = moves[at + 1..].iter().filter(|other| other.0 != one.0);
            others.map(|other| vec![*one, *other])
        });
        let all: Vec<Vec<(usize, f64)>> = moves.iter().map(|one| vec![*one]).chain(pairs).collect();
        let tried = starts
            .iter()
            .flat_map(|start| all.iter().map(|moves| moved(start, moves)));
        let valued = tried.filter_map(|start| {
            let rows = self.residuals(&start)?;
            Some((rows.iter().map(|row| row.0 * row.0).sum::<f64>(), start))
        });
        let mut valued: Vec<(f64, Vec<f64>)> = valued.collect();
        valued.sort_by(|a, b| a.0.total_cmp(&b.0));
        valued
            .into_iter()
            .map(|(_, start)| start)
            .take(FURTHER_STARTS)
            .collect()
    }

    fn failure(&self) -> Option<FitError> {
        self.sets.iter().find_map(Prepared::failure)
    }

    /// Returns the error of the first set without a state.
    fn no_state(&self, starts: &[Vec<f64>]) -> FitError {
        let first = &starts[0];
        let mut sets = self.sets.iter().enumerate();
        let lacks = |(i, set): &(usize, &Prepared<'_>)| set.residuals(&self.values(*i, first)).is_none();
        let set = sets.find(lacks).map_or(self.sets[0].name, |(_, set)| set.name);
        FitError::NoState { set: set.to_owned() }
    }

    /// Returns the sets beside their models, from the residuals of all sets and the lengths of correlation.
    fn results(&self, free: &[f64], residuals: &[f64], lengths: &[Option<f64>]) -> Option<Vec<SetResult>> {
        let mut first = 0;
        let result = |(i, set): (usize, &Prepared<'_>)| {
            let found = &residuals[first..first + set.count()];
            first += set.count();
            let mut result = SetResult {
                name: set.name.to_owned(),
                points: found.len(),
                sum_of_squares: found.iter().map(|r| r * r).sum(),
                residuals: found.to_vec(),
                simulated: Vec::new(),
                field: None,
            };
            match &set.numbers {
                Numbers::Field(model) => {
                    let length = lengths.get(i).copied().flatten();
                    result.field = Some(model.result(&self.values(i, free), self.coordinates.len(), length)?);
                }
                Numbers::Single {
                    rows,
                    data,
                    scale,
                    total,
                    ..
                } => {
                    result.residuals = vec![0.0; *total];
                    result.simulated = vec![f64::NAN; *total];
                    for (at, row) in rows.iter().enumerate() {
                        result.residuals[*row] = found[at];
                        result.simulated[*row] = data[at] + scale[at] * found[at];
                    }
                }
            }
            Some(result)
        };
        self.sets.iter().enumerate().map(result).collect()
    }

    /// Returns the effect of the noise of each set.
    fn noise(&self, evaluation: &Evaluation) -> Vec<CorrelatedNoise> {
        let count = self.coordinates.len();
        let jacobian = &evaluation.jacobian;
        let mut first = 0;
        let of = |set: &Prepared<'_>| {
            let (start, numbers) = (first, set.count());
            first += numbers;
            let rows = start..start + numbers;
            let correlated = match &set.numbers {
                Numbers::Field(model) => model.noise(&evaluation.residual[rows.clone()], jacobian, start),
                Numbers::Single { .. } => None,
            };
            correlated.unwrap_or_else(|| CorrelatedNoise {
                gram: Mat::from_fn(count, count, |i, j| {
                    rows.clone().map(|row| jacobian[(row, i)] * jacobian[(row, j)]).sum()
                }),
                motion: set.nuisance() as f64,
                length: None,
            })
        };
        self.sets.iter().map(of).collect()
    }
}

/// Refuses sets whose residuals have different units.
fn check_noise(sets: &[Prepared<'_>]) -> Result<(), FitError> {
    let Some(first) = sets.first() else {
        return Ok(());
    };
    match sets.iter().find(|set| set.noise != first.noise) {
        Some(other) => Err(FitError::MixedSets {
            set: other.name.to_owned(),
            first: first.name.to_owned(),
        }),
        None => Ok(()),
    }
}

/// Returns where the values of the parameters of a set come from.
fn sources(set: &Prepared<'_>, parameters: &[FreeParameter], fixed: &[(String, f64)]) -> Result<Vec<Source>, FitError> {
    let source = |need: crate::elastomer::Need| {
        let free = parameters.iter().position(|parameter| parameter.name == need.name);
        let value = || {
            fixed
                .iter()
                .find(|(name, _)| *name == need.name)
                .map(|(_, value)| *value)
        };
        match (free, free.is_none().then(value).flatten().or(need.default)) {
            (Some(i), _) => Ok(Source::Free(i)),
            (None, Some(value)) => Ok(Source::Fixed(value)),
            (None, None) => Err(FitError::MissingParameter {
                set: set.name.to_owned(),
                name: need.name,
            }),
        }
    };
    set.needs().into_iter().map(source).collect()
}

impl Model for JointModel<'_> {
    fn coordinates(&self) -> &[Coordinate] {
        &self.coordinates
    }

    fn residuals(&self, values: &[f64]) -> Option<Vec<Number>> {
        let mut all = Vec::new();
        for (i, set) in self.sets.iter().enumerate() {
            let rows = set.residuals(&self.values(i, values))?;
            all.extend(rows.into_iter().map(|(residual, own)| {
                let mut gradient = vec![0.0; values.len()];
                for (source, slope) in self.sources[i].iter().zip(own) {
                    if let Source::Free(at) = source {
                        gradient[*at] += slope;
                    }
                }
                (residual, gradient)
            }));
        }
        Some(all)
    }

    fn data(&self) -> f64 {
        self.sets.iter().map(Prepared::squares).sum()
    }

    fn stated(&self) -> bool {
        self.sets.iter().all(|set| set.noise == Noise::Stated)
    }

    fn pairs_from(&self) -> Option<usize> {
        None
    }

    fn nuisance(&self) -> usize {
        self.sets.iter().map(Prepared::nuisance).sum()
    }

    fn correlated(&self, evaluation: &Evaluation) -> Option<Correlated> {
        let sets = self.noise(evaluation);
        let any = sets.iter().any(|set| set.length.is_some());
        any.then(|| {
            let count = self.coordinates.len();
            let entry = |i: usize, j: usize| sets.iter().map(|set| set.gram[(i, j)]).sum();
            Correlated {
                gram: Mat::from_fn(count, count, entry),
                nuisance: sets.iter().map(|set| set.motion).sum(),
                lengths: sets.iter().map(|set| set.length).collect(),
            }
        })
    }
}
